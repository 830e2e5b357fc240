"""Which branch grows on which: trunk, parents, and the bearers of leaves.

The trunk is, of the pieces at least ``STOUT`` times as thick at an end as the thickest is, the one that
reaches lowest; where several begin at the same level (a bush), the largest. Roots are too thin to be
taken for it, limbs begin too high.

Everything else is hung on it from the inside out, generation by generation. A piece hangs on a parent
when one of its ends reaches the parent's wood; its foot is that end. A piece that tapers clearly has its
foot at the thick end, so a thin tip that happens to touch a neighbour does not hang on it. Earlier
generations come first, so branches of one whorl hang on the trunk and not on each other. What touches
nothing is hung on what is nearest, smallest gaps first, then again what touches it. Wood is taken as
tubes about centrelines, which also tells that a foot deep inside the trunk touches it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from .centreline import Centrelines
from .pieces import Pieces

STOUT = 0.7  # share of the thickest piece's radius that a trunk has at least
LEVEL = 0.02  # share of the tree's height within which pieces begin at the same level
TAPER = 1.1  # an end this many times as thick as the other is the foot
THIN_END = 0.5  # piece lengths of gap that it takes for the thin end to be the foot after all
REACH = 0.5  # radii that an end may stop short of the wood that it touches
FLOAT = 1.25  # where nothing touches, gaps up to this many times the smallest are taken together
CANDIDATES = 12  # stretches of wood looked at closely for each point


@dataclass(frozen=True)
class Contact:
    """The wood nearest to each of N points.

    piece : (N,) int64.
    gap : (N,) distance to its surface, taken as a tube; negative inside.
    along : (N,) place along its centreline.
    direction : (N, 3) unit, of the centreline there.
    radius : (N,) of the tube there.
    """

    piece: np.ndarray
    gap: np.ndarray
    along: np.ndarray
    direction: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True)
class Hierarchy:
    """Who hangs on whom, for C pieces.

    trunk : piece.
    parent : (C,) piece it hangs on, -1 for the trunk.
    branch : (C,) first-level branch it belongs to, itself if it is one, -1 for the trunk.
    foot_end : (C,) which end of its centreline is the foot, 0 first or 1 last.
    gap : (C,) from its foot to the wood it hangs on, negative inside it; 0 for the trunk.
    """

    trunk: int
    parent: np.ndarray
    branch: np.ndarray
    foot_end: np.ndarray
    gap: np.ndarray


def find_trunk(pieces: Pieces, lines: Centrelines) -> int:
    """The piece that is the trunk, by the rule above."""
    z = pieces.vertices[:, 2]
    lowest = np.full(pieces.count, np.inf)
    np.minimum.at(lowest, pieces.piece_of_vertex, z)
    thickest = lines.end_radius.max(axis=1)
    area = np.bincount(pieces.piece, np.linalg.norm(pieces.area_vectors(), axis=1), pieces.count)
    stout = thickest >= STOUT * thickest.max()
    level = lowest <= lowest[stout].min() + LEVEL * np.ptp(z)
    return int(np.argmax(np.where(stout & level, area * thickest, -1.0)))


def find_parents(lines: Centrelines, trunk: int) -> Hierarchy:
    """Hang all pieces on the trunk, generation by generation."""
    ends, radius = lines.ends(), lines.end_radius
    count = len(ends)
    thin = radius * TAPER < radius[:, ::-1]
    handicap = np.where(thin, THIN_END * lines.length()[:, None], 0.0) - REACH * radius

    parent, branch = np.full(count, -1), np.full(count, -1)
    foot_end = np.zeros(count, dtype=np.int64)
    foot_end[trunk] = int(np.argmin(ends[trunk, :, 2]))
    gap, nearest = np.full((count, 2), np.inf), np.full((count, 2), -1)
    waiting = np.flatnonzero(np.arange(count) != trunk)
    hung = np.array([trunk])
    while len(waiting):
        found = find_contacts(lines, hung, ends[waiting].reshape(-1, 3))
        reach = found.gap.reshape(-1, 2)
        nearer = reach < gap[waiting]
        gap[waiting] = np.where(nearer, reach, gap[waiting])
        nearest[waiting] = np.where(nearer, found.piece.reshape(-1, 2), nearest[waiting])
        best = (gap + handicap)[waiting].min(axis=1)
        ready = best <= 0
        if not ready.any():  # nothing touches: let the nearest, and those about as near, float
            ready = best <= FLOAT * best.min()
        hung = waiting[ready]
        foot_end[hung] = np.argmin((gap + handicap)[hung], axis=1)
        parent[hung] = nearest[hung, foot_end[hung]]
        branch[hung] = np.where(parent[hung] == trunk, hung, branch[parent[hung]])
        waiting = waiting[~ready]
    gap[trunk] = 0.0
    return Hierarchy(trunk, parent, branch, foot_end, gap[np.arange(count), foot_end])


def find_bearers(lines: Centrelines, leaves: Pieces) -> tuple[np.ndarray, np.ndarray]:
    """(L,) the piece of wood that bears each leaf, and (L,) the gap between them.

    A leaf hangs by the corner or middle of an edge that is nearest to any wood; where it reaches into
    several pieces, on the thinnest.
    """
    one, other = leaves.edges.T
    middles = (leaves.vertices[one] + leaves.vertices[other]) / 2
    owner = np.concatenate([leaves.piece_of_vertex, leaves.piece_of_vertex[one]])
    everything = np.arange(len(lines.first) - 1)
    places = np.concatenate([leaves.vertices, middles])
    found = find_contacts(lines, everything, places, thinnest=True)
    gap = np.maximum(found.gap, 0.0)
    size = np.bincount(owner, minlength=leaves.count)
    chosen = np.lexsort((found.radius, gap, owner))[np.cumsum(size) - size]
    return found.piece[chosen], gap[chosen]


def find_contacts(
    lines: Centrelines, pieces: np.ndarray, points: np.ndarray, *, thinnest: bool = False
) -> Contact:
    """The wood of some pieces that is nearest to points (N, 3).

    thinnest : for points inside several tubes, the thinnest of them, and not that whose surface is
        farthest away.

    The tubes are filled with balls. Of balls with centres c and radii r the one with the smallest power
    distance |p - c|² - r² is an ordinary nearest neighbour in four dimensions, (c, √(R² - r²)) to
    (p, 0) with R the largest radius; near balls found so are then measured exactly, as cones.
    """
    mine = np.zeros(len(lines.first) - 1, dtype=bool)
    mine[pieces] = True
    owner = np.repeat(np.arange(len(mine)), np.diff(lines.first))
    start = np.flatnonzero(
        mine[owner[:-1]] & (owner[:-1] == owner[1:])
    )  # (S,) knots before stretches
    vector = lines.knot[start + 1] - lines.knot[start]
    length = np.linalg.norm(vector, axis=1)
    thick = np.maximum(lines.radius[start], lines.radius[start + 1])

    spacing = np.maximum(np.maximum(thick, length / 64), lines.along.max() / 1000)
    balls = np.ceil(length / np.maximum(spacing, np.finfo(float).tiny)).astype(np.int64)
    balls = np.maximum(balls, 1)
    of = np.repeat(np.arange(len(start)), balls)
    part = (np.arange(len(of)) - np.repeat(np.cumsum(balls) - balls, balls) + 0.5) / balls[of]
    radius = lines.radius[start[of]] * (1 - part) + lines.radius[start[of] + 1] * part
    lifted = np.sqrt(np.maximum(radius.max() ** 2 - radius**2, 0.0))
    centre = lines.knot[start[of]] + part[:, None] * vector[of]
    tree = cKDTree(np.column_stack([centre, lifted]))
    lifted_points = np.column_stack([points, np.zeros(len(points))])
    near = tree.query(lifted_points, k=np.arange(min(CANDIDATES, len(of))) + 1, workers=-1)[1]

    stretch = of[near]  # (N, k)
    from_start = points[:, None] - lines.knot[start[stretch]]
    along = np.einsum("nki,nki->nk", from_start, vector[stretch])
    squared = np.maximum(length[stretch] ** 2, np.finfo(float).tiny)
    along = np.clip(along / squared, 0.0, 1.0)
    thickness = lines.radius[start[stretch]] * (1 - along)
    thickness += lines.radius[start[stretch] + 1] * along
    gap = np.linalg.norm(from_start - along[..., None] * vector[stretch], axis=2) - thickness

    rank = np.where(gap < 0, thickness - thickness.max(), gap) if thinnest else gap
    row, best = np.arange(len(points)), np.argmin(rank, axis=1)
    chosen = stretch[row, best]
    return Contact(
        piece=owner[start[chosen]],
        gap=gap[row, best],
        along=lines.along[start[chosen]] + along[row, best] * length[chosen],
        direction=vector[chosen] / np.maximum(length[chosen], np.finfo(float).tiny)[:, None],
        radius=thickness[row, best],
    )
