"""Rooting of pieces that begin deep within another one, so that their parent is plain.

A tip or a flank may touch any wood; a foot that was drawn from its parent's axis lies near that axis. An end
is rooted in a piece where it is at most half her radius off her axis, she is no thinner there than the end,
and it is not where she herself begins (there, feet of a whorl lie within one another). Of several, the one
whose axis is nearest in her radii is the parent; less likely is a thinner end of the piece, and an end of
another one as thin as it, which may be a sister's that begins at the same place.
What is rooted nowhere is left to whatever it touches (``hierarchy``).
"""

from __future__ import annotations

import numpy as np

from .centreline import Centrelines
from .hierarchy import TAPER, Known
from .tubes import Tubes

DEEP = 0.5  # radii of the parent off her axis, at most
STOUT = 0.9  # radii of the end that she is thick there at least
TAPERS = 1.05  # ends differ by more than this factor where they tell which of them is the foot
FEET = 1.5  # radii from where a piece begins within which nothing is rooted in it
LESS = 0.25  # added, in radii, to what is less likely
THICKER = 1.1  # than the end, by this factor, a piece is at its own end unless it may be a sister
NEAREST = 12  # balls looked at, of each group


def root(lines: Centrelines, trunk: int, known: Known) -> Known:
    """Return what is known of parents, and the parents of pieces that are rooted deep in one."""
    count = len(lines.first) - 1
    free = np.flatnonzero((known.mother < 0) & (np.arange(count) != trunk))
    if not len(free):
        return known
    tubes = Tubes.of(lines, np.arange(count))
    ends, thick = lines.ends()[free], lines.end_radius[free]
    cone, aside, part, radius = tubes.beside(ends.reshape(-1, 3), NEAREST)
    mother = tubes.piece[cone]
    along = tubes.along[cone] + part * tubes.length[cone]
    own = np.repeat(free, 2)[:, None]
    rank = aside / np.maximum(radius, 1e-12)
    fits = (rank <= DEEP) & (mother != own) & (radius >= STOUT * thick.reshape(-1, 1))
    fits &= ~_begins_there(lines, mother, along, radius, TAPERS)
    other = thick[:, ::-1].reshape(-1, 1)
    fits &= thick.reshape(-1, 1) * TAPER >= other
    rank += LESS * (thick.reshape(-1, 1) < other)
    sister = _begins_there(lines, mother, along, radius, TAPER)
    rank += LESS * (sister & (radius < THICKER * thick.reshape(-1, 1)))
    rank[~fits] = np.inf

    width = rank.shape[1]
    rank = rank.reshape(len(free), 2 * width)
    best = np.argmin(rank, axis=1)
    row, found = 2 * np.arange(len(free)) + best // width, best % width
    sure = np.isfinite(rank[np.arange(len(free)), best])
    row, found, rooted = row[sure], found[sure], free[sure]
    chosen = cone[row, found]
    foot = tubes.start[chosen] + part[row, found][:, None] * tubes.vector[chosen]
    mothers, feet, thickness = known.mother.copy(), known.foot.copy(), known.radius.copy()
    mothers[rooted], feet[rooted] = tubes.piece[chosen], foot
    thickness[rooted] = radius[row, found]
    rings = _in_rings(mothers)
    mothers[rings] = known.mother[rings]
    return Known(mothers, feet, thickness)


def _begins_there(
    lines: Centrelines, mother: np.ndarray, along: np.ndarray, radius: np.ndarray, tapers: float
) -> np.ndarray:
    """Return whether places along pieces are where these begin: at an end, unless that tapers by this
    factor."""
    length, ends = lines.length()[mother], lines.end_radius[mother]
    first = (along <= FEET * radius) & (ends[..., 0] * tapers > ends[..., 1])
    last = (length - along <= FEET * radius) & (ends[..., 1] * tapers > ends[..., 0])
    return np.asarray(first | last)


def _in_rings(mother: np.ndarray) -> np.ndarray:
    """(N,) pieces that are their own ancestors."""
    at = np.arange(len(mother))
    above = np.where(mother < 0, at, mother)
    for _ in range(len(mother).bit_length()):  # so far up that who is not at the top goes round
        above = above[above]
    return np.unique(above[mother[above] >= 0])
