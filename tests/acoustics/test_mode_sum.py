"""Sums of echoes by modes, against the sum echo by echo and bin by bin in double precision."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from forest_addon.acoustics.disc import backscatter_amplitude
from forest_addon.acoustics.kaiser_bessel import Kernel
from forest_addon.acoustics.modes.disc_modes import DiscModes, modes_of, phase_for
from forest_addon.acoustics.modes.mode_sum import Bins, Waves, sum_modes
from forest_addon.acoustics.nonuniform import DelayedSum

SPEED = 343.0
BINS = Bins(50e3 + 11.0, 40.0, 499, (50e3, 70e3), SPEED)
ENDS = (2 * math.pi * 50e3 / SPEED, 2 * math.pi * 70e3 / SPEED)
SOME = np.arange(0, BINS.count, 37)


def air(frequency: np.ndarray) -> np.ndarray:
    """Nepers a second, about those of 20 °C."""
    return SPEED * 0.15 * (np.asarray(frequency) / 40e3) ** 1.2


def plain(
    model: str,
    radius: np.ndarray,
    incidence: np.ndarray,
    gain: np.ndarray,
    delay: np.ndarray,
    loss: Callable[[np.ndarray], np.ndarray],
) -> tuple[np.ndarray, float]:
    """The sum at some of the bins, and Σ max|A| there."""
    frequency = BINS.frequency[SOME]
    k = 2 * np.pi * frequency[:, None] / SPEED
    each = backscatter_amplitude(k * radius, incidence, model) / k * gain
    each *= np.exp(-np.outer(loss(frequency), delay))
    turns = np.outer(frequency, delay)
    total = (each * np.exp(-2j * np.pi * (turns - np.rint(turns)))).sum(axis=1)
    return total, float(np.abs(each).max(axis=0).sum())


def fast(
    model: str,
    radius: np.ndarray,
    incidence: np.ndarray,
    gain: np.ndarray,
    delay: np.ndarray,
    loss: Callable[[np.ndarray], np.ndarray],
    tolerance: float,
) -> DelayedSum | None:
    table = modes_of(model, ENDS, phase_for(0.45 * tolerance), float(radius.max()))
    places = table.places(radius, incidence)
    return sum_modes(table, places, Waves(gain, delay), BINS, loss, tolerance)


@pytest.mark.parametrize("model", ["exact", "paper"])
@pytest.mark.parametrize("where", ["spread", "one place", "one leaf", "lossless", "far"])
def test_the_bound_holds(model: str, where: str) -> None:
    """Equal leaves at one place are the hardest: all errors add up."""
    rng, count, loss = np.random.default_rng(7), 1500, air
    radius = rng.uniform(0.0187, 0.022, count)
    incidence = np.arccos(rng.uniform(0, 1, count))
    delay = rng.uniform(2e-4, 24.5e-3, count)
    if where == "one place":
        radius[:], incidence[:], delay[:] = 0.0213, 0.25, 0.0131
    elif where == "one leaf":
        radius, incidence, delay = radius[:1], incidence[:1], delay[:1]
    elif where == "far":
        delay = rng.uniform(20e-3, 24.5e-3, count)
    elif where == "lossless":
        loss = lambda frequency: np.zeros(np.shape(frequency))  # noqa: E731
    gain = rng.uniform(0.5, 1.0, len(delay)) / delay**2
    found = fast(model, radius, incidence, gain, delay, loss, 1e-3)
    assert found is not None
    total, size = plain(model, radius, incidence, gain, delay, loss)
    off = float(np.abs(found.spectrum[SOME] - total).max())
    assert 0 < off <= found.error_bound * found.size
    assert found.error_bound <= 1e-3
    assert 0.4 * size < found.size <= 1.05 * size
    if where == "spread":  # what is said is not far beyond what may be
        assert off < 0.5 * found.error_bound * found.size


def test_order_does_not_matter_but_for_rounding() -> None:
    rng = np.random.default_rng(8)
    radius, incidence = rng.uniform(0.0187, 0.022, 900), np.arccos(rng.uniform(0, 1, 900))
    delay = rng.uniform(2e-3, 24e-3, 900)
    gain = 1.0 / delay**2
    one = fast("paper", radius, incidence, gain, delay, air, 1e-3)
    other = fast("paper", radius[::-1], incidence[::-1], gain[::-1], delay[::-1], air, 1e-3)
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(one.spectrum, other.spectrum, atol=1e-6 * one.size)


def test_what_was_asked_for_before_changes_no_bit() -> None:
    """Rows of large discs, made first, stand before those of smaller ones."""
    rng = np.random.default_rng(9)
    radius, incidence = rng.uniform(0.012, 0.022, 9000), np.arccos(rng.uniform(0, 1, 9000))
    delay = rng.uniform(2e-3, 24e-3, 9000)
    found = []
    for asked in (np.empty(0), np.array([0.0215])):
        table = DiscModes("paper", ENDS, phase_for(0.45e-3), 0.022)
        table.places(asked, np.full(len(asked), 0.3))
        places = table.places(radius, incidence)
        found.append(sum_modes(table, places, Waves(1.0 / delay**2, delay), BINS, air, 1e-3))
    fresh, later = found
    assert fresh is not None
    assert later is not None
    assert fresh.spectrum.tobytes() == later.spectrum.tobytes()
    assert fresh.error_bound == later.error_bound


def test_losses_that_differ_too_much_are_left_to_others() -> None:
    """Polynomials of the delay cancel each other there: at 16 nepers they were off by more than was said."""
    rng = np.random.default_rng(7)
    radius, incidence = rng.uniform(0.0187, 0.022, 900), np.arccos(rng.uniform(0, 1, 900))
    delay = rng.uniform(2e-4, 24.5e-3, 900)
    gain = 1.0 / delay**2
    for steeper, known in ((35.0, True), (80.0, False), (300.0, False)):

        def loss(frequency: np.ndarray, steeper: float = steeper) -> np.ndarray:
            lowest = air(np.array(50e3))
            return lowest + steeper * (air(frequency) - lowest)

        found = fast("paper", radius, incidence, gain, delay, loss, 1e-3)
        assert (found is not None) is known
        if found is not None:
            total, _ = plain("paper", radius, incidence, gain, delay, loss)
            off = float(np.abs(found.spectrum[SOME] - total).max())
            assert off <= found.error_bound * found.size


@pytest.mark.medium
def test_delays_beyond_the_grid_and_too_tight_a_tolerance_are_left_to_others() -> None:
    radius, incidence, gain = np.full(600, 0.02), np.full(600, 0.4), np.ones(600)
    for delay in (np.full(600, 1e-6), np.full(600, 0.99999 / BINS.spacing)):
        assert fast("paper", radius, incidence, gain, delay, air, 1e-3) is None
    assert fast("exact", radius, incidence, gain, np.full(600, 0.01), air, 3e-6) is None


def test_transform_of_a_kernel_at_a_complex_frequency() -> None:
    """A decaying wave on the points of the grid is its transform; not so without the decay."""
    kernel, place, rate = Kernel(6), 103.37, 2e-2
    frequency = np.array([0.0, 0.07, 0.2])
    first, taps = kernel.spread(np.array([place]), np.float64)
    points = first[0] + np.arange(6)
    wave = np.exp(-(2j * np.pi * frequency[:, None] + rate) * (points - place))
    found = wave @ taps[:, 0]
    known = kernel.transform(frequency - 1j * rate / (2 * np.pi))
    assert np.abs(found - known).max() < 1e-4 * np.abs(known).max()
    assert np.abs(kernel.transform(frequency) - known).max() > 1e-4 * np.abs(known).max()
