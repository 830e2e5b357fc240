"""A small policy that learns, by the cross-entropy method: numpy alone, minutes on two cores.

The nearest thing in each of ``SECTORS`` sectors of the LiDAR's level rays, and the aim's direction, go
through one hidden layer to a direction and a pace, which ``policies.steer`` flies. Weights θ are drawn from
a normal distribution N(μ, σ²), each drawing flies the same starts, and μ, σ become those of the best
(Rubinstein 1999; with noise that fades, Szita & Lőrincz 2006, Neural Comput. 18, 2936).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base.vectors import column
from ..formats.table import write_npz
from ..spec import Flight, SpecError
from .bodies import wrapped
from .policies import bearing, steer
from .senses import LidarSense

SECTORS, HIDDEN = 15, 8
INPUTS = SECTORS + 2
SIZE = HIDDEN * (INPUTS + 1) + 2 * (HIDDEN + 1)
KEPT = 0.2  # share of the drawings that are the best
NEAR = 4.0  # metres: the scale on which nearness is felt


@dataclass
class Trained:
    """A policy of weights (SIZE,), or (N, SIZE) one for each flyer."""

    flight: Flight
    lidar: LidarSense
    weights: np.ndarray
    sensors: tuple[str, ...] = ("lidar",)

    def __post_init__(self) -> None:
        ways = self.lidar.ways
        level = np.flatnonzero(np.abs(ways[:, 2]) < 0.3)
        angle = np.arctan2(ways[level, 1], ways[level, 0])
        front = np.abs(angle) <= np.pi * 0.75
        sector = np.floor((angle[front] / (np.pi * 0.75) + 1) / 2 * SECTORS).astype(int)
        sector = np.clip(sector, 0, SECTORS - 1)
        order = np.argsort(sector, kind="stable")
        self._rays, sector = level[front][order], sector[order]
        self._first = np.searchsorted(sector, np.arange(SECTORS))
        if len(np.unique(sector)) < SECTORS:
            raise SpecError(
                "lidar", f"has too few level rays; a trained policy needs one in each of {SECTORS}"
            )

    def act(self, told: dict[str, np.ndarray]) -> np.ndarray:
        """See ``policies.Policy``."""
        seen = np.minimum.reduceat(told["lidar"][:, self._rays], self._first, axis=1)
        aim = bearing(told)
        felt = np.column_stack([np.exp(-seen / NEAR), np.sin(aim), np.cos(aim)])
        weights = np.broadcast_to(self.weights, (len(felt), SIZE))
        split = HIDDEN * (INPUTS + 1)
        first = weights[:, :split].reshape(-1, HIDDEN, INPUTS + 1)
        last = weights[:, split:].reshape(-1, 2, HIDDEN + 1)
        inner = np.tanh(np.einsum("nhi,ni->nh", first[..., :-1], felt) + first[..., -1])
        out = np.einsum("noh,nh->no", last[..., :-1], inner) + last[..., -1]
        way = wrapped(0.5 * aim + 1.5 * np.tanh(column(out, 0)))
        pace = 0.2 + 0.8 / (1.0 + np.exp(-np.clip(out[:, 1], -30, 30)))
        return steer(self.flight, told, way, pace)

    def save(self, path: Path) -> None:
        """Write the weights."""
        write_npz(path, {"weights": self.weights}, {"weights": "1"})


def load(path: Path, flight: Flight, lidar: LidarSense) -> Trained:
    """A policy that was trained before.

    Raises
    ------
    SpecError : the file is none of ours.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            weights = np.array(file["weights"], dtype=np.float64)
    except (OSError, ValueError, KeyError) as problem:
        raise SpecError(str(path), f"is no trained policy ({problem}); train one first") from None
    if weights.shape != (SIZE,) or not np.isfinite(weights).all():
        raise SpecError(str(path), f"has weights {weights.shape}, not ({SIZE},); train anew")
    return Trained(flight, lidar, weights)


def train(
    score: Callable[[np.ndarray, int], np.ndarray],
    rng: np.random.Generator,
    rounds: int = 20,
    drawings: int = 64,
    tell: Callable[[int, np.ndarray], None] | None = None,
) -> np.ndarray:
    """The weights (SIZE,) that the cross-entropy method comes to.

    score : (D,) of weights (D, SIZE), higher is better, in a round. tell : called as tell(round, scores).
    """
    mean, spread = np.zeros(SIZE), np.ones(SIZE)
    best = max(2, round(KEPT * drawings))
    for number in range(rounds):
        weights = mean + spread * rng.standard_normal((drawings, SIZE))
        weights[0] = mean
        scores = score(weights, number)
        chosen = weights[np.argsort(-scores, kind="stable")[:best]]
        extra = 0.3 * max(0.0, 1.0 - number / (0.7 * rounds))
        mean, spread = chosen.mean(axis=0), chosen.std(axis=0) + extra
        if tell:
            tell(number, scores)
    return mean
