"""``python -m headless stand``: files, table and map, and the scenes of the papers."""

import csv
import json

import numpy as np
import pytest
from matplotlib.image import imread

from forest_addon.base.places import ASSETS
from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene, SpecError
from forest_addon.stand.files import read_inputs
from forest_addon.stand.plan import plan_stand
from headless.cli import main
from headless.commands.estimate import estimate_site, scene_on

SCENES = ASSETS / "scenes"
SCENE = """\
offset = [500000.0, 5400000.0, 0.0]
crs = "EPSG:32632"
[forest]
size = [40.0, 30.0]
spacing = 1.0
polygon = [[0, 0], [40, 0], [40, 30], [0, 30]]
holes = [[[10, 10], [20, 10], [20, 20], [10, 20]]]
terrain = { file = "hill.npy" }
[[plantings]]
species = "maple"
expected = 200
rasters = [{ file = "density.npy", use = "multiply" }]
[[plantings]]
species = "hazelnut"
density = 0.05
slope_deg = [0, 60]
"""


@pytest.fixture
def scene(tmp_path):
    y, x = np.mgrid[0:12, 0:16]
    np.save(tmp_path / "hill.npy", np.sin(x / 3) + 0.2 * y)
    np.save(tmp_path / "density.npy", x / 16)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


@pytest.mark.slow
def test_positions_and_map_are_written(scene, tmp_path, headless):
    out = tmp_path / "new" / "points.csv"
    said = headless("stand", scene, "--out", out).stdout
    assert "too near" in said
    assert "together" in said
    assert "EPSG:32632" in said
    assert "has been added" in (tmp_path / "new" / "points-coordinates.txt").read_text()
    assert (
        out.open().readline() == "id,species,x,y,z,scale,rotation,variant\n"
    )  # as pandas reads it
    rows = list(csv.DictReader(out.open()))
    place = np.array([[float(row["x"]), float(row["y"])] for row in rows]) - [500_000, 5_400_000]
    assert ((place >= 0) & (place <= [40, 30])).all()
    assert not ((place > 10) & (place < 20)).all(axis=1).any()
    gap = np.hypot(*(place[:, None] - place[None]).transpose(2, 0, 1)) + 9 * np.eye(len(place))
    assert gap.min() >= 1 - 1e-8
    assert imread(out.with_suffix(".png")).std() > 0.05


@pytest.mark.slow
def test_geojson_and_another_seed(scene, tmp_path):
    scene.write_text(SCENE.replace("slope_deg = [0, 60]\n", "").replace("rasters =", "# "))
    made = []
    for seed in ("0", "2"):  # the first is the scene's own
        out = tmp_path / f"{seed}.geojson"
        assert main(["stand", str(scene), "--out", str(out), "--seed", seed]) == 0
        made.append(json.loads(out.read_text())["features"])
    settings = read_settings(scene, Scene)
    inputs = read_inputs(settings, tmp_path)
    stand = plan_stand(settings.seed, settings.forest, settings.plantings, inputs)
    place = stand.position + settings.offset
    assert [tree["geometry"]["coordinates"] for tree in made[0]] == place.tolist()
    assert made[0] != made[1]


def test_a_stand_says_what_has_no_effect_and_that_no_tree_stands(tmp_path, headless):
    (tmp_path / "trees.csv").write_text("x,y\n")
    planted = 'species = "maple"\nlayout = "list"\ntrees = "trees.csv"\ndensity = 3\n'
    written = f"[[plantings]]\n{planted}[wind]\nturbulence = 0.1\n"
    (tmp_path / "scene.toml").write_text(written)
    said = headless("stand", tmp_path / "scene.toml", "--out", tmp_path / "p.csv").stderr
    for words in (
        "maple: density has no effect",
        "wind.turbulence has no effect",
        "no tree stands",
    ):
        assert f"Warning: {words}" in said


@pytest.mark.slow
def test_many_trees_are_drawn_as_pixels(tmp_path):
    scene = tmp_path / "many.toml"
    scene.write_text('[[plantings]]\nspecies = "maple"\nexpected = 30000\n')
    assert main(["stand", str(scene), "--out", str(tmp_path / "p.csv")]) == 0
    assert imread(tmp_path / "p.png").std() > 0.05


EXPECTED = {  # plantings
    "wahed-300m": 4,
    "tanveer-20m": 2,
    "tanveer-fig3-left": 2,
    "tanveer-fig3-right": 2,
    "simlidar-orchard": 1,
}


@pytest.mark.parametrize("name", EXPECTED)
def test_scenes_of_the_papers_expect_what_their_formulas_say(name):
    import mpmath

    settings = read_settings(SCENES / f"{name}.toml", Scene)
    stand = plan_stand(settings.seed, settings.forest, settings.plantings)
    assert len(settings.plantings) == EXPECTED[name]
    assert len(stand)
    for planting, expected in zip(settings.plantings, stand.expected, strict=True):
        total = mpmath.mpf(0)
        for hill in planting.gaussians:
            product = mpmath.mpf(hill.peak)
            for k in (0, 1):
                a, h, end = hill.centre[k], hill.width[k], settings.forest.size[k]
                span = mpmath.erf((end - a) / h) - mpmath.erf(-a / h)
                product *= mpmath.sqrt(mpmath.pi) / 2 * h * span
            total += product
        if planting.gaussians:
            assert expected == pytest.approx(float(total), rel=1e-12)


def test_unsquared_formulas_of_the_papers_became_squared_ones():
    """W: h = l = 4000 m²; Tanveer et al. 2020a's example: 5, 6, 3, 6 m²."""
    for name, widths in (("wahed-300m", [4000] * 8), ("tanveer-20m", [5, 6, 3, 6])):
        settings = read_settings(SCENES / f"{name}.toml", Scene)
        found = [w**2 for p in settings.plantings for g in p.gaussians for w in g.width]
        assert found == pytest.approx(widths, rel=1e-8)


# ---------------------------------------------------------------------------------- estimate terrain
# ``estimate --terrain`` takes over where a terrain lies.

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
