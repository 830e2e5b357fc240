"""Rays side by side go through Embree together: what they meet is what each meets alone."""

import numpy as np
import pytest

pytest.importorskip("bpy")

from references.rays_brute import BruteCaster

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.blender.rays.embree import ALIKE, LONE, EmbreeCaster, lanes_for
from forest_addon.sensing.rays.geometry import SceneGeometry


def crumbs(fine):
    """Four turned copies of 150 triangles strewn in a ball; coordinates that float32 holds, or does not."""
    rng = stream(3, "crumbs")
    corners = rng.normal(size=(150, 1, 3)) + 0.2 * rng.normal(size=(150, 3, 3))
    if not fine:
        corners = corners.astype(np.float32).astype(float)
    mesh = TriMesh.of_part(corners.reshape(-1, 3), np.arange(450).reshape(-1, 3), OTHER)
    turned = np.linalg.qr(rng.normal(size=(4, 3, 3)))[0]
    place = np.concatenate([turned, 3 * rng.normal(size=(4, 3, 1))], axis=2)
    some = np.arange(4)
    return SceneGeometry((mesh,), place, np.zeros(4, np.int64), ("x",) * 4, some, some)


def beams(count, rays=19, width=0.0005):
    """Rays of narrow beams from a point outside, one beam after the other, as a scanner's mirror has them."""
    column, row = np.divmod(np.arange(count), 20)
    axis = np.stack([np.ones(count), 0.04 * (column - count / 40), 0.003 * (row - 10)], axis=1)
    way = axis[:, None] + width * stream(4, "beams").normal(size=(count, rays, 3))
    way = way.reshape(-1, 3) / np.linalg.norm(way.reshape(-1, 3), axis=1)[:, None]
    return np.tile([-12.0, 0.3, 0.1], (len(way), 1)), way


@pytest.mark.medium
@pytest.mark.parametrize("fine", [False, True])
def test_rays_of_beams_meet_what_brute_force_says(fine):
    scene = crumbs(fine)
    origin, way = beams(300)
    found, right = EmbreeCaster(scene).cast(origin, way), BruteCaster(scene).cast(origin, way)
    assert 0.2 < right.found.mean() < 0.9
    np.testing.assert_array_equal(found.found, right.found)
    there = right.found
    np.testing.assert_allclose(found.distance[there], right.distance[there], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.triangle, right.triangle)
    assert (scene.table.vertices.dtype == np.float32) is not fine


def test_beams_in_any_order_meet_the_same():
    origin, way = beams(300)
    caster, order = EmbreeCaster(crumbs(False)), stream(5, "order").permutation(300 * 19)
    beside, apart = caster.cast(origin, way).select(order), caster.cast(origin[order], way[order])
    np.testing.assert_array_equal(beside.distance, apart.distance)
    np.testing.assert_array_equal(beside.triangle, apart.triangle)


def test_only_rays_side_by_side_go_together():
    origin, way = (rays.T.copy() for rays in beams(215))
    assert lanes_for(origin, way) == ALIKE
    rng = stream(6, "apart")
    assert lanes_for(origin + rng.normal(size=origin.shape), way) == LONE
    assert lanes_for(origin, rng.normal(size=way.shape)) == LONE
