"""A tree in a few hundred triangles, for views of forests of thousands: trunk, limbs, crown of cards.

Trunk and thickest limbs are tubes along the skeleton. The crown is made of cards: leaves that are near each
other become one, which has about the area of those leaves, so that a crown lets as much sky through as the
tree's own. It stands in for its tree in views alone; sensors and renders never see it. The more trees a
view has to draw, the fewer triangles each has (``level_for``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.trimesh import LEAF, WOOD, TriMesh, join
from ..skeleton import Skeleton, find_axes
from .meshing import tube

WIDEST = 4.2  # of a card, its size over the spread of its leaves
ENOUGH = 20_000  # triangles of leaves that are looked at
SLENDER = 1.25  # of a card, length over width
SPREAD = 1.6  # area of cards over that of their leaves: a card hides itself less than they do


class Level(NamedTuple):
    """Level of detail of a stand-in.

    most : triangles at most. cards : groups of leaves, of a card each. limbs : how many.
    trunk, limb : rings and sides of their tubes.
    """

    most: int
    cards: int
    limbs: int
    trunk: tuple[int, int]
    limb: tuple[int, int]


LEVELS = (
    Level(500, 144, 6, (6, 5), (4, 3)),
    Level(240, 72, 3, (4, 4), (3, 3)),
    Level(120, 36, 2, (3, 3), (2, 3)),
    Level(60, 24, 0, (2, 3), (2, 3)),
    Level(30, 9, 0, (2, 3), (2, 3)),
)


def level_for(trees: int, drawable: int) -> Level:
    """The finest level of which so many trees have at most ``drawable`` triangles together; else the
    coarsest."""
    return next((level for level in LEVELS if trees * level.most <= drawable), LEVELS[-1])


def stand_in(mesh: TriMesh, skeleton: Skeleton, level: Level = LEVELS[0]) -> TriMesh:
    """The few triangles of a level, with the parts and material slots of trees; none of a tree without
    height."""
    if not len(mesh.vertices) or not mesh.vertices[:, 2].max() > 0:
        return TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), WOOD)
    tubes = _wood(skeleton, level) or [_pole(mesh, *level.trunk)]
    wood = [TriMesh.of_part(*one, WOOD) for one in tubes]
    return join([*wood, TriMesh.of_part(*_cards(mesh, level.cards), LEAF, material=1)])


def _wood(skeleton: Skeleton, level: Level) -> list[tuple[np.ndarray, np.ndarray]]:
    """Tubes of the thickest axis of order 0 and of the limbs with most wood."""
    if not len(skeleton):
        return []
    axes = find_axes(skeleton)
    length = skeleton.length
    volume = length * (skeleton.radius**2).sum(axis=1)
    held = np.add.reduceat(volume[axes.segment], axes.first[:-1])
    order = skeleton.order[axes.segment[axes.first[:-1]]]
    stems = np.flatnonzero(order == 0)
    stems = stems[np.argsort(-held[stems], kind="stable")]
    limbs = np.concatenate([stems[1:], np.flatnonzero(order > 0)])
    limbs = limbs[np.argsort(-held[limbs], kind="stable")][: level.limbs + (not len(stems))]
    wanted = [(axis, level.trunk) for axis in stems[:1]] + [(axis, level.limb) for axis in limbs]
    return [
        made
        for axis, (rings, sides) in wanted
        if (
            made := _along(
                skeleton, axes.segment[slice(*axes.first[axis : axis + 2])], rings, sides
            )
        )
    ]


def _along(
    skeleton: Skeleton, segments: np.ndarray, rings: int, sides: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """A tube along an axis through so many of its places, evenly; None of one without length."""
    points = np.concatenate([skeleton.start[segments[:1]], skeleton.end[segments]])
    radius = np.concatenate([skeleton.radius[segments[:1], 0], skeleton.radius[segments, 1]])
    gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    if not gone[-1] > 0:
        return None
    at = np.linspace(0.0, gone[-1], rings)
    line = np.column_stack([np.interp(at, gone, axis) for axis in points.T])
    if not (np.diff(line, axis=0) != 0).any(axis=1).all():
        return None
    return tube(line, np.interp(at, gone, radius), sides)


def _pole(mesh: TriMesh, rings: int, sides: int) -> tuple[np.ndarray, np.ndarray]:
    """A trunk for a tree that has no skeleton: as wide as its wood near the ground."""
    solid = mesh.vertices[mesh.triangles[mesh.part != LEAF].ravel()]
    solid = solid if len(solid) else mesh.vertices
    top = float(mesh.vertices[:, 2].max())
    low = solid[solid[:, 2] <= 0.1 * top]
    foot = np.median(low[:, :2], axis=0) if len(low) else np.zeros(2)
    wide = np.linalg.norm(low[:, :2] - foot, axis=1) if len(low) else np.zeros(1)
    radius = max(float(np.median(wide)), 1e-3 * top)
    line = np.column_stack([np.tile(foot, (rings, 1)), np.linspace(0.0, 0.9 * top, rings)])
    return tube(line, np.linspace(radius, 0.1 * radius, rings), sides)


def _cards(mesh: TriMesh, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (4 C, 3) and triangles (2 C, 3) of at most so many cards that stand for the leaves."""
    leaves = np.flatnonzero(mesh.part == LEAF)
    every = max(1, len(leaves) // ENOUGH)  # of a million triangles some say where the crown is
    corners = mesh.vertices[mesh.triangles[leaves[::every]]]
    if not len(corners):
        return np.empty((0, 3)), np.empty((0, 3), np.int32)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1) / 2 * (len(leaves) / len(corners))
    clump = _clumps(corners.mean(axis=1), most)
    count = int(clump.max()) + 1
    whole = np.bincount(clump, area, count)
    solid = whole > 0
    weight = area / np.where(solid, whole, 1.0)[clump]
    everywhere = np.column_stack(
        [np.bincount(clump, weight * axis, count) for axis in corners.mean(axis=1).T]
    )
    away = ((corners.mean(axis=1) - everywhere[clump]) ** 2).sum(axis=1)
    spread = np.sqrt(np.bincount(clump, weight * away, count))[solid]
    side = np.sqrt(SPREAD * whole[solid] / 0.5)  # a rhombus has half of its box
    side = np.where(spread > 0, np.minimum(side, WIDEST * spread), side)
    vertices = _rhombi(everywhere[solid], side).reshape(-1, 3)
    first = 4 * np.arange(len(vertices) // 4)[:, None, None]
    return vertices, (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)


def _rhombi(middle: np.ndarray, side: np.ndarray) -> np.ndarray:
    """(C, 4, 3) corners of cards about their middles (C, 3), each turned in a way of its own."""
    golden = (1 + 5**0.5) / 2
    number = np.arange(len(middle)) + 0.5
    azimuth = 2 * np.pi * number / golden
    lean = np.arccos(1 - 2 * np.mod(7 * number / golden**2, 1.0))  # all ways alike
    along = np.column_stack(
        [np.sin(lean) * np.cos(azimuth), np.sin(lean) * np.sin(azimuth), np.cos(lean)]
    )
    other = np.column_stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(len(middle))])
    long, wide = side * SLENDER**0.5 / 2, side / SLENDER**0.5 / 2
    ends = [long[:, None] * along, wide[:, None] * other]
    return middle[:, None] + np.stack([ends[0], ends[1], -ends[0], -ends[1]], axis=1)


def _clumps(place: np.ndarray, most: int) -> np.ndarray:
    """(P,) the cubic cell that each place is in, of cells as large as leaves at most so many of them."""
    low, size = place.min(axis=0), float(np.ptp(place, axis=0).max()) + 1e-9
    fine, coarse = size / 64, size
    best = np.zeros(len(place), np.int64)
    for _ in range(12):
        edge = (fine * coarse) ** 0.5
        cell = np.floor((place - low) / edge).astype(np.int64)
        flat = (cell[:, 0] * 4096 + cell[:, 1]) * 4096 + cell[:, 2]
        _, number = np.unique(flat, return_inverse=True)
        if number.max() < most:
            best, coarse = number, edge
        else:
            fine = edge
    return best
