"""What trees were to measure, and what is said of it: counted against the table, and where nobody asked."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.api.world import trees_in_world
from forest_addon.growth.library import find_species, load_species, read_allometry
from forest_addon.growth.measured.allometry import TARGETS, band
from forest_addon.spec import Forest, Planting, Scene, Targets
from forest_addon.stand.compose import Inputs
from forest_addon.stand.files import read_tree_list
from forest_addon.stand.forest import NONE, grow_forest, met_targets, tree_table
from forest_addon.stand.measured import facts_of, in_band, record, sentences, targets_met

LIST = "x,y,dbh,height\n2,2,0.10,8.0\n5,5,0.12,9.0\n8,8,0.16,9.5\n"
LAW = read_allometry("betula", Path())


def grown(tmp_path, targets):
    file = tmp_path / "plot.csv"
    file.write_text(LIST)
    planting = Planting(
        species="honda-birch", layout="list", trees="plot.csv", variants=3, targets=targets
    )
    scene = Scene(seed=4, forest=Forest(size=(10, 10)), plantings=(planting,))
    lists = {"plot.csv": read_tree_list(file)}
    inputs = Inputs(lists=lists, allometries={"betula": LAW} if targets else {})
    return grow_forest(scene, [load_species(find_species("honda-birch", Path()))], None, inputs)


@pytest.mark.slow
def test_target_and_reached_of_every_tree(tmp_path):
    forest = grown(tmp_path, Targets(allometry="betula"))
    assert forest.notes == ()
    (met,) = met_targets(forest)
    table = tree_table(forest)
    assert met.kind == LAW.name
    assert met.wanted[:, 0].tolist() == [0.10, 0.12, 0.16]
    assert met.found[:, 1].tolist() == table["height_m"]
    assert met.reached[:, 0].all()
    told = record(met)
    assert told["measures"]["height"]["target"] == [8.0, 9.0, 9.5]
    assert told["measures"]["dbh"]["not_met"] == 0
    assert told["all_within_band"] == np.mean(np.array(table["in_band"], dtype=float))
    assert next(iter(facts_of(met))) == "honda-birch: dbh"
    low, high = band(LAW, np.array([0.10, 0.12, 0.16]))
    height = np.array(table["height_m"])
    inside = (height >= low[:, 0]) & (height <= high[:, 0])
    assert told["measures"]["height"]["within_band"] == inside.mean()
    columns = trees_in_world(forest, NONE)
    assert columns["target_leaf_area_m2"].dtype == columns["in_band"].dtype == np.float64
    assert columns["not_met"].shape == (3,)


@pytest.mark.medium
def test_what_a_list_says_in_vain_is_said(tmp_path):
    forest = grown(tmp_path, None)
    assert forest.notes == (
        "honda-birch: its list gives dbh and height, which count only with [plantings.targets]; the "
        "trees have the sizes of their species",
    )
    assert met_targets(forest) == []
    assert "target_dbh_m" not in tree_table(forest)


def table_of(found):
    names = ("dbh_m", "height_m", "crown_width_m", "crown_base_m", "leaf_area_m2")
    return dict(zip(names, found.T.tolist(), strict=True))


def test_what_could_not_be_is_counted():
    """A tree a millimetre and more too thick, one with a crown 6 % too wide; the third has no targets."""
    wanted = np.array([[0.2, 15, 4, 5, 60], [0.2, 15, 4, 5, 60], [np.nan] * 5])
    found = np.array([[0.2012, 15, 4.19, 5, 60], [0.2, 15.0, 4.24, 5, 60], [0.1, 2, 1, 1, 1]])
    (met,) = targets_met(
        table_of(found), np.zeros(3, int), ["a"], wanted, [LAW], [("no room",), (), ()]
    )
    assert list(sentences(met)) == [
        "a: dbh of 1 of 2 trees is off its target by more than 1 mm.",
        "a: crown_width of 1 of 2 trees is off its target by more than 5%.",
        "a: no room (1 of 2 trees).",
    ]
    assert dict(zip(TARGETS, met.off.max(axis=0), strict=True))["crown_width"] == pytest.approx(
        0.06
    )


def test_the_band_is_that_of_nine_of_ten():
    """Trees drawn by the law itself: 4,000 binomial trials."""
    from forest_addon.base.rng import stream
    from forest_addon.growth.measured.allometry import draw

    rng = stream(3, "band")
    dbh = np.exp(rng.uniform(np.log(0.05), np.log(0.3), 4000))
    drawn = draw(LAW, dbh, np.full((4000, 4), np.nan), rng.random((4000, 4)))
    inside = in_band(LAW, np.column_stack([dbh, drawn])).mean(axis=0)
    # Residuals are those of a normal within 1.9 sigmas: 0.9 / 0.94257. Four sigmas: 3e-4 false alarms.
    assert np.abs(inside - 0.9 / 0.94257).max() < 4 * np.sqrt(0.955 * 0.045 / 4000)
