"""Scenes for rays and echoes without Blender: meshes at places, each turned, perhaps on level ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from forest_addon.api import GrownForest, TriMesh

from .inside import GROUND, SceneGeometry


def turned(
    place: np.ndarray,
    turn: np.ndarray,
    wide: float | np.ndarray = 1.0,
    tall: float | np.ndarray = 1.0,
) -> np.ndarray:
    """(N, 3, 4) transforms to places (N, 2) m, turned (N,) radians about the vertical, scaled across and
    upwards."""
    transforms = np.tile(np.eye(3, 4), (len(place), 1, 1))
    transforms[:, 0, 0] = transforms[:, 1, 1] = wide * np.cos(turn)
    transforms[:, 1, 0], transforms[:, 0, 1] = wide * np.sin(turn), -wide * np.sin(turn)
    transforms[:, 2, 2], transforms[:, :2, 3] = tall, place
    return transforms


def level_ground(half: float) -> TriMesh:
    """A square at z = 0 that goes so many metres each way."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half
    return TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), GROUND)


def scene_of(
    meshes: Sequence[TriMesh],
    transform: np.ndarray | None = None,
    mesh_index: np.ndarray | None = None,
    tree: np.ndarray | None = None,
    under: TriMesh | None = None,
) -> SceneGeometry:
    """Trees of some meshes.

    transform : (N, 3, 4); None: one of each mesh, where it is. mesh_index : (N,); None: the meshes in turn.
    tree : (N,) their numbers; None: in order. under : the ground.
    """
    where = np.tile(np.eye(3, 4), (len(meshes), 1, 1)) if transform is None else transform
    count, every = len(where), tuple(meshes)
    index = np.arange(count) % len(meshes) if mesh_index is None else mesh_index
    number = np.arange(count) if tree is None else tree
    name, species = ("tree",) * count, np.zeros(count, np.int64)
    if under is not None:
        where, index = np.concatenate([where, np.eye(3, 4)[None]]), np.append(index, len(every))
        every, name = (*every, under), (*name, "ground")
        number, species = np.append(number, -1), np.append(species, -1)
    return SceneGeometry(every, where, index, name, number, species)


def scene_of_forest(forest: GrownForest, under: TriMesh | None = None) -> SceneGeometry:
    """A grown forest, its trees by their numbers."""
    stand, keys = forest.stand, list(forest.variants)
    pairs = zip(stand.species.tolist(), stand.variant.tolist(), strict=True)
    index = np.array([keys.index(pair) for pair in pairs], dtype=np.int64)
    meshes = [forest.variants[key].mesh for key in keys]
    scene = scene_of(meshes, forest.transforms(), index, stand.id, under)
    return replace(scene, species=np.append(stand.species, -1)[: len(scene)])
