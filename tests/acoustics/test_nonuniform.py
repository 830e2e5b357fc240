"""Fast sums over echoes against the direct sum: tolerances, hard cases, and the kernel alone."""

import math

import numpy as np
import pytest

from forest_addon.acoustics.disc import MODELS, backscatter_amplitude
from forest_addon.acoustics.gridding import ALIASING, NARROWEST, DelayGrid
from forest_addon.acoustics.nonuniform import sum_delayed

pytestmark = pytest.mark.usefixtures("computed_by")
START, SPACING, COUNT, SPEED = 60e3, 50.0, 401, 340.0


def direct(amplitude, delay, start=START, spacing=SPACING, count=COUNT):
    """(K,) Σ A·e^{-i2πfτ} and Σ max|A| of all echoes; whole turns are exact in integers."""
    total, size = np.zeros(count, dtype=np.complex128), 0.0
    frequency = start + spacing * np.arange(count)
    for rows in np.array_split(np.arange(len(delay)), len(delay) // 100 + 1):
        values = amplitude(frequency, rows)
        turns = np.mod(np.outer(frequency, delay[rows]), 1.0)
        total += (values * np.exp(-2j * np.pi * turns)).sum(axis=1)
        size += np.abs(values).max(axis=0).sum()
    return total, size


def leaves(model, count, seed=1):
    """Amplitudes of random leaves, their delays, and how far their own responses reach."""
    rng = np.random.default_rng(seed)
    distance, radius = rng.uniform(0.5, 6, count), rng.uniform(0.002, 0.06, count)
    angle = np.arccos(rng.uniform(0, 1, count))

    def amplitude(frequency, rows):
        k = 2 * np.pi * frequency[:, None] / SPEED
        return backscatter_amplitude(k * radius[rows], angle[rows], model) / (
            k * distance[rows] ** 2
        )

    return amplitude, 2 * distance / SPEED, 2 * radius * np.sin(angle) / SPEED


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_tolerance_is_kept(model: str) -> None:
    amplitude, delay, reach = leaves(model, 600)
    exact, size = direct(amplitude, delay)
    errors, most = [], 0.0
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12):
        found = sum_delayed(
            amplitude, delay, START, SPACING, COUNT, tolerance=tolerance, reach=reach
        )
        errors.append(np.abs(found.spectrum - exact).max() / size)
        rough = 1e-5 if model == "exact" else 0.0  # splines are no smoother
        assert errors[-1] <= max(tolerance, rough)
        assert errors[-1] <= 1.5 * found.error
        assert found.error <= max(tolerance, rough) + 1e-11  # rounding of the carrier
        assert found.size == pytest.approx(size, rel=0.05)
        nodes = sum(number * count for number, count in found.nodes.items()) / 600
        assert most <= 1.5 * nodes < COUNT
        most = nodes
    assert errors[0] > 1e-9  # it is not the direct sum that was tested
    unknown = sum_delayed(amplitude, delay, START, SPACING, COUNT, tolerance=1e-4)
    assert np.abs(unknown.spectrum - exact).max() <= 1e-4 * size


@pytest.mark.parametrize(
    ("count", "tolerance"), [(1, 0.0), (2, 1e-3), (3, 1e-12), (7, 1e-6), (64, 1e-12), (65, 1e-3)]
)
def test_few_bins(count: int, tolerance: float) -> None:
    amplitude, delay, _ = leaves("piston", 2000)
    exact, size = direct(amplitude, delay, count=count)
    found = sum_delayed(amplitude, delay, START, SPACING, count, tolerance=tolerance)
    assert found.spectrum.shape == (count,)
    assert np.abs(found.spectrum - exact).max() <= max(tolerance, 1e-13) * size


@pytest.mark.parametrize("echoes", [0, 1, 2])
def test_few_echoes(echoes: int) -> None:
    amplitude, delay, _ = leaves("paper", echoes)
    exact, size = direct(amplitude, delay, count=40000, spacing=0.5)  # enough for the fast way
    found = sum_delayed(amplitude, delay, START, 0.5, 40000, tolerance=1e-6)
    assert np.abs(found.spectrum - exact).max() <= 1e-6 * size
    if not echoes:
        assert (found.spectrum == 0).all()
        assert found.size == found.error == 0
        assert found.nodes == {}


def ones(frequency, rows):
    return np.ones((len(frequency), len(rows)))


