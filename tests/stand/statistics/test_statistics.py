"""K, L, quadrats and envelopes against closed forms, a direct sum and their own laws."""

import numpy as np
import pytest
from references.point_pattern import k_direct, kernel_direct
from scipy import integrate, stats

from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Clusters, Forest, Gaussian, Planting, Scene, SpecError, Strauss
from forest_addon.stand.compose import Inputs, process_of
from forest_addon.stand.intensity.functions import Constant, Mixture, Sum
from forest_addon.stand.layouts import Process, sample
from forest_addon.stand.plan import Spacing, draw_places, space
from forest_addon.stand.statistics.intensity import (
    Window,
    choose_bandwidth,
    fit_mixture,
    kernel_estimate,
    refit,
)
from forest_addon.stand.statistics.law import (
    TestedLaw,
    choose_quadrats,
    choose_radii,
    envelope,
    examine,
    inhomogeneous_k,
    integrate_by_quadrat,
    law_of,
    quadrat_test,
    region_of,
)
from headless.commands.estimate import estimate_site

FIELD = Window.rectangle((0, 0), (100, 80))
NOTCHED = Window(
    (
        np.array([[0, 0], [100, 0], [90, 80], [40, 95], [0, 55.0]]),
        np.array([[20, 20], [40, 20], [40, 40], [20, 30.0]]),
    )
)
UTM = np.array([432_100.0, 5_612_300.0])


def slope(points):
    """λ of the test forests: rises e-fold in 40 m."""
    return 0.02 * np.exp(points[:, 0] / 40)


def forest(*key, window=FIELD, factor=1.0):
    """A Poisson forest with that λ."""
    rng = stream(7, *key)
    top = 0.02 * factor * np.exp(window.high[0] / 40)
    count = rng.poisson(top * np.prod(window.extent))
    points = window.low + window.extent * rng.random((count, 2))
    kept = rng.random(count) * top < factor * slope(points)
    return points[kept & window.contains(points)]


def spaced():
    """A dense forest of which trees are kept that are the oldest within 2 m."""
    points = forest("spaced", factor=3.0)
    mark, none = stream(2, "mark").random(len(points)), np.zeros(len(points), dtype=int)
    apart = Spacing(np.array([[2.0]]), none, np.zeros(len(points)))
    return points[space(points, mark, apart, "matern")]


def flat(points):
    return np.ones(len(points))


def test_the_edge_correction_on_an_example_by_hand():
    # Two trees 3 m apart along x and 4 m along y in 10 m by 8 m: |W ∩ (W + h)| = 7·4, and the pair counts
    # once from either end, 2 / (λ² · 28).
    window = Window.rectangle((0, 0), (10, 8))
    points = np.array([[1.0, 2.0], [4.0, 6.0]])
    at = np.array([4.9, 5.0, 9.0])
    found = inhomogeneous_k(points, np.array([0.5, 0.25]), window, at, renormalise=False)
    assert found.value == pytest.approx([0, 2 / (0.125 * 28), 2 / (0.125 * 28)])
    assert found.pairs == 1
    assert found.l_function == pytest.approx(np.sqrt(found.value / np.pi))
    # Renormalised it is |W|² / |W ∩ (W + h)|, whatever λ is.
    again = inhomogeneous_k(points, np.array([0.5, 0.25]), window, at)
    assert again.value == pytest.approx([0, 80**2 / 28, 80**2 / 28])


def test_it_is_the_direct_sum():
    points = forest("direct")[:150]
    points[3] = points[4]  # two trees at one place
    radius = np.array([0.5, 2.0, 7.0, 20.0])
    direct = k_direct(points, slope(points), FIELD.low, FIELD.high, radius)
    found = inhomogeneous_k(points, slope(points), FIELD, radius, renormalise=False)
    assert found.value == pytest.approx(direct, rel=1e-12)
    moved = inhomogeneous_k(
        points + UTM,
        slope(points),
        Window.rectangle(FIELD.low + UTM, FIELD.high + UTM),
        radius,
        renormalise=False,
    )
    assert moved.value == pytest.approx(direct, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("window", "renormalise"), [(FIELD, False), (NOTCHED, True)])
