"""Tables of poses for interpolated platforms of HELIOS++: time, attitude, place."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ....formats.atomic import replacing
from ..scanner import Pattern

Poses = tuple[np.ndarray, np.ndarray, np.ndarray]


def write_poses(path: Path, poses: Poses) -> None:
    """Write times (K,) in seconds, roll, pitch and yaw (K, 3) in degrees and places (K, 3) in metres."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial:
        np.savetxt(
            partial,
            np.column_stack(poses),
            fmt="%.14g",
            delimiter=",",
            comments="#",
            header='HEADER: "t", "roll", "pitch", "yaw", "x", "y", "z"',
        )


def canonical(attitude: Rotation) -> np.ndarray:
    """(K, 3) roll, pitch and yaw of attitudes, degrees, as HELIOS++'s CANONICAL turns them, without jumps.

    Where roll and yaw turn about one axis (a pitch of 90 degrees) yaw is 0, right to 1e-7.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Gimbal lock")
        angles = attitude.as_euler("XYZ")
    return np.asarray(np.rad2deg(np.unwrap(angles, axis=0)))


def beam_poses(pattern: Pattern, rate: float) -> Poses:
    """Poses of a platform that carries a beam which looks ahead, so that it goes where a pattern's pulses go.

    A pulse of theirs leaves at the end of its period: the first at 1/rate, and the platform waits for it.
    """
    pulses = pattern.pulses(np.arange(pattern.count))
    beside = np.cross(pulses.direction, pulses.across)
    axes = np.stack([beside, pulses.direction, pulses.across], axis=2)
    rows = np.append(0, np.arange(pattern.count))
    time = np.arange(pattern.count + 1) / rate
    angles = canonical(Rotation.from_matrix(axes))
    return time, angles[rows], np.asarray(pulses.origin)[rows]
