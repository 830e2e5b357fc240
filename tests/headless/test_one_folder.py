"""A folder of results: one command at a time, no leavings of killed ones, and a run that goes on."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy")

from forest_addon.api import World
from forest_addon.formats.atomic import replacing
from forest_addon.formats.ownership import RECORD
from forest_addon.formats.ply import PlyFile
from forest_addon.results.packed import read_values, write_values
from headless.command import name_of
from headless.commands import COMMANDS
from headless.lock import only_one
from headless.unfinished import kind_of

SMALL = Path(__file__).with_name("small.toml").read_text(encoding="utf-8")
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
        done = headless("run", scene, "--out", out)
        assert done.returncode == 2
        assert "in use by another command" in done.stderr
        assert os.listdir(out) == [".lock"]
    assert not out.exists()  # nothing was written


def test_a_folder_and_a_file_are_held_by_their_names(tmp_path):
    class Chosen:
        list = False
        out = tmp_path / "a.laz"

    lidar = next(command for command in COMMANDS if command.name == "lidar")
    assert lidar.lock_file(Chosen()) == tmp_path / ".a.lock"
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
    assert headless("run", scene, "--out", whole).returncode == 0
    look, looked = World.look, []

    def until_the_third(self, sensor, progress=None):
        looked.append(sensor.name)
        if len(looked) == 3:
            raise KeyboardInterrupt
        return look(self, sensor, progress)

    monkeypatch.setattr(World, "look", until_the_third)
    done = headless("run", scene, "--out", ended)
    assert done.returncode == 130
    assert "--resume goes on with it" in done.stderr
    assert not (ended / "run.json").exists()
    broken = next((ended / ".unfinished").glob("scan-*.npz"))
    broken.write_bytes(broken.read_bytes()[:1000])
    done = headless("run", scene, "--out", ended, "--resume", "--seed", "9")
    assert done.returncode == 2
    assert "of other settings or files" in done.stderr
    looked[:] = ["none"] * 5
    assert headless("run", scene, "--out", ended, "--resume").returncode == 0
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
            read_values(file, kind_of)


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
        (back,) = read_values(file, kind_of)
    np.testing.assert_equal(back, value)
    assert type(back["numbers"][6]) is np.float32
    with open(tmp_path / "b.npz", "wb") as file, pytest.raises(TypeError, match="is of no result"):
        write_values(file, [[print]])
