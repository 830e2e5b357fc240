"""Trajectories of real platforms as files: CSV in metres and degrees, and SBET as inertial systems write it.

A CSV has the columns ``time_s, x_m, y_m, z_m, heading_deg, pitch_deg, roll_deg``: the heading from +X
to +Y, pitch nose up, roll right side down. An SBET is 17 doubles a record (little-endian): time, latitude,
longitude, altitude, three velocities, roll, pitch, platform heading, wander angle, three accelerations,
three rates; angles in radians. The true heading is the platform's less the wander angle, and clockwise
from north.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ....formats.atomic import replacing
from ....formats.crs import to_map
from ....formats.foreign import guarded
from ....formats.table import read_columns
from ....spec import SpecError
from ..pattern import Pattern

COLUMNS = ("time_s", "x_m", "y_m", "z_m", "heading_deg", "pitch_deg", "roll_deg")
RECORD = 17  # doubles of an SBET
SBET_ENDINGS = (".sbet", ".out")


def read_trajectory(path: Path, crs: str = "") -> np.ndarray:
    """(K, 7) rows of ``COLUMNS`` in the order of time; a file that ends in .sbet or .out is an SBET.

    crs : the map's system that an SBET goes to, as EPSG:26912.

    Raises
    ------
    SpecError : a file that is something else, fewer than two poses, or times that do not rise.
    """
    rows = read_sbet(path, crs) if path.suffix.lower() in SBET_ENDINGS else read_poses(path)
    if len(rows) < 2:
        raise SpecError(str(path), f"has {len(rows)} poses; a trajectory needs two")
    if not np.isfinite(rows).all():
        raise SpecError(str(path), "has values that are no numbers")
    if (np.diff(rows[:, 0]) <= 0).any():
        late = int(np.argmax(np.diff(rows[:, 0]) <= 0)) + 2
        raise SpecError(str(path), f"pose {late} is not later than the one before; sort by time")
    return rows


@guarded("a CSV of time, place and attitude")
def read_poses(path: Path) -> np.ndarray:
    """(K, 7) rows of a CSV; lines that start with # are passed over, other columns too.

    Raises
    ------
    SpecError : columns are missing, or a value is no number.
    """
    return read_columns(path, *COLUMNS).matrix(*COLUMNS)


@guarded("an SBET")
def read_sbet(path: Path, crs: str) -> np.ndarray:
    """(K, 7) rows of an SBET in a map's metres; its altitudes are taken as they are.

    Raises
    ------
    SpecError : no system is named, pyproj is not there, or the file is no SBET.
    """
    stored = np.fromfile(path, dtype="<f8")
    if not len(stored) or len(stored) % RECORD:
        raise SpecError(str(path), f"is no SBET: {8 * len(stored)} bytes are no records of 136")
    time, lat, lon, up, _, _, _, roll, pitch, heading, wander = stored.reshape(-1, RECORD).T[:11]
    if not ((np.abs(lat) <= np.pi / 2) & (np.abs(lon) <= 2 * np.pi)).all():
        raise SpecError(str(path), "is no SBET: latitudes or longitudes are no radians")
    if not crs:
        raise SpecError("--crs", "is missing; an SBET needs the map's system, as EPSG:26912")
    east, north, grid = to_map(crs, np.degrees(lon), np.degrees(lat))
    turn = 90 - np.degrees(heading - wander) + grid
    turn = (turn + 180) % 360 - 180
    return np.column_stack([time, east, north, up, turn, np.degrees(pitch), np.degrees(roll)])


# Tables of poses for interpolated platforms of HELIOS++: time, attitude, place.


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
