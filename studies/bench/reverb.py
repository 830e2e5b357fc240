"""The reverb's sum over trunks: time and error against the exact sum, measures, radii, model error."""

from __future__ import annotations

import ast
import importlib
import sys
import time
import tracemalloc
from dataclasses import replace

import numpy as np

from forest_addon.api import Air, Reverb

from ..inside import (
    Expansions,
    Say,
    TrunkPaths,
    Trunks,
    absorption,
    clarity_db,
    direct_sum,
    energy_decay_db,
    impulse_response,
    model_error,
    peak_memory_mb,
    reverberation_time,
    roll_off,
    stream,
    transfer,
    trunk_paths,
)
from ..tables import fresh, median_seconds, table, timed

TITLE = "reverb: sum over trunks on 1 km², radius 0.25 m, all paths in the record"
SIDE = 1000.0  # m
AIR = Air(sound_speed=343.0)
TOLERANCES = (1e-2, 1e-4, 1e-6)
LOW = (5.0, 10.0, 17.0)  # Hz, besides the frequencies above 20 Hz


def run(say: Say) -> None:
    """Print all tables; a few minutes."""
    _by_number(say)
    _by_rate_and_distance(say)
    _measures(say)
    _cold_and_warm(say)
    _radii(say)
    _all_terms(say)
    _single_against_multiple(say)


def _forest(count: int, distance: float, radius: tuple[float, float] = (0.25, 0.25)) -> TrunkPaths:
    rng = stream(5, "bench", "trunks", count)
    trunks = Trunks(
        position=rng.uniform(-SIDE / 2, SIDE / 2, (count, 2)),
        radius=rng.uniform(*radius, count),
        tree=np.arange(count),
    )
    return _paths(trunks, distance)


def _paths(trunks: Trunks, distance: float) -> TrunkPaths:
    ends = np.array([[-distance / 2, 0.0], [distance / 2, 0.0]])
    return trunk_paths(trunks, ends[0], ends[1], 2.0, 0.7)


def _record(paths: TrunkPaths, rate: float) -> int:
    """Samples that hold every path, and half a second of ringing."""
    return int((paths.length.max() / AIR.speed() + 0.5) * rate)


def _spectrum(paths: TrunkPaths, frequency: np.ndarray) -> np.ndarray:
    """(F,) exact spectrum at frequencies in Hz: every trunk, float64, nothing interpolated."""
    loss = absorption(frequency, AIR.temperature_c, AIR.humidity, AIR.pressure_kpa)
    return np.array(
        [
            np.sum(
                paths.weight
                * np.exp(-(b + 2j * np.pi * f / AIR.speed()) * paths.length)
                * transfer(f, paths.angle, paths.radius, AIR.speed())
            )
            for f, b in zip(frequency, loss, strict=True)
        ]
    )


def _heard_at(frequency: np.ndarray, samples: np.ndarray, rate: float) -> np.ndarray:
    """(F,) spectrum of samples (N,) at frequencies in Hz."""
    turn = -2j * np.pi / rate * np.arange(len(samples))
    return np.array([np.exp(turn * f) @ samples for f in frequency])


class _Exact:
    """The exact spectrum at a few frequencies: every trunk, float64, nothing interpolated."""

    def __init__(self, paths: TrunkPaths, rate: float, count: int) -> None:
        # Dense where the energy is: by the square root of the frequency, and weighted for it.
        rng = stream(6, "bench", "frequencies", count)
        root = (np.arange(count) + rng.random(count)) / count
        above = 20.0 + (0.49 * rate - 20.0) * root**2
        self.frequency, self.rate = np.concatenate([LOW, above]), rate
        self.weight = np.sqrt(root)
        self.spectrum = _spectrum(paths, self.frequency) * roll_off(self.frequency / rate)

    def errors(self, samples: np.ndarray) -> tuple[float, float]:
        """Relative L2 error above 20 Hz, and the largest one below."""
        gap = np.abs(_heard_at(self.frequency, samples, self.rate) - self.spectrum)
        low = len(LOW)
        above = np.linalg.norm(self.weight * gap[low:])
        above /= np.linalg.norm(self.weight * self.spectrum[low:])
        return float(above), float((gap[:low] / np.abs(self.spectrum[:low])).max())


