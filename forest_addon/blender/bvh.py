"""The ray caster that is always there: one BVHTree per unique mesh, instances above it in numpy.

A ray is moved in float64 to just before the bounding box of an instance and into its local space, where
``BVHTree.ray_cast`` finds the triangle in float32; the distance is then computed again in float64. The
instances a ray may meet are visited from the nearest on, until one is entered beyond the best hit.
"""

from __future__ import annotations

import gc
from operator import itemgetter

import bpy  # noqa: F401  where Blender is a module, it brings mathutils
import numpy as np
from mathutils.bvhtree import BVHTree

from ..sensing.boxes import candidates
from ..sensing.geometry import SceneGeometry, invert_transforms
from ..sensing.rays import Hits, plane_distance, unit_directions

PAIRS_AT_ONCE = 2_000_000  # rays times instances that are tested against boxes together
MAX_CHUNK = 32_768


class BvhCaster:
    """Closest hits and occlusion through BVHTree (see ``sensing.rays.RayCaster``)."""

    engine = "bvhtree"

    def __init__(self, scene: SceneGeometry) -> None:
        self.scene = scene
        self._to_local = invert_transforms(scene.transform)
        self._low, self._high = scene.bounds()
        flat = ~np.isfinite(self._to_local).all(axis=(1, 2))
        self._low[flat] = np.nan  # an instance without volume is met by nothing
        self._trees: list[tuple[BVHTree, np.ndarray] | None] = [None] * len(scene.meshes)

    def cast(
        self, origins: np.ndarray, directions: np.ndarray, max_distance: float | np.ndarray = np.inf
    ) -> Hits:
        """Closest hits; see ``RayCaster``."""
        origins = np.asarray(origins, dtype=np.float64)
        directions = unit_directions(directions)
        count = len(origins)
        best = np.broadcast_to(np.asarray(max_distance, dtype=np.float64), (count,)).copy()
        instance = np.full(count, -1, dtype=np.int64)
        triangle = np.full(count, -1, dtype=np.int64)
        chunk = int(np.clip(PAIRS_AT_ONCE // max(len(self.scene), 1), 256, MAX_CHUNK))
        collecting = gc.isenabled()
        gc.disable()  # the loops make millions of small tuples, none of them in a cycle
        try:
            for first in range(0, count, chunk):
                part = slice(first, first + chunk)
                self._cast_chunk(
                    origins[part], directions[part], best[part], instance[part], triangle[part]
                )
        finally:
            if collecting:
                gc.enable()
        return Hits(np.where(instance >= 0, best, np.inf), instance, triangle)

    def occluded(
        self, origins: np.ndarray, directions: np.ndarray, max_distance: float | np.ndarray
    ) -> np.ndarray:
        """Whether anything is hit; see ``RayCaster``."""
        return self.cast(origins, directions, max_distance).found

    def _cast_chunk(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        best: np.ndarray,
        instance: np.ndarray,
        triangle: np.ndarray,
    ) -> None:
        ray, box, entry = candidates(self._low, self._high, origins, directions, best)
        turn = np.searchsorted(ray, np.arange(len(origins)))
        last = np.searchsorted(ray, np.arange(len(origins)), side="right")
        waiting = np.flatnonzero(turn < last)
        while len(waiting):
            pair = turn[waiting]
            waiting = waiting[entry[pair] <= best[waiting]]
            self._visit(
                origins, directions, best, instance, triangle,
                waiting, box[turn[waiting]], entry[turn[waiting]],
            )  # fmt: skip
            turn[waiting] += 1
            waiting = waiting[turn[waiting] < last[waiting]]

    def _visit(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        best: np.ndarray,
        instance: np.ndarray,
        triangle: np.ndarray,
        rays: np.ndarray,
        boxes: np.ndarray,
        entry: np.ndarray,
    ) -> None:
        """Cast each of ``rays`` into one instance and keep what is nearer than the best so far."""
        mesh_of = self.scene.mesh_index[boxes]
        for mesh_number in np.unique(mesh_of):
            here = mesh_of == mesh_number
            r, into = rays[here], boxes[here]
            shift = np.maximum(entry[here] * (1 - 1e-5) - 1e-3, 0.0)
            matrix = self._to_local[into]
            start = origins[r] + shift[:, None] * directions[r]
            local_start = np.einsum("rij,rj->ri", matrix[:, :, :3], start) + matrix[:, :, 3]
            local_way = np.einsum("rij,rj->ri", matrix[:, :, :3], directions[r])
            stretch = np.linalg.norm(local_way, axis=1)
            limit = np.minimum((best[r] - shift) * stretch * (1 + 1e-6), 3e38)

            tree, kept = self._tree(int(mesh_number))
            found = map(
                itemgetter(2),
                map(
                    tree.ray_cast,
                    zip(*local_start.T.tolist(), strict=True),
                    zip(*local_way.T.tolist(), strict=True),
                    limit.tolist(),
                ),
            )
            number = np.array([-1 if n is None else n for n in found], dtype=np.int64)
            hit = np.flatnonzero(number >= 0)
            if not len(hit):
                continue
            number = kept[number[hit]]
            mesh = self.scene.meshes[mesh_number]
            distance = shift[hit] + plane_distance(
                local_start[hit], local_way[hit], mesh.vertices[mesh.triangles[number]]
            )
            nearer = distance <= best[r[hit]]
            # Of two hits at the same distance the first instance stays, in whatever order they come.
            same = distance == best[r[hit]]
            holder = instance[r[hit]]
            nearer &= ~(same & (holder >= 0) & (holder <= into[hit]))
            winner = r[hit][nearer]
            best[winner] = distance[nearer]
            instance[winner] = into[hit][nearer]
            triangle[winner] = number[nearer]

    def _tree(self, mesh_number: int) -> tuple[BVHTree, np.ndarray]:
        """The BVHTree of a mesh, made when first needed, and the triangles it was made of."""
        ready = self._trees[mesh_number]
        if ready is None:
            mesh = self.scene.meshes[mesh_number]
            finite = np.isfinite(mesh.vertices).all(axis=1)
            kept = np.flatnonzero(finite[mesh.triangles].all(axis=1))
            vertices = np.where(finite[:, None], mesh.vertices, 0.0)
            tree = BVHTree.FromPolygons(
                vertices.tolist(), mesh.triangles[kept].tolist(), all_triangles=True
            )
            ready = self._trees[mesh_number] = (tree, kept)
        return ready
