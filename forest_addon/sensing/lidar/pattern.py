"""Pulses of a scanner by their number: where each starts, where it goes, when, at what angle.

A ``Pattern`` is a function of the pulse's number alone, so that a scan can be cut into chunks anywhere.
On a tripod the number counts rows of elevation within columns of azimuth. On a moving platform it gives
the time, the time gives the place (``trajectory``) and the place of the beam within its sweep.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy

from ...base.attitudes import composed
from ...base.rows import RowTable
from ...spec import Airborne, Mobile, MovingScanner, SpecError, Terrestrial, refuse_absurd
from ..trajectory import Trajectory, strips, through

LiDAR = Terrestrial | Mobile | Airborne


@dataclass(frozen=True)
class Pulses(RowTable):
    """P pulses.

    origin : (P, 3) metres. direction : (P, 3) unit vectors. across : (P, 3) unit vectors at right angles
    to it, in the direction of the sweep. time : (P,) seconds. scan_angle : (P,) radians.
    """

    origin: np.ndarray
    direction: np.ndarray
    across: np.ndarray
    time: np.ndarray
    scan_angle: np.ndarray


class Pattern(Protocol):
    """All pulses of a scan."""

    count: int

    def pulses(self, number: np.ndarray) -> Pulses:
        """The pulses of these numbers (P,), from 0 to ``count`` - 1."""
        ...


def pattern_of(scanner: LiDAR, path: Trajectory | None = None) -> Pattern:
    """The pattern of a scanner.

    path : where a mobile scanner goes that follows a curve or an object.

    Raises
    ------
    SpecError : a mobile scanner that has nowhere to go.
    """
    if isinstance(scanner, Terrestrial):
        return Tripod(scanner)
    if isinstance(scanner, Airborne):
        return Sweep(scanner, strips(scanner))
    if path is None:
        if not scanner.poses:
            raise SpecError("poses", "are missing; give poses, or the object to follow")
        path = through(scanner.poses)
    return Sweep(scanner, path)


def directions(scanner: Terrestrial) -> tuple[np.ndarray, np.ndarray]:
    """Azimuths of the columns and elevations of the rows that a tripod looks in, radians."""
    step = np.deg2rad(scanner.angle_step_deg)
    line_step = step if scanner.line_step_deg is None else np.deg2rad(scanner.line_step_deg)
    low, high = np.deg2rad(scanner.azimuth_deg)
    azimuth = steps(low, high, step)
    if scanner.azimuth_deg[1] - scanner.azimuth_deg[0] >= 360:
        azimuth = azimuth[azimuth < low + 2 * np.pi - 1e-9]  # no direction twice
    lowest, highest = np.deg2rad(scanner.elevation_deg)
    return azimuth, steps(lowest, highest, line_step)


class Tripod:
    """Azimuth by elevation, column by column."""

    def __init__(self, scanner: Terrestrial) -> None:
        self._scanner = scanner
        self._azimuth, self._elevation = directions(scanner)
        self.count = len(self._azimuth) * len(self._elevation)

    def pulses(self, number: np.ndarray) -> Pulses:
        """See ``Pattern``; the scan angle is the elevation."""
        column, row = np.divmod(number, len(self._elevation))
        el = self._elevation[row]
        cos_az, sin_az = np.cos(self._azimuth)[column], np.sin(self._azimuth)[column]
        cos_el, sin_el = np.cos(self._elevation)[row], np.sin(self._elevation)[row]
        way = np.stack([cos_el * cos_az, cos_el * sin_az, sin_el], axis=1)
        return Pulses(
            origin=np.broadcast_to(np.array(self._scanner.position), way.shape),
            direction=way,
            across=np.stack([-sin_az, cos_az, np.zeros(len(number))], axis=1),
            time=number / self._scanner.pulse_rate,
            scan_angle=el,
        )


class Sweep:
    """A beam that sweeps while its platform moves along a ``path``."""

    def __init__(self, scanner: MovingScanner, path: Trajectory) -> None:
        self._scanner, self.path = scanner, path
        self._field = np.deg2rad(scanner.field_deg)
        roll, pitch, yaw = np.deg2rad(scanner.mount_deg)
        self.mount = scipy.spatial.transform.Rotation.from_euler("ZYX", [yaw, -pitch, roll])
        # A platform that stands still sweeps one line, or turns once.
        duration = path.duration or 1 / scanner.line_rate
        refuse_absurd("speed", duration * scanner.pulse_rate, scanner.beam.subrays)
        self.count = max(1, int(np.floor(duration * scanner.pulse_rate * (1 + 1e-12) + 1e-9)))

    def pulses(self, number: np.ndarray) -> Pulses:
        """See ``Pattern``; the scan angle is counted from nadir, spinning: from the horizon."""
        time = number / self._scanner.pulse_rate
        way, across, angle = self.ways(number)
        where, attitude = self.path.at(self.path.start + time)
        turn = composed(attitude, self.mount)
        return Pulses(
            origin=where,
            direction=turn.apply(way),
            across=turn.apply(across),
            time=self.path.start + time,
            scan_angle=angle,
        )

    def ways(self, number: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(P, 3) directions of pulses in the scanner's own frame, (P, 3) across them, (P,) scan angles."""
        scanner = self._scanner
        turns = number * scanner.line_rate / scanner.pulse_rate  # whole ones stay whole
        if scanner.pattern in ("spinning", "rosette"):
            return self._around(number, turns)
        return self._circles(turns) if scanner.pattern == "circles" else self._lines(turns)

    def _lines(self, turns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A fan across the way, swept from left to right, or to and fro; or three that lean by turns.

        Of three fans, as of a mirror whose facets lean differently, the first line looks down, the second
        ahead, the third back.
        """
        line, place = np.divmod(turns, 1.0)
        if self._scanner.pattern == "zigzag":
            place = np.where(line % 2 == 1, 1.0 - place, place)
        angle = self._field[0] + place * (self._field[1] - self._field[0])
        cos, sin, lean = np.cos(angle), np.sin(angle), np.zeros(len(turns))
        if self._scanner.pattern == "fans":
            lean = (
                np.deg2rad(self._scanner.fan_deg) * np.array([0.0, 1.0, -1.0])[line.astype(int) % 3]
            )
        ahead, down = np.sin(lean), np.cos(lean)
        way = np.stack([cos * ahead, -sin, -cos * down], 1)
        return way, np.stack([-sin * ahead, -cos, sin * down], 1), angle

    def _circles(self, turns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A cone about nadir (Palmer scan), clockwise seen from above, from straight ahead on."""
        turn = 2 * np.pi * turns
        cone = float(self._field[1])
        cos, sin = np.cos(turn), np.sin(turn)
        way = np.stack(
            [np.sin(cone) * cos, -np.sin(cone) * sin, np.full(len(turns), -np.cos(cone))], 1
        )
        across = np.stack([-sin, -cos, np.zeros(len(turns))], 1)
        return way, across, np.where(sin >= 0, cone, -cone)

    def _around(
        self, number: np.ndarray, turns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All around, clockwise: channels from the lowest up, fired one after the other while the head turns;
        or a rosette, a beam that swings up and down meanwhile."""
        scanner, (low, high) = self._scanner, self._field
        if scanner.pattern == "rosette":
            swing = np.sin(2 * np.pi * scanner.petals * turns)
            el, turn = (low + high) / 2 + (high - low) / 2 * swing, -2 * np.pi * turns
        else:
            channels, rate = scanner.channels, -2 * np.pi * scanner.line_rate
            turn = rate * (number // channels) * channels / scanner.pulse_rate
            elevation = np.linspace(low, high, channels) if channels > 1 else self._field[:1]
            el = elevation[number % channels]
        cos, sin = np.cos(turn), np.sin(turn)
        way = np.stack([np.cos(el) * cos, np.cos(el) * sin, np.sin(el)], 1)
        return way, np.stack([sin, -cos, np.zeros(len(number))], 1), el


# Even steps, without the drift of adding them up.


def steps(low: float, high: float, step: float) -> np.ndarray:
    """Steps from ``low`` to at most ``high``; a last one that rounding would lose is kept."""
    return low + step * np.arange(int(np.floor((high - low) / step + 1e-9)) + 1)
