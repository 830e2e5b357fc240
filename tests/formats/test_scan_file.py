"""Scans on disk: whole at any time, the same bytes however often they are interrupted."""

import csv
import dataclasses
import json
import os
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import laspy
import numpy as np
import pytest
from references.points import cloud, holds, ply_rows
from references.rays import BruteCaster, ground, scene_with, wall
from scipy.optimize import curve_fit
from scipy.signal import find_peaks

from forest_addon.base.places import ROOT
from forest_addon.base.rng import stream
from forest_addon.formats.atomic import remove_partial_files, replacing
from forest_addon.formats.copc import CELLS, nodes
from forest_addon.formats.las import intensity_level, write_las
from forest_addon.formats.table import unquoted, write_csv, write_npz, write_numbers
from forest_addon.formats.tree_map import read_tree_map
from forest_addon.formats.wav import write_wav
from forest_addon.results import POINT_FORMATS
from forest_addon.results.coordinates import Offset
from forest_addon.results.kind import facts, words
from forest_addon.results.kinds import RESULTS, figures_of
from forest_addon.results.points import POINT, records
from forest_addon.results.reverb import of_response
from forest_addon.results.scan_file import write_scan
from forest_addon.sensing.lidar.scan import Scan, scan
from forest_addon.sensing.reverb.channels import ImpulseResponse
from forest_addon.sensing.reverb.metrics import octave_bands
from forest_addon.spec import Beam, Noise, Receiver, Reverb, SpecError, Terrestrial

SCANNER = Terrestrial(
    position=(0.0, 0.0, 1.5),
    elevation_deg=(-40.0, 20.0),
    azimuth_deg=(-60.0, 60.0),
    angle_step_deg=4.0,
    beam=Beam(subrays=4, divergence_mrad=(9.0, 9.0), max_returns=4),
    noise=Noise(range_sd=0.02, drop_out=0.1),
)
OFFSET = Offset((465_000.0, 5_473_000.0, 110.0))


def work(scanner=SCANNER, x=9.0):
    return Scan(scanner, BruteCaster(scene_with(ground(), wall(x, half=3.0))), seed=5)


class Killed(BaseException):
    """What ends a scan in the middle."""


def killed_after(pulses):
    def progress(done, _):
        if done >= pulses:
            raise Killed

    return progress


def kill(path, scan, pulses, **how):
    """Write a scan until so many pulses are done."""
    with pytest.raises(Killed):
        write_scan(path, scan, 5, progress=killed_after(pulses), **how)


@pytest.mark.medium
@pytest.mark.parametrize("kind", POINT_FORMATS)
def test_every_format_holds_the_scan(tmp_path, kind):
    path = tmp_path / f"scan.{kind}"
    done = write_scan(path, work(), 5, offset=OFFSET, at_once=100)
    expected = records(scan(SCANNER, work().caster, 5), OFFSET)
    assert done.points == len(expected) > 200
    assert sorted(p.name for p in tmp_path.iterdir()) == [path.name]
    holds(path, f".{kind}", expected, 0.51e-4)
    if kind == "npz":
        with np.load(path) as data:
            for column in POINT.names:
                assert data[column].tobytes() == expected[column].tobytes(), column
            assert str(data["width_unit"]) == "ns"
        assert zipfile.ZipFile(path).testzip() is None


@pytest.mark.medium
@pytest.mark.parametrize("kind", POINT_FORMATS)
@pytest.mark.parametrize("kills", [(1,), (150, 300)])
def test_an_interrupted_scan_ends_with_the_same_bytes(tmp_path, kind, kills):
    whole, cut = tmp_path / f"whole.{kind}", tmp_path / f"cut.{kind}"
    write_scan(whole, work(), 5, at_once=64)
    for pulses in kills:
        kill(cut, work(), pulses, at_once=64, resume=True)
        assert not cut.exists()
        rows, _, rest = ply_rows(tmp_path / "cut.partial.ply")
        noted = json.loads((tmp_path / "cut.partial.json").read_text())
        assert (len(rows), rest) == (noted["points"], 0)
        assert len(rows) > 0
    done = write_scan(cut, work(), 5, resume=True)
    assert done.resumed_at >= kills[-1]
    assert cut.read_bytes() == whole.read_bytes()


