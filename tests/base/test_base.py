"""Ground that all rooms stand on: streams named by key, vectors, digests, what is kept, attitudes."""

import hashlib
import math

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation, Slerp

from forest_addon.base.attitudes import Turning, composed
from forest_addon.base.kept import LastAsked, digest
from forest_addon.base.rng import child_keys, keyed_uniform, stream, truncated_normal
from forest_addon.base.vectors import azimuth_of, column, elevation_of, zenith_of


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


# ------------------------------------------------------------------------------------------ vectors
# Angles of directions: right, and to the bit the same wherever their memory lies.


def test_angles_are_those_of_the_standard_library():
    ways = np.random.default_rng(1).normal(size=(500, 3))
    for way, azimuth, elevation, zenith in zip(
        ways, azimuth_of(ways), elevation_of(ways), zenith_of(ways), strict=True
    ):
        x, y, z = way.tolist()
        assert math.isclose(azimuth, math.atan2(y, x), rel_tol=1e-15)
        assert math.isclose(elevation, math.atan2(z, math.hypot(x, y)), rel_tol=1e-15)
        assert math.isclose(zenith, math.atan2(math.hypot(x, y), z), rel_tol=1e-15)


def test_a_column_has_the_same_bits_wherever_the_result_lies():
    """numpy 1.26 takes another way where a column ends within 16 bytes of the result's beginning."""
    count = 1_000
    memory = np.empty(4 * count + 8)
    ways = memory[: 3 * count].reshape(count, 3)
    ways[:] = np.random.default_rng(2).normal(size=ways.shape)
    wanted = azimuth_of(ways.copy())
    assert azimuth_of(ways).tobytes() == wanted.tobytes()
    for gap in range(4):
        behind = memory[3 * count + gap : 4 * count + gap]
        np.arctan2(column(ways, 1), column(ways, 0), out=behind)
        assert behind.tobytes() == wanted.tobytes()


# ------------------------------------------------------------------------------------------- digest
# Digests of what decides a result.


def test_digest_is_of_the_bytes_in_their_order_however_an_array_lies_in_memory():
    table = np.arange(12.0).reshape(3, 4)
    told = b"forest" + table.T.tobytes() + b'{"a": 1, "b": "x"}'
    wanted = hashlib.blake2b(told, digest_size=16).hexdigest()
    assert digest([b"forest", table.T, {"b": "x", "a": 1}]) == wanted
    assert digest(iter([b"forest", np.asfortranarray(table.T), {"a": 1, "b": "x"}])) == wanted
    assert digest([b"forest", table]) != digest([b"forest", table.T])
    assert digest([np.empty((0, 3)), 1]) == digest([1])


def test_every_number_of_a_long_array_within_settings_counts():
    track = np.zeros(5000)
    other = track.copy()
    other[2500] = 1e-9
    assert digest([{"track": track}]) != digest([{"track": other}])
    assert digest([{"track": track}]) == digest([{"track": track.copy()}])


# --------------------------------------------------------------------------------------------- kept
# Values that are kept for the next time, so many at most.


def test_what_was_asked_for_longest_ago_is_dropped_and_made_anew():
    made = []

    def ask(key):
        return kept.once(key, lambda: made.append(key) or -key)

    kept = LastAsked(2)
    assert [ask(key) for key in (1, 2, 1, 3, 1, 2)] == [-1, -2, -1, -3, -1, -2]
    assert made == [1, 2, 3, 2]
    assert len(kept) == 2


def test_what_is_none_is_kept_too():
    made = []
    kept = LastAsked(1)
    for _ in range(2):
        assert kept.once("a", lambda: made.append(1)) is None
    assert len(made) == 1


# ----------------------------------------------------------------------------------------- attitudes
# Composed rotations and turns between attitudes, against scipy's own.


def drawn(count, name):
    return Rotation.from_quat(stream(5, name).normal(size=(count, 4)))


@pytest.mark.parametrize(("many", "others"), [(500, 500), (500, 1), (1, 500), (0, 0)])
def test_composed_is_the_product_to_the_last_bit(many, others):
    first, second = drawn(many, "first"), drawn(others, "second")
    assert np.array_equal(composed(first, second).as_quat(), (first * second).as_quat())


def test_one_rotation_serves_all():
    first, only = drawn(40, "first"), Rotation.from_euler("ZYX", [0.3, -0.2, 0.1])
    assert np.array_equal(composed(first, only).as_quat(), (first * only).as_quat())
    assert np.array_equal(composed(only, first).as_quat(), (only * first).as_quat())


def test_turning_is_slerp_to_the_last_bit():
    time = np.cumsum(stream(5, "time").uniform(0.1, 2.0, 9))
    attitude = drawn(9, "attitude")
    asked = np.concatenate([time, stream(5, "asked").uniform(time[0], time[-1], 400)])
    found = Turning(time, attitude).at(asked)
    assert np.array_equal(found.as_quat(), Slerp(time, attitude)(asked).as_quat())


def test_times_that_do_not_rise_are_refused():
    with pytest.raises(ValueError, match="must rise"):
        Turning(np.array([0.0, 1.0, 1.0]), drawn(3, "attitude"))
