"""Competition of crowns against brute force, and in stands that are alike but for their spacing."""

import numpy as np
import pytest
from scipy import stats

from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.measured.allometry import band
from forest_addon.spec import Planting, Scene, Targets
from forest_addon.stand.compose import Inputs, TreeList
from forest_addon.stand.measured import (
    MOST_INDEX,
    OVERLAP,
    SHORTEST,
    apart,
    aside,
    cover,
    filled,
    leaf_area_index,
    suppressed,
    with_targets,
)
from forest_addon.stand.plan import labels, plan_stand


def stand_of(gap, seed=1, count=12):
    axis = (np.arange(count) + 0.5) * gap
    place = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    place = place + 0.2 * gap * np.random.default_rng(3).uniform(-1, 1, place.shape)
    measures = np.full((len(place), 5), np.nan)
    measures[:, 0], measures[:, 1] = 0.2, 16.0
    listed = TreeList(place, measures=measures)
    planting = Planting(species="scots-pine", layout="list", trees="all", variants=len(place))
    scene = Scene(seed=seed, plantings=(planting,))
    scene = scene.changed(forest=scene.forest.changed(size=(gap * count, gap * count)))
    inputs = Inputs(lists={"all": listed})
    stand = plan_stand(scene.seed, scene.forest, scene.plantings, inputs)
    kinds = [load_species(find_species("scots-pine", None))]
    names = labels(scene.plantings)
    found = with_targets(scene.seed, stand, scene.plantings, names, kinds, inputs)
    return stand, found.trees, found.laws[0]


def test_cover_is_the_sum_over_all_neighbours():
    rng = np.random.default_rng(0)
    place, height = rng.uniform(0, 60, (200, 2)), rng.uniform(10, 20, 200)
    width = rng.uniform(2, 4, 200)
    middle = np.argmin(np.linalg.norm(place - 30, axis=1))
    sd, total = width.mean(), 0.0
    for other in range(200):
        away = np.linalg.norm(place[other] - place[middle])
        if other != middle and away <= 2.5 * sd:
            kernel = np.exp(-(away**2) / (2 * sd**2)) / (2 * np.pi * sd**2)
            taller = np.clip(height[other] / height[middle], 0.2, 3.0) ** 2
            taller = (
                taller
                if other < middle
                else 1 / np.clip(height[middle] / height[other], 0.2, 3) ** 2
            )
            total += kernel * np.pi / 4 * width[other] ** 2 * taller
    assert cover(place, height, width)[middle] == pytest.approx(total, rel=1e-6)


def test_a_large_stand_covers_what_its_crowns_cover():
    rng = np.random.default_rng(1)
    place = rng.uniform(0, 100, (4000, 2))
    width = np.full(4000, 3.0)
    found = cover(place, np.full(4000, 15.0), width)
    kept = 1 - np.exp(-(2.5**2) / 2)  # of a normal kernel that is cut at 2.5 standard deviations
    assert found.mean() == pytest.approx(kept * 0.4 * np.pi / 4 * 9, rel=0.03)
    index = leaf_area_index(place, width, np.full(4000, 20.0))
    assert index.mean() == pytest.approx(kept * 8.0 + 20 / (2 * np.pi * 9), rel=0.05)


@pytest.mark.medium
@pytest.mark.parametrize("seed", [1, 3])
def test_crowns_of_a_dense_stand_are_higher_and_narrower(seed):
    dense, wide = (stand_of(gap, seed)[1] for gap in (2.0, 8.0))
    assert np.median(dense[:, 3]) > np.median(wide[:, 3]) + 2.0  # crown bases, m
    assert np.median(dense[:, 2]) < 0.8 * np.median(wide[:, 2])  # widths


