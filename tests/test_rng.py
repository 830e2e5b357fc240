"""Streams are named by their key alone."""

import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from forest_addon.rng import stream, truncated_normal


def test_same_key_same_numbers_in_another_process():
    code = "from forest_addon.rng import stream; print(stream(5, 'tree', 'maple', 3).random(3).tolist())"
    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert printed.stdout.strip() == str(stream(5, "tree", "maple", 3).random(3).tolist())


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
