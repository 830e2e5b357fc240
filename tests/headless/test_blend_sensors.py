"""Sensors that live in a .blend file, run without a window, and the command that a usage line names."""

import json
import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import api as forest
from forest_addon.formats.ownership import RECORD
from forest_addon.ui import registered
from forest_addon.ui.settings.exchange import from_spec, to_spec

ROOT = Path(__file__).resolve().parents[2]
WINDY = forest.Scene(
    name="Windy",
    seed=5,
    forest=forest.Forest(size=(6, 6), margin=2),
    plantings=(forest.Planting(species="hazelnut", variants=1, expected=3, exact=True),),
    wind=forest.Wind(speed=8),
    sensors=(
        forest.Terrestrial(name="cloud", position=(3, 3, 1), angle_step_deg=4),
        forest.Sonar(name="echo", position=(-1, 3, 1), max_range=4),
    ),
)


def saved(path, settings, *, grow):
    """A .blend file as the panel leaves it; returns the settings that the panel holds."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with registered():
        from_spec(bpy.context.scene, settings)
        if grow:
            assert bpy.ops.forest.build() == {"FINISHED"}
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
        return to_spec(bpy.context.scene)


@pytest.mark.slow
def test_sensors_of_a_blend_file_find_what_the_api_finds_in_the_wind(headless, tmp_path):
    blend, out = tmp_path / "windy.blend", tmp_path / "o"
    settings = saved(blend, WINDY, grow=True)
    before = blend.read_bytes()
    ended = headless("run", blend, "--out", out)
    assert ended.returncode == 0, ended.stderr
    assert "stand still" not in ended.stderr
    assert blend.read_bytes() == before
    made = {p.name for p in out.iterdir()}
    pictures = {"cloud.png", "echo.png", "report.html"}
    assert made == {RECORD, "cloud.laz", "echo.npz", "echo.wav", "run.json"} | pictures
    record = json.loads((out / "run.json").read_text())
    assert record["settings"]["blend"] == "windy.blend"
    assert set(record["sensors"]) == {"cloud", "echo"}

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    world = forest.build(settings)  # grown anew, so nothing comes from the file
    for sensor, name in zip(settings.sensors, ("cloud.laz", "echo.npz"), strict=True):
        world.look(sensor).save(tmp_path / name)
    ours, theirs = (laspy.read(folder / "cloud.laz") for folder in (out, tmp_path))
    assert len(ours.points) > 500
    assert np.array_equal(ours.points.array, theirs.points.array)
    ours, theirs = (np.load(folder / "echo.npz") for folder in (out, tmp_path))
    assert sorted(ours.files) == sorted(theirs.files)
    assert all(np.array_equal(ours[name], theirs[name]) for name in ours.files)
    calm = forest.build(settings.changed(wind=forest.Wind())).look(settings.sensors[0])
    calm.save(tmp_path / "calm.laz")
    assert not np.array_equal(
        laspy.read(tmp_path / "calm.laz").xyz, laspy.read(out / "cloud.laz").xyz
    )


def test_a_blend_file_without_sensors_or_things_says_so(headless, tmp_path):
    bare = WINDY.changed(wind=forest.Wind())
    blend, out = tmp_path / "bare.blend", tmp_path / "o"
    saved(blend, bare.changed(sensors=()), grow=False)
    ended = headless("run", blend, "--out", out)
    assert (ended.returncode, "add one in the panel" in ended.stderr) == (2, True)
    saved(blend, bare, grow=False)
    ended = headless("run", blend, "--out", out)
    assert (ended.returncode, "has nothing to scan" in ended.stderr) == (2, True)
    ended = headless("run", blend, "--out", out, "--seed", 3)
    assert (ended.returncode, "belongs to a scene file" in ended.stderr) == (2, True)


@pytest.mark.medium
def test_centimetres_become_metres_and_a_warning_says_so(headless, tmp_path):
    blend, out = tmp_path / "cm.blend", tmp_path / "o"
    scanner = forest.Terrestrial(name="cloud", position=(300, 0, 0), angle_step_deg=1)
    saved(blend, forest.Scene(sensors=(scanner,)), grow=False)
    bpy.ops.mesh.primitive_cube_add(size=200)
    bpy.context.scene.unit_settings.scale_length = 0.01
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    ended = headless("run", blend, "--out", out)
    assert (ended.returncode, "a unit is made 0.01 m" in ended.stderr) == (0, True)
    cloud = laspy.read(out / "cloud.laz")
    assert len(cloud.points) > 100
    assert np.abs(cloud.x - 1).max() < 0.1  # noise of ranges; it sees the face towards it alone
    assert np.abs(cloud.xyz[:, 1:]).max() == pytest.approx(1, abs=0.1)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("before", "after"),
    [
        (("--python", "headless/in_blender.py", "--"), ("run",)),
        (("scene.blend", "--command", "forest"), ("run",)),
    ],
)
def test_the_usage_line_names_the_command_that_was_typed(tmp_path, before, after):
    code = (
        "import runpy, sys; "
        f"sys.argv = {['/usr/bin/blender', '-b', *before, *after, '--help']!r}; "
        f"runpy.run_path({str(ROOT / 'headless' / 'in_blender.py')!r})['run']({[*after, '--help']!r})"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith(f"usage: blender -b {' '.join(before)} run ")
