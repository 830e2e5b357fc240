"""Grown trees held against their truth: tubes against their cones, leaves against what a sensor measures.

A skeleton's segments are frusta of cones. Random points on them (evenly by area, above the ground and
within no other cone) are held against the nearest triangle of the tree's wood: what a beam would be off by
because tubes are polygons, nodes were left out, or a branch is missing. A leaf's truth is held against the
disc that the sensors measure on the evaluated scene's triangles. Both are compared in the tree's own
space; a tree that is scaled is off by as much more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..base.trimesh import is_wood
from ..growth.skeleton import Skeleton
from ..growth.tree import Tree
from ..stand.forest import GrownForest
from .audit import LEAST, Audit, AuditPart, held
from .rays.geometry import SceneGeometry
from .sonar.leaves import FoliageDiscs

TRIES = 4  # points on cones, of which the first counts that can be seen
WORK = 3_000_000  # points by triangles that are asked
FEWEST = 20  # points
ROUNDING = 2.0**-20  # of a coordinate in Blender's single precision, after a few operations


def audit_trees(
    forest: GrownForest,
    scene: SceneGeometry,
    rng: np.random.Generator,
    seconds: float,
    share: float,
) -> dict[str, Audit]:
    """ "branches" and "leaves" of a forest that took ``seconds`` to grow and build, as far as it has them."""
    grown = [
        (tree, forest.species[key[0]].detail.tolerance + _roughness(tree)[0])
        for key, tree in forest.variants.items()
    ]
    parts = {"branches": part_of_tubes(grown, rng), "leaves": part_of_leaves(forest, scene, share)}
    return {name: held([part], rng, seconds) for name, part in parts.items() if part.of}


def _roughness(tree: Tree) -> tuple[float, float]:
    """Bound how far bark in relief lies from the cones, and how high roots reach, metres."""
    if tree.relief is None:
        return 0.0, 0.0
    radius = float(tree.skeleton.radius.max(initial=0.0))
    return tree.relief.most(radius), tree.relief.highest(radius)


def part_of_tubes(trees: Sequence[tuple[Tree, float]], rng: np.random.Generator) -> AuditPart:
    """Points on the branches of trees, each with the tolerance that it was meshed with; of none where none
    grows from cones. A point that no other branch, root or ground hides is off by its way to the wood."""
    known = [(tree, allowed) for tree, allowed in trees if not tree.grafted]
    known = [(tree, allowed) for tree, allowed in known if len(_solid(tree.skeleton)[0])]
    cones = sum(len(tree.skeleton) for tree, _ in known)
    meshed = [tree.mesh.vertices[tree.mesh.triangles[is_wood(tree.mesh.part)]] for tree, _ in known]

    def look(number: np.ndarray) -> np.ndarray:
        errors = np.zeros(len(number))
        for row, one in enumerate((number * len(known) // cones).tolist()):
            points = points_on_cones(known[one][0].skeleton, TRIES, rng)
            for point in points[points[:, 2] >= _roughness(known[one][0])[1]][:1]:
                errors[row] = _to_triangles(point, _near(point, meshed[one])).min(initial=np.inf)
        return errors

    triangles = max((len(corners) for corners in meshed), default=1)
    allowed = max((allowed for _, allowed in known), default=0.0)
    kind = "points of branches by the nearest of all triangles", allowed, "m"
    count = min(max(WORK // max(triangles, 1), FEWEST), LEAST)
    return AuditPart(cones, look, (kind,), count, exact=True)


def part_of_leaves(forest: GrownForest, scene: SceneGeometry, share: float) -> AuditPart:
    """Trees as they stand in an evaluated scene, ``share`` of which are looked at, one at least, leaf by
    leaf; one with a leaf that is missing is infinitely far off."""
    pairs = rows_of_meshes(forest, scene).items()
    trees = [(mesh, row, forest.variant_of(row)) for mesh, row in pairs]
    needles = [species.needles is not None for species in forest.species]
    known = [
        (mesh, tree, needles[int(forest.stand.species[row])])
        for mesh, row, tree in trees
        if len(tree.leaves)
    ]

    def look(number: np.ndarray) -> np.ndarray:
        some = [known[one] for one in number.tolist()]
        errors = [
            _leaf_errors(tree, FoliageDiscs(scene.meshes[m]), shoots) for m, tree, shoots in some
        ]
        return np.array([each.max() for each in errors])

    far = max((float(np.abs(tree.leaves.centre).max()) for _, tree, _ in known), default=0.0)
    what = "trees, the centre and size of each leaf by the triangles in Blender"
    kind = what, ROUNDING * max(far, 1.0), "m"
    count = max(1, math.ceil(min(share, 1.0) * len(known)))
    return AuditPart(len(known), look, (kind,), count, exact=True)


def rows_of_meshes(forest: GrownForest, scene: SceneGeometry) -> dict[int, int]:
    """A tree of a forest, by its row, for each mesh of a scene that is one's."""
    rows = {int(tree): row for row, tree in enumerate(forest.stand.id)}
    return {
        int(scene.mesh_index[instance]): rows[int(scene.tree[instance])]
        for instance in np.flatnonzero(scene.tree >= 0)
        if int(scene.tree[instance]) in rows
        and not (scene.asset and scene.asset[scene.mesh_index[instance]])  # of a library, not ours
    }


