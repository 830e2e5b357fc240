"""Trees with fewer, larger leaves let as much light through as all leaves do, by rays; and who gets them."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from references.rays import scene_with
from scipy.spatial import ConvexHull

from forest_addon.base.rng import stream
from forest_addon.blender.rays.casters import make_caster
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.measured.allometry import Wanted
from forest_addon.growth.tree import grow
from forest_addon.sensing.detail import BOUND, COARSE, SHARE, grow_needed
from forest_addon.sensing.lidar.kind import look_of_terrestrial
from forest_addon.sensing.looks import loudness
from forest_addon.spec import (
    Accuracy,
    Beam,
    Detail,
    Forest,
    Planting,
    Rays,
    Reverb,
    Rows,
    Scene,
    Sonar,
    Terrestrial,
)
from forest_addon.stand.forest import keep_trees, tree_table

KINDS = ("norway-maple", "scots-pine", "norway-spruce")  # leaves, tufts, shoots
TREE = Wanted(0.12, 9.0, 2.8, 3.0, 22.0)
WAYS = np.array([[0, 0, 1], [1, 0, 0.1], [0, 1, 0.3], [0.6, -0.5, 0.6], [-0.7, -0.3, 0.25]])
GROWN = keep_trees()  # no tree grows twice
SIDE = 50  # rays along each side of a picture


def far_trees(forest):
    """(N,) bool, trees that are shown by their coarse variants."""
    return forest.stand.variant >= COARSE


def caster_of(tree):
    return make_caster(scene_with(tree.mesh), Rays(threads=1))


def hidden_and_gap(tree, like):
    """(5,) m² that a tree hides and (5,) gap fractions within the hull of the leaves of ``like``."""
    caster = caster_of(tree)
    middle, reach = np.array([0.0, 0.0, TREE.height / 2]), 0.6 * TREE.height
    found = []
    for number, way in enumerate(WAYS / np.linalg.norm(WAYS, axis=1, keepdims=True)):
        u = np.cross(way, [0.3, 0.5, 0.1])
        u /= np.linalg.norm(u)
        v = np.cross(way, u)
        seen = (like.leaves.centre - middle) @ np.stack([u, v], axis=1)
        jitter = stream(3, "pixels", number).random((SIDE, SIDE, 2))
        at = np.stack(np.mgrid[:SIDE, :SIDE], axis=2) + jitter
        low, high = seen.min(axis=0) - 0.2, seen.max(axis=0) + 0.2
        at = low + at.reshape(-1, 2) / SIDE * (high - low)
        origins = middle + at @ np.stack([u, v]) - 3 * reach * way
        met = caster.cast(origins, np.tile(way, (len(at), 1))).found
        hull = ConvexHull(seen).equations
        inside = (at @ hull[:, :2].T + hull[:, 2] <= 0).all(axis=1)
        found.append((met.mean() * np.prod(high - low), 1 - met[inside].mean()))
    return np.array(found).T


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_coarser_tree_hides_as_much(name):
    """Two trees, five directions, 2,500 rays each: the means of hidden area and gap fraction are within
    the bound, known to 2 % or better (a standard error, from their spread). Most species are within 1 %; a
    quarter of a maple's leaves, whose crown has wide gaps, is 2 to 4 % off.
    """
    species, kind = load_species(find_species(name, Path()))
    shares = (0.5, SHARE) if name == "norway-maple" else (SHARE,)
    off = {share: [] for share in shares}
    for seed in range(2):  # crowns with gaps differ more between directions
        full = grow(species, kind, stream(seed, "detail", name), TREE)
        whole = hidden_and_gap(full, full)
        for share in shares:
            coarse = species.changed(detail=Detail(leaves=share))
            less = grow(coarse, kind, stream(seed, "detail", name), TREE)
            off[share].append(hidden_and_gap(less, full) / whole - 1)
            assert len(less.mesh.triangles) < 0.9 * len(full.mesh.triangles)
            assert (less.leaves.radius**2).sum() == pytest.approx((full.leaves.radius**2).sum())
    for share, of_trees in off.items():
        away = np.concatenate(of_trees, axis=1)  # (2, trees · directions)
        assert (away.std(axis=1, ddof=1) / np.sqrt(away.shape[1]) < 0.02).all(), share
        assert (np.abs(away.mean(axis=1)) < BOUND).all(), share


@cache
def forest(*sensors, detail="auto"):
    """Birches in a row that runs away from the sensors."""
    birch = load_species(find_species("silver-birch", Path()))
    targets = birch[0].targets
    targets = targets.changed(height=6.0, crown_width=2.0, crown_base=1.5, leaf_area=2.0)
    scene = Scene(
        seed=4,
        forest=Forest(size=(4.0, 200.0)),
        accuracy=Accuracy(detail=detail),
        plantings=(
            Planting(
                species="silver-birch",
                layout="rows",
                variants=1,
                targets=targets,
                rows=Rows(rows=1, trees=10, tree_spacing=20.0),
            ),
        ),
        sensors=sensors,
    )
    return grow_needed(scene, [birch], kept=GROWN)


SCANNER = Terrestrial(
    position=(0.0, 0.0, 2.0),
    angle_step_deg=0.2,
    elevation_deg=(-30.0, 30.0),
    max_range=400.0,
)


@pytest.mark.slow
def test_trees_are_coarse_where_a_scanner_cannot_tell_their_leaves_apart():
    """A tree is far from where the pulses of a scanner lie a coarse leaf apart, and no nearer."""
    grown = forest(SCANNER)
    far, stand = far_trees(grown), grown.stand
    away = np.hypot(*stand.position[:, :2].T)
    leaf = max(tree.leaves.length.max() for tree in grown.variants.values())
    edge = leaf / look_of_terrestrial(SCANNER).resolves(np.ones(1))[0]
    assert far[away > edge + 2.5].all()
    assert not far[away < 0.8 * edge].any()
    assert 0 < far.sum() < len(far)
    assert ((stand.variant >= COARSE) == far).all()
    few = [len(grown.variants[key].leaves) for key in grown.variants if key[1] >= COARSE]
    many = [len(grown.variants[key].leaves) for key in grown.variants if key[1] < COARSE]
    assert max(few) < 0.4 * min(many)
    assert "trees have 25% of their leaves" in grown.detail[0]
    assert "cm apart" in grown.detail[1]
    (choice,) = grown.chosen
    assert (choice.key, choice.unit, choice.sensor) == ("range at far leaves", "m", SCANNER.name)
    full = forest(SCANNER, detail="full")
    off = shifts(full, grown)
    assert (off <= choice.bound).mean() == pytest.approx(0.9, abs=0.06)  # of rays of its own
    assert np.median(off) == pytest.approx(choice.value, abs=0.02)


def shifts(full, coarse):
    """Metres between first ranges of level rays through trees with all and with coarse leaves."""
    rng, found = stream(8, "level rays"), []
    for planting, variant in coarse.variants:
        if variant < COARSE:
            continue
        pair = full.variants[planting, variant - COARSE], coarse.variants[planting, variant]
        place = pair[0].leaves.centre[rng.integers(0, len(pair[0].leaves), 1500)]
        turn = rng.uniform(0, 2 * np.pi, 1500)
        ways = np.stack([np.cos(turn), np.sin(turn), np.zeros(1500)], axis=1)
        hits = [caster_of(tree).cast(place - 30.0 * ways, ways) for tree in pair]
        both = hits[0].found & hits[1].found
        found.append(np.abs(hits[0].distance[both] - hits[1].distance[both]))
    return np.concatenate(found)


@pytest.mark.slow
def test_full_detail_is_the_forest_as_it_was_and_auto_moves_no_wood():
    auto, full = forest(SCANNER), forest(SCANNER, detail="full")
    assert full.detail == ()
    assert Scene().accuracy.detail == "full"
    assert np.array_equal(full.transforms(), auto.transforms())
    for (planting, variant), tree in auto.variants.items():
        whole = full.variants[planting, variant % COARSE]
        assert np.array_equal(tree.skeleton.end, whole.skeleton.end)
    a, b = tree_table(full), tree_table(auto)
    np.testing.assert_allclose(a["leaf_area_m2"], b["leaf_area_m2"], rtol=1e-9)
    assert a["dbh_m"] == b["dbh_m"]


@pytest.mark.slow
def test_a_wide_beam_makes_trees_coarse_and_one_that_may_be_anywhere_none():
    narrow = Terrestrial(name="a", angle_step_deg=0.001, max_range=400.0)
    wide = replace(narrow, beam=Beam(divergence_mrad=(3.0, 3.0), subrays=7))
    assert not far_trees(forest(narrow)).any()
    assert far_trees(forest(wide)).any()
    assert not far_trees(forest(wide, narrow.changed(name="b"))).any()  # the finer one decides
    lost = Sonar(follow="bat", max_range=15.0)
    found = forest(wide, lost)
    assert not far_trees(found).any()
    assert "not known yet" in found.detail[0]
    assert not far_trees(forest(Reverb())).any()  # nobody looks


@pytest.mark.medium
def test_beyond_a_sonars_range_leaves_may_be_coarse():
    """Within it so few leaves of small birches sound together that all are made."""
    sonar = Sonar(position=(0.0, -5.0, 3.0), azimuth_deg=90.0, max_range=30.0)
    grown = forest(sonar)
    away = np.hypot(grown.stand.position[:, 0], grown.stand.position[:, 1] + 5.0)
    assert far_trees(grown).any()
    assert away[far_trees(grown)].min() > 30.0
    assert "beyond its range" in grown.detail[1]


def test_large_discs_send_back_by_their_area_and_small_ones_do_not():
    """Energy over all orientations: of one disc against that of four of a quarter of its area each."""
    assert loudness((60e3, 80e3), 0.02) == pytest.approx(1.0, abs=0.05)
    assert (
        loudness((1e3, 2e3), 0.02) > 2.0
    )  # Rayleigh: four times the radius' sixth power of a quarter
