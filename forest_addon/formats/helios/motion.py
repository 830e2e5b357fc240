"""Motions of parts of a HELIOS++ scene: sequences of rigid motions, one step of a sequence at a time.

A step takes the part's turn R and its middle c to A·R and B·c + C: a motion of the part in itself turns it
about its middle (B is the identity), any other about the origin of HELIOS++'s own frame, which is the lowest
corner of the box around the whole scene. A step is an array (2, 4, 4), A and the affine map of B and C, so
that steps after one another are products.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from .document import number, vector, yes

STILL = np.tile(np.eye(4), (2, 1, 1))


@dataclass(frozen=True)
class PartMotion:
    """Motion of a part: steps (2, 4, 4) in the order of time, each taken so many ``times`` (0: for ever), the
    ones from number ``again`` on over and over (beyond the last: none). A step lasts ``every`` pulses."""

    steps: tuple[np.ndarray, ...]
    times: tuple[int, ...]
    again: int
    every: int


def read_motion(
    scene: Element, part: Element, origin: np.ndarray, pulse_rate: float, where: Path
) -> PartMotion | None:
    """The motion of a part; None of one that stands.

    origin : (3,) metres, of HELIOS++'s own frame. pulse_rate : Hz, of the first leg.

    Raises
    ------
    SpecError : a motion that is not known, or a number that is missing.
    """
    elements = part.findall("dmotion")
    if not elements:
        return None
    said = [_sequence(element, origin, where) for element in elements]
    names = [element.get("id", "") for element in elements]
    order: list[int] = []
    now: int | None = 0
    for name, (_, _, following) in zip(names, said, strict=True):
        if following and following not in names:
            raise SpecError(str(where), f'dmotion "{name}": next = "{following}" is not there')
    while now is not None and now not in order:
        order.append(now)
        _, times, following = said[now]
        now = names.index(following) if times > 0 and following else None
    again = len(order) if now is None else order.index(now)
    steps, times_of, _ = zip(*(said[one] for one in order), strict=True)
    return PartMotion(steps, times_of, again, _interval(scene, part, pulse_rate, where))


def _interval(scene: Element, part: Element, pulse_rate: float, where: Path) -> int:
    """Pulses between two steps of a part."""
    seconds = number(scene, "dynTimeStep", where, 0.0)
    if seconds > 0:
        steps = max(int(number(part, "dynTimeStep", where, seconds) / seconds), 1)
        return max(int(pulse_rate * seconds), 1) * steps
    rates = [number(element, "dynStep", where, 1.0) for element in (scene, part)]
    return int(max(rates[0], 1.0)) * int(max(rates[1], 1.0))


def _sequence(element: Element, origin: np.ndarray, where: Path) -> tuple[np.ndarray, int, str]:
    """A sequence: its step, how often it is taken, and the name of the next."""
    name, total = element.get("id", ""), STILL
    if element.get("loop") is None:
        raise SpecError(str(where), f'dmotion "{name}" has no loop')
    motions = element.findall("motion")
    if not motions:
        raise SpecError(str(where), f'dmotion "{name}" holds no motion')
    for motion in motions:
        total = _step(motion, origin, where) @ total
    times = max(int(number(element, "loop", where)), 0)
    return total, times, element.get("next", "")


def _step(motion: Element, origin: np.ndarray, where: Path) -> np.ndarray:
    """(2, 4, 4) the step of a motion, in the world."""
    kind, unit, none = motion.get("type", ""), np.eye(3), np.zeros(3)
    shift = number(motion, "autoCRS", where, 0.0) * origin

    def of(key: str) -> np.ndarray:
        if motion.get(key) is None:
            raise SpecError(str(where), f'motion "{kind}" has no {key}')
        return vector(motion.get(key, ""), where)

    def along(key: str) -> np.ndarray:
        axis = of(key)
        return axis / (float(np.linalg.norm(axis)) or 1.0)

    def mirror(key: str) -> np.ndarray:
        return unit - 2 * np.outer(along(key), along(key))

    def about() -> np.ndarray:
        turn = np.deg2rad(number(motion, "angle", where)) * along("axis")
        return Rotation.from_rotvec(turn).as_matrix()

    def placed(turn: np.ndarray, move: np.ndarray) -> np.ndarray:
        placed_parts = STILL.copy()
        placed_parts[0, :3, :3], placed_parts[1, :3, 3] = turn, move
        if not yes(motion.get("selfMode"), False):
            placed_parts[1, :3, :3], placed_parts[1, :3, 3] = turn, move + origin - turn @ origin
        return placed_parts

    if kind == "identity":
        return STILL
    if kind == "translation":
        return placed(unit, of("vec") + shift)
    if kind == "rotation" and motion.get("center") is not None:
        centre = of("center") - shift
        return placed(unit, centre) @ placed(about(), none) @ placed(unit, -centre)
    if kind == "rotation":
        return placed(about(), none)
    if kind == "helical":
        return placed(about(), number(motion, "glide", where) * along("axis"))
    if kind in ("reflection", "glideplane"):
        return placed(mirror("ortho"), of("shift") if kind == "glideplane" else none)
    if kind == "rotsym":
        turn = mirror("axis") @ about()
        centre = of("center") if motion.get("center") is not None else none
        return placed(turn, centre - turn @ centre)
    raise SpecError(str(where), f'motion type "{kind}" is not known')
