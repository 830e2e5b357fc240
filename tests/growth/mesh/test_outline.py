"""Outlines of trees: few triangles that stand where the tree stands and are about as wide."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, OTHER, WOOD, TriMesh
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.mesh.outline import BANDS, SIDES, outline
from forest_addon.growth.tree import grow


@pytest.mark.slow
@pytest.mark.parametrize("species", ["maple", "honda-conifer", "apple-leafless"])
def test_an_outline_has_the_size_of_its_tree(species):
    mesh = grow(*load_species(find_species(species, Path())), stream(2, "outline")).mesh
    rough = outline(mesh)
    assert len(rough.triangles) <= 2 * BANDS * SIDES
    assert np.isfinite(rough.vertices).all()
    assert rough.vertices[:, 2].min() == 0
    assert rough.vertices[:, 2].max() == pytest.approx(mesh.vertices[:, 2].max())
    wide, true = np.ptp(rough.vertices[:, :2], axis=0), np.ptp(mesh.vertices[:, :2], axis=0)
    # A corner stands for a sector: what is half a sector away from it may reach less far along an axis.
    assert (wide < true / np.cos(np.pi / SIDES)).all()
    assert (wide > 0.4 * true).all()
    leafy = (mesh.part == LEAF).any()
    assert (rough.part == LEAF).any() == leafy
    assert ((rough.material == 1) == (rough.part == LEAF)).all()


def test_a_pole_is_its_own_outline():
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    ring = np.column_stack([0.2 * np.cos(angle) + 3, 0.2 * np.sin(angle) - 1])
    heights = np.linspace(0, 6, 13)
    vertices = np.concatenate([np.column_stack([ring, np.full(48, z)]) for z in heights])
    corner = np.arange(48 * 12)
    rough = outline(
        TriMesh.of_part(vertices, np.column_stack([corner, corner + 1, corner + 48]), WOOD)
    )
    radius = np.linalg.norm(rough.vertices[:-1, :2] - [3, -1], axis=1)
    assert np.abs(radius - 0.2).max() < 0.01
    assert (rough.part == WOOD).all()


@pytest.mark.parametrize(
    "vertices", [np.empty((0, 3)), np.zeros((3, 3)), np.array([[0, 0, -1], [1, 0, -1], [0, 1, -2]])]
)
def test_what_does_not_stand_up_has_no_outline(vertices):
    triangles = np.array([[0, 1, 2]]) if len(vertices) else np.empty((0, 3))
    assert len(outline(TriMesh.of_part(vertices, triangles, OTHER)).triangles) == 0
