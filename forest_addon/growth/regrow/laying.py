"""Laying of the branches of one order: bent otherwise than in the template, each at its own slope.

A trunk leaves the ground as it does in the template, so that its base lies as flat, and does not lean much
more. A branch is bent about its line; how its foot's slope differs fades along it, and where it would grow
into the ground it goes on level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rng import keyed_normal
from ...base.vectors import zenith_of
from .courses import lay, lay_sloping, sloped, slopes
from .fitted import Habit

SWEEP = np.deg2rad(15.0)  # turn of a branch's bends about its line
BEND_SPREAD = 0.15
LEAN = np.deg2rad(2.5)  # of a trunk's slope, towards its tip
MOST_LEAN = np.deg2rad(6.0)  # more than the template's, of a trunk from foot to tip
CALMER = (1.0, 0.5, 0.25, 0.0)  # shares of a trunk's own bends that are tried
SWAY = np.deg2rad(4.0)  # of a level branch's slope at its tip
FADE = 4.0  # how fast a foot's other slope is made up for: e^-4 of it is left at the tip


@dataclass(frozen=True)
class Shoots:
    """Branches of one order before they are laid."""

    piece: np.ndarray
    mother: np.ndarray  # row of the order below
    sign: np.ndarray
    scale: np.ndarray
    key: np.ndarray
    share: np.ndarray
    start: np.ndarray  # (B, 3, 3) frames of the feet
    foot: np.ndarray
    girth: np.ndarray  # (B, 2) scale of thickness at foot and tip


def lay_trunks(
    wanted: Shoots,
    bend: np.ndarray,
    length: np.ndarray,
    first: np.ndarray,
    variety: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Bends (S, 2) and frames (S, 3, 3) of trunks: they leave the ground as in the template, and are bent
    and lean otherwise towards the top, but not much more than it leans.
    """
    plain = lay(bend, first, wanted.start)
    most = _leans(plain, length, first) + MOST_LEAN
    owner, part = _owners(first)
    lean = np.clip(keyed_normal(wanted.key, "lean"), -2.0, 2.0)[owner] * part
    chosen_bend, chosen = bend.copy(), plain.copy()
    open_ones = np.ones(len(first) - 1, dtype=bool)
    for calm in CALMER:
        other = _bent_otherwise(bend, wanted.key[owner], part, calm * variety)
        slope = np.clip(slopes(plain) + calm * variety * LEAN * lean, 0.0, np.pi)
        frame = lay_sloping(other, first, wanted.start, slope)
        fits = open_ones & (_leans(frame, length, first) <= most)
        mine = fits[owner]
        chosen_bend[mine], chosen[mine] = other[mine], frame[mine]
        open_ones &= ~fits
    return chosen_bend, chosen


def lay_branches(
    habit: Habit,
    wanted: Shoots,
    bend: np.ndarray,
    length: np.ndarray,
    first: np.ndarray,
    source: np.ndarray,
    variety: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Bends (S, 2) and frames (S, 3, 3) of branches that come back to their own slope, above the ground.

    source : (S,) stretch of the template that each stretch is.
    """
    owner, part = _owners(first)
    bend = _bent_otherwise(bend, wanted.key[owner], part, variety)
    part = part + 0.5 / np.diff(first)[owner]
    slope = _own_slopes(habit, wanted, source, owner, part, variety)
    slope, start = _above_ground(habit, wanted, slope, length, first)
    return bend, lay_sloping(bend, first, start, slope)


def _owners(first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(S,) line of each stretch, and (S,) how far along it that begins, counted in stretches, 0 .. 1."""
    size = np.diff(first)
    owner = np.repeat(np.arange(len(size)), size)
    return owner, (np.arange(len(owner)) - first[owner]) / size[owner]


def _bent_otherwise(
    bend: np.ndarray, key: np.ndarray, part: np.ndarray, variety: float
) -> np.ndarray:
    """Bends (S, 2) turned about the line, by more or less along it, and more or less strong."""
    turn = keyed_normal(key, "sweep") + 1.5 * (part - 0.5) * keyed_normal(key, "swerve")
    cos, sin = np.cos(variety * SWEEP * turn), np.sin(variety * SWEEP * turn)
    turned = np.stack(
        [cos * bend[:, 0] - sin * bend[:, 1], sin * bend[:, 0] + cos * bend[:, 1]], axis=1
    )
    return np.asarray(turned * np.exp(variety * BEND_SPREAD * keyed_normal(key, "bend"))[:, None])


def _leans(frame: np.ndarray, length: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(C,) radians from the vertical, from foot to tip."""
    way = np.add.reduceat(frame[:, :, 2] * length[:, None], first[:-1], axis=0)
    return zenith_of(way)


def _own_slopes(
    habit: Habit,
    wanted: Shoots,
    source: np.ndarray,
    owner: np.ndarray,
    part: np.ndarray,
    variety: float,
) -> np.ndarray:
    """(S,) slopes of stretches: the piece's own, but for how the foot's differs, which fades along it."""
    lines = habit.anatomy.lines
    own = slopes(lines.frame[source])
    at_foot = slopes(wanted.start) - slopes(lines.frame[lines.first[wanted.piece]])
    sway = variety * SWAY * keyed_normal(wanted.key, "sway")[owner] * part * np.sin(own)
    return np.asarray(np.clip(own + at_foot[owner] * np.exp(-FADE * part) + sway, 0.0, np.pi))


def _above_ground(
    habit: Habit, wanted: Shoots, slope: np.ndarray, length: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (S,) and feet's frames (C, 3, 3) of branches that go on level where they reach the ground."""
    slope, start = slope.copy(), wanted.start
    slope[first[:-1]] = slopes(start)
    owner, _ = _owners(first)
    rise = np.cumsum(length * np.cos(slope))
    base = wanted.foot[:, 2] - (rise - length * np.cos(slope))[first[:-1]]
    floor = np.minimum(habit.floor[wanted.piece], wanted.foot[:, 2])
    if (rise + base[owner] >= floor[owner]).all():
        return slope, start
    height = np.maximum(rise + base[owner], floor[owner])
    before = np.concatenate([[0.0], height[:-1]])
    before[first[:-1]] = wanted.foot[:, 2]
    level = np.arccos(np.clip((height - before) / np.maximum(length, 1e-12), -1.0, 1.0))
    touched = np.abs(level - slope) > 1e-6
    slope[touched] = level[touched]
    low = np.flatnonzero(touched[first[:-1]])
    start = start.copy()
    start[low] = sloped(start[low], slope[first[:-1][low]])
    return slope, start
