"""A run of trees with targets: the report, run.json and trees.csv say target and reached."""

import csv
import json

import pytest

pytest.importorskip("bpy")

from forest_addon.spec import Forest, Output, Planting, Scene, Targets
from headless.pipeline import run_scene

LIST = "x,y,dbh,height,leaf_area\n2,2,0.10,8.0,20\n5,5,0.12,9.0,25\n"
OUTPUT = Output(blend=False, glb=False, preview=False, pictures=False)


@pytest.mark.slow
def test_the_report_says_target_and_reached(tmp_path, capsys):
    (tmp_path / "plot.csv").write_text(LIST)
    measured = Planting(
        species="honda-birch",
        layout="list",
        trees="plot.csv",
        variants=2,
        targets=Targets(allometry="betula"),
    )
    plain = Planting(species="grass", layout="list", trees="plot.csv", variants=1)
    scene = Scene(forest=Forest(size=(10, 10)), plantings=(measured, plain), output=OUTPUT)
    run_scene(scene, tmp_path, tmp_path / "out")
    told = json.loads((tmp_path / "out/run.json").read_text())
    assert told["targets"]["honda-birch"]["measures"]["leaf_area"]["target"] == [20, 22.5, 25]
    assert told["targets"]["honda-birch"]["allometry"] == "Betula"
    assert list(told["targets"]) == ["honda-birch"]
    page = (tmp_path / "out/report.html").read_text()
    assert "What the trees were to measure" in page
    assert "honda-birch: leaf area" in page
    assert "grass: its list gives dbh and height and leaf_area" in page
    assert "Warning: grass: its list gives" in capsys.readouterr().err
    with open(tmp_path / "out/trees.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["target_leaf_area_m2"] for row in rows] == ["20.0", "25.0", "", ""]
    assert rows[0]["in_band"] in ("0", "1")
    assert rows[2]["in_band"] == rows[2]["not_met"] == ""
