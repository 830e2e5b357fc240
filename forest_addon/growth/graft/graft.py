"""Branch templates onto nodes: rotate, scale and move so that foot and direction match (Tanveer et al.
2020a).

A template lies along +X with its upper side towards +Z. At a node its axis is turned into the branch's
direction and its upper side as far up as that direction allows, so that leaves keep facing the light.
Wood is scaled with the branch; leaves move with it but keep their own size, because a longer branch
bears no larger leaves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...base.rng import truncated_normal
from ...base.runs import Runs
from ...base.trimesh import LEAF, WOOD, Edges, TriMesh, join_edges
from ..mesh.edges import repeated_edges
from ..mesh.leaves import Leaves
from .cut import BranchTemplate, canonical_frame

MOST_LEAVES_A_FOOT = 3.0


@dataclass(frozen=True)
class Scion:
    """A branch template made ready to graft: wood and leaves apart, every leaf with its foot."""

    wood: TriMesh
    leaf_mesh: TriMesh
    leaf_foot: np.ndarray  # (L, 3) where each leaf hangs, canonical frame
    blade: np.ndarray  # (V, 3) vertices of leaf_mesh from where their leaf hangs
    vertices: Runs  # of each leaf, as are triangles and edges
    triangles: Runs
    edges: Runs
    leaves: Leaves  # their truth, canonical frame
    length: float  # metres in the template tree


@dataclass(frozen=True)
class GraftSite:
    """Place of a graft: its foot (3,), unit direction (3,) and length in metres."""

    foot: np.ndarray
    direction: np.ndarray
    length: float


def prepare(template: BranchTemplate) -> Scion:
    """Take a template apart; a leaf's foot is its corner or edge middle nearest to any wood."""
    mesh = template.mesh
    wood, leaf_mesh, leaf_of_vertex = _apart(mesh)
    count = len(template.leaves)
    foot = np.zeros((count, 3))
    if count:
        corners = leaf_mesh.vertices[leaf_mesh.triangles]
        places = np.concatenate([corners, (corners + np.roll(corners, 1, axis=1)) / 2], axis=1)
        owner = np.repeat(leaf_mesh.leaf, places.shape[1])
        places = places.reshape(-1, 3)
        gap = cKDTree(wood.vertices).query(places)[0]
        farthest_first = np.argsort(-gap, kind="stable")
        foot[owner[farthest_first]] = places[farthest_first]
    edges = repeated_edges(leaf_mesh.triangles, 0, 1)
    return Scion(
        wood=replace(wood, edges=repeated_edges(wood.triangles, 0, 1)),
        leaf_mesh=replace(leaf_mesh, edges=edges),
        leaf_foot=foot,
        blade=leaf_mesh.vertices - foot[leaf_of_vertex],
        vertices=Runs.of(leaf_of_vertex, count),
        triangles=Runs.of(leaf_mesh.leaf, count),
        edges=Runs.of(leaf_of_vertex[edges.ends[:, 0]], count),
        leaves=template.leaves,
        length=template.length,
    )


def _apart(mesh: TriMesh) -> tuple[TriMesh, TriMesh, np.ndarray]:
    """Wood, leaves sorted by leaf, and the leaf of every leaf vertex."""
    wood, leaves = mesh.select(mesh.part == WOOD), mesh.select(mesh.part == LEAF)
    triangle_order = np.argsort(leaves.leaf, kind="stable")
    leaf_of_vertex = np.zeros(len(leaves.vertices), dtype=np.int64)
    leaf_of_vertex[leaves.triangles] = leaves.leaf[:, None]
    vertex_order = np.argsort(leaf_of_vertex, kind="stable")
    new_number = np.empty_like(vertex_order)
    new_number[vertex_order] = np.arange(len(vertex_order))
    ordered = TriMesh(
        vertices=leaves.vertices[vertex_order],
        triangles=new_number[leaves.triangles[triangle_order]].astype(np.int32),
        part=leaves.part[triangle_order],
        leaf=leaves.leaf[triangle_order],
        material=leaves.material[triangle_order],
    )
    return wood, ordered, leaf_of_vertex[vertex_order]