class Faulty(BruteCaster):
    """Fails on some pulses, as a program does that has a fault."""

    def __init__(self, *pulses):
        super().__init__(work().caster.scene)
        way = work().pattern.pulses(np.array(pulses, dtype=np.int64)).direction
        self.ways = way[:, None, :]

    def cast(self, origins, directions, *limits, **more):
        # The axis of a pulse is the mean of its rays, but for their lengths.
        if len(directions):
            axis = directions.reshape(-1, SCANNER.beam.subrays, 3).mean(axis=1)
            if (np.abs(axis - self.ways).max(axis=2) < 1e-3).any():
                raise IndexError("index 2 is out of bounds")
        return super().cast(origins, directions, *limits, **more)


def faulty(*pulses):
    return Scan(SCANNER, Faulty(*pulses), seed=5)


def test_a_pulse_that_cannot_be_measured_costs_no_other(tmp_path):
    whole = records(scan(SCANNER, work().caster, 5))
    done = write_scan(tmp_path / "a.double.ply", faulty(100, 101, 230), 5, at_once=64)
    rows, *_ = ply_rows(tmp_path / "a.double.ply")
    kept = whole[~np.isin(whole["pulse"], [100, 101, 230])]
    assert len(kept) < len(whole)
    assert rows.tobytes() == kept.tobytes()
    assert done.pulses == work().pulses
    assert [str(lost) for lost in done.lost] == [
        "pulses 100 to 101 (IndexError: index 2 is out of bounds)",
        "pulse 230 (IndexError: index 2 is out of bounds)",
    ]
    cloud = scan(SCANNER, Faulty(100, 101, 230), 5)
    assert cloud.lost == done.lost
    assert cloud.pulses == work().pulses
    assert records(cloud).tobytes() == kept.tobytes()


def test_what_was_lost_before_an_interruption_is_named_after_it(tmp_path):
    path = tmp_path / "a.ply"
    kill(path, faulty(40, 300), 128, at_once=64)
    done = write_scan(path, faulty(40, 300), 5, resume=True)
    assert [(lost.first, lost.stop) for lost in done.lost] == [(40, 41), (300, 301)]
    write_scan(tmp_path / "b.ply", faulty(40, 300), 5, at_once=64)
    assert path.read_bytes() == (tmp_path / "b.ply").read_bytes()


@pytest.mark.medium
def test_a_caster_that_fails_always_ends_the_scan_and_keeps_what_is_done(tmp_path):
    with pytest.raises(IndexError):
        write_scan(tmp_path / "a.ply", faulty(*range(128, 480)), 5, at_once=64)
    rows, *_ = ply_rows(tmp_path / "a.partial.ply")
    whole = records(scan(SCANNER, work().caster, 5))
    assert rows.tobytes() == whole[whole["pulse"] < 192].tobytes()[: rows.nbytes]
    assert rows["pulse"].max() < 128


def test_rows_that_were_written_but_not_noted_are_cut_off(tmp_path):
    path = tmp_path / "a.ply"
    kill(path, work(), 128, at_once=64)
    partial = tmp_path / "a.partial.ply"
    with open(partial, "ab") as file:
        file.write(b"half a row that was being written")
    *_, rest = ply_rows(partial)
    assert rest == 33  # readers stop at the number of the header
    write_scan(path, work(), 5, resume=True)
    write_scan(tmp_path / "b.ply", work(), 5, at_once=64)
    assert path.read_bytes() == (tmp_path / "b.ply").read_bytes()


@pytest.mark.parametrize(
    "other",
    [
        lambda: (work(dataclasses.replace(SCANNER, max_range=99.0)), 5),
        lambda: (work(x=9.1), 5),
        lambda: (work(), 6),
    ],
)
def test_another_scan_is_not_gone_on_with(tmp_path, other):
    path = tmp_path / "a.laz"
    kill(path, work(), 1)
    changed, seed = other()
    with pytest.raises(SpecError, match="of another scan"):
        write_scan(path, changed, seed, resume=True)
    assert (tmp_path / "a.partial.ply").exists()
    write_scan(path, changed, seed)  # without it, it starts anew
    assert path.exists()


def test_a_note_that_is_no_json_is_refused(tmp_path):
    (tmp_path / "a.partial.json").write_text("{")
    with pytest.raises(SpecError, match="of another scan"):
        write_scan(tmp_path / "a.laz", work(), 5, resume=True)