def _row(paths: TrunkPaths, rate: float, exact: _Exact, tolerance: float) -> list[str]:
    prepared, size = Expansions(), _record(paths, rate)
    above, low = exact.errors(prepared.sum(paths, rate, size, AIR, tolerance).samples)
    seconds = median_seconds(lambda: prepared.sum(paths, rate, size, AIR, tolerance), runs=3)
    return [f"{tolerance:.0e}", f"{1e3 * seconds:.0f}", f"{above:.1e}", f"{low:.1e}"]


def _by_number(say: Say) -> None:
    say("24 kHz, D = 10 m; CPU time of one core, without the geometry of the paths (next column);")
    say("error against the exact sum at random frequencies above 20 Hz, and at 5, 10 and 17 Hz\n")
    rows = []
    for count in (1_000, 10_000, 100_000, 1_000_000):
        paths = _forest(count, 10.0)
        exact = _Exact(paths, 24e3, 16 if count < 1_000_000 else 4)
        for tolerance in TOLERANCES if count < 1_000_000 else (1e-4,):
            cost, peak = "", ""
            if tolerance == 1e-4:
                trunks = Trunks(np.zeros((count, 2)), paths.radius, np.arange(count))
                cost = f"{1e3 * median_seconds(lambda t=trunks: _paths(t, 10.0)):.0f}"
                peak = f"{_peak(paths, tolerance):.0f}"
            row = _row(paths, 24e3, exact, tolerance)
            rows.append([f"{count:,}", *row[:2], cost, *row[2:], peak])
    head = ["trunks", "tolerance", "ms", "paths, ms", "error", "below 20 Hz", "peak, MB"]
    table(say, head, rows)


def _peak(paths: TrunkPaths, tolerance: float) -> float:
    """Megabytes that the sum allocates at most, filters included."""
    prepared = Expansions()
    tracemalloc.start()
    prepared.sum(paths, 24e3, _record(paths, 24e3), AIR, tolerance)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def _by_rate_and_distance(say: Say) -> None:
    say("\n100,000 trunks\n")
    rows = []
    for rate in (24e3, 48e3):
        for distance in (10.0, 400.0):
            paths = _forest(100_000, distance)
            exact = _Exact(paths, rate, 6)
            for tolerance in (1e-2, 1e-4, 1e-6):
                row = _row(paths, rate, exact, tolerance)
                rows.append([f"{rate / 1e3:g} kHz", f"{distance:g} m", *row])
    table(say, ["rate", "D", "tolerance", "ms", "error", "below 20 Hz"], rows)


def _measures(say: Say) -> None:
    say("\nWhat the measures make of it: 3,000 trunks at 24 kHz against the exact sum, full band\n")
    rows = []
    for distance in (10.0, 400.0):
        paths = _forest(3_000, distance)
        size = _record(paths, 24e3)
        exact = direct_sum(paths, 24e3, size, AIR)
        decay = energy_decay_db(exact)
        heard = decay > -60.0
        for tolerance in (1e-2, 1e-4, 1e-6):
            samples = Expansions().sum(paths, 24e3, size, AIR, tolerance).samples
            error = np.linalg.norm(samples - exact) / np.linalg.norm(exact)
            t60 = reverberation_time(samples, 24e3) - reverberation_time(exact, 24e3)
            c50 = clarity_db(samples, 24e3) - clarity_db(exact, 24e3)
            edc = np.abs(energy_decay_db(samples) - decay)[heard].max()
            rows.append(
                [
                    f"{distance:g} m",
                    f"{tolerance:.0e}",
                    f"{error:.1e}",
                    f"{abs(t60) * 1e3:.1e}",
                    f"{abs(c50):.1e}",
                    f"{edc:.1e}",
                ]
            )
    head = ["D", "tolerance", "error", "ΔT60, ms", "ΔC50, dB", "ΔEDC to -60 dB, dB"]
    table(say, head, rows)


