"""Copies of parts of a mesh: of leaves, or pieces of wood, any of which may be wanted any number of times.

Triangles are kept wound both ways, so that a copy can be mirrored; edges are copied with them, so that
nobody has to look for them afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.runs import Runs
from ...base.trimesh import Edges, TriMesh
from .meshing import repeated_edges


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
        # ``take`` along the rows is twice as fast as brackets, and so are numbers of half the size.
        corners, of_corner = self.corners.take(wound, axis=0), self.of_corner.take(wound, axis=0)
        ends, moved = self.ends.take(edge, axis=0), moved.astype(np.int32)
        corners += moved.take(of_triangle)[:, None]
        of_corner += edge_moved.astype(np.int32).take(of_triangle)[:, None]
        ends += moved.take(of_edge)[:, None]
        mesh = TriMesh.of_part(np.empty((0, 3)), corners, self.part)
        mesh.material[:] = self.material
        return replace(mesh, edges=Edges(ends, of_corner)), vertex, of_vertex, of_triangle


def leaves_apart(mesh: TriMesh) -> tuple[TriMesh, TriMesh, np.ndarray]:
    """What is no leaf, the leaves sorted by their numbers, and the leaf (V,) of each of their vertices."""
    is_leaf = mesh.leaf >= 0
    leaves = mesh.select(is_leaf)
    leaf_of_vertex = np.zeros(len(leaves.vertices), dtype=np.int64)
    leaf_of_vertex[leaves.triangles] = leaves.leaf[:, None]
    by_leaf = np.argsort(leaf_of_vertex, kind="stable")
    number = np.empty_like(by_leaf)
    number[by_leaf] = np.arange(len(by_leaf))
    row = np.argsort(leaves.leaf, kind="stable")
    ordered = TriMesh(
        vertices=leaves.vertices[by_leaf],
        triangles=number[leaves.triangles[row]].astype(np.int32),
        part=leaves.part[row],
        leaf=leaves.leaf[row],
        material=leaves.material[row],
        uv=None if leaves.uv is None else leaves.uv[row],
        order=None if leaves.order is None else leaves.order[row],
    )
    return mesh.select(~is_leaf), ordered, leaf_of_vertex[by_leaf]
