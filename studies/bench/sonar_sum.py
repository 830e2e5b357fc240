"""The echo sum alone: time, error and memory by leaves and tolerance; what the leaf models differ by."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import dataclass

import numpy as np

from ..inside import DelayedSum, DiscStrength, Say, StrengthParts, backscatter, stream, sum_delayed
from ..tables import median_seconds, table

SUM = "sonar: the sum over leaves, 1201 bins from 60 to 80 kHz, amplitudes included"
START, BAND, BINS, SPEED = 60e3, 20e3, 1201, 340.0
SPACING = BAND / (BINS - 1)
SHARE = 40  # every so many bins are summed directly, for the error
TIMED = 5_000  # leaves of the direct sum that is timed
TOLERANCES = (1e-3, 1e-4, 1e-6, 1e-8)


def say_sum(say: Say) -> None:
    """Print the tables."""
    say(f"Errors against the direct sum at every {SHARE}th bin; leaves of 2.5 cm of any direction.")
    say("Spread: at 1 to 10 m. Equal: all at one place, so that all errors add up.")
    say(
        f"Direct: time of {TIMED:,} leaves, times the number of them. First: the first of its tolerance.\n"
    )
    rows = []
    for count in (1_000, 100_000):
        rows += _rows("paper", count, "spread", TOLERANCES)
    rows += _rows("paper", 1_000_000, "spread", (1e-3, 1e-6))
    for model in ("piston", "exact"):
        rows += _rows(model, 100_000, "spread", (1e-3, 1e-4, 1e-6))
    for model in ("paper", "piston", "exact"):
        rows += _rows(model, 100, "spread", (1e-6,))
        rows += _rows(model, 10_000, "equal", (1e-3, 1e-6))
    head = ["leaf model", "leaves", "where", "tolerance", "first, ms", "again, ms", "direct, s"]
    head += ["times as fast", "estimate / Σ|A|", "largest error / Σ|A|", "nodes", "MB"]
    table(say, head, rows)
    say(
        "\nLevel of the leaf models re the exact disc, dB: piston / paper. All: rms over directions.\n"
    )
    models(say)


@dataclass(frozen=True)
class _Leaves:
    """Random leaves, summed as a ping sums them: in the parts of their strength."""

    distance: np.ndarray
    strength: DiscStrength

    @classmethod
    def random(cls, model: str, count: int, where: str) -> _Leaves:
        rng = stream(5, "bench", "leaves", count)
        radius = np.clip(rng.normal(0.025, 0.005, count), 0.005, 0.05)
        distance, angle = rng.uniform(1, 10, count), np.arccos(rng.uniform(0, 1, count))
        if where == "equal":
            radius, distance, angle = (np.full(count, v[0]) for v in (radius, distance, angle))
        return cls(distance, DiscStrength(radius, angle, np.ones(count), model))

    def sum(self, tolerance: float, start: float, spacing: float, bins: int) -> DelayedSum:
        """Sum over the parts, whose sizes add up to more than that of the leaves."""
        low, high = (2.0 * math.pi * f / SPEED for f in (start, start + spacing * (bins - 1)))
        loud, one = self.strength.bound(low, high) / self.distance**2, np.ones(len(self.distance))
        parts = StrengthParts(np.arange(len(one)), 0.0 * one, one, self.strength)
        if tolerance:
            parts = self.strength.parts(low, high)
        away = self.distance[parts.rows]

        def amplitude(frequency: np.ndarray, rows: np.ndarray) -> np.ndarray:
            k = 2.0 * math.pi * frequency / SPEED
            return parts.strength.select(rows).amplitude(k) / away[rows] ** 2

        return sum_delayed(
            amplitude,
            (2.0 * away + parts.offset) / SPEED,
            start,
            spacing,
            bins,
            tolerance=tolerance,
            reach=parts.strength.reach(low) / SPEED,
            loudness=loud[parts.rows] * parts.share,
        )


def _rows(model: str, count: int, where: str, tolerances: tuple[float, ...]) -> list[list[str]]:
    leaves = _Leaves.random(model, count, where)
    few = _Leaves.random(model, min(count, TIMED), where)
    exact = leaves.sum(0.0, START, SHARE * SPACING, (BINS - 1) // SHARE + 1)
    slow = median_seconds(lambda: few.sum(0.0, START, SPACING, BINS), runs=1)
    slow *= count / len(few.distance)
    rows = []
    for tolerance in tolerances:

        def fast(tolerance: float = tolerance) -> DelayedSum:
            return leaves.sum(tolerance, START, SPACING, BINS)

        first = median_seconds(fast, runs=1)
        found = fast()
        seconds = median_seconds(fast, runs=3 if count < 1_000_000 else 1)
        difference = found.spectrum[::SHARE] - exact.spectrum
        mean_nodes = sum(nodes * some for nodes, some in found.nodes.items()) / count
        rows.append(
            [
                model,
                f"{count:,}",
                where,
                f"{tolerance:.0e}",
                f"{1e3 * first:.1f}",
                f"{1e3 * seconds:.1f}",
                f"{slow:.2f}",
                f"{slow / seconds:,.0f}",
                f"{found.error:.0e}",
                f"{np.abs(difference).max() / exact.size:.0e}",
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
    for ka in (0.5, 1, 2, 5, 10, 37, 100):
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
