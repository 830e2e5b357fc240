"""Every command in a folder full of a user's files: each byte of theirs stays; its own are renewed."""

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.dataset_runs import PLAN
from references.disks import files_up_to
from references.model_tree import tree

from forest_addon.api import World
from forest_addon.formats import atomic
from forest_addon.formats.atomic import replacing
from forest_addon.formats.ownership import RECORD, Keeper, keeping
from forest_addon.formats.ply import PlyFile
from forest_addon.formats.stl import write_stl
from forest_addon.formats.wav import write_wav
from forest_addon.results.packed import read_values, write_values
from headless.command import name_of
from headless.commands import COMMANDS
from headless.dataset.engine import Worker
from headless.lock import only_one
from headless.pipeline import record_named

ROOT = Path(__file__).resolve().parents[2]
SMALL_FILE = Path(__file__).with_name("small.toml")
SMALL = SMALL_FILE.read_text(encoding="utf-8")
FLIGHT = """
[forest]
size = [16.0, 12.0]
[[plantings]]
species = "whorl-8"
variants = 1
expected = 4
[flight]
distance = 8.0
steps = 20
"""
TINY = """
seed = 3
[forest]
size = [5.0, 5.0]
[[plantings]]
species = "hazelnut"
variants = 1
expected = 1
exact = true
[[sensors]]
kind = "terrestrial"
position = [-2.0, 3.0, 1.5]
angle_step_deg = 8.0
[output]
preview_size = [32, 24]
preview_samples = 1
"""
# A command's words; {out} is a folder, and what they read lies beside it.
WORDS = {
    "run": "run small.toml --out {out} --convolve dry.wav --quiet",
    "demo": "demo --out {out} --quiet",
    "dataset": f"dataset {PLAN} --out {{out}} --set count=1 --workers 1 --shards 1 --quiet",
    "accuracy": "accuracy tiny.toml --out {out} --seconds 1",
    "template": "template w.stl l.stl --name elm --siblings 0 --out {out}",
    "species": "species hazelnut --pictures {out} --sheet {out}/sheet.png --pixels 60",
    "stand": "stand small.toml --out {out}/t.csv",
    "estimate": "estimate map.csv --out {out}/site.toml --method kernel --law poisson "
    "--species maple",
    "allometry": "allometry fit measured.csv --kind Quercus --out {out}",
    "assets": "assets hazelnut --variants 1 --out {out} --sheet {out}/sheet.png",
    "canopy": "canopy small.toml --grid 1 --out {out}",
    "lidar": "lidar cube.blend --scanner riegl-vz-400i --at 5,0,0 --azimuth=170,190 "
    "--set angle_step_deg=1 --out {out}/scan.ply",
    "export": "export small.toml --out {out} --quiet",
    "convolve": "convolve ir.wav dry.wav --out {out}/wet.wav",
    "fly": "fly flight.toml --episodes 1 --out {out}",
}
SLOW = {"run", "demo", "accuracy", "fly", "dataset", "assets", "species", "estimate", "template"}
USERS = ("notes.txt", "my.blend", "wood.txt", "42/mine.txt", "scenes/0001/mine.laz", "scenes/42/a")


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """What the commands read."""
    folder = tmp_path_factory.mktemp("inputs")
    (folder / "small.toml").write_text(SMALL)
    (folder / "flight.toml").write_text(FLIGHT)
    (folder / "tiny.toml").write_text(TINY)
    model = tree()
    write_stl(folder / "w.stl", model.wood())
    write_stl(folder / "l.stl", model.leaves())
    for name in ("ir.wav", "dry.wav"):
        write_wav(folder / name, np.eye(1, 400).T, 8000.0)
    rng = np.random.default_rng(1)
    rows = [f"{x:.2f},{y:.2f}" for x, y in rng.uniform(0, 50, (60, 2))]
    (folder / "map.csv").write_text("\n".join(["x,y", *rows, ""]))
    dbh = rng.uniform(0.1, 0.6, 60)
    head = "species,pft,dbh_m,height_m,crown_width_m,crown_base_m,leaf_area_m2"
    sizes = np.stack([20 * dbh**0.5, 8 * dbh, 5 * dbh**0.5, 300 * dbh]) * rng.lognormal(
        0, 0.2, (4, 60)
    )
    rows = [",".join(["Quercus robur,DA", *map(str, row)]) for row in zip(dbh, *sizes, strict=True)]
    (folder / "measured.csv").write_text("\n".join([head, *rows, ""]))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=2)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "cube.blend"))
    return folder


