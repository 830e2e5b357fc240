"""Values that are kept for the next time, so many at most."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from forest_addon.base.attitudes import Turning, composed
from forest_addon.base.kept import LastAsked
from forest_addon.base.rng import stream


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
