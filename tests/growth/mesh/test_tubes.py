"""Tubes against the closed forms of cylinders and cones."""

import numpy as np
import pytest

from forest_addon.growth.mesh.meshing import sides_for, tube


def area_and_volume(vertices, triangles):
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    return area, np.einsum("ti,ti->", a, np.cross(b, c)) / 6


@pytest.mark.parametrize("sides", [3, 8, 24])
def test_straight_tube_has_the_circles_perimeter_and_faces_outwards(sides):
    points = np.array([[0, 0, 0], [0, 0, 1.0], [0, 0, 2.5]])
    vertices, triangles = tube(points, np.full(3, 0.2), sides)
    widened = 0.2 * np.pi / (sides * np.sin(np.pi / sides))
    cap = sides / 2 * widened**2 * np.sin(2 * np.pi / sides)
    area, volume = area_and_volume(vertices, triangles)
    assert area == pytest.approx(2 * np.pi * 0.2 * 2.5 + 2 * cap, rel=1e-12)  # walls: the circle's
    assert volume == pytest.approx(cap * 2.5, rel=1e-12)  # positive: outward facing


def test_closed_and_without_twist_along_a_helix():
    t = np.linspace(0, 4 * np.pi, 200)
    points = np.stack([np.cos(t), np.sin(t), 0.3 * t], axis=1)
    vertices, triangles = tube(points, np.full(len(t), 0.05), 8)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()  # watertight
    rings = vertices[:-2].reshape(len(t), 8, 3) - points[:, None]
    turn = np.einsum("rki,rki->rk", rings[:-1], rings[1:]) / 0.05**2
    assert turn.min() > 0.95  # no corner jumps to another's place


def test_turned_back_on_itself_stays_finite():
    points = np.array([[0, 0, 0], [0, 0, 1.0], [0, 1e-9, 0.2]])
    vertices, _ = tube(points, np.full(3, 0.1), 6)
    assert np.isfinite(vertices).all()


@pytest.mark.parametrize(("radius", "tolerance"), [(0.2, 0.001), (0.05, 0.002), (0.5, 0.0005)])
def test_sides_keep_the_tolerance(radius, tolerance):
    n = sides_for(radius, tolerance)
    assert radius * (1 - np.cos(np.pi / n)) <= tolerance or n == 64
    assert radius * (1 - np.cos(np.pi / (n - 1))) > tolerance


def test_a_twig_thinner_than_the_tolerance_is_a_triangle():
    assert sides_for(0.0005, 0.002) == 3
