"""Bodies of flyers: a decision becomes a step of their state, within the limits of their body.

N flyers move at a time. An action is a number from -1 to 1 for each thing a body can decide, and the state
is place, velocity through the air, heading and tilt. A step is flown as straight pieces: of these the
corners come back, and what touches is looked for along them (``obstacles``).

- bat: turn, climb, thrust. ω ≤ a/v, so that the turn keeps within the acceleration a; the speed along the
  heading stays between the slowest and the largest.
- planar: turn, at an even speed and height (Dubins).
- bird: v ahead along the aim's direction, at most w across (Karaman & Frazzoli 2012).
- quadrotor: pitch, roll, turn, thrust. Tilt follows its command with a time constant τ, exactly:
  θ += (θ_c - θ)(1 - e^{-Δt/τ}); the rotors' thrust along the tilted axis, weight and a drag that balances
  the largest tilt at the largest speed move it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..base.rows import RowTable
from ..base.vectors import column
from ..spec import Flight, SpecError

GRAVITY = 9.81
PIECE = 0.02  # seconds of a quadrotor's straight pieces, at most
ACTIONS = {
    "bat": ("turn", "climb", "thrust"),
    "planar": ("turn",),
    "bird": ("sideways",),
    "quadrotor": ("pitch", "roll", "turn", "thrust"),
}


@dataclass(frozen=True)
class State(RowTable):
    """N flyers.

    position : (N, 3) metres. velocity : (N, 3) m/s over ground. heading : (N,) radians, from +X towards +Y.
    tilt : (N, 2) radians, nose down and left side up; 0 but for a quadrotor. course : (N,) radians, the
    direction of the aim at the start, which a bird keeps.
    """

    position: np.ndarray
    velocity: np.ndarray
    heading: np.ndarray
    tilt: np.ndarray
    course: np.ndarray

    def __len__(self) -> int:
        return len(self.heading)

    def put(self, rows: np.ndarray, other: State) -> State:
        """A copy in which the flyers of ``rows`` are replaced by ``other``."""
        made = {name: values.copy() for name, values in vars(self).items()}
        for name, values in made.items():
            values[rows] = getattr(other, name)
        return State(**made)


def at_rest(
    flight: Flight, position: np.ndarray, heading: np.ndarray, wind: np.ndarray | None = None
) -> State:
    """Flyers (N, 3) that set out along headings (N,), at their slowest or only speed through the air.

    wind : (N, 3) m/s where they are; left out: the steady one of the settings.
    """
    count = len(heading)
    speed = {"bat": flight.slowest, "quadrotor": 0.0}.get(flight.body, flight.speed)
    velocity = np.zeros((count, 3))
    velocity[:, 0], velocity[:, 1] = speed * np.cos(heading), speed * np.sin(heading)
    velocity += flight.wind if wind is None else wind
    return State(
        np.array(position, dtype=np.float64),
        velocity,
        wrapped(heading),
        np.zeros((count, 2)),
        wrapped(heading),
    )


def move(
    flight: Flight, state: State, action: np.ndarray, wind: np.ndarray | None = None
) -> tuple[State, np.ndarray]:
    """The state after a step, and the ends (N, K, 3) of the straight pieces that lead there.

    action : (N, A) from -1 to 1. wind : (N, 3) m/s of the air during the step; left out: the steady one
    of the settings.

    Raises
    ------
    SpecError : actions of another shape, or that are not from -1 to 1.
    """
    names = ACTIONS[flight.body]
    if np.shape(action) != (len(state), len(names)) or not (np.abs(action) <= 1.0).all():
        raise SpecError(
            "action",
            f"has the shape {np.shape(action)}, or values beyond -1 and 1; {len(state)} of body "
            f"{flight.body} take {len(names)} numbers each: {', '.join(names)}",
        )
    air = np.array(flight.wind) if wind is None else wind
    return MOVES[flight.body](flight, state, action, air)


def carried(flight: Flight, state: State, change: np.ndarray) -> State:
    """Flyers (N,) whose wind changes by (N, 3) m/s: a body that flies by its speed through the air keeps
    that, and a quadrotor is pushed by drag."""
    if flight.body == "quadrotor":
        return state
    return replace(state, velocity=state.velocity + change)


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Angles between -π and π."""
    return np.remainder(np.asarray(angle) + np.pi, 2 * np.pi) - np.pi


