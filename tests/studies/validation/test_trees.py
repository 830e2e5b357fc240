"""Bands of measured trees, and what is taken from a grown one."""

import numpy as np
import pytest
from references.measured import FOUND, needs_measurements

from forest_addon.base.rng import stream
from studies.validation.trees import band_of, read_trees


def test_a_band_holds_ninety_in_a_hundred_of_the_trees_near_it():
    rng = stream(1, "band")
    dbh = rng.uniform(0.1, 0.4, 5000)
    height = rng.normal(10, 2, 5000)
    height[:50] = np.nan
    band, count = band_of({"dbh_m": dbh, "height_m": height}, "height_m", 0.2)
    near = np.isfinite(height) & (dbh > 0.16) & (dbh < 0.25)
    assert count == near.sum()
    held = (height[near] >= band.low) & (height[near] <= band.high)
    assert held.mean() == pytest.approx(0.9, abs=0.01)
    assert band_of({"dbh_m": dbh, "height_m": height}, "height_m", 5.0) == (None, 0)


@needs_measurements
def test_measured_trees_are_read_by_type():
    trees = read_trees(FOUND / "baad_trees.csv")
    assert {kind: len(columns["dbh_m"]) for kind, columns in trees.items()}.keys() == {"DA", "EG"}
    band, count = band_of(trees["EG"], "height_m", 0.2)
    assert count > 100
    assert 5 < band.low < band.value < band.high < 30
