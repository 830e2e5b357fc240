"""The fast sum over trunks against the exact one: its tolerance in every band and at every time."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from forest_addon.acoustics.air import absorption
from forest_addon.acoustics.cylinder import transfer
from forest_addon.sensing.reverb.sums.contract import judged
from forest_addon.sensing.reverb.sums.expansion import expand
from forest_addon.sensing.reverb.sums.fast_scattering import Expansions
from forest_addon.sensing.reverb.sums.scattering import TrunkPaths, direct_sum, trunk_paths
from forest_addon.sensing.reverb.sums.tree_response import tree_response
from forest_addon.sensing.reverb.trunks.slices import Trunks
from forest_addon.spec import Air, Reverb

AIR = Air(sound_speed=343.0)
slow = pytest.mark.slow


def paths(
    count: int, distance: float, side: float, radius: float | tuple[float, float], seed: int = 0
) -> TrunkPaths:
    rng = np.random.default_rng(seed)
    radii = (
        rng.uniform(*radius, count) if isinstance(radius, tuple) else np.full(count, float(radius))
    )
    return between(rng.uniform(-side / 2, side / 2, (count, 2)), radii, distance)


def between(place: np.ndarray, radius: np.ndarray, distance: float) -> TrunkPaths:
    ends = np.array([[-distance / 2, 0.0], [distance / 2, 0.0]])
    return trunk_paths(Trunks(place, radius, np.arange(len(radius))), *ends, 2.0, 0.7)


def compare(
    some: TrunkPaths, rate: float, tolerance: float, seconds: float | None = None, **air: Any
) -> tuple[float, dict[float, float]]:
    """Worst error of the fast sum over its tolerance, and what it found itself."""
    last = float(some.length.max()) / 343.0
    count = int((last + 0.05 if seconds is None else seconds) * rate)
    state = Air(sound_speed=343.0, **air)
    exact = direct_sum(some, rate, count, state)
    found = Expansions().sum(some, rate, count, state, tolerance)
    arrivals = (some.length - 2.0 * some.radius * np.sin(some.angle / 2)) / 343.0
    errors = judged(found.samples, exact, rate, tolerance, arrivals)
    return max(errors.values()) / tolerance, found.errors


def stand(
    count: int, kind: str, span: tuple[float, float], distance: float, side: float, seed: int
) -> TrunkPaths:
    """Trunks of every kind of radius between 1 mm and 2 m."""
    rng = np.random.default_rng(seed)
    low, high = sorted(10.0 ** np.array(span))
    radius = {
        "equal": lambda: np.full(count, high),
        "two": lambda: rng.choice([low, high], count),
        "uniform": lambda: rng.uniform(low, high, count),
        "lognormal": lambda: np.clip(rng.lognormal(math.log(low), 0.8, count), 1e-3, 2.0),
        "log-uniform": lambda: np.exp(rng.uniform(math.log(low), math.log(high + 1e-9), count)),
    }[kind]()
    return between(rng.uniform(-side / 2, side / 2, (count, 2)), radius, distance)


@pytest.mark.slow
@settings(max_examples=4, phases=[Phase.explicit, Phase.generate])
@given(
    rate=st.sampled_from([6e3, 8e3, 16e3, 24e3, 48e3]),
    count=st.integers(1, 60),
    kind=st.sampled_from(["equal", "two", "uniform", "lognormal", "log-uniform"]),
    span=st.tuples(*[st.floats(-3.0, math.log10(2.0))] * 2),
    distance=st.floats(0.5, 100.0),
    side=st.floats(5.0, 100.0),
    tolerance=st.sampled_from([1e-3, 1e-4, 1e-5]),
    seed=st.integers(0, 2**32 - 1),
)
def test_tolerance_is_kept_in_every_band_and_at_every_time(
    rate: float,
    count: int,
    kind: str,
    span: tuple[float, float],
    distance: float,
    side: float,
    tolerance: float,
    seed: int,
) -> None:
    paths = stand(min(count, int(6e5 / rate)), kind, span, distance, side, seed)
    worst, reported = compare(paths, rate, tolerance)
    assert worst < 1.0
    assert max(reported.values()) < 3.0 * tolerance


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "count", "radius"),
    [
        (8e3, 120, (0.01, 0.5)),  # above the tolerance before, as were the next two
        (24e3, 25, (0.01, 0.5)),
        (24e3, 60, 0.01),
        (24e3, 60, 0.25),
    ],
)
def test_the_smallest_tolerance(
    rate: float, count: int, radius: float | tuple[float, float]
) -> None:
    worst, _ = compare(paths(count, 10.0, 60.0, radius), rate, 1e-6)
    assert worst < 1.0


@pytest.mark.slow
def test_many_trunks_at_single_frequencies() -> None:
    """20,000 trunks, lognormal from 1 cm to 2 m: the spectrum in each octave against the plain sum."""
    rng = np.random.default_rng(3)
    radius = np.clip(rng.lognormal(math.log(0.08), 0.7, 20_000), 0.01, 2.0)
    some = between(rng.uniform(-250, 250, (20_000, 2)), radius, 10.0)
    rate, tolerance = 16e3, 1e-4
    found = Expansions().sum(
        some, rate, int((some.length.max() / 343 + 1.0) * rate), AIR, tolerance
    )
    for octave in 20.0 * 2.0 ** np.arange(9):
        frequency = rng.uniform(octave, min(2 * octave, 0.44 * rate), 2)
        loss = absorption(frequency)[:, None]
        way = np.exp(-(loss + 2j * np.pi * frequency[:, None] / 343.0) * some.length)
        exact = (some.weight * way * transfer(frequency[:, None], some.angle, radius, 343.0)).sum(1)
        turn = np.exp(-2j * np.pi * np.outer(frequency, np.arange(len(found.samples))) / rate)
        gap = turn @ found.samples - exact
        assert np.linalg.norm(gap) < tolerance * np.linalg.norm(exact)


def test_below_20_hz() -> None:
    """Thin stems, which are 2 to 6 % off with filters that end too early; they fade below 6.4 Hz."""
    some = paths(60, 10.0, 60.0, 0.02)
    found = Expansions().sum(some, 8e3, 40_000, AIR, 1e-4).samples
    exact = direct_sum(some, 8e3, 40_000, AIR)
    turn = np.exp(-2j * np.pi / 8e3 * np.outer([5.0, 10.0, 17.0], np.arange(40_000)))
    error = np.abs(turn @ (found - exact)) / np.abs(turn @ exact)
    assert (error < [5e-4, 1e-4, 1e-4]).all()


@pytest.mark.medium
@pytest.mark.parametrize("radius", [0.1, pytest.param((0.05, 0.2), marks=slow)])
@pytest.mark.parametrize(
    "air",
    [
        {"temperature_c": -40.0, "humidity": 0.01, "pressure_kpa": 60.0},
        {"temperature_c": 50.0, "humidity": 100.0, "pressure_kpa": 60.0},
    ],
)
def test_extreme_air(radius: float | tuple[float, float], air: dict[str, float]) -> None:
    worst, _ = compare(paths(60, 10.0, 100.0, radius), 24e3, 1e-4, **air)
    assert worst < 1.0


@pytest.mark.slow
def test_192_khz() -> None:
    """ka to 176; the air takes 3 dB a metre at the band's end."""
    worst, _ = compare(paths(5, 5.0, 10.0, 0.1), 192e3, 1e-4)
    assert worst < 1.0


