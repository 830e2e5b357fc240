"""The forest beyond the field: where its trunks are, how many, how thick."""

from __future__ import annotations

import math

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.trunks import Trunks, continue_trunks

FIELD = ((-10.0, -20.0), (40.0, 30.0))


def planted(count: int = 60) -> Trunks:
    rng = np.random.default_rng(5)
    inside = rng.uniform((-10, -20), (30, 10), (count, 2))
    stray = [[500.0, 500.0]]  # outside the field: neither counted nor copied
    return Trunks(
        np.concatenate([inside, stray]),
        np.append(rng.choice([0.1, 0.2, 0.4], count), 9.0),
        np.arange(count + 1),
    )


def test_outside_the_field_within_the_distance() -> None:
    centre = np.array([0.0, 0.0])
    beyond = continue_trunks(planted(), FIELD, centre, 100.0, stream(1, "beyond"))
    x, y = beyond.position.T
    assert (np.hypot(x, y) <= 100).all()
    assert not ((x > -10) & (x < 30) & (y > -20) & (y < 10)).any()
    assert set(beyond.radius) == {0.1, 0.2, 0.4}
    assert (beyond.tree == -1).all()


def test_counts_are_poisson_with_the_fields_density() -> None:
    """Mean and variance over 400 seeds; each is missed by chance once in 10 000 times."""
    density = 60 / 1200
    area = math.pi * 50**2 - 1200
    counts = [
        len(continue_trunks(planted(), FIELD, np.array([10.0, -5.0]), 50.0, stream(seed, "beyond")))
        for seed in range(400)
    ]
    expected = density * area
    assert abs(np.mean(counts) - expected) < 3.9 * math.sqrt(expected / 400)
    assert abs(np.var(counts) / expected - 1) < 3.9 * math.sqrt(2 / 399)


def test_same_stream_same_forest() -> None:
    first, second = (
        continue_trunks(planted(), FIELD, np.zeros(2), 80.0, stream(4, "beyond")) for _ in range(2)
    )
    np.testing.assert_array_equal(first.position, second.position)


def test_source_and_receiver_stand_free() -> None:
    clear = np.array([[60.0, 60.0], [-60.0, -60.0]])
    for seed in range(20):
        thick = Trunks(planted().position, np.full(61, 6.0), np.arange(61))
        beyond = continue_trunks(thick, FIELD, np.zeros(2), 99.0, stream(seed, "b"), clear)
        for place in clear:
            assert (np.hypot(*(beyond.position - place).T) > 6.0).all()


def test_no_field_no_forest() -> None:
    nothing = Trunks(np.empty((0, 2)), np.empty(0), np.empty(0, np.int64))
    assert len(continue_trunks(nothing, FIELD, np.zeros(2), 100.0, stream(0, "b"))) == 0
    # Reaching no farther than the field adds nothing.
    assert len(continue_trunks(planted(), FIELD, np.zeros(2), 5.0, stream(0, "b"))) == 0


def test_too_many_are_refused() -> None:
    dense = Trunks(np.zeros((10**6, 2)), np.ones(10**6), np.zeros(10**6, np.int64))
    with pytest.raises(ValueError, match="lower continue_to"):
        continue_trunks(dense, FIELD, np.zeros(2), 2000.0, stream(0, "b"))
