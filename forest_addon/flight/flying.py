"""Whole flights by a policy, in batches: what became of each, and the way it took."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .simulation import Flyers

ENDS = ("arrived", "crashed", "late")


@dataclass(frozen=True)
class Track:
    """One flight.

    position : (P, 3) metres, from the start on. heading : (P,) radians. nearest : (P,) metres to the nearest
    thing that was sensed, NaN without sensors. end : one of ``ENDS``. goal : (3,). step : seconds. flown :
    metres. forest, seed : whose it was.
    """

    position: np.ndarray
    heading: np.ndarray
    nearest: np.ndarray
    end: str
    goal: np.ndarray
    step: float
    flown: float
    forest: int
    seed: int

    @property
    def seconds(self) -> float:
        """It lasted."""
        return (len(self.position) - 1) * self.step

    @property
    def speed(self) -> float:
        """Mean, m/s."""
        return self.flown / self.seconds if self.seconds else 0.0


def fly(
    flyers: Flyers,
    policy: Any,
    seeds: Sequence[int],
    forest: int = 0,
    most: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Track]:
    """Fly once from each seed, as many at a time as there are flyers, in the world that they are in.

    most : steps at most. progress : called as progress(flights done, all).
    """
    tracks: list[Track] = []
    for first in range(0, len(seeds), flyers.count):
        some = list(seeds[first : first + flyers.count])
        padded = some + some[:1] * (flyers.count - len(some))
        flyers.start(range(flyers.count), padded)
        going = np.zeros(flyers.count, dtype=bool)
        going[: len(some)] = True
        ends = np.full(flyers.count, -1)
        count = np.zeros(flyers.count, dtype=np.int64)
        flown = np.zeros(flyers.count)
        rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        number = 0
        while going.any() and (most is None or number < most):
            told = flyers.sense(going)
            rows.append(
                (flyers.state.position.copy(), flyers.state.heading.copy(), nearest(flyers, told))
            )
            out = flyers.step(policy.act(told))
            count[going] += 1
            flown[going] = flyers.flown[going]
            for end, which in enumerate((out.arrived, out.crashed, out.late)):
                ends[going & which] = end
            over = going & out.ended
            going &= ~over
            number += 1
            # Who is through stands still: its place after the end is not asked for.
            rows[-1] = (*rows[-1],)
            last = flyers.state.position.copy()
            if over.any():
                for row in np.flatnonzero(over):
                    tracks.append(
                        _track(
                            rows,
                            row,
                            int(count[row]),
                            last[row],
                            ENDS[ends[row]],
                            flyers,
                            flown,
                            forest,
                            some,
                        )
                    )
                if progress:
                    progress(len(tracks), len(seeds))
        for row in np.flatnonzero(going):
            tracks.append(
                _track(
                    rows,
                    row,
                    int(count[row]),
                    flyers.state.position[row],
                    "late",
                    flyers,
                    flown,
                    forest,
                    some,
                )
            )
    order = {seed: n for n, seed in enumerate(seeds)}
    return sorted(tracks, key=lambda track: order[track.seed])


def nearest(flyers: Flyers, told: dict[str, np.ndarray]) -> np.ndarray:
    """(N,) metres to what the LiDAR meets first, else to what echoes first; NaN with neither."""
    if "lidar" in told:
        return told["lidar"].min(axis=1)
    if "sonar" in told and flyers.ears is not None:
        from .policies import EchoPolicy

        if flyers.ears.sonar.ears > 1:
            first, _ = EchoPolicy(flyers.flight, flyers.ears).cues(told["sonar"])
            return np.minimum(first, flyers.ears.sonar.max_range)
    return np.full(flyers.count, np.nan)


def _track(
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    row: int,
    count: int,
    last: np.ndarray,
    end: str,
    flyers: Flyers,
    flown: np.ndarray,
    forest: int,
    seeds: list[int],
) -> Track:
    place = np.array([*(r[0][row] for r in rows[:count]), last])
    heading = np.array([*(r[1][row] for r in rows[:count]), flyers.state.heading[row]])
    near = np.array([*(r[2][row] for r in rows[:count]), rows[count - 1][2][row]])
    goal = flyers.goal[row].copy()
    return Track(
        place, heading, near, end, goal, flyers.flight.step, float(flown[row]), forest, seeds[row]
    )


def interval(successes: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's interval of a share (1927): from, to; 0 to 1 without trials."""
    if not trials:
        return 0.0, 1.0
    share, square = successes / trials, z * z / trials
    middle = (share + square / 2) / (1 + square)
    half = z * np.sqrt(share * (1 - share) / trials + square / (4 * trials)) / (1 + square)
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))
