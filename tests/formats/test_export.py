"""A result in other programs' formats, read back by their readers."""

import csv
import dataclasses
import json
import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pye57
import pytest
from references.echoes import discs_of
from references.points import cloud as drawn_cloud, holds, of_another_reader, ply_rows
from scipy.io import loadmat, wavfile

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.formats.glb import EXTENSION, Copies, instance_nodes, write_glb
from forest_addon.formats.wav import write_wav
from forest_addon.growth.library import load_species
from forest_addon.results.coordinates import Offset
from forest_addon.results.kinds import RESULTS, labelled_of, write_as
from forest_addon.results.points import POINT, can_write, records
from forest_addon.results.reverb import CALL, PEAK_DB, dry_sound
from forest_addon.results.sonar import write_echo
from forest_addon.results.tables import write_models
from forest_addon.sensing.reverb.auralise import auralise, normalised
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.sensing.sonar.equipment_files import equip, find, read_patterns, read_route
from forest_addon.sensing.sonar.ping import fly, ping
from forest_addon.sensing.sonar.station import posed, poses_of
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Sonar, SonarReceiver, SpecError
from forest_addon.stand.forest import cylinder_table, grow_forest, inventory

CLAP = spec.Reverb(sample_rate=8000, duration=0.05)
POINTS, SOUNDS = RESULTS["terrestrial"].endings, RESULTS["reverb"].endings
OFFSET = Offset((500_000.25, 4_000_000.5, 100.125), "EPSG:32632")


@pytest.fixture
def cloud():
    return drawn_cloud()


STEP = {".laz": 0.5e-4, ".las": 0.5e-4, ".copc.laz": 0.5e-4, ".xyz": 0.5e-4, ".e57": 1e-4}  # metres
STEP |= {".ply": 1e-5, ".pcd": 1e-5}  # single precision, some ten metres from the offset


@pytest.mark.parametrize("ending", POINTS)
def test_points_come_back_where_they_are_on_the_map(cloud, tmp_path, ending):
    path, rows = tmp_path / f"cloud{ending}", records(cloud, OFFSET)
    write_as(path, spec.Terrestrial(), cloud, OFFSET)
    holds(path, ending, rows, STEP.get(ending, 0.0) + 1e-9)
    if ending in (".laz", ".las", ".copc.laz"):
        header = laspy.read(path).header
        assert header.parse_crs().to_epsg() == 32632
        assert header.global_encoding.wkt
    if ending.endswith(".ply"):
        found, origin, rest = ply_rows(path)
        assert rest == 0
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


# ----------------------------------------------------------------------------------------------- glb
# Instances in .glb files, read back by a reader of this test's own, after the glTF 2.0 specification.

WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
TO_Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)  # glTF's x, y, z from ours