def _bat(
    flight: Flight, state: State, action: np.ndarray, wind: np.ndarray
) -> tuple[State, np.ndarray]:
    dt, most = flight.step, flight.acceleration
    through = state.velocity - wind
    cos, sin = np.cos(state.heading), np.sin(state.heading)
    speed = through[:, 0] * cos + through[:, 1] * sin
    speed = (speed + action[:, 2] * (most * dt)).clip(flight.slowest, flight.speed)
    turn = np.minimum(np.deg2rad(flight.turn_rate_deg), most / np.maximum(speed, 1e-9))
    heading = wrapped(state.heading + action[:, 0] * turn * dt)
    wanted = action[:, 1] * flight.climb
    rise = through[:, 2] + (wanted - through[:, 2]).clip(-most * dt, most * dt)
    velocity = np.stack([speed * np.cos(heading), speed * np.sin(heading), rise], axis=1)
    return _straight(flight, state, velocity, heading, wind)


def _planar(
    flight: Flight, state: State, action: np.ndarray, wind: np.ndarray
) -> tuple[State, np.ndarray]:
    turn = min(np.deg2rad(flight.turn_rate_deg), flight.acceleration / flight.speed)
    heading = wrapped(state.heading + action[:, 0] * (turn * flight.step))
    level = np.zeros(len(heading))
    velocity = flight.speed * np.stack([np.cos(heading), np.sin(heading), level], axis=1)
    return _straight(flight, state, velocity, heading, wind)


def _bird(
    flight: Flight, state: State, action: np.ndarray, wind: np.ndarray
) -> tuple[State, np.ndarray]:
    cos, sin, level = np.cos(state.course), np.sin(state.course), np.zeros(len(state))
    across = action[:, 0] * flight.sideways
    velocity = np.stack(
        [flight.speed * cos - across * sin, flight.speed * sin + across * cos, level], axis=1
    )
    return _straight(flight, state, velocity, state.course, wind)


def _straight(
    flight: Flight, state: State, through: np.ndarray, heading: np.ndarray, wind: np.ndarray
) -> tuple[State, np.ndarray]:
    """One straight piece at a velocity through the air, the wind added."""
    velocity = through + wind
    place = state.position + velocity * flight.step
    return State(place, velocity, heading, state.tilt, state.course), place[:, None]


def _quadrotor(
    flight: Flight, state: State, action: np.ndarray, wind: np.ndarray
) -> tuple[State, np.ndarray]:
    pieces = max(1, int(np.ceil(flight.step / PIECE - 1e-9)))
    dt, most = flight.step / pieces, np.deg2rad(flight.tilt_deg)
    drag = GRAVITY * np.tan(most) / flight.speed
    wanted, tilt = action[:, :2] * most, state.tilt
    place, velocity, heading = state.position, state.velocity, state.heading
    corners = np.empty((len(state), pieces, 3))
    for piece in range(pieces):
        tilt = tilt + (wanted - tilt) * -np.expm1(-dt / flight.response)
        heading = heading + action[:, 2] * (np.deg2rad(flight.turn_rate_deg) * dt)
        nose, side = column(tilt, 0), column(tilt, 1)
        lift = GRAVITY / (np.cos(nose) * np.cos(side))
        ahead, left = lift * np.sin(nose), -lift * np.sin(side) * np.cos(nose)
        cos, sin = np.cos(heading), np.sin(heading)
        # Thrust holds the height; what is asked beyond it goes to a rise of at most ``climb``.
        rise = np.clip(
            (action[:, 3] * flight.climb - velocity[:, 2]) / flight.response,
            -flight.acceleration,
            flight.acceleration,
        )
        pull = np.stack([ahead * cos - left * sin, ahead * sin + left * cos, rise], axis=1)
        through = velocity - wind
        pull[:, :2] -= drag * through[:, :2]
        velocity = velocity + pull * dt
        place = place + velocity * dt
        corners[:, piece] = place
    made = State(place, velocity, wrapped(heading), tilt, state.course)
    return made, corners


MOVES = {"bat": _bat, "planar": _planar, "bird": _bird, "quadrotor": _quadrotor}
