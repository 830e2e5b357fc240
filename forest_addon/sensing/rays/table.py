"""All triangles of a scene's meshes in one table, so that what was hit is looked up in one step."""

from __future__ import annotations

import numpy as np

from ...base.trimesh import TriMesh


class TriangleTable:
    """Triangles of meshes, one mesh after the other.

    starts : (M,) number of each mesh's first triangle. triangles : (T, 3) int32, rows of ``vertices``.
    vertices : (V, 3), in each mesh's space; float32 where that holds them all exactly, as Blender does.
    part : (T,) int8.
    """

    def __init__(self, meshes: tuple[TriMesh, ...]) -> None:
        triangles = [len(mesh.triangles) for mesh in meshes]
        vertices = [len(mesh.vertices) for mesh in meshes]
        self.starts = np.cumsum([0, *triangles])[:-1]
        short = all(_is_short(mesh.vertices) for mesh in meshes)
        self._corners = np.cumsum([0, *vertices])
        room = np.zeros((self._corners[-1] + 1, 3), dtype=np.float32 if short else np.float64)
        self.vertices = room[:-1]
        self.triangles = np.empty((sum(triangles), 3), dtype=np.int32)
        self.part = np.empty(sum(triangles), dtype=np.int8)
        for number, mesh in enumerate(meshes):
            corner, face = int(self._corners[number]), int(self.starts[number])
            self.vertices[corner : corner + len(mesh.vertices)] = mesh.vertices
            faces = slice(face, face + len(mesh.triangles))
            np.add(mesh.triangles, corner, out=self.triangles[faces])
            self.part[faces] = mesh.part

    def short(self, mesh: int) -> np.ndarray | None:
        """(V, 3) vertices of a mesh in float32, with a row more behind them; None where that does not hold
        them."""
        if self.vertices.dtype != np.float32:
            return None
        return self.vertices[self._corners[mesh] : self._corners[mesh + 1]]

    def corners(self, number: np.ndarray) -> np.ndarray:
        """(3, 3, R) float64: of each coordinate and each corner, those of triangles (R,) of the table."""
        found = self.vertices.take(self.triangles.take(number, 0), 0)
        return found.transpose(2, 1, 0).astype(np.float64, order="C")


def _is_short(points: np.ndarray) -> bool:
    """Return whether float32 holds points exactly; what is no number need not be kept."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool((points.astype(np.float32) == points).all())
