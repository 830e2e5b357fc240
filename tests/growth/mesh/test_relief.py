"""Bark in relief: closed, of the same area and volume, as deep and as oval as asked, and off unless asked."""

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.mesh.relief import Relief
from forest_addon.growth.skeleton import Skeleton
from forest_addon.growth.tree import grow, with_tolerance
from forest_addon.spec import Accuracy, Bark, Detail, Grammar, Planting, Scene, Species
from forest_addon.stand.forest import grow_forest

STEM = Skeleton(
    np.array([[0, 0, 0.0], [0, 0, 2]]),
    np.array([[0, 0, 2.0], [0, 0, 4]]),
    np.array([[0.2, 0.18], [0.18, 0.16]]),
    np.array([-1, 0]),
    np.array([0, 0]),
    np.array([0, 1]),
)
TEXTURES = ("cracked", "smooth", "furrowed", "plated", "peeling")


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ti,ti->", a, np.cross(b, c)) / 6)


def rings(mesh, height, within=0.004):
    """Radii and angles of vertices near a height."""
    near = mesh.vertices[np.abs(mesh.vertices[:, 2] - height) < within]
    near = near[np.hypot(near[:, 0], near[:, 1]) > 0.01]
    return np.hypot(near[:, 0], near[:, 1]), np.arctan2(near[:, 1], near[:, 0])


@pytest.mark.medium
@pytest.mark.parametrize("texture", TEXTURES)
def test_a_stem_in_relief_is_closed_and_keeps_its_volume(texture):
    relief = Relief(texture, 0.05, 0.02, 0.06, 1.0, seed=3)
    mesh = mesh_wood(STEM, 0.002, relief=relief)
    count = len(mesh.vertices)
    ahead = mesh.triangles[:, [0, 1, 2]].astype(np.int64).ravel()
    after = mesh.triangles[:, [1, 2, 0]].astype(np.int64).ravel()
    keys, times = np.unique(ahead * count + after, return_counts=True)
    assert (times == 1).all()
    assert np.array_equal(keys, np.unique(after * count + ahead))
    length = 2.0
    exact = sum(
        np.pi * length / 3 * (a * a + a * b + b * b) for a, b in ((0.2, 0.18), (0.18, 0.16))
    )
    assert volume(mesh) == pytest.approx(exact, rel=0.01)
    assert np.linalg.norm(mesh.area_vectors(), axis=1).min() > 0
    far = np.abs(
        np.hypot(*mesh.vertices[:, :2].T) - np.interp(mesh.vertices[:, 2], [0, 4], [0.2, 0.16])
    )
    on_axis = np.hypot(*mesh.vertices[:, :2].T) < 1e-9
    assert far[~on_axis].max() < relief.most(0.2)
    again = mesh_wood(STEM, 0.002, relief=relief)
    assert np.array_equal(again.vertices, mesh.vertices)


def test_ovality_is_the_spread_of_diameters():
    """The caliper widths of an oval ring: (largest - smallest) / mean, of harmonics 2 to 4."""
    mesh = mesh_wood(STEM, 0.002, relief=Relief("smooth", 0.05, 0.0, 0.08, 1.0, seed=1))
    height = mesh.vertices[len(mesh.vertices) // 2, 2]
    radius, angle = rings(mesh, height)
    turn = np.pi * np.arange(180) / 180
    points = radius[:, None] * np.exp(1j * angle[:, None])
    width = [np.ptp((points * np.exp(-1j * t)).real) for t in turn]
    assert (max(width) - min(width)) / np.mean(width) == pytest.approx(0.08, abs=0.015)


@pytest.mark.parametrize("depth", [0.01, 0.03])
def test_furrows_are_as_deep_as_asked(depth):
    relief = Relief("plated", 0.06, depth, 0.0, 1.0, seed=2)
    factor = relief.factor(128, np.full(200, 0.2), np.linspace(0, 2, 200), 2.0, axis=0)
    low, high = np.percentile(0.2 * factor, [1, 99])
    assert high - low == pytest.approx(depth, rel=0.2)
    assert np.mean(factor * np.roll(factor, 1, axis=1), axis=1) == pytest.approx(1, abs=1e-12)
    thin = relief.factor(64, np.full(200, 0.06), np.linspace(0, 2, 200), 2.0, axis=0)
    low, high = np.percentile(0.06 * thin, [1, 99])
    assert high - low == pytest.approx(depth / 2, rel=0.25)  # a thin stem has shallower ones


def test_there_is_none_unless_a_species_asks():
    plain = Species(name="plain", grammar=Grammar(generations=3, radius=0.1))
    rough = plain.changed(detail=Detail(relief=True), bark=Bark(texture="furrowed", relief=0.02))
    smooth, tree = (grow(kind, None, stream(1, "relief")) for kind in (plain, rough))
    assert smooth.relief is None
    assert np.array_equal(tree.skeleton.end, smooth.skeleton.end)
    assert np.array_equal(tree.leaves.centre, smooth.leaves.centre)
    assert len(tree.mesh.vertices) > 2 * len(smooth.mesh.vertices)
    coarse = with_tolerance(tree, 0.02)
    radius, _ = rings(coarse.mesh, 1.0, 0.02)
    assert np.ptp(radius) > 0.008  # it stays at a coarser tolerance


def test_a_scene_asks_for_relief_of_all_its_species():
    rough = Species(name="rough", grammar=Grammar(generations=3, radius=0.1))
    planting = Planting(species="rough", layout="rows", variants=1)
    forests = [
        grow_forest(Scene(plantings=(planting,), accuracy=Accuracy(relief=on)), [(rough, None)])
        for on in (False, True)
    ]
    smooth, bark = (next(iter(forest.variants.values())) for forest in forests)
    assert smooth.relief is None
    assert bark.relief is not None
    assert np.array_equal(forests[0].stand.position, forests[1].stand.position)