def test_rows_that_were_lost_are_noticed(tmp_path):
    kill(tmp_path / "a.laz", work(), 200, at_once=64)
    (tmp_path / "a.partial.ply").unlink()
    with pytest.raises(OSError, match="lost rows"):
        write_scan(tmp_path / "a.laz", work(), 5, resume=True)


def test_an_ending_that_is_not_known(tmp_path):
    with pytest.raises(
        SpecError, match=r"\.laz, \.las, \.copc\.laz, \.ply, \.double\.ply, \.pcd, \.npz"
    ):
        write_scan(tmp_path / "a.xyz", work(), 5)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", POINT_FORMATS)
def test_a_scan_that_sees_nothing(tmp_path, kind):
    sky = dataclasses.replace(SCANNER, elevation_deg=(60.0, 80.0))
    done = write_scan(tmp_path / f"a.{kind}", work(sky), 5)
    assert done.points == 0
    assert (tmp_path / f"a.{kind}").stat().st_size > 0


MEMORY = """
import sys
from pathlib import Path
import numpy as np
from forest_addon.formats.las import write_las
from forest_addon.formats.ply import PlyFile
from forest_addon.results.coordinates import NO_OFFSET
from forest_addon.results.points import POINT
from forest_addon.results.scan_file import finish

def peak():
    (line,) = [l for l in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in l]
    return int(line.split()[1]) / 1024

folder, rows = Path(sys.argv[1]), np.zeros(100_000, POINT)
for kind in ("npz", "las"):
    for chunks in (1, 6, 12):  # by six two slices are held at a time
        file = PlyFile(folder / "a.partial.ply", POINT)
        for _ in range(chunks):
            file.append(rows)
        file.close()
        finish(file, folder / f"a.{kind}", NO_OFFSET)
        print(peak())
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_does_not_grow_with_the_scan(tmp_path):
    words = [sys.executable, "-c", MEMORY, str(tmp_path)]
    ended = subprocess.run(words, check=True, capture_output=True, text=True, cwd=ROOT)
    peaks = np.array([float(line) for line in ended.stdout.split()]).reshape(2, 3)
    more = 6 * 100_000 * POINT.itemsize / 1e6
    assert (peaks[:, 2] - peaks[:, 1] < 0.1 * more).all(), peaks  # MB, with pages of files


WAVED = SCANNER.changed(
    faintest=0.1,
    noise=Noise(),
    receiver=Receiver(sample_ns=1.0, echoes="gaussians", threshold_snr=20.0),
)


def packets_of(path):
    """Waveforms of a LAS file's points as laspy and the file beside it tell them: counts over volts, ps."""
    las, raw = laspy.read(path), path.with_suffix(".wdp").read_bytes()
    assert las.header.global_encoding.waveform_data_packets_external
    assert raw[2:13] == b"LASF_Spec\0\0"
    told = {
        v.record_id - 99: v.parsed_record for v in las.vlrs.get_by_id("LASF_Spec", range(100, 355))
    }
    for row in range(len(las.points)):
        one = told[int(las["wavepacket_index"][row])]
        begin, size = int(las["wavepacket_offset"][row]), int(las["wavepacket_size"][row])
        assert size == one.number_of_samples * one.bits_per_sample // 8
        counts = np.frombuffer(raw[begin : begin + size], "<u2").astype(float)
        time = np.arange(len(counts)) * one.temporal_sample_spacing
        yield las, row, time, counts * one.digitizer_gain + one.digitizer_offset