# Trunks, side in m, radii in m, Hz; the record holds all paths, or so many seconds.
CASES = (
    (1_000, 1000.0, (0.25, 0.25), 24e3, None),
    (1_000, 1000.0, (0.25, 0.25), 24e3, 1.0),
    (100_000, 1000.0, (0.25, 0.25), 24e3, None),
    (1_000, 300.0, (0.03, 0.3), 24e3, None),
    (30_000, 600.0, (0.03, 0.3), 24e3, None),
    (30_000, 600.0, (0.03, 0.3), 96e3, None),
    (200, 100.0, (0.03, 0.3), 24e3, 0.5),
)


def _cold_and_warm(say: Say) -> None:
    say(
        "\nCold, the first call of a fresh process with nothing kept (imports not counted), and warm;"
    )
    say(
        "10 m; error against the exact sum at 2 frequencies of each octave from 20 Hz. Records of given"
    )
    say(
        "seconds end 50 ms behind their last trunk: what rings on, in the lowest octave, counts as error.\n"
    )
    rows = []
    for case in CASES:
        for tolerance in (1e-4,) if case[3] > 24e3 or case[0] == 100_000 else (1e-4, 1e-6):
            count, _, radii, rate, seconds = case
            said = fresh(__name__, repr(("case", case, tolerance))).split()
            rows.append(
                [
                    f"{count:,}",
                    f"{radii[0]:g}" + (f"-{radii[1]:g} m" if radii[1] > radii[0] else " m"),
                    f"{rate / 1e3:g} kHz",
                    "full" if seconds is None else f"{seconds:g} s",
                    f"{tolerance:.0e}",
                    *said,
                ]
            )
    head = ["trunks", "radii", "rate", "record", "tolerance", "cold, ms", "warm, ms", "MB"]
    table(say, [*head, "error", "worst octave"], rows)


def _one_case(case: tuple, tolerance: float) -> None:
    """Print one row: in a process of its own."""
    count, side, radii, rate, seconds = case
    rng = stream(5, "bench", "case", count)
    place = rng.uniform(-side / 2, side / 2, (count, 2))
    paths = _paths(Trunks(place, rng.uniform(*radii, count), np.arange(count)), 10.0)
    size = _record(paths, rate)
    if seconds is not None:
        size = int(seconds * rate)
        paths = paths.select(paths.earliest < (seconds - 0.05) * AIR.speed())
    prepared = Expansions()
    whole, cold = timed(lambda: prepared.sum(paths, rate, size, AIR, tolerance))
    peak = peak_memory_mb() or 0.0
    runs = 3 if cold < 1.0 else 1
    warm = median_seconds(lambda: prepared.sum(paths, rate, size, AIR, tolerance), runs)
    whole, worst = _octave_errors(paths, rate, whole.samples)
    print(f"{1e3 * cold:.0f} {1e3 * warm:.0f} {peak:.0f} {whole:.1e} {worst:.1e}")


def _octave_errors(paths: TrunkPaths, rate: float, samples: np.ndarray) -> tuple[float, float]:
    """Relative errors over frequencies weighted by the width of their octaves, and in the worst octave."""
    rng = stream(6, "bench", "octaves")
    gaps, wholes, octave = [], [], 20.0
    while 1.5 * octave < 0.45 * rate:
        frequency = rng.uniform(octave, min(2 * octave, 0.45 * rate), 2)
        exact = _spectrum(paths, frequency)
        summed = _heard_at(frequency, samples, rate)
        gaps.append(np.sqrt(octave) * np.linalg.norm(summed - exact))
        wholes.append(np.sqrt(octave) * np.linalg.norm(exact))
        octave *= 2
    ratio = np.array(gaps) / np.array(wholes)
    return float(np.linalg.norm(gaps) / np.linalg.norm(wholes)), float(ratio.max())