@pytest.fixture
def run(headless, inputs, tmp_path, monkeypatch, quick, warm):
    """Runs a command on copies of its inputs, with words after its own."""
    warm.lend(monkeypatch)
    here = tmp_path / "here"
    shutil.copytree(inputs, here)
    monkeypatch.chdir(here)
    demo = next(command for command in COMMANDS if command.name == "demo")
    monkeypatch.setitem(demo.fixed, "scene", here / "tiny.toml")
    monkeypatch.setattr("headless.report.trees.ICON", 24)
    return lambda name, out, *more: headless(*WORDS[name].format(out=out).split(), *more, ends=None)


def files(folder):
    """Each file of a folder, and what is in it."""
    found = (path for path in folder.rglob("*") if path.is_file() or path.is_symlink())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def put(folder, names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(f"the user's {name}".encode())
    return files(folder)


def test_every_command_is_tried():
    assert {each.name for each in COMMANDS if each.outputs} == set(WORDS)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] if n in SLOW else []) for n in WORDS]
)
def test_a_folder_full_of_a_users_files(run, tmp_path, name):
    read, out = files(tmp_path / "here"), tmp_path / "out"
    users = put(out, USERS)
    done = run(name, out)
    assert done.returncode in (0, 3), done.stderr
    made = files(out)
    assert users.items() <= made.items()
    lines = [json.loads(line) for line in made.pop(RECORD).decode().splitlines()]
    ours = set(made) - set(users)
    apart = {file for file in ours if file.startswith(("scenes/", "status/"))}  # recorded there
    assert ours - apart <= {line["file"] for line in lines}  # nothing is written past the rule

    if name not in SLOW:
        again = run(name, out)  # its own are renewed
        assert again.returncode == done.returncode, again.stderr
        assert set(files(out)) == {*made, RECORD}

    theirs = tmp_path / "theirs"
    users = put(theirs, [*ours, *USERS])
    refused = run(name, theirs)
    assert refused.returncode == 2
    assert "is not what Forest Sensing wrote there" in refused.stderr
    kept = files(theirs)
    assert users.items() <= kept.items()

    if name not in SLOW:
        forced = run(name, theirs, "--force")
        assert forced.returncode == done.returncode, forced.stderr
        lost = {file for file, content in users.items() if files(theirs)[file] != content}
        assert lost <= ours
        assert all(f"{Path(file).name} is replaced" in forced.stderr for file in lost)
    assert files(tmp_path / "here") == read


LAST = {
    "stand": "t.png",
    "estimate": "site-estimate.png",
    "canopy": "hemispheres.png",
    "export": "scene.json",
    "assets": "sheet.png",
    "template": "recognised.png",
}


@pytest.mark.parametrize("name", LAST)
@pytest.mark.parametrize("kind", ["a file", "a folder", "a link"])
def test_nothing_is_written_where_the_last_of_all_files_cannot_be(run, tmp_path, name, kind):
    out, place = tmp_path / "out", tmp_path / "out" / LAST[name]
    out.mkdir()
    (tmp_path / "mine").write_text("mine")
    if kind == "a file":
        place.write_text("mine")
    elif kind == "a folder":
        place.mkdir()
    else:
        place.symlink_to(tmp_path / "mine")
    done = run(name, out)
    assert done.returncode == 2
    why = "is a folder; choose" if kind == "a folder" else "is not what Forest Sensing wrote there"
    assert f"{place}: {why}" in done.stderr
    assert list(out.iterdir()) == [place]
    if kind == "a folder":
        assert run(name, out, "--force").returncode == 2
        assert list(out.iterdir()) == [place]
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.mark.medium
def test_this_test_notices_a_rule_that_is_broken(run, tmp_path, monkeypatch):
    monkeypatch.setattr(Keeper, "claim", lambda *_: None)
    users = put(tmp_path / "theirs", ["t.csv"])
    assert run("stand", tmp_path / "theirs").returncode == 0
    assert not users.items() <= files(tmp_path / "theirs").items()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("stand listed.toml --out trees.csv", "trees.csv"),
        ("stand listed.toml --out link.csv", "link.csv"),
        ("stand listed.toml --out hard.csv", "hard.csv"),
        ("run listed.toml --out .", "trees.csv"),
        ("template wood.stl leaves.stl --name elm --siblings 0 --out .", "wood.stl"),
        ("convolve ir.wav dry.wav --out dry.wav", "dry.wav"),
    ],
)
def test_what_is_read_is_not_written(headless, inputs, tmp_path, monkeypatch, words, named):
    here = tmp_path / "here"
    shutil.copytree(inputs, here)
    monkeypatch.chdir(here)
    for name, as_name in (("w.stl", "wood.stl"), ("l.stl", "leaves.stl"), ("map.csv", "trees.csv")):
        shutil.move(name, as_name)
    os.symlink("trees.csv", "link.csv")
    os.link("trees.csv", "hard.csv")
    Path("listed.toml").write_text(
        SMALL.replace("expected = 4", 'layout = "list"\ntrees = "trees.csv"')
    )
    before = files(here)
    done = headless(*words.split(), ends=2)
    assert f"{named}: is" in done.stderr
    assert files(here) == before
    forced = headless(*words.split(), "--force", ends=2)
    if words.startswith("stand"):  # reads all before it says what it will replace
        assert f"{named} is replaced" not in forced.stderr
    assert files(here)[named] == before[named]