@pytest.mark.medium
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, np.pi / 2, np.pi - 1e-6, np.pi])
@pytest.mark.parametrize("different", [False, pytest.param(True, marks=slow)])
def test_single_angles(angle: float, different: bool) -> None:
    """Straight on and straight back, where cos φ is at its ends."""
    radius = np.linspace(0.2, 0.25, 6) if different else np.full(6, 0.25)
    some = TrunkPaths(
        np.linspace(30.0, 33.0, 6), np.ones(6), np.full(6, angle), radius, np.zeros(6, bool)
    )
    assert compare(some, 16e3, 1e-5)[0] < 1.0


@pytest.mark.medium
def test_few_radii_and_one_of_none() -> None:
    some = paths(200, 10.0, 80.0, 0.1)
    radii = np.array([0.1, 0.3, 0.0, 0.02])[np.arange(200) % 4]
    some = TrunkPaths(some.length, some.weight, some.angle, radii, some.clamped)
    assert compare(some, 8e3, 1e-4)[0] < 1.0


@pytest.mark.parametrize("radius", [0.25, pytest.param((0.05, 0.3), marks=slow)])
def test_nothing_wraps_and_short_records(radius: float | tuple[float, float]) -> None:
    some = paths(300, 10.0, 100.0, radius)
    prepared = Expansions()
    whole = prepared.sum(some, 8e3, 8_000, AIR, 1e-4).samples
    for count in (1, 7, 700, 5003):
        part = prepared.sum(some, 8e3, count, AIR, 1e-4).samples
        assert len(part) == count
        np.testing.assert_allclose(part, whole[:count], atol=2e-4 * np.abs(whole).max())
    before = int((some.earliest.min() / 343.0) * 8e3) - 256
    assert np.abs(whole[: max(0, before)]).max(initial=0.0) < 1e-5 * np.abs(whole).max()


@pytest.mark.medium
def test_chosen_by_tolerance_and_number() -> None:
    rng = np.random.default_rng(1)
    trunks = Trunks(rng.uniform(-30, 30, (300, 2)), np.full(300, 0.2), np.arange(300))
    ends = np.array([[-5.0, 0, 1.5], [5.0, 0, 1.5]])

    def listen(count: int, tolerance: float):
        some = Trunks(trunks.position[:count], trunks.radius[:count], trunks.tree[:count])
        reverb = Reverb(duration=0.3, sample_rate=8000.0, tolerance=tolerance)
        return tree_response(some, *ends, reverb, AIR)

    assert listen(300, 0.0).exact
    assert listen(20, 1e-4).exact
    assert not listen(300, 1e-4).exact
    gap = listen(300, 1e-4).samples - listen(300, 0.0).samples
    assert 0 < np.linalg.norm(gap) < 1e-4 * np.linalg.norm(listen(300, 0.0).samples)


