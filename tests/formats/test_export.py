"""A result in other programs' formats, read back by their readers."""

import csv

import laspy
import numpy as np
import pye57
import pytest
from pypcd4 import PointCloud
from scipy.io import wavfile
from scipy.spatial import cKDTree

from forest_addon import spec
from forest_addon.results.coordinates import Offset
from forest_addon.results.kinds import RESULTS, write_as
from forest_addon.results.points import POINT, can_write, records
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import SpecError

from . import test_las

CLAP = spec.Reverb(sample_rate=8000, duration=0.05)
POINTS, SOUNDS = RESULTS["terrestrial"].endings, RESULTS["reverb"].endings
OFFSET = Offset((500_000.25, 4_000_000.5, 100.125), "EPSG:32632")


@pytest.fixture
def cloud():
    return test_las.cloud()


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
    if ending == ".pcd":
        found = PointCloud.from_path(path)
        return found.numpy(("x", "y", "z")), "tree", found.numpy(("tree",))[:, 0]
    if ending == ".xyz":
        found = np.loadtxt(path, comments="//")
        return found[:, :3], "tree", found[:, 4]
    found = ply_rows(path)
    return np.stack([found[axis] for axis in "xyz"], axis=1), "tree", found["tree"]


def ply_rows(path):
    raw = path.read_bytes()
    return np.frombuffer(raw[raw.index(b"end_header\n") + 11 :], POINT)


STEP = {".laz": 0.5e-4, ".las": 0.5e-4, ".copc.laz": 0.5e-4, ".xyz": 0.5e-4, ".e57": 1e-4}  # metres


@pytest.mark.parametrize("ending", POINTS)
def test_points_come_back_where_they_are_on_the_map(cloud, tmp_path, ending):
    path, rows = tmp_path / f"cloud{ending}", records(cloud, OFFSET)
    write_as(path, spec.Terrestrial(), cloud, OFFSET)
    place, name, told = of_another_reader(path, ending)
    assert len(place) == len(rows) > 0
    truth = np.stack([rows[axis] for axis in "xyz"], axis=1)
    order = np.arange(len(rows))
    if ending == ".copc.laz":  # an octree has an order of its own
        order = cKDTree(place).query(truth)[1]
        assert len(set(order)) == len(rows)
    assert np.abs(place[order] - truth).max() <= STEP.get(ending, 0.0) + 1e-9
    np.testing.assert_array_equal(np.asarray(told)[order], rows[name])
    if ending in (".laz", ".las", ".copc.laz"):
        header = laspy.read(path).header
        assert header.parse_crs().to_epsg() == 32632
        assert header.global_encoding.wkt
    if ending == ".ply":
        np.testing.assert_array_equal(ply_rows(path), rows)


@pytest.mark.parametrize("ending", SOUNDS)
def test_a_response_comes_back_as_it_was(tmp_path, ending):
    if not can_write(ending):
        pytest.skip("sofar is not installed")
    trunks = Trunks(np.array([[8.0, 14.0], [12.0, 7.0]]), np.array([0.1, 0.2]), np.arange(2))
    found = impulse_response(trunks, CLAP, spec.Air())
    path, samples = tmp_path / f"clap{ending}", found.channels[0].samples
    write_as(path, CLAP, found)
    if ending == ".wav":
        rate, heard = wavfile.read(path)
        assert rate == 8000
        np.testing.assert_allclose(heard.reshape(len(samples), -1)[:, 0], samples, atol=1e-6)
    elif ending == ".csv":
        with open(path, newline="") as file:
            found = list(csv.DictReader(file))
        assert [float(row["channel_1"]) for row in found] == samples.tolist()
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_another_ending_is_one_sentence(cloud, tmp_path):
    with pytest.raises(SpecError, match=r'cannot be written as ".obj"; use .laz, .las'):
        write_as(tmp_path / "cloud.obj", spec.Terrestrial(), cloud)
    assert not list(tmp_path.iterdir())
