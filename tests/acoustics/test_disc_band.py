"""The exact disc looked up for a whole band, against the larger table and the disc's own equations."""

from __future__ import annotations

import numpy as np
import pytest

from forest_addon.acoustics import chebyshev
from forest_addon.acoustics.disc import backscatter_amplitude
from forest_addon.acoustics.disc_band import LATER, banded, has_rows, missed, phase_for
from forest_addon.acoustics.disc_exact import HardDisc


@pytest.mark.parametrize("error", [3e-4, 9e-6])
def test_no_value_is_farther_off_than_is_said(error: float) -> None:
    rng = np.random.default_rng(4)
    wavenumber = 1110.0 + 370.0 * chebyshev.points(15)
    radius = rng.uniform(0.008, 0.03, 2000)
    incidence = np.concatenate([rng.uniform(0, 0.1, 500), np.arccos(rng.uniform(0, 1, 1500))])
    phase = phase_for(error)
    assert has_rows(radius, 1480.0).all()
    found = banded(wavenumber, radius, incidence, phase)
    size = wavenumber[:, None] * radius
    known = backscatter_amplitude(size, incidence) * np.exp(1j * LATER * size)
    off = np.abs(found - known / wavenumber[:, None]).max(axis=0)
    bound = missed(radius, incidence, 1480.0, phase)
    assert (off <= bound).all()
    assert off.max() > 0.01 * bound.max()  # it is not the larger table that was asked
    np.testing.assert_array_equal(
        banded(wavenumber, radius[::-1], incidence[::-1], phase)[:, ::-1], found
    )


def test_against_the_equations_of_the_disc() -> None:
    disc, radius = HardDisc(20.0), 0.02
    wavenumber = np.linspace(900.0, 1000.0, 12)
    wavenumber[-1] = 20.0 / radius
    incidence = np.array([0.0, 0.3, 1.0, 1.5])
    found = banded(wavenumber, np.full(4, radius), incidence, phase_for(1e-5))[-1]
    exact = disc.backscatter(incidence) * radius / 20.0 * np.exp(20j * LATER)
    np.testing.assert_allclose(found, exact, atol=2e-4 * radius)


def test_what_is_too_small_or_too_large_has_no_rows() -> None:
    assert has_rows(np.array([1e-6, 0.003, 0.02, 0.07, 0.2]), 1480.0).tolist() == [
        False,
        False,
        True,
        True,
        False,
    ]
