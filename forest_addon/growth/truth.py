"""The truth of a tree: its wood as exact cones, its leaves by area and angle.

A segment of length h with radii r₁ and r₂ is the frustum of a cone: V = πh(r₁² + r₁r₂ + r₂²)/3, lateral area
A_L = π(r₁ + r₂)√(h² + (r₁ − r₂)²), projected area A_PR = (r₁ + r₂)h. For cylinders of diameter d these are V
= Σπd²h/4, A_L = Σπdh and A_PR = Σdh of Méndez et al. (SIMLIDAR), who sum segments each for itself, so that
what overlaps at a joint counts twice. A tree's volume is that of the solid, joints counted once: 1 to 12 %
less. The mesh fills somewhat less than that, since its polygons have the circle's perimeter (a hexagon 91 %
of its area), and goes on below the ground, which does not count.

Of a tree that is grafted from templates the skeleton knows the trunk and the places of branches only; its
wood is measured on the triangles, with A_PR = A_L/π, which holds for a cylinder however it is turned.

Volume of a skeleton's wood: that of the union of its tubes, joints counted once.

An axis is a bent tube: its segments are frustums cut where they meet, so their volumes πh(r₁² + r₁r₂ + r₂²)/3
add up. A child starts within its parent. What its first segments share with the parent's axis, and with
other children that leave the same segment before it, or the one below, is found by points spread evenly in
them and taken off. Branches that cross each other elsewhere count twice.

Volume of the union of closed pieces of a mesh that reach into each other, as grafted branches do.

Upright lines on a grid cross the mesh; a running sum of the signs of their crossings is the winding number,
so the length of a line within any piece, and that within each piece added up, follow. Their ratio times the
volume by the divergence theorem, which counts what is shared twice, is the union's; errors of the grid are
alike in both and cancel. Lines through a piece that is not closed say nothing and are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..base.rng import stream
from ..base.runs import numbered
from ..base.trimesh import TriMesh, is_wood
from ..base.vectors import unit
from .measured.allometry import crown_of, dbh_of
from .mesh.leaves import Leaves
from .skeleton import TOUCH, Skeleton, find_axes
from .tree import Tree

ANGLE_BINS = 18  # of 5° from 0 to 90°
MEASURES = (  # what ``tree_truth`` tells
    *("height_m", "dbh_m", "crown_base_m", "crown_width_m"),
    *("wood_volume_m3", "wood_area_m2", "projected_wood_m2"),
    *("leaves", "leaf_area_m2", "mean_leaf_angle_deg"),
)
HEADS = 3  # segments of an axis that may lie within others
OTHER_CHILDREN = 4  # of a parent, before a branch, that it may share wood with
PARENTS_SIBLINGS = 3  # that leave the segment below
POINTS = 100_000  # of a tree, in all its joints together
FEWEST, MOST = 32, 4096  # in a segment
EVEN = np.array(
    [0.8191725134, 0.6710436067, 0.5497004779]
)  # steps of an even sequence (Roberts' R3)
TESTS = 600_000  # of a triangle against a line, about


@dataclass(frozen=True)
class Wood:
    """The wood of one tree: volume m³, lateral area m², projected area m²."""

    volume: float
    area: float
    projected: float


def wood_of_tree(tree: Tree) -> Wood:
    """The wood of a grown tree, from its skeleton where that is all of it, else from its mesh.

    It is kept with the skeleton: many places ask, also of the same tree with fewer leaves.
    """
    kept: dict[str, Wood] = vars(tree.skeleton)
    if "_wood" not in kept and tree.grafted:
        kept["_wood"] = wood_of_mesh(tree.mesh)
    elif "_wood" not in kept:
        whole = wood_of_skeleton(tree.skeleton)
        kept["_wood"] = replace(whole, volume=volume_of(tree.skeleton))
    return kept["_wood"]


def segment_table(skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Columns by segment: order, generation, length, diameter, volume, area and projected area."""
    length = skeleton.length
    r1, r2 = skeleton.radius.T
    return {
        "order": skeleton.order,
        "generation": skeleton.generation,
        "length_m": length,
        "diameter_m": r1 + r2,
        "volume_m3": skeleton.volume,
        "area_m2": np.pi * (r1 + r2) * np.hypot(length, r1 - r2),
        "projected_m2": (r1 + r2) * length,
    }


def wood_of_skeleton(skeleton: Skeleton) -> Wood:
    """The sum over all segments, as Méndez et al. have it."""
    table = segment_table(skeleton)
    return Wood(*(float(table[name].sum()) for name in ("volume_m3", "area_m2", "projected_m2")))


