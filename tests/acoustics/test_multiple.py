"""Multiple scattering against fundamental solutions, conservation laws, and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from references.cylinders_mfs import scattered_mfs

from forest_addon.acoustics.cylinder import transfer
from forest_addon.acoustics.multiple import _nearness, _System, scattered_field

SPEED = 343.0
SOURCE = np.array([-1.0, 0.3])
EARS = np.array([[2.0, 1.0], [0.1, -2.0], [-1.0, 0.3]])  # the last one is at the source


def stand(count: int, side: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Trunks of different radii, at least 0.6 m from each other and from the origin."""
    rng = np.random.default_rng(seed)
    centre = np.empty((0, 2))
    while len(centre) < count:
        place = rng.uniform(-side / 2, side / 2, 2)
        if np.hypot(*(np.vstack([centre, [0, 0]]) - place).T).min() > 0.6:
            centre = np.vstack([centre, place])
    return centre, rng.uniform(0.05, 0.25, count)


def factor(frequency: float) -> complex:
    return math.sqrt(math.pi**2 * frequency / SPEED) * np.exp(-0.25j * math.pi)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("frequency", "centre", "radius", "tolerance"),
    [
        (300.0, [[0, 0], [0.8, 0.2]], [0.25, 0.15], 1e-12),
        (1000.0, [[0, 0], [0.8, 0.2]], [0.25, 0.15], 1e-12),
        (20.0, [[0, 0], [0.8, 0.2], [0.3, 0.7]], [0.25, 0.15, 0.1], 1e-12),
        (50.0, [[0, 0], [0.45, 0]], [0.25, 0.15], 1e-10),  # 5 cm between the rims
        (1000.0, [[0, 0], [0.42, 0]], [0.25, 0.15], 2e-8),  # 2 cm
    ],
)
def test_against_fundamental_solutions(
    frequency: float, centre: list, radius: list, tolerance: float
) -> None:
    places, sizes = np.array(centre, float), np.array(radius)
    field = scattered_field(np.array([frequency]), places, sizes, SOURCE, EARS, SPEED)
    k = 2 * math.pi * frequency / SPEED
    reference = scattered_mfs(k, places, sizes, SOURCE, EARS, points=90)
    expected = factor(frequency) * np.conj(reference)
    assert (np.abs(field.every[0] - expected) < tolerance * np.abs(expected)).all()
    assert (np.abs(field.once[0] - expected) > 1e-3 * np.abs(expected)).all()


@pytest.mark.parametrize("frequency", [30.0, 400.0, 1500.0])
def test_energy_is_conserved(frequency: float) -> None:
    """Hard trunks take nothing: the power that leaves is what the source gives, 1 + Re p(source)."""
    centre, radius = stand(8, 6.0)
    source = np.zeros(2)
    k = 2 * math.pi * frequency / SPEED
    angle = np.linspace(0, 2 * math.pi, 720, endpoint=False)
    far = 1e7 * np.column_stack([np.cos(angle), np.sin(angle)])
    places = np.vstack([far, source])
    field = scattered_field(np.array([frequency]), centre, radius, source, places, SPEED)
    assert field.unknowns[0] > 8 * 9
    for pressure, kept in ((field.every[0], True), (field.once[0], False)):
        whole = pressure[:-1] + np.exp(-1j * k * 1e7) / math.sqrt(1e7)  # and the incident wave
        leaving = np.mean(np.abs(whole) ** 2) * 1e7
        given = 1.0 + (pressure[-1] / factor(frequency)).real
        assert (abs(leaving - given) < 1e-5 * given) == kept


def test_reciprocity() -> None:
    centre, radius = stand(12, 8.0)
    a, b = np.array([0.0, 0.0]), np.array([7.0, 1.0])
    there, back = (
        scattered_field(np.array([200.0, 900.0]), centre, radius, s, r[None], SPEED)
        for s, r in ((a, b), (b, a))
    )
    np.testing.assert_allclose(there.every, back.every, rtol=1e-9)


