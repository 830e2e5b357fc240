"""Branches with collars: thicker at their mother's surface, and otherwise the tree that it was."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.measured.collars import collared
from forest_addon.growth.measured.measure import dbh_of
from forest_addon.growth.measured.meet import grow_measured
from forest_addon.growth.measured.wanted import Wanted
from forest_addon.growth.skeleton import LeafSites, Skeleton
from forest_addon.growth.solid import volume_of
from forest_addon.growth.tree import blade_of

BRANCH = Skeleton(
    start=np.array([[0, 0, 0], [0, 0, 2], [0, 0, 2], [1, 0, 2.0]]),
    end=np.array([[0, 0, 2], [0, 0, 3], [1, 0, 2], [1.5, 0, 2.0]]),
    radius=np.array([[0.1, 0.1], [0.1, 0.1], [0.04, 0.04], [0.04, 0.02]]),
    parent=np.array([-1, 0, 0, 2]),
    order=np.array([0, 0, 1, 1]),
    generation=np.array([0, 1, 1, 2]),
)


def test_a_collar_is_as_thick_as_asked_at_the_mothers_surface():
    wood, _ = collared(BRANCH, LeafSites.none(), 0.5)
    assert wood.parent.tolist() == [-1, 0, 0, 2, 3]
    assert wood.generation.tolist() == [0, 1, 1, 2, 3]
    assert wood.order.tolist() == [0, 0, 1, 1, 1]
    assert wood.end[2] == pytest.approx(
        [0.18, 0, 2]
    )  # the mother's radius and a diameter of its own
    assert wood.start[3] == pytest.approx(wood.end[2])
    share = 0.1 / 0.18
    r1, r2 = wood.radius[2]
    assert r1 + share * (r2 - r1) == pytest.approx(1.5 * 0.04)
    assert wood.radius[3:].tolist() == [[0.04, 0.04], [0.04, 0.02]]


def test_none_is_the_same_tree():
    wood, _ = collared(BRANCH, LeafSites.none(), 0.0)
    assert wood is BRANCH


def test_a_measured_tree_keeps_its_measures_and_leaves():
    species, kind = load_species(find_species("silver-birch", Path()))
    wanted, blade = Wanted(0.25, 18.0, 5.0, 6.0, 60.0), blade_of(species, kind.blade)
    trees = {
        c: grow_measured(
            species.changed(crown=species.crown.changed(collar=c)), wanted, blade, stream(1, "c")
        )
        for c in (0.0, 0.4)
    }
    plain, tree = trees[0.0], trees[0.4]
    more = len(tree.skeleton) - len(plain.skeleton)
    assert 10 < more < 0.05 * len(plain.skeleton)
    assert dbh_of(tree.skeleton) == pytest.approx(0.25, abs=1e-9)
    for field in fields(LeafSites):
        if field.name != "segment":
            assert np.array_equal(getattr(tree.sites, field.name), getattr(plain.sites, field.name))
    borne = tree.skeleton.end[tree.sites.segment]
    assert np.array_equal(borne, plain.skeleton.end[plain.sites.segment])
    assert (tree.skeleton.parent < np.arange(len(tree.skeleton))).all()
    deep = tree.skeleton.generation[tree.skeleton.parent[1:]]
    assert np.array_equal(tree.skeleton.generation[1:], deep + 1)
    assert 1 < volume_of(tree.skeleton) / volume_of(plain.skeleton) < 1.03
