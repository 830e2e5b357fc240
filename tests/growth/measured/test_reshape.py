"""Trees of template parts meet their targets too, and stay trees: leaves whole, stems as thick as said."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import WOOD
from forest_addon.growth.library.species_file import (
    ASSETS,
    complete_species,
    find_species,
    load_species,
)
from forest_addon.growth.measured.wanted import Wanted
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.tree import grow
from forest_addon.growth.truth import tree_truth
from forest_addon.spec import Siblings, SpecError

WANTED = Wanted(0.2, 12.0, 5.0, 3.0, 60.0)


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