@pytest.mark.parametrize(
    ("name", "point_format"), [("a.laz", 9), ("a.las", 9), ("a.laz", 4), ("a.laz", 10)]
)
def test_waveforms_stand_beside_a_las_file_where_its_points_say(tmp_path, name, point_format):
    """The record of a return is largest where the return says that it is, on the beam through its place."""
    asked = WAVED.changed(receiver=WAVED.receiver.changed(las_format=str(point_format)))
    write_scan(tmp_path / name, work(asked), 5)
    las, expected = laspy.read(tmp_path / name), records(scan(asked, work().caster, 5), OFFSET)
    assert las.header.point_format.id == point_format
    assert (las.return_number == expected["return_number"]).all()
    assert (las.number_of_returns == expected["number_of_returns"]).all()
    angle = las.scan_angle_rank if point_format == 4 else 0.006 * las.scan_angle
    assert np.abs(angle - expected["scan_angle"]).max() <= (0.5 if point_format == 4 else 0.003)
    classes = {0: 1, 1: 5, 2: 5, 3: 2, 4: 5}
    assert np.asarray(las.classification).tolist() == [
        classes[k] for k in expected["organ"].tolist()
    ]
    if point_format == 10:
        assert (las.nir == las.intensity).all()
        seen = {k: np.unique(las.red[expected["organ"] == k]) for k in np.unique(expected["organ"])}
        assert len(set(np.concatenate([*seen.values()]).tolist())) == len(seen) > 1
    origin, rows = np.array(WAVED.position), 0
    for las, row, time, volts in packets_of(tmp_path / name):
        at = float(las["return_point_wave_location"][row])
        assert np.interp(at, time, volts) > 0.2 * volts.max()
        way = np.array([float(las[axis][row]) for axis in ("x_t", "y_t", "z_t")])
        assert np.linalg.norm(way) == pytest.approx(299_792_458 / 2 * 1e-12, rel=1e-6)
        start = las.xyz[row] - float(las["range"][row]) / np.linalg.norm(way) * way
        assert start == pytest.approx(origin, abs=2e-3)
        if las.number_of_returns[row] == 1:
            middle = (time * volts).sum() / volts.sum()
            assert at == pytest.approx(middle, abs=400)
        rows += 1
    assert rows > 100


def middles_of(counts):
    """Middles, in samples, of the Gaussians of a waveform, by the steps of R's waveformlidar (Zhou et al.
    2017): less its least value, smoothed, a Gaussian for each crest above 0.22 of the largest, fitted by
    MINPACK."""
    power = counts - counts.min()
    smooth = np.convolve(power, np.full(3, 1 / 3), "same")
    crest, _ = find_peaks(smooth, height=0.22 * smooth.max())
    time = np.arange(len(power))
    start = np.concatenate([[power[k], k, 2.0] for k in crest])

    def bells(t, *known):
        height, middle, width = np.reshape(known, (-1, 3)).T
        return (height * np.exp(-0.5 * ((t[:, None] - middle) / width) ** 2)).sum(axis=1)

    return np.reshape(curve_fit(bells, time, power, start, maxfev=4000)[0], (-1, 3))[:, 1]


@pytest.mark.parametrize("ending", ["laz", "npz"])
def test_what_another_way_decomposes_of_the_records_are_the_points(tmp_path, ending):
    """From the files alone: waveforms by another program's steps, along their beams, come to the points."""
    path = tmp_path / f"a.{ending}"
    write_scan(path, work(WAVED), 5)
    if ending == "npz":
        data = np.load(path)
        xyz, raw = np.stack([data[axis] for axis in "xyz"], axis=1), data["waveform_counts"]
        begin, many = data["wave_start"].astype(int), data["wave_samples"].astype(int)
        step = data["waveform_step_gain_offset"][0]
    else:
        data, raw = laspy.read(path), np.fromfile(path.with_suffix(".wdp"), "<u2", offset=60)
        xyz, step = data.xyz, 1000
        begin = (np.asarray(data["wavepacket_offset"], int) - 60) // 2
        many = np.asarray(data["wavepacket_size"], int) // 2
    way = np.stack([np.asarray(data[axis]) for axis in ("x_t", "y_t", "z_t")], axis=1)
    away = []
    for row in range(0, len(xyz), 5):
        middle = middles_of(raw[begin[row] : begin[row] + many[row]].astype(float))
        late = middle * step - data["return_point_wave_location"][row]
        place = xyz[row] + late[:, None] * way[row]
        away.append(np.linalg.norm(place - xyz[row], axis=1).min())
    assert len(away) > 40
    assert np.median(away) < 0.01
    assert np.quantile(away, 0.9) < 0.04


