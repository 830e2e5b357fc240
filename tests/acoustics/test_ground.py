"""The ground against values worked out by hand, closed limits, and the exact field of an image line.

The reference is the exact solution for a locally reacting plane, independent of every asymptotic formula:
the mirrored source with a line of sources that go on downwards in complex depth (Di & Gilbert 1993),
integrated by adaptive quadrature. Its own check is that it is 1 and -1 for a hard and a soft plane.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from scipy import integrate

from forest_addon.acoustics.ground import SURFACES, spherical_reflection, surface_impedance

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


def test_presets_from_soft_to_hard() -> None:
    frequency = np.array([500.0])
    sizes = [abs(surface_impedance(frequency, sigma)[0]) for sigma in SURFACES.values()]
    assert sizes == sorted(sizes)
    assert surface_impedance(frequency, 50.0)[0].imag < 0  # a stiffness, in e^{+iωt}


def test_hard_ground_is_a_mirror() -> None:
    frequency = np.geomspace(20, 20_000, 50)
    found = spherical_reflection(frequency, 10.0, 3.0, 1e12, SPEED)
    np.testing.assert_allclose(found, 1.0, atol=1e-8)


def test_far_away_and_steep_it_is_the_plane_waves() -> None:
    impedance = 3.0 - 2.0j
    plane = (0.6 * impedance - 1) / (0.6 * impedance + 1)
    errors = [
        abs(spherical_reflection(np.array([f]), 50.0, 30.0, impedance, SPEED)[0] - plane)
        for f in (1e3, 1e4, 1e5, 1e8, 1e10)
    ]
    assert errors[2] < 1e-4
    assert errors[-1] < 1e-7
    assert errors == sorted(errors, reverse=True)


def test_grazing_and_far_away_it_is_minus_one() -> None:
    found = spherical_reflection(np.array([1e8]), 1000.0, 1e-9, 3.0 - 2.0j, SPEED)
    assert abs(found[0] + 1) < 1e-6


def test_no_step_where_the_series_takes_over() -> None:
    """|w| passes 1000 within this band."""
    frequency = np.geomspace(2e5, 6e6, 4001)
    found = spherical_reflection(frequency, 100.0, 5.0, 3.0 - 2.0j, SPEED)
    assert np.abs(np.diff(found, 2)).max() < 1e-8


def test_the_reference_itself() -> None:
    assert abs(exact_reflection(500.0, 10.0, 3.0, 1e9 + 0j) - 1) < 1e-4
    assert abs(exact_reflection(500.0, 10.0, 3.0, 1e-4 + 0j) + 1) < 1e-2


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
