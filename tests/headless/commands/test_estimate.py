"""A map of trees becomes a scene, and its forests are like the site."""

import numpy as np
import pytest

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
from headless.commands.estimate import estimate_site

UTM = np.array([432_100.0, 5_612_300.0])
SITE = {
    "pine": Mixture(np.array([0.16]), np.array([[40.0, 60.0]]), np.array([[25.0, 15.0]])),
    "maple": Mixture(np.array([0.05]), np.array([[95.0, 30.0]]), np.array([[40.0, 60.0]])),
}
WINDOW = ["432100", "5612300", "432220", "5612390"]


def law(name):
    return Process(SITE[name], np.zeros(2), np.array([120.0, 90.0]))


pytestmark = pytest.mark.usefixtures(
    "quick"
)  # each is estimated again, which takes most of the time


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


@pytest.mark.slow
def test_the_command(headless, tmp_path):
    rows = [f"{k},{(7 * k) % 9},pine" for k in range(20)]
    (tmp_path / "site.csv").write_text("\n".join(["x,y,species", *rows, ""]))
    words = ["estimate", tmp_path / "site.csv", "--out", tmp_path / "s.toml"]
    words += ["--species", "pine=spruce"]
    ended = headless(*words)
    assert "Next: python -m headless run" in ended.stdout
