"""Scanners in scenes whose every distance is known in closed form."""

import numpy as np
import pytest
from references.rays_brute import BruteCaster

from forest_addon.growth.trimesh import GROUND, WOOD, TriMesh
from forest_addon.growth.tubes import tube
from forest_addon.sensing import lidar
from forest_addon.sensing.geometry import SceneGeometry
from forest_addon.spec import Terrestrial, Tractor


def scene_with(*meshes):
    count = len(meshes)
    return SceneGeometry(
        meshes=meshes,
        transform=np.tile(np.eye(3, 4), (count, 1, 1)),
        mesh_index=np.arange(count),
        object_name=("x",) * count,
        tree=np.arange(count) - 1,
        species=np.arange(count) - 1,
    )


def ground(extent=500.0):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * extent
    return TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), GROUND)


def wall(x, half=500.0):
    corners = np.array([[x, -half, 0], [x, half, 0], [x, half, half], [x, -half, half]])
    return TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), WOOD)


TRACTOR = Tractor(position=(1.0, 0.0, 1.0), track=0.1, step=0.002, gap=9, reach=5.0, top=4.0)


def test_the_fan_and_the_track_are_simlidars():
    angle, track = lidar.fan(TRACTOR), lidar.positions(TRACTOR)
    assert angle[0] == pytest.approx(-np.arctan(1 / 5))
    assert np.diff(angle) == pytest.approx(np.deg2rad(0.25))
    assert np.arctan(3 / 5) - np.deg2rad(0.25) < angle[-1] <= np.arctan(3 / 5) + 1e-12
    assert track == pytest.approx([0, 0.02, 0.04, 0.06, 0.08, 0.1])


def test_ground_and_sky_without_trees():
    scan = lidar.drive(TRACTOR, BruteCaster(scene_with(ground())))
    down = scan.angle < 0
    # The lowest beam meets z = 0 at the reach; beams at or above the horizon escape.
    expected = 1.0 / np.sin(-scan.angle[down])
    seen = expected <= TRACTOR.max_range
    assert scan.distance[:, down][:, seen] == pytest.approx(np.tile(expected[seen], (6, 1)))
    assert np.isinf(scan.distance[:, down][:, ~seen]).all()
    assert np.isinf(scan.distance[:, ~down]).all()
    assert (scan.organ[:, ~down] == lidar.ESCAPED).all()
    assert (scan.organ[:, down][:, seen] == GROUND).all()


@pytest.mark.parametrize(
    ("heading", "side", "x"), [(90, "right", 6.0), (-90, "left", 6.0), (90, "left", -4.0)]
)
def test_a_wall_beside_the_track(heading, side, x):
    tractor = Tractor(
        position=(1.0, 0.0, 1.0),
        track=0.1,
        gap=9,
        reach=8.0,
        top=4.0,
        heading_deg=heading,
        side=side,
    )
    scan = lidar.drive(tractor, BruteCaster(scene_with(ground(), wall(x))))
    high = scan.angle > -np.arctan(1 / 5)  # lower beams meet the ground before the wall
    assert scan.distance[:, high] == pytest.approx(np.tile(5 / np.cos(scan.angle[high]), (6, 1)))
    assert (scan.organ[:, high] == WOOD).all()
    assert (scan.returns.tree.reshape(scan.organ.shape)[:, high] == 0).all()


def test_a_terrestrial_scan_of_ground_and_trunk():
    trunk = TriMesh.of_part(*tube(np.array([[5.0, 0, -1], [5.0, 0, 9]]), np.full(2, 0.2), 64), WOOD)
    scanner = Terrestrial(
        position=(0.0, 0.0, 1.5),
        azimuth_deg=(-10.0, 10.0),
        elevation_deg=(-30.0, 30.0),
        angle_step_deg=0.5,
        max_range=100.0,
    )
    cloud = lidar.sweep(scanner, BruteCaster(scene_with(ground(), trunk)))
    assert cloud.pulses == 41 * 121
    organ = cloud.returns.organ
    assert cloud.position[organ == GROUND, 2] == pytest.approx(0, abs=1e-9)
    away = np.linalg.norm(cloud.position[organ == WOOD, :2] - [5, 0], axis=1)
    assert away == pytest.approx(0.2, abs=0.0005)
    assert cloud.position == pytest.approx(
        np.array(scanner.position)
        + cloud.returns.distance[:, None]
        * np.stack(
            [
                np.cos(cloud.elevation) * np.cos(cloud.azimuth),
                np.cos(cloud.elevation) * np.sin(cloud.azimuth),
                np.sin(cloud.elevation),
            ],
            axis=1,
        )
    )
    # Lambert: reflectance · cos / R².
    g = organ == GROUND
    cosine = np.sin(-cloud.elevation[g])
    assert cloud.intensity[g] == pytest.approx(0.5 * cosine / cloud.returns.distance[g] ** 2)


def test_a_full_circle_has_no_beam_twice():
    cloud = lidar.sweep(
        Terrestrial(angle_step_deg=5.0, elevation_deg=(-40.0, -10.0)),
        BruteCaster(scene_with(ground())),
    )
    assert cloud.pulses == 72 * 7
    assert len(np.unique(np.round(cloud.position, 6), axis=0)) == len(cloud.position)


@pytest.mark.parametrize(("low", "high"), [(0.0, 3.0), (3.0, 4.0), (2.9999, 3.0001)])
def test_ranges_are_kept_as_stated(low, high):
    scanner = Terrestrial(
        position=(0.0, 0.0, 3.0),
        azimuth_deg=(0.0, 1.0),
        elevation_deg=(-90.0, -89.0),
        angle_step_deg=1.0,
        min_range=low,
        max_range=high,
    )
    cloud = lidar.sweep(scanner, BruteCaster(scene_with(ground())))
    assert np.isclose(cloud.returns.distance, 3.0).any()
    assert (cloud.returns.distance >= low).all()
    assert (cloud.returns.distance <= high).all()


def test_nothing_to_see():
    cloud = lidar.sweep(Terrestrial(angle_step_deg=10.0), BruteCaster(scene_with()))
    assert len(cloud.position) == 0
    assert cloud.pulses > 0
