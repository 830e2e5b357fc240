"""Flight lines of real clouds flown again: thresholds that are read, shares of returns, their nulls."""

import numpy as np
import pytest

from forest_addon.base.rng import stream
from headless.surveys import FlownCloud
from studies.validation.flights import BLOCK, IntensityScale, halves_apart, threshold
from studies.validation.own_cloud import CloudReturns


def cloud_of(light, far, count, line):
    """Returns whose intensities say their light on a scale from -20 to 0 dB."""
    level = 10 * np.log10(light * far**2)
    code = np.clip(np.round((level + 20) / 20 * 65535), 0, 65535)
    n = len(far)
    return CloudReturns(
        np.zeros((n, 3)), np.ones(n, int), count, np.zeros(n, bool), None, line, code
    )


def test_a_threshold_of_light_is_read_from_lines_of_any_range():
    rng = stream(1, "threshold")
    line = np.repeat([1, 2, 3], 20000)
    far = np.repeat([100.0, 190.0, 290.0], 20000)
    light = 1e-6 * rng.pareto(2.0, 60000) + 1e-6
    count = rng.integers(1, 4, 60000)
    found = threshold(cloud_of(light, far, count, line), line, far, IntensityScale(-20.0, 0.0))
    # P(light < q) = 1 - (1e-6/q)²: a twentieth lies below 1e-6/√0.95.
    assert found == pytest.approx(1e-6 / np.sqrt(0.95), rel=0.01)


def test_halves_of_a_line_are_as_far_apart_as_chance_makes_them():
    rng = stream(2, "halves")
    pulses = 40000
    place = np.column_stack([rng.uniform(0, 20 * BLOCK, (pulses, 2)), np.zeros(pulses)])
    count = np.where(rng.random(pulses) < 0.5, 1, 2)
    ones = np.ones(pulses, int)
    cloud = FlownCloud(place, np.zeros(pulses), ones, count, ones, np.zeros(pulses))
    # Two halves of 20,000 independent pulses: 1.96 times sqrt(0.25/20000 + 0.25/20000).
    assert halves_apart(cloud, 1)[1] == pytest.approx(0.0098, rel=0.35)
