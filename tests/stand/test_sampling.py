"""Samples against their laws. Every statistical test states its false-alarm rate; seeds are fixed, so a
test that passes once passes always.
"""

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, stats
from scipy.spatial import cKDTree

from forest_addon.base.rng import stream
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.measured.allometry import band, suppressed
from forest_addon.site import ForestSite
from forest_addon.spec import (
    Clusters,
    Forest,
    Gaussian,
    Planting,
    Scene,
    Strauss,
    Targets,
)
from forest_addon.stand.competition import (
    MOST_INDEX,
    SHORTEST,
    cover,
    filled,
    leaf_area_index,
)
from forest_addon.stand.compose import Inputs, TreeList, process_of
from forest_addon.stand.intensity import functions
from forest_addon.stand.intensity.functions import (
    Constant,
    Intensity,
    Mixture,
    Polygon,
    Product,
    Sum,
)
from forest_addon.stand.intensity.surface import IntensityError
from forest_addon.stand.layouts import (
    Process,
    activity_of,
    k_of_clusters,
    run_births_and_deaths,
    sample,
    sample_clusters,
    sample_strauss,
)
from forest_addon.stand.measured import with_targets
from forest_addon.stand.plan import labels, plan_stand
from forest_addon.stand.statistics.intensity import Window
from forest_addon.stand.statistics.law import fit_clusters, fit_strauss, inhomogeneous_k

LOW, SIZE = np.array([500_000.0, 5_400_000.0]), np.array([60.0, 40.0])  # UTM
HILLS = Mixture(
    np.array([1.0, 3.0]), np.add(LOW, [[10, 10], [50, 35]]), np.array([[4.0, 9.0], [0.8, 2.0]])
)


class Plain(Intensity):
    """An intensity of which only values and bounds are known, so it has to be thinned."""

    def __init__(self, of, bound=1.0):
        self.of, self.bound = of, bound

    def at(self, points):
        return self.of.at(points)

    def bounds(self, low, high):
        lower, upper = self.of.bounds(low, high)
        return lower, self.bound * upper

    def closed_integral(self, low, high):
        return self.of.closed_integral(low, high)


def pixels():
    image = stream(1, "pixels").random((5, 7))
    image[image < 0.4] = 0
    return functions.RasterIntensity(image, LOW, SIZE)


TRIANGLE = Polygon(np.add(LOW, [[5, 5], [55, 8], [20, 39]]))
KINDS = {
    "by component": HILLS,
    "within a mask": Product((Sum((HILLS, Constant(0.02))), TRIANGLE)),
    "thinned hills": Plain(HILLS),
    "raster": pixels(),
    "raster within a mask": Product((pixels(), TRIANGLE)),
}


def process(name, total=60.0):
    made = Process(KINDS[name], LOW, LOW + SIZE)
    return made.scaled(total / made.expected)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_counts_in_rectangles_are_poisson(name):
    made, runs = process(name), 120
    samples = [sample(made, stream(s, "count", name)) for s in range(runs)]
    for low, high in [((0, 0), (60, 40)), ((5, 5), (30, 20)), ((15, 20), (52, 36))]:
        low, high = LOW + low, LOW + high
        counts = np.array([((p >= low) & (p < high)).all(axis=1).sum() for p in samples])
        mean = replace(made, low=low, high=high).total
        # Mean and dispersion of 15 rectangles, 4.5 sigma each: false alarm below 2.1e-4.
        room = 4.5 * np.sqrt(mean.value / runs) + mean.error
        assert abs(counts.mean() - mean.value) < room
        dispersion = counts.var(ddof=1) / mean.value
        assert abs(dispersion - 1) < 4.5 * np.sqrt(2 / runs + 1 / (mean.value * runs))
    # The whole distribution by chi-square over its octiles: false alarm 1e-4 each, 5e-4 together.
    mean = made.expected
    edges = np.unique(stats.poisson.ppf(np.arange(1, 8) / 8, mean))
    whole = np.array([len(p) for p in samples])
    observed = np.bincount(np.searchsorted(edges, whole), minlength=len(edges) + 1)
    expected = np.diff(stats.poisson.cdf([-1, *edges, 1e9], mean)) * runs
    assert stats.chisquare(observed, expected).pvalue > 1e-4


