"""What a dataset will cost: from thin trials to the whole, linear where time goes with points."""

import pytest

from headless.dataset.estimate import Estimate, Trial, thinned
from headless.dataset.plan import PLANS, read_plan, recipes


def trial(points):
    """3 s and 2 µs a point of sensors, half a second of ground whatever is scanned, 10 bytes a point."""
    return Trial({"sensors": 3 + 2e-6 * points, "build": 0.5}, points, 1000 + 10 * points)


def test_the_whole_is_where_the_line_through_two_trials_leads():
    whole = trial(1e6).at(trial(2e5), 1.8e7)
    assert whole.seconds["sensors"] == pytest.approx(3 + 36)
    assert whole.seconds["build"] == 0.5
    assert whole.size == pytest.approx(1000 + 1.8e8)


def test_a_trial_without_points_stays_as_it_is():
    assert trial(0).at(trial(0), 0.0) == trial(0)


def test_hours_of_all_scenes_and_of_a_set_like_boreal3d():
    found = Estimate(7200, (trial(1e6), trial(3e6)), ())
    assert found.core_hours == pytest.approx(2 * (3.5 + 4))
    # a thousand plots of 35.3 million points: the sensors' seconds by the point, the rest by the plot
    assert found.boreal_hours == pytest.approx((35.3e9 * 14 / 4e6 + 1000 * 0.5) / 3600)


def test_thinned_scanners_send_one_of_so_many_pulses():
    recipe = recipes(read_plan(PLANS / "lidar-plots.toml", ["count=1"]))[0]
    few = thinned(recipe, 64.0)
    for before, after in zip(recipe.settings().sensors, few.settings().sensors, strict=True):
        if before.kind == "terrestrial":
            assert after.angle_step_deg == pytest.approx(8 * before.angle_step_deg)
        else:
            assert after.pulse_rate == pytest.approx(before.pulse_rate / 64)
    assert few.scene["forest"] == recipe.scene["forest"]