def test_k_of_a_poisson_forest_is_pi_r_squared(window, renormalise):
    radius = np.array([2.0, 5.0, 12.0])
    found = []
    for seed in range(100):
        points = forest("law", seed, window=window)
        k = inhomogeneous_k(points, slope(points), window, radius, renormalise=renormalise)
        found.append(k.value / (np.pi * radius**2))
    found = np.array(found)
    # Three radii at 4.5 sigma, false alarm 2e-5; the polygon's table adds 1e-3, renormalising 1/n.
    room = 4.5 * found.std(axis=0) / np.sqrt(len(found)) + 3e-3
    assert (np.abs(found.mean(axis=0) - 1) < room).all()


def test_clusters_and_spacing_show():
    radius = np.array([1.0, 3.0])
    parents = forest("parents")[:120]
    daughters = np.repeat(parents, 5, axis=0)
    daughters = daughters + stream(1, "daughters").normal(0, 0.7, daughters.shape)
    daughters = daughters[FIELD.contains(daughters)]
    k = inhomogeneous_k(daughters, slope(daughters), FIELD, radius)
    assert (k.l_function > 1.3 * radius).all()
    kept = spaced()
    assert inhomogeneous_k(kept, slope(kept), FIELD, radius).value[0] == 0


def test_what_k_cannot_use_is_refused():
    points = np.array([[1.0, 2.0], [3.0, 4.0]])
    for bad in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match=r"not positive at the tree at \(3, 4\)"):
            inhomogeneous_k(points, np.array([1.0, bad]), FIELD, np.array([1.0]))
    with pytest.raises(ValueError, match="at least 2 trees, there are 1"):
        inhomogeneous_k(points[:1], np.ones(1), FIELD, np.array([1.0]))


@pytest.mark.medium
def test_radii_hold_a_bounded_number_of_neighbours():
    rng = stream(3, "radii")
    for points in (
        rng.uniform([0, 0], [100, 80], (20_000, 2)),
        np.clip(rng.normal(50, 0.5, (5000, 2)), 0, 80),
        np.full((500, 2), 7.0),
    ):
        radius = choose_radii(points, FIELD)
        assert (np.diff(radius) > 0).all()
        assert radius[0] > 0
        k = inhomogeneous_k(points, np.ones(len(points)), FIELD, radius)
        assert k.pairs < 60 * len(points) or (points == 7).all()


def test_integrals_over_quadrats():
    cells = integrate_by_quadrat(slope, FIELD, (4, 5))
    edges = np.arange(0, 101, 20)
    law = 0.02 * 40 * np.diff(np.exp(edges / 40)) * 20
    assert cells == pytest.approx(np.tile(law, (4, 1)), rel=1e-4)
    assert integrate_by_quadrat(flat, NOTCHED, (6, 7)).sum() == pytest.approx(
        NOTCHED.area, rel=1e-3
    )


@pytest.mark.medium
@pytest.mark.parametrize("window", [FIELD, NOTCHED], ids=["rectangle", "polygon with a hole"])
def test_p_values_of_the_quadrat_test_are_uniform(window):
    law = integrate_by_quadrat(slope, window, (6, 8))
    tests = [quadrat_test(forest("quadrat", s, window=window), law, window) for s in range(300)]
    assert all(test.count.sum() > 200 and test.classes > 20 for test in tests)
    # Kolmogorov-Smirnov at 1e-4; χ² itself holds to about 1 % with five expected trees a class.
    assert stats.kstest([test.p_value for test in tests], "uniform").pvalue > 1e-4


def test_the_quadrat_test_sees_a_wrong_intensity_and_too_even_a_stand():
    points = forest("wrong")
    shape = choose_quadrats(len(points), FIELD)
    assert 8 < len(points) / np.prod(shape) < 13
    even, rising = (integrate_by_quadrat(at, FIELD, shape) for at in (flat, slope))
    assert quadrat_test(points, rising, FIELD).p_value > 1e-3
    assert quadrat_test(points, even, FIELD).p_value < 1e-6
    orchard = np.stack(np.meshgrid(np.arange(1.0, 100, 2), np.arange(1.0, 80, 2)), -1).reshape(
        -1, 2
    )
    planted = quadrat_test(orchard, even, FIELD)
    assert planted.statistic < planted.classes / 2
    assert planted.p_value < 1e-6
    few = quadrat_test(points[:4], even, FIELD)
    assert few.classes == 1
    assert np.isnan(few.p_value)


