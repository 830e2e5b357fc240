"""The table of all sensors: what each kind is (``kind``), by the word that names it in a scene file.

A sensor's own module is light; its physics is imported when it runs.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from ..base.rng import stream
from ..spec import SENSORS, Choice, Scene, Sensor
from .audit import Audit, held
from .kind import TRIANGLE, Cost, Observation, SensorKind, cost_with
from .lidar.kind import AIRBORNE, MOBILE, TERRESTRIAL, TRACTOR
from .reverb.kind import REVERB
from .sonar.kind import SONAR

S = TypeVar("S", bound=Sensor)

KINDS: dict[str, SensorKind] = {}


def add(kind: SensorKind) -> None:
    """Add a kind of sensor; scene files know its word from then on."""
    KINDS[kind.name] = kind
    SENSORS[kind.name] = kind.settings


for _kind in (TRACTOR, TERRESTRIAL, MOBILE, AIRBORNE, SONAR, REVERB):
    add(_kind)


def kind_of(sensor: Sensor) -> SensorKind:
    """The record of a sensor's kind."""
    return KINDS[sensor.kind]


def cost_of(
    sensor: Sensor,
    trajectory: Any,
    engine: str,
    settings: Scene,
    trees: int,
    triangles: int = 0,
    ready: bool = False,
) -> Cost:
    """The cost of a sensor's run along a trajectory with a ray engine, in a scene with so many trees.

    triangles : that are not set up yet. ready : the kind has run in this scene, and it is the same.
    """
    kind = kind_of(sensor)
    cost = kind.cost(sensor, trajectory, engine)
    setup, work = kind.seconds_among(sensor, settings, trees, cost.count)
    setup += triangles * TRIANGLE
    return cost_with(sensor.kind, cost, -cost.setup if ready else setup, work)


def choose(sensor: S) -> tuple[S, tuple[Choice, ...]]:
    """A sensor with nothing left to "auto", and what was chosen."""
    made = kind_of(sensor).choose(sensor)
    return sensor.changed(**{choice.key: choice.value for choice in made}), made


def audited(job: Observation, found: Any, seconds: float) -> Audit | None:
    """A random sample of a finding, computed again by the exact way; None where audits are off.

    seconds : that the finding took; ``settings.accuracy.audit`` is the share of it that is looked at.
    """
    audit = kind_of(job.sensor).audit
    if job.settings.accuracy.audit == 0 or audit is None:
        return None
    begin, rng = time.perf_counter(), stream(job.settings.seed, "audit", job.sensor.name)
    made = held(audit(job, found), rng, seconds)
    return replace(made, audit_seconds=time.perf_counter() - begin)


def outline(sensor: Sensor) -> np.ndarray:
    """(N, 2, 3) m, ends of the lines that show where a sensor looks; nothing of the scene is needed."""
    return kind_of(sensor).outline(sensor)