@pytest.mark.parametrize("ending", ["laz", "npz"])
def test_waveforms_of_a_scan_that_was_killed_are_those_of_one_that_was_not(tmp_path, ending):
    whole, broken = tmp_path / f"whole.{ending}", tmp_path / f"broken.{ending}"
    write_scan(whole, work(WAVED), 5, at_once=100)
    kill(broken, work(WAVED), 200, at_once=100)
    with open(tmp_path / "broken.partial.wdp", "ab") as file:
        file.write(b"lost")
    write_scan(broken, work(WAVED), 5, at_once=100, resume=True)
    assert whole.with_suffix(".wdp").read_bytes() == broken.with_suffix(".wdp").read_bytes()
    assert not list(tmp_path.glob("*partial*"))
    if ending == "npz":
        one, other = (np.load(path) for path in (whole, broken))
        assert all(
            (one[name] == other[name]).all() for name in one.files if one[name].dtype != "<f4"
        )
        begin, many = int(one["wave_start"][9]), int(one["wave_samples"][9])
        assert (one["waveform_counts"][begin : begin + many] > 990).sum() > many / 2
        assert one["waveform_step_gain_offset"][0] == pytest.approx(1000)
    else:
        assert whole.read_bytes() == broken.read_bytes()


# ----------------------------------------------------------------------------------------------- las
# LAS and LAZ as an independent reading of the bytes sees them.

LABELS = ("tree", "species", "organ", "leaf")


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


# ---------------------------------------------------------------------------------------------- copc
# A cloud as COPC: an octree as readers expect it, of any cloud, with every point once.

REAL = Path(os.environ.get("FOREST_MEASURED", "../shared/data/measured")) / "clouds"


def written(path, place):
    rows = np.zeros(len(place), POINT)
    for axis, name in enumerate("xyz"):
        rows[name] = place[:, axis]
    rows["tree"] = np.arange(len(place))
    write_las(path, rows)
    return rows


def place_of(points):
    return np.column_stack([points.x, points.y, points.z])


def clumped():
    """A ground, two dense crowns and 6,000 points in one place."""
    rng = np.random.default_rng(2)
    return np.concatenate(
        [
            rng.random((40_000, 3)) * [80, 60, 0.2],
            rng.normal([20, 20, 9], 0.4, (30_000, 3)),
            rng.normal([61, 33, 12], 0.1, (20_000, 3)),
            np.tile([5.0, 5.0, 1.0], (6_000, 1)),
        ]
    )


