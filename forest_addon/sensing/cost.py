"""Cost of a run, before it begins: how much it sends, how long that takes, how much it keeps.

The time is a guess until sensors of a kind have run once in this process: seconds to begin, as tables take,
and seconds for each unit of work, as measured in the demo forest. Then the guess is multiplied by what the
last run took over what was guessed, on this machine and in this scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..spec import Sensor

RAY = 2.5e-6  # s, a first guess: a ray of Embree
BEGIN = 0.7  # s to read a scene, make Embree ready and draw what was found
SLOWER = 15.0  # times that BVHTree takes a ray
RETURN = 300  # bytes of a point: what is computed of it, and what Blender keeps

_pace: dict[str, float] = {}  # s taken over s guessed, of the last run of sensors of a kind


@dataclass(frozen=True)
class Cost:
    """Of one run: ``count`` of what it sends (pulses, pings, channels), seconds, bytes.

    work : what the time grows with: rays, pings, channels. guess : seconds as guessed before any has run.
    """

    what: str
    count: int
    work: int
    seconds: float
    memory: int
    guess: float = 0.0

    def __str__(self) -> str:
        rays = f" of {self.work:,} rays" if self.work > self.count else ""
        memory = f", {_few_digits(self.memory / 1e9)} GB" if self.memory > 5e7 else ""
        what = self.what.removesuffix("s") if self.count == 1 else self.what
        return f"{self.count:,} {what}{rays}: about {_lasting(self.seconds)}{memory}"


def cost_with(cost: Cost, more: float) -> Cost:
    """The cost of a run to whose first guess so many seconds are added."""
    guess = cost.guess + more
    pace = cost.seconds / cost.guess if cost.guess > 0 else 1.0
    return replace(cost, seconds=guess * pace, guess=guess)


def _lasting(seconds: float) -> str:
    """A time as one says it, of a guess."""
    if seconds < 1.5:
        return "a second"
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{_few_digits(seconds / 3600)} h"


def _few_digits(value: float) -> str:
    return f"{value:,.1f}" if value < 100 else f"{value:,.0f}"


def cost_of_rays(sensor: Sensor, count: int, subrays: int, returns: float, engine: str) -> Cost:
    """The cost of ``count`` pulses of ``subrays`` rays, each with so many returns, by a ray engine."""
    ray = RAY if engine == "embree" else SLOWER * RAY
    memory = int(count * returns) * RETURN
    work = count * subrays
    return cost_of_work(sensor, "pulses", count, ray, work=work, memory=memory, begin=BEGIN)


def cost_of_work(
    sensor: Sensor,
    what: str,
    count: int,
    unit: float,
    *,
    work: int = 0,
    memory: int = 0,
    begin: float = 0.0,
) -> Cost:
    """The cost of ``count`` of something.

    unit : seconds of a unit of work, begin : seconds before the first, until a sensor of this kind has run.
    work : units; 0: ``count``.
    """
    work = work or count
    guess = begin + work * unit
    return Cost(what, count, work, guess * _pace.get(sensor.kind, 1.0), memory, guess)


def note_pace(sensor: Sensor, cost: Cost, seconds: float) -> None:
    """Remember how long a run took."""
    if cost.guess > 0:
        _pace[sensor.kind] = seconds / cost.guess
