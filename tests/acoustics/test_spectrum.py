"""Delay factors against exponentials, and interpolation between frequencies."""

from __future__ import annotations

import numpy as np
import pytest

from forest_addon.acoustics.cylinder import transfer
from forest_addon.acoustics.spectrum import delay_factors, frequency_panels


@pytest.mark.parametrize("count", [1, 2, 3, 16, 1000])
def test_delay_factors(count: int) -> None:
    delay = np.array([0.0, 1e-5, 0.0123456789, 3.7])
    frequency = 60e3 + 12.5 * np.arange(count)
    expected = np.exp(-2j * np.pi * np.outer(frequency, delay))
    factors = delay_factors(60e3, 12.5, count, delay)
    assert factors.shape == (count, 4)
    np.testing.assert_allclose(factors, expected, atol=1e-9)  # the plain exponential loses digits
    np.testing.assert_allclose(np.abs(factors), 1, rtol=1e-14)


def test_no_delays() -> None:
    assert delay_factors(0.0, 1.0, 5, np.empty(0)).shape == (5, 0)


@pytest.mark.parametrize("last", [1, 2, 41, 42, 5000])
def test_panels_cover_every_bin_once(last: int) -> None:
    panels = frequency_panels(last, 0.5, 300.0)
    bins = np.concatenate([np.arange(p.first, p.first + p.count) for p in panels])
    np.testing.assert_array_equal(bins, np.arange(1, last + 1))
    for panel in panels:
        assert (panel.count - 1) * 0.5 <= 300.0
        np.testing.assert_allclose(panel.weights.sum(axis=1), 1, rtol=1e-13)
    assert frequency_panels(0, 0.5, 300.0) == []


def test_panels_narrower_than_a_bin() -> None:
    assert [p.count for p in frequency_panels(5, 10.0, 1e-3)] == [1] * 5


def test_a_trunk_is_interpolated_to_rounding() -> None:
    radius, angle = 0.3, np.array([0.0, 0.3, 2.0, np.pi])
    width = 3.0 * 343.0 / (2 * np.pi * radius)
    whole = transfer(0.5 * np.arange(20001)[:, None], angle, radius, 343.0)
    for panel in frequency_panels(20000, 0.5, width):
        nodes = transfer(panel.nodes[:, None], angle, radius, 343.0)
        exact = whole[panel.first : panel.first + panel.count]
        assert np.abs(panel.weights @ nodes - exact).max() < 2e-12 * np.abs(whole).max()
