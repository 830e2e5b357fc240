"""Whole flights by a policy, in batches: what became of each, and the way it took."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

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
        """Duration of the flight, s."""
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
    progress: Callable[[int, int], None] | None = None,
) -> list[Track]:
    """Fly once from each seed, as many at a time as there are flyers, in the world that they are in.

    progress : called as progress(flights done, all).
    """
    tracks: list[Track] = []
    for first in range(0, len(seeds), flyers.count):
        some = list(seeds[first : first + flyers.count])
        flyers.start(range(flyers.count), some + some[:1] * (flyers.count - len(some)))
        going = np.arange(flyers.count) < len(some)
        rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []  # of each step, all flyers
        while going.any():
            told = flyers.sense(going)
            state = flyers.state
            rows.append((state.position.copy(), state.heading.copy(), nearest(flyers, told)))
            out = flyers.step(policy.act(told))
            # Who is through stands still: its place after the end is not asked for.
            ended = going & out.ended
            for row in np.flatnonzero(ended).tolist():
                place, heading, near = (
                    np.array([one[row] for one in part]) for part in zip(*rows, strict=True)
                )
                track = Track(
                    np.append(place, flyers.state.position[[row]], axis=0),
                    np.append(heading, flyers.state.heading[row]),
                    np.append(near, near[-1]),
                    ENDS[(out.arrived[row], out.crashed[row], True).index(True)],
                    flyers.goal[row].copy(),
                    flyers.flight.step,
                    float(flyers.flown[row]),
                    forest,
                    some[row],
                )
                tracks.append(track)
            going = going & ~ended
            if progress and ended.any():
                progress(len(tracks), len(seeds))
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


def interval(successes: int, trials: int) -> tuple[float, float]:
    """Wilson's interval of 95 % of a share (1927): from, to; 0 to 1 without trials."""
    if not trials:
        return 0.0, 1.0
    low, high = binomtest(successes, trials).proportion_ci(method="wilson")
    return float(low), float(high)