@pytest.mark.medium
def test_the_global_envelope_keeps_its_level():
    # Curves of one law: the observed one lies outside with probability 2/40 exactly. 4000 trials have a
    # standard deviation of 0.0034; 4.5 sigma, false alarm 7e-6.
    rng = stream(4, "envelope")
    outside = 0
    for _ in range(4000):
        curves = np.cumsum(rng.standard_normal((40, 12)), axis=1)
        outside += not envelope(curves[0], curves[1:]).inside
    assert abs(outside / 4000 - 0.05) < 4.5 * np.sqrt(0.05 * 0.95 / 4000)


def test_pointwise_envelopes_hold_at_one_radius_and_not_at_all():
    rng = stream(5, "envelope")
    missed = np.zeros(12)
    anywhere = 0
    for _ in range(2000):
        curves = rng.standard_normal((40, 12))
        bands = envelope(curves[0], curves[1:])
        out = (bands.observed < bands.low) | (bands.observed > bands.high)
        missed += out
        anywhere += out.any()
    # 2/40 at each of 12 radii at 5 sigma, false alarm 7e-6.
    assert np.abs(missed / 2000 - 0.05).max() < 5 * np.sqrt(0.05 * 0.95 / 2000)
    assert anywhere / 2000 > 0.4  # which is why there is a global one


def test_an_envelope_agrees_with_its_p_value():
    rng = stream(6, "envelope")
    for shift in (0.0, 1.0, 5.0):
        curves = rng.standard_normal((40, 8))
        bands = envelope(curves[0] + shift, curves[1:])
        strays = (bands.observed < bands.global_low) | (bands.observed > bands.global_high)
        assert bands.inside or (strays | np.isclose(bands.observed, bands.global_high)).any()
        assert bands.inside == (bands.p_value > 0.05)
    still = envelope(np.zeros(8), np.zeros((39, 8)))
    assert still.inside
    with pytest.raises(ValueError, match="at least 19"):
        envelope(np.zeros(3), np.zeros((5, 3)))


def test_a_region_is_where_the_intensity_is_not_small():
    region = region_of(slope, FIELD)
    assert region.area == pytest.approx(FIELD.area)  # e^2.5 is not small enough
    shift = np.array([[0.0, 0.0], [10.0, 5.0], [-33.3, 41.7]])
    assert region.set_covariance(shift) == pytest.approx(FIELD.set_covariance(shift), rel=1e-12)

    def hill(points):
        return np.exp(-(((points - [50, 40]) / 15) ** 2).sum(axis=1))

    region = region_of(hill, FIELD)
    # Half the peak is the mean over trees; a circle of radius 15·√ln 20 and its lens with itself moved.
    radius = 15 * np.sqrt(np.log(20))
    assert region.area == pytest.approx(np.pi * radius**2, rel=0.02)
    lens = 2 * radius**2 * np.arccos(10 / radius) - 10 * np.sqrt(4 * radius**2 - 400)
    assert region.set_covariance(np.array([[20.0, 0.0]]))[0] == pytest.approx(lens, rel=0.02)
    places = np.array([[50.0, 40.0], [50.0 + radius - 1, 40.0], [50.0 + radius + 1, 40.0]])
    assert region.contains(places).tolist() == [True, True, False]


@pytest.mark.medium
def test_a_forest_of_the_law_passes_and_another_does_not():
    known = TestedLaw(lambda k: forest("known", k), lambda trees: (slope(trees), slope))
    passed = [examine(forest("passed", s), FIELD, known) for s in range(3)]
    # Each fails with probability 1/40 at p = 0.025: all three 2e-5.
    assert any(found.excess.p_value > 0.025 for found in passed)
    assert all(found.radius[-1] <= 20 for found in passed)
    found = examine(spaced(), FIELD, known)
    assert found.excess.p_value == 1 / 40
    assert found.excess.observed[0] < found.excess.global_low[0]
    assert examine(spaced()[:9], FIELD, known) is None


