"""The engine that is always there: one BVHTree per unique mesh, a tree of boxes above them.

A ray is moved in float64 to just before the box of an instance and into its local space, where
``BVHTree.ray_cast`` finds the triangle in float32. A ray visits the instances that it may meet from the
nearest on, until it would enter one beyond the best hit so far.
"""

from __future__ import annotations

import gc
from itertools import islice, pairwise
from operator import itemgetter

import bpy  # noqa: F401  where Blender is a module, it brings mathutils
import numpy as np
from mathutils.bvhtree import BVHTree

from ...sensing.rays.boxes import BoxTree
from ...sensing.rays.caster import Hits
from ...sensing.rays.geometry import SceneGeometry, invert_transforms
from ...sensing.rays.search import TASK, Search, meet_planes, whole_triangles

BEFORE = 1e-3  # metres, and BEFORE_SHARE of the way: where a ray starts before a box
BEFORE_SHARE = 1e-5
TURN = 256  # rays; between them other threads have their turn, as the window that waits
FAR = 3e38  # the longest way that float32 holds
SLACK = 1e-3  # metres that a ray goes on behind what it has met: float32 may be wrong


class BvhCaster(Search):
    """Closest hits and occlusion through BVHTree (see ``sensing.rays.RayCaster``)."""

    engine = "bvhtree"
    task = (
        4 * TASK
    )  # of many instances the calls on arrays cost more than the rays of a smaller one

    def __init__(self, scene: SceneGeometry, like: BvhCaster | None = None) -> None:
        super().__init__(
            scene, like=like
        )  # ray_cast keeps Python's lock: more threads would only wait
        self._to_local = np.ascontiguousarray(invert_transforms(scene.transform).reshape(-1, 12).T)
        low, high = scene.bounds()
        low[~np.isfinite(self._to_local).all(axis=0)] = np.nan  # flat: met by nothing
        self._boxes = BoxTree(low, high)

    def _nearest(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        start: np.ndarray,
        limit: np.ndarray,
        time: np.ndarray,
    ) -> Hits:
        """Let rays visit their instances, all their nearest, then all their second, until they would enter
        one behind what they have met; of what each met, the nearest by its exact distance."""
        ray, box, entry = self._boxes.pairs(origins, directions, start, limit)
        begin = np.maximum(entry * (1 - BEFORE_SHARE) - BEFORE, start[ray])
        best, hits = limit.copy(), Hits.misses(len(limit))
        turn = np.flatnonzero(np.diff(ray, prepend=-1))
        last = np.append(turn[1:], len(ray))
        collecting = gc.isenabled()
        try:  # without the collector: the loops make millions of small tuples, none in a cycle
            gc.disable()  # within: a job may be cancelled at any line
            while len(turn):
                near = entry[turn] <= best[ray[turn]]
                turn, last = turn[near], last[near]
                pair, triangle = self._only(turn, ray, box, begin, origins, directions, best)
                rays, instance = ray[pair], box[pair]
                ways = origins.take(rays, 1), directions.take(rays, 1)
                distance, normal = meet_planes(self.scene, *ways, instance, triangle)
                # Of two at the same distance the first instance counts.
                first = (distance == hits.distance[rays]) & (instance < hits.instance[rays])
                some = np.flatnonzero(
                    (distance <= limit[rays]) & ((distance < hits.distance[rays]) | first)
                )
                hits.put(rays[some], Hits(distance, instance, triangle, normal.T).select(some))
                best[rays] = np.minimum(best[rays], distance)
                turn = turn + 1
                more = turn < last
                turn, last = turn[more], last[more]
        finally:
            if collecting:
                gc.enable()
        return hits

    def _only(
        self,
        pair: np.ndarray,
        ray: np.ndarray,
        box: np.ndarray,
        begin: np.ndarray,
        origins: np.ndarray,
        directions: np.ndarray,
        limit: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pairs, of some (M,) of a ray and an instance, by number, whose ray meets its instance within its
        limit, and the triangles (M,) met; ``begin`` : metres along the ray where it starts into that."""
        pair = pair[np.argsort(self.scene.mesh_index[box[pair]], kind="stable")]
        mesh_of, start, ray = self.scene.mesh_index[box[pair]], begin[pair], ray[pair]
        # Rays in the space of their instances.
        m = self._to_local.take(box[pair], 1).reshape(3, 4, -1)
        d = directions.take(ray, 1)
        o = start * d
        o += origins.take(ray, 1)
        origin, way = m[:, 0] * o[0], m[:, 0] * d[0]
        for axis in (1, 2):
            origin += m[:, axis] * o[axis]
            way += m[:, axis] * d[axis]
        origin += m[:, 3]
        stretch = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
        reach = np.minimum(((limit[ray] - start) * (1 + 1e-6) + SLACK) * stretch, FAR)
        cuts = [0, *(np.flatnonzero(np.diff(mesh_of)) + 1).tolist(), len(mesh_of)]
        triangle = np.full(len(mesh_of), -1, dtype=np.int64)
        for first, stop in pairwise(cuts if len(mesh_of) else [0]):
            rows, mesh = slice(first, stop), int(mesh_of[first])
            triangle[rows] = self._cast_each(mesh, origin[:, rows], way[:, rows], reach[rows])
        met = np.flatnonzero(triangle >= 0)
        return pair[met], triangle[met]

    def _cast_each(
        self, mesh: int, origin: np.ndarray, way: np.ndarray, reach: np.ndarray
    ) -> np.ndarray:
        """(P,) triangle of a mesh that rays (3, P) in its space meet, -1 for none."""
        tree, numbers = self._tree(mesh)
        starts, ways = (zip(*columns.tolist(), strict=True) for columns in (origin, way))
        triangles = map(itemgetter(2), map(tree.ray_cast, starts, ways, reach.tolist()))
        number: list[int | None] = []
        while len(number) < len(reach):
            number += islice(triangles, TURN)
        place = np.array(number, dtype=np.float64)  # None, a miss, becomes NaN
        met = np.flatnonzero(~np.isnan(place))
        triangle = np.full(len(reach), -1, dtype=np.int64)
        triangle[met] = numbers[place[met].astype(np.int64)]
        return triangle

    def _tree(self, mesh_number: int) -> tuple[BVHTree, np.ndarray]:
        """The BVHTree of a mesh, made when first needed and kept with it, and its triangles' numbers."""
        mesh = self.scene.meshes[mesh_number]
        ready: tuple[BVHTree, np.ndarray] | None = vars(mesh).get("_tree")
        if ready is None:
            numbers = np.flatnonzero(whole_triangles(mesh))
            vertices = np.nan_to_num(mesh.vertices, nan=0.0, posinf=0.0, neginf=0.0)
            tree = BVHTree.FromPolygons(
                vertices.tolist(), mesh.triangles[numbers].tolist(), all_triangles=True
            )
            ready = vars(mesh)["_tree"] = (tree, numbers)
        return ready
