"""Absorption of air: values of ISO 9613-1 and its limits."""

import cmath
import math

import numpy as np
import pytest
from references.reverb import absorption_direct
from scipy import integrate

from forest_addon.acoustics.air import DB_PER_NEPER, absorption
from forest_addon.acoustics.cylinder import transfer
from forest_addon.acoustics.ground import SURFACES, spherical_reflection, surface_impedance
from forest_addon.acoustics.spectrum import delay_factors, frequency_panels

VALUES = [
    (1000, 20, 50, 101.325, 0.004664672605),
    (4000, 20, 50, 101.325, 0.0296651515043),
    (12000, 20, 50, 101.325, 0.220939171002),
    (70000, 20, 50, 101.325, 2.290820845537),
    (2000, 0, 10, 101.325, 0.016560481964),
    (8000, -20, 100, 101.325, 0.04128782229943),  # PHYSICS 5.3 prints this one with a digit lost
    (1000, 35, 80, 80, 0.00807349176466),
]


@pytest.mark.parametrize(("frequency", "celsius", "humidity", "pressure", "expected"), VALUES)
def test_values(
    frequency: float, celsius: float, humidity: float, pressure: float, expected: float
) -> None:
    conditions = (frequency, celsius, humidity, pressure)
    assert DB_PER_NEPER * absorption(*conditions) == pytest.approx(expected, rel=1e-11)
    assert absorption_direct(*conditions) == pytest.approx(absorption(*conditions), rel=1e-13)


def test_broadcasting_and_defaults() -> None:
    loss = DB_PER_NEPER * absorption(
        np.array([[1000.0], [4000.0]]), temperature_c=np.array([20.0, 0.0, -20.0])
    )
    assert loss.shape == (2, 3)
    assert loss[1, 0] == DB_PER_NEPER * absorption(4000.0)
    assert DB_PER_NEPER * absorption(1000.0, 20, 50, 101.325) == DB_PER_NEPER * absorption(1000.0)


def test_limits() -> None:
    assert DB_PER_NEPER * absorption(0.0) == 0
    dry = DB_PER_NEPER * absorption([1.0, 1e3, 1e6], humidity=0.0)
    assert np.isfinite(dry).all()
    assert np.isfinite(
        DB_PER_NEPER * absorption(1e5, temperature_c=[-40.0, 50.0], humidity=1e-9)
    ).all()
    grid = DB_PER_NEPER * absorption(np.geomspace(1e-3, 1e7, 400))
    assert (np.diff(grid) > 0).all()  # the culling of leaves relies on it


@pytest.mark.parametrize(
    "wrong",
    [{"humidity": -1.0}, {"humidity": 101.0}, {"pressure_kpa": 0.0}, {"temperature_c": -274.0}],
)
def test_impossible_air_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"humidity|temperature"):
        absorption(1000.0, **wrong)


# -------------------------------------------------------------------------------------------- ground
# The ground against values worked out by hand, closed limits, and the exact field of an image line. The
# reference is the exact solution for a locally reacting plane, independent of every asymptotic formula: the
# mirrored source with a line of sources that go on downwards in complex depth (Di & Gilbert 1993),
# integrated by adaptive quadrature. Its own check is that it is 1 and -1 for a hard and a soft plane.

SPEED = 343.0


def exact_reflection(frequency: float, across: float, rise: float, impedance: complex) -> complex:
    """Reflected field over the mirrored source's, e^{+iωt} in and out, by quadrature."""
    k, beta = 2 * math.pi * frequency / SPEED, 1 / impedance.conjugate()
    path = math.hypot(across, rise)

    def line(q: float) -> complex:
        way = cmath.sqrt(across**2 + (rise + 1j * q) ** 2)
        return cmath.exp(-k * beta * q + 1j * k * (way - path)) / way

    end = 60 / (k * (beta.real + 1e-3))
    points = np.geomspace(end * 1e-6, end, 60)
    total = 0j
    for low, high in zip([0.0, *points[:-1]], points, strict=True):
        for part, unit in ((lambda q: line(q).real, 1), (lambda q: line(q).imag, 1j)):
            total += unit * integrate.quad(part, low, high, limit=400, epsabs=1e-9)[0]
    return (1 - 2 * k * beta * path * total).conjugate()


def test_impedance_by_hand() -> None:
    """f/σ = 1 gives the constants themselves; a factor 10 their powers."""
    at = np.array([200.0, 2000.0])
    np.testing.assert_allclose(
        surface_impedance(at, 200.0), [6.5 - 8.43j, 2.28340 - 1.96711j], 1e-5
    )
    old = surface_impedance(at, 200.0, "delany-bazley")
    np.testing.assert_allclose(old, [10.08 - 11.9j, 2.61468 - 2.21588j], 1e-5)


def test_hard_ground_is_a_mirror() -> None:
    frequency = np.geomspace(20, 20_000, 50)
    found = spherical_reflection(frequency, 10.0, 3.0, 1e12, SPEED)
    np.testing.assert_allclose(found, 1.0, atol=1e-8)


def test_grazing_and_far_away_it_is_minus_one() -> None:
    found = spherical_reflection(np.array([1e8]), 1000.0, 1e-9, 3.0 - 2.0j, SPEED)
    assert abs(found[0] + 1) < 1e-6


def test_no_step_where_the_series_takes_over() -> None:
    """|w| passes 1000 within this band."""
    frequency = np.geomspace(2e5, 6e6, 4001)
    found = spherical_reflection(frequency, 100.0, 5.0, 3.0 - 2.0j, SPEED)
    assert np.abs(np.diff(found, 2)).max() < 1e-8


@pytest.mark.parametrize("surface", ["snow", "forest floor", "grass"])
@pytest.mark.parametrize("frequency", [125.0, 500.0, 2000.0])
@pytest.mark.parametrize(("across", "rise"), [(10.0, 3.0), (30.0, 1.0), (4.0, 4.0)])
def test_against_the_exact_field(
    surface: str, frequency: float, across: float, rise: float
) -> None:
    """kd' is 13 at the least."""
    impedance = complex(surface_impedance(np.array([frequency]), SURFACES[surface])[0])
    path = math.hypot(across, rise)
    found = spherical_reflection(np.array([frequency]), path, rise, impedance, SPEED)[0]
    assert abs(found - exact_reflection(frequency, across, rise, impedance)) < 0.02


# ------------------------------------------------------------------------------------------ spectrum
# Delay factors against exponentials, and interpolation between frequencies.


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
