"""Sound scattered more than once, as noise: its energy, its joint, and stands that are hard."""

import math
from dataclasses import replace

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.forest.clutter import Clutter
from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand
from forest_addon.sensing.reverb.forest.tail import tail_of
from forest_addon.sensing.reverb.forest.transport import Density
from forest_addon.sensing.reverb.metrics import octave
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb

AIR = Air(sound_speed=343.0)
TWIGS = Clutter((0.005,), ((2.0,),) * 12, (0.785,), (0.2,) * 12, 0.02)
SOURCE, RECEIVER = np.array([-5.0, 0.0, 1.5]), np.array([5.0, 0.0, 1.5])
SETTINGS = {
    "model": "forest",
    "source": (-5.0, 0.0, 1.5),
    "receiver": (5.0, 0.0, 1.5),
    "sample_rate": 4e3,
    "tolerance": 1e-3,
}


def stand_of(count, extent, radius=0.15, seed=1):
    place = np.random.default_rng(seed).uniform(-extent, extent, (count, 2))
    trunks = Trunks(place, np.full(count, radius), np.full(count, -1))
    return trunks.clear_of(np.array([SOURCE[:2], RECEIVER[:2]]))


def tail(rate=4e3, **changes):
    reverb = Reverb(**(SETTINGS | {"sample_rate": rate} | changes))
    losses = Losses.of(reverb, AIR, TrunkStand(0.1, (0.15,)), SOURCE, RECEIVER)
    return tail_of(reverb, losses, Density.even(0.1), SOURCE, RECEIVER, 0.6, (1, "test"), 1500)


def test_noise_has_the_energy_of_transport():
    """In an octave, over 0.15 to 0.4 s, mean of 12 draws: 500 degrees of freedom each, within 12 %."""
    made = tail(multiple_share=1.0, path_ground=False, turbulence=0.0)
    count, step = int(0.6 * 4e3), 343.0 / 4e3
    found = np.zeros(count)
    for number in range(12):
        found += octave(made.samples(4e3, count, AIR, stream(number, "draw")), 4e3, 500.0) ** 2 / 12
    rows = np.arange(int(0.15 * 4e3), int(0.4 * 4e3))
    _, again = made.energies(rows * step)
    band = int(np.flatnonzero(made.band == 500.0)[0])
    lost = np.exp(-2.0 * made.losses.along(made.band[[band]]) * rows * step)
    share = 500.0 / 2000.0 * math.log(2.0)  # of white noise, by the octave's power gain
    assert found[rows].sum() == pytest.approx((again[band] * lost * step * share).sum(), rel=0.15)


def test_the_standard_error_is_the_spread_between_keys():
    """Of the level from the joint on, 12 keys: within a factor of 2 in octaves that it knows within 1 dB.

    Where a few packets bear all of it, as in low octaves, it is told too small.
    """
    reverb = Reverb(**SETTINGS)
    losses = Losses.of(reverb, AIR, TrunkStand(0.1, (0.15,), 0.2, 12.0, TWIGS), SOURCE, RECEIVER)
    given = reverb, losses, Density.even(0.1), SOURCE, RECEIVER, 0.6
    drawn = [tail_of(*given, (key, "spread"), 1200) for key in range(12)]
    joint = np.median([each.joint for each in drawn])
    length, width = drawn[0].energy[0].middle, np.diff(drawn[0].energy[0].edges)
    late = [(each.heard(length)[1] * width)[:, length >= joint].sum(axis=1) for each in drawn]
    told = np.median([each.spread for each in drawn], axis=0)
    known = told < 1.0
    assert known.sum() >= 3, told
    between = (10 * np.log10(np.array(late)[:, known])).std(axis=0, ddof=1)
    assert (np.abs(np.log2(told[known] / between)) < 1.0).all(), (told, between)


def test_nothing_comes_before_the_direct_sound():
    samples = tail().samples(4e3, 2000, AIR, stream(1, "draw"))
    assert not samples[: int(10.0 / 343.0 * 4e3)].any()
    assert samples.any()


@pytest.mark.parametrize("share", [0.02, 0.9, 1.0])
def test_energy_does_not_jump_at_the_joint(share):
    """Noise and what is left of the trunks' sum have transport's energy, whenever the joint comes."""
    made = tail(multiple_share=share)
    length = np.geomspace(12.0, 190.0, 40)
    once, again = made.energies(length)
    kept = made.kept(length) ** 2 * once * np.exp(made.lift[:, None] * length)
    noise = np.maximum(once + again - kept, 0.0)
    np.testing.assert_allclose(noise + kept, once + again, rtol=1e-9)
    assert math.isinf(made.joint) == (share == 1.0)