def small_glb(path):
    """Two nodes that share a mesh of one triangle, one of them with a place of its own."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [
            {"name": "a", "mesh": 0, "translation": [1, 2, 3], "rotation": [0, 1, 0, 0]},
            {"name": "b", "mesh": 0},
            {"name": "empty"},
        ],
        "scenes": [{"nodes": [0, 1, 2]}],
    }
    write_glb(path, document, bytearray(corners))
    return document


def strictly(path):
    """The document and the binary chunk of a .glb; every rule of its container is checked."""
    raw = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", raw)
    assert (magic, version, length) == (b"glTF", 2, len(raw))
    size, kind = struct.unpack_from("<I4s", raw, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    document = json.loads(raw[20 : 20 + size])
    rest = raw[20 + size :]
    size, kind = struct.unpack_from("<I4s", rest)
    assert kind == b"BIN\0"
    assert size % 4 == 0
    assert size == len(rest) - 8 == document["buffers"][0]["byteLength"]
    return document, rest[8:]


def column(document, binary, index):
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    assert accessor["componentType"] == 5126
    assert view["byteOffset"] % 4 == 0
    width = WIDTH[accessor["type"]]
    assert view["byteLength"] == 4 * width * accessor["count"]
    values = np.frombuffer(binary, "<f4", accessor["count"] * width, view["byteOffset"])
    return values.reshape(-1, width).astype(float)


def turn_of(quaternion):
    """(N, 3, 3) from x, y, z, w by the textbook formula."""
    x, y, z, w = quaternion.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def transforms(count, negative=False):
    """Random turns, by QR, with a size of its own for each axis, and places."""
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))[:, None, None]
    size = rng.uniform(0.3, 3, (count, 1, 3)) * (-1 if negative else 1)
    return np.concatenate([turn * size, rng.uniform(-50, 50, (count, 3, 1))], axis=2)


@pytest.mark.parametrize("negative", [False, True])
def test_copies_come_back_where_they_were(tmp_path, negative):
    small_glb(tmp_path / "x.glb")
    placed = transforms(500, negative)
    tree = np.random.default_rng(1).permutation(500)
    instance_nodes(tmp_path / "x.glb", {"a": Copies("oak", placed, {"_TREE": tree})})
    document, binary = strictly(tmp_path / "x.glb")
    (node,) = (n for n in document["nodes"] if n.get("name") == "oak")
    assert not node.keys() & {"translation", "rotation", "scale", "matrix"}
    assert EXTENSION in document["extensionsUsed"]
    assert EXTENSION in document["extensionsRequired"]
    indices = node["extensions"][EXTENSION]["attributes"]
    assert indices.keys() == {"TRANSLATION", "ROTATION", "SCALE", "_TREE"}
    place, turn, size, number = (
        column(document, binary, indices[name])
        for name in ("TRANSLATION", "ROTATION", "SCALE", "_TREE")
    )
    assert (number[:, 0] == tree).all()
    assert np.abs(np.linalg.norm(turn, axis=1) - 1).max() < 1e-6
    linear = turn_of(turn) * size[:, None, :]
    back = TO_Y_UP.T @ linear @ TO_Y_UP
    assert np.abs(back - placed[:, :, :3]).max() < 1e-5
    assert np.abs(place @ TO_Y_UP - placed[:, :, 3]).max() < 1e-5


def test_what_was_in_the_file_stays(tmp_path):
    before = small_glb(tmp_path / "x.glb")
    instance_nodes(tmp_path / "x.glb", {"b": Copies("oak", transforms(3))})
    document, binary = strictly(tmp_path / "x.glb")
    assert document["nodes"][0] == before["nodes"][0]
    assert document["meshes"] == before["meshes"]
    assert (column(document, binary, 0) == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]).all()


@pytest.mark.parametrize("name", ["nobody", "empty"])
def test_a_node_without_a_mesh_is_refused(tmp_path, name):
    small_glb(tmp_path / "x.glb")
    with pytest.raises(ValueError, match=f"'{name}' with a mesh"):
        instance_nodes(tmp_path / "x.glb", {name: Copies("oak", transforms(1))})


def test_a_number_that_float32_does_not_hold_is_refused(tmp_path):
    small_glb(tmp_path / "x.glb")
    large = Copies("oak", transforms(1), {"_TREE": np.array([2**24 + 1])})
    with pytest.raises(ValueError, match="_TREE has numbers above"):
        instance_nodes(tmp_path / "x.glb", {"a": large})


# ----------------------------------------------------------------------------------------------- qsm
# TreeQSM's files: the structure that its readers walk, and the numbers of the skeleton.

CYLINDER = (  # names by which rTwig and aRchi take them
    *("radius", "length", "start", "axis", "parent", "extension", "added", "UnmodRadius"),
    *("branch", "SurfCov", "mad", "BranchOrder", "PositionInBranch"),
)
BRANCH = (
    *("order", "parent", "diameter", "volume", "area"),
    *("length", "angle", "height", "azimuth", "zenith"),
)


@pytest.fixture(scope="module")
def grown():
    scene = spec.Scene(
        seed=3,
        forest=spec.Forest(size=(20.0, 20.0)),
        plantings=(
            spec.Planting(species="abop-monopodial-a", variants=2, expected=3, exact=True),
            spec.Planting(species="scots-pine", variants=1, expected=2, exact=True),
        ),
    )
    kinds = [load_species(ASSETS / "species" / f"{p.species}.toml") for p in scene.plantings]
    return grow_forest(scene, kinds)


@pytest.mark.medium
def test_models_hold_the_trees(grown, tmp_path):
    table, stand = cylinder_table(grown), inventory(grown)
    paths = list(write_models(tmp_path / "qsm", table, (1000.0, 0.0, 0.0)))
    assert len(paths) == len(grown.stand)
    for row, path in enumerate(paths):
        qsm = loadmat(path, simplify_cells=True)["QSM"]
        cylinder, branch, data = qsm["cylinder"], qsm["branch"], qsm["treedata"]
        assert [name for name in CYLINDER if name not in cylinder] == []
        assert [name for name in BRANCH if name not in branch] == []
        mine = table["tree"] == grown.stand.id[row]
        assert len(cylinder["radius"]) == mine.sum()
        assert cylinder["start"].shape == cylinder["axis"].shape == (mine.sum(), 3)
        assert np.allclose(cylinder["start"][:, 0], table["startX"][mine] + 1000.0)
        end = cylinder["start"] + cylinder["axis"] * cylinder["length"][:, None]
        assert np.allclose(end[:, 2], table["endZ"][mine], atol=1e-9)
        assert np.isclose(data["TotalVolume"], 1e3 * table["volume"][mine].sum())
        assert np.isclose(branch["volume"].sum(), data["TotalVolume"])
        assert np.isclose(data["DBHqsm"], stand["dbh_m"][row], rtol=0.06)
        # a branch is one run of cylinders, each the extension of the one before
        for number in (1, int(cylinder["branch"].max())):
            run = np.flatnonzero(cylinder["branch"] == number)
            run = run[np.argsort(cylinder["PositionInBranch"][run])]
            assert (cylinder["PositionInBranch"][run] == np.arange(1, len(run) + 1)).all()
            assert (cylinder["extension"][run[:-1]] == run[1:] + 1).all()
            assert len(set(cylinder["BranchOrder"][run])) == 1
        daughters = branch["parent"] > 0
        mothers = branch["order"][branch["parent"][daughters].astype(int) - 1]
        assert (branch["order"][daughters] == mothers + 1).all()


# -------------------------------------------------------------------------------------- sonar files
# Patterns, routes and calls from files, and echoes into files.

LEAVES = discs_of([[2, 0, 2], [3, 0.2, 2]], [1.0, 0, 0], 0.02)


def test_a_pattern_is_read_in_degrees_hertz_and_decibels(tmp_path: Path) -> None:
    path = tmp_path / "beam.csv"
    path.write_text("# a sonarhead\nangle_deg,60000,80000\n0,0,0\n30,-3,-6\n180,-40,-50\n")
    (pattern,) = read_patterns(path)
    np.testing.assert_allclose(pattern.angle, np.deg2rad([0, 30, 180]))
    assert pattern.frequency.tolist() == [60000, 80000]
    assert pattern.level.tolist() == [[0, 0], [-3, -6], [-40, -50]]


def test_routes(tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    path.write_text(
        "x_m,y_m,z_m,azimuth_deg,elevation_deg,beam_width_deg\n0,0,1,90,0,30\n0,2,1,90,0,65\n"
    )
    first, last = poses_of(read_route(path, 4.0))
    np.testing.assert_allclose(first.frame[0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(first.velocity, [0, 4, 0])
    assert np.rad2deg([first.width, last.width]) == pytest.approx([30, 65])
    assert last.time == pytest.approx(0.5)  # 2 m at 4 m/s
    timed = "x_m,y_m,z_m,azimuth_deg,elevation_deg,time_s\n0,0,1,90,0,{}\n0,2,1,90,0,{}\n"
    path.write_text(timed.format(1.5, 4))
    assert [pose.time for pose in poses_of(read_route(path, 4.0))] == [1.5, 4.0]
    with pytest.raises(SpecError, match="is not in"):
        find("no.csv", tmp_path, "route")
    assert find("tanveer-eight.csv", tmp_path, "route").is_file()


def test_a_call_from_a_wav_file(tmp_path: Path) -> None:
    rate, count = 250_000, 500
    tone = np.sin(2 * np.pi * 70e3 * np.arange(count) / rate) * np.hanning(count)
    wavfile.write(tmp_path / "call.wav", rate, (2000 * tone).astype(np.int16))
    sonar = Sonar(call="file", call_file="call.wav")
    call = equip(sonar, tmp_path).call
    assert call is not None
    assert call.duration == pytest.approx(count / rate)
    echo = ping(LEAVES, sonar, Air(), equipment=equip(sonar, tmp_path))
    assert np.abs(echo.waveforms).max() > 0
    low = np.sin(2 * np.pi * 15e3 * np.arange(count) / rate) * np.hanning(count)
    for wrong, said in ((tone + 0.2, r"offset of 1\d % of its"), (low, r"0\.0 % of its energy")):
        wavfile.write(tmp_path / "call.wav", rate, wrong.astype(np.float32))
        with pytest.raises(SpecError, match=said):
            equip(sonar, tmp_path)
    wavfile.write(tmp_path / "call.wav", rate, np.zeros(10, np.int16))
    with pytest.raises(SpecError, match="silent"):
        equip(sonar, tmp_path)
    (tmp_path / "call.wav").write_bytes(b"no sound")
    with pytest.raises(SpecError, match="cannot be read as a WAV file"):
        equip(sonar, tmp_path)


def test_an_echo_in_files(tmp_path: Path) -> None:
    sonar = Sonar(contributions=True, time_expansion=20.0)
    echo = ping(LEAVES, sonar, Air())
    arrays, sound, heard = write_echo(tmp_path, sonar, echo)
    with np.load(arrays) as data:
        assert data["impulse_response"].shape == data["time"].shape
        np.testing.assert_array_equal(data["spectrum"], echo.spectrum)
        assert str(data["time_unit"]) == "s"
        gain = float(data["wav_gain"])
    rate, samples = wavfile.read(sound)
    assert rate == 20_000
    np.testing.assert_allclose(samples / gain, echo.impulse_response, atol=1e-7 / gain)
    assert np.abs(samples).max() == pytest.approx(0.9, rel=1e-6)
    with np.load(heard) as data:
        assert data["number"].tolist() == [0, 1]
        assert data["kind"].tolist() == ["leaf", "leaf"]
        assert str(data["amplitude_unit"]) == "re call at 1 m"


def test_a_flight_in_files(tmp_path: Path) -> None:
    sonar = Sonar(ears=2, contributions=True)
    flight = fly(EchoTargets.of_discs(LEAVES), sonar, Air(), [posed(sonar)] * 3)
    arrays, sound, heard = write_echo(tmp_path, sonar, flight)
    with np.load(arrays) as data:
        assert data["impulse_response"].shape == (3, 2, len(data["time"]))
        assert data["position"].shape == data["axis"].shape == (3, 3)
    _, samples = wavfile.read(sound)
    assert samples.shape == (3 * len(flight.time), 2)
    with np.load(heard) as data:
        assert np.bincount(data["pose"]).tolist() == [2, 2, 2]


def test_what_a_receiver_recorded_in_files(tmp_path: Path) -> None:
    receiver = SonarReceiver(source_level_db=120.0, self_noise_db=20.0, threshold_db=10.0)
    sonar = Sonar(ears=2, receiver=receiver)
    targets = EchoTargets.of_discs(LEAVES)
    flight = fly(targets, sonar, Air(), [posed(sonar)] * 3, seed=5)
    arrays, sound = write_echo(tmp_path, sonar, flight)
    with np.load(arrays) as data:
        for number, echo in enumerate(flight.echoes):
            assert echo.received is not None
            np.testing.assert_allclose(data["recorded"][number], echo.received.recorded)
            assert np.array_equal(data["snr_db"][number], echo.received.snr_db)
            mine = data["detection_ping"] == number
            assert np.array_equal(data["detection_time"][mine], echo.received.detection_time)
        assert str(data["recorded_unit"]) == "Pa"
        assert data["range_snr_db"].shape == (3, 2, len(data["range"]))
        gain, pressure = float(data["wav_gain"]), float(data["call_pressure"])
        recorded = data["recorded"]
    _, samples = wavfile.read(sound)
    np.testing.assert_allclose(
        samples[: recorded.shape[2]] * (pressure / gain), recorded[0].T, atol=1e-6 * pressure / gain
    )
    shown = {each.short: each.text for each in RESULTS["sonar"].figures(sonar, flight, None)}
    assert shown["Over Noise"] == f"{max(e.received.snr_db.max() for e in flight.echoes):.1f} dB"
    assert not np.array_equal(recorded[0], recorded[1])
    variables, _ = labelled_of(sonar, flight)
    dims, values, unit = variables["recorded"]
    assert np.array_equal(values, recorded)
    assert (dims, unit) == (("ping", "ear", "time"), "Pa")
    assert "recorded" not in labelled_of(Sonar(), ping(LEAVES, Sonar(), Air()))[0]
    ahead = ping(targets, sonar, Air(), seed=5, number=2, pose=posed(sonar)).received
    assert np.array_equal(ahead.recorded, flight.echoes[2].received.recorded)
    bare = write_echo(tmp_path, Sonar(name="bare"), ping(LEAVES, Sonar(), Air()))[0]
    with np.load(bare) as data:
        assert not {name for name in data if "snr" in name or "recorded" in name}


@pytest.mark.parametrize("key", ["transducer_file", "noise_file"])
def test_sounds_of_a_receiver_are_read(tmp_path: Path, key: str) -> None:
    samples = np.sin(np.arange(2000) * 2 * np.pi * 70e3 / 300e3) * np.hanning(2000)
    wavfile.write(tmp_path / "sound.wav", 300_000, samples.astype(np.float32))
    given = {"source_level_db": 110.0, key: "sound.wav"}
    if key == "noise_file":
        given["noise_level_db"] = 60.0
    sonar = Sonar(receiver=SonarReceiver(**given))
    receiver = equip(sonar, tmp_path).receiver
    read = receiver.noise or receiver.transducer
    assert len(read.samples) == round(2000 * 4 / 3)
    if key == "noise_file":
        assert np.sqrt(np.mean(read.samples**2)) == pytest.approx(20e-6 * 1000)
    with pytest.raises(SpecError, match=f"receiver.{key}"):
        equip(sonar, tmp_path / "elsewhere")
    with pytest.raises(ValueError, match=key):
        ping(LEAVES, sonar, Air())


def test_a_sum_is_warned_of_where_it_decides_how_sure_the_result_is() -> None:
    sonar = Sonar(tolerance=1e-6)
    echo = replace(ping(LEAVES, sonar, Air()), cull_bound=1e-4, table_error=2e-5)
    assert echo.error_bound <= 1e-6
    doubts = RESULTS["sonar"].doubts
    assert doubts(sonar, echo) == ()
    assert doubts(sonar, replace(echo, error_bound=1.5e-4)) == ()
    (warning,) = doubts(sonar, replace(echo, error_bound=3e-4))
    assert "3.0e-04" in warning
    assert "1e-06 was asked for" in warning
    (warning,) = doubts(sonar, replace(echo, error_bound=2e-6, cull_bound=0.0, table_error=0.0))
    assert "Set tolerance to 1e-05" in warning
    assert doubts(sonar.changed(tolerance=0.0), replace(echo, error_bound=3e-4)) == ()


def test_silence_can_be_written(tmp_path: Path) -> None:
    sonar = Sonar(max_range=1.0)
    files = write_echo(tmp_path, sonar, ping(LEAVES, sonar, Air()))
    assert not wavfile.read(files[1])[1].any()


# ---------------------------------------------------------------------------------------- dry sounds
# What a reverb sounds like: a clap or a call that is a clap or a call, convolved as the sum says.


def test_a_clap_is_short_and_where_hands_resonate():
    samples, rate = dry_sound("clap")
    assert np.abs(samples).max() == pytest.approx(1)
    energy = np.cumsum(samples**2) / np.sum(samples**2)
    assert np.searchsorted(energy, 0.95) / rate < 0.010  # Repp 1987: a few milliseconds
    power = np.abs(np.fft.rfft(samples, 8192)) ** 2
    centre = np.sum(np.fft.rfftfreq(8192, 1 / rate) * power) / power.sum()
    assert 500 < centre < 3500
    assert (dry_sound("clap")[0] == samples).all()


def test_a_call_is_twenty_times_slower_and_falls():
    samples, rate = dry_sound("call")
    assert len(samples) / rate == pytest.approx(20 * CALL.call_duration, rel=1e-3)
    pieces = np.array_split(samples, 8)
    pitch = [np.count_nonzero(np.diff(np.sign(p))) / 2 / (len(p) / rate) for p in pieces]
    assert pitch == sorted(pitch, reverse=True)
    assert 1200 < pitch[-1] < pitch[0] < 4000


@pytest.mark.parametrize("channels", [1, 3])
def test_it_is_the_sum_of_shifted_copies(channels):
    rng = np.random.default_rng(2)
    response, dry_rate = rng.standard_normal((40, channels)), 48_000.0
    dry, rate = dry_sound("clap")
    assert rate == dry_rate
    wet, _ = normalised(auralise(response, dry, rate, rate), PEAK_DB)
    expected = np.column_stack([np.convolve(row, dry) for row in response.T])
    expected *= 10 ** (PEAK_DB / 20) / np.abs(expected).max()
    assert np.abs(wet - expected).max() < 1e-12


def test_a_file_of_ones_own(tmp_path):
    dry = np.array([0.5, 0.0, -0.25])
    write_wav(tmp_path / "dry.wav", dry, 8000)
    samples, rate = dry_sound("file", tmp_path / "dry.wav")
    assert rate == 8000
    wet = auralise(np.array([0.0, 1.0]), samples, rate, rate)[:, 0]
    assert wet == pytest.approx([0, 0.5, 0, -0.25], abs=1e-6)


def test_silence_stays():
    assert normalised(np.zeros(10), PEAK_DB) == (pytest.approx(0), 0)
