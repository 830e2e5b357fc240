"""Small scenes that tests of echoes share: one mesh, some instances."""

from __future__ import annotations

import numpy as np

from forest_addon.base.trimesh import LEAF, TriMesh
from forest_addon.sensing.rays.geometry import SceneGeometry


def scene_of(mesh: TriMesh, *transforms: np.ndarray) -> SceneGeometry:
    """Instances of one mesh, as trees 3, 4, …; without transforms one, as it is."""
    placed = np.array(transforms or [np.eye(3, 4)], dtype=np.float64).reshape(-1, 3, 4)
    count = len(placed)
    return SceneGeometry(
        (mesh,),
        placed,
        np.zeros(count, np.int64),
        ("thing",) * count,
        np.arange(count) + 3,
        np.zeros(count, np.int64),
    )


def square_leaves(centre: np.ndarray, normal: np.ndarray, side: float, seed: int = 0) -> TriMesh:
    """Square leaves of two triangles at places (L, 3), facing (L, 3)."""
    rng = np.random.default_rng(seed)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    u = np.cross(normal, rng.normal(size=normal.shape))
    u *= side / 2 / np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normal, u)
    corners = np.stack([centre - u - v, centre + u - v, centre + u + v, centre - u + v], axis=1)
    first = 4 * np.arange(len(centre))[:, None, None]
    triangles = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    count = len(triangles)
    return TriMesh(
        corners.reshape(-1, 3),
        triangles.astype(np.int32),
        np.full(count, LEAF, np.int8),
        np.repeat(np.arange(len(centre)), 2).astype(np.int32),
        np.zeros(count, np.int32),
    )
