"""What a dataset will cost: from thin trials to the whole, linear where time goes with points."""

import numpy as np
import pytest

from headless.dataset.estimate import Estimate, Trial, by_cost, tell, thinned
from headless.dataset.plan import PLANS, read_plan, recipes


def trial(points):
    """3 s and 2 µs a point of sensors, half a second of ground whatever is scanned, 10 bytes a point,
    400 MB of memory and 100 bytes a point."""
    seconds = {"sensors": 3 + 2e-6 * points, "build": 0.5}
    return Trial(seconds, points, 1000 + 10 * points, 4e8 + 100 * points)


def test_the_whole_is_where_the_line_through_two_trials_leads():
    whole = trial(1e6).at(trial(2e5), 1.8e7)
    assert whole.seconds["sensors"] == pytest.approx(3 + 36)
    assert whole.seconds["build"] == 0.5
    assert whole.size == pytest.approx(1000 + 1.8e8)
    assert whole.peak == pytest.approx(4e8 + 1.8e9)


def test_the_memory_of_the_largest_scene_is_said():
    said = []
    tell(Estimate(100, (trial(1e6), trial(6e6)), ()), said.append)
    assert any("up to 1.00 GB of memory a worker" in line for line in said)


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


def dataset(kind, rng):
    """Seconds of 300 scenes, and what is guessed of each: wrong by half, and of one in ten by a lot."""
    seconds = {
        "grid": np.repeat([4.0, 9.0, 40.0], 100),
        "wide": rng.lognormal(2.0, 1.0, 300),
        "one heavy": np.append(np.full(299, 5.0), 900.0),
    }[kind]
    wrong = np.where(rng.random(300) < 0.1, 3.0, 1.0) * rng.uniform(0.7, 1.5, 300)
    return seconds, seconds * wrong


@pytest.mark.medium
@pytest.mark.parametrize("kind", ["grid", "wide", "one heavy"])
def test_trials_by_cost_tell_the_whole_and_its_interval_holds(kind):
    """Of 400 datasets: the mean estimate is within 5 % of the truth, the interval of 90 % has it in 80 %
    at least (systematic samples of five); three scenes evenly spread miss a heavy one by 45 %.
    """
    ratio, held = [], 0
    for draw in range(400):
        rng = np.random.default_rng(draw)
        seconds, guessed = dataset(kind, rng)
        rows, weights = by_cost(guessed[(order := rng.permutation(300))], 5)
        trials = tuple(Trial({"sensors": s}, 1.0, 1.0) for s in seconds[order][rows].tolist())
        found = Estimate(300, trials, (), tuple(weights.tolist()))
        ratio.append(found.core_hours * 3600 / seconds.sum())
        low, high = found.interval
        held += low <= seconds.sum() / 3600 <= high
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.05)
    assert np.std(ratio) < 0.3
    assert held >= 320


def test_few_scenes_are_all_tried():
    rows, weights = by_cost(np.array([3.0, 1.0, 9.0]), 5)
    assert rows.tolist() == [0, 1, 2]
    assert weights.tolist() == [1.0, 1.0, 1.0]
    whole = Estimate(3, (trial(1e6),) * 3, (), tuple(weights.tolist()))
    assert whole.interval == (whole.core_hours, whole.core_hours)
