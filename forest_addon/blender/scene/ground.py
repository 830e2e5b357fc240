"""The ground of a forest: a terrain as triangles, with a margin around the field."""

from __future__ import annotations

import numpy as np

from ... import spec
from ...base.trimesh import GROUND, TriMesh
from ...stand.intensity.terrain import GroundSurface, Heightmap


def ground_mesh(field: spec.Forest, terrain: GroundSurface) -> TriMesh:
    """The terrain as triangles; flat ground and heightmaps reach the field's margin beyond the field."""
    low = np.array(field.origin) - field.margin
    high = np.array(field.origin) + np.array(field.size) + field.margin
    shape = terrain.triangles()
    if shape is None:
        corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        vertices = np.column_stack([corners, terrain.height(corners)])
        return TriMesh.of_part(vertices, np.array([[0, 1, 2], [0, 2, 3]]), GROUND)
    vertices, triangles = shape
    if isinstance(terrain, Heightmap):  # its edge goes on at the height that it has there
        vertices, grid = vertices.copy(), terrain.grid
        place = vertices[:, :2]
        vertices[:, :2] = np.where(
            place <= grid.low,
            np.minimum(grid.low, low),
            np.where(place >= grid.high, np.maximum(grid.high, high), place),
        )
    return TriMesh.of_part(vertices, triangles, GROUND)
