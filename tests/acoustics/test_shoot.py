"""Shoots of needles against the sum over their needles, piece by piece."""

import numpy as np
import pytest

from forest_addon.acoustics.extinction import cross_sections
from forest_addon.acoustics.foliage import shoot_width
from forest_addon.base.rng import stream

NEEDLES, PIECES, RADIUS, LENGTH, SPEED = 120, 24, 0.0005, 0.018, 343.0


def in_phase(place: np.ndarray, along: np.ndarray, k: float, way: np.ndarray) -> np.ndarray:
    """(W,) m², mean dσ/dΩ into ways (W, 3) of shoots with pieces at (S, N, P, 3) and axes (S, N, 3)."""
    comes = np.array([0.0, 0.0, 1.0])
    found = []
    for goes in way:
        phase = np.exp(1j * k * (place @ (comes - goes)))
        pushed = 2.0 * (comes @ goes) - (along @ comes) * (along @ goes)
        found.append((phase * (pushed - 1.0)[..., None]).mean(axis=-1).sum(axis=1))
    volume = np.pi * RADIUS**2 * LENGTH
    return np.mean(np.abs(k**2 * volume / (4.0 * np.pi) * np.array(found)) ** 2, axis=1)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("frequency", "allowed"), [(250.0, 0.2), (1e3, 0.1), (4e3, 0.15), (8e3, 0.5)]
)
def test_a_shoot_scatters_as_its_needles_together(frequency, allowed):
    """Random needles around an axis that looks all ways, summed with their phases."""
    rng, k = stream(3, "test", "shoot"), 2.0 * np.pi * frequency / SPEED
    stands = 60
    along = rng.normal(size=(stands, NEEDLES, 3))
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    root = rng.normal(size=(stands, 1, 3))
    root = root / np.linalg.norm(root, axis=-1, keepdims=True)
    root = root * rng.uniform(-0.02, 0.02, (stands, NEEDLES, 1))
    share = (np.arange(PIECES) + 0.5) / PIECES
    place = root[:, :, None] + LENGTH * share[:, None] * along[:, :, None]
    place -= place.mean(axis=(1, 2), keepdims=True)
    spread = np.sqrt(np.mean(np.square(place).sum(axis=-1)))
    area = NEEDLES * np.pi * RADIUS * LENGTH
    cosine, weight = np.polynomial.legendre.leggauss(10)
    way = np.column_stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine])
    summed = 2.0 * np.pi * weight @ in_phase(place, along, k, way)
    joint, density = shoot_width(area, RADIUS, spread, frequency, SPEED, 90)
    alone = cross_sections(np.array([k * RADIUS * np.pi / 4])).energy[0] * RADIUS * np.pi / 4
    found = joint * area + alone * NEEDLES * LENGTH
    assert found == pytest.approx(summed, rel=allowed)
    solid = -2.0 * np.pi * np.diff(np.cos(np.linspace(0.0, np.pi, 91)))
    assert density @ solid == pytest.approx(1.0)


def test_a_shoot_smaller_than_the_wave_scatters_as_one_body():
    """Rayleigh: 4π(k²V/4π)²(1 + t²/3), with the fourth power of the frequency."""
    k = 2.0 * np.pi * 50.0 / SPEED
    joint, _ = shoot_width(0.01, RADIUS, 0.01, 50.0, SPEED, 360)
    strength = k**2 * 0.01 * RADIUS / (4.0 * np.pi)
    whole = 4.0 * np.pi * strength**2 * (1.0 + 25.0 / 27.0)
    assert joint * 0.01 == pytest.approx(whole, rel=0.01)
