"""A mesh of many owners, such as leaves or pieces of wood, of which any may be copied any number of times.

Triangles are kept wound both ways, so that a copy can be mirrored; edges are copied with them, so that
nobody has to look for them afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.runs import Runs
from ...base.trimesh import Edges, TriMesh
from ..mesh.edges import repeated_edges


@dataclass(frozen=True, eq=False)
class CopyStock:
    """The parts of N owners; vertices, triangles and edges stand together by owner.

    place : (V, 3). corners, of_corner : (2T, 3) int32, vertices and edges of all triangles, then of the
    same inside out. ends : (E, 2) int32. part, material : what all triangles are.
    """

    place: np.ndarray
    corners: np.ndarray
    of_corner: np.ndarray
    ends: np.ndarray
    vertices: Runs
    triangles: Runs
    edges: Runs
    part: int
    material: int

    @classmethod
    def of(
        cls, place: np.ndarray, owner: np.ndarray, triangles: np.ndarray, part: int, material: int
    ) -> CopyStock:
        """Of places (V, 3) sorted by owner (V,) and triangles (T, 3) sorted by owner, 0 .. N - 1."""
        count = int(owner[-1]) + 1 if len(owner) else 0
        edges = repeated_edges(triangles, 0, 1)
        return cls(
            place=place,
            corners=np.concatenate([triangles, triangles[:, ::-1]]).astype(np.int32),
            of_corner=np.concatenate([edges.of_corner, edges.of_corner[:, [1, 0, 2]]]),
            ends=edges.ends,
            vertices=Runs.of(owner, count),
            triangles=Runs.of(owner[triangles[:, 0]], count),
            edges=Runs.of(owner[edges.ends[:, 0]], count),
            part=part,
            material=material,
        )

    def copy(
        self, wanted: np.ndarray, mirrored: np.ndarray
    ) -> tuple[TriMesh, np.ndarray, np.ndarray, np.ndarray]:
        """Copies of wanted owners (N,), inside out where mirrored (N,).

        Returns
        -------
        The mesh, its vertices not placed yet; (V,) the vertex of the stock that each one is; (V,) and
        (T,) which wanted one each vertex and triangle is of.
        """
        vertex, of_vertex, moved = self.vertices.copy(wanted)
        triangle, of_triangle, _ = self.triangles.copy(wanted)
        edge, of_edge, edge_moved = self.edges.copy(wanted)
        wound = triangle + (len(self.corners) // 2) * mirrored[of_triangle]
        corners, of_corner, ends = self.corners[wound], self.of_corner[wound], self.ends[edge]
        corners += moved.astype(np.int32)[of_triangle][:, None]
        of_corner += edge_moved.astype(np.int32)[of_triangle][:, None]
        ends += moved.astype(np.int32)[of_edge][:, None]
        mesh = TriMesh.of_part(np.empty((0, 3)), corners, self.part)
        mesh.material[:] = self.material
        return replace(mesh, edges=Edges(ends, of_corner)), vertex, of_vertex, of_triangle
