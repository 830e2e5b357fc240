"""Stands: sampling and spacing of trees, K and estimated intensities, forests in Blender; errors beside."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import kstest

from forest_addon.api import Forest, GrownForest

from ..inside import (
    Intensity,
    Mixture,
    Process,
    RasterIntensity,
    Spacing,
    Window,
    choose_radii,
    find_species,
    fit_mixture,
    grow_forest,
    inhomogeneous_k,
    kernel_estimate,
    load_species,
    sample,
    space,
    spec,
    stream,
    window_of,
)
from .rows import BenchRow, Rows

TITLE = "stand: Poisson forests, spacing, statistics, and forests in Blender"
WORDS = """\
How many: points or trees. Sampled are 4 hills or a 512 x 512 raster on a square of 300 m: counts in a quarter
of the field are off the exact integral by so many standard errors of their mean (100 samples of up to 1e5
points, one above), their variance over their mean, p of the KS test of x against its exact marginal. Spaced
are uniform points with λπr² = 0.5; theory of Matérn II: (1 - exp(-λπr²))/(λπr²), at the edge a little more;
greedy has no closed form. K is inhomogeneous, of Poisson trees with λ rising e-fold in 120 m, translation
correction, 60 radii: K/πr² - 1 over seeds at the largest. Estimates are of two hills, one over the edge:
relative integrated squared error over seeds, ∫(estimate - λ)²/∫λ². Forests in Blender are of 20 maples on
25 m² each: how far the evaluated instances stand from the plan, and how many are missing or bear another
number; the first chunk is that of an airborne strip, with all that it needs of the scene.
"""
SIDE = 300.0
SIZES = (10**3, 10**5, 10**7)
RUNS = 100  # samples that a statistical error is read from
CENTRES = np.array([[61.0, 91.0], [62.0, 141.0], [71.0, 221.0], [205.0, 103.0]])  # Wahed et al.'s


class Thinned(Intensity):
    """The same intensity as a stranger, known by its values and bounds alone: it is thinned."""

    def __init__(self, of: Intensity) -> None:
        self.of = of

    def at(self, points: np.ndarray) -> np.ndarray:
        return self.of.at(points)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.of.bounds(low, high)

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float | None:
        return self.of.closed_integral(low, high)


def _hills(sigma: float) -> Mixture:
    return Mixture(np.ones(4), CENTRES, np.full((4, 2), sigma * np.sqrt(2)))


def _raster() -> RasterIntensity:
    """Hills of 44.7 m, in pixels that differ from their neighbours by noise."""
    side = (np.arange(512) + 0.5) * SIDE / 512
    x, y = np.meshgrid(side, side[::-1])
    value = _hills(44.7).at(np.column_stack([x.ravel(), y.ravel()])).reshape(512, 512)
    value *= stream(1, "bench", "raster").uniform(0.5, 1.5, value.shape)
    return RasterIntensity(value, np.zeros(2), np.full(2, SIDE))


KINDS: dict[str, Callable[[], Intensity]] = {
    "wide hills, σ = 44.7 m, by component": lambda: _hills(44.7),
    "narrow hills, σ = 0.5 m, by component": lambda: _hills(0.5),
    "wide hills, thinned": lambda: Thinned(_hills(44.7)),
    "narrow hills, thinned": lambda: Thinned(_hills(0.5)),
    "raster, 512 x 512": _raster,
}


def _process(intensity: Intensity, count: int) -> Process:
    """Poisson trees over the square, so many expected."""
    whole = Process(intensity, np.zeros(2), np.full(2, SIDE))
    return whole.scaled(count / whole.expected)


def _sampled(name: str, count: int) -> BenchRow:
    process = _process(KINDS[name](), count)

    def error(points: np.ndarray) -> str:
        quarter = np.array([62.0, 92.0])  # from the corner to within the hills
        mean = replace(process, high=quarter).expected
        drawn = (
            sample(process, stream(3 + k, "bench", name, count))
            for k in range(RUNS if count <= 10**5 else 1)
        )
        counts = [int((some <= quarter).all(axis=1).sum()) for some in drawn]
        off = (np.mean(counts) - mean) / np.sqrt(mean / len(counts))
        spread = f"{np.var(counts, ddof=1) / mean:.2f}" if len(counts) > 1 else "-"
        # Points are in the order of hills or cells: choose any.
        shown = stream(2, "bench", "shown").permutation(points[:, 0])[: 10**5]
        return f"{off:+.1f} σ, variance/mean {spread}, p {_marginal(process, shown):.2f}"

    return BenchRow(lambda: sample(process, stream(2, "bench", name, count)), error, count)


def _marginal(process: Process, x: np.ndarray) -> float:
    """p of the Kolmogorov-Smirnov test of x against ∫λ dy, exact at 1500 cuts."""
    low, high = process.low, process.high
    cuts = np.linspace(low[0], high[0], 1501)
    strips = [
        replace(process, low=np.array([a, low[1]]), high=np.array([b, high[1]])).expected
        for a, b in pairwise(cuts)
    ]
    share = np.append(0.0, np.cumsum(strips)) / np.sum(strips)
    return float(kstest(np.interp(x, cuts, share), "uniform").pvalue)


RULES = {"Matérn II": "matern", "greedy": "greedy"}
CROWDING = 0.5  # λπr² of the spacing that is timed


def _spaced(name: str, count: int) -> BenchRow:
    rng = stream(4, "bench", "spacing", count)
    points, mark = rng.uniform(0, SIDE, (count, 2)), rng.random(count)
    distance = float(np.sqrt(CROWDING / np.pi / (count / SIDE**2)))
    alike = Spacing(np.array([[distance]]), np.zeros(count, dtype=int), np.zeros(count))

    def error(keep: np.ndarray) -> str:
        nearest = cKDTree(points[keep]).query(points[keep], 2)[0][:, 1].min() / distance
        off = keep.mean() - (1 - np.exp(-CROWDING)) / CROWDING
        theory = f", off theory {off:+.4f}" if name != "greedy" else ""
        return f"{keep.mean():.4f} stay{theory}; least distance {nearest:.6f} r"

    return BenchRow(lambda: space(points, mark, alike, RULES[name]), error, count)


# K and estimated intensities.


COUNTS = (100, 1_000, 10_000, 100_000)
ESTIMATES = {"kernel": kernel_estimate, "mixture": fit_mixture}
HILLS = Mixture(  # the second reaches over the edge
    np.array([1.0, 1.6]),
    np.array([[90.0, 90.0], [255.0, 180.0]]),
    np.array([[60.0, 45.0], [66.0, 105.0]]),
)


def _field() -> Window:
    return window_of(Forest(size=(SIDE, SIDE)))


def _k(count: int) -> BenchRow:
    radii = choose_radii(_rising(count, 0), _field())

    def work(seed: int = 0) -> Any:
        trees = _rising(count, seed)
        return inhomogeneous_k(trees, np.exp(trees[:, 0] / 120), _field(), radii)

    def error(found: Any) -> str:
        every = [work(seed).value[-1] for seed in range(100 if count <= 10_000 else 4)]
        off = np.array(every) / (np.pi * radii[-1] ** 2) - 1
        ends = f"{off.mean():+.4f} ± {off.std() / np.sqrt(len(off)):.4f}"
        rms = np.sqrt(np.mean(off**2))
        return f"{ends}, rms {rms:.4f}, {len(off)} seeds; {found.pairs:,} pairs within {radii[-1]:.1f} m"

    return BenchRow(work, error, count)


def _rising(count: int, seed: int) -> np.ndarray:
    """Exactly Poisson with λ ∝ exp(x/120), by inversion along x."""
    rng = stream(seed, "bench k", count)
    number, top = rng.poisson(count), np.exp(SIDE / 120) - 1
    x = 120 * np.log1p(top * rng.random(number))
    return np.column_stack([x, SIDE * rng.random(number)])


def _estimated(name: str, count: int) -> BenchRow:
    process = _process(HILLS, count)
    x, y = np.meshgrid(*[np.arange(SIDE / 200, SIDE, SIDE / 100)] * 2)
    at = np.column_stack([x.ravel(), y.ravel()])
    seeds = range(4 if count < 10_000 else 2)
    drawn = [sample(process, stream(seed, "bench estimate", count)) for seed in seeds]

    def error(_: Any) -> str:
        law, fits = process.at(at), [ESTIMATES[name](points, _field()) for points in drawn]
        off = np.mean([((fit.at(at) - law) ** 2).sum() / (law**2).sum() for fit in fits])
        if name == "kernel":
            return f"{off:.1e}; σ {np.mean([fit.bandwidth for fit in fits]):.1f} m"
        return f"{off:.1e}; {', '.join(str(len(fit.peak)) for fit in fits)} hills"

    return BenchRow(lambda: ESTIMATES[name](drawn[-1], _field()), error, count)


# Forests of many trees in Blender: time and memory to build, read back, scan, save and open them.


FORESTS = (("points", 1_000), ("points", 10_000), ("points", 100_000), ("objects", 1_000))
VARIANTS, ROOM = 20, 25.0  # m² a tree


def _grown(instancing: str, count: int) -> tuple[spec.Scene, GrownForest]:
    side = float(np.sqrt(ROOM * count))
    settings = spec.Scene(
        seed=4,
        forest=spec.Forest(size=(side, side), instancing=instancing),
        plantings=(spec.Planting(species="maple", variants=VARIANTS, expected=count, exact=True),),
    )
    return settings, grow_forest(settings, [load_species(find_species("maple", Path()))])


def _in_blender(what: str, instancing: str, count: int) -> BenchRow:
    """One of growing and building a forest, reading it, the first chunk of a strip, saving and opening."""
    import bpy

    from ..inside import (
        Observer,
        Scan,
        build_scene as build,
        choose,
        empty_file,
        open_file,
        save_blend,
    )

    def made() -> GrownForest:
        settings, forest = _grown(instancing, count)
        build(bpy.context.scene, settings, forest)
        return forest

    def read_back() -> Any:
        return Observer(bpy.context.evaluated_depsgraph_get())

    empty_file()
    if what == "grown and built":
        return BenchRow(made, many=count)
    forest = made()
    if what == "read":
        return BenchRow(read_back, lambda seen: _errors(seen.geometry, forest), count)
    if what == "first chunk of a strip":
        strip, _ = choose(spec.Airborne(name="strip"))
        return BenchRow(lambda: next(iter(Scan(strip, read_back().caster, 0).chunks())), many=count)
    folder = TemporaryDirectory()
    path = Path(folder.name) / "forest.blend"

    def saved() -> None:
        save_blend(path)
        open_file(path)
        bpy.context.evaluated_depsgraph_get()

    return BenchRow(saved, lambda _, kept=folder: f"- ({path.stat().st_size / 1e6:.0f} MB)", count)


def _errors(geometry: Any, forest: GrownForest) -> str:
    """Errors of the evaluated scene against the plan."""
    trees = np.flatnonzero(geometry.tree >= 0)
    number = geometry.tree[trees]
    offset = np.abs(geometry.transform[trees] - forest.transforms()[number]).max()
    wrong = len(forest.stand) - len(np.unique(number))
    wrong += np.count_nonzero(geometry.species[trees] != forest.stand.species[number])
    shown = np.array([len(mesh.triangles) for mesh in geometry.meshes])[geometry.mesh_index].sum()
    return f"{offset:.0e} m, {wrong} wrong; {shown:,} triangles shown"


STEPS = ("grown and built", "read", "first chunk of a strip", "saved and opened")
ROWS: Rows = {
    **{
        f"{kind}, {count:,}": partial(_sampled, kind, count)
        for kind, count in product(KINDS, SIZES)
    },
    **{
        f"spacing, {rule}, {count:,}": partial(_spaced, rule, count)
        for rule, count in product(RULES, (10**3, 10**4, 10**6))
    },
    **{f"K of {count:,}": partial(_k, count) for count in COUNTS},
    **{
        f"intensity by {name} of {count:,}": partial(_estimated, name, count)
        for name, count in product(ESTIMATES, COUNTS)
    },
    **{
        f"{count:,} trees as {instancing}, {what}": partial(_in_blender, what, instancing, count)
        for (instancing, count), what in product(FORESTS, STEPS)
    },
}
