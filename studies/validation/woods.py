"""A wood for scanners, without a Blender scene: instances of a few grown trees on a level ground."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import GROUND, WOOD, TriMesh
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.mesh.meshing import tube
from forest_addon.growth.tree import Tree, grow
from forest_addon.sensing.rays.geometry import SceneGeometry

WIDE = 500.0  # metres that the ground goes each way


def grown(name: str, count: int, seed: int) -> list[Tree]:
    """Trees of a preset."""
    species, template = load_species(find_species(name, Path()))
    return [grow(species, template, stream(seed, "validate", name, k)) for k in range(count)]


def wood(
    meshes: list[TriMesh],
    foot: np.ndarray,
    wide: np.ndarray,
    tall: np.ndarray,
    seed: int,
    lift: np.ndarray | None = None,
    bole: float | np.ndarray = 0.2,
) -> SceneGeometry:
    """Trees at ``foot`` (N, 2), of the meshes in turn, each turned, scaled across and upwards (N,).

    lift : (N,) metres that each is raised, on a bole of this radius; None: they stand on the ground.
    """
    count = len(foot)
    turn = stream(seed, "validate", "turn").uniform(0, 2 * np.pi, count)
    transform = np.tile(np.eye(3, 4), (count, 1, 1))
    transform[:, 0, 0] = transform[:, 1, 1] = wide * np.cos(turn)
    transform[:, 1, 0], transform[:, 0, 1] = wide * np.sin(turn), -wide * np.sin(turn)
    transform[:, 2, 2] = tall
    transform[:, :2, 3] = foot
    number, of_mesh = np.arange(count), np.arange(count) % len(meshes)
    if lift is not None:
        boles = np.tile(np.eye(3, 4), (count, 1, 1))
        boles[:, 0, 0] = boles[:, 1, 1] = bole
        boles[:, 2, 2], boles[:, :2, 3] = lift, foot
        transform[:, 2, 3] = lift
        transform = np.concatenate([transform, boles])
        number, of_mesh = np.tile(number, 2), np.append(of_mesh, np.full(count, len(meshes)))
        meshes = [*meshes, pole(1.0, 1.0)]
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * WIDE
    ground = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), GROUND)
    return SceneGeometry(
        meshes=(*meshes, ground),
        transform=np.concatenate([transform, np.eye(3, 4)[None]]),
        mesh_index=np.append(of_mesh, len(meshes)),
        object_name=("tree",) * len(number) + ("ground",),
        tree=np.append(number, -1),
        species=np.append(np.zeros(len(number), np.int64), -1),
    )


def pole(radius: float, height: float) -> TriMesh:
    """An upright cylinder on the ground, 48 sides."""
    knots = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, height]])
    vertices, triangles = tube(knots, np.full(2, radius), 48)
    return TriMesh.of_part(vertices, triangles, WOOD)
