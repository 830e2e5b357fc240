"""Trees that are to measure something measure it, however they grow. Trees of template parts meet their
targets too, and stay trees: leaves whole, stems as thick as said.
"""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import WOOD
from forest_addon.growth.library import complete_species, find_species, load_species
from forest_addon.growth.measured.allometry import Wanted, crown_base_of, dbh_of, width_of
from forest_addon.growth.measured.crown import borne, colonise
from forest_addon.growth.measured.meet import grow_measured, leaves_needed
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.tree import blade_of, grow
from forest_addon.growth.truth import tree_truth
from forest_addon.spec import Crown, Honda, Leaf, Normal, Siblings, SpecError, Species, Targets

SMALL = Wanted(0.12, 9.0, 2.6, 3.0, 12.0)
WANTED = Wanted(0.2, 12.0, 5.0, 3.0, 60.0)


def species_of(name):
    return load_species(find_species(name, Path()))


@pytest.mark.medium
@pytest.mark.parametrize("name", ["scots-pine", "silver-birch", "honda-birch", "ginkgo", "apple"])
def test_a_tree_measures_what_it_is_to(name):
    """Diameter to a tenth of a millimetre, height and base to a few centimetres, leaf area exactly."""
    species, template = species_of(name)
    tree = grow(species, template, stream(1, "meet", name), SMALL)
    truth = tree_truth(tree)
    assert truth["dbh_m"] == pytest.approx(SMALL.dbh, abs=1e-4)
    assert truth["height_m"] == pytest.approx(SMALL.height, abs=0.12)
    assert truth["crown_width_m"] == pytest.approx(SMALL.crown_width, rel=0.04)
    assert truth["leaf_area_m2"] == pytest.approx(SMALL.leaf_area, rel=1e-6)
    if name in ("scots-pine", "silver-birch"):
        assert truth["crown_base_m"] == pytest.approx(SMALL.crown_base, abs=0.02)
    assert tree.wanted == SMALL


@pytest.mark.medium
def test_a_seedling_whose_leaves_alone_pass_breast_height_has_its_diameter():
    """A spruce of 1.5 m: its stem used to end at 1.297 m, below the top shoot."""
    species, kind = species_of("norway-spruce")
    small = Wanted(0.023108107160540136, 1.49987968, 1.45672797, 0.32682055, 3.60500059)
    skeleton, sites, _ = grow_measured(
        species, small, blade_of(species, kind.blade), stream(0, "check", "norway-spruce", 275)
    )
    assert dbh_of(skeleton) == pytest.approx(small.dbh, abs=1e-6)
    tips = sites.foot + sites.length[:, None] * sites.direction
    assert max(skeleton.end[:, 2].max(), tips[:, 2].max()) == pytest.approx(1.5, abs=0.01)


@pytest.mark.medium
def test_a_few_shoots_do_not_draw_the_wood_out():
    """A young pine of nine shoots about its stem: its wood used to be 30 m wide in a crown of 1 m."""
    species, kind = species_of("ponderosa-pine")
    small = Wanted(0.045, 5.1, 1.06, 2.4, 1.1)
    for number in range(3):
        skeleton, _sites, _ = grow_measured(
            species, small, blade_of(species, kind.blade), stream(number, "check", "young")
        )
        assert np.hypot(*skeleton.end[:, :2].T).max() < small.crown_width


def test_the_mesh_of_a_stem_is_as_thick_as_its_skeleton():
    """A ring has the circle's perimeter: the cut of the mesh at 1.3 m is π·DBH around, to 1 mm of DBH."""
    species, template = species_of("scots-pine")
    tree = grow(species, template, stream(2, "meet"), SMALL)
    corner = tree.mesh.vertices[tree.mesh.triangles[tree.mesh.part == WOOD]]
    above = corner[:, :, 2] > 1.3
    corner = corner[above.any(axis=1) & ~above.all(axis=1)]
    around = 0.0
    for face in corner:
        low, high = face[face[:, 2] <= 1.3], face[face[:, 2] > 1.3]
        ends = [a + (1.3 - a[2]) / (b[2] - a[2]) * (b - a) for a in low for b in high]
        around += np.linalg.norm(ends[0] - ends[1])
    assert around / np.pi == pytest.approx(SMALL.dbh, abs=1e-3)


def test_pipes_add_up():
    """With n = 2 and no taper of its own a fork keeps its cross section."""
    parent = np.array([-1, 0, 0, 1, 1, 2])
    assert borne(parent, np.array([0, 0, 0, 2, 3, 5])).tolist() == [10, 5, 5, 2, 3, 5]


def test_a_crown_fills_its_envelope():
    crown = Crown(leader=1.0, widest=0.1, top=1.0)
    nodes = colonise(crown, 10.0, 2.0, 4.0, stream(3, "crown"))
    assert (nodes.parent[1:] < np.arange(1, len(nodes.parent))).all()
    away = np.hypot(*nodes.place[:, :2].T)
    assert 1.5 < away.max() < 2.3
    top = nodes.place[:, 2] > 8.0
    assert away[top].max() < 0.9  # a cone is narrow there
    assert nodes.place[~nodes.trunk, 2].min() > 1.5


