"""What rays met, in words: organ, leaf, tree, species, and the angle of incidence.

A caster says which triangle of which instance a ray hit; ``label`` reads from the scene what that is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .geometry import SceneGeometry
from .rays import Hits, hit_normals

ESCAPED = -1  # organ of a beam that meets nothing


@dataclass(frozen=True)
class Returns:
    """What R rays met; where a ray met nothing: inf, NaN or -1.

    distance : (R,) metres. normal : (R, 3) unit normal of the triangle, as it was made, in the world.
    cos_incidence : (R,) |cos| between ray and surface normal.
    organ : (R,) int8, ``trimesh.PART_NAMES`` or ``ESCAPED``. leaf, tree, species, instance : (R,).
    """

    distance: np.ndarray
    normal: np.ndarray
    cos_incidence: np.ndarray
    organ: np.ndarray
    leaf: np.ndarray
    tree: np.ndarray
    species: np.ndarray
    instance: np.ndarray


def label(scene: SceneGeometry, hits: Hits, directions: np.ndarray) -> Returns:
    """What hits are: organ, leaf, tree, species, and the angle of incidence of unit directions (R, 3)."""
    normal = hit_normals(scene, hits)
    organ, leaf = parts(scene, hits)
    of_tree = np.append(scene.tree, -1)  # a miss has instance -1
    of_species = np.append(scene.species, -1)
    return Returns(
        distance=hits.distance,
        normal=normal,
        cos_incidence=np.abs(np.einsum("ri,ri->r", normal, directions)),
        organ=organ,
        leaf=leaf,
        tree=of_tree[hits.instance],
        species=of_species[hits.instance],
        instance=hits.instance,
    )


def parts(scene: SceneGeometry, hits: Hits) -> tuple[np.ndarray, np.ndarray]:
    """(R,) int8 organ and (R,) int32 leaf number of hits."""
    organ = np.full(len(hits.distance), ESCAPED, dtype=np.int8)
    leaf = np.full(len(hits.distance), -1, dtype=np.int32)
    found = np.flatnonzero(hits.found)
    mesh_of = scene.mesh_index[hits.instance[found]]
    for number in np.unique(mesh_of):
        rows = found[mesh_of == number]
        mesh = scene.meshes[number]
        organ[rows] = mesh.part[hits.triangle[rows]]
        leaf[rows] = mesh.leaf[hits.triangle[rows]]
    return organ, leaf


def take(returns: Returns, rows: np.ndarray) -> Returns:
    """The returns of these rows."""
    return Returns(**{n: getattr(returns, n)[rows] for n in Returns.__dataclass_fields__})
