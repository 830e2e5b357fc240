"""``python -m headless stand``: files, table and map, and the scenes of the papers."""

import csv
import json

import numpy as np
import pytest
from matplotlib.image import imread

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library import read_allometry
from forest_addon.growth.measured.allometry import middle
from forest_addon.spec import Scene, SpecError
from forest_addon.stand.compose import process_of
from forest_addon.stand.files import read_inputs
from forest_addon.stand.intensity.functions import Mixture
from forest_addon.stand.layouts import Process, sample
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


# ----------------------------------------------------------------------------------------- estimate
# A map of trees becomes a scene, and its forests are like the site.

UTM = np.array([432_100.0, 5_612_300.0])
SITE = {
    "pine": Mixture(np.array([0.16]), np.array([[40.0, 60.0]]), np.array([[25.0, 15.0]])),
    "maple": Mixture(np.array([0.05]), np.array([[95.0, 30.0]]), np.array([[40.0, 60.0]])),
}
WINDOW = ["432100", "5612300", "432220", "5612390"]


def law(name):
    return Process(SITE[name], np.zeros(2), np.array([120.0, 90.0]))


@pytest.fixture
def site(tmp_path):
    """A CSV of a site with two species, in UTM coordinates, comments and all."""
    rows = ["# mapped by hand", "Easting;Northing;Species;girth"]
    for name in SITE:
        points = sample(law(name), stream(11, name)) + UTM
        rows += [f"{x:.3f};{y:.3f};{name};1" for x, y in points]
    path = tmp_path / "site.csv"
    path.write_text("\n".join([*rows, ""]), encoding="utf-8-sig")
    return path


@pytest.mark.usefixtures("quick")
@pytest.mark.slow
@pytest.mark.parametrize(("method", "error"), [("mixture", 0.05), ("kernel", 0.25)])
def test_forests_like_the_site(site, tmp_path, method, error):
    said = []
    scene = estimate_site(
        *(site, tmp_path / "o" / "like.toml", method, WINDOW, ["pine=spruce"], said.append),
        law="poisson",
    )
    made = sorted(p.name for p in scene.parent.iterdir())
    arrays = ["like-maple.npy", "like-pine.npy"] if method == "kernel" else []
    assert made == sorted([*arrays, "like-estimate.png", "like.toml"])
    assert "pine as spruce" in "\n".join(said)
    settings = read_settings(scene, Scene)
    assert settings.offset == (432_100.0, 5_612_300.0, 0.0)
    assert settings.forest.size == (120.0, 90.0)
    inputs = read_inputs(settings, scene.parent)
    x, y = np.meshgrid(np.arange(0.5, 120), np.arange(0.5, 90))
    at = np.column_stack([x.ravel(), y.ravel()])
    names = {"spruce": "pine", "maple": "maple"}
    assert {p.species for p in settings.plantings} == set(names)
    for planting in settings.plantings:
        true, like = law(names[planting.species]), process_of(planting, settings.forest, inputs)
        found = like.at(at) / like.expected - true.at(at) / true.expected
        # Of the density, relative; some 3 times what it is on average.
        assert (found**2).sum() < error * ((true.at(at) / true.expected) ** 2).sum()
    stand = plan_stand(3, settings.forest, settings.plantings, inputs)
    mean = sum(p.expected for p in settings.plantings)
    assert abs(len(stand) - mean) < 4.5 * np.sqrt(mean)  # false alarm 7e-6


@pytest.mark.usefixtures("quick")
@pytest.mark.slow
def test_a_polygon_as_the_window(tmp_path):
    corners = [(0, 0), (50, 0), (50, 40), (0, 60)]
    hole = [(10, 10), (20, 10), (20, 20), (10, 20)]
    rings = [(x, y, name) for ring, name in ((corners, "a"), (hole, "b")) for x, y in ring]
    trees = {"w": rings, "t": [(k, (7 * k) % 9) for k in range(40)], "in": [(30, 30), (15, 15)]}
    for name, rows in trees.items():
        lines = [",".join(map(str, row)) for row in [("x", "y", "ring")[: len(rows[0])], *rows]]
        (tmp_path / f"{name}.csv").write_text("\n".join([*lines, ""]))
    words = (tmp_path / "s.toml", "mixture", [str(tmp_path / "w.csv")], ["spruce"])
    scene = estimate_site(tmp_path / "t.csv", *words, law="poisson")
    forest = read_settings(scene, Scene).forest
    assert (forest.polygon, forest.holes) == (tuple(corners), (tuple(hole),))
    with pytest.raises(SpecError, match=r"row 3: the tree at \(15, 15\) lies outside"):
        estimate_site(tmp_path / "in.csv", *words)