@pytest.mark.slow
def test_another_scenes_results_go_and_changed_ones_stay(headless, tmp_path):
    def scene(*names):
        head = SMALL.partition("[[sensors]]")[0]
        sensors = [
            f'[[sensors]]\nkind = "terrestrial"\nname = "{n}"\nangle_step_deg = 5.0\n'
            for n in names
        ]
        off = "[output]\npictures = false\nreport = false\nblend = false\nglb = false\npreview = false\n"
        (tmp_path / "s.toml").write_text("\n".join([head, *sensors, off]))
        return headless("run", tmp_path / "s.toml", "--out", tmp_path / "o", ends=None)

    assert scene("a", "b", "c").returncode == 0
    (tmp_path / "o" / "c.laz").write_bytes(b"clipped by hand")
    done = scene("a")
    assert done.returncode == 0
    assert "Removed b.laz, of an earlier run" in done.stderr
    assert {path.stem for path in (tmp_path / "o").glob("*.laz")} == {"a", "c"}
    (tmp_path / "o" / "trees.csv").write_text("mine\n")
    assert "trees.csv: is not what Forest Sensing wrote" in scene("a").stderr
    assert (tmp_path / "o" / "trees.csv").read_text() == "mine\n"


def test_a_record_that_is_none_of_ours_is_left(tmp_path):
    (tmp_path / RECORD).write_text("mine")
    with keeping(Keeper(tmp_path, "run")), pytest.raises(ValueError, match="is no record"):
        with atomic.replacing(tmp_path / "a.txt") as partial:
            partial.write_text("x")
    assert files(tmp_path) == {RECORD: b"mine"}


@pytest.mark.slow
def test_no_file_of_the_working_folder_is_run(tmp_path, monkeypatch):
    (tmp_path / "queue.py").write_text("import pathlib; pathlib.Path('ran').touch()")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", ".", str(tmp_path.parent)]))
    worker = Worker()
    try:
        assert worker.start() == ""  # as a dataset does
    finally:
        worker.end()
    assert not (tmp_path / "ran").exists()


def test_every_process_takes_the_environment_of_a_child():
    for path in [
        path
        for room in ("headless", "forest_addon", "studies")
        for path in (ROOT / room).rglob("*.py")
    ]:
        text = path.read_text(encoding="utf-8")
        if "sys.executable" in text and re.search(r"subprocess\.(run|Popen)\(", text):
            assert "environment_of_child(" in text, path


# ----------------------------------------------------------------------------------------- bad input
# Bad input ends with one clear sentence and exit code 2; trouble while running keeps what is whole.