@pytest.mark.parametrize("bound", [1.0, 3.0])
def test_a_wood_is_as_dense_everywhere_whatever_the_bound_that_it_is_thinned_from(bound):
    """Number and places of 60,000 trees of an even wood: false alarm 7e-6, and 1e-4 along each axis. It finds
    a chance of staying, or an area of cells, that is off by 2 %, and cells that are off their place."""
    mean = 60_000
    wood = Plain(Constant(mean / SIZE.prod()), bound)
    points = sample(Process(wood, LOW, LOW + SIZE), stream(5, "even wood", int(bound)))
    assert abs(len(points) - mean) < 4.5 * np.sqrt(mean)
    for place in ((points - LOW) / SIZE).T:
        assert stats.kstest(place, "uniform").pvalue > 1e-4


@cache
def marginals(name):
    """Cuts and cumulative shares of ∫λ along x and along y, by a midpoint sum on 600 x 400 places."""
    x, y = (LOW[k] + (np.arange(n) + 0.5) * SIZE[k] / n for k, n in ((0, 600), (1, 400)))
    value = process(name).at(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(400, 600)
    found = []
    for axis, count in ((0, 600), (1, 400)):
        share = np.append(0, np.cumsum(value.sum(axis=axis)))
        found.append((LOW[axis] + np.linspace(0, SIZE[axis], count + 1), share / share[-1]))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("exactly", [None, 6000])
def test_positions_follow_the_intensity(name, exactly):
    """PIT of x and of y by their marginals; false alarm 1e-4 each, 2e-3 together."""
    points = sample(process(name, 9000.0), stream(0, "pit", name), exactly)
    assert exactly is None or len(points) == exactly
    for axis, (cut, share) in enumerate(marginals(name)):
        pit = np.interp(points[:, axis], cut, share)
        found = stats.kstest(pit, "uniform").statistic
        assert found < stats.kstwo.isf(1e-4, len(pit)) + 5e-4  # what the midpoint sum may be off


@pytest.mark.slow
@pytest.mark.parametrize("name", ["thinned hills", "raster"])
def test_disjoint_cells_are_independent(name):
    made, runs = process(name), 300
    counts = np.zeros((runs, 2))
    for s in range(runs):
        west = sample(made, stream(s, "cells", name))[:, 0] < LOW[0] + 30
        counts[s] = west.sum(), (~west).sum()
    assert abs(np.corrcoef(counts.T)[0, 1]) < 4.5 / np.sqrt(runs)  # false alarm 7e-6 each


def test_one_pixel_that_is_not_zero_gets_all_trees():
    image = np.zeros((512, 512))
    image[100, 300] = 1
    made = Process(functions.RasterIntensity(image, LOW, SIZE), LOW, LOW + SIZE)
    points = sample(made.scaled(20_000 / made.expected), stream(1, "pixel"))
    step = SIZE / 512
    centre = LOW + step * [300.5, 512 - 100.5]
    assert (np.abs(points - centre) <= step).all()
    # The hat of bilinear meaning: E|dx|/step = 1/3, sd 1/√18; 5 sigma of the mean, false alarm 6e-7.
    away = np.abs(points - centre).mean(axis=0) / step
    assert np.abs(away - 1 / 3).max() < 5 / np.sqrt(18 * len(points))
    assert abs(len(points) - 20_000) < 5 * np.sqrt(20_000)


def test_a_narrow_spike_far_from_the_origin():
    spike = Plain(Mixture(np.array([1e6]), np.add(LOW, [[31.0, 7.0]]), np.array([[0.01, 0.01]])))
    points = sample(Process(spike, LOW, LOW + SIZE), stream(0, "spike"))
    assert abs(len(points) - 1e6 * np.pi * 1e-4) < 5 * np.sqrt(1e6 * np.pi * 1e-4)
    assert np.abs(points - LOW - [31, 7]).max() < 0.06


def test_a_violated_bound_is_refused_with_place_and_values():
    low_bound = Process(Plain(HILLS, 0.9), LOW, LOW + SIZE).scaled(50)
    with pytest.raises(IntensityError, match=r"at \(5\d+, 5.*e\+06\) is .* above its bound of"):
        for s in range(20):
            sample(low_bound, stream(s, "violated"))


@pytest.mark.parametrize("bad", [np.nan, -1.0])
def test_values_that_are_no_intensity_are_refused_with_their_place(bad):
    class Broken(Plain):
        def at(self, points):
            return np.where(points[:, 0] > LOW[0] + 30, bad, 1.0)

    with pytest.raises(IntensityError, match=f"is {bad:g} trees"):
        sample(Process(Broken(Constant(1.0)), LOW, LOW + SIZE), stream(0, "x"))


@pytest.mark.parametrize("name", ["by component", "raster"])
def test_too_many_trees_are_refused_with_the_number(name):
    with pytest.raises(IntensityError, match="300,000,000 trees, more than 20,000,000"):
        sample(process(name, 3e8), stream(0, "x"))


def test_nothing_where_the_intensity_is_zero():
    empty = Process(functions.RasterIntensity(np.zeros((4, 4)), LOW, SIZE), LOW, LOW + SIZE)
    assert sample(empty, stream(0, "x")).shape == (0, 2)
    with pytest.raises(IntensityError, match="7 trees cannot stand"):
        sample(empty, stream(0, "x"), 7)


def test_sampling_does_not_depend_on_what_was_integrated_before():
    one, two = process("raster"), process("raster")
    assert two.total.value > 0
    assert (sample(one, stream(1, "a")) == sample(two, stream(1, "a"))).all()


# --------------------------------------------------------------------------------------- interaction
# Clusters and repulsion against closed forms. Seeds are fixed, so a test that passes once passes always;
# what a wrong sampler is caught with is said as the chance that a right one would fail.

INTERACTION_LOW, HIGH = np.zeros(2), np.array([100.0, 80.0])
WINDOW = Window.rectangle(INTERACTION_LOW, HIGH)
RADII = np.linspace(0.5, 12, 24)
GROUPS = [Clusters(groups=0.01, spread=2.0), Clusters(kind="matern", groups=0.02, spread=4.0)]


def even(intensity, low=INTERACTION_LOW, high=HIGH):
    return Process(Constant(intensity), low, high)


@pytest.mark.parametrize("clusters", GROUPS, ids=lambda c: c.kind)
def test_k_of_clusters_is_closed_and_samples_have_it(clusters):
    """Means of 24 stands within 4.5 standard errors at each of 24 radii: a right one fails once in 6,000."""
    curves = [
        inhomogeneous_k(trees, np.full(len(trees), 0.05), WINDOW, RADII, renormalise=False).value
        for trees in (sample_clusters(even(0.05), clusters, stream(k, "k")) for k in range(24))
    ]
    error = np.std(curves, axis=0, ddof=1) / np.sqrt(len(curves))
    assert (np.abs(np.mean(curves, axis=0) - k_of_clusters(RADII, clusters)) < 4.5 * error).all()


def test_the_law_of_two_points_in_a_disc_is_the_integral_of_its_density():
    """The distance of two even points of a disc (Kendall & Moran 1963), integrated by scipy."""

    def density(d):
        return 16 * d / np.pi * (math.acos(d) - d * math.sqrt(1 - d * d))

    clusters = Clusters(kind="matern", groups=1.0, spread=0.5)
    for radius in (0.1, 0.5, 0.9, 1.0, 3.0):
        share = integrate.quad(density, 0, min(radius, 1))[0]
        found = k_of_clusters(np.array([radius]), clusters)[0] - np.pi * radius**2
        assert found == pytest.approx(share, abs=1e-10)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("draw", "law", "stands", "near"),
    [
        (sample_clusters, GROUPS[0], 80, 0.0),
        (sample_strauss, Strauss(radius=3.0, gamma=0.2), 6, 0.02),
    ],
    ids=["clusters", "strauss"],
)
def test_as_many_trees_stand_on_each_side_of_a_hill(draw, law, stands, near):
    """Mean numbers of stands in the dense and in the thin half, 4.5 standard errors: fails once in 70,000.

    near : what repulsion, whose activity is an approximation, may be off by, of 1.
    """
    hill = Gaussian(peak=0.12, centre=(0.0, 40.0), width=(40.0, 60.0))
    process = process_of(Planting(species="x", gaussians=(hill,)), Forest(size=(80.0, 80.0)))
    drawn = [draw(process, law, stream(k, "hill")) for k in range(stands)]
    for low, high in (((0, 0), (30, 80)), ((30, 0), (80, 80))):
        counts = np.array([((t >= low) & (t < high)).all(axis=1).sum() for t in drawn])
        error = counts.std(ddof=1) / np.sqrt(stands)
        wanted = replace(process, low=np.array(low, float), high=np.array(high, float)).expected
        assert abs(counts.mean() - wanted) < near * wanted + 4.5 * error


