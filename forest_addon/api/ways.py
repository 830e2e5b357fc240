"""Ways of moving sensors from arrays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..sensing.kinds import kind_of
from ..spec import Sensor, SpecError
from .given import called, points_of

if TYPE_CHECKING:
    from ..blender.sensors.observe import Observer
    from ..sensing.trajectory import Trajectory


def trajectory(
    time: np.ndarray,
    position: np.ndarray,
    heading_deg: np.ndarray | float = 0.0,
    pitch_deg: np.ndarray | float = 0.0,
    roll_deg: np.ndarray | float = 0.0,
) -> Trajectory:
    """The way of a platform through poses; straight lines and shortest turns between them.

    time : (K,) seconds, rising. position : (K, 3) metres. heading_deg : (K,) or one, from +X to +Y.
    pitch_deg : nose up. roll_deg : left side up.

    Raises
    ------
    SpecError : arrays that do not fit together, times that do not rise, a number that is not finite.

    >>> from forest_addon import api as forest
    >>> way = forest.trajectory([0.0, 2.0], [(0, 0, 20), (10, 0, 20)])
    >>> len(way), way.duration
    (2, 2.0)
    """
    from scipy.spatial.transform import Rotation

    from ..sensing.trajectory import Trajectory

    place = points_of("position", position)
    place = place[None] if place.ndim == 1 else place
    try:
        seconds = np.atleast_1d(np.asarray(time, dtype=np.float64))
        angles = [np.asarray(angle, np.float64) for angle in (heading_deg, pitch_deg, roll_deg)]
        turns = np.column_stack([np.broadcast_to(angle, len(place)) for angle in angles])
    except (TypeError, ValueError):
        raise SpecError(
            "trajectory", f"takes arrays of one length; there are {len(place)} positions"
        ) from None
    if seconds.shape != (len(place),):
        raise SpecError("time", f"has {seconds.size} values; give {len(place)}, one a position")
    if not (np.isfinite(seconds).all() and np.isfinite(turns).all()):
        raise SpecError("trajectory", "has a time or angle that is not finite; correct it")
    if (np.diff(seconds) <= 0).any():
        raise SpecError("time", "does not rise from pose to pose; sort the poses")
    attitude = Rotation.from_euler("ZYX", np.deg2rad(turns * [1.0, -1.0, 1.0]))
    return Trajectory(seconds, place, attitude)


def way_of(observer: Observer, sensor: Sensor, along: Any, folder: Path) -> Any:
    """Return where a sensor goes: along what was handed over, or as its settings say.

    Raises
    ------
    SpecError : a way for a sensor that stays, or one that is no trajectory.
    """
    if along is None:
        return observer.way(sensor, folder)
    from ..sensing.trajectory import Trajectory

    if not isinstance(along, Trajectory):
        raise SpecError("along", f"takes a trajectory, not {called(along)}")
    if not kind_of(sensor).moves:
        raise SpecError("along", f"is for a Mobile scanner or a Sonar, not {called(sensor)}")
    return along
