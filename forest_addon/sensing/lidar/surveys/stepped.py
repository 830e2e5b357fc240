"""Paths of parts that move by steps, as HELIOS++ moves them: a motion every so many pulses, and none between.

The state after n steps is a product of powers of few motions, so that any number of steps is reached by
squaring; what repeats is found first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....base.rows import distinct
from ....formats.helios.parts import MotionSequence, MotionStep, PartMotion

STILL = MotionStep(np.eye(3), np.eye(3), np.zeros(3))


@dataclass(frozen=True)
class States:
    """Products of steps (N,): turns (N, 3, 3), and the affine maps (N, 3, 3), (N, 3) of middles."""

    turn: np.ndarray
    carry: np.ndarray
    move: np.ndarray

    @classmethod
    def of(cls, step: MotionStep, count: int) -> States:
        """So many of one step."""
        return cls(
            *(np.broadcast_to(m, (count, *m.shape)) for m in (step.turn, step.carry, step.move))
        )

    def after(self, first: States) -> States:
        """Both, ``first`` before these."""
        move = (self.carry @ first.move[:, :, None])[:, :, 0] + self.move
        return States(self.turn @ first.turn, self.carry @ first.carry, move)

    def put(self, rows: np.ndarray, found: States) -> None:
        """Write some of the rows."""
        self.turn[rows], self.carry[rows], self.move[rows] = found.turn, found.carry, found.move


def powers(step: MotionStep, exponent: np.ndarray) -> States:
    """Powers of a step with exponents (N,) from 0 on."""
    count = len(exponent)
    total = States(*(np.array(m) for m in vars(States.of(STILL, count)).values()))
    left = exponent.copy()
    while left.any():
        rows = np.flatnonzero(left & 1)
        total.put(
            rows,
            States.of(step, len(rows)).after(
                States(total.turn[rows], total.carry[rows], total.move[rows])
            ),
        )
        step, left = step.after(step), left >> 1
    return total


def power(step: MotionStep, exponent: int) -> MotionStep:
    """A step so many times."""
    found = powers(step, np.array([exponent]))
    return MotionStep(found.turn[0], found.carry[0], found.move[0])


class SteppedPath:
    """Transforms of a part over time (a ``rays.paths.PartPath``).

    transform : (3, 4) local to world before the first step. before : pulses that were sent before time 0.
    pulses : how many are sent from then on, at ``rate`` Hz; the one at time t is the (t · rate)-th.
    """

    def __init__(
        self,
        transform: np.ndarray,
        middle: np.ndarray,
        motion: PartMotion,
        rate: float,
        pulses: tuple[int, int],
    ) -> None:
        self._turn, self._middle = transform[:, :3], middle
        self._own = np.linalg.solve(transform[:, :3], middle - transform[:, 3])
        self._every, self._rate = motion.every, rate
        self._before, self._pulses = pulses
        self._runs, self._loop = _runs(motion.sequences)

    def at(self, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) transforms at times (R,), s."""
        return self._placed(self._steps(time))

    def rate(self, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) change of the transforms a second at times (R,), the mean over the step that follows."""
        step = self._steps(time)
        return (self._placed(step + 1) - self._placed(step)) * (self._rate / self._every)

    def swept(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Box in the world, corners (3,), that a part within a box of its own never leaves: a ball around its
        middle, at all steps."""
        arm = np.maximum(np.abs(low - self._own), np.abs(high - self._own))
        radius = float(np.linalg.norm(arm)) * float(np.linalg.norm(self._turn, ord=2))
        last = (self._before + self._pulses) // self._every + 1
        ends = [self._middle, self._middle]
        for first in range(self._before // self._every, last + 1, 100_000):
            states = self._states(np.arange(first, min(first + 100_000, last + 1)))
            centre = states.carry @ self._middle + states.move
            ends = [
                np.minimum(ends[0], centre.min(axis=0)),
                np.maximum(ends[1], centre.max(axis=0)),
            ]
        return ends[0] - radius, ends[1] + radius

    def _steps(self, time: np.ndarray) -> np.ndarray:
        sent = np.round(np.asarray(time) * self._rate).astype(np.int64) - 1 + self._before
        return np.asarray(np.maximum(sent, 0) // self._every)

    def _placed(self, step: np.ndarray) -> np.ndarray:
        known, which = np.unique(step, return_inverse=True)
        states = self._states(known)
        found = np.empty((len(known), 3, 4))
        found[:, :, :3] = states.turn @ self._turn
        centre = states.carry @ self._middle + states.move
        found[:, :, 3] = centre - found[:, :, :3] @ self._own
        return np.asarray(found[which])

    def _states(self, step: np.ndarray) -> States:
        """Products of the steps before each number (N,) of them."""
        runs, loop = self._runs, self._loop
        rounds, place = np.zeros(len(step), dtype=np.int64), step
        if loop is not None:
            again = step >= loop.first
            rounds = np.where(again, (step - loop.first) // loop.length, 0)
            place = np.where(again, loop.first + (step - loop.first) % loop.length, step)
        run = np.searchsorted([one.first for one in runs], place, "right") - 1
        total = States(*(np.empty((len(step), *m.shape)) for m in vars(STILL).values()))
        for number in distinct(run):
            rows, one = np.flatnonzero(run == number), runs[number]
            since = place[rows] - one.first
            since = since if one.length is None else np.minimum(since, one.length)
            here = powers(one.step, since).after(States.of(one.within, len(rows)))
            if loop is not None and one.looped:
                here = here.after(powers(loop.step, rounds[rows]))
            total.put(rows, here.after(States.of(one.before, len(rows))))
        return total


@dataclass(frozen=True)
class _Run:
    """A sequence in the order of time: from which step on, how many (None: for ever), what was done since the
    loop began, and before it; whether it is in the loop."""

    first: int
    length: int | None
    step: MotionStep
    within: MotionStep
    before: MotionStep
    looped: bool


@dataclass(frozen=True)
class _Loop:
    """Sequences that come again: from which step on, how many steps, and their product."""

    first: int
    length: int
    step: MotionStep


def _runs(sequences: tuple[MotionSequence, ...]) -> tuple[list[_Run], _Loop | None]:
    """The sequences in the order of time, and what repeats of them."""
    named = {one.name: one for one in reversed(sequences)}
    order: list[MotionSequence] = []
    now: MotionSequence | None = sequences[0]
    while now is not None and now not in order:
        order.append(now)
        now = named[now.next] if now.loop > 0 and now.next else None
    start = len(order) if now is None else order.index(now)
    runs: list[_Run] = []
    first, total, before = 0, STILL, STILL
    begin = 0
    for place, one in enumerate(order):
        if place == start:
            before, total, begin = total, STILL, first
        looped = place >= start
        length = one.loop if one.loop > 0 else None
        ahead = (total, before) if looped else (total, STILL)
        runs.append(_Run(first, length, one.step, *ahead, looped))
        if length is not None:
            total, first = power(one.step, length).after(total), first + length
    loop = None if now is None else _Loop(begin, first - begin, total)
    return runs, loop
