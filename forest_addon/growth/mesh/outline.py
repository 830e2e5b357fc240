"""A tree in a few triangles: its outline as a stack of rings, for views of forests of thousands.

The tree is cut into bands of equal height; in each, every sector is as wide as most of what it holds. Where
there are leaves the outline is leaf, below the crown it is the trunk.
"""

from __future__ import annotations

import numpy as np

from ...base.trimesh import LEAF, WOOD, TriMesh

BANDS, SIDES = 5, 5
MOST = 85.0  # percent of the vertices of a band that its ring encloses


def outline(mesh: TriMesh) -> TriMesh:
    """At most 2 * BANDS * SIDES triangles, with the parts and material slots of trees."""
    solid = _used(mesh, mesh.triangles)
    solid = solid[solid[:, 2] >= 0]
    if not len(solid) or not solid[:, 2].max() > 0:
        return TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), WOOD)
    top = float(solid[:, 2].max())
    leaves = _used(mesh, mesh.triangles[mesh.part == LEAF])
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    rings, crowned = [], []
    for band in range(BANDS):
        low, high = top * band / BANDS, top * (band + 1) / BANDS
        here = solid[(solid[:, 2] >= low) & (solid[:, 2] <= high)]
        leafy = np.count_nonzero((leaves[:, 2] >= low) & (leaves[:, 2] <= high))
        crowned.append(leafy > 0.02 * len(leaves))
        middle = np.median(here[:, :2], axis=0) if len(here) else np.zeros(2)
        wide = _widths(here[:, :2] - middle) if len(here) else np.zeros(SIDES)
        ring = middle + wide[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        height = low if band == 0 else (low + high) / 2
        rings.append(np.column_stack([ring, np.full(SIDES, height)]))
    tip = np.append(rings[-1][:, :2].mean(axis=0), top)
    vertices = np.concatenate([*rings, tip[None]])
    side = np.arange(SIDES)
    onward = (side + 1) % SIDES
    faces, parts = [], []
    for band in range(BANDS - 1):
        a, b = band * SIDES + side, band * SIDES + onward
        faces += [np.column_stack([a, b, b + SIDES]), np.column_stack([a, b + SIDES, a + SIDES])]
        parts.append(np.full(2 * SIDES, LEAF if crowned[band] or crowned[band + 1] else WOOD))
    last = (BANDS - 1) * SIDES
    faces.append(np.column_stack([last + side, last + onward, np.full(SIDES, BANDS * SIDES)]))
    parts.append(np.full(SIDES, LEAF if crowned[-1] else WOOD))
    part = np.concatenate(parts).astype(np.int8)
    return TriMesh(
        vertices=vertices,
        triangles=np.concatenate(faces).astype(np.int32),
        part=part,
        leaf=np.full(len(part), -1, dtype=np.int32),
        material=(part == LEAF).astype(np.int32),
    )


def _used(mesh: TriMesh, triangles: np.ndarray) -> np.ndarray:
    """(P, 3) the vertices that triangles use, in their order; a mark on each is faster than sorting."""
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[triangles.ravel()] = True
    return np.asarray(mesh.vertices[used])


def _widths(offset: np.ndarray) -> np.ndarray:
    """(SIDES,) radius that encloses most of the points (P, 2) around each direction of the ring."""
    radius = np.linalg.norm(offset, axis=1)
    turn = np.arctan2(offset[:, 1], offset[:, 0]) / (2 * np.pi) * SIDES
    sector = np.round(turn).astype(int) % SIDES
    whole = np.percentile(radius, MOST)
    return np.array(
        [
            np.percentile(radius[sector == k], MOST) if (sector == k).any() else whole
            for k in range(SIDES)
        ]
    )
