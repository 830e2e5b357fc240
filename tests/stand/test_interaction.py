"""Clusters and repulsion against closed forms. Seeds are fixed, so a test that passes once passes always;
what a wrong sampler is caught with is said as the chance that a right one would fail.
"""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, stats

from forest_addon.base.rng import stream
from forest_addon.spec import Clusters, Forest, Gaussian, Planting, SpecError, Strauss
from forest_addon.stand.compose import process_of
from forest_addon.stand.intensity.functions import Constant
from forest_addon.stand.intensity.surface import IntensityError
from forest_addon.stand.layouts import (
    Process,
    activity_of,
    k_of_clusters,
    run_births_and_deaths,
    sample_clusters,
    sample_strauss,
)
from forest_addon.stand.plan import plan_stand
from forest_addon.stand.statistics.intensity import Window
from forest_addon.stand.statistics.law import fit_clusters, fit_strauss, inhomogeneous_k

LOW, HIGH = np.zeros(2), np.array([100.0, 80.0])
WINDOW = Window.rectangle(LOW, HIGH)
RADII = np.linspace(0.5, 12, 24)
GROUPS = [Clusters(groups=0.01, spread=2.0), Clusters(kind="matern", groups=0.02, spread=4.0)]


def even(intensity, low=LOW, high=HIGH):
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


def test_clusters_follow_the_plantings_intensity():
    """Mean numbers of 80 stands in two halves, 4.5 standard errors: fails once in 70,000."""
    hill = Gaussian(peak=0.1, centre=(20.0, 40.0), width=(30.0, 30.0))
    planting = Planting(species="x", gaussians=(hill,), layout="clusters", clusters=GROUPS[0])
    process = process_of(planting, Forest(size=(100.0, 80.0)))
    drawn = [sample_clusters(process, GROUPS[0], stream(k, "hill")) for k in range(80)]
    for low, high in (((0, 0), (30, 80)), ((30, 0), (100, 80))):
        counts = np.array([((t >= low) & (t < high)).all(axis=1).sum() for t in drawn])
        error = counts.std(ddof=1) / np.sqrt(len(counts))
        wanted = process.expected(np.array(low, float), np.array(high, float))
        assert abs(counts.mean() - wanted) < 4.5 * error


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


@pytest.mark.medium
@pytest.mark.parametrize(
    ("gamma", "radius", "intensity"),
    [
        (0.0, 3.0, 0.05),
        (0.02, 3.0, 0.07),
        (0.2, 3.0, 0.12),
        (0.3, 4.0, 0.08),
        (0.4, 2.5, 0.1),
        (0.8, 5.0, 0.1),
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
        near = np.linalg.norm(places[:, None] - trees, axis=2) < radius
        counts.append(len(trees))
        apart.append(
            inside - beta * (high - 2 * radius).prod() * (gamma ** near.sum(axis=1)).mean()
        )
    errors = np.std([counts, apart], axis=1, ddof=1) / np.sqrt(8)
    wanted = intensity * high.prod()
    assert abs(np.mean(counts) - wanted) < 0.01 * wanted + 4 * errors[0]
    assert abs(np.mean(apart)) < 6 * errors[1]  # 8 stands: once in 1,800


def test_as_many_trees_stand_on_each_side_of_a_hill():
    """Within 2 % and 4 standard errors of 8 stands, in the dense and in the thin half."""
    hill = Gaussian(peak=0.12, centre=(0.0, 40.0), width=(40.0, 60.0))
    planting = Planting(species="x", gaussians=(hill,), layout="strauss")
    process = process_of(planting, Forest(size=(80.0, 80.0)))
    drawn = [
        sample_strauss(process, Strauss(radius=3.0, gamma=0.2), stream(k, "hill")) for k in range(8)
    ]
    for low, high in (((0, 0), (30, 80)), ((30, 0), (80, 80))):
        counts = np.array([((t >= low) & (t < high)).all(axis=1).sum() for t in drawn])
        wanted = process.expected(np.array(low, float), np.array(high, float))
        assert abs(counts.mean() - wanted) < 0.02 * wanted + 4 * counts.std(ddof=1) / np.sqrt(8)


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
    with pytest.raises(SpecError, match="cannot be used with"):
        Planting(species="maple", expected=60, layout=layout, exact=True)


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
    from forest_addon.growth.library import find_species, load_species
    from forest_addon.site import ForestSite
    from forest_addon.spec import Scene
    from forest_addon.stand.compose import Inputs, TreeList

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
