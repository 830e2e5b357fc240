"""Gymnasium's rules, the same numbers as the sensors elsewhere, and what may go wrong."""

import warnings

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env

import forest_addon.flight
from forest_addon import api as forest
from forest_addon.flight.environment import FlightEnv, FlightVectorEnv
from forest_addon.flight.senses import SONAR, LidarSense
from forest_addon.spec import Beam, Flight, Mobile, Noise

FLIGHT = Flight(distance=15.0, steps=60, start_low=(0.0, 0.0), start_high=(1.0, 1.0), thinnest=0.0)
SCENE = forest.Scene(
    seed=4,
    flight=FLIGHT,
    forest=forest.Forest(size=(14.0, 12.0), margin=5.0),
    plantings=(forest.Planting(species="hazelnut", variants=2, expected=5, exact=True),),
)


LEAVES = SONAR.changed(wood=False, band=(60e3, 70e3), max_range=3.0)  # quick


@pytest.fixture(scope="module")
def env():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return FlightEnv(SCENE, sensors=("lidar", "sonar"), sonar=LEAVES)


def fly(env, seed, steps=12, **options):
    """Observations and ends of some random steps."""
    rng = np.random.default_rng(seed)
    seen = [env.reset(seed=seed, options=options or None)[0]]
    for _ in range(steps):
        told, _, done, cut, _ = env.step(rng.uniform(-1, 1, env.action_space.shape))
        seen.append(told)
        if done or cut:
            break
    return seen


def same(one, other):
    return len(one) == len(other) and all(
        np.array_equal(a[k], b[k]) for a, b in zip(one, other, strict=True) for k in a
    )


@pytest.mark.slow
def test_gymnasium_finds_nothing_to_complain_of(env):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = gymnasium.make(
            forest_addon.flight.NAME, scene=SCENE, sensors=("lidar",), render_mode="rgb_array"
        )
        check_env(made.unwrapped)
        made.close()
    assert env.observation_space.contains(env.reset(seed=3)[0])


@pytest.mark.slow
def test_seeds_decide_everything(env):
    first, other = fly(env, 5), fly(env, 6)
    assert same(first, fly(env, 5))
    assert not same(first, other)
    fixed = fly(env, 5, forest=9)
    assert same(fixed, fly(env, 5, forest=9))
    assert not same(fixed, first)


@pytest.mark.medium
def test_a_step_senses_what_the_sensors_find_there(env):
    """To the bit: the scan and the ping at the flyer's pose, in the same forest built in Blender."""
    env.reset(seed=11)
    for turn in (0.3, -0.8):
        told = env.step(np.array([turn, 0.4, 0.2]))[0]
    flyers = env.flights.flyers
    world = env.world()
    scanner = flyers.lidar.scanner.changed(poses=(flyers.lidar.pose(flyers.state),))
    cloud = world.scan(scanner).found
    assert len(cloud) > 10
    truth = np.full(flyers.lidar.rays, scanner.max_range)
    truth[cloud.pulse] = cloud.true_range
    assert np.array_equal(told["lidar"], truth)
    heard = world.ping(flyers.ears.settings(flyers.state))
    ours = flyers.ears.ping(flyers.world, flyers.state)
    assert heard.pings[0].heard.instance.size > 10
    assert np.array_equal(ours.waveforms, heard.pings[0].waveforms)
    assert np.array_equal(told["sonar"], flyers.ears.listen(flyers.world, flyers.state)[0])
    assert told["sonar"].max() > 0.02


@pytest.mark.medium
@pytest.mark.parametrize(
    "scanner",
    [
        Mobile(
            pattern="spinning", channels=4, field_deg=(-20.0, 20.0), pulse_rate=2560, line_rate=20.0
        ),
        Mobile(
            pattern="zigzag",
            field_deg=(-60.0, 60.0),
            pulse_rate=960,
            line_rate=20.0,
            mount_deg=(0, 60, 0),
        ),
        Mobile(
            pattern="circles",
            field_deg=(0.0, 70.0),
            pulse_rate=640,
            line_rate=20.0,
            noise=Noise(range_sd=0.1),
            beam=Beam(subrays=7, divergence_mrad=(5, 5), max_returns=2),
        ),
    ],
    ids=["spinning", "zigzag", "noisy"],
)
def test_any_pattern_is_that_of_the_scanner(env, scanner):
    env.reset(seed=12)
    flyers, lidar = env.flights.flyers, LidarSense(scanner)
    seed = 77
    state = flyers.state
    told = lidar.look(flyers.world, state, np.array([seed]))[0]
    world = env.world()
    world.scene = world.scene.changed(seed=seed)
    cloud = world.scan(scanner.changed(poses=(lidar.pose(state),))).found
    first = cloud.number == 1
    truth = np.full(lidar.rays, scanner.max_range)
    truth[cloud.pulse[first]] = cloud.returns.distance[first]
    assert first.sum() > 10
    assert np.array_equal(told, truth)


