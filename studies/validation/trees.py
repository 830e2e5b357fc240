"""Wood of measured species beside destructive measurements and the volume functions of foresters.

Three yardsticks: the stem of boreal conifers and birch by the functions of Laasasenaho (1982, Commun. Inst.
For. Fenn. 108; about 2,000 felled pines, 1,900 spruces, 860 birches); two felled ashes of 0.28 m (Demol et
al. 2022, Silva Fennica 56:10550); the above-ground mass of BAAD's trees less their leaves over the basic
density of their wood (IPCC 2003, table 3A.1.9), each grown with the diameter, height and crown measured.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from forest_addon.api import Allometry, Skeleton, SpecError, Species, Tree

from ..inside import (
    COLUMNS as MEASURED,
    FAINT,
    INK,
    LEAF_GREEN,
    RED,
    Kind,
    Wanted,
    blank_figure,
    crown_base,
    crown_width,
    draw_measures as draw,
    find_axes,
    find_species,
    grow,
    load_species,
    read_measured,
    save_figure,
    segment_table,
    stream,
    table_of,
    trunk_radius,
)
from .plots import compare_living
from .run import Comparison, Interval, Picture

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
NEAR_RATIO, NEARLY = 0.15, 0.25


def compare_volumes(data: Path, seed: int) -> list[Comparison]:
    """Rows of stems, of two ashes, and of grown trees and saplings by genus."""
    rows = [_stem_row(name, seed) for name in STEMS]
    rows.append(_ash_row(seed))
    table = data / "baad_trees.csv"
    if not table.is_file():
        return rows
    weighed = [row for row in table_of(table) if row["above_ground_mass_kg"]]
    saplings: list[tuple[float, float]] = []
    for genus in DENSITIES:
        pairs = _weighed(weighed, genus, seed)
        big = np.array([pair for pair, dbh in pairs if dbh >= GROWN])
        saplings += [pair for pair, _ in pairs if SAPLING[0] <= pair[0] <= SAPLING[1]]
        if len(big):
            rows.append(_mass_row(f"{genus}, all wood over that weighed", big))
    small = np.array(saplings)
    return [*rows, _mass_row("trees of 20 to 45 l, all wood over that weighed", small)]


def wood_of_order(name: str, dbh: float, given: dict[str, float], *key: int | str) -> np.ndarray:
    """(K,) litres of living wood by order of a tree of some measures; others are medians."""
    cones = segment_table(living_wood(name, dbh, given, *key))
    return np.asarray(1000 * np.bincount(cones["order"], cones["volume_m3"]))


def living_wood(name: str, dbh: float, given: dict[str, float], *key: int | str) -> Skeleton:
    """Grow the living wood of a tree of some measures; others are medians."""
    species, kind, law = _species(name)
    told = [given.get(m, np.nan) for m in ("height", "crown_width", "crown_base", "leaf_area")]
    row = draw(law, np.array([dbh]), np.array([told]), np.full((1, 4), 0.5))[0]
    detail = species.detail.changed(tolerance=COARSE)
    bare = species.changed(detail=detail, leaf=species.leaf.changed(on=False))
    tree = grow(bare, kind, stream(0, "volume", name, *key), Wanted(dbh, *row))
    return tree.skeleton.some(~tree.skeleton.is_dead)


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
        *(Interval(middle, min(ratios), max(ratios)), abs(middle - 1) <= NEAR_RATIO),
        words="Diameters of " + ", ".join(f"{100 * d:g}" for d in DIAMETERS) + " cm; the interval "
        "spans them.",
    )


def _ash_row(seed: int) -> Comparison:
    ours = np.array([wood_of_order("european-ash", ASH_DBH, {}, seed, k).sum() for k in range(5)])
    felled = Interval(float(np.mean(ASHES)), *ASHES)
    mine = Interval.of(ours)
    near = bool(abs(mine.value / felled.value - 1) <= NEAR_RATIO)
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
    pairs = []
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
        pairs.append(((1000 * mass / density, float(ours)), dbh))
    return pairs


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


# Presets' trees against measured ones of their stem diameter: bands of BAAD by functional type.
#
# Around a tree's diameter at breast height (within a factor of 1.25) the measured trees of its type,
# deciduous broadleaf or evergreen conifer, give a band from 5 to 95 % of height, crown width, height of
# the crown's base and leaf area. A quantity is judged where at least 20 trees were measured.


TITLE = "Trees: their proportions"
SUMMARY = """\
Measured: 6,081 trees of 170 studies (BAAD, Falster et al. 2015; CC0), deciduous angiosperms (DA) and
evergreen gymnosperms (EG). Bands hold 90 % of the trees whose diameter at breast height is within a factor
of 1.25 of ours. Simulated are medians of three trees of each preset, as it comes at size factor 1. Measured
species: a plot of pines from tripods, a plot from a drone, a scanned beech (TreeQSM); stems by the volume
functions of Laasasenaho (1982), two felled ashes (Demol et al. 2022), and BAAD's trees that were weighed,
their mass over the basic density of their wood (IPCC 2003), each beside ours of its diameter, height and
crown; the branches of twelve broadleaves of 11 to 26 m modelled from scans (L1-Tree, Feng et al. 2024).
"""
TERMS = """\
A band spans many species and sites, so that to lie inside is a weak claim and to lie outside a strong one.
All crowns of presets begin near the ground and are wide for their height, as of trees that stand alone;
most measured trees stood in closed stands. Of a hazel no stem is the trunk at breast height. Presets of
papers keep the papers' numbers; a stem's radius is, in most, ours. Taper and crowns of measured species were
set with these volumes, so that those rows say that they can be met, not that they predict; densities are of
genera, and known to a tenth. The scanned beech has a heavier crown than most that were weighed. In the plot
of pines, crowns that begin at 0.45 of the height would have most voxels at 9 to 10 m as well; BAAD's pines of
12 to 20 m begin at 0.34 to 0.77 by study, those that ours are drawn from at 0.5 to 0.7. Numbers and lengths
of limbs were set with these twelve trees; models of scans make thin branches thicker than they are (Demol et
al. 2022), so that ours below the second order may be right and look thin.
"""
PRESETS = {
    "maple": "DA",
    "hazelnut": "DA",
    "honda-birch": "DA",
    "honda-broadleaf": "DA",
    "spruce": "EG",
    "honda-conifer": "EG",
}
COLUMNS = {
    "height": ("height_m", "m"),
    "crown width": ("crown_width_m", "m"),
    "crown base": ("crown_base_m", "m"),
    "leaf area": ("leaf_area_m2", "m²"),
}
READ = {column: name for name, column in MEASURED.items()}
NEAR, FEWEST, TREES = 1.25, 20, 3
BREAST = 1.3  # m


def validate(data: Path, out: Path, arguments: argparse.Namespace) -> list[Comparison]:
    """A row for each preset and quantity, and one picture."""
    measured = read_trees(data / "baad_trees.csv")
    found, ours = [], {}
    for name, kind in PRESETS.items():
        species, template = load_species(find_species(name, Path()))
        grown = [
            sizes_of(grow(species, template, stream(arguments.seed, "validate", name, k)))
            for k in range(TREES)
        ]
        mine = ours[name] = {
            key: float(np.median([tree[key] for tree in grown])) for key in grown[0]
        }
        spread = {key: [tree[key] for tree in grown] for key in grown[0]}
        for quantity, (column, unit) in COLUMNS.items():
            band = band_of(measured[kind], column, mine["dbh_m"])
            simulated = Interval(mine[column], min(spread[column]), max(spread[column]))
            found.append(
                Comparison(
                    f"{name}, {quantity}",
                    unit,
                    band[0],
                    simulated,
                    None if band[0] is None else band[0].meets(Interval(mine[column])),
                    words=f"{kind}, DBH {100 * mine['dbh_m']:.3g} cm, {band[1]} measured trees near it."
                    if quantity == "height"
                    else "",
                )
            )
    picture = Picture(
        _draw(measured, ours, out / "trees.png"),
        "Measured trees by stem diameter (grey) and one tree of each preset: green dots lie in the 90 % "
        "band of their diameter, red ones do not, of black ones too few were measured.",
    )
    rows = [*found[:-1], replace(found[-1], pictures=(picture,))]
    rows += compare_living(data, arguments.seed)
    rows += compare_volumes(data, arguments.seed)
    return rows + compare_branches(data / "branches" / "l1_tree.csv", arguments.seed)


# Branches by order: trees whose branches were modelled from scans, and ours of the same height, stem, crown.
#
# The measured stem's mean radius stands for its diameter: ours is grown twice, so that the two are alike.
# What is thinner or shorter than a tenth of the measured branches of a tree is left out of both.


BROADLEAVES = ("european-beech", "european-ash", "norway-maple", "pedunculate-oak", "silver-birch")
ORDERS = {1: "limbs on the stem", 2: "branches on limbs", 3: "branches of the third order"}
OF_BRANCHES = {"number": "", "length": "m", "mean radius": "mm"}
SLENDER, ALIKE = 200.0, 1.35  # heights over the stem's mean radius; factor within which ours agree


def compare_branches(path: Path, seed: int) -> list[Comparison]:
    """Number, length and radius of branches by order, of slender trees, too."""
    if not path.is_file():
        return []
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    theirs, ours, slender = [], [], []
    for number in np.unique(table[:, 0]):
        rows = table[table[:, 0] == number]
        branches = rows[:, [2, 3, 4]] - [1, 0, 0]
        place = np.concatenate([rows[:, 5:8], rows[:, 8:11]])
        foot, limbs = place[:, 2].min(), rows[branches[:, 0] == 1]
        size = {
            "height": np.ptp(place[:, 2]),
            "crown_width": ConvexHull(place[:, :2]).area / np.pi,
            "crown_base": limbs[:, 7].min() - foot,
        }
        stem = branches[branches[:, 0] == 0, 1].max()
        slender.append(size["height"] > SLENDER * stem)
        least = np.quantile(branches[branches[:, 0] > 0, 1:], 0.1, axis=0)
        theirs.append(_by_order(branches, least))
        grown = [_like(name, size, stem, seed, int(number)) for name in BROADLEAVES]
        ours.append(np.nanmean([_by_order(tree, least) for tree in grown], axis=0))
    known, mine, thin = np.array(theirs), np.array(ours), np.array(slender)
    branches = [
        _branch_row(f"slender trees, {ORDERS[1]}, number", "", known[thin, 0, 0], mine[thin, 0, 0])
    ]
    for row, order in enumerate(ORDERS.values()):
        for column, (what, unit) in enumerate(OF_BRANCHES.items()):
            values = known[:, row, column], mine[:, row, column]
            branches.append(_branch_row(f"{order}, {what}", unit, *values))
    return branches


def _like(name: str, size: dict[str, float], stem: float, seed: int, number: int) -> np.ndarray:
    """(A, 3) order, mean radius and length, metres, of a tree of ours whose stem is as thick."""
    dbh = 3 * stem
    for _ in range(2):
        wood = living_wood(name, dbh, size, seed, "branches", number)
        axes = find_axes(wood)
        length, of = wood.length, axes.of_segment
        long = np.bincount(of, length)
        radius = np.bincount(of, length * wood.radius.mean(axis=1)) / np.maximum(long, 1e-9)
        order = wood.order[axes.segment[axes.first[:-1]]]
        dbh *= stem / radius[np.argmax(np.where(order == 0, long, 0.0))]
    return np.column_stack([order, radius, long])


def _by_order(found: np.ndarray, least: np.ndarray) -> np.ndarray:
    """(3, 3) of each order number, median length in m and median radius in mm of branches (A, 3)."""
    kept = found[(found[:, 1:] >= least).all(axis=1)]
    rows = [kept[kept[:, 0] == order] for order in ORDERS]
    none = np.full((1, 3), np.nan)
    return np.array(
        [[len(r), *(np.median(r if len(r) else none, axis=0)[[2, 1]] * [1, 1000])] for r in rows]
    )


def _branch_row(what: str, unit: str, known: np.ndarray, mine: np.ndarray) -> Comparison:
    known, mine = known[np.isfinite(mine)], mine[np.isfinite(mine)]
    both = [Interval.mean(values, 2.0) for values in (known, mine)]
    near = bool(abs(np.log(both[1].value / both[0].value)) <= np.log(ALIKE))
    words = (
        f"{len(known)} trees, five species of ours for each; mean and its 95 % interval; "
        f"measured are {known.min():.3g} to {known.max():.3g}, ours {mine.min():.3g} to {mine.max():.3g}."
    )
    return Comparison(f"broadleaves by scan, {what}", unit, *both, near, words)


def read_trees(path: Path) -> dict[str, dict[str, np.ndarray]]:
    """Columns (N,) of the measured trees by functional type, NaN where nothing was measured."""
    table = read_measured(path)
    return {
        kind: {key: table[name][table["pft"] == kind] for key, name in READ.items()}
        for kind in dict.fromkeys(PRESETS.values())
    }


def band_of(trees: dict[str, np.ndarray], column: str, dbh: float) -> tuple[Interval | None, int]:
    """The 90 % band of what trees of about this diameter have, and how many there are."""
    if dbh <= 0:  # several stems, none of which is the trunk at breast height
        return None, 0
    near = np.abs(np.log(trees["dbh_m"] / dbh)) <= np.log(NEAR)
    values = trees[column][near]
    values = values[np.isfinite(values)]
    return (Interval.of(values) if len(values) >= FEWEST else None), len(values)


def sizes_of(tree: Tree) -> dict[str, float]:
    """The quantities of one tree, by the columns' names."""
    return {
        "dbh_m": 2 * trunk_radius(tree.skeleton, BREAST),
        "height_m": tree.height,
        "crown_width_m": crown_width(tree.skeleton, tree.leaves),
        "crown_base_m": crown_base(tree.skeleton, tree.leaves, tree.height),
        "leaf_area_m2": float(np.pi * np.square(tree.leaves.radius).sum()),
    }


