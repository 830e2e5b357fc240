"""ROS 2 bags, read back by another library than the one that writes them: frames, stamps, points in place."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
pytest.importorskip("rosbags")
reader = pytest.importorskip("mcap_ros2.reader")

from scipy.spatial.transform import Rotation

from forest_addon import api as forest
from forest_addon.formats.rosbag import START, BagWay, write_bag

SCENE = forest.Scene(
    seed=4,
    forest=forest.Forest(size=(6.0, 6.0), margin=5.0),
    plantings=(forest.Planting(species="hazelnut", variants=1, expected=2, exact=True),),
)
FORM = {7: "<f4", 5: "<i4", 2: "u1"}


def told(path):
    """Messages by topic: seconds of their stamp in the log, and content."""
    topics = {}
    for message in reader.read_ros2_messages(str(path)):
        topics.setdefault(message.channel.topic, []).append(
            (message.log_time_ns / 1e9, message.ros_msg)
        )
    return topics


def rows_of(cloud):
    kind = np.dtype(
        {
            "names": [f.name for f in cloud.fields],
            "formats": [FORM[f.datatype] for f in cloud.fields],
            "offsets": [f.offset for f in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    return np.frombuffer(bytes(cloud.data), kind)


@pytest.fixture(scope="module")
def world():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return forest.build(SCENE)


@pytest.mark.medium
def test_points_of_a_drone_stand_where_the_scan_found_them(world, tmp_path):
    way = forest.trajectory(
        [2.0, 2.35], [(-3, -3, 9), (5, 6, 8)], [40.0, 75.0], [0.0, 4.0], [3.0, -6.0]
    )
    cloud = world.scan(forest.Mobile(pulse_rate=20_000.0), along=way)
    topics = told(cloud.save(tmp_path / "drone.mcap"))
    assert set(topics) == {"/tf", "/tf_static", "/odom", "/points"}
    poses = {}
    for _, message in topics["/tf"]:
        (moved,) = message.transforms
        assert (moved.header.frame_id, moved.child_frame_id) == ("odom", "base_link")
        spin, move = moved.transform.rotation, moved.transform.translation
        stamp = moved.header.stamp.sec + moved.header.stamp.nanosec / 1e9
        turn = Rotation.from_quat([spin.x, spin.y, spin.z, spin.w])
        poses[round(stamp, 6)] = np.array([move.x, move.y, move.z]), turn
    found, trees, times = [], [], []
    for logged, message in topics["/points"]:
        stamp = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
        assert message.header.frame_id == "base_link"
        assert abs(logged - stamp) < 1e-6
        rows = rows_of(message)
        place, turn = poses[round(stamp, 6)]
        found.append(turn.apply(np.column_stack([rows[a] for a in "xyz"])) + place)
        trees.append(rows["tree"])
        times.append(stamp + rows["time"] - START)
        assert rows["time"].min() >= 0
        assert rows["time"].max() < 0.1001
    assert len(found) == 4
    order = np.argsort(cloud.found.time, kind="stable")
    assert np.allclose(np.concatenate(found), cloud.points[order], atol=2e-5)
    assert np.array_equal(np.concatenate(trees), cloud.labels["tree"][order])
    assert np.allclose(np.concatenate(times), cloud.found.time[order], atol=1e-6)
    first = topics["/odom"][0][1]
    speed = first.twist.twist.linear
    truth = way.attitude[0].inv().apply(np.diff(way.position, axis=0)[0] / way.duration)
    assert np.allclose([speed.x, speed.y, speed.z], truth, rtol=1e-6)
    assert first.child_frame_id == "base_link"


@pytest.mark.medium
def test_a_tripod_stands_still(world, tmp_path):
    cloud = world.scan(forest.Terrestrial(position=(-2.0, 3.0, 1.5), angle_step_deg=5.0))
    topics = told(cloud.save(tmp_path / "tripod.mcap"))
    assert len(topics["/tf"]) == 1
    points = np.concatenate(
        [np.column_stack([rows_of(m)[a] for a in "xyz"]) for _, m in topics["/points"]]
    )
    order = np.argsort(cloud.found.time, kind="stable")
    assert np.allclose(points + np.array([-2.0, 3.0, 1.5]), cloud.points[order], atol=2e-5)


def test_a_flight_tells_its_range(tmp_path):
    turn = Rotation.from_euler("Z", [[0.0], [0.2], [0.4]])
    place = np.array([[0.0, 0, 2], [0.3, 0, 2], [0.6, 0.1, 2]])
    way = BagWay(np.array([0.0, 0.1, 0.2]), place, turn, np.array([3.5, np.nan, 2.5]))
    write_bag(tmp_path / "flight.mcap", way, reach=40.0)
    topics = told(tmp_path / "flight.mcap")
    assert [m.range for _, m in topics["/range"]] == [3.5, 2.5]
    assert topics["/range"][0][1].max_range == 40.0
    spin = topics["/odom"][0][1].twist.twist.angular
    assert np.allclose([spin.x, spin.y, spin.z], [0, 0, 2.0])
    assert [p.name for p in tmp_path.iterdir()] == ["flight.mcap"]
