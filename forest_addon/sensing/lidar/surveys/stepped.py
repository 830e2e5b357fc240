"""Paths of parts that move by steps, as HELIOS++ moves them: a motion every so many pulses, and none between.

The state after n steps is a product of powers of few motions, so that any number of steps is reached by
squaring; what repeats is found first.
"""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from ....base.rows import distinct
from ....formats.helios.motion import STILL, PartMotion

STATES_AT_ONCE = 100_000


def powers(step: np.ndarray, exponent: np.ndarray) -> np.ndarray:
    """(N, 2, 4, 4) powers of a step (2, 4, 4) with exponents (N,) from 0 on."""
    total = np.tile(STILL, (len(exponent), 1, 1, 1))
    while exponent.any():
        rows = np.flatnonzero(exponent & 1)
        total[rows] = step @ total[rows]
        step, exponent = step @ step, exponent >> 1
    return total


class SteppedPath:
    """Transforms of a part over time (a ``rays.paths.PartPath``).

    transform : (3, 4) local to world before the first step. middle : (3,) metres in the world.
    pulses : how many were sent before time 0, and how many are sent from then on, at ``rate`` Hz; the one at
    time t is the (t · rate)-th.
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
        self._motion, self._rate, self._pulses = motion, rate, pulses
        times = motion.times
        self._first = np.cumsum(
            [0, *times]
        )  # step at which each sequence begins, and the last ends
        whole = [powers(s, np.array([n]))[0] for s, n in zip(motion.steps, times, strict=True)]
        begin = motion.again
        early, late = (
            [*accumulate(part, lambda before, one: one @ before, initial=STILL)]
            for part in (whole[:begin], whole[begin:])
        )
        # What was done before each sequence: since the sequences began that come again, and before these.
        self._within = [*early[:-1], *late]
        self._ahead, self._round = early[-1], late[-1]

    def at(self, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) transforms at times (R,), s."""
        return self._placed(self._steps(time))

    def rate(self, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) change of the transforms a second at times (R,), the mean over the step that follows."""
        step = self._steps(time)
        return (self._placed(step + 1) - self._placed(step)) * (self._rate / self._motion.every)

    def swept(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Box in the world, corners (3,), that a part within a box of its own never leaves: a ball around its
        middle, at all steps."""
        arm = np.maximum(np.abs(low - self._own), np.abs(high - self._own))
        radius = float(np.linalg.norm(arm)) * float(np.linalg.norm(self._turn, ord=2))
        first, last = map(int, np.cumsum(self._pulses) // self._motion.every)
        ends = []
        for begin in range(first, last + 2, STATES_AT_ONCE):
            centre = self._centre(
                self._states(np.arange(begin, min(begin + STATES_AT_ONCE, last + 2)))
            )
            ends += [centre.min(axis=0), centre.max(axis=0)]
        return np.min(ends, axis=0) - radius, np.max(ends, axis=0) + radius

    def _steps(self, time: np.ndarray) -> np.ndarray:
        sent = np.round(np.asarray(time) * self._rate).astype(np.int64) - 1 + self._pulses[0]
        return np.asarray(np.maximum(sent, 0) // self._motion.every)

    def _placed(self, step: np.ndarray) -> np.ndarray:
        known, which = np.unique(step, return_inverse=True)
        states, placed = self._states(known), np.empty((len(known), 3, 4))
        placed[:, :, :3] = states[:, 0, :3, :3] @ self._turn
        placed[:, :, 3] = self._centre(states) - placed[:, :, :3] @ self._own
        return np.asarray(placed[which])

    def _centre(self, states: np.ndarray) -> np.ndarray:
        """(N, 3) metres, where states have taken the middle."""
        return np.asarray(states[:, 1, :3, :3] @ self._middle + states[:, 1, :3, 3])

    def _states(self, step: np.ndarray) -> np.ndarray:
        """(N, 2, 4, 4) products of the steps before each number (N,) of them."""
        first, begin = self._first, self._motion.again
        again = np.maximum(step - first[begin], 0)
        rounds = again // max(first[-1] - first[begin], 1) if begin < len(first) - 1 else 0 * again
        place = step - rounds * (first[-1] - first[begin])
        run = np.searchsorted(first[1:-1], place, "right")
        products = np.empty((len(step), 2, 4, 4))
        for number in distinct(run).tolist():
            rows = np.flatnonzero(run == number)
            since = place[rows] - first[number]
            if self._motion.times[number]:
                since = np.minimum(since, self._motion.times[number])
            products[rows] = powers(self._motion.steps[number], since) @ self._within[number]
            if number >= begin:
                products[rows] = products[rows] @ powers(self._round, rounds[rows]) @ self._ahead
        return products