@pytest.mark.slow
def test_an_estimate_is_tested_fairly():
    # The intensity of every simulation is estimated again, so p is nearly uniform; all of 3 forests have p at
    # most 0.1 with probability 1e-3.
    found = []
    for seed in range(3):
        points = forest("fair", seed, factor=0.25)
        fit = fit_mixture(points, FIELD)
        simulate = [forest("fair simulation", seed, k, factor=0.25) for k in range(19)]
        law = law_of(fit, simulate.__getitem__)
        found.append(examine(points, FIELD, law, simulations=19).excess.p_value)
    assert max(found) > 0.3


# -------------------------------------------------------------------------------------------- choose
# A map that was drawn by a law is given that law, and a scene of it stands like the map.

EVEN = Planting(species="maple", expected=150)
HILLS = Planting(
    species="maple",
    expected=150,
    gaussians=(
        Gaussian(peak=1.0, centre=(21.0, 28.0), width=(12.0, 12.0)),
        Gaussian(peak=0.7, centre=(53.0, 49.0), width=(15.0, 9.0)),
    ),
)
CLUSTERS = Clusters(groups=0.006, spread=1.5)
MADE = {  # a planting and the side of its field
    "hills": (HILLS, 70),
    # 43 groups in the window; of which shape they are, 220 trees hardly say.
    "groups": (EVEN.changed(expected=220, layout="clusters", clusters=CLUSTERS), 85),
    "apart": (
        EVEN.changed(expected=90, layout="strauss", strauss=Strauss(radius=3.0, gamma=0.05)),
        47,
    ),
}


def mapped(planting, side, path):
    """A CSV of trees that this planting draws."""
    process = process_of(planting, Forest(size=(side, side)), Inputs())
    points = draw_places(planting, process, stream(5, "a map"))
    path.write_text("x,y\n" + "".join(f"{x:.3f},{y:.3f}\n" for x, y in points))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("made", MADE)
def test_the_law_of_a_map_is_found_again(tmp_path, made, monkeypatch):
    planting, side = MADE[made]
    if made != "apart":  # chance rejects a law in 5 % of maps, by as few simulations as by 39
        monkeypatch.setattr("forest_addon.stand.statistics.law.SIMULATIONS", 19)
    said = []
    scene = estimate_site(
        mapped(planting, side, tmp_path / "map.csv"),
        tmp_path / "like.toml",
        window=["0", "0", str(side), str(side)],
        species=["maple"],
        say=said.append,
    )
    (found,) = read_settings(scene, Scene).plantings
    assert found.layout == planting.layout
    assert len(found.gaussians) == len(planting.gaussians)
    if made == "groups":
        assert np.isclose(found.clusters.groups, 0.006, rtol=0.5)
        assert np.isclose(found.clusters.spread, 1.5, rtol=0.5)
        assert "tried too: poisson" in "\n".join(said)
    if made == "apart":
        assert np.isclose(found.strauss.radius, 3.0, rtol=0.25)
        assert found.strauss.gamma < 0.3


def test_a_law_that_does_not_fit_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("forest_addon.stand.statistics.law.SIMULATIONS", 19)
    rows = "".join(f"{x},{y}\n" for x in range(2, 40, 4) for y in range(2, 40, 4))
    (tmp_path / "grid.csv").write_text("x,y\n" + rows)
    with pytest.raises(SpecError, match=r"--law: .*a kernel estimate is Poisson"):
        estimate_site(
            tmp_path / "grid.csv", tmp_path / "s.toml", "kernel", species=["maple"], law="thomas"
        )
    (tmp_path / "three.csv").write_text("x,y\n1,1\n5,5\n")
    with pytest.raises(SpecError, match="show no groups at any distance; leave --law out"):
        estimate_site(tmp_path / "three.csv", tmp_path / "s.toml", species=["maple"], law="matern")


# ------------------------------------------------------------------------------------------ mixture
# Fitted mixtures against the intensities that points were drawn from.

SQUARE = Window.rectangle((0, 0), (100, 100))
CUT = Window((np.array([[0, 0], [100, 0], [90, 80], [40, 95], [0, 55.0]]),))
TWO_HILLS = Mixture(  # the second reaches over the edge
    np.array([1.0, 1.6]),
    np.array([[30.0, 30.0], [85.0, 60.0]]),
    np.array([[20.0, 15.0], [22.0, 35.0]]),
)


def drawn(intensity, count, *key):
    process = Process(intensity, np.zeros(2), np.full(2, 100.0))
    process = process.scaled(count / process.expected)
    return sample(process, stream(0, *key)), process


