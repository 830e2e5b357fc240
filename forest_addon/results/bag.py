"""Scans as ROS 2 bags: the platform's way and what came back, as a robot would have sent it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..formats.rosbag import BagWay, write_bag
from ..sensing.lidar.cloud import Cloud
from ..sensing.lidar.pattern import Sweep, pattern_of
from ..sensing.trajectory import Trajectory
from .points import origin_of, records

EVERY = 0.02  # s between two poses


def write_scan_bag(path: Path, scanner: Any, cloud: Cloud, way: Trajectory | None) -> None:
    """Write a scan as a bag (``formats.rosbag``), in the scene's own coordinates.

    way : of a scanner that follows one; of others their settings say it.

    Raises
    ------
    SpecError : the library rosbags is missing.
    OSError : it cannot be written; what had its name before stays as it was.
    """
    write_bag(path, _way(scanner, cloud, way), records(cloud))


def _way(scanner: Any, cloud: Cloud, way: Trajectory | None) -> BagWay:
    """Poses from the first return's time to the last's; one, of a scanner that stands."""
    pattern = pattern_of(scanner, way)
    if not isinstance(pattern, Sweep):
        place = origin_of(cloud)
        stands = np.array(scanner.position) if place is None else place
        return BagWay(np.zeros(1), stands[None], Rotation.identity(1))
    first, own = pattern.path.start, pattern.path.time
    last = max(float(cloud.time.max(initial=first)), first)
    times = np.unique([*np.arange(first, last, EVERY), last, *own[(own > first) & (own < last)]])
    position, attitude = pattern.path.at(times)
    return BagWay(times, np.array(position), attitude)
