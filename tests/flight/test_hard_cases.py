"""What a user may do to an environment, and what it answers."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("gymnasium")

from forest_addon import api as forest
from forest_addon.flight.environment import FlightEnv, FlightVectorEnv
from forest_addon.spec import Flight, SpecError

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


@pytest.fixture(scope="module")
def one():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return FlightEnv(ONE, sensors=("lidar",))


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
