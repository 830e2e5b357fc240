"""Leaves inclined as a species' leaves are: each turned about a level line through its foot.

A leaf keeps its foot, its size and the azimuth to which it faces; of its normal only the angle θ to the
vertical becomes that which was drawn. With k the level unit vector at right angles to the normal, the turn
is that by the difference of the angles about k (Rodrigues). A leaf that lies flat has no azimuth: it tips
towards the end of its midrib.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...base.trimesh import TriMesh
from ...base.vectors import column
from ..skeleton import LeafSites
from .leaves import Leaves

FLAT = 1e-9  # sine of an inclination below which a leaf faces no side


def turns(normal: np.ndarray, axis: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(L, 3, 3) what turns leaves of these unit normals and midribs to the wanted inclinations, radians."""
    up = np.where(normal[:, 2:] < 0, -normal, normal)
    level = np.hypot(up[:, 0], up[:, 1])
    side = np.where((level > FLAT)[:, None], up[:, :2], axis[:, :2])
    size = np.linalg.norm(side, axis=1, keepdims=True)
    side = np.where(size > FLAT, side / np.maximum(size, FLAT), [1.0, 0.0])
    by = wanted - np.arctan2(level, column(up, 2))
    cos, sin = np.cos(by), np.sin(by)
    x, y = -side[:, 1], side[:, 0]  # k, which turns +Z towards the side
    turn = np.empty((len(normal), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 0, 2] = (
        cos + x * x * (1 - cos),
        x * y * (1 - cos),
        y * sin,
    )
    turn[:, 1, 0], turn[:, 1, 1], turn[:, 1, 2] = (
        x * y * (1 - cos),
        cos + y * y * (1 - cos),
        -x * sin,
    )
    turn[:, 2, 0], turn[:, 2, 1], turn[:, 2, 2] = -y * sin, x * sin, cos
    return turn


def incline_sites(sites: LeafSites, wanted: np.ndarray, normal: np.ndarray) -> LeafSites:
    """Leaf sites whose leaves incline so (L,), radians. normal : (L, 3) as the leaves face now."""
    turn = turns(normal, sites.direction, wanted)
    direction, up = (np.einsum("lij,lj->li", turn, v) for v in (sites.direction, sites.up))
    return replace(sites, direction=direction, up=up)


def incline_leaves(
    mesh: TriMesh, leaves: Leaves, foot: np.ndarray, wanted: np.ndarray
) -> tuple[TriMesh, Leaves]:
    """A tree's mesh and the truth of its leaves, with these inclinations (L,), radians.

    foot : (L, 3) where each leaf hangs. No two leaves share a vertex, and none with the wood.
    """
    turn = turns(leaves.normal, leaves.axis, wanted)
    of_vertex = np.full(len(mesh.vertices), -1)
    of_leaf = mesh.leaf >= 0
    of_vertex[mesh.triangles[of_leaf]] = mesh.leaf[of_leaf][:, None]
    moved = np.flatnonzero(of_vertex >= 0)
    leaf = of_vertex[moved]
    vertices = mesh.vertices.copy()
    vertices[moved] = foot[leaf] + _turned(turn[leaf], vertices[moved] - foot[leaf])
    truth = replace(
        leaves,
        centre=foot + _turned(turn, leaves.centre - foot),
        normal=_turned(turn, leaves.normal),
        axis=_turned(turn, leaves.axis),
    )
    return replace(mesh, vertices=vertices), truth


def _turned(turn: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("lij,lj->li", turn, vectors))