def test_one_cylinder_is_single_scattering() -> None:
    """And far away it is H of ``transfer``, over the roots of both distances."""
    frequency = np.array([100.0, 1000.0, 4000.0])
    at = np.array([[1e6 * math.cos(0.7), 1e6 * math.sin(0.7)]])
    field = scattered_field(
        frequency, np.zeros((1, 2)), np.array([0.2]), np.array([-1e6, 0]), at, SPEED
    )
    np.testing.assert_array_equal(field.every, field.once)
    k = 2 * math.pi * frequency / SPEED
    expected = transfer(frequency, 0.7, 0.2, SPEED) * np.exp(-2e6j * k) / 1e6
    np.testing.assert_allclose(field.every[:, 0], expected, rtol=2e-5)


def test_far_apart_the_echoes_vanish() -> None:
    """Echoes between two trunks fall with the root of their distance."""
    gaps = []
    for apart in (100.0, 400.0, 1600.0):
        centre = np.array([[0.0, 0.0], [0.0, apart]])
        field = scattered_field(
            np.array([500.0]), centre, np.full(2, 0.2), np.array([-3.0, 0]), EARS[:1], SPEED
        )
        gaps.append(abs(field.every - field.once)[0, 0] / abs(field.once)[0, 0])
    assert gaps[0] < 0.02
    assert gaps[0] > 1.8 * gaps[1] > 3.2 * gaps[2]


def test_gmres_is_elimination() -> None:
    centre, radius = stand(15, 8.0)
    direct, iterated = (
        scattered_field(
            np.array([700.0]), centre, radius, np.zeros(2), EARS[:2], SPEED, direct_up_to=size
        )
        for size in (10_000, 0)
    )
    np.testing.assert_allclose(iterated.every, direct.every, rtol=1e-7)


@pytest.mark.medium
@pytest.mark.parametrize("ka", [1e-3, 1e-2, 60.0])
def test_sizes_that_overflow_without_scaling(ka: float) -> None:
    """Near neighbours with ka = 0.001 take orders whose Hankel functions pass 1e308."""
    radius = np.array([0.1, 0.1, 0.02])
    centre = np.array([[0, 0], [0.202, 0], [0.3, 0.4]])
    frequency = ka / 0.1 * SPEED / (2 * math.pi)
    ear = np.array([[0.3, 3.0]])
    field = scattered_field(np.array([frequency]), centre, radius, SOURCE, ear, SPEED)
    assert np.isfinite(field.every).all()
    system = _System(ka / 0.1, centre, radius, _nearness(centre, radius))
    assert np.isfinite(system._coupling()).all()
    assert np.abs(system._coupling()).max() < 20
    assert system.last > 60
    if ka < 1:  # so small, each is a monopole and a dipole; of one alone it is Rayleigh's
        alone = scattered_field(np.array([frequency]), centre[:1], radius[:1], SOURCE, ear, SPEED)
        assert 1 < abs(field.every / alone.every) < 4


def test_what_cannot_be_solved_is_refused() -> None:
    two = np.array([[0.0, 0.0], [0.3, 0.0]])
    with pytest.raises(ValueError, match="trunks 0 and 1 overlap"):
        scattered_field(np.array([100.0]), two, np.full(2, 0.15), SOURCE, EARS, SPEED)
    with pytest.raises(ValueError, match="covers the source"):
        scattered_field(np.array([100.0]), SOURCE[None], np.full(1, 0.1), SOURCE, EARS[:2], SPEED)
    with pytest.raises(ValueError, match="covers the receiver"):
        scattered_field(np.array([100.0]), EARS[:1], np.full(1, 0.1), SOURCE, EARS, SPEED)
    many = np.column_stack([np.arange(400) + 5.0, np.zeros(400)])
    with pytest.raises(ValueError, match="fewer trunks or a lower frequency"):
        scattered_field(np.array([5000.0]), many, np.full(400, 0.3), SOURCE, EARS, SPEED)


def test_no_trunks() -> None:
    field = scattered_field(np.array([100.0]), np.empty((0, 2)), np.empty(0), SOURCE, EARS, SPEED)
    assert (field.every == 0).all()
    assert field.every.shape == (1, 3)
