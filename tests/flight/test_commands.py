"""The commands as a user types them, small."""

import csv

import pytest
from matplotlib.image import imread

bpy = pytest.importorskip("bpy")

from forest_addon.formats.ownership import RECORD
from headless.cli import main
from studies.__main__ import main as study

SCENE = """
seed = 3
[forest]
size = [16.0, 12.0]
margin = 4.0
[[plantings]]
species = "whorl-8"
variants = 1
expected = 4
[flight]
distance = 8.0
steps = 40
step = 0.1
start_low = [0.0, 0.2]
start_high = [0.1, 0.8]
thinnest = 0.0
"""


def rows(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_fly_writes_tables_picture_and_blend(tmp_path):
    scene = tmp_path / "small.toml"
    scene.write_text(SCENE)
    out = tmp_path / "out"
    assert main(["fly", str(scene), "--episodes", "3", "--out", str(out)]) == 0
    assert {file.name for file in out.iterdir()} == {
        *("trajectories.csv", "success.csv", "flights.png", "flights.blend", RECORD)
    }
    success = rows(out / "success.csv")
    assert len(success) == 1
    assert int(success[0]["flights"]) == 3
    ends = {row["flight"]: row["end"] for row in rows(out / "trajectories.csv")}
    assert len(ends) == 3
    assert sum(end == "arrived" for end in ends.values()) == int(success[0]["arrived"])
    bpy.ops.wm.open_mainfile(filepath=str(out / "flights.blend"))
    flyers = [obj for obj in bpy.data.objects if obj.animation_data]
    assert len(flyers) == 3


@pytest.mark.slow
def test_gaps_are_an_experiment(tmp_path, monkeypatch):
    monkeypatch.setattr("studies.flight.gaps.DRAWS", 2)
    monkeypatch.setattr("studies.flight.gaps.SNR_DB", (None, 0.0))
    assert study(["flight", "gaps", "--size", "0.005", "--out", str(tmp_path)]) == 0
    assert imread(tmp_path / "gaps.png").std() > 0.05
    found = rows(tmp_path / "gaps.csv")
    assert len(found) == 5 * 2 * 4
    assert all(0 <= float(row["auc"]) <= 1 for row in found)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["fly", "nowhere.toml"], "no such file"),
        (["fly", "x.toml", "--episodes", "0"], "--episodes: 0 is out of range"),
        (["fly", "x.toml", "--speeds", "3,fast"], "is not numbers with commas"),
    ],
)
def test_what_cannot_be_says_so(words, said, capfd):
    assert main(words) == 2
    assert said in capfd.readouterr().err
