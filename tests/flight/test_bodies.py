"""Bodies move within their limits, and as closed forms say."""

import numpy as np
import pytest

from forest_addon.flight.bodies import ACTIONS, GRAVITY, at_rest, move
from forest_addon.spec import Flight


def flown(flight, action, steps=200, count=1):
    state = at_rest(flight, np.zeros((count, 3)), np.zeros(count))
    states = [state]
    for _ in range(steps):
        state, corners = move(flight, state, np.broadcast_to(action, (count, len(action))))
        assert np.array_equal(corners[:, -1], state.position)
        states.append(state)
    return states


def test_a_bat_keeps_its_limits():
    flight = Flight(
        speed=6.0, slowest=1.0, acceleration=9.0, turn_rate_deg=400.0, climb=1.5, step=0.02
    )
    rng = np.random.default_rng(0)
    state = at_rest(flight, np.zeros((8, 3)), np.zeros(8))
    for _ in range(300):
        before = state
        state, _ = move(flight, state, rng.uniform(-1, 1, (8, 3)))
        speed = np.hypot(*state.velocity[:, :2].T)
        assert (speed <= 6 + 1e-12).all()
        assert (speed >= 1 - 1e-12).all()
        assert (np.abs(state.velocity[:, 2]) <= 1.5 + 1e-12).all()
        turn = np.angle(np.exp(1j * (state.heading - before.heading))) / flight.step
        assert (np.abs(turn) <= np.deg2rad(400) + 1e-9).all()
        assert (np.abs(turn) * speed <= 9.0 + 1e-9).all()
        assert np.allclose(state.position - before.position, state.velocity * flight.step)


def test_a_planar_flyer_turns_in_a_circle():
    """Dubins: at full turn its places lie on one circle of radius v/ω, the chord's of a polygon."""
    flight = Flight(body="planar", speed=4.0, turn_rate_deg=90.0, acceleration=100.0, step=0.01)
    place = np.array([s.position[0] for s in flown(flight, np.array([1.0]), 400)])
    assert np.ptp(place[:, 2]) == 0
    middle = (place[:200].max(axis=0) + place[:200].min(axis=0)) / 2
    away = np.hypot(
        *(place - place[:-1].mean(axis=0))[:, :2].T
    )  # one whole turn: its mean is the centre
    assert np.ptp(away) < 0.01
    assert away.mean() == pytest.approx(4.0 / (np.pi / 2), rel=1e-3)
    assert middle.shape == (3,)


def test_a_bird_keeps_its_course():
    flight = Flight(body="bird", speed=7.0, sideways=2.0, step=0.1)
    state = flown(flight, np.array([-0.5]), 10)[-1]
    assert state.position[0] == pytest.approx([7.0, -1.0, 0.0])
    assert state.heading[0] == 0


def test_a_quadrotor_follows_its_command_and_reaches_its_speed():
    flight = Flight(
        body="quadrotor", speed=8.0, tilt_deg=30.0, response=0.2, step=0.05, wind=(1.0, 0, 0)
    )
    states = flown(flight, np.array([1.0, 0, 0, 0]), 400)
    tilt = np.array([s.tilt[0, 0] for s in states])
    time = 0.05 * np.arange(len(tilt))
    assert np.allclose(
        tilt, np.deg2rad(30) * -np.expm1(-time / 0.2), atol=1e-12
    )  # first order, exactly
    assert states[-1].velocity[0, 0] == pytest.approx(
        9.0, rel=1e-3
    )  # through the air, and the wind
    assert abs(states[-1].position[0, 2]) < 1e-9
    first = (states[1].velocity[0] - states[0].velocity[0]) / 0.05
    assert 0 < first[0] < GRAVITY * np.tan(np.deg2rad(30))


@pytest.mark.parametrize("body", ACTIONS)
def test_wind_carries_every_body(body):
    still, blown = (
        flown(Flight(body=body, wind=wind, step=0.05), np.zeros(len(ACTIONS[body])), 100)[-1]
        for wind in ((0.0, 0.0, 0.0), (0.0, 1.5, 0.0))
    )
    drift = blown.position[0] - still.position[0]
    assert drift == pytest.approx([0, 7.5, 0], abs=0.7 if body == "quadrotor" else 1e-9)