def _radii(say: Say) -> None:
    say("\nEvery trunk a radius of its own, 0.05 to 0.3 m, 24 kHz, D = 10 m\n")
    rows = []
    for count in (1_000, 10_000, 100_000):
        paths = _forest(count, 10.0, (0.05, 0.3))
        exact = _Exact(paths, 24e3, 8 if count == 100_000 else 16)
        for tolerance in (1e-2, 1e-4):
            rows.append([f"{count:,}", *_row(paths, 24e3, exact, tolerance)])
    table(say, ["trunks", "tolerance", "ms", "error", "below 20 Hz"], rows)


def _all_terms(say: Say) -> None:
    say(
        "\nModel forest, every term, 1 km², 24 kHz, D = 10 m, tolerance 1e-4; each row in a fresh process,"
    )
    say(
        "cold: its first response, imports not counted; joint, s: all is noise from then on; error: the"
    )
    say("largest that is told of an octave; MB: of the process\n")
    rows = []
    for count, radii, leafy in (
        (100_000, (0.25, 0.25), False),
        (100_000, (0.25, 0.25), True),
        (100_000, (0.05, 0.3), True),
        (1_000_000, (0.05, 0.3), True),
    ):
        said = fresh(__name__, repr(("terms", count, radii, leafy))).split()
        words = f"{radii[0]:g}" + (f"-{radii[1]:g} m" if radii[1] > radii[0] else " m")
        stand = "branches and leaves" if leafy else "bare trunks"
        rows.append([f"{count:,}", words, stand, *said])
    head = ["trunks", "radii", "stand", "cold, ms", "warm, ms", "joint, s", "error", "MB"]
    table(say, head, rows)


def _all_terms_of(count: int, radii: tuple[float, float], leafy: bool) -> None:
    """Print the figures of one row: in a process of its own."""
    importlib.import_module("scipy.interpolate")  # not counted
    ends = np.array([[-5.0, 0.0], [5.0, 0.0]])
    rng = stream(5, "bench", "terms")
    place = rng.uniform(-SIDE / 2, SIDE / 2, (count, 2))
    radius = rng.uniform(*radii, count)
    trunks = Trunks(place, radius, np.full(count, -1)).clear_of(ends)
    reverb = Reverb(
        model="forest", source=(-5.0, 0.0, 1.5), receiver=(5.0, 0.0, 1.5), tolerance=1e-4
    )
    if leafy:
        reverb = replace(reverb, branch_area_density=0.1, leaf_area_density=0.2)
    field = ((-SIDE / 2, -SIDE / 2), (SIDE, SIDE))
    prepared, spent = Expansions(), []
    for _ in range(3 if count < 1_000_000 else 2):
        start = time.process_time()
        response = impulse_response(trunks, reverb, AIR, field=field, expansions=prepared)
        spent.append(1e3 * (time.process_time() - start))
    error, peak = max(response.errors.values(), default=0.0), peak_memory_mb() or 0.0
    print(f"{spent[0]:.0f} {min(spent[1:]):.0f} {response.joint:.2f} {error:.1e} {peak:.0f}")


def _single_against_multiple(say: Say) -> None:
    say("\nThe model's own error: single against exact multiple scattering, 60 trunks of 0.15 m")
    say("around a pair 10 m apart, 62.5 Hz to 1 kHz, in the plane; median of 3 stands\n")
    rows = []
    ends = np.array([[-5.0, 0.0], [5.0, 0.0]])
    third = 62.5 * 2.0 ** (np.arange(13) / 3)
    for density in (0.005, 0.01, 0.02, 0.05):
        side = np.sqrt(60 / density)
        errors = []
        for seed in range(3):
            rng = stream(7, "bench", "stand", seed)
            place = rng.uniform(-side / 2, side / 2, (60, 2))
            trunks = Trunks(place, np.full(60, 0.15), np.arange(60))
            errors.append(model_error(trunks, ends[0], ends[1], 60, AIR, third))
        error = np.median([each.relative for each in errors])
        level = np.median([each.level_db for each in errors])
        rows.append([f"{density:g}", f"{100 * error:.0f} %", f"{level:+.1f}"])
    table(say, ["trunks/m²", "relative L2 error", "level, dB"], rows)


if __name__ == "__main__":
    _which, *_given = ast.literal_eval(sys.argv[1])
    (_one_case if _which == "case" else _all_terms_of)(*_given)
