"""Clouds of points: one that is drawn, and files of them as programs read them that are not ours."""

import csv

import laspy
import numpy as np
import pye57
from pypcd4 import PointCloud
from scipy.spatial import cKDTree

from forest_addon.sensing.lidar.cloud import Cloud, Returns


def cloud(count=500):
    rng = np.random.default_rng(1)
    organ = rng.integers(0, 4, count).astype(np.int8)
    normal = rng.normal(size=(count, 3))
    of = rng.integers(1, 16, count)
    returns = Returns(
        distance=rng.uniform(1, 50, count),
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        cos_incidence=rng.random(count),
        organ=organ,
        leaf=np.where(organ == 2, rng.integers(0, 9999, count), -1).astype(np.int32),
        tree=rng.integers(-1, 300, count),
        species=rng.integers(-1, 4, count),
        instance=rng.integers(0, 40, count),
        triangle=rng.integers(0, 9, count).astype(np.int32),
    )
    return Cloud(
        position=rng.uniform(-50, 50, (count, 3)),
        pulse=np.arange(count),
        time=np.sort(rng.uniform(0, 9, count)),
        number=np.ceil(of * rng.uniform(0.01, 1, count)).astype(np.uint8),
        count=of.astype(np.uint8),
        azimuth=rng.uniform(0, 6, count),
        elevation=rng.uniform(-1.5, 1.5, count),
        scan_angle=rng.uniform(-1.5, 1.5, count),
        intensity=rng.random(count),
        width=rng.uniform(1e-9, 9e-9, count),
        true_range=rng.uniform(1, 50, count),
        returns=returns,
        pulses=2 * count,
        engine="test",
    )


def of_another_reader(path, ending):
    """Positions (P, 3) in float64 and a column that tells the points, by a program that is not ours."""
    if ending in (".laz", ".las"):
        found = laspy.read(path)
        return found.xyz, "tree", found["tree"]
    if ending == ".copc.laz":
        with laspy.CopcReader.open(path) as reader:
            found = reader.query()
        return np.stack([found.x, found.y, found.z], axis=1), "tree", found["tree"]
    if ending == ".npz":
        with np.load(path) as found:
            return np.stack([found[axis] for axis in "xyz"], axis=1), "tree", found["tree"]
    if ending == ".csv":
        with open(path, newline="") as file:
            rows = list(csv.DictReader(file))
        place = [[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows]
        return np.array(place), "tree", [int(row["tree"]) for row in rows]
    if ending == ".e57":
        file = pye57.E57(str(path))
        found = file.read_scan(0, intensity=True, ignore_missing_fields=True)
        file.close()
        place = np.stack([found[f"cartesian{axis}"] for axis in "XYZ"], axis=1)
        return place, "amplitude", found["intensity"]
    if ending.endswith(".pcd"):
        found = PointCloud.from_path(path)
        place = found.numpy(("x", "y", "z")).astype(float) + found.metadata.viewpoint[:3]
        return place, "tree", found.numpy(("tree",))[:, 0]
    if ending == ".xyz":
        found = np.loadtxt(path, comments="//")
        return found[:, :3], "tree", found[:, 4]
    found, origin, _ = ply_rows(path)
    place = np.stack([found[axis] for axis in "xyz"], axis=1)
    return place.astype(float) + origin, "tree", found["tree"]


def holds(path, ending, rows, step):
    """Another reader finds every row in a file, within so many metres, in order but in an octree, which has
    an order of its own."""
    place, name, told = of_another_reader(path, ending)
    truth = np.stack([rows[axis] for axis in "xyz"], axis=1)
    order = cKDTree(place).query(truth)[1] if ending == ".copc.laz" else np.arange(len(place))
    assert len(set(order)) == len(place) == len(rows) > 0
    assert np.abs(place[order] - truth).max() <= step
    np.testing.assert_array_equal(np.asarray(told)[order], rows[name])


def ply_rows(path):
    """Records of a PLY by its own header, the origin that it tells, and how many bytes are left over."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii").splitlines()]
    assert lines[:2] == [["ply"], ["format", "binary_little_endian", "1.0"]]
    (count,) = (int(line[2]) for line in lines if line[:2] == ["element", "vertex"])
    kinds = {"double": "<f8", "float": "<f4", "uint": "<u4", "int": "<i4"}
    kinds |= {"short": "<i2", "char": "i1", "uchar": "u1"}
    kind = np.dtype([(line[2], kinds[line[1]]) for line in lines if line[0] == "property"])
    told = [line[2:5] for line in lines if line[:2] == ["comment", "origin"]]
    origin = [float(word.strip(",")) for word in told[0]] if told else [0.0, 0.0, 0.0]
    whole = count * kind.itemsize
    return np.frombuffer(body[:whole], kind), np.array(origin), len(body) - whole
