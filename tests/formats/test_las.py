"""LAS and LAZ as an independent reading of the bytes sees them."""

import struct

import laspy
import numpy as np
import pytest

from forest_addon.formats.las import intensity_level, write_las
from forest_addon.formats.table import write_npz
from forest_addon.formats.wav import write_wav
from forest_addon.results.points import POINT, records
from forest_addon.sensing.lidar.cloud import Cloud, Returns

LABELS = ("tree", "species", "organ", "leaf")


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


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (465_000.25, 5_473_000.125, 110.5)])
def test_everything_comes_back(tmp_path, name, offset):
    written = cloud()
    write_las(tmp_path / name, records(written, offset))
    las = laspy.read(tmp_path / name)
    assert str(las.header.version) == "1.4"
    assert las.header.point_format.id == 6
    assert np.abs(las.xyz - (written.position + np.array(offset))).max() <= 0.5e-4 + 1e-9
    for label in LABELS:
        assert (np.asarray(las[label]) == getattr(written.returns, label)).all(), label
    assert (np.asarray(las["object"]) == written.returns.instance).all()
    assert (np.asarray(las.classification) == np.array([1, 5, 5, 2])[written.returns.organ]).all()
    assert np.asarray(las.scan_angle) * 0.006 == pytest.approx(
        np.rad2deg(written.scan_angle), abs=0.0031
    )
    assert (np.asarray(las.return_number) == written.number).all()
    assert (np.asarray(las.number_of_returns) == written.count).all()
    assert (np.asarray(las.gps_time) == written.time).all()
    assert (np.asarray(las["true_range"]) == written.true_range).all()
    assert (np.asarray(las["range"]) == written.returns.distance).all()
    assert np.asarray(las["amplitude"]) == pytest.approx(written.intensity, rel=1e-6)
    assert np.asarray(las["width"]) == pytest.approx(written.width * 1e9, rel=1e-6)
    assert np.cos(np.deg2rad(np.asarray(las["incidence"]))) == pytest.approx(
        written.returns.cos_incidence, abs=1e-6
    )
    normal = np.stack([np.asarray(las[name]) for name in ("nx", "ny", "nz")], axis=1)
    assert normal == pytest.approx(written.returns.normal, abs=1e-6)


def test_the_header_by_hand(tmp_path):
    written = cloud()
    write_las(tmp_path / "a.las", records(written))
    raw = (tmp_path / "a.las").read_bytes()
    assert raw[:4] == b"LASF"
    assert (raw[24], raw[25]) == (1, 4)
    assert struct.unpack_from("<Q", raw, 247)[0] == 500  # number of points, LAS 1.4 R15 table 3
    assert raw[104] & 0x3F == 6
    returns = struct.unpack_from("<15Q", raw, 255)
    assert list(returns) == np.bincount(written.number, minlength=16)[1:].tolist()
    start, size = struct.unpack_from("<I", raw, 96)[0], struct.unpack_from("<H", raw, 105)[0]
    assert len(raw) == start + 500 * size
    scale, offset = struct.unpack_from("<3d", raw, 131), struct.unpack_from("<3d", raw, 155)
    first = np.array(struct.unpack_from("<3i", raw, start)) * scale + offset
    assert first == pytest.approx(written.position[0], abs=0.51e-4)
    high_x, low_x = struct.unpack_from("<2d", raw, 179)
    assert (low_x, high_x) == pytest.approx(
        (written.position[:, 0].min(), written.position[:, 0].max()), abs=0.51e-4
    )


def test_intensity_is_a_level_in_decibels():
    level = intensity_level(np.array([1.0, 0.5, 1e-4, 1e-10, 0.0, 1e9]))
    decibels = level / 500 - 100
    assert decibels[:4] == pytest.approx([0, -3.0103, -40, -100], abs=0.001)
    assert level[4:].tolist() == [0, 65535]


def test_a_cloud_wider_than_two_hundred_kilometres(tmp_path):
    rows = np.zeros(2, dtype=POINT)
    rows["x"] = [0.0, 1.5e6]
    write_las(tmp_path / "a.las", rows)
    assert laspy.read(tmp_path / "a.las").x == pytest.approx([0, 1.5e6], abs=0.5e-3)


def test_equal_clouds_are_equal_files(tmp_path):
    for name in ("a.laz", "b.laz"):
        write_las(tmp_path / name, records(cloud()))
    assert (tmp_path / "a.laz").read_bytes() == (tmp_path / "b.laz").read_bytes()


def test_an_empty_cloud(tmp_path):
    write_las(tmp_path / "a.laz", records(cloud(0)))
    assert len(laspy.read(tmp_path / "a.laz")) == 0


def test_npz_and_wav(tmp_path):
    for name in ("a.npz", "b.npz"):
        write_npz(tmp_path / name, {"x": np.arange(5.0)}, {"x": "m"})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz") as data:
        assert data["x"].tolist() == [0, 1, 2, 3, 4]
        assert str(data["x_unit"]) == "m"
    samples = np.array([0.0, -3.5, 2.25, 1e-9])
    write_wav(tmp_path / "a.wav", samples, 24000.0)
    raw = (tmp_path / "a.wav").read_bytes()
    assert raw[:4] == b"RIFF"
    data = raw[raw.index(b"data") + 8 :]
    assert np.frombuffer(data, "<f4").tolist() == samples.astype(np.float32).tolist()
    assert struct.unpack_from("<HHI", raw, raw.index(b"fmt ") + 8) == (3, 1, 24000)  # IEEE float
    with pytest.raises(ValueError, match="whole number of hertz"):
        write_wav(tmp_path / "b.wav", samples, 22050.5)