@pytest.mark.medium
def test_no_parasol_no_surplus_of_leaves_and_little_overlap():
    for seed in range(4):
        stand, trees, law = stand_of(2.2, seed)
        assert (trees[:, 3] < (1 - SHORTEST) * trees[:, 1]).all()
        assert len(np.unique(trees[:, 3])) == len(trees)  # none sit on a bound
        assert (trees[:, 4] <= band(law, trees[:, 0])[1, :, 3] + 1e-9).all()
        place = stand.position[:, :2]
        inner = (abs(place - place.mean(axis=0)) < 7).all(axis=1)
        index = trees[inner, 4].sum() / 14.0**2
        assert index < 1.25 * MOST_INDEX
        assert apart(place, trees[:, 2], np.ones(len(trees), bool)) == pytest.approx(
            trees[:, 2], rel=0.35
        )
    assert OVERLAP < 2


@pytest.mark.medium
def test_crowns_grow_into_gaps_between_neighbours_alone():
    rng = np.random.default_rng(2)
    ticks = 2.5 * np.arange(12)
    place = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    place = place + rng.uniform(-0.7, 0.7, place.shape)
    width, free = np.full(len(place), 3.0), np.ones(len(place), dtype=bool)
    height = np.full(len(place), 15.0)
    wider = filled(place, height, width, free)
    assert (wider >= width).all()
    assert (wider <= 1.17 * width + 1e-9).all()
    looks = rng.uniform(2.5, 25.0, (20_000, 2))
    away = np.linalg.norm(looks[:, None] - place, axis=2)
    sky = [(away > w / 2).all(axis=1).mean() for w in (width, wider)]
    assert sky[1] < 0.6 * sky[0]
    assert filled(place, height, width, ~free).tolist() == width.tolist()  # what is given stays
    for apart_by in (50.0, 0.5):  # gaps on all sides, or on none
        looked = filled(apart_by / 2.5 * place, height, width, free)
        assert looked[66] == 3.0  # a tree in the middle


def test_crowns_stand_aside_towards_the_light():
    ticks = 2.5 * np.arange(9)
    place = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    gone = np.linalg.norm(place - place[40] - [2.5, 0.0], axis=1) < 0.1
    place, height, width = place[~gone], np.full(80, 15.0), np.full(80, 3.0)
    found = aside(place, height, width)
    assert found[40, 0] > 0.1  # to the gap at its side
    assert abs(found[40, 1]) < 1e-9
    assert np.abs(found[0]).max() < 1e-9  # as much light on all sides as it can be told
    assert not aside(place, np.where(np.arange(80) == 40, 30.0, height), width)[40].any()  # taller
    far = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]])
    assert not aside(far, height[:3], width[:3]).any()
    turned = aside(place @ [[0.0, 1.0], [-1.0, 0.0]], height, width)
    assert turned == pytest.approx(found @ [[0.0, 1.0], [-1.0, 0.0]], abs=1e-9)


def test_the_understorey_falls_off_by_the_same_factor_from_class_to_class():
    dbh, keys = np.full(20_000, 0.4), np.arange(20_000, dtype=np.uint64)
    found = suppressed(dbh, keys, 0.3)
    young = found[found < 0.4]
    assert abs(len(young) - 6000) < 5 * np.sqrt(20_000 * 0.3 * 0.7)  # false alarm below 1e-6
    law = stats.truncexpon((0.24 - 0.025) * np.log(1.4) / 0.05, 0.025, 0.05 / np.log(1.4))
    assert stats.kstest(young, law.cdf).pvalue > 1e-4
    assert suppressed(dbh, keys, 0.0).tolist() == dbh.tolist()


@pytest.mark.medium
def test_trees_of_one_stand_are_more_alike_than_trees_of_many():
    one = [stand_of(3.0, seed)[1] for seed in range(6)]
    odds = [np.log(t[:, 3] / (t[:, 1] - t[:, 3])) for t in one]
    within = np.mean([o.std() for o in odds])
    assert within < 0.95 * np.concatenate(odds).std()
    assert np.std([o.mean() for o in odds]) > 3 * within / np.sqrt(len(odds[0]))  # not by chance


def test_what_is_given_stays():
    _, trees, _ = stand_of(1.2)
    assert (trees[:, 0] == 0.2).all()
    assert (trees[:, 1] == 16.0).all()
    assert Targets().crown_base == 0
