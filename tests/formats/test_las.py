"""LAS and LAZ as an independent reading of the bytes sees them."""

import struct

import laspy
import numpy as np
import pytest

from forest_addon.formats.las import write_las
from forest_addon.formats.npz import write_npz
from forest_addon.formats.wav import write_wav
from forest_addon.sensing.lidar import Cloud, Returns


def cloud(count=500, far=0.0):
    rng = np.random.default_rng(1)
    organ = rng.integers(0, 4, count).astype(np.int8)
    returns = Returns(
        distance=rng.uniform(1, 50, count),
        cos_incidence=rng.random(count),
        organ=organ,
        leaf=np.where(organ == 2, rng.integers(0, 9999, count), -1).astype(np.int32),
        tree=rng.integers(-1, 300, count),
        species=rng.integers(-1, 4, count),
        instance=rng.integers(0, 40, count),
    )
    return Cloud(
        position=rng.uniform(-50, 50, (count, 3)) + far,
        pulse=np.arange(count),
        azimuth=rng.uniform(0, 6, count),
        elevation=rng.uniform(-1.5, 1.5, count),
        intensity=rng.random(count),
        returns=returns,
        pulses=2 * count,
        engine="test",
    )


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize("far", [0.0, 6.5e6])
def test_points_and_labels_come_back(tmp_path, name, far):
    written = cloud(far=far)
    write_las(tmp_path / name, written)
    las = laspy.read(tmp_path / name)
    assert str(las.header.version) == "1.4"
    assert las.header.point_format.id == 6
    assert np.abs(las.xyz - written.position).max() <= 0.5e-4 + 1e-9
    for label in ("tree", "species", "organ", "leaf"):
        assert (np.asarray(las[label]) == getattr(written.returns, label)).all(), label
    assert (np.asarray(las["object"]) == written.returns.instance).all()
    assert (np.asarray(las.classification) == np.array([1, 5, 5, 2])[written.returns.organ]).all()
    assert np.asarray(las.scan_angle) * 0.006 == pytest.approx(
        np.rad2deg(written.elevation), abs=0.003
    )


def test_the_header_by_hand(tmp_path):
    write_las(tmp_path / "a.las", cloud())
    raw = (tmp_path / "a.las").read_bytes()
    assert raw[:4] == b"LASF"
    assert (raw[24], raw[25]) == (1, 4)
    assert struct.unpack_from("<Q", raw, 247)[0] == 500  # number of points, LAS 1.4 R15 table 3
    assert raw[104] & 0x3F == 6


def test_equal_clouds_are_equal_files(tmp_path):
    for name in ("a.laz", "b.laz"):
        write_las(tmp_path / name, cloud())
    assert (tmp_path / "a.laz").read_bytes() == (tmp_path / "b.laz").read_bytes()


def test_an_empty_cloud(tmp_path):
    write_las(tmp_path / "a.laz", cloud(0))
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