def _draw(
    measured: dict[str, dict[str, np.ndarray]], ours: dict[str, dict[str, float]], path: Path
) -> Path:
    figure = blank_figure((11, 5.6))
    kinds = list(dict.fromkeys(PRESETS.values()))
    for row, kind in enumerate(kinds):
        for number, (quantity, (column, unit)) in enumerate(COLUMNS.items()):
            axes = figure.add_subplot(len(kinds), len(COLUMNS), row * len(COLUMNS) + number + 1)
            trees = measured[kind]
            axes.plot(100 * trees["dbh_m"], trees[column], ".", ms=2, color=FAINT, rasterized=True)
            for name in (n for n, k in PRESETS.items() if k == kind):
                dbh, mine = ours[name]["dbh_m"], ours[name][column]
                band = band_of(trees, column, dbh)[0]
                if not dbh:
                    continue
                inside = band is not None and band.meets(Interval(mine))
                colour = INK if band is None else LEAF_GREEN if inside else RED
                axes.plot(100 * dbh, mine, "o", color=colour)
                axes.annotate(
                    name, (100 * dbh, mine), (4, 3), textcoords="offset points", fontsize=7
                )
            axes.set(xscale="log", yscale="log", title=f"{kind}, {quantity}, {unit}")
            for scale in (axes.xaxis, axes.yaxis):
                scale.set_major_formatter("{x:g}")
                scale.set_minor_formatter("")
            if row == len(kinds) - 1:
                axes.set_xlabel("DBH, cm")
    return save_figure(figure, path)
