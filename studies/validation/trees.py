"""Presets' trees against measured ones of their stem diameter: bands of BAAD by functional type.

Around a tree's diameter at breast height (within a factor of 1.25) the measured trees of its type, deciduous
broadleaf or evergreen conifer, give a band from 5 to 95 % of height, crown width, height of the crown's base
and leaf area. A quantity is judged where at least 20 trees were measured.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.growth.library.species_file import COLUMNS as MEASURED
from forest_addon.growth.library.species_file import find_species, load_species, read_measured
from forest_addon.growth.likeness import crown_base, crown_width, trunk_radius
from forest_addon.growth.tree import Tree, grow
from headless.report.pictures import FAINT, INK, LEAF_GREEN, RED, blank_figure, save_figure

from .comparison import Comparison, Interval, Picture
from .living import compare_living
from .volumes import compare_volumes

TITLE = "Trees: their proportions"
SUMMARY = """\
Measured: 6,081 trees of 170 studies (BAAD, Falster et al. 2015; CC0), deciduous angiosperms (DA) and
evergreen gymnosperms (EG). Bands hold 90 % of the trees whose diameter at breast height is within a factor
of 1.25 of ours. Simulated are medians of three trees of each preset, as it comes at size factor 1. Measured
species: a plot of pines from tripods, a plot from a drone, a scanned beech (TreeQSM); stems by the volume
functions of Laasasenaho (1982), two felled ashes (Demol et al. 2022), and BAAD's trees that were weighed,
their mass over the basic density of their wood (IPCC 2003), each beside ours of its diameter, height and
crown.
"""
TERMS = """\
A band spans many species and sites, so that to lie inside is a weak claim and to lie outside a strong one.
All crowns of presets begin near the ground and are wide for their height, as of trees that stand alone;
most measured trees stood in closed stands. Of a hazel no stem is the trunk at breast height. Presets of
papers keep the papers' numbers; a stem's radius is, in most, ours. Taper and crowns of measured species were
set with these volumes, so that those rows say that they can be met, not that they predict; densities are of
genera, and known to a tenth. The scanned beech has a heavier crown than most that were weighed. In the plot
of pines, crowns that begin at 0.45 of the height would have most voxels at 9 to 10 m as well; BAAD's pines of
12 to 20 m begin at 0.34 to 0.77 by study, those that ours are drawn from at 0.5 to 0.7.
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
    rows = [*found[:-1], Comparison(**(vars(found[-1]) | {"pictures": (picture,)}))]
    rows += compare_living(data, arguments.seed)
    return rows + compare_volumes(data, arguments.seed)


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
        "crown_width_m": crown_width(tree),
        "crown_base_m": crown_base(tree),
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
