"""Labels of points: a number for each point, and a name for each number.

By class they are organs (other, wood, leaf, ground), which every file has; by object, species or material
they are numbered from the most frequent on, so that a format with few classes keeps the ones that matter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.labels import UNKNOWN, Labels
from ..sensing.lidar.cloud import Returns
from ..sensing.rays.geometry import SceneGeometry


def labels_by_object(returns: Returns, scene: SceneGeometry) -> Labels:
    """Objects by their names; what is instanced many times is one object."""
    return _named(np.append(scene.object_index, UNKNOWN)[returns.instance], scene.object_name)


def labels_by_species(returns: Returns, species: Sequence[str]) -> Labels:
    """Species of trees by their names."""
    return _named(returns.species, species)


def labels_by_material(returns: Returns, scene: SceneGeometry) -> Labels:
    """Materials by their names, as the slots of meshes hold them."""
    known: dict[str, int] = {}
    number = np.full(len(returns.instance), UNKNOWN, dtype=np.int64)
    mesh_of = np.append(scene.mesh_index, UNKNOWN)[returns.instance]
    for index, slots in enumerate(scene.slot_names):
        rows = np.flatnonzero(mesh_of == index)
        if not len(rows):
            continue
        of_slot = np.array(
            [known.setdefault(name, len(known)) if name else UNKNOWN for name in slots]
        )
        slot = scene.meshes[index].material[returns.triangle[rows]]
        number[rows] = of_slot[np.clip(slot, 0, len(slots) - 1)]
    return _named(number, tuple(known))


def _named(number: np.ndarray, names: Sequence[str]) -> Labels:
    """Labels with those numbers alone that occur, the most frequent first."""
    number = np.where((number >= 0) & (number < len(names)), number, UNKNOWN)
    there, count = np.unique(number[number >= 0], return_counts=True)
    order = there[np.argsort(-count, kind="stable")]
    place = np.full(len(names) + 1, UNKNOWN, dtype=np.int32)  # the last is that of UNKNOWN
    place[order] = np.arange(len(order))
    return Labels(place[number], tuple(names[k] for k in order.tolist()))
