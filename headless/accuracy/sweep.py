"""Settings of a sensor, each with its error and its seconds, and which of them are worth taking.

A sensor's sweep (``lidar``, ``sonar``, ``reverb`` beside this) tries settings on a part of the scene that is
small enough to finish, against the exact way; the seconds are those of the whole sensor, scaled up from the
part. What is here knows no sensor: the frontier, the choice, and the words.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from forest_addon.spec import Settings

T = TypeVar("T")
NOTABLY = 0.95  # of the error: settings that gain less are not worth their seconds
SOME, ENOUGH = 0.3, 1.0  # s of several runs, and of one, that tell how long it takes


@dataclass(frozen=True)
class Point:
    """Settings that were tried.

    changes : of the sensor, empty for today's. label : in words. error, spread : against the exact way, and
    the standard error of that estimate. seconds : for the whole sensor.
    engine : of rays, where another is tried. elsewhere : what has to be set in place of the scene file, as a
    species' mesh; empty: the sensor, or the engine.
    """

    changes: dict[str, Any]
    label: str
    error: float
    spread: float
    seconds: float
    engine: str = ""
    elsewhere: str = ""


@dataclass(frozen=True)
class AccuracySweep:
    """Sweep of a sensor's settings.

    unit : of the errors. today : the settings of the scene. points : others.
    model : the error of the model itself, which no setting mends, with its words; None where unknown.
    terms : what today's error is made of, by name.
    notes : what else should be said.
    """

    sensor: Settings
    what: str
    unit: str
    today: Point
    points: tuple[Point, ...]
    model: tuple[float, str] | None = None
    notes: tuple[str, ...] = field(default=())
    terms: dict[str, float] = field(default_factory=dict)

    @property
    def all(self) -> tuple[Point, ...]:
        """Today's settings and the others."""
        return (self.today, *self.points)

    def frontier(self) -> list[Point]:
        """Settings of a scene file that none beats in both error and seconds, the fastest first; a slower
        one is notably more exact.
        """
        best: list[Point] = []
        for point in sorted(self.all, key=lambda p: (p.seconds, p.error)):
            if point.elsewhere:
                continue
            if math.isfinite(point.error) and (not best or point.error < NOTABLY * best[-1].error):
                best.append(point)
        return best

    def choice(self, error: float, seconds: float) -> Point:
        """The cheapest settings within ``error``; else the most exact of those within ``seconds``."""
        front = self.frontier()
        if not front:
            return self.today
        exact = [point for point in front if point.error + 2 * point.spread <= error]
        soon = [point for point in front if point.seconds <= seconds]
        if exact and exact[0].seconds <= seconds:
            return exact[0]
        return soon[-1] if soon else front[0]

    def dominant(self) -> str:
        """The largest term of today's error and the others, in words; nothing where none is known."""
        terms = self.terms | ({} if self.model is None else {"model": self.model[0]})
        known = sorted(((e, n) for n, e in terms.items() if math.isfinite(e)), reverse=True)
        if not known or known[0][0] == 0:
            return ""
        unit = f" {self.unit}" if self.unit else ""
        others = ", ".join(f"{name} {size:.0e}{unit}" for size, name in known[1:])
        first = f"{known[0][1]} dominates, {known[0][0]:.0e}{unit}"
        return f"{first} (beside {others})" if others else first

    def verdict(self, error: float, seconds: float) -> str:
        """Sentence on what to do about the error."""
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
    if 1 / 1.2 < times < 1.2:
        return f"take {chosen.label}, about as fast as today's"
    speed = f"{times:.1f} times as fast as" if times >= 1 else f"{1 / times:.1f} times as slow as"
    return f"take {chosen.label}, {speed} today's"


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """Result of some work and its CPU seconds, the least of several runs where it is short."""
    spent: list[float] = []
    while True:
        begin = time.process_time()
        returned = work()
        spent.append(time.process_time() - begin)
        if sum(spent) > ENOUGH or (len(spent) > 1 and sum(spent) > SOME):
            return returned, min(spent)


def mean_and_spread(values: Sequence[float]) -> tuple[float, float]:
    """The root mean square of errors and its standard error."""
    squares = np.asarray(values, dtype=np.float64) ** 2
    if not len(squares):
        return math.nan, math.nan
    rms = math.sqrt(float(squares.mean()))
    if len(squares) < 2 or rms == 0:
        return rms, 0.0
    return rms, float(squares.std(ddof=1) / math.sqrt(len(squares)) / (2 * rms))
