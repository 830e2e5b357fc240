"""Sway of grown trees: skeletons of measured size, their modes and what a gauge at their foot would tell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.measured.crown import scaled_to
from forest_addon.growth.measured.curves import curved
from forest_addon.growth.measured.meet import grow_measured
from forest_addon.growth.measured.wanted import Kind, Wanted, drawn
from forest_addon.growth.mesh.blades import leaf_areas
from forest_addon.growth.sway.beams import wood_of_species
from forest_addon.growth.sway.shape import SwayShape, shape_with
from forest_addon.growth.tree import blade_of, has_curves
from forest_addon.stand.wind.response import SwayResponse

CONIFERS = {"Picea": "norway-spruce", "Abies": "silver-fir", "Pseudotsuga": "douglas-fir"}
BROADLEAVES = {
    "Acer": "norway-maple",
    "Quercus": "pedunculate-oak",
    "Fraxinus": "european-ash",
    "Betula": "silver-birch",
}


PINES = ("Pinus", "Agathis", "Cupressus")


@dataclass(frozen=True)
class MeasuredSway:
    """A measured tree: its genus, diameter and height in m, sway frequency in Hz."""

    genus: str
    dbh: float
    height: float
    frequency: float

    @property
    def preset(self) -> str:
        """The species of ours that is nearest: of its genus, else a pine or a beech."""
        return {**CONIFERS, **BROADLEAVES}.get(self.genus, "")

    @property
    def stand_in(self) -> str:
        """The species of ours that it is grown as."""
        return self.preset or ("scots-pine" if self.genus in PINES else "european-beech")


def shape_as(tree: MeasuredSway, preset: str, rng: np.random.Generator, vary: bool) -> SwayShape:
    """Grow a skeleton of a measured diameter and height, and find its modes.

    vary : crown and leaf area are drawn as the species' allometry has them, else its medians.

    Raises
    ------
    SpecError : no tree of the species has such a diameter and height.
    """
    species, kind = load_species(find_species(preset, Path()))
    assert isinstance(kind, Kind)
    chance = rng.random((1, 4)) if vary else np.full((1, 4), 0.5)
    given = np.array([[tree.height, np.nan, np.nan, np.nan]])
    row = drawn(kind.allometry, np.array([tree.dbh]), given, chance, preset, np.zeros(4))[0]
    blade, wanted = blade_of(species, kind.blade), Wanted(*row.tolist())
    met = grow_measured(species, wanted, blade, rng)
    skeleton, sites = met.skeleton, met.sites
    if has_curves(species):
        skeleton, sites = curved(skeleton, sites, species.crown.collar if species.crown else 0.0)
        skeleton = scaled_to(skeleton, wanted.dbh)
    area = np.bincount(
        np.maximum(sites.segment, 0), leaf_areas(sites, blade), minlength=len(skeleton)
    )
    return shape_with(skeleton, area, wood_of_species(species))


def strain(shape: SwayShape, response: SwayResponse, time: np.ndarray) -> np.ndarray:
    """(T, 2) bending of the stem's foot over time, as two gauges at right angles have it, rad/m."""
    low, high = shape.ends
    length = float(np.linalg.norm(shape.members.end[0] - shape.members.start[0]))
    bend = (high - low)[0, :, 3:5] / length
    return response.exact(time)[0] @ bend


def tip_motion(shape: SwayShape, response: SwayResponse, time: np.ndarray) -> np.ndarray:
    """(T, 2) level displacement in m of the tree's highest node."""
    top = int(np.argmax(shape.members.nodes[:, 2]))
    return response.exact(time)[0] @ shape.modes.shape[top, :, :2]


def trunk_motion(
    shape: SwayShape, response: SwayResponse, share: float, time: np.ndarray
) -> np.ndarray:
    """(T, 2) level displacement in m of the stem at a share of the tree's height."""
    nodes = shape.members.nodes
    height = share * float(nodes[:, 2].max())
    chain = _stem(shape)
    order = np.argsort(nodes[chain, 2])
    level = nodes[chain, 2][order]
    modes = shape.modes.shape[chain][order][:, :, :2]
    at = np.stack(
        [
            [np.interp(height, level, modes[:, m, axis]) for axis in range(2)]
            for m in range(modes.shape[1])
        ]
    )
    return response.exact(time)[0] @ at


def _stem(shape: SwayShape) -> np.ndarray:
    """Nodes of the stem, from the ground on: the thickest member that goes on from each."""
    members, chain = shape.members, [0]
    while True:
        onward = np.flatnonzero(members.node[:, 0] == chain[-1])
        if not len(onward):
            return np.array(chain)
        chain.append(int(onward[np.argmax(members.radius[onward, 0])]) + 1)
