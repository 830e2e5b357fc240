"""K and estimated intensities: time and error by number of trees."""

from __future__ import annotations

import numpy as np

from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.spec import Forest
from forest_addon.stand.intensity.functions import Mixture
from forest_addon.stand.poisson import sample
from forest_addon.stand.process import Process
from forest_addon.stand.statistics.goodness import window_of
from forest_addon.stand.statistics.k_function import At, choose_radii, inhomogeneous_k
from forest_addon.stand.statistics.kernel import kernel_estimate
from forest_addon.stand.statistics.mixture import fit_mixture
from forest_addon.stand.statistics.window import Window

from ..tables import median_seconds, table

TITLE = "stand_statistics: the K function and estimated intensities, by number of trees"
COUNTS = (100, 1_000, 10_000, 100_000)
SIDE = 300.0  # metres
HILLS = Mixture(  # the second reaches over the edge
    np.array([1.0, 1.6]),
    np.array([[90.0, 90.0], [255.0, 180.0]]),
    np.array([[60.0, 45.0], [66.0, 105.0]]),
)


def run(say: Say) -> None:
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
        found = [
            inhomogeneous_k(trees, _rise(trees), window, radii)
            for trees in (_rising(count, seed) for seed in range(_seeds(count)))
        ]
        ratios = np.array([k.value[-1] for k in found]) / (np.pi * radius**2)
        seconds = median_seconds(
            lambda p=points, r=radii, w=window: inhomogeneous_k(p, _rise(p), w, r)
        )
        rows.append(
            [
                f"{count:,}",
                f"{radius:.1f}",
                f"{found[0].pairs:,}",
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
        process = whole.scaled(count / whole.expected())
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