@pytest.mark.usefixtures("quick")
@pytest.mark.slow
@pytest.mark.parametrize("method", ["mixture", "kernel"])
@pytest.mark.parametrize(
    "text", ["x,y\n5,5\n", "x,y,stem\n5,5,1\n5,5,2\n5,5,3\n", "x,y\n5,5\n6,5\n9,5\n"]
)
def test_few_trees_make_a_scene_too(tmp_path, method, text):
    (tmp_path / "t.csv").write_text(text)
    scene = estimate_site(tmp_path / "t.csv", tmp_path / "s.toml", method, (), ["maple"])
    settings = read_settings(scene, Scene)
    stand = plan_stand(1, settings.forest, settings.plantings, read_inputs(settings, tmp_path))
    assert settings.plantings[0].expected == len(
        {row[:3] for row in text.splitlines()[1:]}
    )  # stems of one tree
    assert len(stand) < 20


@pytest.mark.usefixtures("quick")
@pytest.mark.slow
def test_measures_of_the_map_are_those_of_the_scene(tmp_path):
    """Of 80 spruces whose heights are 0.8 times those of their kind."""
    kind, rng = read_allometry("picea-abies", tmp_path), stream(5, "carried")
    dbh = rng.normal(0.3, 0.05, 80)
    height = 0.8 * np.exp(middle(kind.height, dbh) + rng.normal(0, 0.05, 80))
    rows = zip(
        *np.add(rng.uniform(0, 60, (2, 80)), [[4e5], [5.4e6]]), 100 * dbh, height, strict=True
    )
    (tmp_path / "t.csv").write_text(
        "Easting,Northing,BHD [cm],Height,sp\n"
        + "".join(f"{x},{y},{d},{h},fichte\n" for x, y, d, h in rows)
    )
    words = [
        "--species",
        "fichte=norway-spruce",
        "--crs",
        "EPSG:25832",
        "--out",
        str(tmp_path / "s.toml"),
    ]
    assert main(["estimate", str(tmp_path / "t.csv"), *words]) == 0
    scene = read_settings(tmp_path / "s.toml", Scene)
    assert scene.crs == "EPSG:25832"
    targets = scene.plantings[0].targets
    assert targets.dbh.mean == pytest.approx(dbh.mean(), rel=1e-3)
    assert targets.dbh.sd == pytest.approx(dbh.std(), rel=1e-3)
    law = read_allometry(targets.allometry, tmp_path)
    assert np.exp(middle(law.height, dbh)) == pytest.approx(
        0.8 * np.exp(middle(kind.height, dbh)), rel=0.03
    )
    assert law.height.high == pytest.approx(1.645 * 0.05, rel=0.4)
    text = (tmp_path / "t.csv").read_text().replace("BHD [cm],Height", "k,Height")  # heights alone
    (tmp_path / "t.csv").write_text(text)
    scene = estimate_site(tmp_path / "t.csv", tmp_path / "h.toml", species=["norway-spruce"])
    alone = read_settings(scene, Scene).plantings[0].targets
    assert alone.allometry == "picea-abies"
    tall = middle(kind.height, np.array([alone.dbh.mean]))
    assert np.exp(tall[0]) == pytest.approx(height.mean(), rel=0.1)


@pytest.mark.usefixtures("quick")
@pytest.mark.slow
def test_the_command(headless, tmp_path):
    rows = [f"{k},{(7 * k) % 9},pine" for k in range(20)]
    (tmp_path / "site.csv").write_text("\n".join(["x,y,species", *rows, ""]))
    words = ["estimate", tmp_path / "site.csv", "--out", tmp_path / "s.toml"]
    words += ["--species", "pine=spruce"]
    ended = headless(*words)
    assert "Next: python -m headless run" in ended.stdout
