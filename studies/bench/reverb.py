"""The reverb's sum over trunks: time and error against the exact sum, measures, terms, the model's error."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from forest_addon.api import Air, ImpulseResponse, Reverb

from ..inside import (
    Expansions,
    TrunkPaths,
    Trunks,
    absorption,
    clarity_db,
    direct_sum,
    energy_decay_db,
    impulse_response,
    model_error,
    reverberation_time,
    roll_off,
    stream,
    transfer,
    trunk_paths,
)
from .rows import BenchRow, Rows

TITLE = "reverb: sums over trunks"
WORDS = """\
On 1 km² where nothing else is said, 24 kHz, source and receiver 10 m apart, all paths in the record; first is
with nothing kept. Errors are against the exact sum at 2 frequencies of each octave from 20 Hz on, relative,
and of frequencies below that. Records of given seconds end 50 ms behind their last trunk: what rings on, in
the lowest octave, counts as error. Measures are those of 3,000 trunks, full band, against the exact sum. The
model forest has every term; its error is the largest that is told of an octave, joint from when on all is
noise. Last, the model's own error: single against exact multiple scattering, 60 trunks of 0.15 m around a
pair, 62.5 Hz to 1 kHz, in the plane; median of 3 stands.
"""
SIDE = 1000.0  # m
AIR = Air(sound_speed=343.0)
LOW = np.array([5.0, 10.0, 17.0])  # Hz
RADIUS, RADII, THIN = (0.25, 0.25), (0.05, 0.3), (0.03, 0.3)  # m
SAID = {RADIUS: "0.25 m", RADII: "0.05 to 0.3 m", THIN: "0.03 to 0.3 m"}


def trunks_at_random(count: int, radii: tuple[float, float], side: float = SIDE) -> Trunks:
    """Trunks on a square about the origin."""
    rng = stream(5, "bench", "trunks", count)
    place = rng.uniform(-side / 2, side / 2, (count, 2))
    return Trunks(place, rng.uniform(*radii, count), np.arange(count))


def paths_of(trunks: Trunks, distance: float = 10.0) -> TrunkPaths:
    """Paths between two ends on the x axis by way of each trunk."""
    ends = np.array([[-distance / 2, 0.0], [distance / 2, 0.0]])
    return trunk_paths(trunks, ends[0], ends[1], 2.0, 0.7)


def _record(paths: TrunkPaths, rate: float) -> int:
    """Samples that hold every path, and half a second of ringing."""
    return int((paths.length.max() / AIR.speed() + 0.5) * rate)


def _gaps(
    paths: TrunkPaths, rate: float, samples: np.ndarray, frequency: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(F,) differences from the exact spectrum at frequencies in Hz, and that: every trunk, float64."""
    loss = absorption(frequency, AIR.temperature_c, AIR.humidity, AIR.pressure_kpa)
    exact = np.array(
        [
            np.sum(
                paths.weight
                * np.exp(-(b + 2j * np.pi * f / AIR.speed()) * paths.length)
                * transfer(f, paths.angle, paths.radius, AIR.speed())
            )
            for f, b in zip(frequency, loss, strict=True)
        ]
    ) * roll_off(frequency / rate)
    turn = -2j * np.pi / rate * np.arange(len(samples))
    return np.array([np.exp(turn * f) @ samples for f in frequency]) - exact, exact


def _off(paths: TrunkPaths, rate: float, samples: np.ndarray) -> str:
    """Relative errors over frequencies weighted by the width of their octaves, in the worst, and below."""
    rng = stream(6, "bench", "octaves")
    gaps, wholes, octave = [], [], 20.0
    while 1.5 * octave < 0.45 * rate:
        frequency = rng.uniform(octave, min(2 * octave, 0.45 * rate), 2)
        gap, exact = (np.linalg.norm(v) for v in _gaps(paths, rate, samples, frequency))
        gaps.append(np.sqrt(octave) * gap)
        wholes.append(np.sqrt(octave) * exact)
        octave *= 2
    whole, worst = np.linalg.norm(gaps) / np.linalg.norm(wholes), np.divide(gaps, wholes).max()
    gap, exact = _gaps(paths, rate, samples, LOW)
    return f"{whole:.1e}; worst octave {worst:.1e}, below {np.abs(gap / exact).max():.1e}"


def summed(
    count: int,
    radii: tuple[float, float],
    tolerance: float,
    rate: float = 24e3,
    distance: float = 10.0,
    side: float = SIDE,
    seconds: float | None = None,
) -> BenchRow:
    """A sum with nothing kept but what the calls before have made."""
    paths, prepared = paths_of(trunks_at_random(count, radii, side), distance), Expansions()
    size = _record(paths, rate)
    if seconds is not None:
        size = int(seconds * rate)
        paths = paths.select(paths.earliest < (seconds - 0.05) * AIR.speed())

    def work() -> np.ndarray:
        return prepared.sum(paths, rate, size, AIR, tolerance)[0]

    return BenchRow(work, partial(_off, paths, rate))


def _paths(count: int) -> BenchRow:
    trunks = trunks_at_random(count, RADIUS)
    return BenchRow(lambda: paths_of(trunks), many=count)