def start(*words, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "headless", *map(str, words)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def ended(process):
    _, said = process.communicate(timeout=900)
    assert "Traceback" not in said
    return process.returncode, said


def no_half_written_files(out):
    assert not [p.name for p in out.iterdir() if "partial" in p.name]


def without_sensors(tmp_path, output="preview = false\n"):
    """A forest and its files, without pictures: what matters here is how writing ends."""
    off = "[output]\npictures = false\ngoodness = false\nreport = false\n"
    scene = tmp_path / "scene.toml"
    scene.write_text(SMALL.split("[[sensors]]")[0] + off + output)
    return scene


@pytest.mark.slow
def test_a_full_disk(tmp_path):
    """A folder of 1 MB: tables fit, what Blender writes does not."""
    scene = without_sensors(tmp_path)
    out = tmp_path / "disk"
    out.mkdir()
    if not shutil.which("unshare"):
        pytest.skip("a small disk needs util-linux' unshare")
    inside = (
        f"mount -t tmpfs -o size=1m tmpfs {out} && {sys.executable} -m headless run {scene} --out {out}"
        f"; code=$?; ls -A {out}; exit $code"
    )
    process = subprocess.run(
        ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", inside],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=900,
    )
    if "mount:" in process.stderr or "unshare:" in process.stderr:
        pytest.skip("this system lets nobody mount a small disk")
    assert process.returncode == 1, process.stderr
    assert "Traceback" not in process.stderr
    lines = [line for line in process.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert "disk" in lines[0]
    files = process.stdout.split()
    assert "trees.csv" in files
    assert "run.json" not in files
    assert not [name for name in files if "partial" in name]


@pytest.mark.slow
def test_a_file_that_may_not_grow(headless, tmp_path):
    out, scene = tmp_path / "o", without_sensors(tmp_path)
    with files_up_to(400_000):
        done = headless("run", scene, "--out", out, ends=1)
    assert done.stderr.count("error: ") == 1
    assert "disk" in done.stderr or os.strerror(errno.EFBIG) in done.stderr
    assert (out / "trees.csv").exists()
    no_half_written_files(out)


def interrupt_when(process, ready, patience=900):
    end = time.monotonic() + patience
    while not ready():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < end
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    return ended(process)


@pytest.mark.slow
def test_ctrl_c_ends_a_long_render(tmp_path):
    """The render would take an hour, longer than a test waits; all else is written before."""
    picture = 'preview = "cycles"\npreview_size = [800, 600]\npreview_samples = 65536\n'
    scene = without_sensors(tmp_path, picture)
    out = tmp_path / "o"
    code, said = interrupt_when(start("run", scene, "--out", out), (out / "run.json").exists)
    assert code == 130
    assert "interrupted; finished files are kept" in said
    assert all((out / name).exists() for name in ("forest.blend", "run.json"))
    assert not (out / "preview.png").exists()
    no_half_written_files(out)


# ---------------------------------------------------------------------------------------- one folder
# A folder of results: one command at a time, no leavings of killed ones, and a run that goes on.

OFF = (
    "pictures = false\ngoodness = false\nreport = false\nblend = false\nglb = false\n"
    "preview = false\n[output]\n"
)


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(SMALL[: SMALL.index("[output]")] + "\n".join(["[output]", OFF[:-10]]))
    return path


def dead_process():
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_two_commands_do_not_share_a_folder(headless, scene, tmp_path):
    out = tmp_path / "o"
    with only_one(out):
        done = headless("run", scene, "--out", out, ends=2)
        assert "in use by another command" in done.stderr
        assert os.listdir(out) == [".lock"]
    assert not out.exists()  # nothing was written


def test_a_folder_and_a_file_are_held_by_their_names(tmp_path):
    lidar = next(command for command in COMMANDS if command.name == "lidar")
    chosen = SimpleNamespace(list=False, out=tmp_path / "a.laz")
    assert lidar.lock_file(chosen) == tmp_path / ".a.lock"
    with only_one(tmp_path, ".a.lock"), only_one(tmp_path, ".b.lock"):
        pass
    assert not list(tmp_path.iterdir())


def test_what_a_killed_command_left_is_removed(tmp_path):
    dead, alive = f".a.{dead_process()}.partial.laz", f".a.{os.getpid()}.partial.laz"
    for name in (dead, alive, "a.partial.ply", ".other.txt"):
        (tmp_path / name).write_text("x")
    with only_one(tmp_path):
        pass
    assert {path.name for path in tmp_path.iterdir()} == {alive, "a.partial.ply", ".other.txt"}


def test_a_lock_that_cannot_be_written_is_not_left(tmp_path, monkeypatch):
    with files_up_to(0), pytest.raises(OSError, match="large"), only_one(tmp_path / "a" / "b"):
        pass
    assert not list(tmp_path.iterdir())


def test_a_record_that_grew_by_half_a_line_is_none(tmp_path):
    """A full disk takes a part of what is written; the next command reads the record again."""
    with keeping(Keeper(tmp_path, "run")):
        atomic.write_whole(tmp_path / "a.txt", "x")
        most = (tmp_path / RECORD).stat().st_size + 9
        with files_up_to(most), pytest.raises(OSError, match="is the disk full"):
            atomic.write_whole(tmp_path / "b.txt", "x")
    with keeping(Keeper(tmp_path, "run")):
        for name in ("a.txt", "b.txt"):
            atomic.write_whole(tmp_path / name, "y")
    assert sorted(files(tmp_path)) == [RECORD, "a.txt", "b.txt"]


def test_a_name_as_long_as_the_system_allows_can_be_written(tmp_path):
    for letter in "aü":
        longest = tmp_path / f"{letter * (251 // len(letter.encode()))}.csv"
        with replacing(longest) as partial:
            partial.write_text("x")
        assert longest.read_text() == "x"


def test_an_error_names_the_file_that_was_meant(tmp_path):
    with pytest.raises(FileNotFoundError) as said, replacing(tmp_path / "no" / "a.txt") as partial:
        partial.write_text("x")
    assert said.value.filename == str(tmp_path / "no" / "a.txt")


def test_scenes_of_one_name_have_folders_of_their_own():
    assert name_of(Path("elm/scene.toml")) == "elm-scene"
    assert name_of(Path("plots/site.toml")) == "plots-site"
    assert name_of(Path("plots/oak.toml")) == "oak"


@pytest.mark.slow
def test_a_run_that_was_ended_goes_on_to_the_same_bytes(headless, scene, tmp_path, monkeypatch):
    whole, ended = tmp_path / "whole", tmp_path / "ended"
    headless("run", scene, "--out", whole)
    look, looked = World.look, []

    def until_the_third(self, sensor, progress=None):
        looked.append(sensor.name)
        if len(looked) == 3:
            signal.raise_signal(signal.SIGINT)  # as Ctrl-C does
        return look(self, sensor, progress)

    monkeypatch.setattr(World, "look", until_the_third)
    done = headless("run", scene, "--out", ended, ends=130)
    assert "interrupted; finished files are kept" in done.stderr
    assert "--resume goes on with it" in done.stderr
    assert (ended / "trees.csv").exists()
    assert not (ended / "run.json").exists()
    no_half_written_files(ended)
    broken = next((ended / ".unfinished").glob("scan-*.npz"))
    broken.write_bytes(broken.read_bytes()[:1000])
    done = headless("run", scene, "--out", ended, "--resume", "--seed", "9", ends=2)
    assert "of other settings or files" in done.stderr
    looked[:] = ["none"] * 5
    headless("run", scene, "--out", ended, "--resume")
    assert looked[5:] == ["scan", "echo", "reverb"]
    names = {path.name for path in whole.iterdir()}
    assert {path.name for path in ended.iterdir()} == names
    for name in names - {"run.json", RECORD}:  # how long it took, in which order
        assert (whole / name).read_bytes() == (ended / name).read_bytes(), name


@pytest.mark.parametrize(
    "name", ["os:system", "numpy:memmap", "shutil:rmtree", f"{PlyFile.__module__}:PlyFile"]
)
def test_only_dataclasses_of_ours_are_made_of_what_lies_among_unfinished_results(tmp_path, name):
    with open(tmp_path / "a.npz", "w+b") as file:
        np.savez(file, tree=np.array(json.dumps([["record", name, {}]])))
        file.seek(0)
        with pytest.raises(ValueError, match="is of no result"):
            read_values(file, record_named)


def test_values_come_back_as_they_were(tmp_path):
    value = {
        "numbers": (1, 2.5, True, None, "x", 3j, np.float32(0.1), np.int64(2**60)),
        "sets": {1, 2},
        "path": Path("a/b"),
        ("key", 1): [np.arange(6).reshape(2, 3), range(3), slice(1, None, 2)],
        "arrays": (np.array(["ab", "c"]), np.zeros((0, 3)), np.array(np.nan)),
    }
    with open(tmp_path / "a.npz", "w+b") as file:
        write_values(file, [value])
        file.seek(0)
        (back,) = read_values(file, record_named)
    np.testing.assert_equal(back, value)
    assert type(back["numbers"][6]) is np.float32
    with open(tmp_path / "b.npz", "wb") as file, pytest.raises(TypeError, match="is of no result"):
        write_values(file, [[print]])
