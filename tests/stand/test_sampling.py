"""Samples against their laws. Every statistical test states its false-alarm rate; seeds are fixed, so a
test that passes once passes always.
"""

from functools import cache

import numpy as np
import pytest
from scipy import stats

from forest_addon.base.rng import stream
from forest_addon.spec import Forest, Gaussian, Planting
from forest_addon.stand.compose import process_of
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
from forest_addon.stand.layouts import MAX_POINTS, BoundViolation, Process, sample

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
    return made.scaled(total / made.expected())


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_counts_in_rectangles_are_poisson(name):
    made, runs = process(name), 200
    samples = [sample(made, stream(s, "count", name)) for s in range(runs)]
    for low, high in [((0, 0), (60, 40)), ((5, 5), (30, 20)), ((15, 20), (52, 36))]:
        low, high = LOW + low, LOW + high
        counts = np.array([((p >= low) & (p < high)).all(axis=1).sum() for p in samples])
        mean = made.integral(low, high)
        # Mean and dispersion of 15 rectangles, 4.5 sigma each: false alarm below 2.1e-4.
        room = 4.5 * np.sqrt(mean.value / runs) + mean.error
        assert abs(counts.mean() - mean.value) < room
        dispersion = counts.var(ddof=1) / mean.value
        assert abs(dispersion - 1) < 4.5 * np.sqrt(2 / runs + 1 / (mean.value * runs))
    # The whole distribution by chi-square over its octiles: false alarm 1e-4 each, 5e-4 together.
    mean = made.expected()
    edges = np.unique(stats.poisson.ppf(np.arange(1, 8) / 8, mean))
    whole = np.array([len(p) for p in samples])
    observed = np.bincount(np.searchsorted(edges, whole), minlength=len(edges) + 1)
    expected = np.diff(stats.poisson.cdf([-1, *edges, 1e9], mean)) * runs
    assert stats.chisquare(observed, expected).pvalue > 1e-4


@cache
def marginals(name):
    """Cuts and cumulative shares of ∫λ along x and along y, by a midpoint sum on 1200 x 800 places."""
    x, y = (LOW[k] + (np.arange(n) + 0.5) * SIZE[k] / n for k, n in ((0, 1200), (1, 800)))
    value = process(name).at(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(800, 1200)
    found = []
    for axis, count in ((0, 1200), (1, 800)):
        share = np.append(0, np.cumsum(value.sum(axis=axis)))
        found.append((LOW[axis] + np.linspace(0, SIZE[axis], count + 1), share / share[-1]))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("exactly", [None, 40])
def test_positions_follow_the_intensity(name, exactly):
    """PIT of x and of y by their marginals; false alarm 1e-4 each, 2e-3 together."""
    made = process(name)
    points = np.concatenate([sample(made, stream(s, "pit", name), exactly) for s in range(150)])
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


@pytest.mark.medium
@pytest.mark.parametrize("name", KINDS)
def test_an_exact_number_is_exact(name):
    points = sample(process(name), stream(1, "exact"), 1234)
    assert len(points) == 1234
    assert ((points >= LOW) & (points <= LOW + SIZE)).all()


def test_one_pixel_that_is_not_zero_gets_all_trees():
    image = np.zeros((512, 512))
    image[100, 300] = 1
    made = Process(functions.RasterIntensity(image, LOW, SIZE), LOW, LOW + SIZE)
    points = sample(made.scaled(20_000 / made.expected()), stream(1, "pixel"))
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
    with pytest.raises(BoundViolation, match=r"at \(5\d+, 5.*e\+06\) is .* above its bound of"):
        for s in range(20):
            sample(low_bound, stream(s, "violated"))


@pytest.mark.parametrize("bad", [np.nan, -1.0])
def test_values_that_are_no_intensity_are_refused_with_their_place(bad):
    class Broken(Plain):
        def at(self, points):
            return np.where(points[:, 0] > LOW[0] + 30, bad, 1.0)

    with pytest.raises(IntensityError, match=f"is {bad:g} trees"):
        sample(Process(Broken(Constant(1.0)), LOW, LOW + SIZE), stream(0, "x"))


@pytest.mark.medium
@pytest.mark.parametrize("name", KINDS)
def test_too_many_trees_are_refused_with_the_number(name):
    with pytest.raises(IntensityError, match="300,000,000 trees, more than 20,000,000"):
        sample(process(name, 3e8), stream(0, "x"))
    assert MAX_POINTS == 20_000_000


def test_nothing_where_the_intensity_is_zero():
    empty = Process(functions.RasterIntensity(np.zeros((4, 4)), LOW, SIZE), LOW, LOW + SIZE)
    assert sample(empty, stream(0, "x")).shape == (0, 2)
    with pytest.raises(IntensityError, match="7 trees cannot stand"):
        sample(empty, stream(0, "x"), 7)


@pytest.mark.slow
def test_millions_of_points_stay_points_of_the_process():
    """The count, and the mean of x, at 5 sigma: false alarm 2e-6."""
    field = Forest(size=(3000.0, 3000.0))
    hill = Gaussian(centre=(1500.0, 1500.0), width=(300.0, 300.0))
    made = process_of(Planting(species="m", expected=2e6, gaussians=(hill,)), field)
    points = sample(made, stream(3, "many"))
    assert abs(len(points) - 2e6) < 5 * np.sqrt(2e6)
    assert abs(points[:, 0].mean() - 1500) < 5 * 300 / np.sqrt(4e6)


def test_sampling_does_not_depend_on_what_was_integrated_before():
    one, two = process("raster"), process("raster")
    two.integral(LOW, LOW + 5)
    assert (sample(one, stream(1, "a")) == sample(two, stream(1, "a"))).all()
