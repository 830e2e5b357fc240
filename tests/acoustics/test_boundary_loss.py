"""Loss at thin cylinders: thin boundary layers in closed form, the air's equations solved on a grid."""

import math

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.linalg import solve_banded

from forest_addon.acoustics.foliage import DIFFUSIVITY, HEATS, VISCOSITY, twig_loss

SPEED = 343.0


@pytest.mark.parametrize("along", [0.0, 1.0, 1.0 / 3.0])
def test_thick_cylinders_have_thin_layers(along):
    """What a wall takes, ¼ρωδ·u² of its sliding air and (γ-1)/4·ωδ_t·p²/ρc² by heat, around a cylinder."""
    radius, frequency = np.array([0.05]), 20_000.0
    omega = 2 * math.pi * frequency
    slow, warm = (math.sqrt(2 * each / omega) for each in (VISCOSITY, DIFFUSIVITY))
    k = omega / SPEED
    wanted = math.pi * k * radius * (2 * slow * (1 - along) + slow * along + (HEATS - 1) * warm)
    np.testing.assert_allclose(twig_loss(radius, frequency, SPEED, along), wanted, rtol=2e-3)


def _wave(radius, diffusivity, omega, count=20_000):
    """(N,) radii and T of -iωT = χ·(T'' + T'/r) outside a cylinder, 1 on it and 0 far away."""
    r = np.linspace(radius, radius + 30 * math.sqrt(2 * diffusivity / omega), count)
    step = r[1] - r[0]
    bands = np.zeros((3, count), complex)
    bands[1] = -2 / step**2 + 1j * omega / diffusivity
    bands[0, 1:] = 1 / step**2 + 1 / (2 * r[:-1] * step)
    bands[2, :-1] = 1 / step**2 - 1 / (2 * r[1:] * step)
    bands[1, [0, -1]], bands[0, 1], bands[2, -2] = 1.0, 0.0, 0.0
    given = np.zeros(count, complex)
    given[0] = 1.0
    return r, solve_banded((1, 1), bands, given)


@pytest.mark.parametrize("radius", [2e-5, 5e-4, 5e-3])
def test_sliding_along_the_axis_and_heat_by_finite_differences(radius):
    """Work of the drag on the wall; heat that lags behind the pressure."""
    omega = 2 * math.pi * 4000.0
    r, sliding = _wave(radius, VISCOSITY, omega)
    slope = np.gradient(sliding, r, edge_order=2)[0]
    drag = -2 * math.pi * radius * VISCOSITY / SPEED * slope.real
    r, warmth = _wave(radius, DIFFUSIVITY, omega)
    lag = abs(trapezoid(warmth * 2 * math.pi * r, r).imag)
    heat = (HEATS - 1) * omega / SPEED * lag
    found = twig_loss(np.array([radius]), 4000.0, SPEED, 1.0)[0]
    assert found == pytest.approx(drag + heat, rel=2e-3)


def test_a_needle_of_the_size_of_the_layer_drags_more_than_its_share():
    """Far below the layer a metre of thread takes as much as a thicker one but for a logarithm."""
    thin, thick = twig_loss(np.array([1e-7, 1e-6]), 4000.0, SPEED, 1.0)
    assert 0.5 * thick < thin < thick
