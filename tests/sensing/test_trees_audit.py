"""Audits of what grew: silent on the shipped species, loud on thin tubes, lost branches, moved leaves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.echoes import square_leaves
from references.rays import BruteCaster, scene_with

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD, TriMesh
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.leaves import separate_leaves
from forest_addon.growth.tree import grow
from forest_addon.sensing.audit import Audit, Check, held
from forest_addon.sensing.canopy import OUTSIDE, REACH, SKY, hemisphere, look_up
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.trees_audit import (
    _to_triangles,
    audit_trees,
    part_of_leaves,
    part_of_tubes,
    points_on_cones,
)
from forest_addon.spec import Normal, Planting, Scene, Targets
from forest_addon.stand.forest import grow_forest

RNG = stream(1, "audit test")
POINTS = 24
SEEDLING = Targets(dbh=Normal(mean=0.03), height=3.0, leaf_area=1.0)


@pytest.fixture
def points(monkeypatch):
    """An audit of branches by so many points."""
    monkeypatch.setattr("forest_addon.sensing.trees_audit.LEAST", POINTS)

    def audit(*trees):
        rng = stream(2, "audit points")
        return held([part_of_tubes(trees, rng)], rng, 1.0)

    return audit


def grown(name):
    species, template = load_species(find_species(name, Path()))
    return grow(species, template, stream(2, "audit tree")), species.detail.tolerance


@pytest.fixture(scope="module")
def birch():
    return grown("honda-birch")


@pytest.mark.medium
@pytest.mark.parametrize("name", ["honda-willow", "abop-ternary-a"])
def test_the_tubes_of_species_are_within_their_tolerance(name, points):
    found = points(grown(name))
    assert found.kept, str(found)
    assert found.error > 0
    assert found.checked == POINTS


@pytest.mark.medium
def test_a_branch_that_is_thin_or_lost_is_found(birch, points):
    """Half of the wood is lost: that none of 24 points lies there has a chance of 6e-8."""
    tree, allowed = birch
    thick = replace(tree, skeleton=replace(tree.skeleton, radius=tree.skeleton.radius * 1.2))
    assert not points((thick, allowed)).kept
    wood = np.flatnonzero(tree.mesh.part == WOOD)
    lost = tree.mesh.select(~np.isin(np.arange(len(tree.mesh.part)), wood[len(wood) // 2 :]))
    assert not points((replace(tree, mesh=lost), allowed)).kept


def test_points_are_on_cones_above_the_ground(birch):
    wood = birch[0].skeleton
    points = points_on_cones(wood, 50, RNG)
    assert (points[:, 2] > 0).all()
    span = wood.end - wood.start
    for point in points:  # of some segment: as far off its axis as it is thick there
        along = np.einsum("si,si->s", point - wood.start, span) / np.einsum("si,si->s", span, span)
        foot = wood.start + along[:, None] * span
        thick = wood.radius[:, 0] + along * np.diff(wood.radius, axis=1)[:, 0]
        off = np.abs(np.linalg.norm(point - foot, axis=1) - thick)
        assert off[(along >= 0) & (along <= 1)].min() < 1e-12


def test_metres_to_a_triangle():
    """Against many points of the triangle; one has no area."""
    corners = RNG.normal(size=(20, 3, 3))
    corners[0, 2] = corners[0, 1]
    share = RNG.dirichlet([0.6, 0.6, 0.6], 40_000)
    share[:3] = np.eye(3)
    for point in RNG.normal(size=(5, 3)) * 2:
        found = _to_triangles(point, corners)
        brute = [np.linalg.norm(share @ one - point, axis=1).min() for one in corners]
        assert (found <= np.array(brute) + 1e-12).all()
        assert np.allclose(found, brute, atol=0.03)


@pytest.mark.medium
@pytest.mark.parametrize("name", ["fern", "scots-pine"])
def test_curved_leaves_and_shoots_are_where_their_truth_says(name):
    """As they come out of Blender: in single precision, and numbered anew where they are in pieces."""
    species, kind = load_species(find_species(name, Path()))
    settings = Scene(plantings=(Planting(species=name, variants=1, expected=1, exact=True),))
    small = species.changed(targets=SEEDLING) if species.needles else species
    forest = grow_forest(settings, [(small, kind)])
    mesh = forest.variant_of(0).mesh
    single = replace(mesh, vertices=mesh.vertices.astype(np.float32).astype(np.float64))
    none = np.zeros(1, np.int64)
    meshes = (separate_leaves(single),)
    scene = SceneGeometry(meshes, forest.transforms(), none, ("a",), forest.stand.id, none)
    found = held([part_of_leaves(forest, scene, 1.0)], RNG, 1.0)
    assert found.kept
    assert found.checked == 1


def test_leaves_are_where_their_truth_says():
    bush = Planting(species="hazelnut", variants=1, expected=2, exact=True)
    settings = Scene(plantings=(bush,))
    forest = grow_forest(settings, [load_species(find_species("hazelnut", Path()))])
    tree = forest.variant_of(0)
    single = tree.mesh.vertices.astype(np.float32).astype(np.float64)
    mesh = replace(tree.mesh, vertices=single)
    none = np.zeros(2, np.int64)
    scene = SceneGeometry((mesh,), forest.transforms(), none, ("a", "b"), forest.stand.id, none)
    found = audit_trees(forest, scene, RNG, 1.0, 0.1)
    assert list(found) == ["leaves"]  # branches come from a template
    assert found["leaves"].kept
    assert found["leaves"].checked == 1
    moved = replace(scene, meshes=(replace(mesh, vertices=single + np.array([0, 0, 1e-3])),))
    assert not held([part_of_leaves(forest, moved, 0.1)], RNG, 1.0).kept
    fewer = replace(scene, meshes=(mesh.select(mesh.leaf != 0),))
    assert held([part_of_leaves(forest, fewer, 0.1)], RNG, 1.0).error == np.inf


def test_an_audit_reads_as_people_write_numbers():
    check = Check.on("rays", np.zeros(3), 30, 1e-9, "m")
    assert "(10 % of 30; sees errors in 63 %), 0 m off at most" in str(Audit((check,), 1.0, 1234.0))
    said = {1234.0: "1,230", 1.2e7: "12,000,000", 56.54: "56.5", 2.0: "2"}
    for times, words in said.items():
        assert f"; about {words} times as fast" in str(Audit((check,), 1.0, times))


# -------------------------------------------------------------------------------------------- canopy
# Hemispherical pictures of canopies whose gap fraction is known.


def slab(index, rng, size=0.4, half=7.0):
    """Square leaves at random from 1 to 1.5 m up, facing all ways: P = exp(-L/(2 cos θ))."""
    count = round(index * (2 * half) ** 2 / size**2)
    centre = np.column_stack([rng.uniform(-half, half, (count, 2)), rng.uniform(1.0, 1.5, count)])
    return scene_with(square_leaves(centre, rng.standard_normal((count, 3)), size))


@pytest.mark.slow
def test_leaves_at_random_have_the_index_that_they_have():
    """L = 0.8, spherical, from 40 points; a ring's gap is that of about as many leaves, 0.48/√40 = 0.08."""
    points = np.column_stack([stream(1, "at").uniform(-3, 3, (40, 2)), np.zeros(40)])
    seen = look_up(BruteCaster(slab(0.8, stream(1, "slab"))), points, stream(1, "rays"), 6, 12)
    expected = np.exp(-0.4 / np.cos(seen.zenith))
    assert seen.gap[:4] == pytest.approx(expected[:4], abs=0.16)
    assert seen.effective == pytest.approx(0.8, rel=0.2)
    assert 0 < seen.open < 1
    assert seen.rays == 40 * 6 * 12
    assert seen.zenith[-1] < REACH


