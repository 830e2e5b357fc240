"""Test for points inside the wood of a tree: all rays that leave them meet the back of one tree's faces.

Points and a caster over wood go in, tree numbers come out. Faces of wood look outwards; where an instance
is mirrored, they are turned back. A point among branches sees sky, or a front.
"""

from __future__ import annotations

import math

import numpy as np

from .caster import RayCaster, hit_normals

RAYS = 16


def tree_around(caster: RayCaster, points: np.ndarray) -> np.ndarray:
    """(P,) the number of the tree that each of the points (P, 3) lies in, -1 where it lies in none."""
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    # Evenly all around, none along an axis.
    up = 1.0 - (2.0 * np.arange(RAYS) + 1.0) / RAYS
    turn = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(RAYS) + 0.1
    level = np.sqrt(1.0 - up * up)
    ways = np.column_stack([level * np.cos(turn), level * np.sin(turn), up])
    hits = caster.cast(np.repeat(points, RAYS, axis=0), np.tile(ways, (len(points), 1)))
    scene = caster.scene
    if not len(scene.transform):
        return np.full(len(points), -1)
    flipped = np.linalg.det(scene.transform[:, :, :3])[hits.instance] < 0
    along = np.einsum("ri,ri->r", hit_normals(scene, hits), np.tile(ways, (len(points), 1)))
    behind = hits.found & (np.where(flipped, -along, along) > 0)
    tree = np.where(behind, scene.tree[hits.instance], -1).reshape(-1, RAYS)
    return np.where((tree == tree[:, :1]).all(axis=1), tree[:, 0], -1)