@pytest.mark.medium
@pytest.mark.parametrize("gamma", [0.0, 0.3, 1.0])
def test_where_all_trees_see_each_other_their_number_is_known(gamma):
    """On islands smaller than R, P(n) is as (β|W|)^n/n! γ^(n(n-1)/2). Chi-squared at 1e-4, 400 islands."""
    beta, apart, strauss = 3.0, 5.0, Strauss(radius=2.0, gamma=gamma)

    def activity(points):
        return np.where((points % apart < 1.0).all(axis=1), beta, 0.0)

    rng = stream(1, "islands")
    trees = run_births_and_deaths(activity, 0.2, np.zeros(2), np.full(2, 20 * apart), strauss, rng)
    column, row = (trees // apart).astype(int).T
    counts = np.bincount(20 * row + column, minlength=400)
    law = np.array([beta**k / math.factorial(k) * gamma ** (k * (k - 1) // 2) for k in range(30)])
    law /= law.sum()
    most = int(np.flatnonzero(400 * law >= 5).max())
    want = np.append(400 * law[:most], 400 * law[most:].sum())
    have = np.bincount(np.minimum(counts, most), minlength=most + 1)
    assert stats.chisquare(have, want).pvalue > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gamma", "radius", "intensity"),
    [
        (0.0, 3.0, 0.05),
        (0.7, 4.0, 0.08),
    ],
)
def test_as_many_trees_stand_as_were_asked_for(gamma, radius, intensity):
    """Within 1 % and 4 standard errors of 8 stands of 0.5 ha; and births balance deaths (Georgii, Nguyen &
    Zessin: E n = E ∫ β γ^t(u) du whatever β is)."""
    strauss = Strauss(radius=radius, gamma=gamma)
    beta, high = float(activity_of(np.array([intensity]), strauss)[0]), np.array([80.0, 65.0])
    counts, apart = [], []
    for k in range(8):
        rng = stream(k, "n")
        trees = sample_strauss(even(intensity, high=high), strauss, rng)
        places = rng.uniform(
            radius, high - radius, (4000, 2)
        )  # whose neighbours are all on the field
        inside = ((trees >= radius) & (trees < high - radius)).all(axis=1).sum()
        near = cKDTree(trees).query_ball_point(places, radius, return_length=True)
        counts.append(len(trees))
        apart.append(inside - beta * (high - 2 * radius).prod() * (gamma**near).mean())
    errors = np.std([counts, apart], axis=1, ddof=1) / np.sqrt(8)
    wanted = intensity * high.prod()
    assert abs(np.mean(counts) - wanted) < 0.01 * wanted + 4 * errors[0]
    assert abs(np.mean(apart)) < 6 * errors[1]  # 8 stands: once in 1,800


@pytest.mark.medium
@pytest.mark.parametrize(("gamma", "radius"), [(0.0, 4.0), (0.1, 5.0), (0.5, 9.0)])
def test_a_mean_that_cannot_be_reached_is_refused_with_a_radius_that_can(gamma, radius):
    process = even(0.05)
    with pytest.raises(IntensityError, match="make radius at most") as refused:
        sample_strauss(process, Strauss(radius=radius, gamma=gamma), stream(1, "core"))
    nearest = float(re.search(r"at most ([\d.]+) m", str(refused.value))[1])
    sample_strauss(process, Strauss(radius=0.999 * nearest, gamma=gamma), stream(1, "core"))


def test_a_hard_core_is_kept():
    trees = sample_strauss(even(0.05), Strauss(radius=2.5, gamma=0.0), stream(1, "core"))
    apart = np.linalg.norm(trees[:, None] - trees, axis=2) + 99 * np.eye(len(trees))
    assert apart.min() >= 2.5


def test_clusters_are_found_again():
    """Of 6 stands the median of κ and σ within 25 %."""
    found = []
    for k in range(6):
        trees = sample_clusters(even(0.08), GROUPS[0], stream(k, "fit"))
        found.append(fit_clusters(inhomogeneous_k(trees, np.ones(len(trees)), WINDOW, RADII)))
    assert np.median([c.groups for c in found]) == pytest.approx(0.01, rel=0.25)
    assert np.median([c.spread for c in found]) == pytest.approx(2.0, rel=0.25)


@pytest.mark.slow
def test_repulsion_is_found_again_and_poisson_has_none():
    radii = np.arange(1.0, 6.1, 0.5)
    strauss = Strauss(radius=3.0, gamma=0.2)
    found = [
        fit_strauss(sample_strauss(even(0.05), strauss, stream(k, "s")), WINDOW, radii)
        for k in range(3)
    ]
    assert np.median([fitted.radius for fitted, _ in found]) == 3.0
    assert np.median([fitted.gamma for fitted, _ in found]) == pytest.approx(0.2, abs=0.08)
    assert min(gain for _, gain in found) > 10
    trees = HIGH * stream(1, "none").random((400, 2))
    assert fit_strauss(trees, WINDOW, radii)[1] < 6


@pytest.mark.medium
@pytest.mark.parametrize("layout", ["clusters", "strauss"])
def test_a_scene_plants_them_with_streams_of_their_own(layout):
    one = Planting(species="maple", expected=60, layout=layout)
    field = Forest(size=(60.0, 60.0))
    alone = plan_stand(3, field, (one,))
    beside = plan_stand(3, field, (one, Planting(species="apple", expected=5)))
    assert 30 < len(alone) < 110
    assert (beside.position[beside.species == 0] == alone.position).all()


@pytest.mark.slow
def test_the_edge_of_a_field_has_no_more_trees_than_its_middle():
    """16 stands of 300 trees that keep 3 m apart: 2.9 % too many of them with nothing beyond the edge.

    Their mean is known to 0.8 %; the mean intensity itself is an approximation within 1 %.
    """
    side, strauss = 100.0, Strauss(radius=3.0, gamma=0.3)
    process = even(0.03, np.zeros(2), np.full(2, side))
    stands = [sample_strauss(process, strauss, stream(k, "edge")) for k in range(16)]
    assert np.mean([len(trees) for trees in stands]) == pytest.approx(0.03 * side**2, rel=0.02)
    trees = np.concatenate(stands)
    at_edge = (np.minimum(trees, side - trees) < 3.0).any(axis=1).mean()
    share = 1 - (1 - 6.0 / side) ** 2
    assert at_edge == pytest.approx(share, abs=4.5 * np.sqrt(share / len(trees)))


def test_fewer_trees_than_were_asked_for_exactly_are_said():
    species = load_species(find_species("hazelnut", Path()))
    close = Planting(species="hazelnut", variants=1, expected=18, exact=True)
    scene = Scene(forest=Forest(size=(10.0, 10.0), spacing=2.0), plantings=(close,))
    forest = ForestSite(scene, species=(species,)).grow()
    count = len(forest.stand)
    assert count < 18
    assert forest.notes == (
        f"hazelnut: {count} trees of exactly so many stand; {18 - count} are nearer to others than "
        "spacing allows",
    )
    place = np.array([[1.0, 1.0], [50.0, 1.0], [2.0, 90.0]])
    listed = Planting(species="hazelnut", variants=1, layout="list", trees="a.csv")
    inputs = Inputs(
        lists={"a.csv": TreeList(place, None, np.full(3, np.nan), np.full(3, np.nan), None)}
    )
    scene = Scene(forest=Forest(size=(10.0, 10.0)), plantings=(listed,))
    forest = ForestSite(scene, species=(species,), inputs=inputs).grow()
    assert forest.notes == (
        "hazelnut: 1 trees of a list stand; 2 are outside of the field, or of where the planting may stand",
    )


# --------------------------------------------------------------------------------------- competition
# Competition of crowns against brute force, and in stands that are alike but for their spacing.


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
    assert np.median(dense[:, 2]) < 0.85 * np.median(wide[:, 2])  # widths


@pytest.mark.medium
def test_no_parasol_and_no_surplus_of_leaves():
    for seed in range(4):
        stand, trees, law = stand_of(2.2, seed)
        assert (trees[:, 3] < (1 - SHORTEST) * trees[:, 1]).all()
        assert len(np.unique(trees[:, 3])) == len(trees)  # none sit on a bound
        assert (trees[:, 4] <= band(law, trees[:, 0])[1, :, 3] + 1e-9).all()
        place = stand.position[:, :2]
        inner = (abs(place - place.mean(axis=0)) < 7).all(axis=1)
        index = trees[inner, 4].sum() / 14.0**2
        assert index < 1.25 * MOST_INDEX


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
