"""Settings of a sensor, each with its error and its seconds, and which of them are worth taking.

A sensor's sweep (``lidar``, ``sonar``, ``reverb`` beside this) tries settings on a part of the scene that is
small enough to finish, against the exact way; the seconds are those of the whole sensor, scaled up from the
part. What is here knows no sensor: the frontier, the choice, and the words.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from forest_addon.spec import Settings

Say = Callable[[str], None]


@dataclass(frozen=True)
class Point:
    """Settings that were tried.

    changes : of the sensor, empty for today's. label : in words. error, spread : against the exact way, and
    the standard error of that estimate. seconds : for the whole sensor.
    """

    changes: dict[str, Any]
    label: str
    error: float
    spread: float
    seconds: float


@dataclass(frozen=True)
class Sweep:
    """What was tried for a sensor.

    unit : of the errors. today : the settings of the scene. points : others.
    model : the error of the model itself, which no setting mends, with its words; None where unknown.
    notes : what else should be said.
    """

    sensor: Settings
    what: str
    unit: str
    today: Point
    points: tuple[Point, ...]
    model: tuple[float, str] | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def all(self) -> tuple[Point, ...]:
        """Today's settings and the others."""
        return (self.today, *self.points)

    def frontier(self) -> list[Point]:
        """Settings that none beats in both error and seconds, the fastest first."""
        best: list[Point] = []
        for point in sorted(self.all, key=lambda p: (p.seconds, p.error)):
            if math.isfinite(point.error) and (not best or point.error < best[-1].error):
                best.append(point)
        return best

    def choice(self, error: float, seconds: float) -> Point:
        """The cheapest settings within ``error``; else the most exact of those within ``seconds``."""
        front = self.frontier()
        if not front:
            return self.today
        exact = [point for point in front if point.error <= error]
        soon = [point for point in front if point.seconds <= seconds]
        if exact and exact[0].seconds <= seconds:
            return exact[0]
        return soon[-1] if soon else front[0]

    def verdict(self, error: float, seconds: float) -> str:
        """Which error is the largest, and what to do about it, in a sentence."""
        chosen = self.choice(error, seconds)
        unit = f" {self.unit}" if self.unit else ""
        if self.model is not None and self.model[0] > max(error, self.today.error):
            share, words = self.model
            return (
                f"the model's own error is the larger one, about {share:.0e}{unit} ({words}): "
                f"no setting helps; {_advice(chosen, self.today)}"
            )
        if chosen.error > error:
            short = f"{error:.0e}{unit} is not reached within {seconds:g} s"
            return f"{short}; {_advice(chosen, self.today)} ({chosen.error:.0e}{unit})"
        return _advice(chosen, self.today)


def _advice(chosen: Point, today: Point) -> str:
    if chosen is today:
        return "keep today's settings"
    times = today.seconds / chosen.seconds if chosen.seconds else math.inf
    speed = f"{times:.1f} times as fast" if times >= 1 else f"{1 / times:.1f} times as slow"
    return f"take {chosen.label}, {speed} as today's"


def mean_and_spread(values: Sequence[float]) -> tuple[float, float]:
    """The root mean square of errors and its standard error."""
    squares = np.asarray(values, dtype=np.float64) ** 2
    if not len(squares):
        return math.nan, math.nan
    rms = math.sqrt(float(squares.mean()))
    if len(squares) < 2 or rms == 0:
        return rms, 0.0
    return rms, float(squares.std(ddof=1) / math.sqrt(len(squares)) / (2 * rms))
