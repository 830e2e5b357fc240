"""Gymnasium's rules, the same numbers as the sensors elsewhere, and what may go wrong."""

import re
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
gymnasium = pytest.importorskip("gymnasium")


from gymnasium import error
from gymnasium.utils.env_checker import check_env

import forest_addon
from forest_addon import api as forest
from forest_addon.flight import ENVIRONMENTS
from forest_addon.flight.environment import FlightEnv, FlightVectorEnv, PoissonEnv
from forest_addon.flight.obstacles import distances
from forest_addon.flight.senses import SONAR, LidarSense, degrees
from forest_addon.flight.stems import poisson_forests
from forest_addon.spec import Beam, Flight, Mobile, Noise, Pose, Sonar, SpecError

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


def posed(sensor, state):
    """The settings of a flyer's scanner or sonar at its pose."""
    heading, pitch, roll = degrees(state, 0)
    place = tuple(state.position[0].tolist())
    if isinstance(sensor, Sonar):
        return sensor.changed(position=place, azimuth_deg=heading, elevation_deg=pitch)
    pose = Pose(position=place, heading_deg=heading, pitch_deg=pitch, roll_deg=roll)
    return sensor.changed(poses=(pose,))


@pytest.mark.parametrize(
    "scanner",
    [
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
    ids=["zigzag", "noisy"],
)
def test_any_pattern_is_that_of_the_scanner(env, scanner):
    env.reset(seed=12)
    flyers, lidar = env.flights.flyers, LidarSense(scanner)
    seed = 77
    state = flyers.state
    told = lidar.look(flyers.world, state, np.array([seed]))[0]
    world = env.world()
    world.scene = world.scene.changed(seed=seed)
    cloud = world.scan(posed(scanner, state)).found
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
def test_pictures_of_many_flyers():
    many = FlightVectorEnv(2, SCENE, sensors=(), render_mode="rgb_array")
    assert many.render() is None
    many.reset(seed=1)
    many.step(np.zeros((2, 3)))
    one, other = many.render()
    assert one.shape == other.shape
    assert one.dtype == np.uint8
    assert len(np.unique(one.reshape(-1, one.shape[2]), axis=0)) >= 4
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
    seen = {name: fly(made, 2, steps=5) for name, made in ways.items()}
    assert same(seen["still"], seen["calm"])
    assert not same(seen["still"], seen["windy"])
    assert same(fly(ways["windy"], 2, steps=5), seen["windy"])
    gusts = ways["windy"].flights.flyers.world.gusts
    made = FlightEnv(SCENE.changed(wind=forest.Wind(speed=9.0)))
    made.reset(seed=3)
    assert not np.array_equal(made.flights.flyers.world.gusts.phase, gusts.phase)
    state = ways["windy"].flights.flyers.state
    ground = made.flights.flyers.world.ground(state.position[:, :2])
    above = state.position - [0.0, 0.0, ground[0]]
    assert 0 < gusts.mean(above[:, 2])[0] < 9.0 or above[0, 2] > gusts.height


# ----------------------------------------------------------------------------------------------- gym
# Environments as Gymnasium knows them: ids, its own checks, and what answers misuse; without Blender.

POISSON, POLE = "ForestSensing/Poisson-v0", "ForestSensing/Pole-v0"
QUICK = {"density": 0.05, "distance": 10.0}
PLAIN = ["ForestSensing/Passage-v0", POISSON, POLE]  # these need no Blender


@pytest.mark.slow
@pytest.mark.parametrize("name", PLAIN)
def test_gymnasium_finds_nothing_to_complain_of(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = gymnasium.make(name, **({"render_mode": "rgb_array"} if name == POISSON else {}))
        check_env(made.unwrapped)
        again = gymnasium.make(made.spec)
        first, other = (env.reset(seed=3)[0] for env in (made, again))
        step = (made.action_space.sample(),)
        first, other = ([first, *env.step(*step)][:3] for env in (made, again))
        made.close()
    assert gymnasium.utils.env_checker.data_equivalence(first, other)


def test_all_are_registered_and_the_readme_says_how():
    assert set(ENVIRONMENTS) <= set(gymnasium.registry)
    for page in ("README.md", "docs/flight.md"):
        text = (Path(__file__).parents[2] / page).read_text("utf-8")
        assert re.search(r"import .*forest_addon\.flight", text)
        assert set(re.findall(r"ForestSensing/[\w-]+", text)) <= set(ENVIRONMENTS)
    assert "Flight-v0" in text


def test_a_module_in_the_name_is_import_enough(monkeypatch):
    monkeypatch.setattr(forest_addon, "flight", forest_addon.flight)
    monkeypatch.delitem(sys.modules, "forest_addon.flight")
    for name in ENVIRONMENTS:
        monkeypatch.delitem(gymnasium.registry, name)
    with pytest.raises(error.UnregisteredEnv):
        gymnasium.make(POISSON)
    assert gymnasium.make(f"forest_addon.flight:{POISSON}").spec.id == POISSON


def begun(make=gymnasium.make, **given):
    env = make(POISSON, **QUICK, **given)
    env.reset(seed=1)
    return env


def over():
    """Return an environment whose flight has ended."""
    env = gymnasium.make(POISSON, density=0.0, distance=2.0)
    env.reset(seed=1)
    while not any(env.step(np.zeros(1))[2:4]):
        pass
    return env


def many():
    return begun(gymnasium.make_vec, num_envs=2)


def heard(guess):
    env = gymnasium.make(POLE)
    env.reset(seed=1)
    env.step(guess)
    return env


MISUSES = {
    "a step before reset": (lambda: gymnasium.make(POISSON).step(np.zeros(1)), error.ResetNeeded),
    "the same without wrappers": (lambda: PoissonEnv().step(np.zeros(1)), error.ResetNeeded),
    "a picture before reset": (
        lambda: gymnasium.make(POISSON, render_mode="rgb_array").render(),
        error.ResetNeeded,
    ),
    "that without wrappers": (
        lambda: PoissonEnv(render_mode="rgb_array").render(),
        error.ResetNeeded,
    ),
    "a step after the end": (lambda: over().step(np.zeros(1)), error.ResetNeeded),
    "a second guess": (lambda: heard(1).step(1), error.ResetNeeded),
    "many before reset": (
        lambda: gymnasium.make_vec(POISSON, num_envs=2).step(np.zeros((2, 1))),
        error.ResetNeeded,
    ),
    "too many numbers": (lambda: begun().step(np.zeros(2)), error.InvalidAction),
    "a bare number": (lambda: begun().step(0.5), error.InvalidAction),
    "no action": (lambda: begun().step(None), error.InvalidAction),
    "words": (lambda: begun().step(["left"]), error.InvalidAction),
    "complex numbers": (lambda: begun().step(np.ones(1) * 1j), error.InvalidAction),
    "ragged rows": (lambda: many().step([[0.0], [0.0, 1.0]]), error.InvalidAction),
    "not a number": (lambda: begun().step(np.array([np.nan])), error.InvalidAction),
    "out of space": (lambda: begun().step(np.array([1.5])), error.InvalidAction),
    "one action for two": (lambda: many().step(np.zeros((1, 1))), error.InvalidAction),
    "half a guess": (lambda: heard(0.5), error.InvalidAction),
    "a negative seed": (lambda: begun().reset(seed=-1), error.Error),
    "a seed of halves": (lambda: begun().reset(seed=1.5), error.Error),
    "a seed in words": (lambda: many().reset(seed="one"), error.Error),
    "a seed too few": (lambda: many().reset(seed=[1]), error.Error),
    "a negative one among seeds": (lambda: many().reset(seed=[1, -2]), error.Error),
    "an unknown mode": (lambda: PoissonEnv(render_mode="ansi"), error.UnsupportedMode),
    "a window for many": (
        lambda: FlightVectorEnv(2, poisson_forests(0.1, 4.0, 9.0), render_mode="human"),
        error.UnsupportedMode,
    ),
    "another version": (lambda: gymnasium.make("ForestSensing/Flight-v9"), error.VersionNotFound),
    "another name": (lambda: gymnasium.make("ForestSensing/Fly-v0"), error.NameNotFound),
    "another maker": (lambda: gymnasium.make("Forest/Flight-v0"), error.NamespaceNotFound),
    "an unknown argument": (lambda: gymnasium.make(POISSON, trees=3), TypeError),
    "steps after closing": (lambda: closed().step(np.zeros((2, 1))), error.ClosedEnvironmentError),
    # What Gymnasium has no error for is told as a scene file is.
    "an unknown option": (lambda: begun().reset(options={"begin": 3}), SpecError),
    "options that are none": (lambda: begun().reset(options=[3]), SpecError),
    "a forest of halves": (lambda: begun().reset(options={"forest": 1.5}), SpecError),
    "a heading in words": (lambda: begun().reset(options={"heading_deg": "east"}), SpecError),
    "a plane start": (lambda: begun().reset(options={"start": (1, 2)}), SpecError),
    "a negative density": (lambda: gymnasium.make(POISSON, density=-1.0), SpecError),
    "no speed": (lambda: gymnasium.make(POISSON, speed=0.0), SpecError),
    "a hedge behind": (lambda: gymnasium.make(POLE, distance=-1.0), SpecError),
    "a pole of no width": (lambda: gymnasium.make(POLE, width=float("nan")), SpecError),
    "an unknown sense": (lambda: gymnasium.make(POISSON, sensors=("smell",)), SpecError),
    "a scene that is none": (lambda: FlightEnv(5), SpecError),
}


def closed():
    env = many()
    env.close()
    env.close()  # twice is once
    return env


@pytest.mark.parametrize(("do", "kind"), MISUSES.values(), ids=MISUSES)
def test_misuse_gets_an_error_that_says_so(do, kind):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Gymnasium warns first
        with pytest.raises(kind) as said:
            do()
    assert issubclass(type(said.value), error.Error) == issubclass(kind, error.Error)
    assert "\n" not in str(said.value)


def test_a_picture_without_a_mode_is_warned_of():
    env = begun()
    with pytest.warns(UserWarning, match="draws nothing without a mode"):
        assert env.unwrapped.render() is None
    env.close()
    env.close()


def test_a_refused_action_leaves_the_flight_as_it_was():
    for env, action in ((begun(), np.array([0.4])), (many(), np.array([[0.4], [-0.2]]))):
        env.step(action)
        flyers = env.unwrapped.flights.flyers
        before, steps = [values.copy() for values in vars(flyers.state).values()], flyers.steps[0]
        with pytest.raises(error.InvalidAction):
            env.step(np.full_like(action, np.inf))
        after = vars(flyers.state).values()
        assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
        assert flyers.steps[0] == steps


# ------------------------------------------------------------------------------------------- swaying
# Flyers among trees that sway: what they sense and touch at a time is what is there then.

STEP, SEED = 0.25, 11  # s: whole frames of 1/24 s
SWAYING_SCENE = forest.Scene(
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
def swaying_env():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    ears = SONAR.changed(wood=False, band=(60e3, 70e3), max_range=3.0, doppler=True)
    return FlightEnv(SWAYING_SCENE, sensors=("lidar", "sonar"), sonar=ears)


@pytest.mark.medium
@pytest.mark.parametrize("flown", ["env", pytest.param("swaying_env", marks=pytest.mark.slow)])
def test_a_step_senses_what_the_sensors_find_there(request, flown):
    """To the bit: scan and ping at the flyer's pose and its time, in the same forest built in Blender."""
    env = request.getfixturevalue(flown)
    env.reset(seed=SEED)
    for turn in (0.3, -0.8):
        told = env.step(np.array([turn, 0.4, 0.2]))[0]
    flyers, world = env.flights.flyers, env.world()
    bpy.context.scene.render.fps = 24
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + round(2 * STEP * 24))
    scanner = posed(flyers.lidar.scanner, flyers.state)
    cloud = world.scan(scanner).found
    assert len(cloud) > 10
    truth = np.full(flyers.lidar.rays, scanner.max_range)
    truth[cloud.pulse] = cloud.true_range
    assert np.array_equal(told["lidar"], truth)
    heard = world.ping(posed(flyers.ears.sonar, flyers.state)).pings[0]
    ours = flyers.ears.ping(flyers.world, flyers.state, time=float(flyers.time[0]))
    assert heard.heard.instance.size > 10
    assert np.array_equal(ours.waveforms, heard.waveforms)
    level = flyers.ears.listen(flyers.world, flyers.state, time=flyers.time)[0]
    assert np.array_equal(told["sonar"], level)
    assert level.max() > 0.02
    rest = flyers.lidar.look(flyers.world, flyers.state, np.zeros(1), np.array([7.0]))[0]
    assert np.array_equal(rest, told["lidar"]) == (flown == "env")  # another moment in the wind


@pytest.mark.slow
def test_the_first_touch_is_that_of_the_moment(swaying_env):
    """Against every triangle, put in its place one by one."""
    swaying_env.reset(seed=SEED)
    world, time = swaying_env.flights.flyers.world, 3.7
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
    ends = corners[rng.integers(len(corners), size=8), 0] + rng.normal(0, 0.05, (8, 3))
    start = ends + rng.normal(0, 0.3, (8, 3))
    now = world.obstacles.at(time)
    share, room = now.touch(start, ends, 0.05), now.room(start)
    for k in range(8):
        away = distances(start[k], corners).min()
        assert room[k] <= away + 1e-9
        if away <= 0.05:
            assert share[k] == 0.0
        elif np.isfinite(share[k]):
            there = start[k] + share[k] * (ends[k] - start[k])
            assert distances(there, corners).min() == pytest.approx(0.05, abs=1e-6)
        else:
            along = start[k] + np.linspace(0, 1, 21)[:, None] * (ends[k] - start[k])
            assert min(distances(spot, corners).min() for spot in along) > 0.05 - 1e-9
    assert np.isfinite(share).sum() > 2
    assert not np.array_equal(share, world.obstacles.at(time + 1.0).touch(start, ends, 0.05))


# ---------------------------------------------------------------------------------------- hard cases
# What a user may do to an environment, and what it answers.

BARE = forest.Scene(
    seed=2,
    forest=forest.Forest(size=(10.0, 10.0), margin=30.0),
    flight=Flight(distance=8.0, steps=50, start=(1.0, 5.0, 1.5)),
)
ONE = BARE.changed(
    plantings=(
        forest.Planting(species="whorl-8", variants=1, expected=1, exact=True, scale=(1.0, 1.0)),
    )
)


@pytest.fixture(scope="module")
def bare():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return FlightEnv(BARE, sensors=())


def test_no_trees_and_no_sensors(bare):
    seen, _ = bare.reset(seed=1)
    assert set(seen) == {"odometry"}
    assert seen["odometry"][:3] == pytest.approx([8, 0, 0])
    ends = [(False, False)]
    while not any(ends[-1]):
        ends.append(bare.step(np.array([0.0, 0.0, 1.0]))[2:4])
    assert ends[-1] == (True, False)  # it arrives


def test_the_ground_stops(bare):
    bare.reset(seed=1)
    for _ in range(60):
        _, _, done, _, info = bare.step(np.array([0.0, -1.0, 0.0]))
        if done:
            break
    assert info["crashed"]
    assert info["position"][2] == pytest.approx(0.15, abs=1e-9)  # the sphere lies on it


def test_a_field_in_tiles_is_refused():
    with pytest.raises(SpecError, match="take them away to fly"):
        FlightEnv(BARE.changed(tiles=forest.Tiles(size=5.0)), sensors=())


@pytest.mark.parametrize(
    ("do", "words"),
    [
        (
            lambda env: env.reset(options={"begin": 3}),
            '"begin" is not known; use one of forest, start',
        ),
        (lambda env: env.reset(options={"goal": (1, 2)}), "goal: must be three finite numbers"),
        (
            lambda _: FlightEnv(BARE, sensors=("smell",)),
            '"smell" is not known; use one of lidar, sonar',
        ),
        (lambda _: FlightEnv(BARE, forest="old"), '"old" is not known; use one of new, fixed'),
        (lambda _: FlightVectorEnv(0, BARE), "num_envs: 0 is out of range"),
        (lambda _: FlightEnv("nowhere.toml"), "no such file"),
    ],
)
def test_what_cannot_be_says_so(bare, do, words):
    with pytest.raises(SpecError) as said:
        do(bare)
    assert words in str(said.value)
    assert "\n" not in str(said.value)


@pytest.mark.medium
def test_a_fixed_forest_stays():
    env = FlightEnv(ONE, sensors=("lidar",), forest="fixed")
    first = env.reset(seed=1)[0]["lidar"]
    assert np.array_equal(first, env.reset(seed=2)[0]["lidar"])
    new = FlightEnv(ONE, sensors=("lidar",))
    assert not np.array_equal(new.reset(seed=1)[0]["lidar"], new.reset(seed=2)[0]["lidar"])


def test_what_stands_in_blender_is_flown_through():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(5, 5, 1.5))
    env = FlightEnv(forest.current(BARE), sensors=("lidar",))
    assert env.reset(seed=1)[0]["lidar"][0] == pytest.approx(3.5, abs=1e-6)
    for _ in range(40):
        info = env.step(np.array([0.0, 0.0, 1.0]))[4]
        if info["crashed"]:
            break
    assert info["position"][0] == pytest.approx(4.5 - 0.15, abs=1e-6)


def test_a_seed_may_be_left_out_among_seeds():
    assert many().reset(seed=[None, 1])[1]["position"].shape == (2, 3)