def relative_error(fit, process):
    x, y = np.meshgrid(np.arange(0.5, 100), np.arange(0.5, 100))
    at = np.column_stack([x.ravel(), y.ravel()])
    law = process.at(at)
    return ((fit.at(at) - law) ** 2).sum() / (law**2).sum()


@pytest.mark.medium
def test_it_finds_the_hills_also_that_beyond_the_edge():
    points, process = drawn(TWO_HILLS, 4_000, "found")
    points = points[CUT.contains(points)]
    fit = fit_mixture(points, CUT)
    assert len(fit.peak) == 2
    order = np.argsort(fit.centre[:, 0])
    # Standard errors at 4,000 trees: 0.7 m of centres, 3 % of widths and peaks; bounds at 4 of them.
    assert fit.centre[order] == pytest.approx(TWO_HILLS.centre, abs=2.8)
    assert fit.width[order] == pytest.approx(TWO_HILLS.width, rel=0.12)
    assert fit.peak[order] == pytest.approx(TWO_HILLS.peak * process.factor, rel=0.12)
    assert fit.expected == pytest.approx(len(points), rel=1e-9)


@pytest.mark.medium
def test_it_is_a_maximum_of_the_likelihood():
    points, _ = drawn(TWO_HILLS, 800, "maximum")
    fit = fit_mixture(points, SQUARE)

    def likelihood(**changed):
        other = type(fit)(**{**vars(fit), **changed})
        return np.log(other.at(points)).sum() - other.expected

    best = likelihood()
    assert best == pytest.approx(fit.log_likelihood, abs=1e-6)
    for name in ("peak", "centre", "width"):
        value = getattr(fit, name)
        for index in np.ndindex(value.shape):
            for factor in (0.99, 1.01):
                moved = value.copy()
                moved[index] *= factor
                assert likelihood(**{name: moved}) < best


@pytest.mark.medium
def test_trees_that_stand_evenly_or_in_an_orchard_get_no_hill():
    # BIC takes one hill of 5 parameters for chance with probability about 1 %: 3 of 6 has 2e-5.
    even = [fit_mixture(drawn(Constant(1.0), 300, "even", s)[0], SQUARE) for s in range(6)]
    assert sum(len(fit.peak) > 0 for fit in even) <= 2
    orchard = np.stack(np.meshgrid(np.arange(2.5, 100, 5), np.arange(2.5, 100, 5)), -1)
    fit = fit_mixture(orchard.reshape(-1, 2), SQUARE)
    assert len(fit.peak) == 0
    assert fit.base == pytest.approx(400 / 1e4)


@pytest.mark.medium
def test_hills_on_a_base():
    on_base = Sum(
        (Constant(0.2), Mixture(np.array([2.0]), np.array([[60.0, 40.0]]), np.full((1, 2), 8)))
    )
    points, process = drawn(on_base, 3000, "base")
    fit = fit_mixture(points, SQUARE)
    assert len(fit.peak) == 1
    assert fit.base == pytest.approx(0.2 * process.factor, rel=0.1)
    assert relative_error(fit, process) < 0.01


@pytest.mark.slow
def test_order_and_place_of_the_map_do_not_matter(monkeypatch):
    monkeypatch.setattr("forest_addon.stand.statistics.intensity.SKETCH", 600)
    points, _ = drawn(TWO_HILLS, 900, "order")  # more than the sketch
    fit = fit_mixture(points, SQUARE)
    again = fit_mixture(points[stream(1, "order").permutation(len(points))], SQUARE)
    assert (again.centre == fit.centre).all()
    there = fit_mixture(points + UTM, Window.rectangle(UTM, UTM + 100))
    assert there.centre - UTM == pytest.approx(fit.centre, abs=1e-3)
    assert there.width == pytest.approx(fit.width, rel=1e-4)


@pytest.mark.medium
def test_refitting_gives_the_same_fit():
    points, _ = drawn(TWO_HILLS, 1000, "refit")
    fit = fit_mixture(points, SQUARE)
    again = refit(fit, points)
    assert again.log_likelihood == pytest.approx(fit.log_likelihood, abs=1e-3)
    assert again.expected == pytest.approx(len(points))


