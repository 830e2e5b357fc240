"""Triangles that know what they are: wood, leaf, ground or something else.

The one mesh type of the project: growth makes it, ``blender/`` writes it to a Mesh and reads it back
from the evaluated scene, ray casters and sensors use it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from .rows import distinct

OTHER, WOOD, LEAF, GROUND, DEAD = 0, 1, 2, 3, 4
PART_NAMES = ("other", "wood", "leaf", "ground", "dead wood")


def is_wood(part: np.ndarray) -> np.ndarray:
    """(N,) whether parts are wood, living or dead."""
    return np.asarray((part == WOOD) | (part == DEAD))


@dataclass(frozen=True)
class Edges:
    """Every edge of a mesh once.

    ends : (E, 2) int32, vertices.
    of_corner : (T, 3) int32, the edge from each corner of a triangle to its next.
    """

    ends: np.ndarray
    of_corner: np.ndarray


@dataclass(frozen=True)
class TriMesh:
    """Triangles with a part, a leaf number and a material slot each.

    vertices : (V, 3) float64, metres; those given in float32, as Blender has them, are kept so (``points``).
    triangles : (T, 3) int32, indices into ``vertices``.
    part : (T,) int8, ``OTHER``, ``WOOD``, ``LEAF``, ``GROUND`` or ``DEAD``.
    leaf : (T,) int32, the leaf a triangle belongs to, -1 where it is no leaf.
    material : (T,) int32, material slot.
    uv : (T, 3, 2) float32 texture coordinates by corner, or None; may be given as what makes them each time.
    order : (T,) int8, branching order of the wood (0 the trunk) or of what bears the leaf, or None.
    edges : known from how the mesh was made, or what makes them when they are asked for, or None.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    part: np.ndarray
    leaf: np.ndarray
    material: np.ndarray
    uv: np.ndarray | None = None
    order: np.ndarray | None = None
    edges: Edges | Callable[[], Edges] | None = None

    @classmethod
    def of_part(
        cls,
        vertices: np.ndarray,
        triangles: np.ndarray,
        part: int,
        leaf: np.ndarray | int = -1,
        material: int = 0,
    ) -> TriMesh:
        """A mesh of one part and material slot. leaf : (T,) numbers of leaves; -1: of none."""
        count = len(triangles)
        return cls(
            vertices=np.ascontiguousarray(vertices, dtype=np.float64).reshape(-1, 3),
            triangles=np.ascontiguousarray(triangles, dtype=np.int32).reshape(-1, 3),
            part=np.full(count, part, dtype=np.int8),
            leaf=np.full(count, leaf, dtype=np.int32),
            material=np.full(count, material, dtype=np.int32),
        )

    @property
    def points(self) -> np.ndarray:
        """(V, 3) vertices as they are kept: in float64, or in float32 with a row more behind them."""
        points: np.ndarray = vars(self)["vertices"]
        return points

    def known_edges(self) -> Edges | None:
        """The edges, made now where they were left for later."""
        return self.edges() if callable(self.edges) else self.edges

    @cached_property
    def solid(self) -> TriMesh:
        """The mesh without leaves: itself where it has none."""
        wood = self.part != LEAF
        return self if wood.all() else self.select(wood)

    def area_vectors(self) -> np.ndarray:
        """(T, 3) half cross products: the direction is the normal, the length the area in m²."""
        first, second, third = np.ascontiguousarray(self.triangles.T)
        u, v = [], []
        for x in np.ascontiguousarray(self.vertices.T):  # axis by axis: a third of np.cross' time
            a = x[first]
            u.append(x[second] - a)
            v.append(x[third] - a)
        area = np.empty((len(first), 3))
        for axis, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
            area[:, axis] = u[i] * v[j] - u[j] * v[i]
        area *= 0.5
        return area

    def select(self, keep: np.ndarray) -> TriMesh:
        """Triangles where ``keep`` (T,) is true, or by their numbers; vertices that none uses are dropped."""
        triangles = self.triangles[keep]
        used = distinct(triangles)
        return TriMesh(
            vertices=self.points[used],
            triangles=np.searchsorted(used, triangles).astype(np.int32),
            part=self.part[keep],
            leaf=self.leaf[keep],
            material=self.material[keep],
            uv=None if self.uv is None else self.uv[keep],
            order=None if self.order is None else self.order[keep],
        )


def _keep(mesh: TriMesh, vertices: np.ndarray) -> None:
    if vertices.dtype == np.float32:  # Embree reads them where they are, 16 bytes at a time
        vertices = np.concatenate([vertices, np.zeros((1, 3), np.float32)])[:-1]
    vars(mesh)["vertices"] = vertices


TriMesh.vertices = property(  # type: ignore[assignment]
    lambda mesh: mesh.points.astype(np.float64, copy=False), _keep
)
TriMesh.uv = property(  # type: ignore[assignment]
    lambda mesh: vars(mesh)["uv"]() if callable(vars(mesh)["uv"]) else vars(mesh)["uv"],
    lambda mesh, given: vars(mesh).update(uv=given),
)


def join(meshes: Sequence[TriMesh]) -> TriMesh:
    """One mesh out of several; leaf numbers of later meshes follow on those of earlier ones."""
    if not meshes:
        return TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), OTHER)
    sizes = [len(m.triangles) for m in meshes]
    triangles = np.empty((sum(sizes), 3), dtype=np.int32)
    leaf = np.empty(sum(sizes), dtype=np.int32)
    start = first_vertex = first_leaf = 0
    for m, size in zip(meshes, sizes, strict=True):
        stop = start + size
        np.add(m.triangles, first_vertex, out=triangles[start:stop], casting="unsafe")
        largest = int(m.leaf.max(initial=-1))
        leaf[start:stop] = m.leaf
        if largest >= 0 and first_leaf:
            leaf[start:stop][m.leaf >= 0] += first_leaf
        first_vertex += len(m.vertices)
        first_leaf += largest + 1
        start = stop
    has_uv = all(m.uv is not None for m in meshes)
    has_order = all(m.order is not None for m in meshes)
    edges = [(m.edges, len(m.vertices)) for m in meshes if m.edges is not None]
    return TriMesh(
        vertices=np.concatenate([m.vertices for m in meshes]),
        triangles=triangles,
        part=np.concatenate([m.part for m in meshes]),
        leaf=leaf,
        material=np.concatenate([m.material for m in meshes]),
        uv=np.concatenate([m.uv for m in meshes if m.uv is not None]) if has_uv else None,
        order=np.concatenate([m.order for m in meshes if m.order is not None])
        if has_order
        else None,
        edges=partial(join_edges, edges) if len(edges) == len(meshes) else None,
    )


def join_edges(parts: Sequence[tuple[Edges | Callable[[], Edges], int]]) -> Edges:
    """Edges of joined meshes, given those of each, or what makes them, and how many vertices it has."""
    ends, of_corner = [], []
    vertex = edge = 0
    for own, vertices in parts:
        known = own() if callable(own) else own
        ends.append(known.ends + np.int32(vertex))
        of_corner.append(known.of_corner + np.int32(edge))
        vertex += vertices
        edge += len(known.ends)
    return Edges(
        np.concatenate(ends or [np.empty((0, 2), np.int32)]),
        np.concatenate(of_corner or [np.empty((0, 3), np.int32)]),
    )
