"""Trees of a plot as its own clouds tell them: places, heights, crowns and leaf area.

Summits of the canopy are trees; what is nearer to one than to another, and at least half as high, is its
crown, and the width that of a circle of the same area. The crown's base is where layers of half a metre that
hold a hundredth of its returns begin without a break to the top (Holmgren & Persson 2004, Remote Sens.
Environ. 90, 415). Leaf area is that of Beer's law for the light that reaches the ground below the crown,
L = -2 cos(θ) ln(P), less the wood, over the clumping of the species' shoots.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial import cKDTree

from forest_addon.growth.library.species_file import find_species, load_species, read_allometry
from forest_addon.growth.measured.allometry import band, middle
from forest_addon.growth.measured.wanted import MOST_TIMES
from forest_addon.growth.mesh.blades import shoot_of

from ..living import tops_of
from ..own_cloud import CloudReturns

ALLOMETRY = "pinus-sylvestris"  # whose heights and diameters go together
CELL = 0.5  # m
LOW = 0.5  # of a tree's height, above which the canopy near it is its crown
LAYER, RARE, SMOOTH = 0.5, 0.01, 9  # m; share of a crown's returns; layers of the median filter
WOOD = 0.15  # of all that a crown holds back: assumed
DARKEST = 0.01  # share of light that is told from none
TRIES = 2000  # places in a crown that tell how much of it lies on the plot
BARE = 1.0  # m over the ground, below which a return is the ground's
MOST_BASE = 0.9  # of the height


def trees_of(
    dense: CloudReturns,
    upright: CloudReturns,
    zenith: float,
    species: str,
    low: np.ndarray,
    floor: np.ndarray,
) -> np.ndarray:
    """(N, 7) x, y, DBH, height, width and base of the crown, m, and leaf area, m².

    dense : of the returns that heights and crowns are read from; floor : (P,) m of the ground below these.
    upright : of pulses that came down at ``zenith`` degrees in the mean, which tell leaf area. low : (2,)
    corner of the plot. Diameters are those that Scots pines of such heights have.
    """
    place = dense.place[:, :2] - low[:2]
    height = dense.place[:, 2] - floor
    top = tops_of(np.column_stack([place, height]), height)
    crown = _crowns(place, height, top)
    of_return = _at(crown, place)
    many = len(top)
    area = CELL**2 * np.bincount(crown[crown >= 0], minlength=many)
    area = area / _on_plot(top, area, np.ptp(place, axis=0))
    base = [_base(height[of_return == k]) for k in range(many)]
    beam = _at(crown, upright.place[:, :2] - low[:2])
    light = 1 / np.maximum(upright.count, 1)
    seen = beam >= 0
    ground = seen & (upright.heights() < BARE)
    passed = np.bincount(beam[ground], light[ground], many)
    passed = passed / np.maximum(np.bincount(beam[seen], light[seen], many), 1e-9)
    index = -2 * np.cos(np.deg2rad(zenith)) * np.log(np.clip(passed, DARKEST, 1))
    leaves = (1 - WOOD) * index * area / clumping_of(species)
    law = read_allometry(ALLOMETRY, Path())
    dbh = np.linspace(0.05, 1.0, 400)
    return np.column_stack(
        [
            top[:, :2],
            np.interp(top[:, 2], np.exp(middle(law.height, dbh)), dbh),
            top[:, 2],
            2 * np.sqrt(area / np.pi),
            np.minimum(base, MOST_BASE * top[:, 2]),
            np.maximum(leaves, 0.1),
        ]
    )


def most_leaves(dbh: np.ndarray) -> np.ndarray:
    """(N,) m² of leaves that trees of these diameters (N,) may be asked for."""
    kind = read_allometry(ALLOMETRY, Path())
    return np.asarray(0.999 * MOST_TIMES * band(kind, dbh)[1, :, 3])


def clumping_of(species: str) -> float:
    """Mean shadow of a species' shoots over that of their needles apart; 1 of leaves."""
    found, _ = load_species(find_species(species, Path()))
    if found.needles is None:
        return 1.0
    return shoot_of(found.needles, found.leaf.length.mean).clumping


def _crowns(place: np.ndarray, height: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Tree of each cell of half a metre, -1 where there is none."""
    cell = np.floor(place / CELL).astype(int)
    canopy = np.zeros(cell.max(axis=0) + 1)
    np.maximum.at(canopy, tuple(cell.T), height)
    middle_of = (np.argwhere(canopy >= 0) + 0.5) * CELL
    near = cKDTree(top[:, :2]).query(middle_of)[1]
    inside = canopy.ravel() > np.maximum(LOW * top[near, 2], 2.0)
    return np.where(inside, near, -1).reshape(canopy.shape)


def _at(crown: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(P,) tree whose crown is over places (P, 2), -1 where none is."""
    cell = np.floor(place / CELL).astype(int)
    inside = ((cell >= 0) & (cell < crown.shape)).all(axis=1)
    found = np.full(len(place), -1)
    found[inside] = crown[tuple(cell[inside].T)]
    return found


def _on_plot(top: np.ndarray, area: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(N,) share of each crown, a disc about its summit, that lies on the plot of this size (2,)."""
    k = np.arange(TRIES) + 0.5
    out, turn = np.sqrt(k / TRIES), np.pi * (3 - np.sqrt(5)) * k
    disc = np.column_stack([out * np.cos(turn), out * np.sin(turn)])
    share = np.ones(len(top))
    for _ in range(6):
        radius = np.sqrt(area / share / np.pi)
        spot = top[:, None, :2] + radius[:, None, None] * disc
        share = np.maximum(((spot >= 0) & (spot <= size)).all(axis=2).mean(axis=1), 0.2)
    return share


def _base(height: np.ndarray) -> float:
    """Height of the lowest return of a crown above the highest gap between its layers, m."""
    some = height[height > BARE]
    if not len(some):
        return 0.0
    count = np.bincount((some / LAYER).astype(int))
    full = median_filter((count >= RARE * count.sum()).astype(int), SMOOTH)
    gaps = np.flatnonzero(full[: full.nonzero()[0].max(initial=0)] == 0)
    lowest = (gaps.max(initial=-1) + 1) * LAYER
    return float(some[some >= lowest].min())
