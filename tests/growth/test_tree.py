"""Whole trees: the truth that grows with them is what is measured on their triangles."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.formats.species_file import find_species, load_species
from forest_addon.growth.leaves import measure_leaves
from forest_addon.growth.tree import grow
from forest_addon.rng import stream


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
