"""Ray casting: what a caster promises, and the float64 refinement of what it finds.

A sensor hands a batch of world rays to a ``RayCaster`` and gets ``Hits`` back. Casters work in float32
inside; ``refine`` intersects the plane of the triangle they name again, in float64 and in the local
space of the instance, which takes the error of a distance from 1e-5 m to 1e-13 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .geometry import SceneGeometry


@dataclass(frozen=True)
class Hits:
    """What R rays hit first.

    distance : (R,) float64 metres along the unit direction, ``inf`` for a miss.
    instance, triangle : (R,) int64, -1 for a miss.
    """

    distance: np.ndarray
    instance: np.ndarray
    triangle: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """(R,) bool, whether anything was hit."""
        return self.instance >= 0


class RayCaster(Protocol):
    """Closest-hit and occlusion queries over batches of world rays.

    Directions need not be unit vectors; a direction that is zero or not finite hits nothing. A hit at
    exactly ``max_distance`` counts. Both faces of a triangle are hit.
    """

    engine: str
    scene: SceneGeometry

    def cast(
        self, origins: np.ndarray, directions: np.ndarray, max_distance: float | np.ndarray
    ) -> Hits:
        """Closest hits of rays (R, 3), (R, 3) within ``max_distance``, a number or (R,)."""
        ...

    def occluded(
        self, origins: np.ndarray, directions: np.ndarray, max_distance: float | np.ndarray
    ) -> np.ndarray:
        """(R,) bool: whether anything is hit within ``max_distance``."""
        ...


def unit_directions(directions: np.ndarray) -> np.ndarray:
    """(R, 3) float64 unit vectors; NaN rows where a direction is zero or not finite."""
    d = np.asarray(directions, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        d = d / np.abs(d).max(
            axis=1, keepdims=True
        )  # 1e-20 and 1e30 long vectors do not under/overflow
        d = d / np.linalg.norm(d, axis=1, keepdims=True)
    return np.where(np.isfinite(d).all(axis=1, keepdims=True), d, np.nan)


def plane_distance(origins: np.ndarray, directions: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(R,) ray parameter at which each ray meets the plane of its triangle (R, 3, 3), float64."""
    a = corners[:, 0]
    normal = np.cross(corners[:, 1] - a, corners[:, 2] - a)
    with np.errstate(invalid="ignore", divide="ignore"):
        t: np.ndarray = np.einsum("ri,ri->r", a - origins, normal) / np.einsum(
            "ri,ri->r", directions, normal
        )
    return t


def hit_normals(scene: SceneGeometry, hits: Hits) -> np.ndarray:
    """(R, 3) unit world normals of the triangles that were hit; NaN for a miss."""
    normals = np.full((len(hits.distance), 3), np.nan)
    found = np.flatnonzero(hits.found)
    mesh_of_hit = scene.mesh_index[hits.instance[found]]
    for index in np.unique(mesh_of_hit):
        rows = found[mesh_of_hit == index]
        mesh = scene.meshes[index]
        corners = mesh.vertices[mesh.triangles[hits.triangle[rows]]]
        linear = scene.transform[hits.instance[rows], :, :3]
        u = np.einsum("rij,rj->ri", linear, corners[:, 1] - corners[:, 0])
        v = np.einsum("rij,rj->ri", linear, corners[:, 2] - corners[:, 0])
        normal = np.cross(u, v)
        with np.errstate(invalid="ignore", divide="ignore"):
            normals[rows] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return normals
