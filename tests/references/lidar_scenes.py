"""Scenes of a few flat things, whose every distance is known in closed form."""

import numpy as np

from forest_addon.base.trimesh import GROUND, WOOD, TriMesh
from forest_addon.sensing.rays.geometry import SceneGeometry


def scene_with(*meshes):
    count = len(meshes)
    return SceneGeometry(
        meshes=meshes,
        transform=np.tile(np.eye(3, 4), (count, 1, 1)),
        mesh_index=np.arange(count),
        object_name=("x",) * count,
        tree=np.arange(count) - 1,
        species=np.arange(count) - 1,
    )


def ground(extent=500.0):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * extent
    return TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), GROUND)


def wall(x, half=500.0):
    corners = np.array([[x, -half, 0], [x, half, 0], [x, half, half], [x, -half, half]])
    return TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), WOOD)
