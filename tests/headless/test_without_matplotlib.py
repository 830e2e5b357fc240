"""Where there is no matplotlib, as in Blender: data are written, pictures are plain, a sentence says so."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.api.results import Response
from forest_addon.blender import packages
from forest_addon.drawing.palette import SPECIES, rgb
from forest_addon.drawing.strips import WIDE
from forest_addon.formats.raster_file import read_png
from forest_addon.spec import Forest, Planting, Reverb, Scene, SpecError
from forest_addon.stand.compose import Inputs
from forest_addon.ui.results.images import ABOVE, BELOW, LEFT
from headless import report
from headless.report import page

PLANTING = '[[plantings]]\nspecies = "{}"\nexpected = 20\nexact = true\n'


@pytest.fixture
def no_matplotlib(monkeypatch):
    """As if neither were installed; what was imported before is forgotten meanwhile."""
    drawing_ones = ("forest_addon.drawing.", "headless.report.", "headless.accuracy.")
    for name in list(sys.modules):
        if name.split(".")[0] in report.DRAWERS or name.startswith(drawing_ones):
            monkeypatch.delitem(sys.modules, name)
    for name in report.DRAWERS:
        monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.medium
def test_the_map_of_a_stand_is_drawn_all_the_same(tmp_path, headless, no_matplotlib):
    scene = tmp_path / "scene.toml"
    scene.write_text("[forest]\nsize = [40, 20]\n" + PLANTING.format("maple"))
    ended = headless("stand", scene, "--out", tmp_path / "points.csv")
    assert ended.returncode == 0
    assert "The map is plain: matplotlib is not there" in ended.stdout
    assert len((tmp_path / "points.csv").read_text().splitlines()) == 21
    pixels, _ = read_png((tmp_path / "points.png").read_bytes())
    green = np.abs(pixels / 255 - rgb(SPECIES["green"])).max(axis=2) < 0.12
    assert green.sum() > 20 * 50


@pytest.mark.medium
def test_an_estimate_is_written_without_its_picture(tmp_path, headless, no_matplotlib):
    trees = np.random.default_rng(1).uniform(0, 60, (80, 2))
    np.savetxt(tmp_path / "t.csv", trees, delimiter=",", header="x,y", comments="")
    words = ("--window", 0, 0, 60, 60, "--species", "maple", "--out", tmp_path / "site.toml")
    ended = headless("estimate", tmp_path / "t.csv", *words)
    assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "site.toml").exists()
    assert "The picture is left out: matplotlib is not there" in ended.stdout
    assert not list(tmp_path.glob("*.png"))


@pytest.mark.medium
def test_what_was_asked_to_be_drawn_is_refused_in_a_sentence(tmp_path, headless, no_matplotlib):
    ended = headless("species", "hazelnut", "--sheet", tmp_path / "a.png")
    assert ended.returncode == 2
    assert "hazelnut" in ended.stdout  # the table comes first
    assert "--sheet" in ended.stderr
    assert "pip install matplotlib" in ended.stderr


def test_a_command_that_only_draws_says_what_it_lacks(tmp_path, headless, no_matplotlib):
    ended = headless("accuracy", "demo", "--out", tmp_path / "figures")
    assert ended.returncode == 2
    assert "accuracy cannot draw its pictures: matplotlib is not there" in ended.stderr


def test_blender_is_told_where_it_looks_for_packages(monkeypatch, tmp_path):
    """The folder is on its path; a plain Python's pip knows its own."""
    assert "--target" not in report.without("Nothing is drawn")
    app = SimpleNamespace(binary_path="/opt/blender/blender")
    monkeypatch.setattr(packages, "bpy", SimpleNamespace(app=app, utils=bpy.utils))
    folder = report.without("Nothing is drawn").split('--target "')[1].split('"')[0]
    assert Path(folder) in map(Path, sys.path)


def test_a_figure_that_a_notebook_asks_for_says_what_it_lacks(no_matplotlib):
    with pytest.raises(SpecError, match=r'plot.*needs matplotlib; type once: ".*" -m pip install'):
        Response(Reverb(), None, 0.0).plot()


@pytest.mark.medium
def test_trees_stand_in_the_plain_map_where_they_stand(tmp_path, no_matplotlib):
    settings = Scene(
        forest=Forest(size=(100, 50)),
        plantings=(Planting(species="a", crown=3.0, expected=1), Planting(species="b", expected=1)),
    )
    stand = SimpleNamespace(
        position=np.array([[25.0, 10.0, 0.0], [80.0, 40.0, 0.0]]),
        species=np.array([0, 1]),
        scale=np.ones(2),
        area=5000.0,
    )
    stand = type("Stand", (), {**vars(stand), "__len__": lambda self: 2})()
    path = page.draw_stand(stand, ("a", "b"), settings, Inputs(), tmp_path / "map.png")
    pixels = read_png(path.read_bytes())[0][ABOVE:-BELOW, LEFT:] / 255
    for name, place in (("green", (25, 10)), ("orange", (80, 40))):
        rows, columns = np.nonzero(np.abs(pixels - rgb(SPECIES[name])).max(axis=2) < 0.12)
        metres = np.array([columns.mean(), len(pixels) - 1 - rows.mean()]) / WIDE * 100
        assert metres == pytest.approx(place, abs=0.3)
        if name == "green":  # as wide as its crown
            assert np.ptp(columns) / WIDE * 100 == pytest.approx(6.0, abs=0.3)
    assert page.colours_in_words(("a", "b")) == "In the map: a green, b orange."