@pytest.mark.medium
@pytest.mark.parametrize(
    ("points", "hills"),
    [
        (np.empty((0, 2)), 0),
        ([[3.0, 4.0]], 0),
        ([[3.0, 4.0]] * 5, 0),
        ([[3.0, 4.0]] * 50, 1),
        ([[float(x), 40.0] for x in np.linspace(1, 99, 200)], 1),
        (np.repeat([[20.0, 20.0], [70.0, 60.0]], 30, axis=0), 2),
    ],
    ids=["none", "one", "five at one place", "fifty at one place", "collinear", "two places"],
)
def test_hard_cases(points, hills):
    points = np.array(points)
    fit = fit_mixture(points, SQUARE)
    assert len(fit.peak) == hills
    assert fit.expected == pytest.approx(len(points), rel=1e-6)
    for values in (fit.base, fit.peak, fit.centre, fit.width):
        assert np.isfinite(values).all()
    assert (fit.width > 0).all()


def test_a_given_number_of_hills():
    points, _ = drawn(TWO_HILLS, 500, "given")
    for hills in (0, 1, 3):
        assert len(fit_mixture(points, SQUARE, hills).peak) == hills
    with pytest.raises(ValueError, match="3 hills need at least 18 trees, there are 2"):
        fit_mixture(points[:2], SQUARE, 3)
    with pytest.raises(ValueError, match="outside the window"):
        fit_mixture(points + 50, SQUARE)


# -------------------------------------------------------------------------------------------- kernel
# Kernel estimates against the direct sum, and against the intensities that points were drawn from.

KERNEL_HILLS = Mixture(
    np.array([1.0, 1.6]),
    np.array([[40.0, 40.0], [65.0, 55.0]]),
    np.array([[14.0, 10.0], [10.0, 12.0]]),
)


def middles(step):
    x, y = np.meshgrid(np.arange(step / 2, 100, step), np.arange(step / 2, 80, step))
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.mark.parametrize("sigma", [1.0, 6.0, 60.0])
def test_it_is_the_direct_sum_with_the_edge_correction(sigma):
    points = stream(1, "kernel").uniform([0, 0], [100, 80], (60, 2))
    points[:4] = points[4]  # a tree that was entered five times
    found = kernel_estimate(points, FIELD, sigma)
    places = np.vstack([points, [[0, 0], [100, 80], [50, 0.3]]])
    direct = [kernel_direct(p, points, FIELD.low, FIELD.high, sigma) for p in places]
    left = [kernel_direct(p, points, FIELD.low, FIELD.high, sigma, skip=True) for p in points]
    # Pixels of σ/4 or finer cost at most 2 % of the peak of one tree.
    allowed = 0.02 * np.max(direct)
    assert found.at(places) == pytest.approx(direct, abs=allowed)
    assert found.leave_one_out == pytest.approx(left, abs=allowed)


@pytest.mark.parametrize(
    "window",
    [FIELD, Window((np.array([[0, 0], [100, 0], [90, 80], [0, 60.0]]),))],
    ids=["rectangle", "polygon"],
)
def test_every_tree_counts_once_however_near_the_edge(window):
    points = stream(2, "kernel").uniform([0, 0], [100, 80], (300, 2))
    points = points[window.contains(points)]
    for sigma in (0.5, 5.0, 50.0):
        found = kernel_estimate(points, window, sigma)
        assert found.expected == pytest.approx(len(points), rel=1e-9)
        assert found.value.min() >= 0
    assert kernel_estimate(points, window, 5.0).at(np.array([[200.0, 5.0]])).tolist() == [0.0]


@pytest.mark.medium
def test_far_from_the_origin_it_is_the_same():
    points = stream(3, "kernel").uniform([0, 0], [100, 80], (200, 2))
    there = Window.rectangle(FIELD.low + UTM, FIELD.high + UTM)
    moved = kernel_estimate(points + UTM, there)
    here = kernel_estimate(points, FIELD)
    assert moved.bandwidth == pytest.approx(here.bandwidth, rel=1e-6)
    assert moved.at(points + UTM) == pytest.approx(here.at(points), rel=1e-5)


