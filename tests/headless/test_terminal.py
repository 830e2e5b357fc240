"""Words of a run in a terminal and in a pipe: a line a step, and what it found; nothing is redrawn."""

import json
import re
import subprocess
import sys
from importlib import metadata

import laspy
import pytest

from forest_addon import api, kernels, spec
from forest_addon.base.places import ASSETS, environment_of_child
from headless import pipeline
from headless.cli import main

SCENE = """
seed = 7
[forest]
size = [8.0, 8.0]
[[plantings]]
species = "maple"
variants = 1
expected = 1
exact = true
[output]
report = false
preview = false
pictures = false
blend = false
glb = false
goodness = false
[[sensors]]
kind = "terrestrial"
name = "tripod"
position = [1.0, 1.0, 1.6]
angle_step_deg = 3.0
"""


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def test_a_step_is_a_line_that_says_what_it_found(scene, tmp_path, capsys):
    assert main(["run", str(scene), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().err
    assert "\r" not in said
    assert "\n\n" not in said
    lines = said.splitlines()
    assert max(map(len, lines)) < 110 + len(str(tmp_path))
    tripod = next(line for line in lines if "terrestrial tripod" in line)
    with laspy.open(tmp_path / "out" / "tripod.laz") as cloud:
        assert f"{cloud.header.point_count:,} points" in tripod
    assert "checked: " in tripod
    assert not any("sent again" in line for line in lines)


def test_details_are_said_where_they_are_asked_for_and_the_record_is_printed(
    scene, tmp_path, capsys
):
    words = ["run", str(scene), "--out", str(tmp_path / "out"), "--verbose", "--json"]
    assert main(words) == 0
    said = capsys.readouterr()
    assert any("sent again" in line for line in said.err.splitlines())
    assert json.loads(said.out) == json.loads((tmp_path / "out" / "run.json").read_text())


@pytest.mark.parametrize("word", ["demo", "assets/scenes/demo.toml"])
def test_what_ships_is_named_from_any_folder(word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert api.read(word).name == api.read(ASSETS / "scenes" / "demo.toml").name
    (tmp_path / word).mkdir(parents=True)  # such as results of an earlier run
    assert api.read(word).name == api.read(ASSETS / "scenes" / "demo.toml").name


def test_a_mistyped_command_or_scene_is_answered_with_the_nearest(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["--versoin"]) == 2
    assert 'did you mean "--version"' in capsys.readouterr().err
    assert main(["rnu", "demo"]) == 2
    assert 'did you mean "run"' in capsys.readouterr().err
    assert main(["run", "dmo"]) == 2
    assert 'did you mean "demo"' in capsys.readouterr().err
    with pytest.raises(spec.SpecError, match='did you mean "demo"'):
        api.read("dmo")


def test_a_folder_may_be_called_like_the_command(scene, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    assert main(["run", "scene.toml", "--out", "run"]) == 0


def test_doctor_names_what_computes_and_how_to_get_what_is_missing(monkeypatch, capsys):
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert f"numpy {metadata.version('numpy')}" in said
    assert kernels.engine() in said
    monkeypatch.setenv(kernels.SWITCH, "off")
    monkeypatch.setitem(sys.modules, "bpy", None)
    monkeypatch.setattr(metadata, "version", lambda name: _version_but_of(name, "scipy"))
    assert main(["doctor"]) == 4
    told = capsys.readouterr()
    assert "missing scipy: pip install forest-sensing" in told.out
    assert "C compiler" in told.out
    assert "Blender, scipy missing" in told.err


def _version_but_of(name, missing):
    if name == missing:
        raise metadata.PackageNotFoundError(name)
    return "1.0"


def test_without_blender_a_run_says_what_to_install(tmp_path):
    code = "import sys; sys.modules['bpy'] = None; from headless.cli import main; sys.exit(main())"
    words = [sys.executable, "-c", code, "run", "demo", "--out", str(tmp_path / "out")]
    ended = subprocess.run(words, capture_output=True, text=True, env=environment_of_child())
    assert ended.returncode == 2
    assert ended.stderr.splitlines()[-1].startswith(
        "error: run: Blender as a module is not installed"
    )
    assert "pip install bpy" in ended.stderr


def test_a_forest_that_memory_will_not_hold_is_refused_as_it_has_grown(
    scene, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(pipeline, "free_memory", lambda: 1e5)
    assert main(["run", str(scene), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert re.match(r"error: plantings: their 1 different trees need about \S+ GB of memory", said)
    assert said.endswith("0.0001 GB are free; give about 1 variants in all")
