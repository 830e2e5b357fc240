"""A ray caster without any tree: every ray against every triangle of every instance, float64.

The reference for the casters in ``blender/``, and the caster of tests that run without Blender. Rays
and triangles go in, the closest ``Hits`` come out (Möller & Trumbore 1997, both faces, edges
included). Each instance is met from its own origin, so that an offset of 1e6 m costs few digits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from forest_addon.sensing.rays.caster import Hits, hit_normals
from forest_addon.sensing.rays.geometry import SceneGeometry

EDGE = 1e-12  # barycentric slack: a ray aimed at a shared edge meets at least one of its triangles
PAIRS = 1_000_000  # rays x triangles at a time


class BruteCaster:
    """The ``RayCaster`` protocol over a ``SceneGeometry``; time grows with rays x triangles."""

    engine = "brute force"

    def __init__(self, scene: SceneGeometry) -> None:
        self.scene = scene

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
    ) -> Hits:
        """The closest hit of each ray, by meeting them all."""
        origin = np.asarray(origins, np.float64).reshape(-1, 3)
        direction = _unit(np.asarray(directions, np.float64).reshape(-1, 3))
        far = np.broadcast_to(np.asarray(max_distance, np.float64), len(origin))
        near = np.broadcast_to(np.asarray(min_distance, np.float64), len(origin))
        left = Hits.misses(len(origin)) if leaving is None else leaving
        hits = Hits.misses(len(origin))
        for index in range(len(self.scene)):
            corners = self._corners(index)
            if not len(corners):
                continue
            step = max(1, PAIRS // len(corners))
            for first in range(0, len(origin), step):
                rows = np.arange(first, min(first + step, len(origin)))
                start = origin[rows] - self.scene.transform[index, :, 3]
                t = ray_parameters(start, direction[rows], corners)
                t[~(t <= far[rows, None]) | ~(t >= near[rows, None])] = np.inf
                t[left.found[rows, None] & (t <= near[rows, None])] = np.inf
                own = left.instance[rows] == index
                t[own, left.triangle[rows[own]]] = np.inf
                nearest = t.argmin(axis=1)
                reached = t[np.arange(len(t)), nearest]
                closer = np.flatnonzero(reached < hits.distance[rows])
                nothing = np.full((len(closer), 3), np.nan)
                found = Hits(reached[closer], np.full(len(closer), index), nearest[closer], nothing)
                hits.put(rows[closer], found)
        return replace(hits, normal=hit_normals(self.scene, replace(hits, normal=None)))

    def occluded(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
    ) -> np.ndarray:
        """(R,) bool: whether ``cast`` finds anything."""
        return self.cast(
            origins, directions, max_distance, min_distance=min_distance, leaving=leaving
        ).found

    def _corners(self, index: int) -> np.ndarray:
        """(T, 3, 3) corners of one instance's triangles, turned as the world, from its origin."""
        mesh = self.scene.meshes[self.scene.mesh_index[index]]
        transform = self.scene.transform[index]
        corners: np.ndarray = (mesh.vertices @ transform[:, :3].T)[mesh.triangles]
        return corners


def ray_parameters(origins: np.ndarray, directions: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(R, T) distance >= 0 at which rays (R, 3) meet triangles (T, 3, 3); inf for a miss."""
    a = corners[:, 0]
    u, v = corners[:, 1] - a, corners[:, 2] - a
    with np.errstate(all="ignore"):
        p = np.cross(directions[:, None, :], v[None, :, :])
        determinant = np.einsum("tk,rtk->rt", u, p)
        s = origins[:, None, :] - a[None, :, :]
        first = np.einsum("rtk,rtk->rt", s, p) / determinant
        q = np.cross(s, u[None, :, :])
        second = np.einsum("rk,rtk->rt", directions, q) / determinant
        t: np.ndarray = np.einsum("tk,rtk->rt", v, q) / determinant
        met = (first >= -EDGE) & (second >= -EDGE) & (first + second <= 1 + EDGE) & (t >= 0)
    return np.where(met, t, np.inf)


def _unit(directions: np.ndarray) -> np.ndarray:
    """(R, 3) unit vectors in float64; NaN where a direction is zero or not finite."""
    with np.errstate(all="ignore"):
        scaled = directions / np.abs(directions).max(axis=1, keepdims=True)
        return scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
