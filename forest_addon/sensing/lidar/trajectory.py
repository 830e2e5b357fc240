"""Where a moving scanner is, and how it is turned, at any time.

A ``Path`` is a list of poses that a platform goes through evenly: positions along straight lines,
attitudes along the shortest turn (slerp). ``Strips`` are parallel straight flights, back and forth. The
frame of a platform is X forward, Y left, Z up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ...spec import Airborne, Pose


class Trajectory(Protocol):
    """What a scanner asks of a platform."""

    @property
    def start(self) -> float:
        """Seconds at which it begins."""
        ...

    @property
    def duration(self) -> float:
        """Seconds that it takes; 0 where the platform stands still."""
        ...

    def at(self, time: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """(P, 3) positions and P attitudes, platform to world, at times (P,)."""
        ...


@dataclass(frozen=True)
class Path:
    """Poses in the order of time.

    time : (K,) seconds, rising. position : (K, 3) metres. attitude : K rotations, platform to world.
    """

    time: np.ndarray
    position: np.ndarray
    attitude: Rotation

    @property
    def start(self) -> float:
        """Time of the first pose."""
        return float(self.time[0])

    @property
    def duration(self) -> float:
        """Seconds from the first pose to the last."""
        return float(self.time[-1] - self.time[0])

    def at(self, time: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """See ``Trajectory``; before the first pose and after the last the platform stands still."""
        time = np.clip(time, self.time[0], self.time[-1])
        if len(self.time) == 1:
            where = np.broadcast_to(self.position[0], (len(time), 3))
            return where, self.attitude[np.zeros(len(time), dtype=np.int64)]
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        share = (time - self.time[after - 1]) / (self.time[after] - self.time[after - 1])
        step = self.position[after] - self.position[after - 1]
        where = self.position[after - 1] + share[:, None] * step
        return where, Slerp(self.time, self.attitude)(time)


def path_of(poses: Sequence[Pose]) -> Path:
    """The path through poses of a scene file, in the order of time; at least one."""
    angles = np.deg2rad([[p.heading_deg, -p.pitch_deg, p.roll_deg] for p in poses])
    return Path(
        time=np.array([pose.time for pose in poses]),
        position=np.array([pose.position for pose in poses]),
        attitude=Rotation.from_euler(
            "ZYX", angles
        ),  # pitch: the nose, X, goes up for a turn about -Y
    )


def path_along(points: np.ndarray, speed: float) -> Path:
    """Along a polyline (K, 3) at an even speed, level sideways and forward along the line.

    Raises
    ------
    ValueError : fewer than two different points.
    """
    points = points[np.append(True, (np.diff(points, axis=0) != 0).any(axis=1))]
    if len(points) < 2:
        raise ValueError("a path needs two different points")
    way = np.diff(points, axis=0)
    length = np.linalg.norm(way, axis=1)
    tangent = way / length[:, None]
    tangent = np.concatenate([tangent[:1], tangent[:-1] + tangent[1:], tangent[-1:]])
    heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    pitch = np.arctan2(tangent[:, 2], np.hypot(tangent[:, 0], tangent[:, 1]))
    attitude = Rotation.from_euler("ZY", np.column_stack([heading, -pitch]))
    return Path(np.concatenate([[0.0], np.cumsum(length)]) / speed, points, attitude)


class Strips:
    """The flight of an airborne scanner; turning round takes no time."""

    start = 0.0

    def __init__(self, flight: Airborne) -> None:
        self._flight = flight
        self._strip_time = flight.track / flight.speed
        self.duration = flight.strips * self._strip_time

    def at(self, time: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """See ``Trajectory``."""
        flight = self._flight
        heading = np.deg2rad(flight.heading_deg)
        forward = np.array([np.cos(heading), np.sin(heading), 0.0])
        right = np.array([forward[1], -forward[0], 0.0])
        strip = np.clip((time / self._strip_time).astype(np.int64), 0, flight.strips - 1)
        gone = (time - strip * self._strip_time) * flight.speed
        back = strip % 2 == 1
        along = np.where(back, flight.track - gone, gone)
        where = (
            np.array(flight.position)
            + along[:, None] * forward
            + (strip * flight.spacing)[:, None] * right
        )
        turn = np.where(back, heading + np.pi, heading)
        return where, Rotation.from_euler("Z", turn[:, None])
