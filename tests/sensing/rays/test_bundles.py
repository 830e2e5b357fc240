"""Verdicts on bundles of rays, found without a look at any ray, against every ray in float64."""

import numpy as np
import pytest
from references.lidar_scenes import ground, scene_with, wall
from references.rays_brute import BruteCaster

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.sensing.rays.bundles import MOST, NOTHING, UNKNOWN, Faces

BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def box(low, size):
    triangles = np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))])
    return TriMesh.of_part(BOX * size + low, triangles, OTHER)


def soup(rng, count, size):
    corners = rng.uniform(-20, 20, (count, 1, 3)) + rng.normal(0, size, (count, 3, 3))
    return TriMesh.of_part(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), OTHER)


def scenes():
    rng = stream(1, "test", "bundles")
    wire = box((9.0, -0.00005, 0.0), (0.0001, 0.0001, 30.0))
    return {
        "ground and boxes": [ground(80.0), box((5, 5, 0), (3, 3, 3)), box((-9, 2, 0), (1, 6, 4))],
        "a wire before a wall": [wall(12.0, 40.0), wire],
        "two walls in one plane": [wall(12.0, 40.0), wall(12.0, 20.0), wall(13.0, 60.0)],
        "large triangles anywhere": [soup(rng, 60, 6.0)],
        "small triangles anywhere": [ground(60.0), soup(rng, 400, 0.5)],
        "nothing": [],
    }


@pytest.mark.medium
@pytest.mark.parametrize("name", list(scenes()))
@pytest.mark.parametrize(
    ("radius", "spread", "moves"), [(0.0, 0.0, 0.0), (0.01, 0.002, 2.0), (0.3, 0.03, 0.0)]
)
def test_all_rays_of_a_bundle_meet_what_is_said(name, radius, spread, moves):
    scene = scene_with(*scenes()[name])
    rng = stream(2, "test", "bundles", name)
    az, el = np.meshgrid(np.linspace(-0.8, 0.8, 25), np.linspace(-0.6, 0.5, 19))
    az, el = az.ravel(), el.ravel()
    axis = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], 1)
    origin = np.array([0.0, 0.0, 1.5]) + moves * rng.random((len(axis), 3))
    faces = Faces(scene)
    met = faces.met(origin, axis, radius, spread)
    known = np.flatnonzero(met != UNKNOWN)
    # rays on the rim, where a bundle ends, and within it
    count = 24
    aside = rng.normal(size=(len(known), count, 3))
    aside -= np.einsum("pki,pi->pk", aside, axis[known])[:, :, None] * axis[known, None]
    aside /= np.linalg.norm(aside, axis=2, keepdims=True)
    turn = spread * np.where(np.arange(count) % 2, 1.0, rng.random(count))[:, None]
    ways = np.cos(turn) * axis[known, None] + np.sin(turn) * aside
    start = rng.normal(size=ways.shape)
    start *= radius * rng.random((1, count, 1)) / np.linalg.norm(start, axis=2, keepdims=True)
    start += origin[known, None]
    hits = BruteCaster(scene).cast(start.reshape(-1, 3), ways.reshape(-1, 3))
    said = np.repeat(met[known], count)
    assert not hits.found[said == NOTHING].any()
    named = said >= 0
    assert (hits.instance[named] == faces.instance[said[named]]).all()
    assert (hits.triangle[named] == faces.triangle[said[named]]).all()
    if name == "nothing":
        assert (met == NOTHING).all()
    elif spread < 0.01 and name.startswith(("ground", "a wire")):
        assert len(known) > 0.8 * len(axis)  # else the promise above is of nothing
        assert (met >= 0).sum() > 0.1 * len(axis)


def test_faces_in_one_plane_are_told_by_rays():
    faces = Faces(scene_with(wall(12.0, 40.0), wall(12.0, 20.0)))
    ahead = np.array([[1.0, 0.2, 0.2]]) / np.sqrt(1.08)
    assert faces.met(np.array([[0.0, 0.0, 1.5]]), ahead, 0.0, 1e-4) == UNKNOWN


def test_flat_instances_and_triangles_without_area_are_not_met():
    scene = scene_with(wall(5.0), wall(9.0))
    scene.transform[0, 1, 1] = 0.0  # flat
    ahead = np.array([[1.0, 0.02, 0.01]])
    ahead /= np.linalg.norm(ahead)
    faces = Faces(scene)
    met = faces.met(np.array([[0.0, 0.0, 1.5]]), ahead, 0.0, 1e-4)
    assert faces.instance[met] == 1


def test_a_scene_of_many_triangles_is_left_to_rays():
    few = soup(stream(3, "test", "bundles"), 10, 1.0)
    assert Faces.of(scene_with(few)) is not None
    many = soup(stream(3, "test", "bundles"), MOST + 1, 1.0)
    assert Faces.of(scene_with(many)) is None