def _measures(distance: float, tolerance: float) -> BenchRow:
    paths = paths_of(trunks_at_random(3_000, RADIUS), distance)
    size = _record(paths, 24e3)

    def error(samples: np.ndarray) -> str:
        exact = direct_sum(paths, 24e3, size, AIR)
        decay = energy_decay_db(exact)
        off = np.linalg.norm(samples - exact) / np.linalg.norm(exact)
        t60 = reverberation_time(samples, 24e3) - reverberation_time(exact, 24e3)
        c50 = clarity_db(samples, 24e3) - clarity_db(exact, 24e3)
        edc = np.abs(energy_decay_db(samples) - decay)[decay > -60.0].max()
        return f"{off:.1e}; T60 {abs(t60) * 1e3:.1e} ms, C50 {abs(c50):.1e} dB, EDC to -60 dB {edc:.1e} dB"

    return BenchRow(lambda: Expansions().sum(paths, 24e3, size, AIR, tolerance)[0], error)


def _every_term(count: int, radii: tuple[float, float], leafy: bool) -> BenchRow:
    ends = np.array([[-5.0, 0.0], [5.0, 0.0]])
    trunks = trunks_at_random(count, radii).clear_of(ends)
    reverb = Reverb(
        model="forest", source=(-5.0, 0.0, 1.5), receiver=(5.0, 0.0, 1.5), tolerance=1e-4
    )
    if leafy:
        reverb = replace(reverb, branch_area_density=0.1, leaf_area_density=0.2)
    field, prepared = ((-SIDE / 2, -SIDE / 2), (SIDE, SIDE)), Expansions()

    def work() -> ImpulseResponse:
        return impulse_response(trunks, reverb, AIR, field=field, expansions=prepared)

    def error(response: ImpulseResponse) -> str:
        return f"{max(response.errors.values(), default=0.0):.1e}; joint {response.joint:.2f} s"

    return BenchRow(work, error)


def _single_against_multiple(density: float) -> BenchRow:
    ends = np.array([[-5.0, 0.0], [5.0, 0.0]])
    third, side = 62.5 * 2.0 ** (np.arange(13) / 3), np.sqrt(60 / density)

    def work() -> list[Any]:
        found = []
        for seed in range(3):
            place = stream(7, "bench", "stand", seed).uniform(-side / 2, side / 2, (60, 2))
            trunks = Trunks(place, np.full(60, 0.15), np.arange(60))
            found.append(model_error(trunks, ends[0], ends[1], 60, AIR, third))
        return found

    def error(found: list[Any]) -> str:
        relative, level = (
            np.median([getattr(f, n) for f in found]) for n in ("relative", "level_db")
        )
        return f"{relative:.0%}, level {level:+.1f} dB"

    return BenchRow(work, error)


SUMS: dict[str, tuple] = {
    **{
        f"{count:,} trunks of 0.25 m, {t:.0e}": (count, RADIUS, t)
        for count, t in product((1_000, 10_000, 100_000), (1e-2, 1e-4, 1e-6))
    },
    "1,000,000 trunks of 0.25 m, 1e-04": (1_000_000, RADIUS, 1e-4),
    **{
        f"100,000 trunks, {rate / 1e3:g} kHz, {away:g} m apart, {t:.0e}": (
            100_000,
            RADIUS,
            t,
            rate,
            away,
        )
        for (rate, away), t in product(
            ((24e3, 400.0), (48e3, 10.0), (48e3, 400.0)), (1e-2, 1e-4, 1e-6)
        )
    },
    **{
        f"{count:,} trunks of 0.05 to 0.3 m, {t:.0e}": (count, RADII, t)
        for count, t in product((1_000, 10_000, 100_000), (1e-2, 1e-4))
    },
    **{
        f"{count:,} trunks of {SAID[radii]}, {side:g} m, {rate / 1e3:g} kHz, {seconds or 'all'} s, {t:.0e}": (
            *(count, radii, t, rate, 10.0, side, seconds),
        )
        for count, radii, side, rate, seconds, tolerances in (
            (1_000, RADIUS, 1000.0, 24e3, 1.0, (1e-4, 1e-6)),
            (30_000, THIN, 600.0, 24e3, None, (1e-4, 1e-6)),
            (30_000, THIN, 600.0, 96e3, None, (1e-4,)),
            (200, THIN, 100.0, 24e3, 0.5, (1e-4, 1e-6)),
        )
        for t in tolerances
    },
}
ROWS: Rows = {
    **{name: partial(summed, *case) for name, case in SUMS.items()},
    **{f"paths of {count:,} trunks": partial(_paths, count) for count in (100_000, 1_000_000)},
    **{
        f"measures at {away:g} m, {t:.0e}": partial(_measures, away, t)
        for away, t in product((10.0, 400.0), (1e-2, 1e-4, 1e-6))
    },
    **{
        f"every term, {count:,} trunks of {SAID[radii]}, {'leafy' if leafy else 'bare'}": partial(
            _every_term, count, radii, leafy
        )
        for count, radii, leafy in (
            (100_000, RADIUS, False),
            (100_000, RADIUS, True),
            (100_000, RADII, True),
            (1_000_000, RADII, True),
        )
    },
    **{
        f"single scattering alone, {d:g} trunks/m²": partial(_single_against_multiple, d)
        for d in (0.005, 0.01, 0.02, 0.05)
    },
}
