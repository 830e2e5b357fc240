"""Spacing against brute force, its exact minimum distance, and what no distance may do."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from forest_addon.base.rng import stream
from forest_addon.spec import Distance, Forest, Planting, SpecError
from forest_addon.stand.plan import Spacing, greedy, matern_ii, plan_stand, space

RULES = {"matern": matern_ii, "greedy": greedy}


def apart(rule, points, mark, distance):
    none = np.zeros(len(points))
    return RULES[rule](points, mark, Spacing(np.array([[distance]]), none.astype(int), none))


def forest(count, seed=1, cluster=False):
    """Points, marks and spacing of three kinds, with crowns on one of them."""
    rng = stream(seed, "spacing", count)
    points = rng.uniform(0, 20, (count, 2)) + np.array([500_000.0, 5_400_000.0])
    if cluster:
        points[: count // 2] = points[0] + rng.normal(0, 0.05, (count // 2, 2))
    kind = rng.integers(0, 3, count)
    crown = np.where(kind == 2, rng.uniform(0.2, 0.9, count), 0.0)
    distance = np.array([[0.8, 0.3, 1.5], [0.3, 0.0, 0.5], [1.5, 0.5, 0.6]])
    return points, rng.random(count), Spacing(distance, kind, crown)


def brute(points, mark, spacing, rule):
    """One tree after another, from the oldest on."""
    order = np.argsort(mark, kind="stable")
    keep, judges = np.zeros(len(points), dtype=bool), []
    for tree in order:
        others = np.array(judges, dtype=int)
        gap = np.hypot(*(points[others] - points[tree]).T)
        ok = not (gap < spacing.between(np.full(len(others), tree), others)).any()
        keep[tree] = ok
        if ok or rule == "matern":
            judges.append(tree)
    return keep


@pytest.mark.medium
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("cluster", [False, True])
@pytest.mark.parametrize("count", [2, 60, 900])
def test_pairs_crowns_and_rules_equal_the_definition(rule, cluster, count):
    points, mark, spacing = forest(count, cluster=cluster)
    keep = space(points, mark, spacing, rule)
    assert (keep == brute(points, mark, spacing, rule)).all()
    a, b = np.triu_indices(int(keep.sum()), 1)
    trees = np.flatnonzero(keep)
    gap = np.hypot(*(points[trees[a]] - points[trees[b]]).T)
    assert (gap >= spacing.between(trees[a], trees[b])).all()


@pytest.mark.medium
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("distance", [0.05, 0.5, 3.0])
def test_batches_of_many_trees_equal_the_definition(rule, distance):
    """More trees than one batch holds, against a walk in a grid of its own."""
    rng = stream(2, "many")
    points, mark = rng.uniform(0, 30, (6000, 2)), rng.random(6000)
    near = cKDTree(points).query_ball_point(points, distance * (1 - 1e-12))
    expected = np.zeros(6000, dtype=bool)
    for k in np.argsort(mark):
        older = [o for o in near[k] if mark[o] < mark[k]]
        expected[k] = not (expected[older].any() if rule == "greedy" else older)
    assert (apart(rule, points, mark, distance) == expected).all()


@pytest.mark.medium
@pytest.mark.parametrize("rule", RULES)
def test_a_distance_larger_than_the_field_leaves_the_oldest_tree(rule):
    rng = stream(3, "one")
    points, mark = rng.uniform(0, 20, (50_000, 2)), rng.random(50_000)
    keep = apart(rule, points, mark, 1000.0)
    assert keep.sum() == 1
    assert keep[np.argmin(mark)]


@pytest.mark.parametrize("rule", RULES)
def test_the_order_of_trees_does_not_matter(rule):
    points, mark, spacing = forest(700)
    keep = space(points, mark, spacing, rule)
    other = stream(4, "order").permutation(700)
    mixed = Spacing(spacing.distance, spacing.kind[other], spacing.crown[other])
    assert (space(points[other], mark[other], mixed, rule) == keep[other]).all()


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("count", [0, 1, 5])
def test_trees_in_one_place_and_hardly_any(rule, count):
    points = np.full((count, 2), 7.0)
    keep = apart(rule, points, np.zeros(count), 0.5)
    assert keep.sum() == min(count, 1)
    assert apart(rule, points, np.zeros(count), 0.0).all()


@pytest.mark.parametrize("rule", RULES)
def test_a_distance_of_exactly_the_spacing_is_kept(rule):
    points = np.array([[0.0, 0.0], [3.0, 4.0], [6.0, 8.0]])
    assert apart(rule, points, np.arange(3.0), 5.0).all()
    assert apart(rule, points, np.arange(3.0), np.nextafter(5.0, 6)).sum() == (
        2 if rule == "greedy" else 1
    )


@pytest.mark.medium
def test_matern_ii_keeps_the_share_that_it_should():
    """Of a Poisson process, (1 - exp(-λπr²))/(λπr²) stay (Matérn 1960; Stoyan, Kendall and Mecke 5.4).

    150 runs; neighbours inhibit each other, so the binomial error is larger than the true one: 4.5 sigma,
    false alarm below 7e-6.
    """
    stay, every = 0, 0
    for s in range(150):
        rng = stream(s, "share")
        points = rng.uniform(0, 20, (rng.poisson(400), 2))
        keep = apart("matern", points, rng.random(len(points)), 0.6)
        inner = ((points > 0.6) & (points < 19.4)).all(axis=1)
        stay, every = stay + (keep & inner).sum(), every + inner.sum()
    load = np.pi * 0.6**2
    expected = (1 - np.exp(-load)) / load
    assert abs(stay / every - expected) < 4.5 * np.sqrt(expected * (1 - expected) / every)


def test_two_species_on_the_same_centre_keep_their_pair_distance():
    field = Forest(
        size=(20.0, 20.0),
        spacing=0.5,
        distances=(
            Distance(species="oak", other="elm", distance=2.0),
            Distance(species="elm", other="elm", distance=0.0),
        ),
    )
    hill = [{"peak": 1.0, "centre": (10.0, 10.0), "width": (2.0, 2.0)}]
    from forest_addon.spec import Gaussian

    trees = tuple(
        Planting(species=name, expected=60, gaussians=tuple(Gaussian(**h) for h in hill))
        for name in ("oak", "elm")
    )
    stand = plan_stand(5, field, trees)
    assert stand.removed > 0
    assert stand.too_near.sum() == stand.removed
    points = stand.position[:, :2]
    gap = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    np.fill_diagonal(gap, np.inf)
    oak = stand.species == 0
    assert gap[np.ix_(oak, oak)].min() >= 0.5
    assert gap[np.ix_(oak, ~oak)].min() >= 2.0
    assert stand.density().sum() == pytest.approx(len(stand) / 400)


def test_a_distance_of_a_species_that_is_not_planted_is_refused():
    field = Forest(distances=(Distance(species="oak", other="yew", distance=2.0),))
    with pytest.raises(
        SpecError, match=r'distances\[0\].other: "yew" is not planted; use one of oak'
    ):
        plan_stand(0, field, [Planting(species="oak", expected=3)])
