"""Facets against Kirchhoff's integral by small squares, image sources, and what they hide."""

from __future__ import annotations

import math

import numpy as np
import pytest
from references.echo_scenes import scene_of
from references.facet_direct import triangle_direct

from forest_addon.base.trimesh import GROUND, OTHER, TriMesh
from forest_addon.sensing.sonar.ping import Echo, ping
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Sonar

AIR = Air(sound_speed=340.0)
QUIET = {"beam": "omni", "absorption": False, "shading": "none", "cull": 0.0, "tolerance": 0.0}


def echo_of(mesh: TriMesh, *placed: np.ndarray, **settings: object) -> Echo:
    sonar = Sonar(**({"position": (0, 0, 0)} | QUIET | settings))
    return ping(EchoTargets(scene_of(mesh, *placed)), sonar, AIR)


def plane(half: float, height: float = -1.0, cells: int = 1, part: int = GROUND) -> TriMesh:
    line = np.linspace(-half, half, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], axis=1)
    i, j = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
    a = (i * (cells + 1) + j).ravel()
    b, c, d = a + cells + 1, a + cells + 2, a + 1
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return TriMesh.of_part(vertices, triangles, part)


def sphere(radius: float, centre: tuple[float, float, float], cells: int = 24) -> TriMesh:
    """A closed mesh of triangles, wound outwards."""
    theta = np.linspace(0, math.pi, cells + 1)
    phi = np.linspace(0, 2 * math.pi, 2 * cells, endpoint=False) + 0.01
    t, p = np.meshgrid(theta, phi, indexing="ij")
    around = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1)
    number = np.arange(t.size).reshape(t.shape)
    a, b = number[:-1], number[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    triangles = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    return TriMesh.of_part(np.array(centre) + radius * around.reshape(-1, 3), triangles, OTHER)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("size", [0.02, 0.1, 0.3])
def test_one_triangle_is_kirchhoffs_integral(seed: int, size: float) -> None:
    """To a part in a few thousand of what an endless plane would send back."""
    rng = np.random.default_rng(seed)
    height = rng.uniform(0.4, 1.2)
    corners = rng.normal(size=(3, 3)) * size * [1, 1, 0.3]
    corners += [*rng.normal(size=2) * size * 0.7, -height]
    echo = echo_of(TriMesh.of_part(corners, np.array([[0, 1, 2]]), OTHER))
    some = [0, len(echo.frequency) // 2, len(echo.frequency) - 1]
    k = 2 * math.pi * echo.frequency[some] / 340.0
    expected = triangle_direct(corners, np.zeros(3), k, 0.0008)
    assert np.abs(echo.spectrum[some] - expected).max() < 1e-3 / (2 * height)


@pytest.mark.parametrize("cells", [1, 7, 40])
@pytest.mark.parametrize("height", [-0.3, -2.0])
def test_a_wide_plane_is_a_mirror(cells: int, height: float) -> None:
    """The image source, e^{-2ikh}/2h, however the plane is cut; its rim is beyond the range."""
    echo = echo_of(plane(30.0, height, cells), max_range=12.0, position=(0.013, 0.0077, 0))
    h = abs(height)
    expected = np.exp(-4j * math.pi * echo.frequency / 340.0 * h) / (2 * h)
    np.testing.assert_allclose(echo.spectrum, expected, atol=1e-9)
    assert len(echo.heard) == 1
    assert echo.heard.kind[0] == "facet"


@pytest.mark.parametrize("point", [(0.0, 0.0), (1.0, 1.0), (0.5, 0.5), (0.0, 0.5), (0.5, 0.25)])
def test_a_foot_on_an_edge_or_a_corner_counts_once(point: tuple[float, float]) -> None:
    echo = echo_of(plane(30.0, -1.0, 60), position=(*point, 0.0), max_range=12.0)
    assert np.abs(echo.spectrum) == pytest.approx(0.5, rel=1e-9)


@pytest.mark.slow
def test_a_sphere_sounds_like_a_sphere() -> None:
    """Geometric optics of a sphere: p = R/(2s(R + s)); facets of 1 mm sag would need finer ones."""
    radius, away = 0.05, 1.0
    echo = echo_of(sphere(radius, (away + radius, 0, 0), 160))
    expected = radius / (2 * away * (radius + away))
    assert np.abs(echo.spectrum).mean() == pytest.approx(expected, rel=0.1)
    assert echo.heard.position[:, 0].max() < away + radius + 1e-6  # the far side is silent


def test_small_far_triangle_is_its_area() -> None:
    """f = kA/2π of a face-on facet that is small against the Fresnel width."""
    corners = np.array([[3.0, 0, 0], [3.0, 0.01, 0], [3.0, 0, 0.012]])
    echo = echo_of(TriMesh.of_part(corners, np.array([[0, 1, 2]]), OTHER))
    k = 2 * math.pi * echo.frequency / 340.0
    np.testing.assert_allclose(np.abs(echo.spectrum), k * 6e-5 / (2 * math.pi) / 9, rtol=0.05)


@pytest.mark.medium
def test_mirrored_and_squeezed_instances() -> None:
    mesh = sphere(1.0, (0, 0, 0))
    for stretch in ([0.2, 0.3, 0.1], [-0.2, 0.3, 0.1]):
        placed = np.column_stack([np.diag(stretch), [1.5, 0, 0]])
        moved = TriMesh.of_part(
            mesh.vertices @ np.diag(stretch) + [1.5, 0, 0], mesh.triangles, OTHER
        )
        one, other = echo_of(mesh, placed), echo_of(moved)
        size = np.abs(other.spectrum).max()
        np.testing.assert_allclose(one.spectrum, other.spectrum, atol=1e-6 * size)
        assert one.heard.position[:, 0].max() < 1.5


def test_broken_and_flat_facets_are_passed_over() -> None:
    corners = np.array([[1, 0, 0], [1, 1, 0], [1, 0, 1], [np.nan, 0, 0], [2, 0, 0], [2, 0, 0.0]])
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 1, 3], [0, 4, 5]]), OTHER)
    echo = echo_of(mesh)
    assert np.isfinite(echo.spectrum).all()
    assert not echo_of(mesh, facets=False).spectrum.any()
