"""Wood of measured species beside destructive measurements and the volume functions of foresters.

Three yardsticks: the stem of boreal conifers and birch by the functions of Laasasenaho (1982, Commun. Inst.
For. Fenn. 108; about 2,000 felled pines, 1,900 spruces, 860 birches); two felled ashes of 0.28 m (Demol et
al. 2022, Silva Fennica 56:10550); the above-ground mass of BAAD's trees less their leaves over the basic
density of their wood (IPCC 2003, table 3A.1.9), each grown with the diameter, height and crown measured.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.measured.allometry import draw
from forest_addon.growth.measured.wanted import Kind, Wanted
from forest_addon.growth.tree import grow
from forest_addon.growth.truth import segment_table
from forest_addon.spec import Allometry, SpecError, Species

from .comparison import Comparison, Interval

DIAMETERS = (0.08, 0.14, 0.2, 0.28, 0.38)  # m
COARSE = 0.02  # metres of tolerance: only the skeleton counts
# Species: a, b, c, d, e of a·D^b·c^D·H^d·(H - 1.3)^e, litres, D in cm over bark, H in m.
STEMS = {
    "scots-pine": (0.036089, 2.01395, 0.99676, 2.07025, -1.07209),
    "norway-spruce": (0.022927, 1.91505, 0.99146, 2.82541, -1.53547),
    "silver-birch": (0.011197, 2.10253, 0.986, 3.98519, -2.65900),
}
ASHES, ASH_DBH = (732.0, 868.0), 0.28  # l, m
# Genus: the species that stands for it, kg of dry wood a m³.
DENSITIES = {
    "Fagus": ("european-beech", 580.0),
    "Quercus": ("pedunculate-oak", 580.0),
    "Betula": ("silver-birch", 510.0),
    "Acer": ("norway-maple", 520.0),
    "Pinus": ("scots-pine", 420.0),
    "Abies": ("silver-fir", 400.0),
    "Larix": ("european-larch", 460.0),
}
LEAVES = 0.03  # of the mass above ground, where they were not weighed
GROWN, MOST = 0.12, 40  # m of diameter of grown trees, trees of a genus
SAPLING = (20.0, 45.0)  # l
NEAR, NEARLY = 0.15, 0.25


def compare_volumes(data: Path, seed: int) -> list[Comparison]:
    """Rows of stems, of two ashes, and of grown trees and saplings by genus."""
    rows = [_stem_row(name, seed) for name in STEMS]
    rows.append(_ash_row(seed))
    table = data / "baad_trees.csv"
    if not table.is_file():
        return rows
    with table.open(newline="") as file:
        weighed = [row for row in csv.DictReader(file) if row["above_ground_mass_kg"]]
    saplings: list[tuple[float, float]] = []
    for genus in DENSITIES:
        found = _weighed(weighed, genus, seed)
        big = np.array([pair for pair, dbh in found if dbh >= GROWN])
        saplings += [pair for pair, _ in found if SAPLING[0] <= pair[0] <= SAPLING[1]]
        if len(big):
            rows.append(_mass_row(f"{genus}, all wood over that weighed", big))
    small = np.array(saplings)
    return [*rows, _mass_row("trees of 20 to 45 l, all wood over that weighed", small)]


def wood_of_order(name: str, dbh: float, given: dict[str, float], *key: int | str) -> np.ndarray:
    """(K,) litres of living wood by order of a tree of some measures; others are medians."""
    species, kind, law = _species(name)
    told = [given.get(m, np.nan) for m in ("height", "crown_width", "crown_base", "leaf_area")]
    row = draw(law, np.array([dbh]), np.array([told]), np.full((1, 4), 0.5))[0]
    detail = species.detail.changed(tolerance=COARSE)
    tree = grow(
        species.changed(detail=detail), kind, stream(0, "volume", name, *key), Wanted(dbh, *row)
    )
    cones = segment_table(tree.skeleton.some(~tree.skeleton.is_dead))
    return np.asarray(1000 * np.bincount(cones["order"], cones["volume_m3"]))


def stem_volume(name: str, dbh: float, height: float) -> float:
    """Litres of a stem over bark by Laasasenaho's function of diameter and height, metres."""
    a, b, c, d, e = STEMS[name]
    return float(a * (100 * dbh) ** b * c ** (100 * dbh) * height**d * (height - 1.3) ** e)


