"""Two lists of the stems of one plot, by hand and by scan, matched: which stem of one is which of the other.

Both have their origin near the plot's centre, and norths that differ: the turn and shift are looked for that
bring most stems within 0.6 m of each other (from all turns, nearest neighbours and least squares in turns).
The same of a list mirrored says how many meet by chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

NEAR = 0.6  # m between a stem on one list and on the other
STARTS = np.deg2rad(np.arange(-180.0, 180.0, 5.0))
STAGES = (1.5, 1.0, NEAR)  # m within which neighbours count, one after the other
FEWEST = 4  # neighbours that tell a turn and a shift
CERTAIN = 2.0  # times as many matches as of the mirrored list, for a plot to count


@dataclass(frozen=True)
class StemMatch:
    """turn : radians from the found list to the given one. shift : (2,) m. given, found : (K,) rows that are
    one stem. chance : matches of the mirrored list."""

    turn: float
    shift: np.ndarray
    given: np.ndarray
    found: np.ndarray
    chance: int

    @property
    def certain(self) -> bool:
        """Return whether far more stems meet than by chance."""
        return len(self.given) > CERTAIN * self.chance


def match_stems(given: np.ndarray, found: np.ndarray) -> StemMatch:
    """Match places (N, 2) of a list with those (M, 2) of another, metres."""
    turn, shift, rows = _best(given, found)
    chance = len(_best(given, found * [-1.0, 1.0])[2])
    return StemMatch(turn, shift, rows[:, 0], rows[:, 1], chance)


def _best(given: np.ndarray, found: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Turn, shift and (K, 2) pairs of rows of the start that matches most."""
    tree = cKDTree(given)
    best = (0.0, np.zeros(2), np.zeros((0, 2), dtype=np.int64))
    for start in STARTS:
        turn, shift = float(start), np.zeros(2)
        for reach in STAGES:
            away, near = tree.query(_turned(found, turn) + shift)
            ok = away < reach
            if ok.sum() < FEWEST:
                break
            turn, shift = _fitted(found[ok], given[near[ok]])
        moved = _turned(found, turn) + shift
        away, near = tree.query(moved)
        mutual = cKDTree(moved).query(given)[1][near] == np.arange(len(found))
        rows = np.flatnonzero(mutual & (away < NEAR))
        if len(rows) > len(best[2]):
            best = turn, shift, np.column_stack([near[rows], rows])
    return best


def _turned(place: np.ndarray, turn: float) -> np.ndarray:
    c, s = np.cos(turn), np.sin(turn)
    return np.asarray(place @ np.array([[c, s], [-s, c]]))


def _fitted(start: np.ndarray, end: np.ndarray) -> tuple[float, np.ndarray]:
    """Turn and shift that bring places (K, 2) to others by least squares."""
    a, b = start - start.mean(axis=0), end - end.mean(axis=0)
    turn = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    return turn, end.mean(axis=0) - _turned(start.mean(axis=0), turn)
