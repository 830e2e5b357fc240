"""Every command in a folder full of a user's files: each byte of theirs stays; its own are renewed."""

import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.formats import atomic
from forest_addon.formats.ownership import RECORD, Keeper, keeping
from forest_addon.formats.stl import write_stl
from forest_addon.formats.wav import write_wav
from headless.commands import COMMANDS
from headless.dataset.engine import Worker
from tests.references.dataset_runs import PLAN
from tests.references.model_tree import tree

ROOT = Path(__file__).resolve().parents[2]
SMALL = Path(__file__).with_name("small.toml").read_text(encoding="utf-8")
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
def run(headless, inputs, tmp_path, monkeypatch, quick):
    """Runs a command on copies of its inputs, with words after its own."""
    here = tmp_path / "here"
    shutil.copytree(inputs, here)
    monkeypatch.chdir(here)
    demo = next(command for command in COMMANDS if command.name == "demo")
    monkeypatch.setitem(demo.fixed, "scene", here / "tiny.toml")
    monkeypatch.setattr("headless.report.trees.ICON", 24)
    return lambda name, out, *more: headless(*WORDS[name].format(out=out).split(), *more)


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


@pytest.mark.medium
def test_this_test_notices_a_rule_that_is_broken(run, tmp_path, monkeypatch):
    monkeypatch.setattr(atomic, "claim", lambda *paths, ours=False: None)
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
    done = headless(*words.split())
    assert done.returncode == 2
    assert f"{named}: is" in done.stderr
    assert files(here) == before
    assert headless(*words.split(), "--force").returncode == 2
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
        return headless("run", tmp_path / "s.toml", "--out", tmp_path / "o")

    assert scene("a", "b", "c").returncode == 0
    (tmp_path / "o" / "c.laz").write_bytes(b"clipped by hand")
    done = scene("a")
    assert done.returncode == 0
    assert "Removed b.laz, of an earlier run" in done.stderr
    assert {path.stem for path in (tmp_path / "o").glob("*.laz")} == {"a", "c"}
    (tmp_path / "o" / "trees.csv").write_text("mine\n")
    assert "trees.csv: is not what Forest Sensing wrote" in scene("a").stderr
    assert (tmp_path / "o" / "trees.csv").read_text() == "mine\n"


@pytest.mark.parametrize(
    ("kinds", "said"),
    [
        ({"leaves": "sonar"}, "leaves.npz, as the scene does"),
        ({"preview": "terrestrial"}, "preview.png, as the scene does"),
        ({"tls": "terrestrial", "TLS": "sonar"}, 'as sensor "tls" does'),
        ({"a": "reverb", "a-dry": "reverb"}, 'a-dry.wav, as sensor "a" does'),
        ({"a": "sonar", "a-heard": "sonar"}, 'a-heard.npz, as sensor "a" does'),
    ],
)
def test_names_that_collide_are_refused_at_once(headless, inputs, tmp_path, kinds, said):
    sensors = [f'[[sensors]]\nkind = "{kind}"\nname = "{name}"\n' for name, kind in kinds.items()]
    scene = tmp_path / "s.toml"
    scene.write_text("\n".join([SMALL.partition("[[sensors]]")[0], *sensors]))
    done = headless("run", scene, "--out", tmp_path / "o", "--convolve", inputs / "dry.wav")
    assert done.returncode == 2
    assert said in done.stderr
    assert not (tmp_path / "o").exists()


def test_an_empty_out_is_refused(headless, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = headless("run", "demo", "--out", "")
    assert done.returncode == 2
    assert "is empty; name a file or folder" in done.stderr
    assert not list(tmp_path.iterdir())


def test_names_do_not_command_the_terminal(headless, tmp_path):
    done = headless("stand", tmp_path / "a\x1b[2Jb.toml")
    assert "a\\x1b[2Jb.toml" in done.stderr
    assert "\x1b" not in done.stderr


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
