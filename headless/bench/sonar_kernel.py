"""The echo sum alone: time, error and memory by leaves and tolerance; what the leaf models differ by."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import dataclass

import numpy as np

from forest_addon.acoustics.disc import backscatter, backscatter_amplitude
from forest_addon.acoustics.nonuniform import sum_delayed
from forest_addon.rng import stream

from . import Say, median_seconds, table

TITLE = "sonar: the sum over leaves, 1201 bins from 60 to 80 kHz, amplitudes included"
START, BAND, BINS, SPEED = 60e3, 20e3, 1201, 340.0
SPACING = BAND / (BINS - 1)
SHARE = 40  # every so many bins are summed directly, for the error
TIMED = 5_000  # leaves of the direct sum that is timed
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def run(say: Say) -> None:
    """Print both tables."""
    say(f"Errors against the direct sum at every {SHARE}th bin; random leaves of 2.5 cm.")
    say(f"Direct: time of {TIMED:,} leaves, times the number of them.\n")
    rows = []
    for model, count in (("paper", 1_000), ("paper", 10_000), ("paper", 100_000)):
        rows += _rows(model, count, TOLERANCES)
    rows += _rows("paper", 1_000_000, (1e-3, 1e-5, 1e-6))
    for model in ("piston", "exact"):
        rows += _rows(model, 100_000, (1e-3, 1e-5, 1e-6))
    head = ["leaf model", "leaves", "tolerance", "ms", "direct, s", "times as fast"]
    head += ["largest error / Σ|A|", "relative L2 error", "nodes", "MB"]
    table(say, head, rows)
    say(
        "\nLevel of the leaf models re the exact disc, dB: piston / paper. All: rms over directions.\n"
    )
    models(say)


@dataclass(frozen=True)
class _Leaves:
    """Random leaves; ``amplitude`` and ``spread`` are what ``sum_delayed`` asks for."""

    model: str
    distance: np.ndarray
    radius: np.ndarray
    incidence: np.ndarray

    @classmethod
    def random(cls, model: str, count: int) -> _Leaves:
        rng = stream(5, "bench", "leaves", count)
        radius = np.clip(rng.normal(0.025, 0.005, count), 0.005, 0.05)
        return cls(model, rng.uniform(1, 10, count), radius, np.arccos(rng.uniform(0, 1, count)))

    @property
    def delay(self) -> np.ndarray:
        return 2.0 * self.distance / SPEED

    @property
    def spread(self) -> np.ndarray:
        rim = {"paper": 0.0, "piston": np.sin(self.incidence), "exact": 1.0}[self.model]
        return 2.0 * self.radius * rim / SPEED

    def amplitude(self, frequency: np.ndarray, rows: np.ndarray) -> np.ndarray:
        k = 2.0 * math.pi * frequency[:, None] / SPEED
        amplitude = backscatter_amplitude(k * self.radius[rows], self.incidence[rows], self.model)
        amplitude /= k
        amplitude /= self.distance[rows] ** 2
        return amplitude

    def sum(self, tolerance: float, start: float, spacing: float, bins: int):
        return sum_delayed(
            self.amplitude,
            self.delay,
            start,
            spacing,
            bins,
            tolerance=tolerance,
            spread=self.spread,
        )


def _rows(model: str, count: int, tolerances: tuple[float, ...]) -> list[list[str]]:
    leaves, few = _Leaves.random(model, count), _Leaves.random(model, min(count, TIMED))
    exact = leaves.sum(0.0, START, SHARE * SPACING, (BINS - 1) // SHARE + 1)
    slow = median_seconds(lambda: few.sum(0.0, START, SPACING, BINS), runs=1)
    slow *= count / len(few.radius)
    rows = []
    for tolerance in tolerances:

        def fast(tolerance: float = tolerance):
            return leaves.sum(tolerance, START, SPACING, BINS)

        found = fast()
        seconds = median_seconds(fast, runs=3 if count < 1_000_000 else 1)
        difference = found.spectrum[::SHARE] - exact.spectrum
        relative = np.linalg.norm(difference) / np.linalg.norm(exact.spectrum)
        mean_nodes = sum(nodes * some for nodes, some in found.nodes.items()) / count
        rows.append(
            [
                model,
                f"{count:,}",
                f"{tolerance:.0e}",
                f"{1e3 * seconds:.1f}",
                f"{slow:.2f}",
                f"{slow / seconds:,.0f}",
                f"{np.abs(difference).max() / exact.size:.0e}",
                f"{relative:.0e}",
                f"{mean_nodes:.1f}",
                f"{_megabytes(fast):.1f}",
            ]
        )
    return rows


def _megabytes(work) -> float:
    """Largest memory in use on the way, beyond what the leaves take."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def models(say: Say) -> None:
    """Print by how much the leaf models differ, by ka and incidence."""
    degrees = (0, 10, 20, 30, 45, 60, 75)
    every = np.arccos((np.arange(20_000) + 0.5) / 20_000)  # isotropic
    rows = []
    for ka in (0.5, 1, 2, 5, 10, 20, 37, 60, 100, 200):
        cells = [f"{ka}"]
        for angle in (*np.radians(degrees), every):
            levels = {
                model: 10.0 * np.log10(np.mean(backscatter(ka, angle, model) ** 2))
                for model in ("exact", "piston", "paper")
            }
            shown = (f"{levels[name] - levels['exact']:+.1f}" for name in ("piston", "paper"))
            cells.append(" / ".join(shown))
        rows.append(cells)
    table(say, ["ka", *(f"{angle}°" for angle in degrees), "all"], rows)
