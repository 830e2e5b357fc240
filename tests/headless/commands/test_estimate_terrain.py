"""``estimate --terrain`` takes over where a terrain lies."""

import numpy as np
import pytest

from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene, SpecError
from forest_addon.stand.files import read_inputs
from headless.commands.estimate import estimate_site, scene_on

HEAD = "ncols 300\nnrows 200\nxllcorner 500000.5\nyllcorner 5400000\ncellsize 1\n"


@pytest.fixture
def terrain(tmp_path):
    heights = " ".join(["250"] * 60_000)
    (tmp_path / "dem.asc").write_text(HEAD + heights)
    return tmp_path / "dem.asc"


def test_a_terrain_alone_is_a_scene_in_its_middle(tmp_path, terrain):
    heard = []
    scene_on(terrain, tmp_path / "out" / "site.toml", "EPSG:32632", heard.append)
    scene = read_settings(tmp_path / "out" / "site.toml", Scene)
    assert scene.forest.size == (100.0, 100.0)
    assert np.abs(np.array(scene.offset) - [500100.5, 5400050, 0]).max() <= 0.5
    assert scene.crs == "EPSG:32632"
    ground = read_inputs(scene, tmp_path / "out").terrain
    assert ground.height(np.array([[50.0, 50.0]])).tolist() == [250.0]
    assert "heights in m of 250 to 250" in heard[0]


@pytest.mark.slow
def test_a_map_of_trees_stands_on_its_terrain(tmp_path, terrain):
    rng = np.random.default_rng(1)
    rows = [f"{500050 + x:.2f},{5400050 + y:.2f},maple" for x, y in 80 * rng.random((30, 2))]
    (tmp_path / "trees.csv").write_text("\n".join(["x,y,species", *rows]))
    estimate_site(
        tmp_path / "trees.csv", tmp_path / "site.toml", terrain=terrain, say=lambda _: None
    )
    scene = read_settings(tmp_path / "site.toml", Scene)
    assert scene.forest.terrain.file == "dem.asc"
    assert read_inputs(scene, tmp_path).terrain is not None


def test_a_terrain_without_a_place_is_refused(tmp_path):
    np.save(tmp_path / "dem.npy", np.zeros((3, 3)))
    with pytest.raises(SpecError, match="does not say where it lies"):
        scene_on(tmp_path / "dem.npy", tmp_path / "site.toml")
