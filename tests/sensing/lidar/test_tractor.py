"""SIMLIDAR's tractor in scenes whose every distance is known in closed form."""

import numpy as np
import pytest
from references.lidar_scenes import ground, scene_with, wall
from references.rays_brute import BruteCaster

from forest_addon.base.trimesh import GROUND, WOOD
from forest_addon.sensing.lidar import tractor as driven
from forest_addon.sensing.lidar.cloud import ESCAPED
from forest_addon.spec import Tractor

TRACTOR = Tractor(position=(1.0, 0.0, 1.0), track=0.1, step=0.002, gap=9, reach=5.0, top=4.0)


def test_the_fan_and_the_track_are_simlidars():
    angle, track = driven.fan(TRACTOR), driven.positions(TRACTOR)
    assert angle[0] == pytest.approx(-np.arctan(1 / 5))
    assert np.diff(angle) == pytest.approx(np.deg2rad(0.25))
    assert np.arctan(3 / 5) - np.deg2rad(0.25) < angle[-1] <= np.arctan(3 / 5) + 1e-12
    assert track == pytest.approx([0, 0.02, 0.04, 0.06, 0.08, 0.1])


def test_ground_and_sky_without_trees():
    scan = driven.drive(TRACTOR, BruteCaster(scene_with(ground())))
    down = scan.angle < 0
    # The lowest beam meets z = 0 at the reach; beams at or above the horizon escape.
    expected = 1.0 / np.sin(-scan.angle[down])
    seen = expected <= TRACTOR.max_range
    assert scan.distance[:, down][:, seen] == pytest.approx(np.tile(expected[seen], (6, 1)))
    assert np.isinf(scan.distance[:, down][:, ~seen]).all()
    assert np.isinf(scan.distance[:, ~down]).all()
    assert (scan.organ[:, ~down] == ESCAPED).all()
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
    scan = driven.drive(tractor, BruteCaster(scene_with(ground(), wall(x))))
    high = scan.angle > -np.arctan(1 / 5)  # lower beams meet the ground before the wall
    assert scan.distance[:, high] == pytest.approx(np.tile(5 / np.cos(scan.angle[high]), (6, 1)))
    assert (scan.organ[:, high] == WOOD).all()
    assert (scan.returns.tree.reshape(scan.organ.shape)[:, high] == 0).all()


def test_a_beam_that_begins_on_a_surface_has_a_finite_intensity():
    scan = driven.drive(TRACTOR, BruteCaster(scene_with(ground(), wall(-4.0))))
    met = np.flatnonzero(np.isfinite(scan.returns.distance))
    scan.returns.distance[met[:5]] = 0.0
    cloud = driven.to_cloud(scan, TRACTOR)
    assert np.isfinite(cloud.intensity).all()
    assert cloud.true_range[0] == 0
