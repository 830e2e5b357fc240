"""The command ``canopy``: its figures are those of the world, its files those that it names."""

import csv
import json
import re
import signal
import subprocess
import sys
import time
from argparse import Namespace
from dataclasses import replace
from functools import partial
from pathlib import Path

import laspy
import numpy as np
import pytest
from matplotlib.image import imread
from scipy.io import wavfile

bpy = pytest.importorskip("bpy")

from forest_addon import api
from forest_addon.base.places import ASSETS
from forest_addon.formats.ownership import RECORD
from forest_addon.sensing.canopy import OUTSIDE, SKY
from headless.cli import main
from headless.commands import canopy, convolve
from studies.papers.reverb_figures import Study, draw_figures, findings, responses

SCENE = """
seed = 3
[forest]
size = [8.0, 8.0]
[[plantings]]
species = "hazelnut"
variants = 1
expected = 6
exact = true
"""


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text(SCENE)
    return file


@pytest.mark.slow
def test_effective_and_true_index_and_pictures(scene, tmp_path):
    told = []
    chosen = Namespace(scene=scene, out=tmp_path / "out", grid=2, height=0.5, at=None, seed=None)
    seen = canopy.run(chosen, say=told.append)
    world = api.build(api.read(scene))
    leaf = world.trees["leaf_area_m2"].sum() / 64
    assert world.leaf_area_index == pytest.approx(leaf)
    assert any(f"true leaf area index       {leaf:8.3f}" in line for line in told)
    assert 0 < seen.effective < 3 * leaf
    with open(tmp_path / "out/gaps.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["gap_fraction"]) for row in rows] == pytest.approx(seen.gap.tolist())
    with np.load(tmp_path / "out/hemispheres.npz") as held:
        pictures, points = held["picture"], held["point"]
    assert points.shape == (4, 3)
    assert (points[:, 2] == 0.5).all()
    shown = pictures[pictures != OUTSIDE]
    assert np.mean(pictures != OUTSIDE) == pytest.approx(np.pi / 4, abs=0.01)
    assert set(np.unique(shown).tolist()) <= {SKY, 0, 1, 2, 3}
    assert {SKY, 1, 2} <= set(np.unique(shown).tolist())
    assert imread(tmp_path / "out/hemispheres.png").std() > 0.05


# ------------------------------------------------------------------------------------------ convolve
# The commands that let one hear a forest, and the findings of the paper's figures.

ROOT = Path(__file__).resolve().parents[3]
CLAP = ROOT / "assets" / "sounds" / "clap.wav"


def test_convolve_from_the_command_line(headless, tmp_path):
    response = tmp_path / "ir.wav"
    wavfile.write(response, 48_000, np.array([[0, 1.0], [0.5, 0]], np.float32))
    headless("convolve", response, CLAP)
    rate, wet = wavfile.read(tmp_path / "ir-clap.wav")
    _, dry = wavfile.read(CLAP)
    assert (rate, wet.dtype) == (48_000, np.float32)
    np.testing.assert_allclose(wet[1:, 0], 0.5 * dry / 32768, atol=1e-7)
    np.testing.assert_allclose(wet[:-1, 1], dry / 32768, atol=1e-7)


def test_levels_above_full_scale_stay_unless_normalised(tmp_path):
    said = []
    wavfile.write(tmp_path / "ir.wav", 24_000, np.array([40.0], np.float32))
    chosen = Namespace(response=tmp_path / "ir.wav", dry=CLAP, out=tmp_path / "new" / "a.wav")
    convolve.run(Namespace(**vars(chosen), normalise=None), said.append)
    assert np.abs(wavfile.read(tmp_path / "new" / "a.wav")[1]).max() > 10
    assert "resampled from 48000 to 24000 Hz" in said[0]
    assert "clip" in said[-1]
    chosen.out = tmp_path / "b.wav"
    convolve.run(Namespace(**vars(chosen), normalise=-1.0), said.append)
    peak = np.abs(wavfile.read(tmp_path / "b.wav")[1]).max()
    assert peak == pytest.approx(10 ** (-0.05), rel=1e-5)


@pytest.mark.slow
def test_figures_and_findings(tmp_path, monkeypatch):
    """A tiny study: files, and verdicts that follow the responses they are given."""
    tiny = Study((300, 900), (10.0, 40.0), (1,))
    monkeypatch.setattr("studies.papers.reverb_figures.QUICK", tiny)
    sentences = draw_figures(tmp_path, quick=True, say=lambda _: None)
    assert len(list(tmp_path.glob("figure-*.png"))) == 4
    assert (tmp_path / "findings.txt").read_text(encoding="utf-8").splitlines() == sentences

    found = responses(tiny)
    noise = np.random.default_rng(0).standard_normal(96_000)
    time = np.arange(96_000) / 24e3

    sparse = noise * (np.arange(96_000) % 64 == 0) * 8.0  # of the same energy

    def decaying(number, distance):
        """Noise whose decay takes longer with more trees and with distance; of many, soon sparse."""
        seconds = (0.6 if number == 300 else 1.2) + distance / 40
        heard = np.where((time > 0.7) & (number == 900), sparse, noise)
        zero = np.zeros(96_000)
        return {"direct": zero, "ground": zero, "trees": heard * 10 ** (-3 * time / seconds)}

    made = {key: replace(each, **decaying(*key[:2])) for key, each in found.items()}
    verdicts = [": reproduced" in sentence for sentence in findings(tiny, made)]
    assert verdicts == [False, False, True, True]  # more trees, longer; C50 does not fall


# -------------------------------------------------------------------------------------------- derive
# ``python -m headless derive``: strings as the papers print them, counts, refusals.

S2 = (
    "[I01I01[t+I01I01+I02I02[t+I02I02+F]I02[T-I02F]I02F]I01[T-I01I02I02[t+I02I02+F]I02"
    "[T-I02F]I02F]I01I02I02[t+I02I02+F]I02[T-I02F]I02F]"
)


@pytest.mark.parametrize(
    ("words", "printed"),
    [
        ("apple --generations 2", S2),
        ("apple --generations 3", S2.replace("F", "I03I03[t+I03I03+F]I03[T-I03F]I03F")),
        ("apple --generations 0", "[F]"),
        ("maple --generations 2", "d(d(g)[g)+g)[d(g)[g)+g)+d(g)[g)+g)"),
        ("whorl-8", "d(d)+d)[d(d)+d)"),
        ("apple --generations 2 --count", "75 symbols, 9 branches"),
        ("maple --generations 12 --count", "2,125,762 symbols, 531,440 branches"),
    ],
)
def test_strings_and_counts_as_the_papers_print_them(headless, words, printed):
    assert headless("derive", *words.split()).stdout.strip() == printed


def test_strings_of_chance_follow_their_seed_and_are_counted_by_their_means(headless):
    words = ("derive", "apple-stochastic", "--generations", 3)
    one, again, other = (headless(*words, "--seed", seed).stdout for seed in (1, 1, 2))
    assert one == again != other
    first, _ = headless(*words, "--count").stdout.splitlines()
    assert first.startswith("expected: ")
    assert headless("derive", "apple", "--generations", 900, "--count").stdout.startswith("1e430 ")


# ------------------------------------------------------------------------------------------- species
# The table and the contact sheet of species.


@pytest.mark.slow
def test_the_table_a_sheet_and_small_pictures_for_the_panel(tmp_path, capsys, monkeypatch):
    pytest.importorskip("bpy")
    from PIL import Image

    from headless.report import trees

    monkeypatch.setattr(trees, "ICON", 64)
    folder, sheet = tmp_path / "new" / "pictures", tmp_path / "new" / "species.png"
    words = ["--pictures", str(folder), "--sheet", str(sheet), "--pixels", "150"]
    assert main(["species", "hazelnut", *words]) == 0
    said = capsys.readouterr().out
    assert all(name in said for name in ("hazelnut  ", "Wrote 1 pictures"))
    assert imread(sheet).std() > 0.05
    assert {path.name for path in folder.iterdir()} == {RECORD, "hazelnut.jpg"}
    with Image.open(folder / "hazelnut.jpg") as picture:
        assert picture.size == (64, 64)
        grey = np.asarray(picture.convert("L"), float)
    tree = grey < 180  # darker than the paper behind it
    assert 0.02 < tree.mean() < 0.5
    assert tree[:, 24:40].sum() > 0.5 * tree.sum()  # it stands in the middle


# -------------------------------------------------------------------------------------------- lidar
# The command ``lidar`` on scenes of one's own, in a process that is really killed.


def words(*arguments):
    return [sys.executable, "-m", "headless", "lidar", *map(str, arguments)]


@pytest.fixture
def lidar(headless):
    return partial(headless, "lidar")


@pytest.fixture(scope="module")
def park(tmp_path_factory):
    """A .blend without anything of ours: ground, spheres, a curve, an animated empty."""
    path = tmp_path_factory.mktemp("park") / "park.blend"
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_plane_add(size=60)
    for place in ((6, 0, 2), (0, 6, 2), (-6, 0, 2)):
        bpy.ops.mesh.primitive_uv_sphere_add(radius=1, location=place)
    bpy.ops.curve.primitive_nurbs_path_add(radius=2, location=(0, 0, 5))
    bpy.context.object.name = "Way"
    drone = bpy.data.objects.new("Drone", None)
    bpy.context.scene.collection.objects.link(drone)
    bpy.context.scene.frame_end = 5
    for frame, x in ((1, -2.0), (5, 2.0)):
        drone.location = (x, 0, 20)
        drone.keyframe_insert("location", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


SCAN = ("--scanner", "riegl-vz-400i", "--at", "-1,0.5,1.6", "--set", "angle_step_deg=1.0")
SCAN += ("--set", "beam.subrays=7")


@pytest.mark.medium
def test_a_scene_of_ones_own(lidar, park, tmp_path):
    out = tmp_path / "scan.laz"
    ended = lidar(park, *SCAN, "--azimuth", "-45,45", "--offset", "465000,5473000,0", "--out", out)
    assert "points of" in ended.stderr.splitlines()[-1]
    assert {p.name for p in tmp_path.iterdir()} == {RECORD, "scan.laz"}
    las = laspy.read(out)
    place = las.xyz - [465000 - 1, 5473000 + 0.5, 1.6]
    away = np.linalg.norm(place, axis=1)
    assert away == pytest.approx(np.asarray(las["range"]), abs=1e-4)
    assert np.abs(np.asarray(las["range"]) - np.asarray(las["true_range"])).std() < 0.006
    azimuth = np.rad2deg(np.arctan2(place[:, 1], place[:, 0]))
    assert (np.abs(azimuth) < 45.1).all()
    assert len(np.unique(las["object"])) == 2  # ground, and the sphere in front


@pytest.mark.medium
@pytest.mark.parametrize(
    ("ending", "corners", "size", "doubt"),
    [
        ("obj", ((-2, 0, -1.6), (2, 20, 1.6)), "metres, Y up: 4 by 3.2 m, 20 m high", None),
        ("obj", ((-2, -4, 0), (2, 4, 20)), "metres, Y up: 4 by 20 m, 8 m high", "if it has Z up, turn"),
        ("obj", ((0, 0, 0), (300, 900, 300)), "metres, Y up: 300 by 300 m, 900 m", "its unit is another"),
        ("ply", ((-2, -1.6, 0), (2, 1.6, 20)), "metres, Z up: 4 by 3.2 m, 20 m high", None),
        ("ply", ((-2, -4, -4), (2, 20, 4)), "metres, Z up: 4 by 24 m, 8 m high", "if it has Y up, turn"),
        ("ply", ((0, 0, 0), (0.004, 0.004, 0.02)), "metres, Z up: 0.004 by", "its unit is another"),
        ("ply", ((0, 0, -200), (9000, 9000, 400)), "metres, Z up: 9,000 by", None),
    ],
)  # fmt: skip
def test_a_mesh_is_said_to_lie_and_be_as_large_as_it_was_read(
    lidar, tmp_path, ending, corners, size, doubt
):
    box = np.array([[corners[k >> a & 1][a] for a in range(3)] for k in range(8)])
    faces = [(0, 1, 3), (0, 3, 2), (4, 7, 5), (4, 6, 7), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6)]
    if ending == "obj":
        lines = [f"v {x} {y} {z}" for x, y, z in box]
        lines += ["f " + " ".join(str(1 + n) for n in face) for face in faces]
    else:
        lines = ["ply", "format ascii 1.0", "element vertex 8"]
        lines += [f"property float {axis}" for axis in "xyz"]
        lines += ["element face 8", "property list uchar int vertex_indices", "end_header"]
        lines += [f"{x} {y} {z}" for x, y, z in box] + ["3 " + " ".join(map(str, f)) for f in faces]
    mesh = tmp_path / f"mine.{ending}"
    mesh.write_text("\n".join(lines) + "\n")
    said = lidar(mesh, *SCAN, "--set", "angle_step_deg=10", "--out", tmp_path / "a.laz").stderr
    assert f"mine.{ending}: read in {size}" in said
    assert ("save a .blend" in said) == (doubt is not None)
    assert doubt is None or doubt in said


def killed_while(park, out, *more):
    """Start a scan, wait until some of it is on disk, and kill it as a power cut would.

    On a busy machine the scan may be over before we look again: then once more.
    """
    for _ in range(20):
        if noted := killed(park, out, *more):
            return noted
        out.unlink()
    pytest.fail("every scan was over before it could be killed")


def killed(park, out, *more):
    """Return the notes of the killed scan, or nothing where it was done before."""
    process = subprocess.Popen(
        words(park, *SCAN, "--out", out, "--chunk", 700, "--quiet", *more), cwd=ROOT
    )
    noted = out.with_suffix(".partial.json")
    while process.poll() is None:
        try:
            if json.loads(noted.read_text())["done"] > 2000:
                process.send_signal(signal.SIGKILL)
                process.wait()
                return None if out.exists() else json.loads(noted.read_text())
        except FileNotFoundError:
            pass
        time.sleep(0.001)
    assert process.returncode == 0
    return None


@pytest.mark.slow
def test_a_killed_scan_goes_on_to_the_same_bytes(lidar, park, tmp_path):
    whole, cut = tmp_path / "whole.laz", tmp_path / "cut.laz"
    lidar(park, *SCAN, "--out", whole, "--quiet")
    noted = killed_while(park, cut)
    assert not cut.exists()
    head = (tmp_path / "cut.partial.ply").read_bytes()[:400].decode("ascii", "replace")
    (count,) = [int(line.split()[2]) for line in head.splitlines() if "element vertex" in line]
    assert count >= noted["points"] > 0  # readable up to the last chunk
    lidar(park, *SCAN, "--out", cut, "--resume")
    assert cut.read_bytes() == whole.read_bytes()
    assert {p.name for p in tmp_path.iterdir()} == {RECORD, "cut.laz", "whole.laz"}


@pytest.mark.slow
@pytest.mark.parametrize("follow", ["Way", "Drone"])
def test_a_scanner_follows_a_curve_or_an_object(lidar, park, tmp_path, follow):
    out = tmp_path / "scan.npz"
    more = ("--set", "pulse_rate=20000", "--set", "line_rate=20", "--set", "min_range=1")
    lidar(park, "--scanner", "riegl-minivux-1uav", "--along", follow, *more, "--out", out)
    with np.load(out) as data:
        assert len(data["x"]) > 500
        assert np.ptp(data["time"]) > 0.1
        assert data["z"].min() > -0.2  # nothing lies below the ground but noise


@pytest.mark.medium
def test_a_flight_over_it(lidar, park, tmp_path):
    more = ("--set", "track=20", "--set", "speed=20", "--set", "pulse_rate=10000")
    out = tmp_path / "scan.ply"
    lidar(
        park, "--scanner", "riegl-vux-1uav", "--at", "-10,0,60", "--azimuth", 0, *more, "--out", out
    )
    assert out.stat().st_size > 97 * 100


def test_the_list_of_scanners(lidar):
    ended = lidar("--list")
    assert "riegl-vz-400i" in ended.stdout
    shipped = {path.stem for path in (ASSETS / "scanners").glob("*.toml")}
    _, *rows = ended.stdout.splitlines()
    assert {row.split()[0] for row in rows} == shipped
    assert all(re.search(r" (terrestrial|mobile|airborne)\b", row) for row in rows)  # columns apart


@pytest.mark.slow
def test_scanners_of_a_scene_file(tmp_path):
    """Every platform, from presets, through a whole run with pictures and report."""
    scene = tmp_path / "scene.toml"
    scene.write_text(
        "offset = [465000.0, 5473000.0, 100.0]\n[forest]\nsize = [6.0, 6.0]\n"
        '[[plantings]]\nspecies = "hazelnut"\nvariants = 1\nexpected = 3\n'
        '[[sensors]]\nkind = "terrestrial"\nname = "puck"\nscanner = "velodyne-vlp-16"\n'
        "position = [-1.0, 3.0, 1.0]\nangle_step_deg = 2.0\n"
        '[[sensors]]\nkind = "mobile"\nname = "walk"\nscanner = "velodyne-vlp-16"\n'
        "pulse_rate = 4000\n"
        "poses = [{ position = [-2, 0, 1.5] }, { time = 1, position = [-2, 6, 1.5] }]\n"
        '[[sensors]]\nkind = "airborne"\nname = "drone"\nscanner = "riegl-vux-1uav"\n'
        "position = [3.0, -5.0, 40.0]\ntrack = 16.0\npulse_rate = 4000\n"
        "[output]\nblend = false\nglb = false\npreview = false\n"
    )
    assert main(["run", str(scene), "--out", str(tmp_path / "o"), "--quiet"]) == 0
    for name in ("puck", "walk", "drone"):
        las = laspy.read(tmp_path / "o" / f"{name}.laz")
        assert len(las) > 200
        assert np.abs(np.median(las.x) - 465000) < 60
        assert imread(tmp_path / "o" / f"{name}.png").std() > 0.02
    page = (tmp_path / "o" / "report.html").read_text()
    assert "Airborne LiDAR: drone" in page
    assert "by riegl-vux-1uav gave" in page


def test_a_lost_material_file_of_an_obj_is_said(lidar, tmp_path):
    wall = tmp_path / "wall.obj"
    wall.write_text("mtllib gone.mtl\nv 5 -1 -1\nv 5 1 -1\nv 5 1 3\nv 5 -1 3\nf 1 2 3 4\n")
    ended = lidar(wall, *SCAN, "--azimuth", "-45,45", "--out", tmp_path / "scan.laz")
    assert "Warning: wall.obj: its material file gone.mtl is not there" in ended.stderr
