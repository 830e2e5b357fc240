"""Kernel estimates against the direct sum, and against the intensities that points were drawn from."""

import numpy as np
import pytest
from references.point_pattern import kernel_direct

from forest_addon.base.rng import stream
from forest_addon.stand.intensity.functions import Mixture
from forest_addon.stand.layouts import Process, sample
from forest_addon.stand.statistics.intensity import Window, choose_bandwidth, kernel_estimate

FIELD = Window.rectangle((0, 0), (100, 80))
UTM = np.array([432_100.0, 5_612_300.0])
HILLS = Mixture(
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


@pytest.mark.medium
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


@pytest.mark.slow
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
    process = Process(HILLS, FIELD.low, FIELD.high)
    return process.scaled(count / process.expected())


def _error(points, process, bandwidth=None):
    """Integrated squared error over that of λ."""
    at = middles(1.0)
    law = process.at(at)
    return ((kernel_estimate(points, FIELD, bandwidth).at(at) - law) ** 2).sum() / (law**2).sum()
