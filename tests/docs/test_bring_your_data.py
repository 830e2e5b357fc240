"""The table of docs/bring-your-data.md is planted by the scene that the page shows, word for word."""

import re

import numpy as np
import pytest
from references.scripts import ROOT

from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene
from forest_addon.stand.files import read_inputs
from forest_addon.stand.plan import plan_stand

PAGE = (ROOT / "docs/bring-your-data.md").read_text(encoding="utf-8")


def test_its_trees_stand_where_they_were_measured(tmp_path):
    (tmp_path / "trees.csv").write_text(PAGE.split("```\n")[1], encoding="utf-8")
    toml = re.search(r"^```toml\n(.*?)^```", PAGE, re.M | re.S)[1]
    (tmp_path / "these.toml").write_text(toml, encoding="utf-8")
    scene = read_settings(tmp_path / "these.toml", Scene)
    inputs = read_inputs(scene, tmp_path)
    assert 'trees.csv: "Bu" is planted as european-beech' in inputs.told
    assert 'trees.csv: "Fi" is planted as norway-spruce' in inputs.told
    trees = inputs.lists["trees.csv"]
    measured = [[0.315, 22.4], [0.28, 21.0], [0.402, 25.1], [0.228, 17.9]]
    assert trees.measures[:, :2] == pytest.approx(np.array(measured))
    stand = plan_stand(scene.seed, scene.forest, scene.plantings, inputs)
    of = np.array([planting.species for planting in scene.plantings])[stand.species]
    places = {
        (kind, *place)
        for kind, place in zip(of.tolist(), stand.position[:, :2].tolist(), strict=True)
    }
    assert places == {
        ("european-beech", 4.2, 3.75),
        ("norway-spruce", 11.8, 6.1),
        ("european-beech", 6.4, 14.9),
        ("european-beech", 17.1, 4.4),
    }
