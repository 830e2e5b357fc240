"""Leaves of species: within their unit frame, alike in area from near and far, with stalk, fold and bend."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.measured.needles import shoot_of
from forest_addon.growth.mesh.blades import HALVES, SHAPES, STALK, lay, leaf_blade, truth_of
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.skeleton import LeafSites
from forest_addon.spec import Leaf, Needles

NEAR, FAR = 0.0005, 0.002


def blade(shape, tolerance=NEAR, **settings):
    return leaf_blade(Leaf(shape=shape, **settings), tolerance)


def flat_area(one):
    a, b, c = (one.vertices[one.triangles[:, k], :2] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.mark.parametrize("shape", HALVES)
@pytest.mark.parametrize("tolerance", [NEAR, FAR])
def test_a_blade_is_one_flat_piece_that_faces_up(shape, tolerance):
    one = blade(shape, tolerance, petiole=0.3)
    area = flat_area(one)
    assert area.min() > 0
    assert one.vertices[:, 0].min() == 0
    assert one.vertices[:, 0].max() == pytest.approx(1)
    edges = np.sort(np.concatenate([one.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]))
    _, times = np.unique(edges, axis=0, return_counts=True)
    assert set(times.tolist()) == {1, 2}  # no facet over another's edge twice
    mirrored = one.vertices * [1, -1, 1]
    assert {tuple(v) for v in mirrored.round(9)} == {tuple(v) for v in one.vertices.round(9) + 0.0}
    assert one.atlas.min() >= 0
    assert one.atlas.max() <= 1


@pytest.mark.parametrize("shape", HALVES)
def test_near_and_far_have_the_same_area(shape):
    near, far = blade(shape, NEAR, petiole=0.3), blade(shape, FAR, petiole=0.3)
    assert far.share == pytest.approx(near.share, rel=1e-12)
    assert len(far.triangles) < len(near.triangles) / 2
    assert len(far.triangles) <= 15


def test_a_stalk_is_its_share_of_the_leaf_and_thin():
    bare, stalked = blade("beech"), blade("beech", petiole=0.5)
    assert stalked.share == pytest.approx(bare.share / 1.5 + STALK / 3, rel=1e-3)
    low = stalked.vertices[stalked.vertices[:, 0] < 0.3]
    assert np.abs(low[:, 1]).max() == pytest.approx(STALK)


def test_a_leaf_bends_down_by_its_curl_and_folds_up_along_its_midrib():
    flat, bent = blade("beech"), blade("beech", curl_deg=40.0)
    assert flat.vertices[:, 2].min() == 0
    edge = np.abs(flat.vertices[:, 1]).argmax()
    assert flat.vertices[edge, 2] > 0
    tip = bent.vertices[bent.vertices[:, 0].argmax()]
    chord = np.arctan2(-tip[2], tip[0])
    assert np.rad2deg(chord) == pytest.approx(20.0, abs=1.0)  # half the bend, of an arc


def test_the_truth_of_such_leaves_is_what_their_triangles_measure():
    rng = np.random.default_rng(4)
    direction = rng.normal(size=(40, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    up = np.cross(direction, rng.normal(size=(40, 3)))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    sites = LeafSites(
        rng.normal(size=(40, 3)), direction, up, np.full(40, 0.07), np.full(40, 0.05), np.arange(40)
    )
    for tolerance in (NEAR, FAR):
        one = blade("palmate", tolerance, petiole=0.6, curl_deg=25.0)
        told, measured = truth_of(sites, one, np.arange(40)), measure_leaves(lay(sites, one))
        np.testing.assert_allclose(told.radius, measured.radius, rtol=1e-9)
        np.testing.assert_allclose(told.centre, measured.centre, atol=1e-9)
        np.testing.assert_allclose(np.abs((told.normal * measured.normal).sum(1)), 1, atol=1e-9)


def test_shapes_of_before_are_as_before():
    for shape in ("ellipse", "oval", "maple", "needle"):
        one = blade(shape, petiole=0.4, curl_deg=30.0)
        assert np.array_equal(one.vertices, SHAPES[shape]().vertices)


@pytest.mark.medium
def test_needles_of_a_fascicle_spring_from_one_place_and_shade_as_their_number():
    single, pairs = (
        shoot_of(Needles(length=0.05, diameter=0.0013, count=120, blades=0, together=n), 0.09)
        for n in (1, 2)
    )
    feet = pairs.vertices[::4]
    assert len(np.unique(feet.round(9), axis=0)) == 60
    assert len(np.unique(single.vertices[::4].round(9), axis=0)) == 120
    assert pairs.needle_area == single.needle_area
    assert pairs.shadow == pytest.approx(single.shadow, rel=0.06)
    tips = pairs.vertices[2::4].reshape(60, 2, 3)
    assert np.linalg.norm(tips[:, 0] - tips[:, 1], axis=1).min() > 0.05


def test_a_shoot_of_scots_pine_shades_as_measured():
    """Silhouette over all of the needles' surface: 0.14 of 258 shoots (Oker-Blom & Smolander 1988), 0.146 of
    305 (Tree Physiology 14:971, 1994); 0.25 would be needles apart."""
    species, _ = load_species(find_species("scots-pine", Path()))
    shoot = shoot_of(species.needles.changed(blades=0), species.leaf.length.mean)
    assert shoot.clumping / 4 == pytest.approx(0.143, abs=0.008)
    feet = shoot.vertices[::4, 0]
    assert feet.min() < 0.1
    assert feet.max() > 0.95
    assert shoot.vertices[:, 0].max() > 1.3
