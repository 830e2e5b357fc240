"""Labels of what rays met: organ, leaf, tree, species, and the angle of incidence.

A caster says which triangle of which instance a ray hit; ``label`` reads from the scene what that is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rows import RowTable
from ..rays.caster import Hits, hit_normals
from ..rays.geometry import SceneGeometry

ESCAPED = -1  # organ of a beam that meets nothing


@dataclass(frozen=True)
class Returns(RowTable):
    """Hits of R rays with their labels; where a ray met nothing: inf, NaN or -1.

    distance : (R,) metres. normal : (R, 3) unit normal of the triangle, as it was made, in the world.
    cos_incidence : (R,) |cos| between ray and surface normal.
    organ : (R,) int8, ``trimesh.PART_NAMES`` or ``ESCAPED``. leaf, tree, species, instance : (R,).
    triangle : (R,) int32, which one of the instance's mesh.
    """

    distance: np.ndarray
    normal: np.ndarray
    cos_incidence: np.ndarray
    organ: np.ndarray
    leaf: np.ndarray
    tree: np.ndarray
    species: np.ndarray
    instance: np.ndarray
    triangle: np.ndarray


def label(
    scene: SceneGeometry, hits: Hits, directions: np.ndarray, normal: np.ndarray | None = None
) -> Returns:
    """Return what hits are: organ, leaf, tree, species, and the angle of incidence of unit directions (R, 3).

    normal : (R, 3) normals of the triangles, where they are known already.
    """
    normal = hit_normals(scene, hits) if normal is None else normal
    of_tree = np.append(scene.tree, -1)  # a miss has instance -1
    of_species = np.append(scene.species, -1)
    return Returns(
        distance=hits.distance,
        normal=normal,
        cos_incidence=cosines(normal, directions),
        organ=organs(scene, hits),
        leaf=_leaves(scene, hits),
        tree=of_tree[hits.instance],
        species=of_species[hits.instance],
        instance=hits.instance,
        triangle=hits.triangle.astype(np.int32, copy=False),
    )


def cosines(normal: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(R,) |cos| between unit vectors (R, 3)."""
    n, d = normal, directions
    cosine: np.ndarray = np.abs(n[:, 0] * d[:, 0] + n[:, 1] * d[:, 1] + n[:, 2] * d[:, 2])
    return cosine


def organs(scene: SceneGeometry, hits: Hits) -> np.ndarray:
    """(R,) int8 parts of what was hit, ``ESCAPED`` where nothing was."""
    found = np.flatnonzero(hits.found)
    whole = len(found) == len(hits.found)
    instance, triangle = hits.instance, hits.triangle
    if not whole:
        instance, triangle = instance[found], triangle[found]
    table = scene.table
    part: np.ndarray = table.part.take(table.starts[scene.mesh_index].take(instance) + triangle)
    if whole:
        return part
    values = np.full(len(hits.found), ESCAPED, dtype=np.int8)
    values[found] = part
    return values


def _leaves(scene: SceneGeometry, hits: Hits) -> np.ndarray:
    """(R,) int32 leaf numbers of what was hit, -1 where it is no leaf."""
    values = np.full(len(hits.distance), -1, dtype=np.int32)
    found = np.flatnonzero(hits.found)
    mesh_of = scene.mesh_index[hits.instance[found]]
    for number in np.flatnonzero(np.bincount(mesh_of)):
        rows = found[mesh_of == number]
        values[rows] = scene.meshes[number].leaf[hits.triangle[rows]]
    return values
