"""Hemispherical pictures of canopies whose gap fraction is known."""

import numpy as np
import pytest
from references.rays_brute import BruteCaster

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, TriMesh
from forest_addon.sensing.canopy import OUTSIDE, REACH, SKY, hemisphere, look_up
from forest_addon.sensing.rays.geometry import SceneGeometry


def slab(index, rng, size=0.4, half=7.0):
    """Square leaves at random from 1 to 1.5 m up, facing all ways: P = exp(-L/(2 cos θ))."""
    count = round(index * (2 * half) ** 2 / size**2)
    normal = rng.standard_normal((count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    helper = rng.standard_normal((count, 3))
    u = np.cross(normal, helper)
    u *= size / 2 / np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normal, u)
    centre = np.column_stack([rng.uniform(-half, half, (count, 2)), rng.uniform(1.0, 1.5, count)])
    corners = np.stack([centre - u - v, centre + u - v, centre + u + v, centre - u + v], axis=1)
    first = 4 * np.arange(count)[:, None, None]
    triangles = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    mesh = TriMesh.of_part(corners.reshape(-1, 3), triangles, LEAF)
    place = np.eye(4)[None, :3]
    one = np.zeros(1, dtype=np.int64)
    return SceneGeometry((mesh,), place, one, ("leaves",), one, one)


@pytest.mark.slow
def test_leaves_at_random_have_the_index_that_they_have():
    """L = 0.8, spherical, from 40 points; a ring's gap is that of about as many leaves, 0.48/√40 = 0.08."""
    points = np.column_stack([stream(1, "at").uniform(-3, 3, (40, 2)), np.zeros(40)])
    seen = look_up(BruteCaster(slab(0.8, stream(1, "slab"))), points, stream(1, "rays"), 6, 12)
    expected = np.exp(-0.4 / np.cos(seen.zenith))
    assert seen.gap[:4] == pytest.approx(expected[:4], abs=0.16)
    assert seen.effective == pytest.approx(0.8, rel=0.2)
    assert 0 < seen.open < 1
    assert seen.rays == 40 * 6 * 12
    assert seen.zenith[-1] < REACH


def test_an_open_sky_has_no_leaves():
    seen = look_up(
        BruteCaster(slab(0.0, stream(2, "slab"))), np.zeros((1, 3)), stream(2, "rays"), 4, 8
    )
    assert (seen.gap == 1).all()
    assert seen.effective == 0
    assert seen.open == 1


def test_a_hemispherical_picture_shows_a_ceiling_where_it_is():
    """A square at height 1 from x 0 to 2 and y 0 to 1, east and north of the point: tan z (cos a, sin a)."""
    corners = np.array([[0, 0, 1], [2, 0, 1], [2, 1, 1], [0, 1, 1.0]])
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), LEAF)
    one = np.zeros(1, dtype=np.int64)
    scene = SceneGeometry((mesh,), np.eye(4)[None, :3], one, ("ceiling",), one, one)
    seen = hemisphere(BruteCaster(scene), np.zeros(3), 40)
    row, column = np.indices((40, 40))
    east, north = 1 - (column + 0.5) / 20, 1 - (row + 0.5) / 20  # the head lies north: east is left
    away = np.hypot(east, north)
    reach = np.tan(np.minimum(away, 0.999) * np.pi / 2) / away
    x, y = east * reach, north * reach
    covered = (x > 0) & (x < 2) & (y > 0) & (y < 1) & (away < 1)
    assert np.array_equal(seen == LEAF, covered)
    assert np.array_equal(seen == OUTSIDE, away > 1)
    assert np.array_equal(seen == SKY, (away <= 1) & ~covered)
