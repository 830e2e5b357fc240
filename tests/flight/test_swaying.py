"""Flyers among trees that sway: what they sense and touch at a time is what is there then."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("gymnasium")

from forest_addon import api as forest
from forest_addon.flight.environment import FlightEnv
from forest_addon.flight.obstacles import distances
from forest_addon.flight.senses import SONAR
from forest_addon.spec import Flight

STEP, SEED = 0.25, 11  # s: whole frames of 1/24 s
SCENE = forest.Scene(
    seed=4,
    wind=forest.Wind(speed=12.0),
    flight=Flight(
        distance=15.0,
        steps=60,
        step=STEP,
        start_low=(0.0, 0.0),
        start_high=(1.0, 1.0),
        thinnest=0.0,
        radius=0.02,
    ),
    forest=forest.Forest(size=(14.0, 12.0), margin=5.0),
    plantings=(forest.Planting(species="hazelnut", variants=2, expected=5, exact=True),),
)


@pytest.fixture(scope="module")
def env():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    ears = SONAR.changed(wood=False, band=(60e3, 70e3), max_range=3.0, doppler=True)
    return FlightEnv(SCENE, sensors=("lidar", "sonar"), sonar=ears)


@pytest.mark.slow
def test_a_step_senses_the_trees_of_its_moment(env):
    """To the bit: scan and ping at the flyer's pose in Blender, at the frame of that time."""
    env.reset(seed=SEED)
    for _ in range(2):
        told = env.step(np.array([0.3, -0.4, 0.2]))[0]
    flyers, world = env.flights.flyers, env.world()
    bpy.context.scene.render.fps = 24
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + round(2 * STEP * 24))
    scanner = flyers.lidar.scanner.changed(poses=(flyers.lidar.pose(flyers.state),))
    cloud = world.scan(scanner).found
    truth = np.full(flyers.lidar.rays, scanner.max_range)
    truth[cloud.pulse] = cloud.true_range
    assert len(cloud) > 10
    assert np.array_equal(told["lidar"], truth)
    heard = world.ping(flyers.ears.settings(flyers.state)).pings[0]
    ours = flyers.ears.ping(flyers.world, flyers.state, time=float(flyers.time[0]))
    assert heard.heard.instance.size > 10
    assert np.array_equal(ours.waveforms, heard.waveforms)
    rest = flyers.lidar.look(flyers.world, flyers.state, np.zeros(1), np.array([7.0]))[0]
    assert not np.array_equal(rest, told["lidar"])  # another moment is another


@pytest.mark.slow
def test_the_first_touch_is_that_of_the_moment(env):
    """Against every triangle, put in its place one by one."""
    env.reset(seed=SEED)
    world, time = env.flights.surroundings, 3.7
    sway, scene = world.sway, world.geometry
    number = sway.number
    rows = np.flatnonzero([int(tree) in number for tree in scene.tree])
    corners = []
    for row in rows.tolist():
        tree, mesh = number[int(scene.tree[row])], int(scene.mesh_index[row])
        own = world.stock.solids[mesh].corners
        piece = sway.pieces_at(tree, own.mean(axis=1), np.full(len(own), -1))
        place, stands = sway.moment(tree, time)[0][piece], scene.transform[row]
        moved = np.einsum("tij,tkj->tki", place[:, :, :3], own) + place[:, None, :, 3]
        corners.append(moved @ stands[:, :3].T + stands[:, 3])
    corners = np.concatenate(corners)
    rng = np.random.default_rng(0)
    ends = corners[rng.integers(len(corners), size=12), 0] + rng.normal(0, 0.05, (12, 3))
    start = ends + rng.normal(0, 0.3, (12, 3))
    now = world.obstacles.at(time)
    share, room = now.touch(start, ends, 0.05), now.room(start)
    for k in range(12):
        away = distances(start[k], corners).min()
        assert room[k] <= away + 1e-9
        if away <= 0.05:
            assert share[k] == 0.0
        elif np.isfinite(share[k]):
            there = start[k] + share[k] * (ends[k] - start[k])
            assert distances(there, corners).min() == pytest.approx(0.05, abs=1e-6)
        else:
            along = start[k] + np.linspace(0, 1, 41)[:, None] * (ends[k] - start[k])
            assert min(distances(spot, corners).min() for spot in along) > 0.05 - 1e-9
    assert np.isfinite(share).sum() > 4
    assert not np.array_equal(share, world.obstacles.at(time + 1.0).touch(start, ends, 0.05))
