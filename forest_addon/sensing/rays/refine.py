"""The float64 distance of a hit: where both engines become exact.

An engine says in float32 which triangle of which instance a ray meets. ``RefinedSurfaces.distance``
intersects the ray with that triangle's plane again, in float64, with the world's axes but from the ray's
origin: that takes the error from 1e-5 m to 1e-13 m, near the world's origin and at UTM coordinates alike.
"""

from __future__ import annotations

import numpy as np

from ...base.trimesh import TriMesh
from .geometry import SceneGeometry
from .table import TriangleTable

ROWS = 8192  # at a time: what is in work stays in the cache


class RefinedSurfaces:
    """The planes of all triangles of a scene.

    like : of a scene with the same meshes, whose table is shared.
    """

    def __init__(self, scene: SceneGeometry, like: RefinedSurfaces | None = None) -> None:
        if like is not None:
            scene.share_table(like.table)
        self.table: TriangleTable = scene.table
        self._transform = np.ascontiguousarray(scene.transform.reshape(-1, 12).T)
        self._first = self.table.starts[scene.mesh_index]  # triangle, by instance

    def distance(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        instance: np.ndarray,
        triangle: np.ndarray,
        transform: np.ndarray | None = None,
        corners: np.ndarray | None = None,
    ) -> np.ndarray:
        """(R,) metres along rays (3, R) with unit directions to the planes of their triangles (R,).

        transform : (R, 3, 4) of the instances, where they are then; left out: where the scene says.
        corners : (R, 3, 3) of the triangles in their own frames; left out: of their meshes.

        A ray that float32 found to hit and that passes just beside the triangle may meet its plane
        far away, or never: the distance is kept within that of the triangle's corners.
        """
        if len(instance) <= ROWS:
            return self._distance(origins, directions, instance, triangle, transform, corners)
        found = np.empty(len(instance))
        for first in range(0, len(instance), ROWS):
            part = slice(first, first + ROWS)
            found[part] = self._distance(
                origins[:, part],
                directions[:, part],
                instance[part],
                triangle[part],
                None if transform is None else transform[part],
                None if corners is None else corners[part],
            )
        return found

    def _distance(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        instance: np.ndarray,
        triangle: np.ndarray,
        transform: np.ndarray | None,
        corners: np.ndarray | None,
    ) -> np.ndarray:
        """Few calls on whole arrays: of few rays each costs more than what it computes."""
        if transform is None:
            place = self._transform.take(instance, 1)
        else:
            place = np.ascontiguousarray(transform.reshape(-1, 12).T)
        m = place.reshape(3, 4, 1, -1)  # to, from, 1, R
        if corners is None:
            corner = self.table.corners(self._first.take(instance) + triangle)
        else:
            corner = corners.transpose(2, 1, 0).copy()  # (of space, of triangle, R)
        space = m[:, 0] * corner[0]
        part = m[:, 1] * corner[1]
        space += part
        np.multiply(m[:, 2], corner[2], out=part)
        space += part
        # Foot, and the other corners from it; rows x, y, z, x, y: slices of them are their turns.
        way = np.empty((5, 3, space.shape[2]))
        np.subtract(space[:, 1:], space[:, :1], out=way[:3, 1:])
        way[3:, 1:] = way[:2, 1:]
        u, v = way[:, 1], way[:, 2]
        normal = u[1:4] * v[2:5]
        normal -= u[2:5] * v[1:4]
        foot = np.subtract(m[:, 3, 0], origins, out=way[:3, 0])
        foot += space[:, 0]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            t = _dot(foot, normal)
            t /= _dot(directions, normal)
        at, second, third = _dot(way[:3], directions[:, None])  # along the ray
        nearest = np.minimum(second, third)
        np.minimum(nearest, 0.0, out=nearest)
        nearest += at
        np.maximum(second, third, out=third)
        np.maximum(third, 0.0, out=third)
        third += at
        np.fmax(t, nearest, out=t)
        return np.fmin(t, third, out=t)


def whole_triangles(mesh: TriMesh) -> np.ndarray:
    """Numbers of the triangles that a ray can hit: corners finite, area not zero."""
    with np.errstate(invalid="ignore", over="ignore"):
        area = sum(np.abs(mesh.area_vectors().T))
    return np.flatnonzero(np.isfinite(area) & (area > 0))


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of vectors (3, …), in this order of sums at any number of them."""
    product = a * b
    total: np.ndarray = product[0] + product[1]
    total += product[2]
    return total
