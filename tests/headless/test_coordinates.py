"""One rule of coordinates for all files of numbers: the same scene with and without an offset."""

import csv
import json
import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.io import loadmat

bpy = pytest.importorskip("bpy")

from forest_addon.results.coordinates import on_the_map

SMALL = Path(__file__).with_name("small.toml").read_text(encoding="utf-8")
OFFSET = (432100.25, 5612300.5, 130.0)
PLAIN = """[output]
pictures = false
goodness = false
report = false
preview = false
qsm = true
"""


def columns(path):
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def numbers(table, names):
    return np.array([[float(value) for value in table[name]] for name in names]).T


@pytest.mark.slow
def test_every_file_has_the_offset(headless, tmp_path):
    text = SMALL[: SMALL.index("[output]")].replace(
        "cull = 0.01", "cull = 0.01\ncontributions = true"
    )
    for name, head in (("near", ""), ("far", f'offset = {list(OFFSET)}\ncrs = "EPSG:32632"\n')):
        (tmp_path / f"{name}.toml").write_text(head + text + PLAIN)
        done = headless("run", tmp_path / f"{name}.toml", "--out", tmp_path / name)
        assert done.returncode == 0, done.stderr
    near, far = tmp_path / "near", tmp_path / "far"
    tables = columns(near / "trees.csv"), columns(far / "trees.csv")
    places = [numbers(table, ("x_m", "y_m", "z_m")) for table in tables]
    assert np.allclose(places[1] - places[0], OFFSET, rtol=0, atol=1e-8)
    assert {k: v for k, v in tables[0].items() if k[1:] != "_m"} == {
        k: v for k, v in tables[1].items() if k[1:] != "_m"
    }
    for file, key in (("leaves", "centre"), ("echo", "position"), ("echo-heard", "position")):
        with np.load(near / f"{file}.npz") as here, np.load(far / f"{file}.npz") as there:
            assert len(np.atleast_2d(here[key]))
            assert np.allclose(there[key] - here[key], OFFSET, rtol=0, atol=1e-8), file
            assert {k for k in here if k != key and not np.array_equal(here[k], there[k])} == set()
    tables = [columns(folder / "cylinders.csv") for folder in (near, far)]
    for ends in ("start", "end"):
        here, there = (numbers(table, [f"{ends}{axis}" for axis in "XYZ"]) for table in tables)
        assert len(here)
        assert np.allclose(there - here, OFFSET, rtol=0, atol=2e-5)  # digits of the table
    models = [
        loadmat(next((folder / "qsm").iterdir()), simplify_cells=True) for folder in (near, far)
    ]
    here, there = (model["QSM"]["cylinder"]["start"] for model in models)
    assert np.allclose(there - here, OFFSET, rtol=0, atol=1e-8)
    clouds = [laspy.read(folder / "cloud.laz") for folder in (near, far)]
    assert np.allclose(clouds[1].xyz - clouds[0].xyz, OFFSET, rtol=0, atol=2e-4)
    note = (far / "coordinates.txt").read_text()
    assert "metres in EPSG:32632; the offset 432100.25, 5612300.5, 130 has been added" in note
    assert not (near / "coordinates.txt").exists()
    raw = (far / "forest.glb").read_bytes()
    told = json.loads(raw[20 : 20 + struct.unpack_from("<I", raw, 12)[0]])
    assert told["scenes"][0]["extras"]["offset_m"] == list(OFFSET)
    bpy.ops.wm.open_mainfile(filepath=str(far / "forest.blend"))
    assert tuple(bpy.context.scene["offset_m"]) == OFFSET


@pytest.mark.medium
def test_trees_that_were_written_are_planted_where_they_stood(headless, tmp_path):
    text = SMALL[: SMALL.index("[[sensors]]")]
    (tmp_path / "a.toml").write_text(f"offset = {list(OFFSET)}\n" + text)
    done = headless("stand", tmp_path / "a.toml", "--out", tmp_path / "a.csv")
    assert done.returncode == 0, done.stderr
    first = (tmp_path / "a.csv").read_text().splitlines()[0]
    assert first == "id,species,x,y,z,scale,rotation,variant"  # as pandas reads it
    assert "has been added" in (tmp_path / "a-coordinates.txt").read_text()
    listed = text.replace("expected = 4", 'layout = "list"\ntrees = "a.csv"')
    (tmp_path / "b.toml").write_text(f"offset = {list(OFFSET)}\n" + listed)
    assert headless("stand", tmp_path / "b.toml", "--out", tmp_path / "b.csv").returncode == 0
    places = [numbers(columns(tmp_path / f"{name}.csv"), "xy") for name in "ab"]
    assert len(places[0])
    assert np.allclose(*places, rtol=0, atol=1e-8)


def test_a_scene_without_offset_is_as_it_was():
    table = {"x_m": [1.5], "centre": np.eye(3), "tree": [7]}
    assert on_the_map(table, (0.0, 0.0, 0.0)) == table
    moved = on_the_map(table, OFFSET)
    assert moved["x_m"] == [1.5 + OFFSET[0]]
    assert moved["tree"] == [7]
    assert table["x_m"] == [1.5]