def test_measures_of_a_known_thing():
    angle = np.linspace(0, 2 * np.pi, 3000)
    ring = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle)])
    assert width_of(ring) == pytest.approx(4.0, rel=1e-4)
    inner = np.concatenate([ring, stream(4, "in").normal(0, 0.3, (5000, 2))])
    assert width_of(inner) == pytest.approx(4.0, rel=1e-4)
    species, template = species_of("honda-conifer")
    tree = grow(species, template, stream(4, "tree"))
    assert dbh_of(tree.skeleton) > 0
    assert crown_base_of(tree.skeleton, np.arange(len(tree.skeleton))) >= 0


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"height": 6.0, "crown_width": 14.0}, "2.3 times the height"),
        ({"height": 50.0, "dbh": Normal(mean=0.05)}, "1e\\+03 times the dbh"),
        ({"dbh": Normal(mean=0.02), "leaf_area": 500.0}, "times what 95 %"),
        ({"dbh": Normal(mean=0.1), "height": 1.0}, "does not reach 1.3 m"),
    ],
)
def test_targets_that_contradict_each_other_are_refused(said, words):
    species, template = species_of("scots-pine")
    targets = Targets(allometry="pinus-sylvestris", **said)
    with pytest.raises(SpecError, match=words):
        grow(species.changed(targets=targets), template, stream(5, "no"))


def test_a_base_above_the_top_is_refused_at_once():
    with pytest.raises(SpecError, match="is not below the height"):
        Targets(height=5.0, crown_base=6.0)


def test_a_hundred_million_leaves_are_refused_by_number():
    leaf = Leaf(length=Normal(mean=0.001), width_ratio=Normal(mean=0.5))
    species = Species(name="moss", honda=Honda(), leaf=leaf)
    with pytest.raises(SpecError, match=r"1\.0e\+08|1e\+08"):
        leaves_needed(species, blade_of(species, None), 40.0)


def grown(name, wanted, siblings=False):
    species, template = load_species(find_species(name, Path()))
    if siblings:
        species = species.changed(siblings=Siblings())
        species, template = complete_species(species, ASSETS / "species", name)
    return grow(species, template, stream(1, "reshape", name), wanted)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "siblings"),
    [("maple", False), ("hazelnut", False), ("spruce", False), ("maple", True)],
)
def test_all_five_are_met(name, siblings):
    tree = grown(name, WANTED, siblings)
    truth = tree_truth(tree)
    assert truth["dbh_m"] == pytest.approx(WANTED.dbh, abs=1e-6)
    assert truth["height_m"] == pytest.approx(WANTED.height, rel=2e-3)
    assert truth["crown_width_m"] == pytest.approx(WANTED.crown_width, rel=2e-3)
    assert truth["crown_base_m"] == pytest.approx(WANTED.crown_base, rel=2e-3)
    assert truth["leaf_area_m2"] == pytest.approx(WANTED.leaf_area, rel=1e-9)
    assert tree.missed == ()


@pytest.mark.medium
def test_leaves_keep_their_size_and_their_truth_is_that_of_the_mesh():
    plain, tree = grown("hazelnut", None), grown("hazelnut", WANTED)
    assert len(tree.leaves) > 3 * len(plain.leaves)  # more leaves, not larger ones
    assert tree.leaves.radius.mean() == pytest.approx(plain.leaves.radius.mean(), rel=0.02)
    measured = measure_leaves(tree.mesh)
    assert np.abs(measured.centre - tree.leaves.centre).max() < 1e-12
    assert np.abs(measured.radius / tree.leaves.radius - 1).max() < 1e-12
    facing = np.einsum("li,li->l", measured.normal, tree.leaves.normal)
    assert np.abs(facing).min() > 1 - 1e-9
    counts = np.bincount(tree.mesh.leaf[tree.mesh.leaf >= 0])
    assert set(counts) <= set(np.bincount(plain.mesh.leaf[plain.mesh.leaf >= 0]))


@pytest.mark.medium
def test_the_mesh_of_the_stem_has_the_diameter():
    """The cut of the wood at 1.3 m, below all branches: its widest extent is the DBH."""
    tree = grown("maple", WANTED)
    edges = tree.mesh.triangles[tree.mesh.part == WOOD][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    a, b = tree.mesh.vertices[edges[:, 0]], tree.mesh.vertices[edges[:, 1]]
    crosses = (a[:, 2] - 1.3) * (b[:, 2] - 1.3) < 0
    a, b = a[crosses], b[crosses]
    cut = (a + ((1.3 - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None] * (b - a))[:, :2]
    across = np.ptp(cut, axis=0)
    assert np.abs(across / WANTED.dbh - 1).max() < 0.03


@pytest.mark.medium
def test_what_no_stretching_reaches_is_named():
    tree = grown("hazelnut", Wanted(0.9, 30.0, 1.0, 27.0, 5.0))
    assert any("crown_width cannot be met" in sentence for sentence in tree.missed)
    assert tree_truth(tree)["leaf_area_m2"] == pytest.approx(5.0, rel=1e-9)


def test_too_many_leaves_are_refused_by_number():
    with pytest.raises(SpecError, match="leaves, more than 5,000,000"):
        grown("hazelnut", Wanted(0.9, 30.0, 12.0, 5.0, 1e6))