def wood_of_mesh(mesh: TriMesh) -> Wood:
    """The wood of a mesh of closed tubes, facing outwards, what they share counted once (``shared_once``);
    pieces without caps make the volume a guess.
    """
    triangles = mesh.triangles[is_wood(mesh.part)]
    if not len(triangles):
        return Wood(0.0, 0.0, 0.0)
    a, b, c = (mesh.vertices[triangles[:, k]] - mesh.vertices[triangles[0, 0]] for k in range(3))
    once = shared_once(np.stack([a, b, c], axis=1))
    cross = np.cross(b - a, c - a)
    volume = float(np.einsum("ti,ti->", a, cross)) / 6
    area = float(np.linalg.norm(cross, axis=1).sum()) / 2
    return Wood(volume * once, area, area / np.pi)


def leaf_angles(leaves: Leaves) -> tuple[np.ndarray, np.ndarray]:
    """The leaf-angle distribution: edges (K + 1,) in radians and density (K,) per radian.

    A leaf's angle is that between its normal, either way round, and the vertical: 0 lies flat, π/2
    stands. Leaves count by their area. The density integrates to 1; without leaves it is 0.
    """
    edges = np.linspace(0.0, np.pi / 2, ANGLE_BINS + 1)
    angle = np.arccos(np.clip(np.abs(leaves.normal[:, 2]), 0.0, 1.0))
    area = np.bincount(
        np.minimum((angle / edges[1]).astype(np.int64), ANGLE_BINS - 1),
        leaves.radius**2,
        ANGLE_BINS,
    )
    total = float(area.sum())
    return edges, area / (total * edges[1]) if total > 0 else np.zeros(ANGLE_BINS)


def tree_truth(tree: Tree) -> dict[str, float]:
    """The truth of one tree by name and unit."""
    wood = wood_of_tree(tree)
    width, base = crown_of(tree.skeleton, tree.leaves, tree.grafted)
    edges, density = leaf_angles(tree.leaves)
    middle = (edges[1:] + edges[:-1]) / 2
    told = (
        tree.height,
        dbh_of(tree.skeleton),
        base,
        width,
        wood.volume,
        wood.area,
        wood.projected,
        float(len(tree.leaves)),
        float(np.pi * (tree.leaves.radius**2).sum()),
        float(np.rad2deg((density * middle).sum() * edges[1])),
    )
    return dict(zip(MEASURES, told, strict=True))


def volume_of(skeleton: Skeleton) -> float:
    """m³ of wood."""
    length, volume = skeleton.length, skeleton.volume
    heads, others = _joints(skeleton, length)
    count = int(np.clip(POINTS // max(len(heads), 1), FEWEST, MOST))
    others = np.where(_near(skeleton, heads, others), others, -1)
    some = np.flatnonzero((others >= 0).any(axis=1))  # the rest share nothing
    heads, others = heads[some], others[some]
    step = max(1, 2_000_000 // (count * others.shape[1]))
    for first in range(0, len(heads), step):
        part = slice(first, first + step)
        shared = _shared(skeleton, length, heads[part], others[part], count)
        volume[heads[part]] *= 1 - shared
    return float(volume.sum())


def _joints(skeleton: Skeleton, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First segments of children (H,), and those that each may lie in (H, C), -1 for none."""
    axes = find_axes(skeleton)
    onward = np.append(axes.onward, -1)  # the last one: of none, none
    foot = axes.segment[axes.first[:-1]]
    foot = foot[skeleton.parent[foot] >= 0]
    bearer = skeleton.parent[foot]
    order = np.lexsort((foot, bearer))
    foot, bearer = foot[order], bearer[order]

    parent = np.append(skeleton.parent, -1)
    before, after = parent[bearer], onward[bearer]
    own = [bearer, before, parent[before], after, onward[after]]
    for back in range(1, OTHER_CHILDREN + 1):
        other_child = np.full(len(foot), -1)
        same = bearer[back:] == bearer[:-back]
        other_child[back:][same] = foot[:-back][same]
        own += [other_child, onward[other_child]]
    low, high = np.searchsorted(bearer, before), np.searchsorted(bearer, before, "right")
    for place in range(PARENTS_SIBLINGS):
        parents_sibling = np.append(foot, -1)[np.minimum(low + place, len(foot))]
        own.append(np.where((before >= 0) & (low + place < high), parents_sibling, -1))
    others = np.stack(own, axis=1)
    feet, within = [foot], [others]
    for _ in range(HEADS - 1):
        feet.append(onward[feet[-1]])
        within.append(others)
    head, around = np.concatenate(feet), np.concatenate(within)
    known = np.flatnonzero((head >= 0) & (length[head] > TOUCH))
    return head[known], around[known]


def _near(skeleton: Skeleton, heads: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(H, C) whether a segment and another, -1 for none, may have a point in common: their boxes overlap."""
    thick = skeleton.radius.max(axis=1)
    low = np.minimum(skeleton.start, skeleton.end) - thick[:, None]
    high = np.maximum(skeleton.start, skeleton.end) + thick[:, None]
    near = others >= 0
    for k in range(3):
        near &= low[heads, k, None] <= high[others, k]
        near &= high[heads, k, None] >= low[others, k]
    return near


def _shared(
    skeleton: Skeleton, length: np.ndarray, heads: np.ndarray, others: np.ndarray, count: int
) -> np.ndarray:
    """(H,) share of each segment's volume that lies in any of some others (H, C)."""
    place = np.arange(count)[:, None] + np.sqrt(2) * heads[:, None, None]  # each segment its own
    along, turn, out = (np.modf(place[:, :, 0] * step)[0] for step in EVEN)  # (H, P) each
    r1, r2 = skeleton.radius[heads].T[:, :, None]
    slope = r2 - r1
    weight = (r1 + slope * along) ** 2  # (H, P): a thick end has more
    axis = (skeleton.end[heads] - skeleton.start[heads]) / length[heads, None]
    side = unit(np.cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=1)]))
    across = np.cross(axis, side)
    far = (r1 + slope * along) * np.sqrt(out)
    cos, sin = far * np.cos(2 * np.pi * turn), far * np.sin(2 * np.pi * turn)
    along = along * length[heads, None]
    places = [  # (H, P) of each coordinate: twice as fast as rows of three
        skeleton.start[heads, k, None]
        + along * axis[:, k, None]
        + cos * side[:, k, None]
        + sin * across[:, k, None]
        for k in range(3)
    ]
    inside = np.zeros(weight.shape, dtype=bool)
    for other in others.T:
        rows = np.flatnonzero((other >= 0) & (length[other] > TOUCH))
        which = other[rows]
        way = (skeleton.end[which] - skeleton.start[which]) / length[which, None]
        above, square = np.zeros((2, len(rows), count))
        for k in range(3):
            from_start = places[k][rows]
            from_start -= skeleton.start[which, k, None]
            above += from_start * way[:, k, None]
            from_start *= from_start
            square += from_start
        square -= above**2
        share = np.divide(above, length[which, None], out=above)
        a, b = skeleton.radius[which].T[:, :, None]
        reach = a + (b - a) * share
        reach *= reach
        here = square < reach
        here &= share >= 0
        here &= share <= 1
        inside[rows] |= here
    return np.asarray((weight * inside).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-300))