def test_an_open_sky_has_no_leaves():
    seen = look_up(
        BruteCaster(slab(0.0, stream(2, "slab"))), np.zeros((1, 3)), stream(2, "rays"), 4, 8
    )
    assert (seen.gap == 1).all()
    assert seen.effective == 0
    assert seen.open == 1


def test_a_hemispherical_picture_shows_a_ceiling_where_it_is():
    """A square at height 1 from x 0 to 2 and y 0 to 1, east and north of the point: tan z (cos a, sin a)."""
    corners = np.array([[0, 0, 1], [2, 0, 1], [2, 1, 1], [0, 1, 1.0]])
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), LEAF)
    seen = hemisphere(BruteCaster(scene_with(mesh)), np.zeros(3), 40)
    row, column = np.indices((40, 40))
    east, north = 1 - (column + 0.5) / 20, 1 - (row + 0.5) / 20  # the head lies north: east is left
    away = np.hypot(east, north)
    reach = np.tan(np.minimum(away, 0.999) * np.pi / 2) / away
    x, y = east * reach, north * reach
    covered = (x > 0) & (x < 2) & (y > 0) & (y < 1) & (away < 1)
    assert np.array_equal(seen == LEAF, covered)
    assert np.array_equal(seen == OUTSIDE, away > 1)
    assert np.array_equal(seen == SKY, (away <= 1) & ~covered)
