"""Whole trees: the truth that grows with them is what is measured on their triangles. Trees of a planting
at other ages and in other seasons.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.tree import SUNK, fallen, grow, in_season, with_fallen
from forest_addon.growth.truth import wood_of_tree
from forest_addon.site import ForestSite
from forest_addon.spec import Detail, Forest, Grammar, Leaf, Planting, Scene, Species
from forest_addon.stand import forest as room
from forest_addon.stand.forest import TreesBeforeFall, tree_table


@pytest.mark.slow
@pytest.mark.parametrize("name", ["maple", "spruce"])
def test_grafted_truth_is_what_the_mesh_measures(name):
    species, template = load_species(find_species(name, Path()))
    tree = grow(species, template, stream(3, "tree", name, 0))
    measured = measure_leaves(tree.mesh)
    assert len(tree.leaves) == len(measured)
    for column in ("centre", "length", "width", "radius"):
        np.testing.assert_allclose(
            getattr(tree.leaves, column), getattr(measured, column), atol=1e-12
        )
    np.testing.assert_allclose(tree.leaves.normal, measured.normal, atol=1e-11)
    along = np.einsum("li,li->l", tree.leaves.axis, measured.axis)
    np.testing.assert_allclose(np.abs(along), 1, atol=1e-9)  # which end is the tip is not measured
    assert (np.diff(tree.leaves.branch) >= 0).all()


def test_a_species_without_a_template_grows_whole():
    species = Species(name="plain", grammar=Grammar(generations=4, radius=0.08))
    tree = grow(species, None, stream(3, "tree", "plain", 0))
    assert not tree.grafted
    assert tree.mesh.uv is not None
    assert tree.mesh.vertices[:, 2].min() == pytest.approx(-SUNK, abs=0.01)
    again = grow(species, None, stream(3, "tree", "plain", 0))
    assert np.array_equal(tree.mesh.vertices, again.mesh.vertices)
    bare = grow(replace(species, leaf=Leaf(on=False)), None, stream(3, "tree", "plain", 0))
    assert np.array_equal(bare.mesh.vertices, tree.mesh.vertices[: len(bare.mesh.vertices)])
    coarse = grow(
        replace(species, detail=Detail(tolerance=0.02)), None, stream(3, "tree", "plain", 0)
    )
    assert np.sum(coarse.mesh.part == WOOD) < 0.8 * np.sum(tree.mesh.part == WOOD)


def test_fewer_leaves_keep_their_area_and_move_no_branch():
    species, _ = load_species(find_species("honda-birch", Path()))
    few = replace(species, detail=Detail(leaves=0.2))
    whole, thinned = (grow(s, None, stream(3, "tree", "birch", 0)) for s in (species, few))
    assert len(thinned.leaves) == pytest.approx(0.2 * len(whole.leaves), abs=1)
    areas = [(tree.leaves.radius**2).sum() for tree in (thinned, whole)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-9)
    assert np.array_equal(thinned.skeleton.end, whole.skeleton.end)
    measured = measure_leaves(thinned.mesh)
    np.testing.assert_allclose(thinned.leaves.radius, measured.radius, rtol=1e-6)


def grown(**given):
    planting = Planting(**({"expected": 4, "exact": True, "variants": 2, "scale": (1, 1)} | given))
    return ForestSite.read(
        Scene(seed=2, forest=Forest(size=(30, 30)), plantings=(planting,))
    ).grow()


@pytest.mark.medium
@pytest.mark.parametrize("species", ["hazelnut", "honda-birch", "abop-monopodial-a", "ginkgo"])
def test_trees_are_smaller_the_younger_they_are(species):
    heights = [grown(species=species, age=age).heights().mean() for age in (0.25, 0.5, 1.0, 2.0)]
    assert (np.diff(heights) > 0).all(), heights
    assert grown(species=species).heights().mean() == heights[2]


@pytest.mark.slow
def test_trees_grown_to_measure_have_diameters_in_proportion_to_age():
    """Their heights are as their kind was measured: more than half of them at half the diameter."""
    old, young = (tree_table(grown(species="silver-birch", age=age)) for age in (1.0, 0.5))
    assert np.array(young["dbh_m"]) == pytest.approx(np.array(old["dbh_m"]) / 2, rel=1e-9)
    ratio = np.array(young["height_m"]) / np.array(old["height_m"])
    assert 0.5 < ratio.mean() < 0.9


@pytest.fixture(scope="module")
def tree():
    species, kind = load_species(find_species("hazelnut", Path()))
    return grow(species, kind, stream(1, "season"))


def test_leaves_fall_the_same_ones_first_and_those_left_are_as_they_were(tree):
    """The share is that of a binomial: off by 4.5 deviations with a chance of 7e-6."""
    count, before = len(tree.leaves), None
    for share in (0.2, 0.5, 0.9):
        left = with_fallen(tree, share, stream(1, "fall"))
        off = abs(len(left.leaves) - (1 - share) * count)
        assert off < 4.5 * np.sqrt(count * share * (1 - share))
        found = set(map(tuple, left.leaves.centre.tolist()))
        assert found <= set(map(tuple, tree.leaves.centre.tolist()))
        assert before is None or found < before
        before = found
        again = measure_leaves(left.mesh)  # mesh and truth say the same
        assert again.centre == pytest.approx(left.leaves.centre, abs=1e-9)
        assert again.radius == pytest.approx(left.leaves.radius, rel=1e-9)
        wood = left.mesh.select(left.mesh.part != LEAF)
        assert len(wood.triangles) == (tree.mesh.part != LEAF).sum()
    assert len(with_fallen(tree, 1.0, stream(1, "fall")).leaves) == 0
    assert with_fallen(tree, 0.0, stream(1, "fall")) is tree


def test_seasons_turn_colours_then_take_leaves():
    species, _ = load_species(find_species("hazelnut", Path()))
    colours = [in_season(species, season).look.autumn for season in (0, 0.25, 0.5, 1)]
    assert colours == [species.look.autumn, 0.5, 1, 1]
    assert [fallen(season) for season in (0, 0.5, 0.75, 1)] == [0, 0, 0.5, 1]
    summer, late, bare = (grown(species="hazelnut", season=s) for s in (0.0, 0.75, 1.0))
    many = [sum(len(t.leaves) for t in f.variants.values()) for f in (summer, late, bare)]
    assert many[2] == 0
    assert many[1] / many[0] == pytest.approx(0.5, abs=0.05)
    assert (summer.stand.position == bare.stand.position).all()


@pytest.mark.slow
@pytest.mark.parametrize("species", ["hazelnut", "silver-birch"])  # of templates, and to measure
def test_kept_trees_are_those_that_would_grow_and_a_season_grows_none(species, monkeypatch):
    def asked(season, age=0.3):
        given = {"species": species, "season": season, "age": age}
        planting = Planting(**given, expected=2, exact=True, variants=1)
        field = Forest(size=(30, 30))
        return ForestSite.read(Scene(seed=2, forest=field, plantings=(planting,)))

    kept, grew = TreesBeforeFall(), []
    monkeypatch.setattr(room, "grow", lambda *args, **named: grew.append(1) or grow(*args, **named))
    for season, growing in ((0.0, True), (0.8, False), (1.0, False), (0.3, False)):
        grew.clear()
        forest = asked(season).grow(kept=kept)
        kept.forget_others()
        assert bool(grew) == growing
        other = asked(season).grow()
        assert (forest.stand.scale == other.stand.scale).all()
        for key, tree in other.variants.items():
            mine = forest.variants[key]
            for name in ("vertices", "triangles", "leaf"):
                assert (getattr(mine.mesh, name) == getattr(tree.mesh, name)).all()
            assert wood_of_tree(mine) == wood_of_tree(tree)
    grew.clear()
    asked(0.3, age=0.25).grow(kept=kept)
    assert grew  # another age is other trees
