"""Ways and points as ROS 2 messages in an MCAP file, by the library rosbags.

Frames are those of REP 105, axes those of REP 103: ``map`` and ``odom`` are the scene (X east, Y north,
Z up, metres), ``base_link`` is the platform (X forward, Y left, Z up). ``/tf_static`` holds map to odom,
``/tf`` odom to base_link; ``/odom`` has the velocity in the platform's frame. ``/points`` are clouds in
``base_link`` as it is at their stamp, each return moved there from where the platform was when it came
(de-skewed). Stamps are the scene's time plus one second: time 0 has a meaning of its own in ROS.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from .atomic import replacing
from .foreign import library

START = 1.0  # s, the stamp of time 0
CLOUD = 0.1  # s of returns that are one message
FLOAT32, INT32, UINT8 = 7, 5, 2  # of sensor_msgs/PointField
FIELDS = (
    *((axis, "<f4", FLOAT32) for axis in "xyz"),
    ("intensity", "<f4", FLOAT32),
    ("time", "<f4", FLOAT32),  # s after the stamp
    ("tree", "<i4", INT32),
    ("species", "<i4", INT32),
    ("organ", "u1", UINT8),
    ("return_number", "u1", UINT8),
)


@dataclass(frozen=True)
class BagWay:
    """K poses of a platform: time (K,) s, rising; position (K, 3) m; attitude, platform to world; nearest
    (K,) m to the nearest thing around, NaN where it is not known, or None."""

    time: np.ndarray
    position: np.ndarray
    attitude: Rotation
    nearest: np.ndarray | None = None


def write_bag(
    path: str | os.PathLike[str],
    way: BagWay,
    points: np.ndarray | None = None,
    reach: float = 100.0,
) -> None:
    """Write a bag.

    points : (P,) rows with x, y, z in the scene, time, amplitude, tree, species, organ, return_number.
    reach : metres that ``nearest`` was looked for.

    Raises
    ------
    SpecError : the library is missing.
    OSError : it cannot be written; what had its name before stays as it was.
    """
    bags = library(path, "files", "rosbags.rosbag2")
    types = library(path, "files", "rosbags.typesys")
    store = types.get_typestore(types.Stores.ROS2_HUMBLE)
    made = _Messages(store)
    with tempfile.TemporaryDirectory(prefix=".bag-", dir=Path(path).resolve().parent) as folder:
        home = Path(folder) / "bag"
        with bags.Writer(home, version=9, storage_plugin=bags.StoragePlugin.MCAP) as writer:
            topics: dict[str, Any] = {}
            messages = [*made.still(), *made.poses(way, reach), *made.clouds(way, points)]
            for stamp, topic, message in sorted(messages, key=lambda entry: entry[0]):
                kind = message.__msgtype__
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(topics[topic], stamp, store.serialize_cdr(message, kind))
        (bag,) = home.glob("*.mcap")
        with replacing(path) as partial:
            bag.replace(partial)


class _Messages:
    """Messages of a bag: stamp in ns, topic, content."""

    def __init__(self, store: Any) -> None:
        self._types = store.types

    def _make(self, kind: str, *values: Any) -> Any:
        return self._types[kind](*values)

    def _head(self, stamp: int, frame: str) -> Any:
        time = self._make("builtin_interfaces/msg/Time", stamp // 10**9, stamp % 10**9)
        return self._make("std_msgs/msg/Header", time, frame)

    def _transform(self, stamp: int, frames: tuple[str, str], place: np.ndarray, turn: Any) -> Any:
        move = self._make("geometry_msgs/msg/Vector3", *map(float, place))
        spin = self._make("geometry_msgs/msg/Quaternion", *map(float, turn))
        both = self._make("geometry_msgs/msg/Transform", move, spin)
        return self._make(
            "geometry_msgs/msg/TransformStamped", self._head(stamp, frames[0]), frames[1], both
        )

    def still(self) -> Iterator[tuple[int, str, Any]]:
        """The scene's frames."""
        stamp = _stamp(0.0)
        fixed = self._transform(stamp, ("map", "odom"), np.zeros(3), (0, 0, 0, 1))
        yield stamp, "/tf_static", self._make("tf2_msgs/msg/TFMessage", [fixed])

    def poses(self, way: BagWay, reach: float) -> Iterator[tuple[int, str, Any]]:
        """Transform, odometry and, where it is known, range of each pose."""
        linear, angular = _speeds(way)
        turns, nothing = way.attitude.as_quat(), np.zeros(36)
        for row, time in enumerate(way.time.tolist()):
            stamp, place = _stamp(time), way.position[row]
            moved = self._transform(stamp, ("odom", "base_link"), place, turns[row])
            yield stamp, "/tf", self._make("tf2_msgs/msg/TFMessage", [moved])
            where = self._make("geometry_msgs/msg/Point", *map(float, place))
            pose = self._make("geometry_msgs/msg/Pose", where, moved.transform.rotation)
            speeds = [
                self._make("geometry_msgs/msg/Vector3", *map(float, part[row]))
                for part in (linear, angular)
            ]
            yield (
                stamp,
                "/odom",
                self._make(
                    "nav_msgs/msg/Odometry",
                    self._head(stamp, "odom"),
                    "base_link",
                    self._make("geometry_msgs/msg/PoseWithCovariance", pose, nothing),
                    self._make(
                        "geometry_msgs/msg/TwistWithCovariance",
                        self._make("geometry_msgs/msg/Twist", *speeds),
                        nothing,
                    ),
                ),
            )
            if way.nearest is not None and np.isfinite(way.nearest[row]):
                head, wide = self._head(stamp, "base_link"), 2 * np.pi
                told = (1, wide, 0.0, reach, float(way.nearest[row]))  # 1: infrared, as light is
                yield stamp, "/range", self._make("sensor_msgs/msg/Range", head, *told)

    def clouds(self, way: BagWay, points: np.ndarray | None) -> Iterator[tuple[int, str, Any]]:
        """A cloud a tenth of a second, seen from where the platform was when it began."""
        if points is None or not len(points):
            return
        points = points[np.argsort(points["time"], kind="stable")]
        slot = np.floor((points["time"] - way.time[0]) / CLOUD).astype(np.int64)
        kind = np.dtype([(name, form) for name, form, _ in FIELDS])
        fields = [
            self._make("sensor_msgs/msg/PointField", name, kind.fields[name][1], number, 1)  # type: ignore[index]
            for name, _, number in FIELDS
        ]
        first = np.flatnonzero(np.diff(slot, prepend=slot[0] - 1))
        for begin, end in zip(first, [*first[1:], len(points)], strict=True):
            some = points[begin:end]
            start = float(way.time[0]) + float(slot[begin]) * CLOUD
            place, turn = _pose_at(way, start)
            rows = np.empty(len(some), kind)
            seen = turn.inv().apply(np.column_stack([some[a] for a in "xyz"]) - place)
            rows["x"], rows["y"], rows["z"] = seen.T
            rows["intensity"], rows["time"] = some["amplitude"], some["time"] - start
            for name in ("tree", "species", "organ", "return_number"):
                rows[name] = some[name]
            stamp, size = _stamp(start), kind.itemsize
            shape = (1, len(rows), fields, False, size, size * len(rows))
            data = np.frombuffer(rows.tobytes(), np.uint8)
            head = self._head(stamp, "base_link")
            yield (
                stamp,
                "/points",
                self._make("sensor_msgs/msg/PointCloud2", head, *shape, data, True),
            )


def _stamp(time: float) -> int:
    return round((time + START) * 1e9)


def _pose_at(way: BagWay, time: float) -> tuple[np.ndarray, Rotation]:
    """Pose of a platform."""
    if len(way.time) == 1:
        return way.position[0], way.attitude[0]
    time = float(np.clip(time, way.time[0], way.time[-1]))
    place = np.array([np.interp(time, way.time, axis) for axis in way.position.T])
    return place, Slerp(way.time, way.attitude)(time)


def _speeds(way: BagWay) -> tuple[np.ndarray, np.ndarray]:
    """(K, 3) m/s and (K, 3) rad/s in the platform's frame, from each pose to the next."""
    count = len(way.time)
    if count == 1:
        return np.zeros((1, 3)), np.zeros((1, 3))
    step = np.diff(way.time)[:, None]
    now = way.attitude[: count - 1]
    linear = now.inv().apply(np.diff(way.position, axis=0)) / step
    angular = (now.inv() * way.attitude[1:]).as_rotvec() / step
    return (np.concatenate([part, part[-1:]]) for part in (linear, angular))  # type: ignore[return-value]
