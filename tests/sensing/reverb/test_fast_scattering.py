"""The fast sum over trunks against the exact one, at every tolerance and in the hard corners."""

from __future__ import annotations

import numpy as np
import pytest

from forest_addon.sensing.reverb.expansion import Key, expand
from forest_addon.sensing.reverb.fast_scattering import Expansions
from forest_addon.sensing.reverb.scattering import TrunkPaths, trunk_paths
from forest_addon.sensing.reverb.slices import Trunks
from forest_addon.sensing.reverb.tree_response import direct_sum, tree_response
from forest_addon.spec import Air, Reverb

AIR = Air(sound_speed=343.0)


def paths(
    count: int, distance: float, side: float, radius: float | tuple[float, float], seed: int = 0
) -> TrunkPaths:
    rng = np.random.default_rng(seed)
    radii = (
        rng.uniform(*radius, count) if isinstance(radius, tuple) else np.full(count, float(radius))
    )
    trunks = Trunks(rng.uniform(-side / 2, side / 2, (count, 2)), radii, np.arange(count))
    ends = np.array([[-distance / 2, 0.0], [distance / 2, 0.0]])
    return trunk_paths(trunks, *ends, 2.0, 0.7)


def errors(found: np.ndarray, exact: np.ndarray, rate: float) -> tuple[float, float]:
    """Relative L2 error over the full band, and above 20 Hz."""
    spectra = np.fft.rfft([found - exact, exact])
    above = np.fft.rfftfreq(len(exact), 1 / rate) > 20
    gap, whole = np.linalg.norm(spectra[:, above], axis=1)
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact)), float(gap / whole)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "distance", "side", "radius", "count"),
    [
        (24e3, 10.0, 150.0, 0.25, 400),
        (24e3, 100.0, 200.0, 0.25, 251),  # every sector is full
        (24e3, 400.0, 100.0, 0.2, 100),
        (8e3, 10.0, 150.0, 0.05, 301),  # one layer: the whole band is low
        (48e3, 10.0, 60.0, 0.15, 203),
    ],
)
def test_tolerance_is_kept(
    rate: float, distance: float, side: float, radius: float, count: int
) -> None:
    some = paths(count, distance, side, radius)
    samples = int((some.length.max() / 343.0 + 0.05) * rate)
    exact = direct_sum(some, rate, samples, AIR)
    prepared = Expansions()
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
        found = prepared.sum(some, rate, samples, AIR, tolerance)
        assert max(errors(found, exact, rate)) < tolerance
        assert max(errors(found, exact, rate)) > 1e-3 * tolerance  # it is the fast way


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_every_trunk_a_radius_of_its_own(tolerance: float) -> None:
    some = paths(300, 10.0, 80.0, (0.05, 0.3))
    exact = direct_sum(some, 8e3, 4000, AIR)
    assert max(errors(Expansions().sum(some, 8e3, 4000, AIR, tolerance), exact, 8e3)) < tolerance


def test_few_radii_and_one_of_none() -> None:
    some = paths(200, 10.0, 80.0, 0.1)
    radii = np.array([0.1, 0.3, 0.0, 0.02])[np.arange(200) % 4]
    some = TrunkPaths(some.length, some.weight, some.angle, radii, some.clamped)
    exact = direct_sum(some, 8e3, 4000, AIR)
    assert max(errors(Expansions().sum(some, 8e3, 4000, AIR, 1e-4), exact, 8e3)) < 1e-4


@pytest.mark.slow
def test_192_khz() -> None:
    """ka to 176; the air takes 3 dB a metre at the band's end."""
    some = paths(40, 10.0, 20.0, 0.1)
    exact = direct_sum(some, 192e3, 20_000, AIR)
    found = Expansions().sum(some, 192e3, 20_000, AIR, 1e-3)
    assert max(errors(found, exact, 192e3)) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("temperature", [-40.0, 50.0])
@pytest.mark.parametrize("humidity", [0.01, 100.0])
def test_extreme_air(temperature: float, humidity: float) -> None:
    air = Air(temperature_c=temperature, humidity=humidity, pressure_kpa=60.0)
    some = paths(100, 10.0, 300.0, 0.2)
    exact = direct_sum(some, 24e3, 20_000, air)
    assert max(errors(Expansions().sum(some, 24e3, 20_000, air, 1e-4), exact, 24e3)) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, np.pi / 2, np.pi - 1e-6, np.pi])
def test_single_angles(angle: float) -> None:
    """Straight on and straight back, where cos φ is at its ends."""
    one = TrunkPaths(
        np.array([30.0]), np.ones(1), np.array([angle]), np.array([0.25]), np.zeros(1, bool)
    )
    exact = direct_sum(one, 24e3, 4000, AIR)
    assert max(errors(Expansions().sum(one, 24e3, 4000, AIR, 1e-5), exact, 24e3)) < 1e-5


def test_nothing_wraps_and_short_records() -> None:
    some = paths(500, 10.0, 150.0, 0.25)
    prepared = Expansions()
    whole = prepared.sum(some, 24e3, 24_000, AIR, 1e-4)
    for count in (1, 7, 700, 5003):
        part = prepared.sum(some, 24e3, count, AIR, 1e-4)
        assert len(part) == count
        np.testing.assert_allclose(part, whole[:count], atol=2e-4 * np.abs(whole).max())
    before = int((some.earliest.min() / 343.0) * 24e3) - 256
    assert np.abs(whole[:before]).max() < 1e-5 * np.abs(whole).max()


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


@pytest.mark.slow
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
def test_hard_places(source: tuple[float, float], receiver: tuple[float, float]) -> None:
    """Trunks exactly between, exactly behind, on and around both; one 3 km away; any number."""
    rng = np.random.default_rng(4)
    rows = [(0.5, 0.0), (8.0, 0.0), (-8.0, 0.0), (0.0, 3000.0), *rng.uniform(-40, 40, (63, 2))]
    trunks = Trunks(np.array(rows), np.full(67, 0.3), np.arange(67))
    exact, fast = (
        tree_response(
            trunks,
            np.array(source),
            np.array(receiver),
            Reverb(duration=20.0, sample_rate=2000.0, tolerance=tolerance),
            AIR,
        )
        for tolerance in (0.0, 1e-4)
    )
    assert exact.exact
    assert not fast.exact
    assert fast.heard.all()
    assert fast.clamped == exact.clamped == (np.hypot(8 - receiver[0], receiver[1]) < 0.3)
    assert max(errors(fast.samples, exact.samples, 2000.0)) < 1e-4


def test_no_trunks() -> None:
    none = paths(0, 10.0, 150.0, 0.25)
    assert not Expansions().sum(none, 24e3, 100, AIR, 1e-4).any()


def test_sectors_cover_every_angle_once() -> None:
    for layer in expand(Key(24e3, 0.25, 0.25, 343.0, 1e-4)):
        assert layer.sectors[0].low == -1.0
        assert layer.sectors[-1].high == 1.0
        for before, after in zip(layer.sectors[:-1], layer.sectors[1:], strict=True):
            assert before.high == after.low > before.low


def test_order_of_trunks_does_not_matter() -> None:
    some = paths(2000, 10.0, 150.0, 0.25)
    order = np.random.default_rng(3).permutation(2000)
    prepared = Expansions()
    one, other = (prepared.sum(p, 24e3, 9000, AIR, 1e-6) for p in (some, some.select(order)))
    np.testing.assert_allclose(one, other, atol=1e-12)