@pytest.mark.medium
def test_many_flyers_fly_as_each_alone(env):
    many = FlightVectorEnv(3, SCENE, sensors=("lidar",))
    alone = FlightEnv(SCENE, sensors=("lidar",))
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (8, 3, 3))
    seen = [many.reset(seed=20)[0]]
    ends = []
    for action in actions:
        told, _, done, cut, _ = many.step(action)
        seen.append(told)
        ends.append(done | cut)
    for row in range(3):
        told = alone.reset(seed=20 + row, options={"forest": 20})[0]
        assert np.array_equal(told["lidar"], seen[0]["lidar"][row])
        for number, action in enumerate(actions):
            told = alone.step(action[row])[0]
            assert np.array_equal(told["odometry"], seen[number + 1]["odometry"][row])
            assert np.array_equal(told["lidar"], seen[number + 1]["lidar"][row])
            if ends[number][row]:
                break


@pytest.mark.medium
def test_the_noise_of_a_receiver_is_each_flyers_and_steps_own():
    receiver = forest.SonarReceiver(source_level_db=110.0, self_noise_db=60.0)
    carried = {"sensors": ("sonar",), "sonar": LEAVES.changed(receiver=receiver, max_range=1.0)}
    many = FlightVectorEnv(2, SCENE, heard="waveforms", **carried)
    alone = FlightEnv(SCENE, heard="waveforms", **carried)
    stay = np.zeros((2, *alone.action_space.shape))
    first, then = many.reset(seed=20)[0]["sonar"], many.step(stay)[0]["sonar"]
    assert np.array_equal(alone.reset(seed=21, options={"forest": 20})[0]["sonar"], first[1])
    assert np.array_equal(alone.step(stay[1])[0]["sonar"], then[1])
    records = np.stack([*first, *then])[:, 0]  # of which noise is nearly all
    alike = np.corrcoef(records) - np.eye(4)
    assert np.abs(alike).max() * np.sqrt(records.shape[1]) < 6


@pytest.mark.medium
def test_ended_flights_begin_anew_on_the_next_step():
    hits = Flight(distance=15.0, steps=3, start_low=(0.0, 0.0), start_high=(1.0, 1.0))
    many = FlightVectorEnv(2, SCENE, sensors=(), flight=hits)
    many.reset(seed=1)
    cuts = [many.step(np.zeros((2, 3)))[3].all() for _ in range(8)]
    assert cuts == [False, False, True, False, False, False, True, False]


@pytest.mark.medium
def test_pictures(env):
    drawn = FlightEnv(SCENE, sensors=(), render_mode="rgb_array")
    drawn.reset(seed=1)
    drawn.step(np.zeros(3))
    picture = drawn.render()
    assert picture.dtype == np.uint8
    assert picture.shape[2] == 3
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) >= 4


@pytest.mark.medium
def test_pictures_of_many_flyers():
    many = FlightVectorEnv(2, SCENE, sensors=(), render_mode="rgb_array")
    assert many.render() is None
    many.reset(seed=1)
    many.step(np.zeros((2, 3)))
    one, other = many.render()
    assert one.shape == other.shape
    assert not np.array_equal(one, other)


@pytest.mark.medium
def test_single_precision_is_the_same_flight_rounded(env):
    plain, half = (FlightEnv(SCENE, dtype=dtype) for dtype in ("float64", "float32"))
    assert half.observation_space["lidar"].dtype == half.action_space.dtype == np.float32
    assert all(
        np.isfinite([space.low, space.high]).all() for space in half.observation_space.values()
    )
    seen, rounded = plain.reset(seed=3)[0], half.reset(seed=3)[0]
    for _ in range(5):
        assert half.observation_space.contains(rounded)
        for name, values in seen.items():
            assert np.array_equal(values.astype(np.float32), rounded[name])
        seen, rounded = (e.step(np.array([0.25, 0.5, 0.125]))[0] for e in (plain, half))
    with pytest.raises(forest.SpecError, match="dtype"):
        FlightEnv(SCENE, dtype="float16")


@pytest.mark.slow
def test_the_wind_of_a_scene_carries_flyers_and_a_seed_repeats_it():
    """Another forest has other gusts; a wind of 0 is none, to the byte."""
    ways = {}
    for name, speed in (("still", None), ("calm", 0.0), ("windy", 9.0)):
        scene = SCENE if speed is None else SCENE.changed(wind=forest.Wind(speed=speed))
        ways[name] = FlightEnv(scene)
    seen = {name: fly(made, 2) for name, made in ways.items()}
    assert same(seen["still"], seen["calm"])
    assert not same(seen["still"], seen["windy"])
    assert same(fly(ways["windy"], 2), seen["windy"])
    gusts = ways["windy"].flights.surroundings.gusts
    made = FlightEnv(SCENE.changed(wind=forest.Wind(speed=9.0)))
    made.reset(seed=3)
    assert not np.array_equal(made.flights.surroundings.gusts.phase, gusts.phase)
    state = ways["windy"].flights.flyers.state
    ground = made.flights.surroundings.ground(state.position[:, :2])
    above = state.position - [0.0, 0.0, ground[0]]
    assert 0 < gusts.mean(above[:, 2])[0] < 9.0 or above[0, 2] > gusts.height
