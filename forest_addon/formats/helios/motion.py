"""Parts of a HELIOS++ scene that move: sequences of rigid motions, one step of a sequence at a time.

A step takes the part's turn R and its middle c to A·R and B·c + C: a motion of the part in itself turns it
about its middle (B is the identity), any other about the origin of HELIOS++'s own frame, which is the lowest
corner of the box around the whole scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from .document import number, vector, yes


@dataclass(frozen=True)
class MotionStep:
    """Rigid motion of a step: turns become ``turn`` · R, middles ``carry`` · c + ``move``, metres."""

    turn: np.ndarray
    carry: np.ndarray
    move: np.ndarray

    def after(self, first: MotionStep) -> MotionStep:
        """Both, ``first`` before this one."""
        return MotionStep(
            self.turn @ first.turn, self.carry @ first.carry, self.carry @ first.move + self.move
        )


@dataclass(frozen=True)
class MotionSequence:
    """Step that is taken ``loop`` times (0: for ever), before the sequence ``next`` (empty: it stands)."""

    name: str
    step: MotionStep
    loop: int
    next: str


@dataclass(frozen=True)
class PartMotion:
    """Motion of a part: sequences, the first one first; each step lasts ``every`` pulses."""

    sequences: tuple[MotionSequence, ...]
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
    sequences = tuple(_sequence(element, origin, where) for element in part.findall("dmotion"))
    if not sequences:
        return None
    names = [one.name for one in sequences]
    for one in sequences:
        if one.next and one.next not in names:
            raise SpecError(str(where), f'dmotion "{one.name}": next = "{one.next}" is not there')
    return PartMotion(sequences, _interval(scene, part, pulse_rate, where))


def _interval(scene: Element, part: Element, pulse_rate: float, where: Path) -> int:
    """Pulses between two steps of a part."""
    seconds = number(scene, "dynTimeStep", where, 0.0)
    if seconds > 0:
        steps = max(int(number(part, "dynTimeStep", where, seconds) / seconds), 1)
        return max(int(pulse_rate * seconds), 1) * steps
    rates = [number(element, "dynStep", where, 1.0) for element in (scene, part)]
    return int(max(rates[0], 1.0)) * int(max(rates[1], 1.0))


def _sequence(element: Element, origin: np.ndarray, where: Path) -> MotionSequence:
    name = element.get("id", "")
    if element.get("loop") is None:
        raise SpecError(str(where), f'dmotion "{name}" has no loop')
    total = MotionStep(np.eye(3), np.eye(3), np.zeros(3))
    motions = element.findall("motion")
    if not motions:
        raise SpecError(str(where), f'dmotion "{name}" holds no motion')
    for motion in motions:
        for step in _steps(motion, origin, where):
            total = step.after(total)
    return MotionSequence(name, total, int(number(element, "loop", where)), element.get("next", ""))


def _steps(motion: Element, origin: np.ndarray, where: Path) -> list[MotionStep]:
    """The steps of a motion, in the world."""
    kind = motion.get("type", "")
    itself = yes(motion.get("selfMode"), False)
    shift = number(motion, "autoCRS", where, 0.0) * origin
    none, unit = np.zeros(3), np.eye(3)

    def of(key: str) -> np.ndarray:
        if motion.get(key) is None:
            raise SpecError(str(where), f'motion "{kind}" has no {key}')
        return vector(motion.get(key, ""), where)

    def about() -> np.ndarray:
        turn = np.deg2rad(number(motion, "angle", where)) * _unit(of("axis"))
        return Rotation.from_rotvec(turn).as_matrix()

    def placed(turn: np.ndarray, move: np.ndarray) -> MotionStep:
        if itself:
            return MotionStep(turn, unit, move)
        return MotionStep(turn, turn, move + origin - turn @ origin)

    if kind == "identity":
        return [MotionStep(unit, unit, none)]
    if kind == "translation":
        return [placed(unit, of("vec") + shift)]
    if kind == "rotation" and motion.get("center") is not None:
        centre = of("center") - shift
        return [placed(unit, -centre), placed(about(), none), placed(unit, centre)]
    if kind == "rotation":
        return [placed(about(), none)]
    if kind == "helical":
        return [placed(about(), number(motion, "glide", where) * _unit(of("axis")))]
    if kind == "reflection":
        return [placed(_mirror(of("ortho")), none)]
    if kind == "glideplane":
        return [placed(_mirror(of("ortho")), of("shift"))]
    if kind == "rotsym":
        turn = _mirror(of("axis")) @ about()
        centre = of("center") if motion.get("center") is not None else none
        return [placed(turn, centre - turn @ centre)]
    raise SpecError(str(where), f'motion type "{kind}" is not known')


def _mirror(normal: np.ndarray) -> np.ndarray:
    n = _unit(normal)
    return np.eye(3) - 2 * np.outer(n, n)


def _unit(axis: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(axis))
    return axis / length if length else axis
