"""The stand: time to sample and to space trees, with the statistical error of their numbers.

What is measured of statistics, and of forests in Blender, is in the modules that ``PARTS`` names.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.stand.intensity.functions import Intensity
from forest_addon.stand.poisson import sample
from forest_addon.stand.process import Process
from forest_addon.stand.spacing import greedy, matern_ii

from ..tables import median_seconds, table
from . import stand_scene, stand_statistics
from .cold import say_cold
from .intensities import KINDS, SIDE

TITLE = "stand: exact Poisson forests, 4 hills or a 512 x 512 raster on a square of 300 m"
SIZES = (10**3, 10**4, 10**5, 10**6, 10**7)
RUNS = 100  # samples that a statistical error is read from
SPACED = (10**4, 10**5, 10**6)
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
    for part in (stand_statistics, stand_scene):
        say(f"\n### {part.TITLE}\n")
        part.run(say)


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
