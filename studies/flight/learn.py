"""Trains the small policy (``flight.learning``) among trunks at random, and draws how it got better.

Each round all drawings fly the same starts through the same trunks; the score is the way that was made good,
and ten metres for arriving. What was learnt is tried on forests that it has not seen.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib import rc_context

from forest_addon.api import Flight

from ..inside import (
    FAINT,
    LIDAR,
    LINES,
    SIZE,
    STYLE,
    Flyers,
    LidarSense,
    StemWorld,
    Straight,
    Trained,
    fly,
    new_figure,
    poisson_strip,
    save_figure,
    stream,
    write_csv,
)

DENSITY, TRUNK = 0.08, 0.2  # trees/m², metres
FIELD = np.array([60.0, 40.0])
ROUNDS, DRAWINGS, STARTS = 18, 40, 3
STEPS = 120
FLIGHT = Flight(
    speed=5.0,
    distance=40.0,
    aim="heading",
    step=0.1,
    steps=STEPS,
    start_low=(0.0, 0.3),
    start_high=(0.05, 0.7),
    height=1.5,
)
TRIED = 64  # flights of the test
KEPT = 0.2  # share of the drawings that are the best


def run(out: Path, size: float = 1.0, seed: int = 1, say: Callable[[str], None] = print) -> Trained:
    """Train, test, write ``trained.npz``, ``learning.csv`` and ``learning.png``."""
    out.mkdir(parents=True, exist_ok=True)
    lidar = LidarSense(LIDAR)
    rounds = max(2, round(ROUNDS * size))
    history: list[tuple[float, float]] = []

    def score(weights: np.ndarray, number: int) -> np.ndarray:
        flyers = Flyers(FLIGHT, len(weights), lidar, None)
        total = np.zeros(len(weights))
        for start in range(STARTS):
            flyers.enter(world(seed, "train", number * STARTS + start))
            flyers.start(range(len(weights)), [seed + number] * len(weights))
            policy = Trained(FLIGHT, lidar, weights)
            going = np.ones(len(weights), dtype=bool)
            for _ in range(STEPS):
                step = flyers.step(policy.act(flyers.sense()))
                total += np.where(going, step.reward, 0.0)
                going &= ~step.ended
                if not going.any():
                    break
        return total / STARTS

    def tell(number: int, scores: np.ndarray) -> None:
        history.append((float(scores.mean()), float(scores.max())))
        say(f"round {number + 1}: mean {scores.mean():.1f}, best {scores.max():.1f}")

    weights = train(score, stream(seed, "flight", "learn"), rounds, DRAWINGS, tell)
    learnt = Trained(FLIGHT, lidar, weights)
    learnt.save(out / "trained.npz")
    tried = {"before": np.zeros(SIZE), "after": weights}
    shares = {name: success(Trained(FLIGHT, lidar, w), lidar, seed) for name, w in tried.items()}
    shares["straight on"] = success(Straight(FLIGHT), lidar, seed)
    say("forests not seen before: " + ", ".join(f"{n} {s:.0%} arrive" for n, s in shares.items()))
    mean, best = zip(*history, strict=True)
    write_csv(out / "learning.csv", {"mean": list(mean), "best": list(best)})
    draw(out / "learning.png", history, shares)
    say(f"Written to {out}: trained.npz, learning.csv, learning.png")
    return learnt


def world(seed: int, purpose: str, number: int) -> StemWorld:
    """Trunks at random."""
    place = poisson_strip(stream(seed, "flight", purpose, number), DENSITY, *FIELD)
    return StemWorld(place, np.full(len(place), TRUNK), np.zeros(2), FIELD)


def success(policy: object, lidar: LidarSense, seed: int) -> float:
    """Share of flights that arrive in forests of their own."""
    count, each = 0, 8
    for number in range(TRIED // each):
        flyers = Flyers(FLIGHT, each, lidar, None)
        flyers.enter(world(seed, "test", number))
        tracks = fly(flyers, policy, [1000 + seed + number * each + n for n in range(each)])
        count += sum(track.end == "arrived" for track in tracks)
    return count / TRIED


def draw(path: Path, history: list[tuple[float, float]], shares: dict[str, float]) -> Path:
    """Scores by round, and success before and after."""
    with rc_context(STYLE):
        figure, (left, right) = new_figure(2, (9, 3.6), width_ratios=(2, 1))
        mean, best = zip(*history, strict=True)
        rounds = np.arange(1, len(mean) + 1)
        left.plot(rounds, mean, color=LINES[0], label="mean of the drawings")
        left.plot(rounds, best, color=LINES[1], label="best")
        left.set(
            xlabel="round", ylabel="metres made good, -10 or +10", title="Cross-entropy method"
        )
        left.grid(color=FAINT, lw=0.4)
        left.legend()
        right.bar(list(shares), list(shares.values()), color=[LINES[2], LINES[1], LINES[4]])
        right.set(ylabel="share that comes 40 m", ylim=(0, 1), title="Forests not seen before")
    return save_figure(figure, path)


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