def graft(
    scion: Scion, site: GraftSite, leaf_spread: float, roll: float, rng: np.random.Generator
) -> tuple[TriMesh, Leaves, np.ndarray]:
    """The branch at its site, wood and leaves in one mesh with leaf numbers from 0; their truth, and
    (L, 3) where they hang.

    leaf_spread : relative standard deviation of leaf size.
    roll : radians that the branch is turned about its own axis.

    A longer branch bears more leaves, not larger ones. The truth of a leaf is its template's, moved as
    the leaf is moved.
    """
    turn = canonical_frame(site.direction).T @ _roll(roll)  # columns: images of X, Y, Z
    wood = scion.wood
    wood_vertices = (wood.vertices * site.length) @ turn.T + site.foot

    leaves, truth, foot = _hang_leaves(scion, site.length, leaf_spread, rng)
    leaf_vertices = leaves.vertices @ turn.T + site.foot
    mesh = TriMesh(
        vertices=np.concatenate([wood_vertices, leaf_vertices]),
        triangles=np.concatenate([wood.triangles, leaves.triangles + np.int32(len(wood_vertices))]),
        part=np.concatenate([wood.part, leaves.part]),
        leaf=np.concatenate([wood.leaf, leaves.leaf]),
        material=np.concatenate([wood.material, leaves.material]),
        edges=join_edges([wood, leaves]),
    )
    moved = replace(
        truth,
        centre=truth.centre @ turn.T + site.foot,
        normal=truth.normal @ turn.T,
        axis=truth.axis @ turn.T,
    )
    return mesh, moved, foot @ turn.T + site.foot


def _hang_leaves(
    scion: Scion, length: float, spread: float, rng: np.random.Generator
) -> tuple[TriMesh, Leaves, np.ndarray]:
    """Leaves of a branch of this length, their truth and feet, in the template's frame but in metres.

    The number of leaves goes with length^1.5, as a crown's leaf area between its length and its area: a
    leaf of the template hangs there not at all, once or several times, each further one turned about
    the vertical at the same foot.
    """
    count = len(scion.leaf_foot)
    share = min((length / scion.length) ** 1.5, MOST_LEAVES_A_FOOT)
    times = np.floor(share + rng.random(count)).astype(int)
    source = np.repeat(np.arange(count), times)  # (L,) leaf of the template
    rank = np.arange(len(source)) - np.repeat(np.cumsum(times) - times, times)
    size = scion.length * (1 + spread * truncated_normal(rng, len(source)))
    turn = np.where(rank == 0, 0.0, np.pi * rng.uniform(0.4, 1.6, len(source)))

    # Vertices and triangles of a template's leaf stand together: copy the runs.
    vertex, vertex_leaf, moved = scion.vertices.copy(source)
    cos, sin = np.cos(turn), np.sin(turn)
    # ``take`` along the rows is twice as fast as brackets, and so are numbers of half the size.
    blade = scion.blade.take(vertex, axis=0)
    turned = _about_vertical(blade, cos.take(vertex_leaf), sin.take(vertex_leaf))
    turned *= size.take(vertex_leaf)[:, None]
    foot = scion.leaf_foot[source] * length
    turned += foot.take(vertex_leaf, axis=0)
    triangle, triangle_leaf, _ = scion.triangles.copy(source)
    moved = moved.astype(np.int32)
    triangles = scion.leaf_mesh.triangles.take(triangle, axis=0)
    triangles += moved.take(triangle_leaf)[:, None]
    mesh = TriMesh(
        vertices=turned,
        triangles=triangles,
        part=scion.leaf_mesh.part[triangle],
        leaf=triangle_leaf.astype(np.int32),
        material=np.ones(len(triangle), dtype=np.int32),
        edges=_hung_edges(scion, source, moved, triangle, triangle_leaf),
    )
    own = scion.leaves
    middle = _about_vertical(own.centre[source] - scion.leaf_foot[source], cos, sin)
    truth = Leaves(
        centre=foot + middle * size[:, None],
        normal=_about_vertical(own.normal[source], cos, sin),
        axis=_about_vertical(own.axis[source], cos, sin),
        length=own.length[source] * size,
        width=own.width[source] * size,
        radius=own.radius[source] * size,
        branch=own.branch[source],
    )
    return mesh, truth, foot


def _hung_edges(
    scion: Scion,
    source: np.ndarray,
    moved: np.ndarray,
    triangle: np.ndarray,
    triangle_leaf: np.ndarray,
) -> Edges:
    """Edges of the leaves ``source`` of a template, copied as their vertices and triangles are."""
    known = scion.leaf_mesh.known_edges()
    assert known is not None  # ``prepare`` finds them
    edge, edge_leaf, edge_moved = scion.edges.copy(source)
    ends = known.ends.take(edge, axis=0)
    ends += moved.take(edge_leaf)[:, None]
    of_corner = known.of_corner.take(triangle, axis=0)
    of_corner += edge_moved.astype(np.int32).take(triangle_leaf)[:, None]
    return Edges(ends, of_corner)


def _about_vertical(vectors: np.ndarray, cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
    """Vectors (N, 3), each turned about +Z by the angle with this cosine and sine."""
    x, y, z = vectors.T
    turned = np.empty(vectors.shape)
    np.subtract(cos * x, sin * y, out=turned[:, 0])
    np.add(sin * x, cos * y, out=turned[:, 1])
    turned[:, 2] = z
    return turned


def _roll(angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
