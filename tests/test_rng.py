"""Streams are named by their key alone."""

import numpy as np
import pytest
from scipy import stats

from forest_addon.base.rng import child_keys, keyed_uniform, stream, truncated_normal


def test_different_keys_are_uncorrelated():
    keys = [(0, "a"), (0, "b"), (1, "a"), (0, "a", 0), (0, "a", 1), (0, 0), (0, 1), (0, "0")]
    draws = np.array([stream(*key).random(20_000) for key in keys])
    corr = np.corrcoef(draws) - np.eye(len(keys))
    assert np.abs(corr).max() < 5 / np.sqrt(20_000)  # 28 pairs: false alarm below 2e-5


def test_negative_keys_are_refused():
    with pytest.raises(ValueError, match="0 or larger"):
        stream(0, -1)


def test_truncated_normal_follows_its_law():
    z = truncated_normal(stream(1, "law"), 50_000, limit=1.5)
    assert np.abs(z).max() <= 1.5
    assert stats.kstest(z, stats.truncnorm(-1.5, 1.5).cdf).pvalue > 1e-4


def test_keyed_numbers_are_uniform_and_independent_of_their_neighbours():
    keys = child_keys(np.zeros(40_000, np.uint64), np.arange(40_000))
    assert len(np.unique(keys)) == 40_000
    draws = keyed_uniform(keys, "angle")
    assert 0 < draws.min() < draws.max() < 1
    assert (keyed_uniform(keys[7::11], "angle") == draws[7::11]).all()
    others = np.array(
        [
            draws,
            keyed_uniform(keys, "length"),
            keyed_uniform(keys + np.uint64(1), "angle"),
            keyed_uniform(child_keys(keys, 0), "angle"),
            keyed_uniform(child_keys(keys, 1), "angle"),
            keyed_uniform(child_keys(keys, "leaf"), "angle"),
        ]
    )
    # False alarm below 1e-5: six Kolmogorov tests, 15 correlations and 6 of successive draws.
    assert min(stats.kstest(row, "uniform").pvalue for row in others) > 1e-6
    assert np.abs(np.corrcoef(others) - np.eye(6)).max() < 5.5 / np.sqrt(40_000)
    successive = [np.corrcoef(row[:-1], row[1:])[0, 1] for row in others]
    assert np.abs(successive).max() < 5.5 / np.sqrt(40_000)


def test_numbers_stay_what_they_are():
    """In every process, on every machine, in every version."""
    drawn = stream(5, "tree", "maple", 3).random(3).tolist()
    assert drawn == [0.3641612322596921, 0.4198843378196193, 0.8942618312553818]
    keys = child_keys(np.array([1, 2], np.uint64), np.array([3, 4]))
    assert keyed_uniform(keys, "angle").tolist() == [0.5278940289521616, 0.37693566134421447]
