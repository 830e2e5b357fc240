"""Fitted mixtures against the intensities that points were drawn from."""

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.stand.intensity.functions import Constant, Mixture, Sum
from forest_addon.stand.layouts import Process, sample
from forest_addon.stand.statistics.intensity import Window, fit_mixture, refit

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
    process = process.scaled(count / process.expected())
    return sample(process, stream(0, *key)), process


def relative_error(fit, process):
    x, y = np.meshgrid(np.arange(0.5, 100), np.arange(0.5, 100))
    at = np.column_stack([x.ravel(), y.ravel()])
    law = process.at(at)
    return ((fit.at(at) - law) ** 2).sum() / (law**2).sum()


@pytest.mark.slow
def test_it_finds_the_hills_also_that_beyond_the_edge():
    points, process = drawn(HILLS, 8_000, "found")
    points = points[NOTCHED.contains(points)]
    fit = fit_mixture(points, NOTCHED)
    assert len(fit.peak) == 2
    order = np.argsort(fit.centre[:, 0])
    # Standard errors at 8,000 trees: 0.5 m of centres, 2 % of widths and peaks; bounds at 4 of them.
    assert fit.centre[order] == pytest.approx(HILLS.centre, abs=2.0)
    assert fit.width[order] == pytest.approx(HILLS.width, rel=0.1)
    assert fit.peak[order] == pytest.approx(HILLS.peak * process.factor, rel=0.1)
    assert fit.expected == pytest.approx(len(points), rel=1e-9)


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_error_falls_with_one_over_n():
    # MISE of maximum likelihood falls with 1/n. From 200 to 1,600 trees, 5 samples each, the slope
    # spreads by 0.1: bounds at 4 sigma.
    errors = []
    for count in (200, 1_600):
        tried = (drawn(HILLS, count, "rate", count, s) for s in range(5))
        errors.append(np.mean([relative_error(fit_mixture(p, FIELD), law) for p, law in tried]))
    assert -1.4 < np.log(errors[1] / errors[0]) / np.log(8) < -0.6


@pytest.mark.slow
def test_trees_that_stand_evenly_or_in_an_orchard_get_no_hill():
    # BIC takes one hill of 5 parameters for chance with probability about 1 %: 3 of 12 has 2e-4.
    even = [fit_mixture(drawn(Constant(1.0), 300, "even", s)[0], FIELD) for s in range(12)]
    assert sum(len(fit.peak) > 0 for fit in even) <= 2
    orchard = np.stack(np.meshgrid(np.arange(2.5, 100, 5), np.arange(2.5, 100, 5)), -1)
    fit = fit_mixture(orchard.reshape(-1, 2), FIELD)
    assert len(fit.peak) == 0
    assert fit.base == pytest.approx(400 / 1e4)


@pytest.mark.slow
def test_hills_on_a_base():
    on_base = Sum(
        (Constant(0.2), Mixture(np.array([2.0]), np.array([[60.0, 40.0]]), np.full((1, 2), 8)))
    )
    points, process = drawn(on_base, 5000, "base")
    fit = fit_mixture(points, FIELD)
    assert len(fit.peak) == 1
    assert fit.base == pytest.approx(0.2 * process.factor, rel=0.1)
    assert relative_error(fit, process) < 0.01


@pytest.mark.slow
def test_order_and_place_of_the_map_do_not_matter():
    points, _ = drawn(HILLS, 4500, "order")  # more than the sketch
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