def _leaf_errors(tree: Tree, measured: FoliageDiscs, shoots: bool) -> np.ndarray:
    """(L,) metres between centres or radii, the larger of the two.

    shoots : whether facets stand for needles, all by the same share of their area.
    """
    errors = np.full(len(tree.leaves), np.inf)
    there = measured.leaf < len(errors)
    number = measured.leaf[there]
    centre, _, radius = (value[there] for value in measured.local)
    whole = np.bincount(number, radius**2, len(errors))  # of all pieces of a leaf
    sounding = np.flatnonzero(whole > 0)
    middle = np.stack([np.bincount(number, radius**2 * axis, len(errors)) for axis in centre.T])
    apart = np.linalg.norm(
        middle[:, sounding].T / whole[sounding, None] - tree.leaves.centre[sounding], axis=1
    )
    size, truth = np.sqrt(whole[sounding]), tree.leaves.radius[sounding]
    size = size * np.median(truth / size) if shoots else size
    errors[sounding] = np.maximum(apart, np.abs(size - truth))
    return errors


def points_on_cones(wood: Skeleton, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points (N, 3) on the cones of a skeleton, at most ``count``: above the ground and in no other cone."""
    start, axis, length, radius = _solid(wood)
    area = radius.sum(axis=1) * np.hypot(length, radius[:, 1] - radius[:, 0])
    chosen = rng.choice(len(area), count, p=area / area.sum())
    along, turn = rng.random(count), rng.uniform(0, 2 * np.pi, count)
    thick = radius[chosen, 0] + along * (radius[chosen, 1] - radius[chosen, 0])
    across = np.cross(axis[chosen], np.eye(3)[np.abs(axis[chosen]).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    beside = np.cross(axis[chosen], across)
    points = start[chosen] + (along * length[chosen])[:, None] * axis[chosen]
    points += thick[:, None] * (np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * beside)
    free = points[:, 2] > 0
    for row, point in enumerate(points):
        away = point - start
        place = np.einsum("si,si->s", away, axis)
        off = np.linalg.norm(away - place[:, None] * axis, axis=1)
        share = np.clip(place / length, 0.0, 1.0)
        inside = (place > 0) & (place < length)
        inside &= off < radius[:, 0] + share * (radius[:, 1] - radius[:, 0])
        inside[chosen[row]] = False
        free[row] &= not inside.any()
    return points[free]


def _solid(wood: Skeleton) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Start (S, 3), axis (S, 3), length (S,) and radius (S, 2) of segments that have any surface."""
    span = wood.end - wood.start
    length = np.linalg.norm(span, axis=1)
    kept = (length > 1e-9) & (wood.radius.max(axis=1) > 0)
    axis = span[kept] / length[kept, None]
    return wood.start[kept], axis, length[kept], np.maximum(wood.radius[kept], 0.0)


def _near(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Triangles of (T, 3, 3) that may be the nearest to a point, by their first corners and sizes."""
    first = corners[:, 0]
    away = np.linalg.norm(first - point, axis=1)
    size = np.linalg.norm(corners[:, 1:] - first[:, None], axis=2).max(axis=1)
    return corners[away - size <= away.min(initial=np.inf)]


def _to_triangles(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(T,) metres from a point to triangles (T, 3, 3): to what it stands over, else to the edges."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    normal = np.divide(normal, size[:, None], out=np.zeros_like(normal), where=size[:, None] > 0)
    over = size > 0
    nearest = np.full(len(corners), np.inf)
    for begin, end in ((a, b), (b, c), (c, a)):
        edge, away = end - begin, point - begin
        over &= np.einsum("ti,ti->t", np.cross(edge, away), normal) >= 0
        square = np.einsum("ti,ti->t", edge, edge)
        share = np.einsum("ti,ti->t", away, edge) / np.where(square > 0, square, 1.0)
        left = away - np.clip(share, 0.0, 1.0)[:, None] * edge
        nearest = np.minimum(nearest, np.linalg.norm(left, axis=1))
    return np.where(over, np.abs(np.einsum("ti,ti->t", point - a, normal)), nearest)
