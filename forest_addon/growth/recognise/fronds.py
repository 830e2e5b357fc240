"""Fronds of a palm: leaves so large that they are its branches.

A trunk that bears no wood but long leaves is a palm's. Each frond gets a midrib, a thin tube along its
centreline from the trunk's axis to its tip, which is its branch and bears it; so a palm is made of the
same pieces as other trees.
"""

from __future__ import annotations

import numpy as np

from ..mesh.tubes import tube
from .centreline import Centrelines, find_centrelines
from .hierarchy import Known
from .pieces import Pieces, assemble, join_pieces
from .tubes import find_contacts

LONG = 0.08  # heights of the trunk that a frond is long at least
FEWEST = 3
SLENDER = 0.004  # of a frond's length is its midrib's radius, at the trunk
SIDES = 4


def are_fronds(trunk: Centrelines, leaves: Pieces) -> bool:
    """Return whether the leaves are so long that they are a palm's fronds."""
    if leaves.count < FEWEST:
        return False
    low, high = np.full((leaves.count, 3), np.inf), np.full((leaves.count, 3), -np.inf)
    np.minimum.at(low, leaves.piece_of_vertex, leaves.vertices)
    np.maximum.at(high, leaves.piece_of_vertex, leaves.vertices)
    long = float(np.median(np.linalg.norm(high - low, axis=1)))
    return long >= LONG * float(trunk.length().max())


def draw_midribs(
    timber: Pieces, lines: Centrelines, leaves: Pieces
) -> tuple[Pieces, Centrelines, Known]:
    """The trunk and a midrib for each frond, in their order; their lines, and that they hang on it."""
    fronds = find_centrelines(leaves)
    ends = fronds.ends()
    touch = find_contacts(lines, np.array([0]), ends.reshape(-1, 3))
    gap = touch.gap.reshape(-1, 2)
    foot_end = np.argmin(gap, axis=1)
    row = np.arange(leaves.count)
    along = touch.along.reshape(-1, 2)[row, foot_end]
    foot = np.stack([np.interp(along, lines.along, x) for x in lines.knot.T], axis=1)
    thick = touch.radius.reshape(-1, 2)[row, foot_end]
    vertices, triangles, piece, count = [], [], [], 0
    for number in range(leaves.count):
        knots = fronds.knot[fronds.first[number] : fronds.first[number + 1]]
        knots = knots[::-1] if foot_end[number] else knots
        knots = _smooth(np.concatenate([foot[number : number + 1], knots]))
        step = np.linalg.norm(np.diff(knots, axis=0), axis=1)
        knots = knots[np.concatenate([[True], step > 1e-9 * step.sum()])]
        radius = SLENDER * float(step.sum()) * np.linspace(1.0, 0.25, len(knots))
        corners, facets = tube(knots, radius, SIDES)
        vertices.append(corners)
        triangles.append(facets.astype(np.int64) + count)
        piece.append(np.full(len(facets), number))
        count += len(corners)
    midribs = assemble(
        np.concatenate(vertices), np.concatenate(triangles), np.concatenate(piece), drawn=0
    )
    whole = join_pieces(timber, midribs)
    known = Known(
        np.concatenate([[-1], np.zeros(leaves.count, dtype=np.int64)]),
        np.concatenate([np.zeros((1, 3)), foot]),
        np.concatenate([[0.0], thick]),
    )
    return whole, find_centrelines(whole), known


def _smooth(knots: np.ndarray) -> np.ndarray:
    """A course through knots that lie now on one half of a flat frond, now on the other."""
    for _ in range(min(len(knots) // 2, 12)):
        knots[1:-1] = (knots[:-2] + 2 * knots[1:-1] + knots[2:]) / 4
    return knots
