"""Fitted mixtures against the intensities that points were drawn from."""

import numpy as np
import pytest
from references.point_pattern import kernel_direct
from scipy import integrate

from forest_addon.base.rng import stream
from forest_addon.stand.intensity.functions import Constant, Mixture, Sum
from forest_addon.stand.layouts import Process, sample
from forest_addon.stand.statistics.intensity import (
    Window,
    choose_bandwidth,
    fit_mixture,
    kernel_estimate,
    refit,
)

FIELD = Window.rectangle((0, 0), (100, 100))
NOTCHED = Window((np.array([[0, 0], [100, 0], [90, 80], [40, 95], [0, 55.0]]),))
UTM = np.array([432_100.0, 5_612_300.0])
HILLS = Mixture(  # the second reaches over the edge
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
    points, process = drawn(HILLS, 4_000, "found")
    points = points[NOTCHED.contains(points)]
    fit = fit_mixture(points, NOTCHED)
    assert len(fit.peak) == 2
    order = np.argsort(fit.centre[:, 0])
    # Standard errors at 4,000 trees: 0.7 m of centres, 3 % of widths and peaks; bounds at 4 of them.
    assert fit.centre[order] == pytest.approx(HILLS.centre, abs=2.8)
    assert fit.width[order] == pytest.approx(HILLS.width, rel=0.12)
    assert fit.peak[order] == pytest.approx(HILLS.peak * process.factor, rel=0.12)
    assert fit.expected == pytest.approx(len(points), rel=1e-9)


@pytest.mark.medium
def test_it_is_a_maximum_of_the_likelihood():
    points, _ = drawn(HILLS, 800, "maximum")
    fit = fit_mixture(points, FIELD)

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
    even = [fit_mixture(drawn(Constant(1.0), 300, "even", s)[0], FIELD) for s in range(6)]
    assert sum(len(fit.peak) > 0 for fit in even) <= 2
    orchard = np.stack(np.meshgrid(np.arange(2.5, 100, 5), np.arange(2.5, 100, 5)), -1)
    fit = fit_mixture(orchard.reshape(-1, 2), FIELD)
    assert len(fit.peak) == 0
    assert fit.base == pytest.approx(400 / 1e4)


@pytest.mark.medium
def test_hills_on_a_base():
    on_base = Sum(
        (Constant(0.2), Mixture(np.array([2.0]), np.array([[60.0, 40.0]]), np.full((1, 2), 8)))
    )
    points, process = drawn(on_base, 3000, "base")
    fit = fit_mixture(points, FIELD)
    assert len(fit.peak) == 1
    assert fit.base == pytest.approx(0.2 * process.factor, rel=0.1)
    assert relative_error(fit, process) < 0.01


@pytest.mark.slow
def test_order_and_place_of_the_map_do_not_matter(monkeypatch):
    monkeypatch.setattr("forest_addon.stand.statistics.intensity.SKETCH", 600)
    points, _ = drawn(HILLS, 900, "order")  # more than the sketch
    fit = fit_mixture(points, FIELD)
    again = fit_mixture(points[stream(1, "order").permutation(len(points))], FIELD)
    assert (again.centre == fit.centre).all()
    there = fit_mixture(points + UTM, Window.rectangle(UTM, UTM + 100))
    assert there.centre - UTM == pytest.approx(fit.centre, abs=1e-3)
    assert there.width == pytest.approx(fit.width, rel=1e-4)


@pytest.mark.medium
def test_refitting_gives_the_same_fit():
    points, _ = drawn(HILLS, 1000, "refit")
    fit = fit_mixture(points, FIELD)
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
    fit = fit_mixture(points, FIELD)
    assert len(fit.peak) == hills
    assert fit.expected == pytest.approx(len(points), rel=1e-6)
    for values in (fit.base, fit.peak, fit.centre, fit.width):
        assert np.isfinite(values).all()
    assert (fit.width > 0).all()


def test_a_given_number_of_hills():
    points, _ = drawn(HILLS, 500, "given")
    for hills in (0, 1, 3):
        assert len(fit_mixture(points, FIELD, hills).peak) == hills
    with pytest.raises(ValueError, match="3 hills need at least 18 trees, there are 2"):
        fit_mixture(points[:2], FIELD, 3)
    with pytest.raises(ValueError, match="outside the window"):
        fit_mixture(points + 50, FIELD)


# -------------------------------------------------------------------------------------------- kernel
# Kernel estimates against the direct sum, and against the intensities that points were drawn from.

KERNEL_FIELD = Window.rectangle((0, 0), (100, 80))
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
    found = kernel_estimate(points, KERNEL_FIELD, sigma)
    places = np.vstack([points, [[0, 0], [100, 80], [50, 0.3]]])
    direct = [kernel_direct(p, points, KERNEL_FIELD.low, KERNEL_FIELD.high, sigma) for p in places]
    left = [
        kernel_direct(p, points, KERNEL_FIELD.low, KERNEL_FIELD.high, sigma, skip=True)
        for p in points
    ]
    # Pixels of σ/4 or finer cost at most 2 % of the peak of one tree.
    allowed = 0.02 * np.max(direct)
    assert found.at(places) == pytest.approx(direct, abs=allowed)
    assert found.leave_one_out == pytest.approx(left, abs=allowed)


@pytest.mark.parametrize(
    "window",
    [KERNEL_FIELD, Window((np.array([[0, 0], [100, 0], [90, 80], [0, 60.0]]),))],
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
    there = Window.rectangle(KERNEL_FIELD.low + UTM, KERNEL_FIELD.high + UTM)
    moved = kernel_estimate(points + UTM, there)
    here = kernel_estimate(points, KERNEL_FIELD)
    assert moved.bandwidth == pytest.approx(here.bandwidth, rel=1e-6)
    assert moved.at(points + UTM) == pytest.approx(here.at(points), rel=1e-5)


@pytest.mark.medium
def test_the_bandwidth_is_near_the_best_and_shrinks_with_more_trees():
    found = []
    for count in (300, 10_000):
        process = _process(count)
        points = sample(process, stream(4, "kernel"))
        found.append(choose_bandwidth(points, KERNEL_FIELD))
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
    found = kernel_estimate(points, KERNEL_FIELD)
    assert found.bandwidth > 0
    assert np.isfinite(found.value).all()
    assert found.expected == pytest.approx(len(points), rel=1e-9)


def test_what_cannot_be_used_is_refused():
    with pytest.raises(ValueError, match="at least one tree"):
        kernel_estimate(np.empty((0, 2)), KERNEL_FIELD)
    with pytest.raises(ValueError, match="outside the window"):
        kernel_estimate(np.array([[5.0, 90.0]]), KERNEL_FIELD)
    with pytest.raises(ValueError, match="larger than 0"):
        kernel_estimate(np.array([[5.0, 9.0]]), KERNEL_FIELD, 0.0)


def _process(count):
    process = Process(KERNEL_HILLS, KERNEL_FIELD.low, KERNEL_FIELD.high)
    return process.scaled(count / process.expected)


def _error(points, process, bandwidth=None):
    """Integrated squared error over that of λ."""
    at = middles(1.0)
    law = process.at(at)
    return ((kernel_estimate(points, KERNEL_FIELD, bandwidth).at(at) - law) ** 2).sum() / (
        law**2
    ).sum()


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