@pytest.mark.parametrize("changes", [{}, {"turbulence": 0.0}, {"multiple_share": 0.5}])
def test_what_noise_replaces_is_bounded_in_every_octave(changes):
    """Summed anew, band by band and at every length from the joint on, over a grid of its own."""
    made = tail(**changes)
    share = changes.get("multiple_share", 0.9)
    last = made.energy[0].edges[-1]
    length = np.geomspace(10.001, last, 4000)
    once, several = made.heard(length)
    width = np.gradient(length)
    to_come = np.cumsum((once * width)[:, ::-1], axis=1)[:, ::-1]
    all_to_come = np.cumsum(((once + several) * width)[:, ::-1], axis=1)[:, ::-1]
    after = length >= 1.1 * made.joint  # a bin of the rule
    assert after.any()
    direct = made.losses.unthinned.mean_square(made.band, np.array(10.0)) / 100.0
    direct *= np.exp(-10 * (2 * made.losses.along(made.band) + made.losses.removed(made.band)))
    whole = direct + all_to_come[:, 0]
    over = to_come > 1.2 * np.maximum((1 - share) * all_to_come, 1e-4 * whole[:, None])
    assert not over[:, after].any()
    assert over[:, length < made.joint / 1.2].any()  # nor does it come later than it must


@pytest.mark.medium
def test_trunks_after_the_joint_are_not_summed():
    """Trunks stand on beyond the joint, and are heard there where all of them are summed."""
    trunks = stand_of(9000, 150.0)
    given = SETTINGS | {"duration": 1.0}
    found = impulse_response(trunks, Reverb(**given), AIR)
    assert found.joint < 0.7
    late = int(1.3 * found.joint * 4e3)
    np.testing.assert_allclose(found.trees[late:], found.tail[late:], atol=1e-12)
    whole = impulse_response(trunks, Reverb(**(given | {"multiple_share": 1.0})), AIR)
    assert np.abs(whole.trees - whole.tail)[late : late + 400].max() > 1e-6


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_few_trunks_have_no_tail(count):
    trunks = Trunks(
        np.array([[0.0, 6.0], [4.0, -9.0]])[:count], np.full(count, 0.2), np.arange(count)
    )
    found = impulse_response(trunks, Reverb(**SETTINGS, duration=0.1), AIR)
    assert found.tail is None
    assert np.isfinite(found.samples).all()
    assert found.trees.any() == (count > 0)


@pytest.mark.medium
def test_an_opaque_stand():
    """More than 4 trunks a square metre: finite, and quiet soon."""
    trunks = stand_of(900, 7.5, 0.1)
    found = impulse_response(trunks, Reverb(**SETTINGS, duration=0.2), AIR)
    assert np.isfinite(found.samples).all()
    assert found.samples.any()


def test_a_source_in_a_trunks_shadow():
    """A trunk straight between, which no wood was told of: the sum has its shadow, within the sum's rules."""
    trunks = Trunks(np.array([[0.0, 0.0], [2.0, 8.0], [-3.0, 7.0]]), np.full(3, 0.3), np.arange(3))
    found = impulse_response(trunks, Reverb(**SETTINGS, duration=0.1), AIR)
    assert np.isfinite(found.samples).all()


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1e3, 192e3])
def test_rates_from_low_to_ultrasound(rate):
    trunks = stand_of(12, 20.0)
    reverb = Reverb(**(SETTINGS | {"sample_rate": rate, "duration": 0.06}))
    assert np.isfinite(impulse_response(trunks, reverb, AIR).samples).all()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_noise_and_channels_their_own():
    trunks = stand_of(60, 15.0)
    reverb = Reverb(**SETTINGS, duration=0.1, array=2)
    one, two = (impulse_response(trunks, reverb, AIR, key=(seed, "a")) for seed in (3, 3))
    np.testing.assert_array_equal(one.samples, two.samples)
    assert np.abs(one.tail - one.further[0].tail).max() > 0.5 * np.abs(one.tail).max()
    other = impulse_response(trunks, replace(reverb, array=1), AIR, key=(4, "a"))
    assert not np.array_equal(other.tail, one.tail)


def test_a_scene_of_before_is_as_it_was():
    """Without a model, no loss, no noise: K's weights."""
    trunks = stand_of(60, 15.0)
    plain = {key: value for key, value in SETTINGS.items() if key != "model"}
    found = impulse_response(trunks, Reverb(**plain, duration=0.1), AIR)
    assert found.tail is None
    again = impulse_response(
        trunks, Reverb(**plain, duration=0.1, bark=0.5, turbulence=9.0, trunk_height=3.0), AIR
    )
    np.testing.assert_array_equal(found.samples, again.samples)