@pytest.mark.medium
@pytest.mark.parametrize(
    "delay",
    [
        np.zeros(500),
        np.arange(500) / (SPACING * 810),  # on the points of the grid (2·405)
        np.arange(500) / SPACING,  # whole records: all the same
        np.nextafter(np.arange(500) / SPACING, -1),  # the last point, which is also the first
        -np.linspace(0, 0.5, 500),
        2.0**20 + np.linspace(0, 0.01, 500),  # 8e10 periods of the carrier
    ],
    ids=["zero", "on the grid", "records", "just before", "negative", "huge"],
)
def test_hard_delays(delay: np.ndarray) -> None:
    exact, size = direct(ones, delay)
    rounding = 2 * math.pi * 2.0**-52 * 80e3 * np.abs(delay).max()
    for tolerance in (1e-3, 1e-6, 1e-10):
        found = sum_delayed(ones, delay, START, SPACING, COUNT, tolerance=tolerance)
        assert np.abs(found.spectrum - exact).max() <= (tolerance + rounding) * size
        assert found.nodes.keys() != {COUNT}  # the fast way was taken


def test_discs_of_no_size_add_nothing() -> None:
    def amplitude(frequency, rows):
        k = 2 * np.pi * frequency[:, None] / SPEED
        return backscatter_amplitude(k * np.zeros(len(rows)), np.ones(len(rows)), "piston") / k

    found = sum_delayed(amplitude, np.full(500, 0.01), START, SPACING, COUNT)
    assert (found.spectrum == 0).all()
    assert found.error == 0


def test_an_amplitude_that_is_not_smooth_is_said_to_be_off() -> None:
    rng = np.random.default_rng(7)
    delay, kink = rng.uniform(0, 0.02, 300), rng.uniform(62e3, 78e3, 300)

    def amplitude(frequency, rows):
        smooth = np.ones((len(frequency), len(rows)))
        return np.where(rows % 3 == 0, np.abs(frequency[:, None] - kink[rows]) / 1e4, smooth)

    exact, size = direct(amplitude, delay)
    found = sum_delayed(amplitude, delay, START, SPACING, COUNT, tolerance=1e-8)
    error = np.abs(found.spectrum - exact).max() / size
    assert 1e-8 < error <= found.error < 100 * error


@pytest.mark.medium
@pytest.mark.parametrize(
    ("sums", "tolerance", "wrong"),
    [(1, 1e-6, 0.0), (2, 1e-6, 100.0), (3, 0.0, 0.3), (40, 1e-3, 0.3)],
)
def test_weighted_sums_of_the_same_echoes(sums: int, tolerance: float, wrong: float) -> None:
    """Also with a wrong reach, for which some are computed again; 40 are several blocks."""
    amplitude, delay, reach = leaves("piston", 900)
    weights = np.random.default_rng(5).uniform(-1, 1, (900, sums))
    found = sum_delayed(
        amplitude, delay, START, SPACING, COUNT,
        tolerance=tolerance, reach=wrong * reach, weights=weights,
    )  # fmt: skip
    assert found.spectrum.shape == (sums, COUNT)
    assert sum(found.nodes.values()) == 900
    for number in (0, sums - 1):
        exact, size = direct(lambda f, rows, n=number: amplitude(f, rows) * weights[rows, n], delay)
        error = np.abs(found.spectrum[number] - exact).max()
        assert error <= max(tolerance, 1e-13) * found.size
        assert size < found.size
        assert tolerance == 0 or error > 1e-12 * size  # it is not the direct sum that was tested


def test_weighted_sums_of_nothing() -> None:
    amplitude, delay, _ = leaves("paper", 0)
    found = sum_delayed(
        amplitude, delay, START, 0.5, 40000, tolerance=1e-6, weights=np.empty((0, 2))
    )
    assert found.spectrum.shape == (2, 40000)
    assert not found.spectrum.any()


@pytest.mark.parametrize(("width", "stated"), list(enumerate(ALIASING, NARROWEST)))
def test_aliasing_of_the_kernel(width: int, stated: float) -> None:
    """Every delay between two points, every bin: within the stated bound, and no wider than needed."""
    bins, delays = 64, np.linspace(0, 1 / 128, 65)
    worst = 0.0
    for delay in delays:
        grid = DelayGrid(bins, 1, width)
        grid.add(np.array([delay]), np.zeros(1), np.ones((1, 1)), np.ones((1, 1)))
        exact = np.exp(-2j * np.pi * delay * (np.arange(bins) - bins // 2))
        worst = max(worst, np.abs(grid.spectrum(np.ones((1, bins))) - exact).max())
    assert worst < stated
    assert worst > 0.5 * stated
