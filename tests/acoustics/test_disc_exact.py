"""The exact disc: printed values, separation of variables, conservation laws, limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from references.disc_spheroidal import hard_disc_spheroidal
from references.hard_disc import HardDisc, hard_disc_amplitude

VALUES = [  # PHYSICS 4.1: (ka, degrees, k|f|)
    (0.5, 0, 0.027882978554),
    (1, 0, 0.258102015075),
    (1, 60, 0.050690636907),
    (5, 0, 12.584126425459),
    (10, 0, 49.4776247107),
]
DIRECTIONS = [(0.3, 0.3, 0.0), (0.7, 1.2, 0.9), (0.4, 2.3, 2.0), (1.5, 1.5, 0.0), (0.0, 3.1, 1.0)]


@pytest.mark.parametrize(("ka", "degrees", "expected"), VALUES)
def test_values(ka: float, degrees: float, expected: float) -> None:
    angle = math.radians(degrees)
    assert abs(hard_disc_amplitude(ka, angle, angle, 0.0)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("ka", [0.3, 2.0, 6.0])
def test_separation_of_variables(ka: float) -> None:
    expected = hard_disc_spheroidal(ka, DIRECTIONS)
    values = hard_disc_amplitude(ka, *np.array(DIRECTIONS).T)
    np.testing.assert_allclose(values, expected, atol=1e-9 * max(ka**3, ka**2))


@pytest.mark.parametrize("ka", [1e-3, 0.4, 5.0, 37.0, 100.0])
def test_reciprocity(ka: float) -> None:
    incidence, scattered, azimuth = np.array(DIRECTIONS).T
    there = hard_disc_amplitude(ka, incidence, scattered, azimuth)
    back = hard_disc_amplitude(ka, scattered, incidence, azimuth)
    np.testing.assert_allclose(there, back, atol=1e-12 * min(ka**3, ka**2))


@pytest.mark.slow
@pytest.mark.parametrize("ka", [1e-2, 1.0, 8.0, 30.0])
@pytest.mark.parametrize("incidence", [0.0, 0.7, 1.5])
def test_optical_theorem(ka: float, incidence: float) -> None:
    """∫|k·f|² dΩ = -4π·Im k·f forward (e^{+iωt}): nothing is lost."""
    count = math.ceil(1.5 * ka) + 24
    nodes, weights = np.polynomial.legendre.leggauss(count)
    turn = 2 * math.pi * np.arange(2 * count) / (2 * count)
    scattered, azimuth = (
        grid.ravel() for grid in np.meshgrid(np.arccos(nodes), turn, indexing="ij")
    )
    disc = HardDisc(ka)
    field = disc.amplitude(np.full(scattered.shape, incidence), scattered, azimuth)
    power = weights @ (np.abs(field) ** 2).reshape(count, -1).sum(axis=1) * math.pi / count
    ahead = disc.amplitude(*(np.array([a]) for a in (incidence, math.pi - incidence, math.pi)))
    assert power == pytest.approx(-4 * math.pi * ahead[0].imag, rel=1e-10)


def test_rayleigh_limit() -> None:
    ka = 1e-4
    for incidence, scattered, azimuth in DIRECTIONS:
        expected = -2 / (3 * math.pi) * ka**3 * math.cos(incidence) * math.cos(scattered)
        value = hard_disc_amplitude(ka, incidence, scattered, azimuth)
        assert value == pytest.approx(expected, rel=1e-7)


def test_optics_limit() -> None:
    """Towards the mirror and straight on a large disc is a mirror with its shadow."""
    for ka in (40.0, 150.0):
        for incidence in (0.0, 0.6):
            expected = 0.5j * ka**2 * math.cos(incidence)
            mirror = hard_disc_amplitude(ka, incidence, incidence, math.pi)
            shadow = hard_disc_amplitude(ka, incidence, math.pi - incidence, math.pi)
            assert abs(mirror - expected) < 2 / ka * abs(expected)
            assert abs(shadow + expected) < 2 / ka * abs(expected)


def test_backscatter_is_the_amplitude_straight_back() -> None:
    angle = np.array([0.0, 1e-9, 0.4, 1.2, math.pi / 2, 2.0])
    for ka in (1e-3, 3.0, 60.0):
        disc = HardDisc(ka)
        expected = disc.amplitude(angle, angle, np.zeros(6))
        np.testing.assert_allclose(disc.backscatter(angle), expected, atol=1e-13 * ka**2)
        series = disc.backscatter_series()
        waves = np.cos(2 * np.outer(angle, np.arange(len(series))))
        np.testing.assert_allclose(ka**3 * (waves @ series), expected, atol=1e-12 * ka**2)


def test_more_orders_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """60 and 100 are beyond the separation of variables; there the truncation is what could be wrong."""
    angle = np.linspace(0, 1.5, 7)
    for ka in (60.0, 100.0):
        disc, finer = HardDisc(ka), _Finer(ka)
        assert finer.orders > disc.orders
        difference = np.abs(disc.backscatter(angle) - finer.backscatter(angle))
        assert difference.max() < 1e-9 * abs(disc.backscatter(np.zeros(1))[0])


class _Finer(HardDisc):
    """Half as many orders more, and so the quadrature of a larger disc's field."""

    def __init__(self, ka: float) -> None:
        from references.hard_disc import _galerkin_matrix

        super().__init__(ka)
        self.orders = self.orders * 3 // 2
        self._matrix = _galerkin_matrix(self._k, self.orders)


@pytest.mark.medium
@pytest.mark.parametrize("ka", [0.0, 5e-324, 1e-200, 1e-90, 1e-30, 300.0])
def test_hard_regions(ka: float) -> None:
    angle = np.array([0.0, 5e-324, 1.0, math.pi / 2, math.pi])
    value = hard_disc_amplitude(ka, angle[:, None], angle, 0.5)
    assert value.shape == (5, 5)
    assert np.isfinite(value).all()
    assert np.abs(value[3]).max() <= 1e-15 * ka**2  # edge-on
    if ka < 1e-110:
        assert (value == 0).all()


def test_sizes_broadcast() -> None:
    ka = np.array([2.0, 0.5, 2.0])
    value = hard_disc_amplitude(ka[:, None], [0.1, 0.2], 0.3, 0.4)
    assert value.shape == (3, 2)
    np.testing.assert_array_equal(value[0], value[2])
    assert value[1, 1] == pytest.approx(hard_disc_amplitude(0.5, 0.2, 0.3, 0.4), rel=1e-13)
    assert hard_disc_amplitude(np.empty(0), 0.0, 0.0, 0.0).shape == (0,)


@pytest.mark.parametrize("ka", [-1.0, math.nan, math.inf])
def test_impossible_sizes(ka: float) -> None:
    with pytest.raises(ValueError, match="ka must be finite and not negative"):
        hard_disc_amplitude(ka, 0.0, 0.0, 0.0)
