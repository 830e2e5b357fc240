"""Sensors as one adds them: by what carries them, with settings that run at once where they are put.

A kind of ``spec`` may be carried in several ways (a moving scanner by a drone or a vehicle). What moves along
a path gets one through what there is to sense: a curve, which the user can edit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ... import spec
from ...sensing.kinds import KINDS
from ..shell.words import keep

Point = tuple[float, float, float]

AROUND = 40.0  # m that a sensor's path reaches from where it is put, at most
SWATHE = 20.0  # m between two legs of a drone


@dataclass(frozen=True)
class Around:
    """Place of a new sensor: on the ground at ``foot``, among things from ``low`` to ``high`` (m)."""

    foot: Point
    low: Point
    high: Point

    def reach(self, axis: int) -> tuple[float, float]:
        """From where to where there is something to sense along x or y, not too far from the foot."""
        here = self.foot[axis]
        return (
            min(max(self.low[axis], here - AROUND), here - 5.0),
            max(min(self.high[axis], here + AROUND), here + 5.0),
        )

    def raised(self, height: float) -> Point:
        """A place above the foot."""
        x, y, z = self.foot
        return x, y, z + height


@dataclass(frozen=True)
class Start:
    """A sensor to add: ``settings`` where it stands, ``path`` of what moves along one."""

    title: str
    kind: str
    icon: str
    help: str
    settings: Callable[[Around], spec.Sensor]
    path: Callable[[Around], list[Point]] | None = None


def _tripod(around: Around) -> spec.Sensor:
    return spec.Terrestrial(position=around.raised(1.6))


def _drone(_around: Around) -> spec.Sensor:
    return spec.Mobile(
        speed=5.0,
        max_range=150.0,
        pulse_rate=50e3,
        field_deg=(-35.0, 35.0),
        line_rate=50.0,
    )


def _over(around: Around) -> list[Point]:
    """Back and forth above everything."""
    (x0, x1), (y0, y1) = around.reach(0), around.reach(1)
    height = max(around.high[2], around.foot[2]) + 30.0
    legs = max(math.ceil((x1 - x0) / SWATHE), 1)
    path = []
    for leg in range(legs):
        x = x0 + (leg + 0.5) * (x1 - x0) / legs
        ends = [(x, y0, height), (x, y1, height)]
        path += ends[::-1] if leg % 2 else ends
    return path


def _vehicle(_around: Around) -> spec.Sensor:
    return spec.Mobile(
        speed=5.0,
        max_range=80.0,
        pulse_rate=100e3,
        pattern="spinning",
        field_deg=(-25.0, 15.0),
        line_rate=10.0,
        channels=32,
    )


def _along(around: Around) -> list[Point]:
    """Straight through, at the height of a roof."""
    (y0, y1), (x, _, z) = around.reach(1), around.raised(2.0)
    return [(x, y0, z), (x, y1, z)]


def _aircraft(around: Around) -> spec.Sensor:
    (x0, x1), (y0, y1) = around.reach(0), around.reach(1)
    height = max(around.high[2], around.foot[2]) + 100.0
    return spec.Airborne(
        position=((x0 + x1) / 2, y0, height), track=y1 - y0, max_range=1000.0, pulse_rate=200e3
    )


def _tractor(around: Around) -> spec.Sensor:
    return spec.Tractor(position=around.raised(1.0), step=0.01)


def _bat(around: Around) -> spec.Sensor:
    x, y, _ = around.foot
    aim = [(a + b) / 2 for a, b in zip(around.low, around.high, strict=True)]
    away = math.hypot(aim[0] - x, aim[1] - y)
    azimuth = math.degrees(math.atan2(aim[1] - y, aim[0] - x)) if away > 1.0 else 0.0
    return spec.Sonar(position=around.raised(2.0), azimuth_deg=round(azimuth, 1))


def _reverb(around: Around) -> spec.Sensor:
    x, y, z = around.raised(1.5)
    return spec.Reverb(  # the defaults are the paper's, so that scenes of before stay as they were
        source=(x, y, z), receiver=(x + 9.0, y, z), model="forest", surface="forest floor"
    )


STARTS: dict[str, Start] = {
    "terrestrial": Start(
        keep("Tripod LiDAR"),
        "terrestrial",
        KINDS["terrestrial"].icon,
        KINDS["terrestrial"].help,
        _tripod,
    ),
    "drone": Start(
        keep("Drone LiDAR"),
        "mobile",
        "OUTLINER_OB_FORCE_FIELD",
        keep("A scanner under a drone, which flies to and fro along a curve"),
        _drone,
        _over,
    ),
    "mobile": Start(
        keep("Vehicle LiDAR"),
        "mobile",
        "AUTO",
        KINDS["mobile"].help,
        _vehicle,
        _along,
    ),
    "airborne": Start(
        keep("Aircraft LiDAR"),
        "airborne",
        KINDS["airborne"].icon,
        KINDS["airborne"].help,
        _aircraft,
    ),
    "tractor": Start(
        keep("Tractor LiDAR"),
        "tractor",
        KINDS["tractor"].icon,
        KINDS["tractor"].help,
        _tractor,
    ),
    "sonar": Start(
        keep("Bat Sonar"),
        "sonar",
        KINDS["sonar"].icon,
        KINDS["sonar"].help,
        _bat,
    ),
    "reverb": Start(
        keep("Reverb"),
        "reverb",
        KINDS["reverb"].icon,
        KINDS["reverb"].help,
        _reverb,
    ),
}


def _beside(settings: type[spec.Sensor]) -> Callable[[Around], spec.Sensor]:
    return lambda around: settings(position=around.raised(1.5))


STARTS |= {  # every other kind stands where it is put
    name: Start(
        kind.settings.TITLE or name.title(), name, kind.icon, kind.help, _beside(kind.settings)
    )
    for name, kind in KINDS.items()
    if name not in {start.kind for start in STARTS.values()}
}
