"""Sensors by rules: clear of trunks, above the ground, within the field; the same for the same seed."""

import numpy as np
import pytest

from forest_addon import spec
from forest_addon.base.rng import stream
from forest_addon.spec import SpecError
from headless.dataset.place import heights_of, place_sensors, terrain_of
from headless.dataset.settings import Ground, Placing

FIELD = spec.Forest(size=(20.0, 20.0), origin=(100.0, -50.0), margin=10.0)
TRUNKS = stream(1, "trunks").uniform([100, -50], [120, -30], (25, 2))
GROUND = terrain_of(*heights_of(Ground(relief=3.0, wavelength=10.0), 4, FIELD))


def placed(sensor, **rule):
    scene = spec.Scene(seed=9, forest=FIELD, sensors=(sensor,))
    rules = [Placing(sensor=sensor.name, **rule)]
    found, files = place_sensors(scene, rules, TRUNKS, GROUND)
    again, _ = place_sensors(scene, rules, TRUNKS, GROUND)
    assert found == again
    return found.sensors, files


def to_trunks(points):
    return np.linalg.norm(np.array(points)[:, None, :2] - TRUNKS, axis=2).min(axis=1)


@pytest.mark.parametrize(("rule", "count"), [("centre", 1), ("corners", 4), ("scattered", 6)])
def test_tripods_keep_clear_of_trunks_and_stand_above_the_ground(rule, count):
    sensors, _ = placed(spec.Terrestrial(name="tls"), rule=rule, count=6, clear=1.0, apart=3.0)
    points = np.array([sensor.position for sensor in sensors])
    assert len(points) == count == len({sensor.name for sensor in sensors})
    assert (to_trunks(points) >= 1.0).all()
    assert np.allclose(points[:, 2] - GROUND.height(points[:, :2]), 1.6)
    if rule == "scattered":
        gaps = np.linalg.norm(points[:, None] - points, axis=2) + 99 * np.eye(count)
        assert gaps.min() >= 3.0


def test_a_path_goes_round_trunks_at_its_speed():
    (sensor,), _ = placed(spec.Mobile(name="mls"), rule="path", clear=0.5, speed=2.0)
    points = np.array([pose.position for pose in sensor.poses])
    times = np.array([pose.time for pose in sensor.poses])
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.allclose(length / np.diff(times), 2.0)
    assert to_trunks(points).min() > 0.3
    assert np.allclose(points[:, 2] - GROUND.height(points[:, :2]), 1.6)


def test_a_bats_route_is_a_file_and_pairs_stand_apart():
    (sensor,), files = placed(spec.Sonar(name="bat"), rule="path", count=5)
    lines = files[sensor.route].splitlines()
    assert len(lines) == 6
    pairs, _ = placed(spec.Reverb(name="hall"), rule="pairs", count=3, distance=7.0)
    for pair in pairs:
        assert np.linalg.norm(np.subtract(pair.source, pair.receiver)) == pytest.approx(7.0)
        assert to_trunks([pair.source, pair.receiver]).min() >= 0.8


def test_strips_cover_the_field():
    (flight,), _ = placed(
        spec.Airborne(name="uav", spacing=8.0), rule="over", height=60.0, inset=-5.0
    )
    assert flight.track == pytest.approx(30.0)
    assert flight.strips == 4
    assert flight.position[:2] == pytest.approx((110 - 12, -55))


def test_a_rule_that_a_sensor_cannot_follow_is_refused():
    with pytest.raises(SpecError, match="airborne"):
        placed(spec.Airborne(name="als"), rule="centre")


def test_the_ground_has_its_relief_on_the_field():
    heights, low, size = heights_of(Ground(relief=3.0, wavelength=10.0), 4, FIELD)
    x = low[0] + (np.arange(heights.shape[1]) + 0.5) * size[0] / heights.shape[1]
    y = low[1] + (np.arange(heights.shape[0])[::-1] + 0.5) * size[1] / heights.shape[0]
    field = heights[np.ix_((y >= -50) & (y <= -30), (x >= 100) & (x <= 120))]
    assert field.min() == pytest.approx(0.0, abs=1e-12)
    assert field.max() == pytest.approx(3.0)