@pytest.mark.medium
def test_the_bandwidth_is_near_the_best_and_shrinks_with_more_trees():
    found = []
    for count in (300, 10_000):
        process = _process(count)
        points = sample(process, stream(4, "kernel"))
        found.append(choose_bandwidth(points, FIELD))
        error = _error(points, process, found[-1])
        # Not more than a fifth above the least error of any bandwidth.
        others = [_error(points, process, found[-1] * f) for f in (0.5, 0.7, 0.85, 1.2, 1.4, 2.0)]
        assert error < 1.2 * min(others)
    assert found[1] < 0.75 * found[0]  # n^(-1/6) would be 0.56


@pytest.mark.medium
def test_the_error_falls_at_the_rate_of_kernel_estimates():
    # MISE falls with n^(-2/3) in the plane where hills lie within the field. The slope from 200 to 1,600
    # trees, averaged over 4 samples, spreads by 0.08 about -0.65: bounds at 3 sigma.
    counts = (200, 1_600)
    errors = [
        np.mean([_error(sample(_process(n), stream(s, "rate")), _process(n)) for s in range(4)])
        for n in counts
    ]
    slope = np.log(errors[1] / errors[0]) / np.log(counts[1] / counts[0])
    assert -0.9 < slope < -0.4


@pytest.mark.medium
@pytest.mark.parametrize(
    "points",
    [
        [[3.0, 4.0]],
        [[3.0, 4.0]] * 20,
        [[3.0, 4.0], [3.0, 4.0], [60.0, 70.0]],
        [[float(x), 40.0] for x in range(0, 100, 5)],
        [[0.0, 0.0], [100.0, 80.0]],
    ],
    ids=["one", "identical", "two places", "collinear", "corners"],
)
def test_hard_cases_stay_finite_and_keep_their_number(points):
    points = np.array(points)
    found = kernel_estimate(points, FIELD)
    assert found.bandwidth > 0
    assert np.isfinite(found.value).all()
    assert found.expected == pytest.approx(len(points), rel=1e-9)


def test_what_cannot_be_used_is_refused():
    with pytest.raises(ValueError, match="at least one tree"):
        kernel_estimate(np.empty((0, 2)), FIELD)
    with pytest.raises(ValueError, match="outside the window"):
        kernel_estimate(np.array([[5.0, 90.0]]), FIELD)
    with pytest.raises(ValueError, match="larger than 0"):
        kernel_estimate(np.array([[5.0, 9.0]]), FIELD, 0.0)


def _process(count):
    process = Process(KERNEL_HILLS, FIELD.low, FIELD.high)
    return process.scaled(count / process.expected)


def _error(points, process, bandwidth=None):
    """Integrated squared error over that of λ."""
    at = middles(1.0)
    law = process.at(at)
    return ((kernel_estimate(points, FIELD, bandwidth).at(at) - law) ** 2).sum() / (law**2).sum()


# -------------------------------------------------------------------------------------------- window
# The window against closed forms and numerical integration.

TRIANGLE = Window((np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]]),))
HOLED = Window(
    (
        np.array([[0, 0], [10, 0], [10, 8], [4, 9], [0, 5.0]]),
        np.array([[2, 2], [4, 2], [4, 4.0], [2, 3]]),
    )
)


@pytest.mark.parametrize(
    ("centre", "deviation"), [((1.0, 0.5), (0.7, 1.1)), ((-2.0, 4.0), (2.0, 1.5)), ((9, 9), (1, 3))]
)
def test_moments_of_a_gaussian_over_a_triangle(centre, deviation):
    mass, first, second = TRIANGLE.gaussian_moments(np.array([centre]), np.array([deviation]))

    def moment(power_x, power_y):
        def of(y, x):
            z = (x - centre[0]) / deviation[0], (y - centre[1]) / deviation[1]
            density = np.exp(-(z[0] ** 2 + z[1] ** 2) / 2) / (2 * np.pi * np.prod(deviation))
            return z[0] ** power_x * z[1] ** power_y * density

        return integrate.dblquad(of, 0, 3, 0, lambda x: 3 - x, epsabs=1e-9, epsrel=1e-9)[0]

    assert mass[0] == pytest.approx(moment(0, 0), abs=1e-9)
    assert first[0] == pytest.approx([moment(1, 0), moment(0, 1)], abs=1e-9)
    assert second[0] == pytest.approx([moment(2, 0), moment(0, 2)], abs=1e-9)


