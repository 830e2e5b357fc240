"""Environments as Gymnasium knows them: ids, its own checks, and what answers misuse; without Blender."""

import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

gym = pytest.importorskip("gymnasium")

from gymnasium import error
from gymnasium.utils.env_checker import check_env

from forest_addon.flight import ENVIRONMENTS
from forest_addon.flight.environment import FlightEnv, FlightVectorEnv, PoissonEnv
from forest_addon.flight.stems import poisson_forests
from forest_addon.spec import SpecError

POISSON, POLE = "ForestSensing/Poisson-v0", "ForestSensing/Pole-v0"
QUICK = {"density": 0.05, "distance": 10.0}
PLAIN = ["ForestSensing/Passage-v0", POISSON, POLE]  # these need no Blender


@pytest.mark.slow
@pytest.mark.parametrize("name", PLAIN)
def test_gymnasium_finds_nothing_to_complain_of(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = gym.make(name, **({"render_mode": "rgb_array"} if name == POISSON else {}))
        check_env(made.unwrapped)
        again = gym.make(made.spec)
        first, other = (env.reset(seed=3)[0] for env in (made, again))
        step = (made.action_space.sample(),)
        first, other = ([first, *env.step(*step)][:3] for env in (made, again))
        made.close()
    assert gym.utils.env_checker.data_equivalence(first, other)


def test_all_are_registered_and_the_readme_says_how():
    assert set(ENVIRONMENTS) <= set(gym.registry)
    for page in ("README.md", "docs/flight.md"):
        text = (Path(__file__).parents[2] / page).read_text("utf-8")
        assert re.search(r"import .*forest_addon\.flight", text)
        assert set(re.findall(r"ForestSensing/[\w-]+", text)) <= set(ENVIRONMENTS)
    assert "Flight-v0" in text


def test_a_module_in_the_name_is_import_enough():
    code = f"import gymnasium; print(gymnasium.make('forest_addon.flight:{POISSON}').spec.id)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.split() == [POISSON], done.stderr


def begun(make=gym.make, **given):
    env = make(POISSON, **QUICK, **given)
    env.reset(seed=1)
    return env


def over():
    """Return an environment whose flight has ended."""
    env = gym.make(POISSON, density=0.0, distance=2.0)
    env.reset(seed=1)
    while not any(env.step(np.zeros(1))[2:4]):
        pass
    return env


def many():
    return begun(gym.make_vec, num_envs=2)


def heard(guess):
    env = gym.make(POLE)
    env.reset(seed=1)
    env.step(guess)
    return env


MISUSES = {
    "a step before reset": (lambda: gym.make(POISSON).step(np.zeros(1)), error.ResetNeeded),
    "the same without wrappers": (lambda: PoissonEnv().step(np.zeros(1)), error.ResetNeeded),
    "a picture before reset": (
        lambda: gym.make(POISSON, render_mode="rgb_array").render(),
        error.ResetNeeded,
    ),
    "that without wrappers": (
        lambda: PoissonEnv(render_mode="rgb_array").render(),
        error.ResetNeeded,
    ),
    "a step after the end": (lambda: over().step(np.zeros(1)), error.ResetNeeded),
    "a second guess": (lambda: heard(1).step(1), error.ResetNeeded),
    "many before reset": (
        lambda: gym.make_vec(POISSON, num_envs=2).step(np.zeros((2, 1))),
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
    "another version": (lambda: gym.make("ForestSensing/Flight-v9"), error.VersionNotFound),
    "another name": (lambda: gym.make("ForestSensing/Fly-v0"), error.NameNotFound),
    "another maker": (lambda: gym.make("Forest/Flight-v0"), error.NamespaceNotFound),
    "an unknown argument": (lambda: gym.make(POISSON, trees=3), TypeError),
    "steps after closing": (lambda: closed().step(np.zeros((2, 1))), error.ClosedEnvironmentError),
    # What Gymnasium has no error for is told as a scene file is.
    "an unknown option": (lambda: begun().reset(options={"begin": 3}), SpecError),
    "options that are none": (lambda: begun().reset(options=[3]), SpecError),
    "a forest of halves": (lambda: begun().reset(options={"forest": 1.5}), SpecError),
    "a heading in words": (lambda: begun().reset(options={"heading_deg": "east"}), SpecError),
    "a plane start": (lambda: begun().reset(options={"start": (1, 2)}), SpecError),
    "a negative density": (lambda: gym.make(POISSON, density=-1.0), SpecError),
    "no speed": (lambda: gym.make(POISSON, speed=0.0), SpecError),
    "a hedge behind": (lambda: gym.make(POLE, distance=-1.0), SpecError),
    "a pole of no width": (lambda: gym.make(POLE, width=float("nan")), SpecError),
    "an unknown sense": (lambda: gym.make(POISSON, sensors=("smell",)), SpecError),
    "a scene that is none": (lambda: FlightEnv(5), SpecError),
}


def closed():
    env = many()
    env.close()
    env.close()  # twice is once
    return env


@pytest.mark.medium
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