def _species(name: str) -> tuple[Species, Kind, Allometry]:
    species, kind = load_species(find_species(name, Path()))
    if not isinstance(kind, Kind) or kind.allometry is None:
        raise SpecError(name, "has no targets with an allometry; choose a species that has")
    return species, kind, kind.allometry


def _height(name: str, dbh: float) -> float:
    none, half = np.full((1, 4), np.nan), np.full((1, 4), 0.5)
    return float(draw(_species(name)[2], np.array([dbh]), none, half)[0, 0])


def _stem_row(name: str, seed: int) -> Comparison:
    ratios = []
    for dbh in DIAMETERS:
        tall = _height(name, dbh)
        stems = [wood_of_order(name, dbh, {"height": tall}, seed, k)[0] for k in range(3)]
        ratios.append(float(np.median(stems)) / stem_volume(name, dbh, tall))
    middle = float(np.median(ratios))
    return Comparison(
        *(f"{name}, stem over its volume function", "", Interval(1.0)),
        *(Interval(middle, min(ratios), max(ratios)), abs(middle - 1) <= NEAR),
        words="Diameters of " + ", ".join(f"{100 * d:g}" for d in DIAMETERS) + " cm; the interval "
        "spans them.",
    )


def _ash_row(seed: int) -> Comparison:
    ours = np.array([wood_of_order("european-ash", ASH_DBH, {}, seed, k).sum() for k in range(5)])
    felled = Interval(float(np.mean(ASHES)), *ASHES)
    mine = Interval.of(ours)
    near = bool(abs(mine.value / felled.value - 1) <= NEAR)
    return Comparison(
        "two ashes of 28 cm, all wood", "l", felled, mine, near, words="Ours of median height."
    )


def _weighed(
    rows: list[dict[str, str]], genus: str, seed: int
) -> list[tuple[tuple[float, float], float]]:
    """Litres weighed and ours, and the diameter, of trees of a genus."""
    name, density = DENSITIES[genus]
    own = [row for row in rows if row["species"].startswith(genus) and row["dbh_m"]]
    own = [row for row in own if _number(row, "height_m") > 2.5 and _number(row, "dbh_m") > 0.05]
    pick = stream(seed, "weighed", genus).permutation(len(own))[:MOST]
    found = []
    for number in np.sort(pick).tolist():
        row = own[number]
        dbh, height = _number(row, "dbh_m"), _number(row, "height_m")
        given = {"height": height}
        for key, most in (("crown_width", 2 * height), ("crown_base", 0.98 * height)):
            value = _number(row, f"{key}_m")
            if 0 < value < most:
                given[key] = value
        mass = _number(row, "above_ground_mass_kg")
        leaves = _number(row, "leaf_mass_kg")
        mass -= leaves if np.isfinite(leaves) else LEAVES * mass
        ours = wood_of_order(name, dbh, given, genus, number).sum()
        found.append(((1000 * mass / density, float(ours)), dbh))
    return found


def _number(row: dict[str, str], key: str) -> float:
    return float(row[key]) if row[key] else np.nan


def _mass_row(what: str, pairs: np.ndarray) -> Comparison:
    ratio = pairs[:, 1] / pairs[:, 0]
    mine = Interval.of(ratio, 0.5)
    return Comparison(
        *(what, "", Interval(1.0), mine, bool(abs(mine.value - 1) <= NEARLY)),
        words=f"{len(pairs)} trees of {pairs[:, 0].min():.0f} to {pairs[:, 0].max():.0f} l; the interval "
        "holds half of them.",
    )
