"""One way through a scene: where a moving sensor is, how it is turned and how fast it goes, at any time.

A ``Trajectory`` is a list of poses in the order of time: positions along straight lines between them,
attitudes along the shortest turn (slerp). It comes from the poses of a scene file (``through``), from arrays
or a file of places and angles (``looking``), from a curve (``along``), or from an animated object
(``moving``); ``strips`` are parallel straight flights, back and forth. A LiDAR asks it at any time; a sonar,
which measures at single places, takes its poses, on a curve evenly (``visits``). The frame of a platform is X
forward, Y left, Z up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy

from ..base.attitudes import Turning
from ..base.vectors import azimuth_of, elevation_of
from ..spec import Airborne, Pose, SpecError

SMALL = 1e-3  # of a curve's length, over which its direction is taken


@dataclass(frozen=True)
class Trajectory:
    """K poses in the order of time.

    time : (K,) seconds, rising. position : (K, 3) metres. frame : (K, 3, 3) rows forward, left, up: platform
    to world. velocity : (K, 3) m/s, or None where nobody asked for it. width : (K,) full -3 dB widths in
    radians of a beam that changes on the way, or None.
    """

    time: np.ndarray
    position: np.ndarray
    attitude: scipy.spatial.transform.Rotation
    frame: np.ndarray | None = None
    velocity: np.ndarray | None = None
    width: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def start(self) -> float:
        """Time of the first pose, s."""
        return float(self.time[0])

    @property
    def duration(self) -> float:
        """Seconds from the first pose to the last; 0 where the platform stands still."""
        return float(self.time[-1] - self.time[0])

    @property
    def frames(self) -> np.ndarray:
        """(K, 3, 3) rows forward, left, up of each pose, in the world."""
        if self.frame is not None:
            return self.frame
        return np.asarray(self.attitude.as_matrix().transpose(0, 2, 1))

    def take(self, rows: np.ndarray) -> Trajectory:
        """The poses of these rows (P,)."""

        def some(values: np.ndarray | None) -> np.ndarray | None:
            return None if values is None else values[rows]

        return Trajectory(
            self.time[rows],
            self.position[rows],
            self.attitude[rows],
            some(self.frame),
            some(self.velocity),
            some(self.width),
        )

    def at(self, time: np.ndarray) -> tuple[np.ndarray, scipy.spatial.transform.Rotation]:
        """(P, 3) positions and P attitudes, platform to world, at times (P,); before the first pose and after
        the last the platform stands still."""
        time = np.clip(time, self.time[0], self.time[-1])
        if len(self.time) == 1:
            where = np.broadcast_to(self.position[0], (len(time), 3))
            return where, self.attitude[np.zeros(len(time), dtype=np.int64)]
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        share = (time - self.time[after - 1]) / (self.time[after] - self.time[after - 1])
        step = self.position[after] - self.position[after - 1]
        where = self.position[after - 1] + share[:, None] * step
        return where, self._turning.at(time)

    @cached_property
    def _turning(self) -> Turning:
        return Turning(self.time, self.attitude)

    def visits(
        self, count: int, azimuth: float = 0.0, elevation: float = 0.0, speed: float = 0.0
    ) -> Trajectory:
        """Poses, ``count`` of them evenly in time, which look along the trajectory and stay level.

        azimuth, elevation : radians by which they are turned from there. speed : m/s along the
        trajectory. The last pose of a trajectory that comes back to its start is left out.
        """
        closed = bool((self.position[0] == self.position[-1]).all())
        last = float(self.time[-1])
        time = np.linspace(self.time[0], last, count, endpoint=not closed)
        small = SMALL * self.duration
        ahead, behind = np.minimum(time + small, last), np.maximum(time - small, self.time[0])
        step = self._between(ahead) - self._between(behind)
        turn = azimuth_of(step) + azimuth
        rise = elevation_of(step) + elevation
        rise = np.clip(rise, -math.pi / 2, math.pi / 2)
        velocity = speed * (step / np.linalg.norm(step, axis=1, keepdims=True))
        return _framed(time, self._between(time), frames_of(turn, rise), velocity)

    def _between(self, time: np.ndarray) -> np.ndarray:
        """(P, 3) positions at times (P,)."""
        return np.stack([np.interp(time, self.time, axis) for axis in self.position.T], axis=1)


def _framed(
    time: np.ndarray,
    position: np.ndarray,
    frame: np.ndarray,
    velocity: np.ndarray | None = None,
    width: np.ndarray | None = None,
) -> Trajectory:
    attitude = scipy.spatial.transform.Rotation.from_matrix(frame.transpose(0, 2, 1))
    return Trajectory(time, position, attitude, frame, velocity, width)


def frames_of(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """(P, 3, 3) rows forward, left, up of level platforms that look to angles (P,), radians."""
    return np.array([frame_of(float(a), float(e)) for a, e in zip(azimuth, elevation, strict=True)])


def frame_of(azimuth: float, elevation: float) -> np.ndarray:
    """(3, 3) rows forward, left, up of a level platform that looks to these angles, radians."""
    cos_az, sin_az = math.cos(azimuth), math.sin(azimuth)
    cos_el, sin_el = math.cos(elevation), math.sin(elevation)
    return np.array(
        [
            [cos_el * cos_az, cos_el * sin_az, sin_el],
            [-sin_az, cos_az, 0.0],
            [-sin_el * cos_az, -sin_el * sin_az, cos_el],
        ]
    )


def through(poses: Sequence[Pose]) -> Trajectory:
    """The trajectory through poses of a scene file, in the order of time; at least one."""
    angles = np.deg2rad([[p.heading_deg, -p.pitch_deg, p.roll_deg] for p in poses])
    return Trajectory(
        time=np.array([pose.time for pose in poses]),
        position=np.array([pose.position for pose in poses]),
        # pitch: the nose, X, goes up for a turn about -Y
        attitude=scipy.spatial.transform.Rotation.from_euler("ZYX", angles),
    )


def looking(
    position: np.ndarray,
    azimuth: np.ndarray,
    elevation: np.ndarray,
    width: np.ndarray | None = None,
    speed: float = 0.0,
    time: np.ndarray | None = None,
) -> Trajectory:
    """Places (P, 3) looking to angles (P,), radians, flown through in order at a speed in m/s.

    width : (P,) full -3 dB widths of a beam, radians, or None. time : (P,) s, rising; left out: as the speed
    takes from place to place, a second where it stays at one, and everywhere without a speed. A single pose
    flies where it looks.
    """
    frame = frames_of(azimuth, elevation)
    velocity = speed * frame[:, 0]
    if len(position) > 1 and speed:
        step = np.gradient(position, axis=0)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        velocity = speed * np.divide(step, length, out=np.zeros_like(step), where=length > 0)
    if time is None:
        gone = np.linalg.norm(np.diff(position, axis=0), axis=1)
        lasts = np.where(gone > 0, gone / speed, 1.0) if speed else np.ones(len(gone))
        time = np.append(0.0, np.cumsum(lasts))
    return _framed(time, position, frame, velocity, width)


def along(points: np.ndarray, speed: float) -> Trajectory:
    """Along a polyline (K, 3) at an even speed, level sideways and forward along the line.

    Raises
    ------
    ValueError : fewer than two different points.
    """
    points = np.concatenate([points[:1], points[1:][(np.diff(points, axis=0) != 0).any(axis=1)]])
    if len(points) < 2:
        raise ValueError("a trajectory needs two different points")
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    tangent = step / length[:, None]
    tangent = np.concatenate([tangent[:1], tangent[:-1] + tangent[1:], tangent[-1:]])
    heading = np.unwrap(azimuth_of(tangent))
    pitch = elevation_of(tangent)
    attitude = scipy.spatial.transform.Rotation.from_euler("ZY", np.column_stack([heading, -pitch]))
    return Trajectory(np.concatenate([[0.0], np.cumsum(length)]) / speed, points, attitude)


def moving(time: np.ndarray, matrix: np.ndarray, velocity: np.ndarray | None = None) -> Trajectory:
    """An object's matrices (K, 4, 4) at times (K,): its X axis looks forward, its Z axis up.

    Raises
    ------
    ValueError : its scale is zero, so that it has no direction.
    """
    if np.any(np.abs(np.linalg.det(matrix[:, :3, :3])) < 1e-12):
        raise ValueError("has a scale of zero; give it a size")
    forward = matrix[:, :3, 0] / np.linalg.norm(matrix[:, :3, 0], axis=1, keepdims=True)
    left = np.cross(matrix[:, :3, 2], forward)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    frame = np.stack([forward, left, np.cross(forward, left)], axis=1)
    return _framed(time, matrix[:, :3, 3].copy(), frame, velocity)


@dataclass(frozen=True)
class Strips(Trajectory):
    """The strips of an airborne scanner, back and forth; turning round takes no time.

    Its poses are the ends of the strips.
    """

    flight: Airborne | None = None

    def at(self, time: np.ndarray) -> tuple[np.ndarray, scipy.spatial.transform.Rotation]:
        """See ``Trajectory``."""
        flight = self.flight
        assert flight is not None
        heading = np.deg2rad(flight.heading_deg)
        forward = np.array([np.cos(heading), np.sin(heading), 0.0])
        right = np.array([forward[1], -forward[0], 0.0])
        strip_time = flight.track / flight.speed
        strip = np.clip((time / strip_time).astype(np.int64), 0, flight.strips - 1)
        gone = (time - strip * strip_time) * flight.speed
        back = strip % 2 == 1
        travelled = np.where(back, flight.track - gone, gone)
        where = (
            np.array(flight.position)
            + travelled[:, None] * forward
            + (strip * flight.spacing)[:, None] * right
        )
        turn = np.where(back, heading + np.pi, heading)
        return where, scipy.spatial.transform.Rotation.from_euler("Z", turn[:, None])


def strips(flight: Airborne) -> Strips:
    """The trajectory of an airborne scanner."""
    heading = np.deg2rad(flight.heading_deg)
    forward = np.array([np.cos(heading), np.sin(heading), 0.0])
    right = np.array([forward[1], -forward[0], 0.0])
    number = np.arange(flight.strips)
    near = np.array(flight.position) + (number * flight.spacing)[:, None] * right
    ends = np.stack([near, near + flight.track * forward], axis=1)
    ends[1::2] = ends[1::2, ::-1]
    turn = np.where(np.repeat(number, 2) % 2 == 1, heading + np.pi, heading)
    strip_time = flight.track / flight.speed
    return Strips(
        time=np.repeat(np.arange(flight.strips + 1), 2)[1:-1] * strip_time,
        position=ends.reshape(-1, 3),
        attitude=scipy.spatial.transform.Rotation.from_euler("Z", turn[:, None]),
        flight=flight,
    )


class Follower(Protocol):
    """Blender's scene, asked about an object by its name.

    Raises
    ------
    SpecError : there is no such object, or it has no direction.
    """

    def curve(self, name: str) -> np.ndarray | None:
        """(K, 3) points of a curve, the last the first of a closed one; None of what moves as an object."""
        ...

    def motion(self, name: str, count: int | None = None) -> Trajectory:
        """The poses of an object over the scene's frames: at each, or so many evenly, with velocities."""
        ...


def followed(follower: Follower, name: str, speed: float) -> Trajectory:
    """The trajectory of a platform that follows a curve at a speed in m/s, or an animated object.

    Raises
    ------
    SpecError : there is no such object, or it goes nowhere.
    """
    points = follower.curve(name)
    if points is None:
        return follower.motion(name)
    try:
        return along(points, speed)
    except ValueError:
        raise SpecError("follow", f'the curve "{name}" has no length; draw it') from None
