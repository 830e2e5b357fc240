"""Where a sonar is, where it looks and how it moves: poses, single or along a way.

A pose is a place, a frame (the beam's axis, left, up) and a velocity. ``posed`` makes one from settings,
``along`` many from places and angles, with velocities along the way; animated objects and curves are
read by ``blender/motion``. ``Ears`` places receivers in the frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...spec import Sonar
from .beam import beam_frame


@dataclass(frozen=True)
class Pose:
    """One place of a sonar.

    position : (3,) metres. frame : (3, 3) rows: the axis of the beam, to its left, up.
    velocity : (3,) m/s. width : full -3 dB width in radians instead of the sonar's own, or None.
    """

    position: np.ndarray
    frame: np.ndarray
    velocity: np.ndarray
    width: float | None = None


def posed(sonar: Sonar) -> Pose:
    """The pose that the settings say; its speed is along the beam."""
    frame = beam_frame(math.radians(sonar.azimuth_deg), math.radians(sonar.elevation_deg))
    return Pose(np.asarray(sonar.position, dtype=np.float64), frame, sonar.speed * frame[0])


def along(
    position: np.ndarray,
    azimuth: np.ndarray,
    elevation: np.ndarray,
    width: np.ndarray | None = None,
    speed: float = 0.0,
) -> list[Pose]:
    """Poses at places (P, 3) looking to angles (P,), flown through in order at a speed in m/s.

    width : (P,) full -3 dB widths in radians, or None. A single pose flies along its beam.
    """
    frames = [beam_frame(float(a), float(e)) for a, e in zip(azimuth, elevation, strict=True)]
    poses = [
        Pose(place, frame, speed * frame[0], None if width is None else float(width[number]))
        for number, (place, frame) in enumerate(zip(position, frames, strict=True))
    ]
    if len(poses) < 2 or not speed:
        return poses
    step = np.gradient(position, axis=0)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    way = np.divide(step, length, out=np.zeros_like(step), where=length > 0)
    return [
        replace(pose, velocity=speed * towards) for pose, towards in zip(poses, way, strict=True)
    ]


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
        return cls(offset, np.array([beam_frame(float(a), 0.0) for a in turn]))
