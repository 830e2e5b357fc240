"""A result in other programs' formats, read back by their readers."""

import csv
import dataclasses
import shutil
import subprocess

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
    if ending.endswith(".pcd"):
        found = PointCloud.from_path(path)
        place = found.numpy(("x", "y", "z")).astype(float) + found.metadata.viewpoint[:3]
        return place, "tree", found.numpy(("tree",))[:, 0]
    if ending == ".xyz":
        found = np.loadtxt(path, comments="//")
        return found[:, :3], "tree", found[:, 4]
    found, origin = ply_rows(path)
    place = np.stack([found[axis] for axis in "xyz"], axis=1)
    return place.astype(float) + origin, "tree", found["tree"]


def ply_rows(path):
    """Records of a PLY by its own header, and the origin that it tells."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii").splitlines()]
    kinds = {"double": "<f8", "float": "<f4", "uint": "<u4", "int": "<i4"}
    kinds |= {"short": "<i2", "char": "i1", "uchar": "u1"}
    kind = [(line[2], kinds[line[1]]) for line in lines if line[0] == "property"]
    told = [line[2:5] for line in lines if line[:2] == ["comment", "origin"]]
    origin = [float(word.strip(",")) for word in told[0]] if told else [0.0, 0.0, 0.0]
    return np.frombuffer(body, kind), np.array(origin)


STEP = {".laz": 0.5e-4, ".las": 0.5e-4, ".copc.laz": 0.5e-4, ".xyz": 0.5e-4, ".e57": 1e-4}  # metres
STEP |= {".ply": 1e-5, ".pcd": 1e-5}  # single precision, some ten metres from the offset


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
    if ending.endswith(".ply"):
        found, origin = ply_rows(path)
        assert found.dtype["x"] == ("<f8" if "double" in ending else "<f4")
        assert tuple(origin) == ((0.0, 0.0, 0.0) if "double" in ending else OFFSET)
        for name in set(POINT.names) - set("xyz"):
            called = {"amplitude": "intensity"}.get(name, name)
            np.testing.assert_array_equal(found[called], rows[name])


PCL = ("x", "y", "z", "normal_x", "normal_y", "normal_z", "intensity")


@pytest.mark.skipif(not shutil.which("pcl_ply2pcd"), reason="needs PCL's tools (pcl-tools)")
@pytest.mark.parametrize("ending", [".ply", ".pcd", ".double.pcd"])
def test_pcl_reads_all_points_with_normals_and_intensity(cloud, tmp_path, ending):
    """PCL's own tools turn the file to text and, by its viewpoint, onto the map; of double precision they
    know no point, as the file's own comment says."""
    path, rows = tmp_path / f"cloud{ending}", records(cloud, OFFSET)
    write_as(path, spec.Terrestrial(), cloud, OFFSET)
    steps = [["pcl_convert_pcd_ascii_binary", "a.pcd", "text.pcd", "0"]]
    if ending == ".ply":
        steps.insert(0, ["pcl_ply2pcd", "-format", "1", path.name, "a.pcd"])
    else:
        path.rename(tmp_path / "a.pcd")
    if ending == ".double.pcd":
        assert b"PCL, and what is built on it, reads no point" in (tmp_path / "a.pcd").read_bytes()
        words = ["pcl_voxel_grid", "a.pcd", "b.pcd", "-leaf", "0.001,0.001,0.001"]
        said = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert ": 0 points]" in said.stdout
        return
    for words in steps:
        subprocess.run(words, cwd=tmp_path, check=True, capture_output=True, timeout=60)
    head, _, body = (tmp_path / "text.pcd").read_text().partition("DATA ascii\n")
    told = {line.split()[0]: line.split()[1:] for line in head.splitlines()}
    text = np.array([line.split() for line in body.splitlines()], dtype=float)
    found = {name: text[:, told["FIELDS"].index(name)] for name in PCL}
    assert int(told["POINTS"][0]) == len(rows) == len(text) > 0
    for k, axis in enumerate("xyz"):
        assert found[axis] == pytest.approx(rows[axis] - OFFSET[k], abs=1e-4)
        assert found[f"normal_{axis}"] == pytest.approx(rows[f"n{axis}"], abs=1e-5)
    assert found["intensity"] == pytest.approx(rows["amplitude"], rel=1e-5)
    if ending == ".pcd":
        assert [float(word) for word in told["VIEWPOINT"][:3]] == pytest.approx(OFFSET, rel=1e-6)


@pytest.mark.parametrize("ending", [".ply", ".pcd"])
def test_points_far_from_the_offset_keep_their_millimetres(cloud, tmp_path, ending):
    """Of a scene at map coordinates without an offset the origin is in the middle of its points."""
    moved = dataclasses.replace(cloud, position=cloud.position + np.array(OFFSET))
    path = tmp_path / f"a{ending}"
    write_as(path, spec.Terrestrial(), moved, Offset())
    place, *_ = of_another_reader(path, ending)
    assert place == pytest.approx(moved.position, abs=1e-4)


def test_an_e57_says_that_its_points_are_valid(cloud, tmp_path):
    write_as(tmp_path / "a.e57", spec.Terrestrial(), cloud, OFFSET)
    file = pye57.E57(str(tmp_path / "a.e57"))
    assert "cartesianInvalidState" in file.get_header(0).point_fields
    state = file.read_scan_raw(0)["cartesianInvalidState"]
    file.close()
    assert len(state) == len(cloud)
    assert not state.any()


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