def test_a_hole_takes_its_part_away():
    outline, hole = Window(HOLED.rings[:1]), Window(HOLED.rings[1:])
    of = (np.array([[3.0, 3.0], [-1.0, 6.0]]), np.array([[1.0, 2.0], [3.0, 0.5]]))
    whole = zip(outline.gaussian_moments(*of), hole.gaussian_moments(*of), strict=True)
    for both, kept in zip(whole, HOLED.gaussian_moments(*of), strict=True):
        assert kept == pytest.approx(both[0] - both[1], abs=1e-14)
    assert HOLED.area == pytest.approx(outline.area - hole.area)


def test_the_whole_mass_and_none_of_it():
    window = Window.rectangle((0, 0), (100, 100))
    centre = np.array([[50.0, 50.0], [1e4, 50.0], [0.0, 30.0], [0.0, 0.0]])
    mass = window.gaussian_moments(centre, np.full((4, 2), 0.5))[0]
    assert mass == pytest.approx([1, 0, 0.5, 0.25], abs=1e-14)


def test_orientation_and_place_do_not_matter():
    turned = Window(tuple(ring[::-1] + UTM for ring in HOLED.rings))
    assert turned.area == pytest.approx(HOLED.area, rel=1e-9)
    points = stream(1, "window").uniform(0, 10, (2000, 2))
    assert (turned.contains(points + UTM) == HOLED.contains(points)).all()
    of = np.array([[3.0, 3.0]]), np.array([[1.0, 2.0]])
    there = turned.gaussian_moments(of[0] + UTM, of[1])
    assert there[0] == pytest.approx(HOLED.gaussian_moments(*of)[0], abs=1e-8)


def test_corners_and_edges_are_inside():
    corners = np.concatenate(HOLED.rings) + UTM
    window = Window(tuple(ring + UTM for ring in HOLED.rings))
    assert window.contains(np.vstack([corners, (corners[:1] + corners[1:2]) / 2])).all()
    away = np.array([[-1e-3, 2.0], [3.0, 2.5], [5.0, -1e-3], [20.0, 0.0]]) + UTM
    assert not window.contains(away).any()


def test_coverage_adds_up_to_the_area():
    for window in (TRIANGLE, HOLED):
        cover = window.coverage((50, 40))
        assert cover.mean() * window.extent.prod() == pytest.approx(window.area, rel=1e-3)
        assert cover.min() >= -1e-12
        assert cover.max() <= 1 + 1e-12


@pytest.mark.medium
def test_set_covariance():
    x, y = shift = stream(2, "window").uniform(-2, 2, (200, 2)).T
    # Two right triangles, one moved, overlap in a right triangle.
    side = np.minimum(3, 3 + x + y) - np.maximum(x, 0) - np.maximum(y, 0)
    overlap = np.maximum(side, 0) ** 2 / 2
    assert np.abs(TRIANGLE.set_covariance(shift.T) - overlap).max() < 1e-3 * TRIANGLE.area
    window = Window.rectangle((5, 5), (8, 9))
    found = window.set_covariance(np.array([[1.0, -1.0], [0.0, 0.0], [3.5, 0.0]]))
    assert found.tolist() == [6.0, 12.0, 0.0]


@pytest.mark.medium
def test_the_rectangle_around_points_has_the_right_area_on_average():
    # Uniform points: the widened box has the mean area 1, by Ripley & Rasson. Each area has a standard
    # deviation below 1; 4.5 sigma, false alarm 7e-6.
    rng = stream(3, "around")
    areas = [Window.around(100 * rng.random((6, 2))).area / 1e4 for _ in range(4000)]
    assert abs(np.mean(areas) - 1) < 4.5 * np.std(areas) / np.sqrt(len(areas))
    assert Window.around(np.array([[7.0, 7.0]])).extent.tolist() == [1, 1]
    with pytest.raises(ValueError, match="no points"):
        Window.around(np.empty((0, 2)))


@pytest.mark.parametrize(
    "ring",
    [
        [[0, 0], [1, 1]],
        [[0, 0], [1, 1], [2, 2]],
        [[0, 0], [4, 4], [4, 0], [0, 3]],
        [[0, 0], [1, np.nan], [1, 0]],
    ],
)
def test_a_window_without_an_inside_is_refused(ring):
    with pytest.raises(ValueError, match=r"area|cross|finite"):
        Window((np.array(ring, dtype=float),))
