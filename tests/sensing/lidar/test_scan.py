"""Scanners in scenes whose every distance is known in closed form."""

import numpy as np
import pytest
from references.lidar_scenes import ground, scene_with
from references.rays_brute import BruteCaster

from forest_addon.base.trimesh import GROUND, WOOD, TriMesh
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.lidar.scan import scan
from forest_addon.spec import Terrestrial


@pytest.mark.medium
def test_a_terrestrial_scan_of_ground_and_trunk():
    trunk = TriMesh.of_part(*tube(np.array([[5.0, 0, -1], [5.0, 0, 9]]), np.full(2, 0.2), 64), WOOD)
    scanner = Terrestrial(
        position=(0.0, 0.0, 1.5),
        azimuth_deg=(-10.0, 10.0),
        elevation_deg=(-30.0, 30.0),
        angle_step_deg=0.5,
        max_range=100.0,
    )
    cloud = scan(scanner, BruteCaster(scene_with(ground(), trunk)))
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
    cloud = scan(
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
    cloud = scan(scanner, BruteCaster(scene_with(ground())))
    assert np.isclose(cloud.returns.distance, 3.0).any()
    assert (cloud.returns.distance >= low).all()
    assert (cloud.returns.distance <= high).all()


def test_nothing_to_see():
    cloud = scan(Terrestrial(angle_step_deg=10.0), BruteCaster(scene_with()))
    assert len(cloud.position) == 0
    assert cloud.pulses > 0
