"""The engine that is always there: one BVHTree per unique mesh, a tree of boxes above them.

A ray is moved in float64 to just before the box of an instance and into its local space, where
``BVHTree.ray_cast`` finds the triangle in float32. Rays visit the instances they may meet in rounds, each
its nearest, then its second nearest, until it would enter one beyond the best hit so far.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from operator import itemgetter

import bpy  # noqa: F401  where Blender is a module, it brings mathutils
import numpy as np
from mathutils.bvhtree import BVHTree

from ..sensing.rays.boxes import BoxTree
from ..sensing.rays.caster import Hits
from ..sensing.rays.geometry import SceneGeometry, invert_transforms
from ..sensing.rays.refine import whole_triangles
from ..sensing.rays.search import Search

BEFORE = 1e-3  # metres, and BEFORE_SHARE of the way: where a ray starts before a box
BEFORE_SHARE = 1e-5
TURN = 256  # rays; between them other threads have their turn, as the window that waits
FAR = 3e38  # the longest way that float32 holds


class BvhCaster(Search):
    """Closest hits and occlusion through BVHTree (see ``sensing.rays.RayCaster``)."""

    engine = "bvhtree"

    def __init__(self, scene: SceneGeometry) -> None:
        super().__init__(scene)  # ray_cast keeps Python's lock: more threads would only wait
        self._to_local = invert_transforms(scene.transform).reshape(-1, 12)
        low, high = scene.bounds()
        low[~np.isfinite(self._to_local).all(axis=1)] = np.nan  # flat: met by nothing
        self._boxes = BoxTree(low, high)
        self._trees: list[tuple[BVHTree, np.ndarray] | None] = [None] * len(scene.meshes)

    def _nearest(
        self, origins: np.ndarray, directions: np.ndarray, start: np.ndarray, limit: np.ndarray
    ) -> Hits:
        hits = Hits.misses(len(start))
        with _no_collection():
            self._visit(origins, directions, start, limit, hits)
        return hits

    def _visit(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        start: np.ndarray,
        limit: np.ndarray,
        hits: Hits,
    ) -> None:
        """Let rays visit their instances, and write what they hit."""
        ray, box, entry = self._boxes.pairs(origins, directions, start, limit)
        turn = np.searchsorted(ray, np.arange(len(limit)))
        last = np.searchsorted(ray, np.arange(len(limit)), side="right")
        best = limit.copy()
        rays = np.flatnonzero(turn < last)
        while len(rays):
            rays = rays[entry[turn[rays]] <= best[rays]]
            rays = rays[np.argsort(self.scene.mesh_index[box[turn[rays]]], kind="stable")]
            pair = turn[rays]
            begin = np.maximum(entry[pair] * (1 - BEFORE_SHARE) - BEFORE, start[rays])
            into = box[pair]
            triangle = self._enter(origins[:, rays], directions[:, rays], begin, best[rays], into)
            met = np.flatnonzero(triangle >= 0)
            found, into, triangle = rays[met], into[met], triangle[met]
            distance = self._surfaces.distance(
                origins[:, found], directions[:, found], into, triangle
            )
            held, holder = best[found], hits.instance[found]
            # Of two at the same distance the first instance stays, in whatever order they come.
            first = (holder < 0) | (into < holder)
            better = (distance < held) | ((distance == held) & first)
            found = found[better]
            best[found] = distance[better]
            hits.put(found, Hits(distance[better], into[better], triangle[better]))
            turn[rays] += 1
            rays = rays[turn[rays] < last[rays]]

    def _enter(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        begin: np.ndarray,
        limit: np.ndarray,
        instance: np.ndarray,
    ) -> np.ndarray:
        """(R,) first triangle, -1 for none, of each ray (3, R) in one instance (R,); sorted by mesh."""
        m = self._to_local[instance].T.copy()  # (12, R)
        d = directions
        o = origins + begin * d
        origin = [m[i] * o[0] + m[i + 1] * o[1] + m[i + 2] * o[2] + m[i + 3] for i in (0, 4, 8)]
        way = [m[i] * d[0] + m[i + 1] * d[1] + m[i + 2] * d[2] for i in (0, 4, 8)]
        stretch = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
        reach = np.minimum(((limit - begin) * (1 + 1e-6) + 1e-5) * stretch, FAR)

        origin_rows = list(zip(*(x.tolist() for x in origin), strict=True))
        way_rows = list(zip(*(x.tolist() for x in way), strict=True))
        reach_rows = reach.tolist()
        mesh_of = self.scene.mesh_index[instance]
        cuts = {0, *(np.flatnonzero(np.diff(mesh_of)) + 1).tolist(), len(mesh_of)}
        cuts |= set(range(0, len(mesh_of), TURN))
        triangle = np.full(len(instance), -1, dtype=np.int64)
        for first, last in pairwise(sorted(cuts)):
            tree, numbers = self._tree(int(mesh_of[first]))
            part = slice(first, last)
            found = map(
                itemgetter(2),
                map(tree.ray_cast, origin_rows[part], way_rows[part], reach_rows[part]),
            )
            number = np.array(list(found), dtype=np.float64)  # None, a miss, becomes NaN
            met = np.flatnonzero(~np.isnan(number))
            triangle[first + met] = numbers[number[met].astype(np.int64)]
        return triangle

    def _tree(self, mesh_number: int) -> tuple[BVHTree, np.ndarray]:
        """The BVHTree of a mesh, made when first needed, and the triangles it was made of."""
        ready = self._trees[mesh_number]
        if ready is None:
            mesh = self.scene.meshes[mesh_number]
            numbers = whole_triangles(mesh)
            vertices = np.nan_to_num(mesh.vertices, nan=0.0, posinf=0.0, neginf=0.0)
            tree = BVHTree.FromPolygons(
                vertices.tolist(), mesh.triangles[numbers].tolist(), all_triangles=True
            )
            ready = self._trees[mesh_number] = (tree, numbers)
        return ready


@contextmanager
def _no_collection() -> Iterator[None]:
    """Pause the garbage collector: the loops make millions of small tuples, none in a cycle."""
    collecting = gc.isenabled()
    try:
        gc.disable()  # within: a job may be cancelled at any line
        yield
    finally:
        if collecting:
            gc.enable()
