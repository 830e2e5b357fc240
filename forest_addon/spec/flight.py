"""A flyer that moves through the forest: what its body can do, what it aims at, what it knows of itself."""

from __future__ import annotations

from typing import ClassVar

from .base import Settings, SpecError, param
from .sensor import azimuth

BODIES = ("bat", "bird", "planar", "quadrotor")


class Flight(Settings):
    """A flyer in the forest; it senses with the scene's first mobile scanner and its first sonar."""

    TITLE: ClassVar[str] = "Flight"
    body: str = param(
        "bat",
        help="how it moves: a point mass with limits (bat), even speed ahead and a little sideways (bird, of "
        "Karaman & Frazzoli 2012), even speed and turns (planar), or by tilting (quadrotor)",
        choices=BODIES,
    )
    radius: float = param(
        0.15,
        unit="m",
        help="radius of the sphere around the flyer that must not touch anything",
        gt=0,
        le=5,
    )
    speed: float = param(
        5.0,
        unit="m/s",
        help="largest speed; a bird and a planar flyer always have it",
        gt=0,
        le=100,
    )
    slowest: float = param(
        1.0, unit="m/s", help="least speed of a bat through the air", ge=0, le=100
    )
    acceleration: float = param(
        10.0, unit="m/s²", help="largest acceleration, along and across the way", gt=0, le=1000
    )
    turn_rate_deg: float = param(
        180.0, unit="deg/s", help="largest rate of turning about the vertical", gt=0, le=3600
    )
    climb: float = param(2.0, unit="m/s", help="largest speed up or down", ge=0, le=100)
    sideways: float = param(2.0, unit="m/s", help="largest speed across of a bird", gt=0, le=100)
    tilt_deg: float = param(35.0, unit="deg", help="largest tilt of a quadrotor", gt=0, le=80)
    response: float = param(
        0.1, unit="s", help="time in which a quadrotor's tilt follows", gt=0, le=10
    )
    wind: tuple[float, float, float] = param(
        (0.0, 0.0, 0.0), unit="m/s", help="steady wind that carries it", ge=-100, le=100
    )
    step: float = param(0.05, unit="s", help="time between two decisions", gt=0, le=10)
    steps: int = param(
        1000, help="number of decisions after which a flight ends", ge=1, le=100_000_000
    )
    aim: str = param(
        "goal",
        help="reach a place at the distance below, or get so far along the heading",
        choices=("goal", "heading"),
    )
    distance: float = param(50.0, unit="m", help="from the start to the aim", gt=0, le=1e5)
    reached: float = param(
        2.0, unit="m", help="distance at which a goal counts as reached", gt=0, le=1000
    )
    heading_deg: float = azimuth(0.0, "direction of the aim")
    start: tuple[float, float, float] | None = param(
        None, unit="m", help="where it starts; left out: drawn from the box below", ge=-1e7, le=1e7
    )
    start_low: tuple[float, float] = param(
        (0.0, 0.2), help="box of starts in shares of the field, its smallest corner", ge=-10, le=10
    )
    start_high: tuple[float, float] = param(
        (0.05, 0.8), help="largest corner of that box", ge=-10, le=10
    )
    height: float = param(
        2.0, unit="m", help="height above the ground of a start that is drawn", gt=0, le=1000
    )
    clearance: float = param(
        0.5,
        unit="m",
        help="distance around a start that is drawn in which nothing stands",
        ge=0,
        le=100,
    )
    thinnest: float = param(
        0.01,
        unit="m",
        help="radius of the thinnest wood that stops it; leaves and twigs brush",
        ge=0,
        le=1,
    )
    position_sd: float = param(
        0.0, unit="m", help="standard deviation of the place that the flyer measures", ge=0, le=100
    )
    velocity_sd: float = param(
        0.0, unit="m/s", help="standard deviation of the velocity that it measures", ge=0, le=100
    )
    heading_sd_deg: float = param(
        0.0, unit="deg", help="standard deviation of the heading that it measures", ge=0, le=90
    )

    def check(self) -> None:
        if self.slowest > self.speed:
            raise SpecError("slowest", f"{self.slowest:g} m/s must be at most the speed")
        for axis in (0, 1):
            if self.start_low[axis] > self.start_high[axis]:
                raise SpecError(f"start_low[{axis}]", "must be at most that of start_high")