def test_gain_of_each_path() -> None:
    rng = np.random.default_rng(2)
    trunks = Trunks(rng.uniform(-30, 30, (200, 2)), np.full(200, 0.2), np.arange(200))
    reverb = Reverb(duration=0.3, sample_rate=8000.0)
    ends = np.array([[-5.0, 0], [5.0, 0]])
    heard = np.arange(200) % 2 == 0
    some = Trunks(trunks.position[heard], trunks.radius[heard], trunks.tree[heard])
    np.testing.assert_allclose(
        tree_response(trunks, *ends, reverb, AIR, gain=heard * 3.0).samples,
        tree_response(some, *ends, reverb, AIR).samples * 3.0,
        atol=1e-6,
    )


@pytest.mark.medium
@pytest.mark.parametrize(
    ("source", "receiver"),
    [
        ((0.0, 0.0), (0.0, 0.0)),  # source is receiver
        ((0.0, 0.0), (1e-9, 0.0)),
        ((-5.0, 0.0), (5.0, 0.0)),
        ((-5.0, 0.0), (8.0, 0.1)),  # the receiver in a trunk
        ((8.0, 0.0), (8.0, 0.0)),  # both at a trunk's axis
    ],
)
@pytest.mark.parametrize("spread", [pytest.param(0.0, marks=slow), 0.1])
def test_hard_places(
    source: tuple[float, float], receiver: tuple[float, float], spread: float
) -> None:
    """Trunks exactly between, exactly behind, on and around both; one far off; any number."""
    rng = np.random.default_rng(4)
    rows = [(0.5, 0.0), (8.0, 0.0), (-8.0, 0.0), (0.0, 600.0), *rng.uniform(-40, 40, (563, 2))]
    radius = 0.3 + spread * rng.uniform(-1, 0, 567) * (np.arange(567) != 1)
    trunks = Trunks(np.array(rows), radius, np.arange(567))
    exact, fast = (
        tree_response(
            trunks,
            np.array(source),
            np.array(receiver),
            Reverb(duration=5.0, sample_rate=2000.0, tolerance=tolerance),
            AIR,
        )
        for tolerance in (0.0, 1e-4)
    )
    assert exact.exact
    assert not fast.exact
    assert fast.heard.all()
    assert fast.clamped == exact.clamped >= (np.hypot(8 - receiver[0], receiver[1]) < 0.3)
    gap = np.linalg.norm(fast.samples - exact.samples)
    assert gap < 1e-4 * np.linalg.norm(exact.samples)


def test_no_trunks() -> None:
    none = paths(0, 10.0, 150.0, 0.25)
    assert not Expansions().sum(none, 24e3, 100, AIR, 1e-4).samples.any()


def test_sectors_cover_every_angle_once() -> None:
    for layer in expand(0.25, 24e3, 343.0, 1e-4):
        sectors = [layer.sector(number) for number in range(len(layer.highs))]
        assert sectors[0].low == -1.0
        assert sectors[-1].high == 1.0
        for before, after in itertools.pairwise(sectors):
            assert before.high == after.low > before.low


@pytest.mark.medium
@pytest.mark.parametrize("radius", [0.25, pytest.param((0.1, 0.2), marks=slow)])
def test_order_of_trunks_does_not_matter(radius: float | tuple[float, float]) -> None:
    some = paths(2000, 10.0, 150.0, radius)
    order = np.random.default_rng(3).permutation(2000)
    prepared = Expansions()
    one, other = (prepared.sum(p, 8e3, 9000, AIR, 1e-6).samples for p in (some, some.select(order)))
    np.testing.assert_allclose(one, other, atol=1e-6 * np.abs(one).max())


@pytest.mark.slow
def test_progress_of_many_radii_begins_with_the_low_frequencies_and_ends_whole() -> None:
    some, told = paths(5000, 10.0, 150.0, (0.05, 0.3)), []
    Expansions().sum(some, 8e3, 9000, AIR, 1e-4, progress=lambda *at: told.append(at))
    shares = [done / every for done, every in told]
    assert shares == sorted(shares)
    assert 0 < shares[0] < 0.5 < shares[-1] == 1.0


@pytest.mark.medium
def test_what_was_dropped_is_set_up_anew_with_the_same_samples() -> None:
    some = paths(500, 10.0, 150.0, 0.25)
    prepared = Expansions()
    first = prepared.sum(some, 8e3, 4000, AIR, 1e-4).samples
    prepared._layers.limit = 1
    prepared.sum(paths(500, 10.0, 150.0, 0.2), 8e3, 4000, AIR, 1e-4)
    assert len(prepared._layers) == 1
    np.testing.assert_array_equal(prepared.sum(some, 8e3, 4000, AIR, 1e-4).samples, first)