def test_each_point_is_in_one_node_that_holds_it():
    place = clumped() - clumped().min(axis=0)
    edge = float(place.max()) * 1.0001
    seen, keys = [], set()
    for (depth, *corner), points in nodes(place, edge):
        side = edge / 2**depth
        low = np.array(corner) * side
        assert (place[points] >= low - 1e-9).all()
        assert (place[points] <= low + side + 1e-9).all()
        assert depth == 0 or (depth - 1, *(c // 2 for c in corner)) in keys  # no orphans
        keys.add((depth, *corner))
        seen.append(points)
    assert max(depth for depth, *_ in keys) >= 4
    assert (np.sort(np.concatenate(seen)) == np.arange(len(place))).all()


@pytest.mark.medium
def test_coarse_nodes_are_an_even_sample():
    place = clumped() - clumped().min(axis=0)
    edge = float(place.max()) * 1.0001
    ((depth, *_), points), *_ = nodes(place, edge)
    assert depth == 0
    cells = np.unique((place[points] / edge * CELLS).astype(int), axis=0)
    assert len(cells) == len(points)  # one a cell, and every cell that holds any
    assert len(cells) == len(np.unique((place / edge * CELLS).astype(int), axis=0))


@pytest.mark.medium
def test_another_reader_finds_what_lies_in_a_box(tmp_path):
    place = clumped()
    written(tmp_path / "a.copc.laz", place)
    low, high = np.array([15.0, 10.0, 5.0]), np.array([30.0, 25.0, 15.0])
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        found = reader.query(bounds=laspy.copc.Bounds(low, high))
        coarse = reader.query(resolution=2.0)
    inside = ((place >= low) & (place <= high)).all(axis=1)
    there = place_of(found)
    rows = ((there >= low) & (there <= high)).all(axis=1)
    assert set(np.asarray(found["tree"])[rows]) == set(np.flatnonzero(inside))
    assert 100 < len(coarse) < len(place) / 2


@pytest.mark.skipif(not REAL.is_dir(), reason="the measured clouds are not here")
def test_a_real_cloud_keeps_every_point(tmp_path):
    place = np.asarray(laspy.read(REAL / "spanner_ALS.laz").xyz)
    written(tmp_path / "a.copc.laz", place)
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        found = reader.query()
    order = np.argsort(np.asarray(found["tree"]))
    assert np.abs(place_of(found)[order] - place).max() <= 0.51e-4


# -------------------------------------------------------------------------------------------- table
# Numbers as text against Python's own formatting; texts that spreadsheets would take for formulas.


def test_numbers_are_as_python_writes_them(tmp_path):
    rng = stream(1, "digits")
    columns = {
        "whole": rng.integers(-(10**12), 10**12, 500),
        "small": rng.integers(0, 10, 500).astype(np.int8),
        "metres": rng.normal(0, 1e3, 500),
        "tiny": rng.normal(0, 1e-3, 500),
        "none": np.zeros(500),
    }
    columns["metres"][:6] = [0.0, -0.0, 0.00004, -0.00004, 99999.99996, -1.0]
    decimals = {"metres": 4, "tiny": 6, "none": 2}
    write_numbers(tmp_path / "x.csv", columns, decimals)
    lines = (tmp_path / "x.csv").read_text().splitlines()
    assert lines[0] == "whole,small,metres,tiny,none"
    for number, line in enumerate(lines[1:]):
        for (name, values), text in zip(columns.items(), line.split(","), strict=True):
            wanted = f"{values[number]:.{decimals.get(name, 0)}f}"
            if float(wanted) == 0:
                wanted = wanted.lstrip("-")
            assert text == wanted


def test_many_rows_and_none(tmp_path):
    write_numbers(tmp_path / "many.csv", {"n": np.arange(45_000)}, {})
    assert np.array_equal(np.loadtxt(tmp_path / "many.csv", skiprows=1), np.arange(45_000))
    write_numbers(tmp_path / "none.csv", {"a": np.empty(0), "b": np.empty(0, int)}, {})
    assert (tmp_path / "none.csv").read_text() == "a,b\n"


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_what_is_no_number_is_refused(tmp_path, bad):
    with pytest.raises(ValueError, match="length"):
        write_numbers(tmp_path / "x.csv", {"length": np.array([1.0, bad])}, {"length": 3})
    assert not (tmp_path / "x.csv").exists()


@pytest.mark.parametrize(
    "text", ["=1+1", "+a", "@sum", "'=x", "''@y", "'plain", "-3", "+3", "a=b", ""]
)
def test_a_text_that_would_be_a_formula_is_none_and_comes_back(tmp_path, text):
    path = tmp_path / "t.csv"
    write_csv(path, {"x": [-3.0], "y": [2], "species": [text]})
    with open(path, newline="", encoding="utf-8") as file:
        x, y, cell = list(csv.reader(file))[1]
    assert (x, y) == ("-3.0", "2")
    assert not cell.startswith(("=", "+", "@")) or cell == "+3"
    assert unquoted(cell) == text
    assert read_tree_map(path).species.tolist() == [text]


# -------------------------------------------------------------------------------------------- atomic
# A file is whole or not there.


def test_a_good_block_leaves_the_file_and_nothing_else(tmp_path):
    with replacing(tmp_path / "a.txt") as partial:
        partial.write_text("new")
        assert not (tmp_path / "a.txt").exists()
        assert partial.suffix == ".txt"
    assert os.listdir(tmp_path) == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "new"


@pytest.mark.parametrize("problem", [ValueError, KeyboardInterrupt, OSError])
def test_a_bad_block_leaves_the_old_file(tmp_path, problem):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(problem), replacing(tmp_path / "a.txt") as partial:
        partial.write_text("half")
        raise problem
    assert os.listdir(tmp_path) == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


@pytest.mark.parametrize("text", [None, ""])
def test_a_writer_that_wrote_nothing_is_an_error(tmp_path, text):
    with pytest.raises(OSError, match=r"a\.txt could not be written"):
        with replacing(tmp_path / "a.txt") as partial:
            if text is not None:
                partial.write_text(text)
    assert os.listdir(tmp_path) == []


def test_partial_files_can_be_removed_before_a_sudden_end(tmp_path):
    with (
        pytest.raises(OSError, match="could not be written"),
        replacing(tmp_path / "a.txt") as partial,
    ):
        partial.write_text("half")
        remove_partial_files()
        assert os.listdir(tmp_path) == []


# ------------------------------------------------------------------------------------------- figures
# Figures of a result: worded once, the same value in the report and in the panel.


def response(direct_clear=True, further=()):
    """A decay of 60 dB/s after an impulse."""
    time = np.arange(24_000) / 24_000
    decay = 10.0 ** (-3 * time)
    return ImpulseResponse(
        sample_rate=24_000.0,
        direct=np.where(time == 0, 1.0, 0.0),
        ground=np.zeros_like(time),
        trees=0.1 * decay,
        direct_delay=0.0,
        direct_clear=direct_clear,
        ground_clear=True,
        trunks=1234,
        continued=0,
        late=0,
        clamped=0,
        exact=True,
        left_db=np.full(1 + len(octave_bands(24_000.0)), -np.inf),
        errors={},
        further=further,
    )


def test_numbers_of_a_response():
    shown = facts(of_response(response(), trunks=5000))
    assert shown["trunks cut from the scene"] == "5,000"
    assert shown["trunks heard"] == "1,234"
    assert float(shown["reverberation time"].removesuffix(" s")) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("trunks", "continued", "stands", "said"),
    [
        (0, 0, 0, "no trunks heard"),
        (12, 0, 9, "12 stems of 9 trees heard"),
        (4492, 4472, 4481, "20 stems of 9 trees heard, and 4,472 trunks around the scene"),
        (4492, 4480, 4492, "4,492 trunks heard"),
        (12, 4, -1, "12 trunks heard"),
    ],
)
def test_trunks_beyond_the_scene_are_no_trees_of_it(trunks, continued, stands, said):
    of = {"trunks": trunks, "continued": continued, "stands": stands}
    assert RESULTS["reverb"].sentence(dataclasses.replace(response(), **of)) == said


def test_a_path_of_several_channels():
    blocked = dataclasses.replace(response(direct_clear=False), channel="other")
    found = figures_of(Reverb(), response(further=(blocked,)))
    (path,) = [each for each in found if each.name == "direct path"]
    assert path.text == "blocked by wood in 1 of 2"
    assert path.pattern.format(**path.values) == path.text
    assert facts(figures_of(Reverb(), blocked))["direct path"] == "blocked by wood"


def test_a_reverb_whose_tolerance_was_not_reached_is_warned_of():
    found = dataclasses.replace(response(), errors={20.0: 3e-4, 40.0: 1e-4})
    (warning,) = RESULTS["reverb"].doubts(Reverb(tolerance=1e-4), found)
    assert "3e-04 off from 20 to 40 Hz, where 1e-04 was asked for" in warning
    assert RESULTS["reverb"].doubts(Reverb(tolerance=1e-3), found) == ()


def test_a_record_shorter_than_its_reverberation_time_tells_none():
    """A decay of 60 dB a second, of which 0.3 s are recorded, tells more than it lasts."""
    short = dataclasses.replace(
        response(),
        **{part: getattr(response(), part)[:7200] for part in ("direct", "ground", "trees")},
    )
    told = RESULTS["reverb"].doubts(Reverb(duration=0.3), short)
    assert len(told) == 1
    assert "the record of 0.3 s is shorter" in told[0]
    assert facts(figures_of(Reverb(duration=0.3), short))["reverberation time"] == "not reached"
    assert RESULTS["reverb"].doubts(Reverb(duration=0.0), short) == ()
    assert "s" in facts(figures_of(Reverb(duration=0.0), short))["reverberation time"].split()
    assert RESULTS["reverb"].doubts(Reverb(duration=1.5), response()) == ()


def test_the_tail_says_how_sure_its_level_is():
    error = np.array([np.nan, 5.25, *np.full(len(octave_bands(24_000.0)) - 2, 0.3)])
    found = of_response(dataclasses.replace(response(), tail_error=error))
    assert facts(found)["standard error of the tail's level by octave"].startswith("62.5 Hz 5.2 dB")
    (shown,) = [each.text for each in found if each.short == "Tail Error"]
    assert shown == "5.2 dB at 62.5 Hz"
    assert "Tail Error" not in [each.short for each in of_response(response())]


def test_no_name_twice():
    error = np.ones(len(octave_bands(24_000.0)))
    found = of_response(dataclasses.replace(response(), tail_error=error), trunks=1)
    for names in ([each.name for each in found], [each.short for each in found]):
        named = [name for name in names if name]
        assert len(named) == len(set(named))


def test_braces_in_a_text_stay():
    assert words("a", "A", "as {it} is").text == "as {it} is"
    assert words("a", "A", "{n:,} of them", n=1200).text == "1,200 of them"
