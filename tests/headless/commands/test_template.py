"""From a user's STL files to a forest in two commands."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from references.model_tree import tree

from forest_addon.formats.stl import read_stl, write_stl
from forest_addon.growth.library import load_species
from forest_addon.growth.own_tree.pieces import infer_unit

MAPLE = Path(__file__).resolve().parents[4] / "shared" / "data" / "maple"


@pytest.fixture
def files(tmp_path):
    """A model tree, drawn in centimetres."""
    model = tree()
    write_stl(tmp_path / "w.stl", model.wood() * 100)
    write_stl(tmp_path / "l.stl", model.leaves() * 100)
    return tmp_path


@pytest.mark.slow
def test_a_users_tree_becomes_a_forest_in_two_commands(headless, files, monkeypatch):
    monkeypatch.setattr("headless.report.trees.WIDTH", 500)  # it is rendered, which takes seconds
    monkeypatch.setattr("headless.report.trees.OF_TEMPLATE", 4)
    monkeypatch.setattr("headless.report.trees.SIDES", 4)
    out = files / "elm"
    words = ("--name", "elm", "--out", out, "--siblings", 3)
    said = headless("template", files / "w.stl", files / "l.stl", *words).stdout
    for words in (
        *("1 trunk", "9 first-level branches", "63 leaves", "inferred", "centimetres"),
        *("Rebuilt from its parts: 63 of 63 leaves", "Variety: 0.7"),
        "Lowest rings on the mesh, the tree itself: 0 of ",
        "24 siblings against the tree, 3 of them with sensors",
    ):
        assert words in said
    assert "Bridged" not in said
    for picture in ("recognised.png", "siblings.png"):
        assert imread(out / picture).std() > 0.05

    species, habit = load_species(out / "elm.toml")
    assert (habit.anatomy.order == 1).sum() == 9
    assert habit.anatomy.lines.knot[:, 2].max() < 20  # the library is in metres
    assert species.siblings.variety == 0.7  # its 63 leaves stand in lumps, siblings' in others

    scene = out / "scene.toml"
    scene.write_text(
        scene.read_text()
        + "\n[output]\nblend = false\nglb = false\npreview = false\n"
        + "pictures = false\ngoodness = false\nreport = false\n",
    )
    headless("run", scene, "--out", files / "out", "--quiet")
    with open(files / "out" / "trees.csv", encoding="utf-8") as table:
        rows = list(csv.DictReader(table))
    assert rows
    model = tree()
    tall = np.ptp(model.wood()[:, :, 2])
    for row in rows:
        assert 0.5 * tall < float(row["height_m"]) / float(row["scale"]) < 1.6 * tall
        assert float(row["wood_volume_m3"]) > 0
    record = json.loads((files / "out" / "run.json").read_text())
    assert record["triangles"]["unique"] > 0


@pytest.mark.medium
def test_a_height_that_is_given_sets_the_scale(headless, files):
    out = files / "elm"
    words = ("--name", "elm", "--height", 8, "--out", out, "--siblings", 0)
    said = headless("template", files / "w.stl", *words).stdout
    assert "given by --height" in said
    assert "8.00 m high" in said
    assert not (out / "leaves.stl").exists()
    _, habit = load_species(out / "elm.toml")
    assert len(habit.anatomy.foliage.bearer) == 0


@pytest.mark.slow
def test_the_grammar_of_2020a_is_there_by_name(headless, files):
    out = files / "elm"
    words = ("--name", "elm", "--grammar", "tanveer-2020a", "--out", out)
    said = headless("template", files / "w.stl", files / "l.stl", *words).stdout
    assert "siblings" not in said
    species, template = load_species(out / "elm.toml")
    assert species.siblings is None
    assert len(template.branches) == 9
    assert species.grammar.radius == pytest.approx(template.trunk_radius, rel=1e-3)


@pytest.mark.slow
def test_the_string_of_a_fitted_grammar(headless, files):
    out = files / "pine"
    words = ("--name", "pine", "--siblings", 0, "--out", out)
    headless("template", files / "w.stl", files / "l.stl", *words)
    species, _ = load_species(out / "pine.toml")
    assert species.siblings.allometry == "pinus"
    axiom = headless("derive", out / "pine.toml", "--generations", 0).stdout
    assert "A(" in axiom
    assert "F" not in axiom
    whole = headless("derive", out / "pine.toml").stdout
    assert whole.count("[") == whole.count("]") > 60
    assert "~(" in whole


@pytest.mark.slow
@pytest.mark.parametrize(("unit", "scale"), [("millimetres", 1000.0), ("inches", 1 / 0.0254)])
def test_one_file_of_any_unit_with_y_up(headless, tmp_path, unit, scale):
    """Wood and leaves in one STL, lying: told apart, stood up, and in metres."""
    model = tree()
    facets = np.concatenate([model.wood(), model.leaves()])[:, :, [0, 2, 1]] * [1, 1, -1]
    write_stl(tmp_path / "all.stl", facets * scale)
    out = tmp_path / "elm"
    words = ("--name", "elm", "--out", out, "--siblings", 0)
    said = headless("template", tmp_path / "all.stl", *words).stdout
    assert f"taken as {unit}" in said
    assert "told apart by shape" in said
    assert "Up: y, inferred" in said
    assert "63 leaves" in said
    _, habit = load_species(out / "elm.toml")
    assert (habit.anatomy.order == 1).sum() == 9
    tall = np.ptp(read_stl(out / "wood.stl")[:, :, 2])
    assert tall == pytest.approx(np.ptp(model.wood()[:, :, 2]), rel=1e-4)


@pytest.mark.slow
def test_unit_and_axis_may_be_given(headless, files):
    out = files / "elm"
    words = ("template", files / "w.stl", files / "l.stl", "--name", "elm", "--out", out)
    said = headless(*words, "--unit", "feet", "--up", "z", "--siblings", 0).stdout
    assert "given by --unit feet" in said
    assert "Up: z, given" in said
    assert "leans" in headless(*words, "--up", "y", ends=2).stderr


@pytest.mark.slow
def test_siblings_unlike_the_tree_get_no_scene_unless_they_are_accepted(
    headless, files, monkeypatch
):
    """Allowed is so little that no siblings keep to it: exit code 5, the files and no scene."""
    for name, few in (("MOST_DIFFERENCE", 1e-4), ("FEWEST", 6), ("MESHED", 2)):
        monkeypatch.setattr(f"forest_addon.growth.likeness.{name}", few)
    monkeypatch.setattr("headless.commands.template.can_draw", lambda: False)
    monkeypatch.setattr("headless.commands.template.SENSED", 1)
    monkeypatch.setattr("headless.report.trees.OF_TEMPLATE", 2)
    monkeypatch.setattr("headless.report.trees.SIDES", 3)
    out = files / "elm"
    words = ("template", files / "w.stl", files / "l.stl", "--name", "elm", "--out", out)
    assert "Next: " in headless(*words, "--siblings", 3, "--accept").stdout
    assert (out / "scene.toml").exists()
    ended = headless(*words, "--siblings", 3, ends=5)
    assert "error: siblings are not like the tree: " in ended.stderr
    assert "--accept" in ended.stderr
    assert "Variety: 0." in ended.stdout
    assert "Next: " not in ended.stdout
    assert (out / "elm.toml").exists()
    assert not (out / "scene.toml").exists()


@pytest.mark.medium
@pytest.mark.parametrize(
    ("facets", "problem"),
    [
        (np.concatenate([tree().wood(), tree().wood() + np.array([8, 0, 0])]), "one tree alone"),
        (tree().leaves(), "lies far from the rest"),
    ],
    ids=["two trees", "leaves alone"],
)
def test_what_is_not_understood_is_marked_in_a_picture(headless, tmp_path, facets, problem):
    write_stl(tmp_path / "x.stl", facets)
    out = tmp_path / "out"
    said = headless("template", tmp_path / "x.stl", "--name", "x", "--out", out, ends=2).stderr
    assert said.count("\n") == 1
    assert problem in said
    assert "recognised.png" in said
    assert imread(out / "recognised.png").std() > 0.05


@pytest.mark.parametrize(
    ("height", "leaf", "name"),
    [
        (9.5, 0.08, "metres"),
        (950, 8, "centimetres"),
        (12_000, 110, "millimetres"),
        (400, 4.0, "inches"),
        (40, 0.35, "metres"),  # as high as trees are
        (25.2, 0.02, "metres"),
        (119, None, "metres"),
        (0.02, None, "metres"),  # in no unit
        (8, None, "metres"),
    ],
)
def test_units_are_inferred_from_usual_sizes(height, leaf, name):
    assert infer_unit(height, leaf).name == name


@pytest.mark.slow
def test_the_maple_of_tanveer_2020a(headless, tmp_path):
    if not MAPLE.is_dir():
        pytest.skip(
            f"the maple of Tanveer et al. 2020a is not at {MAPLE}; it has no licence to be shipped"
        )
    wood, leaves = MAPLE / "maple_stem.stl", MAPLE / "maple_leaves.stl"
    words = ("--name", "maple", "--out", tmp_path, "--siblings", 0)
    said = headless("template", wood, leaves, *words).stdout
    assert "in 244 pieces" in said
    assert "1 trunk" in said
    assert "24 first-level branches" in said
    assert "3,710 leaf faces: 1,855 leaves" in said
    assert "inferred" in said
