"""``python -m headless allometry``: laws of size from measured trees, and whether grown ones keep them."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.stats import ks_2samp

from forest_addon.base.rng import child_keys, stream
from forest_addon.formats.ownership import claim
from forest_addon.formats.toml_file import write_settings
from forest_addon.growth.draw import draw_inclination
from forest_addon.growth.library import file_stem, find_species, load_species, read_measured
from forest_addon.growth.measured.allometry import (
    KINDS,
    MEASURES,
    Z90,
    Kind,
    Wanted,
    band,
    crown_base_of,
    dbh_of,
    draw,
    fit_kind,
    leaf_tips,
    scores,
    width_of,
)
from forest_addon.growth.measured.meet import grow_measured
from forest_addon.growth.mesh.blades import leaf_areas
from forest_addon.growth.tree import blade_of, grow
from forest_addon.spec import SpecError, Species


def run(chosen: argparse.Namespace) -> None:
    """Fit laws, or check a species."""
    if chosen.action == "fit":
        table = Path(chosen.what)
        measured = read_measured(table)
        kinds = chosen.kind or KINDS
        claim(*(chosen.out / f"{file_stem(kind)}.toml" for kind in kinds))
        chosen.out.mkdir(parents=True, exist_ok=True)
        print(
            f"{'kind':22} {'trees':>17}  90 % at its middle diameter: height m, width m, base m, leaves m²"
        )
        for kind in kinds:
            fitted = fit_kind(kind, measured, chosen.source or table.name)
            write_settings(chosen.out / f"{file_stem(kind)}.toml", fitted)
            trees = "/".join(str(getattr(fitted, name).trees) for name in MEASURES)
            dbh = float(np.sqrt(np.prod(fitted.height.dbh)))
            low, high = band(fitted, np.array([dbh]))[:, 0]
            spans = ", ".join(f"{a:.1f}-{b:.1f}" for a, b in zip(low, high, strict=True))
            lent = {getattr(fitted, name).of for name in MEASURES} - {""}
            note = f" (with {', '.join(sorted(lent))})" if lent else ""
            print(f"{kind:22} {trees:>17}  {dbh:.2f} m: {spans}{note}")
        print(f"Done: {len(kinds)} files in {chosen.out}")
    else:
        check_species(chosen.what, chosen.trees)


LEAVES = 1000  # whose inclination is tested


def check_species(name: str, trees: int) -> None:
    """Grow trees of a species over the measured diameters and print how many lie in the measured bands.

    Raises
    ------
    SpecError : the species is not grown to measure.
    """

    species, kind = load_species(find_species(name, Path()))
    if not isinstance(kind, Kind) or kind.allometry is None:
        raise SpecError(name, "has no targets with an allometry; choose a species that has")
    law = kind.allometry
    rng = stream(0, "check", name)
    low, high = np.log(np.maximum(law.height.dbh, 0.02))
    dbh = np.exp(rng.uniform(low, high, trees))
    wanted = draw(law, dbh, np.full((trees, 4), np.nan), rng.random((trees, 4)))
    blade = blade_of(species, kind.blade)
    measured = np.empty((trees, 5))
    before = time.process_time()
    for tree in range(trees):
        target = Wanted(float(dbh[tree]), *wanted[tree].tolist())
        skeleton, sites, _ = grow_measured(species, target, blade, stream(0, "check", name, tree))
        tips = leaf_tips(sites)
        measured[tree] = (
            dbh_of(skeleton),
            max(float(skeleton.end[:, 2].max()), float(tips[:, 2].max())),
            width_of(tips),
            crown_base_of(skeleton, sites.segment),
            float(leaf_areas(sites, blade).sum()),
        )
    spent = time.process_time() - before
    inside = np.abs(scores(law, dbh, measured[:, 1:])) <= Z90 * (1 + 1e-6)
    print(
        f"{trees} trees of {name}, DBH {dbh.min():.3f}-{dbh.max():.3f} m, {spent / trees:.3f} CPU s each"
    )
    print(f"  DBH: off by at most {1e3 * np.abs(measured[:, 0] - dbh).max():.2g} mm")
    for column, measure in enumerate(MEASURES):
        off = np.abs(measured[:, column + 1] / wanted[:, column] - 1)
        print(
            f"  {measure:12} {100 * inside[:, column].mean():5.1f} % within the 90 % band of "
            f"{getattr(law, measure).trees} trees; off its target by at most {100 * off.max():.2g} %"
        )
    print(
        f"  height, crown width and leaf area jointly {100 * inside[:, [0, 1, 3]].all(1).mean():.1f} %"
    )
    print(f"  all four jointly {100 * inside.all(1).mean():.1f} %")
    _check_leaves(species, kind)


def _check_leaves(species: Species, kind: Kind) -> None:
    """Print whether the leaves of a tree incline as measured: Kolmogorov and Smirnov's test."""

    if species.inclination is None:
        return

    rng = stream(0, "check", species.name, "leaves")
    tree = grow(species, kind, rng)
    some = rng.choice(len(tree.leaves), min(LEAVES, len(tree.leaves)), replace=False)
    angle = np.arccos(np.clip(np.abs(tree.leaves.normal[some, 2]), 0, 1))
    keys = child_keys(np.full(400_000, 1, np.uint64), np.arange(400_000))
    p = ks_2samp(angle, draw_inclination(species.inclination, keys)).pvalue
    print(f"  inclination of {len(some)} leaves against the measured one: KS p = {p:.3f}")
