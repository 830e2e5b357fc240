"""Poses of a sonar: where it is, where it looks and how it moves; ``Ears`` places receivers in its frame.

A pose is a place, a frame (the beam's axis, left, up) and a velocity. ``posed`` makes one from settings,
``poses_of`` many from a trajectory.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...spec import Sonar
from ..trajectory import Trajectory, frame_of


@dataclass(frozen=True)
class SonarPose:
    """One place of a sonar.

    position : (3,) metres. frame : (3, 3) rows: the axis of the beam, to its left, up.
    velocity : (3,) m/s. width : full -3 dB width in radians instead of the sonar's own, or None.
    time : s, when it pings.
    """

    position: np.ndarray
    frame: np.ndarray
    velocity: np.ndarray
    width: float | None = None
    time: float = 0.0


def posed(sonar: Sonar) -> SonarPose:
    """The pose that the settings say; its speed is along the beam."""
    frame = frame_of(math.radians(sonar.azimuth_deg), math.radians(sonar.elevation_deg))
    return SonarPose(np.asarray(sonar.position, dtype=np.float64), frame, sonar.speed * frame[0])


def poses_of(trajectory: Trajectory) -> list[SonarPose]:
    """The poses of a trajectory; one that says no velocity stands still at each."""
    count = len(trajectory)
    velocity = np.zeros((count, 3)) if trajectory.velocity is None else trajectory.velocity
    width = [None] * count if trajectory.width is None else trajectory.width.tolist()
    time = trajectory.time.tolist()
    each = zip(trajectory.position, trajectory.frames, velocity, width, time, strict=True)
    return [SonarPose(*one) for one in each]


@dataclass(frozen=True)
class Ears:
    """E receivers in the frame of the sonar: ``offset`` (E, 3) metres from where the call is sent,
    ``frame`` (E, 3, 3) of their own axis, left and up, in the sonar's frame."""

    offset: np.ndarray
    frame: np.ndarray

    def __len__(self) -> int:
        return len(self.offset)

    @classmethod
    def of(cls, sonar: Sonar) -> Ears:
        """Evenly on a line across the beam, the first to the left; a single one where the call starts."""
        side = np.linspace(1.0, -1.0, sonar.ears) if sonar.ears > 1 else np.zeros(1)
        offset = np.zeros((sonar.ears, 3))
        offset[:, 1] = side * sonar.ear_spacing / 2
        turn = np.deg2rad(sonar.ear_turn_deg) * side
        return cls(offset, np.array([frame_of(float(a), 0.0) for a in turn]))
