"""The fast sum over trunks against the exact one: its tolerance in every band and at every time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from forest_addon.sensing.reverb.fast_scattering import Expansions
from forest_addon.sensing.reverb.scattering import TrunkPaths, roll_off, trunk_paths
from forest_addon.sensing.reverb.slices import Trunks
from forest_addon.sensing.reverb.tree_response import direct_sum
from forest_addon.spec import Air

AIR = Air(sound_speed=343.0)
EXACT = 3e-12  # of the whole: what the exact sum is good for at any time


def paths(
    count: int, distance: float, side: float, radius: float | tuple[float, float], seed: int = 0
) -> TrunkPaths:
    rng = np.random.default_rng(seed)
    radii = (
        rng.uniform(*radius, count) if isinstance(radius, tuple) else np.full(count, float(radius))
    )
    return between(rng.uniform(-side / 2, side / 2, (count, 2)), radii, distance)


def between(place: np.ndarray, radius: np.ndarray, distance: float) -> TrunkPaths:
    ends = np.array([[-distance / 2, 0.0], [distance / 2, 0.0]])
    return trunk_paths(Trunks(place, radius, np.arange(len(radius))), *ends, 2.0, 0.7)


def from_the_first(samples: np.ndarray, some: TrunkPaths, rate: float) -> np.ndarray:
    """The samples, 0 where nothing can be heard yet."""
    first = max(0, int(some.earliest.min() / 343.0 * rate) - 256)
    return np.concatenate([np.zeros(first), samples[first:]])


def errors(
    found: np.ndarray, exact: np.ndarray, rate: float, tolerance: float, arrivals: np.ndarray
) -> list[float]:
    """Relative L2 errors of the whole, of each octave from 20 Hz, and of each tenth that trunks begin in.

    arrivals : seconds. Left out is what is fainter than the exact sum is good for.
    """
    gap, whole = found - exact, float(np.linalg.norm(exact))
    result = [float(np.linalg.norm(gap)) / whole]
    end = int(0.04 * rate)  # a record that ends at once sounds at all frequencies
    fade = np.ones(len(exact))
    fade[-end:] = roll_off(0.45 + 0.05 * np.arange(end) / end)
    of_gap, of_exact = np.fft.rfft(gap * fade), np.fft.rfft(exact * fade)
    frequency = np.fft.rfftfreq(len(exact), 1 / rate)
    low, all_of_it = 20.0, float(np.linalg.norm(of_exact))
    while low < 0.45 * rate:
        band = (frequency >= low) & (frequency < min(2 * low, 0.45 * rate))
        size = float(np.linalg.norm(of_exact[band]))
        if size * tolerance > EXACT * all_of_it:
            result.append(float(np.linalg.norm(of_gap[band])) / size)
        low *= 2
    for part in np.array_split(np.arange(len(exact)), 10):
        size = float(np.linalg.norm(exact[part]))
        heard = ((arrivals * rate > part[0]) & (arrivals * rate < part[-1])).any()
        if heard and size * tolerance > EXACT * whole:
            result.append(float(np.linalg.norm(gap[part])) / size)
    return result


def compare(
    some: TrunkPaths, rate: float, tolerance: float, seconds: float | None = None, **air: Any
) -> tuple[float, dict[float, float]]:
    """Worst error of the fast sum over its tolerance, and what it found itself."""
    last = float(some.length.max()) / 343.0
    count = int((last + 0.05 if seconds is None else seconds) * rate)
    state = Air(sound_speed=343.0, **air)
    exact = direct_sum(some, rate, count + int(2 * rate), state)[:count]
    found = Expansions().sum(some, rate, count, state, tolerance)
    pair = (from_the_first(samples, some, rate) for samples in (found.samples, exact))
    return max(errors(*pair, rate, tolerance, some.length / 343.0)) / tolerance, found.errors


@st.composite
def stands(draw: st.DrawFn) -> tuple[TrunkPaths, float]:
    """Trunks of every kind of radius between 1 mm and 2 m, and a sampling rate."""
    rate = draw(st.sampled_from([6e3, 8e3, 16e3, 24e3, 48e3, 96e3]))
    count = draw(st.integers(1, int(min(300, 2e6 / rate))))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kind = draw(st.sampled_from(["equal", "two", "uniform", "lognormal", "log-uniform"]))
    low, high = sorted(10.0 ** np.array(draw(st.tuples(*[st.floats(-3.0, math.log10(2.0))] * 2))))
    radius = {
        "equal": lambda: np.full(count, high),
        "two": lambda: rng.choice([low, high], count),
        "uniform": lambda: rng.uniform(low, high, count),
        "lognormal": lambda: np.clip(rng.lognormal(math.log(low), 0.8, count), 1e-3, 2.0),
        "log-uniform": lambda: np.exp(rng.uniform(math.log(low), math.log(high + 1e-9), count)),
    }[kind]()
    distance = draw(st.floats(0.5, 100.0))
    side = draw(st.floats(5.0, 100.0))
    return between(rng.uniform(-side / 2, side / 2, (count, 2)), radius, distance), rate


@settings(max_examples=12, deadline=None)
@given(stand=stands(), tolerance=st.sampled_from([1e-3, 1e-4, 1e-5, 1e-6]))
def test_tolerance_is_kept_in_every_band_and_at_every_time(
    stand: tuple[TrunkPaths, float], tolerance: float
) -> None:
    worst, reported = compare(*stand, tolerance)
    assert worst < 1.0 or max(reported.values()) > tolerance
