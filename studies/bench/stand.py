"""Intensities that the benches of stands sample: four hills or a raster on a square of 300 m."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from forest_addon.api import Forest, GrownForest

from ..inside import (
    At,
    Intensity,
    Mixture,
    Process,
    Say,
    Spacing,
    Window,
    choose_radii,
    find_species,
    fit_mixture,
    greedy,
    grow_forest,
    inhomogeneous_k,
    kernel_estimate,
    load_species,
    matern_ii,
    peak_memory_mb,
    sample,
    spec,
    stream,
    window_of,
)
from ..tables import fresh, median_seconds, table
from .cold import say_cold
from .intensities import KINDS, SIDE

# K and estimated intensities: time and error by number of trees.


STATISTICS = "stand_statistics: the K function and estimated intensities, by number of trees"
COUNTS = (100, 1_000, 10_000, 100_000)
HILLS = Mixture(  # the second reaches over the edge
    np.array([1.0, 1.6]),
    np.array([[90.0, 90.0], [255.0, 180.0]]),
    np.array([[60.0, 45.0], [66.0, 105.0]]),
)


def say_statistics(say: Say) -> None:
    """Print the tables."""
    say("Inhomogeneous K of Poisson trees, λ rising e-fold in 120 m on 300 m x 300 m, translation")
    say("correction, 60 radii; K/πr² over seeds at the largest radius.\n")
    _bench_k(say)
    say(
        "\nEstimates of two hills on 300 m x 300 m, one over the edge; relative integrated squared error"
    )
    say("over seeds, ∫(estimate - λ)² / ∫λ².\n")
    _bench_estimates(say)


def _bench_k(say: Say) -> None:
    rows = []
    for count in COUNTS:
        window, points = _field(), _rising(count, 0)
        radii = choose_radii(points, window)
        radius = float(radii[-1])
        estimates = [
            inhomogeneous_k(trees, _rise(trees), window, radii)
            for trees in (_rising(count, seed) for seed in range(_seeds(count)))
        ]
        ratios = np.array([k.value[-1] for k in estimates]) / (np.pi * radius**2)
        seconds = median_seconds(
            lambda p=points, r=radii, w=window: inhomogeneous_k(p, _rise(p), w, r)
        )
        rows.append(
            [
                f"{count:,}",
                f"{radius:.1f}",
                f"{estimates[0].pairs:,}",
                f"{seconds:.4f}",
                f"{np.mean(ratios) - 1:+.4f} ± {np.std(ratios) / np.sqrt(len(ratios)):.4f}",
                f"{np.sqrt(np.mean((ratios - 1) ** 2)):.4f}",
                f"{len(ratios)}",
            ]
        )
    table(say, ["trees", "r, m", "pairs", "time, s", "bias", "rms", "seeds"], rows)


def _bench_estimates(say: Say) -> None:
    whole = Process(HILLS, np.zeros(2), np.full(2, SIDE))
    x, y = np.meshgrid(*[np.arange(SIDE / 200, SIDE, SIDE / 100)] * 2)
    at = np.column_stack([x.ravel(), y.ravel()])
    rows = []
    for count in COUNTS:
        process = whole.scaled(count / whole.expected)
        law, errors, hills, widths = process.at(at), [], [], []
        for seed in range(4 if count < 10_000 else 2):
            points = sample(process, stream(seed, "bench estimate", count))
            smooth, fit = kernel_estimate(points, _field()), fit_mixture(points, _field())
            errors.append([_ise(smooth.at, at, law), _ise(fit.at, at, law)])
            hills.append(len(fit.peak))
            widths.append(smooth.bandwidth)
        seconds = [
            median_seconds(lambda e=estimate, p=points: e(p, _field()), runs=1)
            for estimate in (kernel_estimate, fit_mixture)
        ]
        error = np.mean(errors, axis=0)
        rows.append(
            [
                f"{count:,}",
                f"{seconds[0]:.2f}",
                f"{np.mean(widths):.1f}",
                f"{error[0]:.1e}",
                f"{seconds[1]:.2f}",
                f"{min(hills)}" if min(hills) == max(hills) else f"{min(hills)} to {max(hills)}",
                f"{error[1]:.1e}",
                f"{len(errors)}",
            ]
        )
    head = ["trees", "kernel, s", "σ, m", "error", "mixture, s", "hills found", "error", "seeds"]
    table(say, head, rows)


def _field() -> Window:
    return window_of(Forest(size=(SIDE, SIDE)))


def _seeds(count: int) -> int:
    return 100 if count <= 10_000 else 4


def _rise(points: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(points[:, 0] / 120))


def _rising(count: int, seed: int) -> np.ndarray:
    """Exactly Poisson with λ ∝ exp(x/120), by inversion along x."""
    rng = stream(seed, "bench k", count)
    number, top = rng.poisson(count), np.exp(SIDE / 120) - 1
    x = 120 * np.log1p(top * rng.random(number))
    return np.column_stack([x, SIDE * rng.random(number)])


def _ise(estimate: At, points: np.ndarray, law: np.ndarray) -> float:
    return float(((estimate(points) - law) ** 2).sum() / (law**2).sum())


# Forests of many trees in Blender: time and memory to build, read back, scan, save and open them.
#
# Each size runs in a process of its own, because a process has one peak of memory. The error is how far the
# evaluated instances stand from the plan, and how many trees are missing or bear another number. The first
# chunk is that of an airborne strip, with all that it needs of the scene.


SCENES = "stand_scene: forests of 20 maples in Blender, by number of trees"
FORESTS = (("points", 1_000), ("points", 10_000), ("points", 100_000), ("objects", 1_000))
VARIANTS, ROOM = 20, 25.0  # m² a tree


def say_scenes(say: Say) -> None:
    """Print CPU seconds, peak memory and errors by number of trees."""
    rows = []
    for instancing, count in FORESTS:
        told = json.loads(fresh(__name__, instancing, str(count)))
        seconds = (f"{told[key]:.2f}" for key in ("grow", "build", "evaluate", "read", "strip"))
        files = (f"{told[key]:.2f}" for key in ("save", "open"))
        sizes = (f"{told['peak']:.2f}", f"{told['size']:.0f}")
        error = (f"{told['error']:.0e}", f"{told['wrong']:.0f}")
        shown = (f"{told['trees']:,}", instancing, f"{told['triangles']:,}")
        rows.append([*shown, *seconds, *files, *sizes, *error])
    times = [
        "grow, s",
        "build, s",
        "evaluate, s",
        "read, s",
        "first chunk, s",
        "save, s",
        "open, s",
    ]
    head = ["trees", "as", "triangles shown", *times, "peak, GB", "file, MB"]
    table(say, [*head, "largest error, m", "wrong numbers"], rows)


def measure(instancing: str, count: int) -> dict[str, float]:
    """Build, evaluate, read, scan, save and open one forest: CPU seconds, GB, MB, metres."""
    import bpy

    from ..inside import Observer, Scan, choose, empty_file, open_file, save_blend
    from ..inside import build_scene as build

    empty_file()
    told: dict[str, float] = {}
    start = time.process_time()

    def lap(name: str) -> None:
        nonlocal start
        told[name] = time.process_time() - start
        start = time.process_time()

    settings, forest = _forest(instancing, count)
    lap("grow")
    build(bpy.context.scene, settings, forest)
    lap("build")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    lap("evaluate")
    observer = Observer(depsgraph)
    geometry = observer.geometry
    lap("read")
    strip, _ = choose(spec.Airborne(name="strip"))
    next(iter(Scan(strip, observer.eyes(strip), 0).chunks()))
    lap("strip")
    faces = np.array([len(mesh.triangles) for mesh in geometry.meshes])
    told |= {"trees": len(forest.stand), "triangles": int(faces[geometry.mesh_index].sum())}
    told |= _errors(geometry, forest)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "forest.blend"
        start = time.process_time()
        save_blend(path)
        lap("save")
        told["size"] = path.stat().st_size / 1e6
        open_file(path)
        bpy.context.evaluated_depsgraph_get()
        lap("open")
    told["peak"] = (peak_memory_mb() or 0.0) / 1024
    return told


def _forest(instancing: str, count: int) -> tuple[spec.Scene, GrownForest]:
    side = float(np.sqrt(ROOM * count))
    settings = spec.Scene(
        seed=4,
        forest=spec.Forest(size=(side, side), instancing=instancing),
        plantings=(spec.Planting(species="maple", variants=VARIANTS, expected=count, exact=True),),
    )
    return settings, grow_forest(settings, [load_species(find_species("maple", Path()))])


def _errors(geometry, forest: GrownForest) -> dict[str, float]:
    """Errors of the evaluated scene against the plan."""
    trees = np.flatnonzero(geometry.tree >= 0)
    number = geometry.tree[trees]
    offset = geometry.transform[trees] - forest.transforms()[number]
    missing = len(forest.stand) - len(np.unique(number))
    other = np.count_nonzero(geometry.species[trees] != forest.stand.species[number])
    return {"error": float(np.abs(offset).max()), "wrong": float(missing + other)}


# The stand: time to sample and to space trees, with the statistical error of their numbers.
#
# What is measured of statistics, and of forests in Blender, is in the modules that ``PARTS`` names.


TITLE = "stand: exact Poisson forests, 4 hills or a 512 x 512 raster on a square of 300 m"
SIZES = (10**3, 10**5, 10**7)
RUNS = 100  # samples that a statistical error is read from
SPACED = (10**4, 10**6)
CROWDING = 0.5  # λπr² of the spacing that is timed


def run(say: Say) -> None:
    """Print sampling, spacing, then the tables of statistics and scenes."""
    rows = [_sampled(name, make(), count) for name, make in KINDS.items() for count in SIZES]
    head = ["intensity", "points", "s", "µs a point", "mean of counts, off", "variance/mean"]
    table(say, [*head, "PIT of x, p"], rows)
    say(
        "\nCounts in a quarter of the field, off the exact integral in standard errors of their mean; "
        f"{RUNS} samples of up to 1e5 points, one above. KS test of x against its exact marginal."
    )
    say("")
    spaced = [_spaced(rule, count) for rule in (matern_ii, greedy) for count in SPACED]
    head = ["rule", "points", "s", "stay", "share that stays", "off theory", "least distance/r"]
    table(say, head, spaced)
    say(
        f"\nUniform points with λπr² = {CROWDING:g}. Theory of Matérn II: (1 - exp(-λπr²))/(λπr²), "
        "at the edge a little more; greedy has no closed form."
    )
    say_cold(say, "stand")
    say(f"\n### {STATISTICS}\n")
    say_statistics(say)
    say(f"\n### {SCENES}\n")
    say_scenes(say)


def _sampled(name: str, intensity: Intensity, count: int) -> list[str]:
    low, high = np.zeros(2), np.full(2, SIDE)
    process = Process(intensity, low, high)
    process = process.scaled(count / process.expected)
    seconds = median_seconds(lambda: sample(process, stream(2, "bench", name, count)))
    runs = RUNS if count <= 10**5 else 1
    quarter = np.array([62.0, 92.0])  # from the corner to within the hills
    mean = replace(process, low=low, high=quarter).expected
    counts, shown = [], np.empty(0)
    for k in range(runs):
        points = sample(process, stream(3 + k, "bench", name, count))
        counts.append(int((points <= quarter).all(axis=1).sum()))
        if k == 0:  # points are in the order of hills or cells: choose any
            shown = stream(2, "bench", "shown").permutation(points[:, 0])[: 10**5]
    off = (np.mean(counts) - mean) / np.sqrt(mean / runs)
    spread = f"{np.var(counts, ddof=1) / mean:.2f}" if runs > 1 else "-"
    return [
        name,
        f"{count:,}",
        f"{seconds:.4f}",
        f"{1e6 * seconds / count:.3f}",
        f"{off:+.1f} σ",
        spread,
        f"{_marginal(process, shown):.2f}",
    ]


def _marginal(process: Process, x: np.ndarray) -> float:
    """p of the Kolmogorov-Smirnov test of x against ∫λ dy, exact at 1500 cuts."""
    from scipy.stats import kstest

    low, high = process.low, process.high
    cuts = np.linspace(low[0], high[0], 1501)
    strips = [
        replace(process, low=np.array([a, low[1]]), high=np.array([b, high[1]])).expected
        for a, b in pairwise(cuts)
    ]
    share = np.append(0.0, np.cumsum(strips)) / np.sum(strips)
    return float(kstest(np.interp(x, cuts, share), "uniform").pvalue)


def _spaced(rule: Callable[..., np.ndarray], count: int) -> list[str]:
    from scipy.spatial import cKDTree

    rng = stream(4, "bench", "spacing", count)
    points, mark = rng.uniform(0, SIDE, (count, 2)), rng.random(count)
    distance = float(np.sqrt(CROWDING / np.pi / (count / SIDE**2)))
    alike = Spacing(np.array([[distance]]), np.zeros(count, dtype=int), np.zeros(count))
    keep = rule(points, mark, alike)
    seconds = median_seconds(lambda: rule(points, mark, alike))
    nearest = cKDTree(points[keep]).query(points[keep], 2)[0][:, 1]
    share, theory = keep.mean(), (1 - np.exp(-CROWDING)) / CROWDING
    return [
        "Matérn II" if rule is matern_ii else "greedy",
        f"{count:,}",
        f"{seconds:.3f}",
        f"{keep.sum():,}",
        f"{share:.4f}",
        f"{share - theory:+.4f}" if rule is matern_ii else "-",
        f"{nearest.min() / distance:.6f}",
    ]


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1], int(sys.argv[2]))))
