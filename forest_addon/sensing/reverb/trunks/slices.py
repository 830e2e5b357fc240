"""Trunks from the evaluated geometry: where a horizontal plane cuts the wood.

A ``SceneGeometry`` goes in, the stems at one height come out as upright cylinders for the reverb. The
wood triangles that cross the plane give one segment each; segments meet in the mesh edges that their
triangles share, and the connected components of that graph are the contours. ``contours`` turns
each into a circle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ....base.rows import RowTable
from ....base.trimesh import TriMesh, is_wood
from ...rays.geometry import SceneGeometry
from .contours import equivalent_circle, largest_radii


@dataclass(frozen=True)
class Trunks(RowTable):
    """N upright cylinders.

    position : (N, 2) centre in the plane, metres.
    radius : (N,) metres.
    tree : (N,) int64, the tree it belongs to, -1 where it belongs to none.
    instance : (N,) int64, the instance that was cut, None where trunks come from no scene.
    thin : how many stems were left out because they are thinner than asked for.
    inside : how many were left out because they lie inside a thicker one of their instance.
    """

    position: np.ndarray
    radius: np.ndarray
    tree: np.ndarray
    instance: np.ndarray | None = None
    thin: int = 0
    inside: int = 0

    def __len__(self) -> int:
        return len(self.radius)

    def clear_of(self, places: np.ndarray) -> Trunks:
        """Those that cover none of the places (P, 2)."""
        free = np.ones(len(self), dtype=bool)
        for place in places:
            free &= np.hypot(*(self.position - place).T) > self.radius
        return self.select(free)

    def with_others(self, *others: Trunks) -> Trunks:
        """These trunks and after them the others'; which instance was cut is forgotten."""
        every = (self, *others)
        return Trunks(
            position=np.concatenate([trunks.position for trunks in every]),
            radius=np.concatenate([trunks.radius for trunks in every]),
            tree=np.concatenate([trunks.tree for trunks in every]),
            thin=max(trunks.thin for trunks in every),
            inside=max(trunks.inside for trunks in every),
        )


def trunks_at_height(
    scene: SceneGeometry,
    height: float,
    min_radius: float = 0.0,
    wood: dict[int, WeldedWood] | None = None,
) -> Trunks:
    """The stems that the plane z = ``height`` cuts, at least ``min_radius`` thick (both metres).

    A vertex in the plane counts as above it, so that a stem reaches from its foot, excluded, to its
    top, included. Triangles with a coordinate that is not finite are passed over.

    wood : of the scene's meshes, by their number, as earlier cuts needed it; what is lacking is added.
    """
    low, high = scene.bounds()
    slack = 1e-9 * (1.0 + abs(height))  # the boxes are rounded; the vertices decide
    crossed = np.flatnonzero((low[:, 2] <= height + slack) & (high[:, 2] >= height - slack))
    wood = {} if wood is None else wood
    for index in np.unique(scene.mesh_index[crossed]).tolist():
        if index not in wood:
            wood[index] = WeldedWood(scene.meshes[index])
    found: list[tuple[int, np.ndarray, float]] = []
    thin = inside = 0
    for instance in crossed:
        transform = scene.transform[instance]
        segments = wood[scene.mesh_index[instance]].cut(transform, height)
        stems, thinner = _stems(segments, min_radius)
        separate = _outermost(stems)
        thin += thinner
        inside += len(stems) - len(separate)
        found += [(int(instance), centre + transform[:2, 3], radius) for centre, radius in separate]
    of = np.array([instance for instance, _, _ in found], dtype=np.int64)
    return Trunks(
        position=np.array([centre for _, centre, _ in found]).reshape(-1, 2),
        radius=np.array([radius for _, _, radius in found], dtype=np.float64),
        tree=scene.tree[of],
        instance=of,
        thin=thin,
        inside=inside,
    )


@dataclass(frozen=True)
class _Segments:
    """M segments where triangles cross the plane.

    ends : (M, 2, 2) x and y of both ends, from the instance's origin.
    normal : (M, 3) unit normals of the triangles.
    contour : (M,) number of the contour, 0 to the count less 1.
    """

    ends: np.ndarray
    normal: np.ndarray
    contour: np.ndarray


