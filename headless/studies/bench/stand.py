"""The stand: time to sample and to space trees, with the statistical error of their numbers.

What is measured of statistics, and of forests in Blender, is in the modules that ``PARTS`` names.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.stand.intensity.functions import Intensity, Mixture
from forest_addon.stand.intensity.layers import Raster
from forest_addon.stand.poisson import sample
from forest_addon.stand.process import Process
from forest_addon.stand.spacing import greedy, matern_ii

from . import Say, median_seconds, table
from .cold import say_cold

TITLE = "stand: exact Poisson forests, 4 hills or a 512 x 512 raster on a square of 300 m"
PARTS = ("stand_statistics", "stand_scene")
SIZES = (10**3, 10**4, 10**5, 10**6, 10**7)
SIDE = 300.0
CENTRES = np.array([[61.0, 91.0], [62.0, 141.0], [71.0, 221.0], [205.0, 103.0]])  # W's
RUNS = 100  # samples that a statistical error is read from
SPACED = (10**4, 10**5, 10**6)
CROWDING = 0.5  # λπr² of the spacing that is timed


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


def run(say: Say) -> None:
    """Print sampling, spacing, then the tables of ``PARTS``."""
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
    for name in PARTS:
        part = importlib.import_module(f".{name}", __package__)
        say(f"\n### {part.TITLE}\n")
        part.run(say)


def _hills(sigma: float) -> Mixture:
    return Mixture(np.ones(4), CENTRES, np.full((4, 2), sigma * np.sqrt(2)))


def _raster() -> Raster:
    """Hills of 44.7 m, in pixels that differ from their neighbours by noise."""
    side = (np.arange(512) + 0.5) * SIDE / 512
    x, y = np.meshgrid(side, side[::-1])
    value = _hills(44.7).at(np.column_stack([x.ravel(), y.ravel()])).reshape(512, 512)
    value *= stream(1, "bench", "raster").uniform(0.5, 1.5, value.shape)
    return Raster(value, np.zeros(2), np.full(2, SIDE))


KINDS: dict[str, Callable[[], Intensity]] = {
    "wide hills, σ = 44.7 m, by component": lambda: _hills(44.7),
    "narrow hills, σ = 0.5 m, by component": lambda: _hills(0.5),
    "wide hills, thinned": lambda: Thinned(_hills(44.7)),
    "narrow hills, thinned": lambda: Thinned(_hills(0.5)),
    "raster, 512 x 512": _raster,
}


def _sampled(name: str, intensity: Intensity, count: int) -> list[str]:
    low, high = np.zeros(2), np.full(2, SIDE)
    process = Process(intensity, low, high)
    process = process.scaled(count / process.expected())
    seconds = median_seconds(lambda: sample(process, stream(2, "bench", name, count)))
    runs = RUNS if count <= 10**5 else 1
    quarter = np.array([62.0, 92.0])  # from the corner to within the hills
    mean = process.expected(low, quarter)
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
        process.expected(np.array([a, low[1]]), np.array([b, high[1]])) for a, b in pairwise(cuts)
    ]
    share = np.append(0.0, np.cumsum(strips)) / np.sum(strips)
    return float(kstest(np.interp(x, cuts, share), "uniform").pvalue)


def _spaced(rule: Callable[..., np.ndarray], count: int) -> list[str]:
    from scipy.spatial import cKDTree

    rng = stream(4, "bench", "spacing", count)
    points, mark = rng.uniform(0, SIDE, (count, 2)), rng.random(count)
    distance = float(np.sqrt(CROWDING / np.pi / (count / SIDE**2)))
    keep = rule(points, mark, distance)
    seconds = median_seconds(lambda: rule(points, mark, distance))
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
