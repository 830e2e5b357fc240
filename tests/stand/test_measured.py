"""Stands of trees that measure what a list or a planting says."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.growth.library import FOLDER, find_species, load_species, read_allometry
from forest_addon.growth.measured.allometry import Wanted, scores
from forest_addon.growth.skeleton import Skeleton
from forest_addon.growth.tree import grow
from forest_addon.spec import Forest, Normal, Planting, Rows, Scene, SpecError, Targets
from forest_addon.stand.compose import Inputs
from forest_addon.stand.files import read_tree_list
from forest_addon.stand.forest import ForestPlan, grow_forest, tree_table
from forest_addon.stand.measured import dbh_at, groups_of, scales_for, with_targets
from forest_addon.stand.plan import plan_stand

LIST = "x,y,dbh,height\n" + "".join(
    f"{x},{x},{0.08 + 0.01 * x:.3f},{7 + 0.3 * x:.2f}\n" for x in range(1, 9)
)


def grown(tmp_path, variants):
    file = tmp_path / "plot.csv"
    file.write_text(LIST)
    planting = Planting(species="scots-pine", layout="list", trees="plot.csv", variants=variants)
    scene = Scene(seed=4, forest=Forest(size=(20, 20)), plantings=(planting,))
    inputs = Inputs(lists={"plot.csv": read_tree_list(file)})
    return grow_forest(scene, [load_species(find_species("scots-pine", Path()))], None, inputs)


@pytest.mark.slow
@pytest.mark.parametrize("variants", [8, 3])
def test_every_tree_of_a_list_has_its_diameter(tmp_path, variants):
    """With a variant for each tree its height too; with fewer, that of a tree of like proportions."""
    forest = grown(tmp_path, variants)
    table = tree_table(forest)
    dbh, height = np.array(table["dbh_m"]), np.array(table["height_m"])
    assert len(forest.variants) == variants
    assert dbh == pytest.approx(0.08 + 0.01 * np.arange(1, 9), abs=1e-6)
    near = 0.01 if variants == 8 else 0.35
    assert height == pytest.approx(7 + 0.3 * np.arange(1, 9), rel=near)
    assert table["target_dbh_m"] == pytest.approx(dbh)
    assert np.array(table["crown_base_m"]).min() > 0


@pytest.mark.medium
def test_a_tree_keeps_its_targets_whichever_others_stand(tmp_path):
    many, few = grown(tmp_path, 8), grown(tmp_path, 3)
    assert many.wanted == pytest.approx(few.wanted)


@pytest.mark.medium
def test_a_variant_of_which_no_tree_stands_lends_its_size_to_none():
    pine = load_species(find_species("scots-pine", Path()))
    targets = Targets(allometry="pinus-sylvestris", dbh=Normal(mean=0.1, sd=0.01))
    planting = Planting(species="scots-pine", expected=2, exact=True, variants=1, targets=targets)
    scene = Scene(seed=4, forest=Forest(size=(20, 20)), plantings=(planting, planting))
    plan = ForestPlan.of(scene, [pine, pine])
    trees = dict(plan.grow().variants)
    assert sorted(trees) == [(0, 0), (1, 0)]
    thick = grow(*pine, stream(9, "thick"), Wanted(0.3, 18.0, 5.0, 9.0, 60.0))
    assert np.array_equal(plan.placed(trees | {(0, 1): thick}).scale, plan.placed(trees).scale)


def test_what_no_allometry_tells_must_be_given():
    targets = Targets(dbh=Normal(mean=0.1), height=8.0, crown_width=2.0, crown_base=3.0)
    planting = Planting(species="ginkgo", expected=2, exact=True, targets=targets)
    scene = Scene(forest=Forest(size=(20, 20)), plantings=(planting,))
    species = load_species(find_species("ginkgo", Path()))
    with pytest.raises(SpecError, match="leaf_area is not given"):
        grow_forest(scene, [species])


@pytest.mark.slow
def test_sizes_in_a_stand_are_one_joint_law():
    """Spruces too far apart to compete: each size follows its diameter as the law says, and what is left
    of it no diameter, but the other sizes as residuals are correlated.

    Of 2,500 trees each of ten correlations is off by 4.5 standard errors with a chance of 7e-6.
    """
    name, law = "norway-spruce", read_allometry("picea-abies", FOLDER)
    rows = Rows(row_spacing=30, tree_spacing=30)
    targets = Targets(dbh=Normal(mean=0.3, sd=0.07), allometry="picea-abies")
    planting = Planting(species=name, layout="rows", rows=rows, targets=targets)
    inputs = Inputs(allometries={"picea-abies": law})
    stand = plan_stand(7, Forest(size=(1500, 1500)), [planting], inputs)
    species = [load_species(find_species(name, Path()))]
    trees = with_targets(7, stand, [planting], [name], species, inputs).trees
    left = np.column_stack([trees[:, 0], scores(law, trees[:, 0], trees[:, 1:])])
    found = np.corrcoef(left.T)[np.triu_indices(5, 1)]
    assert len(trees) > 2400
    expected = [0, 0, 0, 0, *law.correlation]
    assert np.abs(found - expected).max() < 4.5 / np.sqrt(len(trees))


def test_a_size_is_found_at_which_a_stem_has_its_diameter():
    """A cone of 10 m, 0.3 m thick at the foot: s·0.3·(1 - 1.3/(10 s)) = D."""
    z = np.zeros((1, 3))
    cone = Skeleton(
        z, np.array([[0, 0, 10.0]]), np.array([[0.15, 0.0]]), np.array([-1]), *np.zeros((2, 1), int)
    )
    wanted = np.array([0.2, 0.3, 0.5])
    scale = scales_for(cone, wanted)
    assert scale == pytest.approx((wanted + 0.3 * 0.13) / 0.3, rel=1e-9)
    assert dbh_at(cone, scale) == pytest.approx(wanted, rel=1e-9)


def test_like_trees_share_a_variant():
    rng = stream(1, "like")
    slim = np.column_stack(
        [np.full(40, 0.2), np.full(40, 22.0), *np.tile([3.0, 9.0, 30.0], (40, 1)).T]
    )
    stout = slim * [1, 0.5, 2, 0.4, 1]
    wanted = np.concatenate([slim, stout]) * np.exp(0.01 * rng.standard_normal((80, 5)))
    group, models = groups_of(wanted, 2, None, stream(2, "like"))
    assert len(models) == 2
    assert len(set(group[:40])) == len(set(group[40:])) == 1
    assert group[0] != group[40]