class WeldedWood:
    """The wood of one mesh in local space; vertices at the same place are one vertex."""

    def __init__(self, mesh: TriMesh) -> None:
        triangles = mesh.triangles[is_wood(mesh.part)]
        finite = np.isfinite(mesh.vertices).all(axis=1)
        triangles = triangles[finite[triangles].all(axis=1)]
        used, packed = np.unique(triangles, return_inverse=True)
        self.vertices, welded = _places(mesh.vertices[used])
        self.triangles = welded[packed.reshape(-1, 3)].astype(np.int64)
        self._z = np.ascontiguousarray(self.vertices[:, 2])
        of_triangles = self._z[self.triangles.T]
        self._low, self._high = of_triangles.min(axis=0), of_triangles.max(axis=0)

    def cut(self, transform: np.ndarray, height: float) -> _Segments:
        """Cut one instance: only triangles that cross the plane are moved to the world."""
        x, y, up, lift = transform[2]
        lift -= height
        if x == y == 0 and up > 0:  # upright: heights rise as they do in the mesh
            level = self._z * up + lift
            above = level >= 0
            low, high = self._low * up + lift, self._high * up + lift
            crossing = self.triangles[(low < 0) & (high >= 0)]
        else:
            level = self.vertices @ transform[2, :3] + lift
            above = level >= 0
            sides = above[self.triangles]
            crossing = self.triangles[sides.any(axis=1) & ~sides.all(axis=1)]

        # The corner that is alone on its side makes the two crossed edges with the other two.
        side = above[crossing]
        lone = np.where((side.sum(axis=1) == 1)[:, None], side, ~side).argmax(axis=1)
        turned = np.take_along_axis(crossing, (lone[:, None] + np.arange(3)) % 3, axis=1)
        edges = np.sort(
            np.stack([turned[:, [0, 1]], turned[:, [0, 2]]], axis=1), axis=2
        )  # (M, 2, 2) vertex numbers
        a, b = edges[..., 0], edges[..., 1]
        share = (level[a] / (level[a] - level[b]))[..., None]
        local = self.vertices[a] + share * (self.vertices[b] - self.vertices[a])

        corners = self.vertices[crossing] @ transform[:, :3].T
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return _Segments(
            ends=local @ transform[:2, :3].T,
            normal=np.divide(normal, length, out=np.zeros_like(normal), where=length > 0),
            contour=_components(a * len(self.vertices) + b),
        )


def _places(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) different places of vertices (V, 3) by x, y and z, and (V,) which of them is a vertex': in a
    third of the time of ``np.unique`` over rows."""
    order = np.lexsort(vertices.T[::-1])
    ordered = vertices[order]
    new = np.ones(len(ordered), dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    which = np.empty(len(order), dtype=np.int64)
    which[order] = np.cumsum(new) - 1
    return ordered[new], which


def _components(edge: np.ndarray) -> np.ndarray:
    """(M,) contour of each segment; ``edge`` (M, 2) names the mesh edges that hold its ends."""
    names, node = np.unique(edge, return_inverse=True)
    node = node.reshape(-1, 2)
    graph = sparse.coo_matrix(
        (np.ones(len(node), np.int8), (node[:, 0], node[:, 1])), shape=(len(names), len(names))
    )
    label = csgraph.connected_components(graph, directed=False)[1]
    contour: np.ndarray = label[node[:, 0]]
    return contour


def _stems(segments: _Segments, min_radius: float) -> tuple[list[tuple[np.ndarray, float]], int]:
    """Centre and radius of each contour that is thick enough, and how many are not."""
    step = segments.ends[:, 1] - segments.ends[:, 0]
    length = np.bincount(segments.contour, np.hypot(step[:, 0], step[:, 1]))
    order = np.argsort(segments.contour, kind="stable")
    first = np.searchsorted(segments.contour[order], np.arange(len(length) + 1))
    most = largest_radii(segments.ends, segments.normal, segments.contour, len(length))
    stems = []
    for contour in np.flatnonzero((most >= min_radius) & (length > 0)):
        rows = order[first[contour] : first[contour + 1]]
        centre, radius = equivalent_circle(segments.ends[rows], segments.normal[rows])
        if radius >= min_radius:
            stems.append((centre, radius))
    return stems, len(length) - len(stems)


def _outermost(stems: list[tuple[np.ndarray, float]]) -> list[tuple[np.ndarray, float]]:
    """The stems, thickest first, without those whose centre lies within a thicker one."""
    kept: list[tuple[np.ndarray, float]] = []
    for centre, radius in sorted(stems, key=lambda stem: -stem[1]):
        if all(math.dist(centre, other) >= reach for other, reach in kept):
            kept.append((centre, radius))
    return kept
