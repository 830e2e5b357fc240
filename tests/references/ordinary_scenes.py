"""Ordinary scenes of boxes, walls, ground and leaves, drawn by seed; some of their faces lie on others."""

from __future__ import annotations

import numpy as np

from forest_addon.base.trimesh import GROUND, LEAF, OTHER, WOOD, TriMesh, join
from forest_addon.sensing.rays.geometry import SceneGeometry

FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def quad(corners, part):
    """Two triangles."""
    return TriMesh.of_part(np.asarray(corners, float), np.array([[0, 1, 2], [0, 2, 3]]), part)


def level(low, high, height, part):
    """A rectangle at a height."""
    (x, y), (u, v) = low, high
    return quad([(x, y, height), (u, y, height), (u, v, height), (x, v, height)], part)


def box(low, high, part):
    """A closed box of twelve triangles."""
    ends = np.array([low, high], float)
    corners = np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(-1, 3)
    return join([quad(corners[face], part) for face in FACES])


def ordinary(rng: np.random.Generator) -> SceneGeometry:
    """Ground, and on it what is drawn: a road at its height, boxes that share a face, a wall that stands
    there twice, a card of a leaf with both of its sides, a box sunk into the ground up to its top."""
    half = rng.uniform(6, 20)
    things = [(level((-half, -half), (half, half), 0.0, GROUND), 0.2)]
    for _ in range(int(rng.integers(1, 5))):
        kind = rng.integers(6)
        x, y = rng.uniform(-5, 5, 2)
        w, d, h = rng.uniform(0.3, 3, 3)
        part, bright = rng.choice([WOOD, OTHER]), rng.uniform(0.1, 0.9)
        one = box((x, y, 0), (x + w, y + d, h), part)
        if kind == 0:  # a road
            things.append((level((x, -half), (x + w, half), 0.0, OTHER), bright))
        elif kind == 1:
            things += [(one, bright), (box((x + w, y, 0), (x + 2 * w, y + d, h), WOOD), 0.5)]
        elif kind == 2:  # the same twice, under two names
            things += [(one, bright), (one, rng.choice([bright, 0.5]))]
        elif kind == 3:
            things.append((box((x, y, -h), (x + w, y + d, 0), part), bright))
        elif kind == 4:
            card = quad([(x, y, h), (x + w, y, h), (x + w, y, h + d), (x, y, h + d)], LEAF)
            back = TriMesh.of_part(card.vertices, card.triangles[:, ::-1], LEAF)
            things.append((join([card, back]), bright))
        else:
            shelf = level((x - 1, y - 1), (x + w, y + d), h, OTHER)
            things += [(one, bright), (shelf, 0.5)]
    count = len(things)
    place = np.tile(np.eye(3, 4), (count, 1, 1))
    if rng.random() < 0.5:  # somewhere far off, turned
        turn, shift = rng.uniform(0, 6), rng.uniform(-300, 300, 3)
        cos, sin = np.cos(turn), np.sin(turn)
        place[:, :3, :3] = [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]
        place[:, :, 3] = shift
    none = np.full(count, -1)
    names = tuple(f"thing {n}" for n in range(count))
    meshes, bright = zip(*things, strict=True)
    return SceneGeometry(
        tuple(meshes), place, np.arange(count), names, none, none, reflectance=np.array(bright)
    )
