"""Wood as cylinders: found in meshes, and as loud as the endless cylinder says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from references.echo_scenes import scene_of

from forest_addon.acoustics.cylinder import scattering_sum
from forest_addon.base.trimesh import WOOD, TriMesh
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.sonar.ping import ping
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.sensing.sonar.wood import (
    CylinderStrength,
    _backscatter,
    _largest_backscatter,
    wood_segments,
)
from forest_addon.spec import Air, Sonar

AIR = Air(sound_speed=340.0)
QUIET = {"beam": "omni", "absorption": False, "shading": "none", "cull": 0.0, "tolerance": 0.0}


def pole(radius: float, x: float = 1.5, half: float = 2.0, sides: int = 64) -> TriMesh:
    points = np.stack([np.full(9, x), np.zeros(9), np.linspace(-half, half, 9)], axis=1)
    vertices, triangles = tube(points, np.full(9, radius), sides)
    return TriMesh.of_part(vertices, triangles, WOOD)


@pytest.mark.medium
def test_table_against_the_series() -> None:
    size = np.exp(np.random.default_rng(0).uniform(math.log(1e-5), math.log(600), 3000))
    exact = scattering_sum(size, math.pi) * np.exp(2j * size)
    np.testing.assert_allclose(_backscatter(size), exact, rtol=1e-6)
    assert (np.abs(exact) <= _largest_backscatter(size)).all()


@pytest.mark.medium
@pytest.mark.parametrize("radius", [0.002, 0.01, 0.05])
def test_a_long_pole_is_the_endless_cylinder(radius: float) -> None:
    """Broadside at d: ∫ S/π·e^{-2ik√(d²+z²)}/(d²+z²) dz by stationary phase, spread from the near side."""
    mesh = pole(radius)
    start, end, found = wood_segments(mesh)
    assert len(start) == 1
    assert np.linalg.norm(end - start) == pytest.approx(4.0, abs=1e-4)
    assert found[0] == pytest.approx(radius, rel=5e-3)
    echo = ping(EchoTargets(scene_of(mesh)), Sonar(position=(0, 0, 0), **QUIET), AIR)
    assert len(echo.heard) > 1000
    k, d = 2 * math.pi * echo.frequency / 340.0, 1.5
    line = np.sqrt(math.pi * d / k) / d**2 * np.exp(-2j * k * d - 0.25j * math.pi)
    expected = np.conj(scattering_sum(k * found[0], math.pi)) / math.pi * line * d / (d - found[0])
    np.testing.assert_allclose(echo.spectrum, expected, atol=0.01 * np.abs(expected).max())


def test_a_large_pole_is_as_loud_as_optics_says() -> None:
    """Geometric optics: p = 1/2s·√(a/(a + s)) at s from the surface."""
    radius, away = 0.08, 1.2
    echo = ping(
        EchoTargets(scene_of(pole(radius, away + radius))), Sonar(position=(0, 0, 0), **QUIET), AIR
    )
    expected = math.sqrt(radius / (radius + away)) / (2 * away)
    assert np.abs(echo.spectrum).mean() == pytest.approx(expected, rel=0.01)
    peak = echo.time[np.argmax(echo.envelope)] * 340.0 / 2
    assert peak == pytest.approx(away, abs=2e-3)


def test_a_tilted_pole_is_heard_where_it_is_square_to_the_sound() -> None:
    """A pole leaning 30°: the loudest piece is the foot of the perpendicular."""
    lean = math.radians(30)
    turn = np.array(
        [[math.cos(lean), 0, math.sin(lean)], [0, 1, 0], [-math.sin(lean), 0, math.cos(lean)]]
    )
    placed = np.column_stack([turn, [1.5, 0, 0]])
    echo = ping(
        EchoTargets(scene_of(pole(0.01, 0.0), placed)), Sonar(position=(0, 0, 0), **QUIET), AIR
    )
    axis = turn[:, 2]
    foot = np.array([1.5, 0, 0]) - (np.array([1.5, 0, 0]) @ axis) * axis
    assert np.linalg.norm(echo.heard.position[0] - foot) < 0.05


@pytest.mark.slow
def test_stretched_wood_is_thicker_or_longer() -> None:
    mesh = pole(0.01, 0.0)
    for stretch, radius, length in (([1, 1, 2.0], 0.01, 8.0), ([3.0, 3.0, 1], 0.03, 4.0)):
        placed = np.column_stack([np.diag(stretch), [1.5, 0, 0]])
        targets = EchoTargets(scene_of(mesh, placed))
        sonar = Sonar(position=(0, 0, 0), **QUIET)
        whole = pole(radius, 1.5, length / 2)
        expected = ping(EchoTargets(scene_of(whole)), sonar, AIR)
        found = ping(targets, sonar, AIR)
        size = np.abs(expected.spectrum).max()
        assert np.abs(np.abs(found.spectrum) - np.abs(expected.spectrum)).max() < 0.01 * size


def test_strength_is_never_above_its_bound() -> None:
    rng = np.random.default_rng(4)
    cosine = rng.uniform(-1, 1, 2000)
    strength = CylinderStrength(
        rng.uniform(0, 0.2, 2000),
        rng.uniform(0, 0.1, 2000),
        np.sqrt(1 - cosine**2),
        cosine,
        np.ones(2000),
        *np.zeros((2, 2000), np.int8),
    )
    k = np.linspace(1100, 1480, 60)
    assert (np.abs(strength.amplitude(k)) <= strength.bound(1100, 1480) * (1 + 1e-9)).all()


def test_no_wood_and_a_switch() -> None:
    assert len(wood_segments(TriMesh.of_part(np.eye(3), np.array([[0, 1, 2]]), 0))[0]) == 0
    targets = EchoTargets(scene_of(pole(0.01)))
    silent = ping(targets, Sonar(position=(0, 0, 0), wood=False, **QUIET), AIR)
    assert not silent.spectrum.any()


@pytest.mark.parametrize("engine", ["on", "off"])
def test_mirror_creeping_wave_and_ends_add_up(engine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FOREST_SENSING_KERNELS", engine)
    rng = np.random.default_rng(7)
    tilt = rng.uniform(0.0, math.pi, 300)
    radius = np.exp(rng.uniform(math.log(5e-4), math.log(0.4), 300))
    whole = CylinderStrength(
        rng.uniform(0.005, 0.06, 300),
        radius,
        np.sin(tilt),
        np.cos(tilt),
        rng.uniform(0.9, 1.0, 300),
        *np.zeros((2, 300), np.int8),
    )
    wavenumber = np.linspace(700.0, 1500.0, 9)
    parts = whole.parts(wavenumber[0], wavenumber[-1])
    kinds = np.stack([parts.strength.wave, parts.strength.end])
    assert len(np.unique(kinds, axis=1).T) == 6
    later = np.exp(-1j * wavenumber[:, None] * parts.offset)
    total = np.zeros((9, 300), complex)
    np.add.at(total.T, parts.rows, (parts.strength.amplitude(wavenumber) * later).T)
    off = np.abs(total - whole.amplitude(wavenumber)).max(axis=0)
    assert (off <= whole.error(wavenumber[-1]) + 1e-12).all()
