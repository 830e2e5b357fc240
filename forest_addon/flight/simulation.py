"""Flyers in a world: they start, sense, decide elsewhere, move, and touch something or arrive.

All N flyers move at a time; each has its own chances (``generator(seed)``), so that its flight does
not depend on the others. On each straight piece of a
step what comes first counts: the touch ends a flight, arriving ends it too, wherever along the piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.rows import lengths
from ..spec import Flight, SpecError
from .bodies import State, at_rest, carried, move
from .obstacles import first_within, touched
from .senses import EarSense, LidarSense, generator, odometry

TRIES = 200  # places that are drawn for a start
SENSORS = ("lidar", "sonar")
CRASH, ARRIVED = -10.0, 10.0  # rewards, beside the metres nearer to the aim


@dataclass(frozen=True)
class Outcome:
    """A step of N flyers.

    reward : (N,) metres nearer to the aim, and what an end counts. crashed, arrived, late : (N,) bool: it
    touched, it is there, its steps are used up. way : (N,) metres flown in this step.
    """

    reward: np.ndarray
    crashed: np.ndarray
    arrived: np.ndarray
    late: np.ndarray
    way: np.ndarray

    @property
    def ended(self) -> np.ndarray:
        """(N,) bool."""
        return self.crashed | self.arrived | self.late


class Flyers:
    """N flyers of one kind.

    lidar, ears : what they carry, or None. every : steps from ping to ping.
    """

    def __init__(
        self,
        flight: Flight,
        count: int,
        lidar: LidarSense | None,
        ears: EarSense | None,
        every: int = 1,
    ) -> None:
        self.flight, self.count = flight, count
        self.lidar, self.ears, self.every = lidar, ears, every
        self.world: Any = None

    def enter(self, world: Any) -> None:
        """Take all flyers to a world; ``start`` them then."""
        self.world = world
        count = self.count
        self.state = at_rest(self.flight, np.zeros((count, 3)), np.zeros(count))
        self.goal, self._axis = np.zeros((count, 3)), np.zeros((count, 3))
        self.steps, self.flown = np.zeros(count, dtype=np.int64), np.zeros(count)
        self._rngs, self._own = [generator(0)] * count, [0] * count
        self._ball, self._room = np.zeros((count, 3)), np.full(count, -1.0)
        self._left = np.zeros(count)
        self._air = np.tile(np.array(self.flight.wind), (count, 1))
        self._heard = np.zeros((count, *self.ears.shape)) if self.ears else None

    def start(
        self,
        rows: Sequence[int],
        seeds: Sequence[int],
        start: Any = None,
        goal: Any = None,
        heading_deg: float | None = None,
    ) -> None:
        """Set some flyers out anew.

        start, goal : (3,) metres in place of those of the settings. heading_deg : of the aim, likewise.

        Raises
        ------
        SpecError : a start that touches something; no free place was found for one.
        """
        flight = self.flight
        turned = flight.heading_deg if heading_deg is None else heading_deg
        towards = np.deg2rad(_finite("heading_deg", turned, (), "a finite number, degrees"))
        metres = (3,), "three finite numbers, metres"
        given = flight.start if start is None else _finite("start", start, *metres)
        aim = None if goal is None else _finite("goal", goal, *metres)
        begun = []
        for row, seed in zip(rows, seeds, strict=True):
            rng = generator(int(seed))
            place = self._free(rng) if given is None else np.array(given, dtype=np.float64)
            if given is not None and self._stuck(place, 0.0):
                x, y, z = place
                raise SpecError(
                    "flight.start",
                    f"({x:g}, {y:g}, {z:g}) is inside or within {flight.radius:g} m of something solid; "
                    "start elsewhere",
                )
            ahead = np.array([np.cos(towards), np.sin(towards), 0.0])
            target = place + flight.distance * ahead if aim is None else aim
            way = target - place
            heading = float(np.arctan2(way[1], way[0])) if way[:2].any() else float(towards)
            begun.append((row, int(seed), rng, place, target, heading))
        for row, seed, rng, place, target, heading in begun:
            self._rngs[row], self._own[row] = rng, seed
            self.goal[row], self._axis[row] = target, target - place
            self.steps[row], self.flown[row] = 0, 0.0
            self._room[row] = -1.0
            self._air[row] = self._wind(place[None], np.zeros(1))[0]
            fresh = at_rest(flight, place[None], np.array([heading]), self._air[[row]])
            self.state = self.state.put(np.array([row]), fresh)
        self._length = np.maximum(np.linalg.norm(self._axis, axis=1), 1e-12)
        self._left = self._distance(self.state.position)

    def sense(self, rows: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Observations of all flyers, arrays with a row each; a ping is new every so many steps.

        rows : bool (N,), of those that have to listen now whatever their step.
        """
        told = {}
        state = self.state
        if self.lidar:
            chance = not self.lidar.exact  # of what the scanners of this step do
            seeds = [rng.integers(2**31) if chance else 0 for rng in self._rngs]
            told["lidar"] = self.lidar.look(self.world, state, np.array(seeds), self.time)
        if self.ears and self._heard is not None:
            due = self.steps % self.every == 0
            if rows is not None:
                due = due & rows
            now = due.nonzero()[0]
            if len(now):
                own = [self._own[row] for row in now]
                time, steps = self.time[now], self.steps[now]
                self._heard[now] = self.ears.listen(self.world, state.select(now), time, own, steps)
            told["sonar"] = self._heard.copy()
        told["odometry"] = odometry(self.flight, state, self.goal, self._rngs)
        return told

    @property
    def time(self) -> np.ndarray:
        """(N,) s since each set out."""
        return np.asarray(self.steps * self.flight.step)

    def step(self, action: np.ndarray) -> Outcome:
        """Move all flyers a step.

        action : (N, A) from -1 to 1, see ``bodies``.
        """
        flight = self.flight
        before = self.state
        if self.world.gusts is None:
            after, corners = move(flight, before, action)
        else:
            air = self._wind(before.position, self.time)
            after, corners = move(flight, carried(flight, before, air - self._air), action, air)
            self._air = air
        crashed, arrived = np.zeros(self.count, bool), np.zeros(self.count, bool)
        here, place, way = before.position, after.position, np.zeros(self.count)
        for piece in range(corners.shape[1]):
            there = corners[:, piece]
            stops, comes = self._touched(here, there), self._arrives(here, there)
            going = ~(crashed | arrived)
            hit = going & (stops <= np.minimum(comes, 1.0))
            comes_there = going & (comes < stops)
            share = np.minimum(np.minimum(stops, comes), 1.0)
            way += np.where(going, share * lengths(there - here), 0.0)
            ended = (hit | comes_there)[:, None]
            place = np.where(ended, here + share[:, None] * (there - here), place)
            crashed |= hit
            arrived |= comes_there
            here = there
        left = self._distance(place)
        reward = self._left - left + CRASH * crashed + ARRIVED * arrived
        self._left = left
        self.state = State(place, after.velocity, after.heading, after.tilt, after.course)
        self.steps += 1
        self.flown += way
        late = (self.steps >= flight.steps) & ~crashed & ~arrived
        return Outcome(reward, crashed, arrived, late, way)

    def _wind(self, place: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(N, 3) m/s of the wind at places (N, 3) and times (N,), s: the steady one, and that of the scene
        with its gusts."""
        steady = np.tile(np.array(self.flight.wind), (len(place), 1))
        field = self.world.gusts
        if field is None:
            return steady
        above = place - np.column_stack(
            [np.zeros((len(place), 2)), self.world.ground(place[:, :2])]
        )
        return np.asarray(steady + field.at(above, time))

    def _touched(self, here: np.ndarray, there: np.ndarray) -> np.ndarray:
        """(N,) shares of ways at which flyers touch, ``inf``: not on them. Who stays in the free ball of
        before is not asked; obstacles that move stand for a step where they are in its middle.
        """
        radius, obstacles = self.flight.radius, self.world.obstacles
        share = np.full(self.count, np.inf)
        # The ball holds the start of the way too, since that of before ended in it: a ball is convex.
        rows = (lengths(there - self._ball) + radius > self._room).nonzero()[0]
        when = (self.time[rows] + 0.5 * self.flight.step) * obstacles.moves
        for time in set(when.tolist()):
            some = rows[when == time]
            one, other = here[some], there[some]
            share[some], room = touched(obstacles.at(time), one, other, radius)
            self._ball[some] = (one + other) / 2
            self._room[some] = -1.0 if obstacles.moves else room
        return share

    def _arrives(self, here: np.ndarray, there: np.ndarray) -> np.ndarray:
        """(N,) shares of ways at which flyers come to their aim, ``inf``: not on it."""
        way, share = there - here, np.full(self.count, np.inf)
        if self.flight.aim == "heading":
            left = np.einsum("ni,ni->n", self._axis, self.goal - here)
            speed = np.einsum("ni,ni->n", self._axis, way)
            rows = (left <= np.maximum(speed, 0.0)).nonzero()[0]
            share[rows] = np.where(
                left[rows] > 0, left[rows] / np.maximum(speed[rows], 1e-300), 0.0
            )
            return share
        reached, off = self.flight.reached, here - self.goal
        distance = lengths(off)
        rows = (distance <= (reached + lengths(way)) * (1 + 1e-9)).nonzero()[0]
        if len(rows):
            share[rows] = first_within(off[rows], way[rows], reached)
        share[distance <= reached] = 0.0
        return np.where(share <= 1, share, np.inf)

    def _distance(self, place: np.ndarray) -> np.ndarray:
        """(N,) metres from places to the aims."""
        off: np.ndarray = self.goal - place
        if self.flight.aim == "heading":
            along: np.ndarray = np.einsum("ni,ni->n", off, self._axis)
            return along / self._length
        return lengths(off)

    def _free(self, rng: np.random.Generator) -> np.ndarray:
        """A free place in the box of starts."""
        flight = self.flight
        low, high = self.world.field
        for _ in range(TRIES):
            share = rng.uniform(flight.start_low, flight.start_high)
            spot = low + share * (high - low)
            place = np.array([*spot, float(self.world.ground(spot[None])[0]) + flight.height])
            if not self._stuck(place, flight.clearance):
                return place
        raise SpecError(
            "flight.start",
            f"no free place was found in {TRIES} draws; widen start_low to start_high, or lower clearance",
        )

    def _stuck(self, place: np.ndarray, clearance: float) -> bool:
        radius = self.flight.radius + clearance
        obstacles = self.world.obstacles.at(0.0)
        at = place[None]
        if float(obstacles.room(at)[0]) > radius:
            return False
        return bool(np.isfinite(obstacles.touch(at, at, radius)[0]) or obstacles.encloses(place))


def _finite(name: str, value: Any, shape: tuple[int, ...], words: str) -> np.ndarray:
    """Return a value that a user gave as numbers.

    Raises
    ------
    SpecError : it has another shape, or is no finite number.
    """
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise SpecError(name, f"must be {words}")
    return numbers
