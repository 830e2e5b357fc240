"""Limbs and dead branches of measured species, held to a model of a scanned beech."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import DEAD, LEAF
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.measured.wanted import Wanted
from forest_addon.growth.tree import grow
from forest_addon.growth.truth import segment_table, wood_of_tree
from forest_addon.spec import SpecError, Species

BEECH = Wanted(0.517, 22.0, 12.0, 5.5, 330.0)
PINE = Wanted(0.2, 16.5, 3.2, 9.0, 40.0)


def tree_of(name, wanted, seed=0):
    species, kind = load_species(find_species(name, Path()))
    return grow(species, kind, stream(seed, "scaffold"), wanted)


def limbs_of(skeleton):
    """First segments of living limbs of order 1, and how thick they are a diameter of the stem away."""
    parent = np.maximum(skeleton.parent, 0)
    first = np.flatnonzero((skeleton.order == 1) & (skeleton.order[parent] == 0))
    first = first[~skeleton.is_dead[first]]
    thick = []
    for row in first:
        chain = skeleton.axis(int(row))
        far = np.linalg.norm(skeleton.end[chain] - skeleton.start[row], axis=1)
        at = chain[int(np.argmax(far > 2 * skeleton.radius[skeleton.parent[row]].mean()))]
        thick.append(2 * skeleton.radius[at].mean())
    return first, np.array(thick)


@pytest.mark.slow
def test_a_beech_divides_into_as_few_limbs_as_a_scanned_one():
    # TreeQSM of a beech of 22 m (R package aRchi): 7 limbs of order 1 over 5 cm with 1,379 l, 3,897 l in all.
    for seed in range(3):
        skeleton = tree_of("european-beech", BEECH, seed).skeleton
        first, thick = limbs_of(skeleton)
        assert 7 / 1.5 <= (thick > 0.05).sum() <= 7 * 1.5
        table = segment_table(skeleton)
        litres = 1000 * np.bincount(table["order"], table["volume_m3"])
        assert litres[1] == pytest.approx(1379, rel=0.25)
        assert litres.sum() == pytest.approx(3897, rel=0.15)
        heavy = first[thick > 0.15]
        assert skeleton.start[heavy, 2].min() < 7.5  # the scanned one divides 5.5 m up


def test_a_young_beech_keeps_its_leader():
    skeleton = tree_of("european-beech", Wanted(0.06, 7.0, 2.6, 1.5, 15.0)).skeleton
    stem = skeleton.order == 0
    assert skeleton.end[stem, 2].max() > 6.0
    table = segment_table(skeleton)
    assert table["volume_m3"][stem].sum() > 0.5 * table["volume_m3"].sum()


@pytest.mark.medium
def test_conifers_stand_in_whorls():
    skeleton = tree_of("norway-spruce", Wanted(0.2, 16.0, 4.0, 5.0, 60.0)).skeleton
    first, _ = limbs_of(skeleton)
    level = np.sort(skeleton.start[first, 2])
    gap = np.diff(level)
    assert np.mean(gap < 0.05) > 0.5
    assert (gap > 0.15).sum() >= 10


def test_dead_branches_hang_below_the_crown():
    tree = tree_of("scots-pine", PINE)
    wood = tree.skeleton
    dead = wood.is_dead
    foot = np.flatnonzero(dead & (wood.order == 1) & ~dead[np.maximum(wood.parent, 0)])
    assert len(foot) > 30
    assert (wood.order[wood.parent[foot]] == 0).all()
    height = wood.start[foot, 2]
    assert height.max() < PINE.crown_base
    assert height.min() < 1.0
    upper, lower = (height > 6).sum(), (height < 3).sum()
    assert upper > 1.4 * lower  # they fall in the end
    assert not dead[wood.parent[~dead & (wood.parent >= 0)]].any()  # nothing lives on dead wood
    on_axis = wood.start[foot] - wood.start[wood.parent[foot]]
    way = wood.end[wood.parent[foot]] - wood.start[wood.parent[foot]]
    assert np.linalg.norm(np.cross(on_axis, way), axis=1).max() < 1e-6
    assert (wood.radius[dead, 1] <= wood.radius[dead, 0] + 1e-12).all()


def test_dead_wood_has_a_label_and_no_leaves_and_counts_as_wood():
    tree = tree_of("scots-pine", PINE)
    part = tree.mesh.part
    assert (part == DEAD).any()
    assert (tree.mesh.leaf[part == DEAD] == -1).all()
    high = tree.mesh.vertices[tree.mesh.triangles[part == DEAD]][:, :, 2]
    assert high.max() < PINE.crown_base + 1.0
    leaf = tree.mesh.vertices[tree.mesh.triangles[part == LEAF]][:, :, 2]
    assert leaf.min() > PINE.crown_base - 1.0
    living = tree.skeleton.some(~tree.skeleton.is_dead)
    table = segment_table(living)
    assert wood_of_tree(tree).volume > 0.97 * table["volume_m3"].sum()


def test_without_shade_nothing_has_died():
    tree = tree_of("scots-pine", Wanted(0.2, 10.0, 5.0, 0.4, 60.0))
    assert (tree.mesh.part == DEAD).sum() < 0.02 * len(tree.mesh.part)


@pytest.mark.medium
def test_every_measured_species_names_its_model():
    names = [p.stem for p in sorted(find_species("maple", Path()).parent.glob("*.toml"))]
    found = [load_species(find_species(n, Path()))[0] for n in names]
    grown = [s for s in found if s.crown is not None]
    assert grown
    assert all(s.architecture is not None and s.architecture.model for s in grown)


def test_an_architecture_needs_a_crown():
    with pytest.raises(SpecError, match="crown"):
        Species(
            name="x", architecture=load_species(find_species("scots-pine", Path()))[0].architecture
        )
