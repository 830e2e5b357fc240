"""A result in other programs' formats, read back by their readers."""

import csv

import laspy
import numpy as np
import pye57
import pytest
from pypcd4 import PointCloud
from scipy.io import wavfile

from forest_addon import spec
from forest_addon.results.coordinates import Offset
from forest_addon.results.kinds import RESULTS, write_as
from forest_addon.results.point_files import can_write
from forest_addon.results.points import POINT, records
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks.slices import Trunks
from forest_addon.spec import SpecError

from . import test_las

CLAP = spec.Reverb(sample_rate=8000, duration=0.05)
POINTS, SOUNDS = RESULTS["terrestrial"].endings, RESULTS["reverb"].endings
OFFSET = Offset((500_000.0, 4_000_000.0, 100.0), "EPSG:32632")


@pytest.fixture
def cloud():
    return test_las.cloud()


@pytest.mark.parametrize("ending", POINTS)
def test_points_come_back_as_they_were(cloud, tmp_path, ending):
    path, rows = tmp_path / f"cloud{ending}", records(cloud, OFFSET)
    write_as(path, spec.Terrestrial(), cloud, OFFSET)
    if ending in (".laz", ".las"):
        found = laspy.read(path)
        assert found.header.parse_crs().to_epsg() == 32632
        assert found.header.global_encoding.wkt
        assert np.abs(np.asarray(found.x) - rows["x"]).max() <= 0.5e-4 + 1e-9
        np.testing.assert_array_equal(found["tree"], rows["tree"])
    elif ending == ".npz":
        with np.load(path) as found:
            np.testing.assert_array_equal(found["x"], rows["x"])
    elif ending == ".csv":
        with open(path, newline="") as file:
            found = list(csv.DictReader(file))
        assert [float(row["x_m"]) for row in found] == rows["x"].tolist()
        assert [int(row["tree"]) for row in found] == rows["tree"].tolist()
    elif ending == ".copc.laz":
        with laspy.CopcReader.open(path) as reader:
            found = reader.query()
        assert laspy.read(path).header.parse_crs().to_epsg() == 32632
        order = np.lexsort([rows["z"], rows["x"]])
        there = np.lexsort([found.z, found.x])
        assert np.abs(np.asarray(found.x)[there] - rows["x"][order]).max() <= 0.5e-4 + 1e-9
        np.testing.assert_array_equal(found["tree"][there], rows["tree"][order])
    elif ending == ".e57":
        file = pye57.E57(str(path))
        found = file.read_scan(0, intensity=True, ignore_missing_fields=True)
        assert np.abs(found["cartesianX"] - rows["x"]).max() < 1e-4
        np.testing.assert_array_equal(found["intensity"], rows["amplitude"])
        file.close()
    elif ending == ".pcd":
        found = PointCloud.from_path(path)
        np.testing.assert_array_equal(found.numpy(("x",))[:, 0], rows["x"])
        np.testing.assert_array_equal(found.numpy(("tree",))[:, 0], rows["tree"])
    elif ending == ".xyz":
        found = np.loadtxt(path, comments="//")
        assert np.abs(found[:, 0] - rows["x"]).max() <= 0.5e-4 + 1e-9
        np.testing.assert_array_equal(found[:, 4], rows["tree"])
    else:
        text = path.read_bytes()
        body = text[text.index(b"end_header\n") + 11 :]
        np.testing.assert_array_equal(np.frombuffer(body, POINT), rows)


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
