"""The promise of a tolerance: whole, octaves and tenths, with every loss, air and radius, to 1e-6."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st
from references.trunks_at_length import sum_at_length

from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand
from forest_addon.sensing.reverb.sums import fast_scattering
from forest_addon.sensing.reverb.sums.contract import judged
from forest_addon.sensing.reverb.sums.fast_scattering import Expansions
from forest_addon.sensing.reverb.sums.scattering import TrunkPaths, direct_sum, trunk_paths
from forest_addon.sensing.reverb.trunks.slices import Trunks
from forest_addon.spec import Air, Reverb, SpecError

slow = pytest.mark.slow
AIR = Air(sound_speed=343.0)
SLOW_AIR = Air(sound_speed=343.0, temperature_c=0.0, humidity=3.0)
LOSSES = st.fixed_dictionaries(
    {
        "surface": st.sampled_from(["constant", "snow", "forest floor", "grass", "asphalt"]),
        "ground": st.floats(-1, 1),
        "extinction": st.sampled_from(["none", "energy", "coherent"]),
        "bark": st.sampled_from([0.0, 0.05, 0.9]),
        "leaf_absorption": st.sampled_from([0.0, 0.0015, 0.01]),
        "turbulence": st.sampled_from([0.0, 1.0, 100.0]),
        "path_ground": st.booleans(),
    }
)


def stand(
    count: int, low: float, high: float, side: float, distance: float, seed: int = 0
) -> tuple[TrunkPaths, np.ndarray, np.ndarray]:
    """Paths among even random trunks, and both ends."""
    rng = np.random.default_rng(seed)
    radius = (
        np.full(count, low) if low == high else np.exp(rng.uniform(*np.log([low, high]), count))
    )
    trunks = Trunks(rng.uniform(-side / 2, side / 2, (count, 2)), radius, np.arange(count))
    ends = np.array([[-distance / 2, 0.0, 1.5], [distance / 2, 0.0, 1.2]])
    return trunk_paths(trunks, *ends[:, :2], 2.0, 0.7, None, True), *ends


def worst(
    paths: TrunkPaths,
    rate: float,
    tolerance: float,
    losses: Losses | None = None,
    air: Air = AIR,
    seconds: float | None = None,
) -> float:
    """Largest error of all that is promised, over the tolerance."""
    count = int(rate * (seconds or float(paths.length.max()) / 343.0 + 0.05))
    exact = direct_sum(paths, rate, count, air, None, losses, min(tolerance, 1e-6))
    found = Expansions().sum(paths, rate, count, air, tolerance, losses).samples
    arrivals = (paths.length - 2.0 * paths.radius * np.sin(paths.angle / 2)) / 343.0
    return max(judged(found, exact, rate, tolerance, arrivals).values()) / tolerance


def forest(ends: tuple[np.ndarray, np.ndarray], leaves: float = 0.3, **changes: object) -> Losses:
    given = {"model": "forest", "surface": "forest floor"} | changes
    return Losses.of(Reverb(**given), AIR, TrunkStand(0.05, (0.1, 0.2), leaves, 15.0), *ends)


@pytest.mark.medium
@pytest.mark.parametrize(
    "radii",
    [(0.02, 0.02), pytest.param((0.5, 2.0), marks=slow), pytest.param((0.1, 0.3), marks=slow)],
)
def test_the_exact_sum_is_exact_at_all_times(radii: tuple[float, float]) -> None:
    """Against one transform of ten minutes, also before the first arrival and below 20 Hz."""
    paths, *_ = stand(3, *radii, 60.0, 10.0)
    truth = sum_at_length(paths, 1000.0, 400, AIR)
    found = direct_sum(paths, 1000.0, 400, AIR, None, None, 1e-6)
    assert np.linalg.norm(found - truth) < 1e-9 * np.linalg.norm(truth)
    tenths = [np.linalg.norm(part) for part in np.array_split(found - truth, 10)]
    assert max(tenths) < 1e-6 * 3e-5 * 10 * np.linalg.norm(truth)


@pytest.mark.medium
def test_the_exact_sum_with_every_loss_is_exact() -> None:
    paths, *ends = stand(3, 0.1, 0.3, 40.0, 10.0)
    losses = forest(ends, 1.0)
    truth = sum_at_length(paths, 1000.0, 300, AIR, losses, 300.0)
    found = direct_sum(paths, 1000.0, 300, AIR, None, losses, 1e-6)
    assert np.linalg.norm(found - truth) < 3e-8 * np.linalg.norm(truth)


@pytest.mark.medium
@pytest.mark.parametrize("tolerance", [1e-4, pytest.param(1e-6, marks=slow)])
def test_leaves_among_trunks_of_one_radius(tolerance: float) -> None:
    """Was 4.8 to 478 times over: what leaves take rings longer than what the air does."""
    paths, *ends = stand(60, 0.15, 0.15, 60.0, 10.0)
    assert worst(paths, 4e3, tolerance, forest(ends, 0.5)) < 1.0


@pytest.mark.medium
@pytest.mark.parametrize("ground", ["grass", "constant"])
def test_few_radii_over_a_ground(ground: str) -> None:
    """Had a floor of 1e-5 to 5e-5: widths that were interpolated by straight lines ring too."""
    paths, *ends = stand(60, 0.12, 0.12, 60.0, 10.0)
    assert worst(paths, 4e3, 1e-5, forest(ends, 0.0, surface=ground)) < 1.0


@pytest.mark.parametrize("tolerance", [1e-5, pytest.param(1e-6, marks=slow)])
def test_a_record_that_ends_among_arrivals_in_slow_air(tolerance: float) -> None:
    """Was 3.1 and 30 times over."""
    paths, *_ = stand(60, 0.12, 0.12, 60.0, 10.0)
    assert worst(paths, 4e3, tolerance, None, SLOW_AIR, 0.08) < 1.0


@pytest.mark.medium
@pytest.mark.parametrize("leaves", [None, 0.3])
def test_low_frequencies_of_many_radii_by_shared_filters(
    monkeypatch: pytest.MonkeyPatch, leaves: float | None
) -> None:
    """As for thousands of trunks: classes of radii from 1 to 50 cm share filters below 600 Hz."""
    monkeypatch.setattr(fast_scattering, "MANY", 1)
    paths, *ends = stand(60, 0.01, 0.5, 60.0, 10.0)
    assert worst(paths, 6e3, 1e-4, leaves and forest(ends, leaves, bark=0.05)) < 1.0


@pytest.mark.medium
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_thick_trunks_beside_both_ends(tolerance: float) -> None:
    """Was 4 to 7 times over in a tenth of the record."""
    rng = np.random.default_rng(5)
    ends = np.array([[-10.0, 0.0], [10.0, 0.0]])
    near = np.repeat(ends, 6, axis=0) + rng.normal(0, 2.5, (12, 2))
    place = np.concatenate([near, rng.uniform(-60, 60, (60, 2))])
    trunks = Trunks(place, rng.uniform(0.5, 2.0, 72), np.arange(72))
    paths = trunk_paths(trunks, *ends, 2.0, 0.7)
    assert worst(paths, 4e3, tolerance) < 1.0


@slow
@settings(max_examples=2, phases=[Phase.explicit, Phase.generate])
@given(
    given_losses=LOSSES,
    leaves=st.sampled_from([0.0, 0.3, 3.0]),
    span=st.tuples(st.floats(-2.3, 0.3), st.floats(-2.3, 0.3)),
    distance=st.floats(1.0, 40.0),
    side=st.floats(20.0, 120.0),
    air=st.tuples(st.sampled_from([-40.0, 0.0, 20.0, 50.0]), st.sampled_from([0.01, 3.0, 100.0])),
    tolerance=st.sampled_from([1e-2, 1e-4, 1e-5, 1e-6]),
    seed=st.integers(0, 10_000),
)
@example(  # was 1.09 of the tolerance: what trunks that lean do had a kink at 20 Hz
    given_losses={
        "surface": "grass",
        "ground": 3.4e-42,
        "extinction": "coherent",
        "bark": 0.0,
        "leaf_absorption": 0.0,
        "turbulence": 1.0,
        "path_ground": True,
    },
    leaves=3.0,
    span=(-0.0454, -0.1449),
    distance=1.1,
    side=63.4,
    air=(50.0, 100.0),
    tolerance=1e-4,
    seed=10_000,
)
def test_every_loss_and_air(
    given_losses: dict[str, object],
    leaves: float,
    span: tuple[float, float],
    distance: float,
    side: float,
    air: tuple[float, float],
    tolerance: float,
    seed: int,
) -> None:
    low, high = sorted(10.0 ** np.array(span))
    paths, *ends = stand(80, low, high, side, distance, seed)
    state = Air(sound_speed=343.0, temperature_c=air[0], humidity=air[1])
    losses = Losses.of(
        Reverb(model="forest", **given_losses),
        state,
        TrunkStand(0.03, (low, math.sqrt(low * high), high), leaves, 20.0),
        *ends,
    )
    known = 10.0 if tolerance < 1e-5 else 1.0  # of losses at 1e-6 the contract says so
    assert worst(paths, 4e3, tolerance, losses, state) < known


def test_what_cannot_be_kept_is_refused() -> None:
    with pytest.raises(SpecError, match="tolerance"):
        Reverb(tolerance=1e-12)
    assert Reverb(tolerance=0.0).tolerance == 0.0
