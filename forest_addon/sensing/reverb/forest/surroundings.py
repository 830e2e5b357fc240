"""Surroundings of a source and a receiver, for a model ``forest``: density, radii, leaves, tops.

Trunks of the field, its extent and the scene's canopy come in; the ``TrunkStand`` that losses along paths
need, and the ``Density`` that energy travels through, go out. Trunks' density is counted in cells of the
field that hold CELL_HOLDS each on average; where counts are no more uneven than random ones, it is the
same everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ....spec import Reverb
from ..trunks.continuation import Field
from ..trunks.slices import Trunks
from .clutter import ALL_WAYS, LAYER, Clutter
from .clutter import BARE as NO_CLUTTER
from .losses import TrunkStand, stand_of
from .transport import Density

CELL_HOLDS = 12.0  # trunks
UNEVEN = 1.6  # variance over mean of the counts, above which cells are told apart
MOST_CELLS = 200  # to a side
USUAL_TOP = 15.0  # m, of stems without tops


@dataclass(frozen=True)
class FoliageCanopy:
    """Of a scene: leaf_area_density, m²/m³ at the height of the path; top, m, where trees end; clutter;
    floor_leaf_area, m²/m² of leaves of plants on the floor."""

    leaf_area_density: float = 0.0
    top: float = 0.0
    clutter: Clutter = NO_CLUTTER
    floor_leaf_area: float = 0.0


BARE = FoliageCanopy()


@dataclass(frozen=True)
class Surroundings:
    """stand : for losses along paths. density : for transport."""

    stand: TrunkStand
    density: Density


def surroundings(
    trunks: Trunks, reverb: Reverb, field: Field | None, canopy: FoliageCanopy
) -> Surroundings:
    """Of the trunks of a field; None: the field is as large as its trunks' hull."""
    place = trunks.position
    if field is not None:
        corner, size = np.asarray(field[0], np.float64), np.asarray(field[1], np.float64)
        inside = np.all((place >= corner) & (place <= corner + size), axis=1)
        area = float(np.prod(size))
    else:
        inside = np.ones(len(place), bool)
        corner = place.min(axis=0) if len(place) else np.zeros(2)
        size = np.ptp(place, axis=0) if len(place) else np.zeros(2)
        area = _hull(place)
    leaves = reverb.leaf_area_density
    if leaves == 0 and reverb.needle_area_density == 0:
        leaves = canopy.leaf_area_density
    found = stand_of(
        trunks.select(inside),
        area,
        leaves if reverb.foliage else 0.0,
        reverb.trunk_height or canopy.top,
        clutter_around(reverb, canopy) if reverb.branches else NO_CLUTTER,
        reverb.floor_leaf_area + canopy.floor_leaf_area if reverb.foliage else 0.0,
    )
    if found.density == 0:
        return Surroundings(found, Density.even(0.0))
    beyond = found.density if reverb.continue_to > 0 else 0.0
    return Surroundings(found, _density(place[inside], corner, size, beyond, found.density))


def clutter_around(reverb: Reverb, canopy: FoliageCanopy) -> Clutter:
    """Branches and leaves of the scene; where settings have densities, those at all heights of the canopy."""
    found, top = canopy.clutter, reverb.trunk_height or canopy.top or USUAL_TOP
    if reverb.branch_area_density > 0:
        count = max(1, math.ceil(top / LAYER))
        metres = reverb.branch_area_density / (2.0 * math.pi * reverb.branch_radius)
        found = replace(
            found,
            radii=(reverb.branch_radius,),
            length=((metres,),) * count,
            across=(ALL_WAYS,),
            leaf_area=found.leaf_area + (0.0,) * (count - len(found.leaf_area)),
        )
    if not reverb.foliage:
        return found.without_leaves()
    found = replace(found, needle_radius=reverb.needle_radius)
    if reverb.leaf_area_density > 0 or reverb.needle_area_density > 0:
        found = found.filled(top).without_leaves()
        found = found.with_leaves(reverb.leaf_area_density)
        found = found.with_needles(reverb.needle_area_density)
    if reverb.floor_leaf_area > 0:
        found = found.on_floor(reverb.floor_leaf_area)
    if reverb.leaf_radius > 0:
        found = replace(found, leaf_radius=reverb.leaf_radius)
    return found


def _density(
    place: np.ndarray, corner: np.ndarray, size: np.ndarray, beyond: float, mean: float
) -> Density:
    cell = max(math.sqrt(CELL_HOLDS / mean), float(size.max()) / MOST_CELLS)
    shape = np.maximum(1, np.round(size / cell)).astype(np.int64)
    counts = _counted(place, corner, cell, shape)
    start = float(corner[0]), float(corner[1])
    if counts.var() <= UNEVEN * counts.mean():
        if beyond > 0:
            return Density.even(mean)
        return Density(np.full((1, 1), mean), start, (float(size[0]), float(size[1])), 0.0)
    share = counts.sum() / max(len(place), 1)  # cells do not cover the field to the last metre
    cells = counts / cell**2 / max(share, 1e-9)
    cells *= mean / max(float(cells.mean()), 1e-30)
    return Density(cells, start, (cell, cell), beyond)


def _counted(place: np.ndarray, corner: np.ndarray, cell: float, shape: np.ndarray) -> np.ndarray:
    """(A, B) how many places (N, 2) are in each cell."""
    x, y = (np.floor((place[:, n] - corner[n]) / cell).astype(np.int64) for n in range(2))
    inside = (x >= 0) & (x < shape[0]) & (y >= 0) & (y < shape[1])
    found = np.bincount(x[inside] * shape[1] + y[inside], minlength=int(shape.prod()))
    return found.reshape(shape).astype(np.float64)


def _hull(place: np.ndarray) -> float:
    """m² within the outermost trunks; 0 where they span none."""
    try:
        return float(ConvexHull(place).volume) if len(place) >= 3 else 0.0
    except QhullError:
        return 0.0