def shared_once(corners: np.ndarray) -> float:
    """Volume of the union over that of all pieces added up, 0 to 1, of triangles (T, 3, 3) facing outwards.

    1 where no line says anything.
    """
    low, high = corners[:, :, :2].min(axis=1), corners[:, :, :2].max(axis=1)
    wide = np.maximum(high - low, 1e-9)
    a, b = float(wide.prod(axis=1).sum()), float(wide.sum())  # lines for about TESTS of triangles
    cell = max((b + np.sqrt(b * b + 4 * TESTS * a)) / (2 * TESTS), 1e-6)
    shift = stream(0, "union").random(2) * cell  # not along anything that was modelled
    first = np.ceil((low - shift) / cell).astype(np.int64)
    count = np.maximum(np.floor((high - shift) / cell).astype(np.int64) - first + 1, 0)
    each = count.prod(axis=1)
    triangle, place = numbered(each)
    column = first[triangle] + np.stack(
        [place // count[triangle, 1], place % count[triangle, 1]], axis=1
    )
    height, sign, hit = _crossings(corners.T.take(triangle, axis=2), column * cell + shift)
    return _ratio(column[hit], height[hit], sign[hit])


def _crossings(corners: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Height and sign (M,) of upright lines through (M, 2) with triangles (axis, corner, M); whether they
    meet."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    u, v, w = b - a, c - a, at.T - a[:2]
    twice = u[0] * v[1] - u[1] * v[0]
    safe = np.where(twice == 0, 1.0, twice)
    p = (w[0] * v[1] - w[1] * v[0]) / safe
    q = (u[0] * w[1] - u[1] * w[0]) / safe
    hit = (twice != 0) & (p >= 0) & (q >= 0) & (p + q <= 1)
    return a[2] + p * u[2] + q * v[2], -np.sign(twice), hit


def _ratio(column: np.ndarray, height: np.ndarray, sign: np.ndarray) -> float:
    """Length within any piece over that within each, of crossings (M,) by column (M, 2)."""
    order = np.lexsort((height, column[:, 1], column[:, 0]))
    column, height, sign = column[order], height[order], sign[order]
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(column, axis=0) != 0).any(axis=1)
    line = np.cumsum(new) - 1
    total = np.bincount(line, sign) if len(line) else np.empty(0)
    level = np.cumsum(sign)
    level -= (level - sign)[new][line] if len(line) else 0.0  # from 0 in every line
    sound = (total == 0)[line] if len(line) else np.empty(0, bool)
    inside = np.append(np.diff(height), 0.0) * np.append(~new[1:], False) * sound
    deep = np.maximum(level, 0.0)
    added = float((inside * deep).sum())
    return float((inside * (deep > 0)).sum()) / added if added > 0 else 1.0
