"""Echoes against sampled waveforms and closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.optimize import curve_fit, minimize_scalar

from forest_addon.formats.toml_file import read_scanner, scanner_names
from forest_addon.sensing.lidar.waveform import (
    LIGHT,
    Waveforms,
    decompose,
    find_echoes,
    fitted_echoes,
    pulse_length,
    record,
    sent_pulse,
)
from forest_addon.spec import Beam

SIGMA = 0.3


def sample(time, distance, energy, sigma):
    """Waveform at two-way times (T,) s of contacts (C,): energy a metre of range."""
    away = (time[:, None] * LIGHT / 2 - distance) / sigma
    return np.exp(-0.5 * away**2) / (sigma * np.sqrt(2 * np.pi)) @ energy


def echoes_of(distance, energy=None, pulse=None, sigma=SIGMA):
    distance = np.asarray(distance, float)
    energy = np.ones(len(distance)) if energy is None else np.asarray(energy, float)
    pulse = np.zeros(len(distance), np.int64) if pulse is None else np.asarray(pulse)
    ray = pulse * len(distance) + np.arange(len(distance))
    return find_echoes(ray, max(len(distance), 1), distance, energy, sigma)


def crests_by_grid(distance, energy, sigma):
    """Local maxima of the waveform on a grid of σ/2000."""
    x = np.arange(min(distance) - sigma, max(distance) + sigma, sigma / 2000)
    wave = sample(x * 2 / LIGHT, np.asarray(distance), np.asarray(energy), sigma)
    inner = (wave[1:-1] > wave[:-2]) & (wave[1:-1] >= wave[2:])
    return x[1:-1][inner]


def test_a_pulse_of_so_many_nanoseconds():
    # FWHM of 10 ns in time is c·10 ns/2 = 1.499 m in range.
    assert pulse_length(10.0) * 2.3548200450309493 == pytest.approx(1.49896229, rel=1e-9)


def test_one_contact_is_one_echo_to_the_last_digit():
    found = echoes_of([123.456789012345], [0.25])
    assert found.distance.tolist() == [123.456789012345]
    assert found.energy.tolist() == [0.25]
    assert found.width.tolist() == [SIGMA]


@pytest.mark.parametrize("gap", [0.0, 0.5, 1.0, 1.9, 2.0])
def test_two_equal_contacts_within_two_sigma_are_one_echo_in_the_middle(gap):
    found = echoes_of([10.0, 10.0 + gap * SIGMA])
    assert found.distance == pytest.approx([10 + gap * SIGMA / 2], abs=1e-9)
    assert found.energy == pytest.approx([2.0])
    assert found.width == pytest.approx([SIGMA * np.sqrt(1 + gap**2 / 4)])


def test_two_contacts_beyond_two_sigma_are_two_echoes_drawn_together():
    a, b = 10.0, 10.0 + 2.5 * SIGMA
    found = echoes_of([a, b])

    def wave(x):
        return -(np.exp(-((x - a) ** 2) / 2 / SIGMA**2) + np.exp(-((x - b) ** 2) / 2 / SIGMA**2))

    first = minimize_scalar(
        wave, bounds=(a, (a + b) / 2), method="bounded", options={"xatol": 1e-12}
    )
    assert len(found.distance) == 2
    assert found.distance[0] == pytest.approx(first.x, abs=1e-7)
    assert found.distance[0] > a
    assert found.distance[1] == pytest.approx(a + b - found.distance[0], abs=1e-9)


def test_far_echoes_do_not_move_each_other():
    found = echoes_of([10.0, 20.0, 30.0], [3.0, 1.0, 2.0])
    assert found.distance == pytest.approx([10, 20, 30], abs=1e-12)
    assert found.energy == pytest.approx([3, 1, 2])


def test_a_weak_contact_on_a_strong_ones_slope_is_swallowed():
    found = echoes_of([10.0, 10.0 + 2.2 * SIGMA], [1.0, 1e-3])
    assert len(found.distance) == 1
    assert found.energy == pytest.approx([1.001])


@pytest.mark.parametrize("seed", range(12))
def test_random_foliage_has_the_crests_of_its_waveform(seed):
    rng = np.random.default_rng(seed)
    distance = 40 + rng.gamma(2.0, 1.5 * SIGMA, 60)
    energy = rng.uniform(0.1, 1, 60)
    found = echoes_of(distance, energy)
    grid = crests_by_grid(distance, energy, SIGMA)
    assert len(found.distance) == len(grid)
    assert found.distance == pytest.approx(grid, abs=SIGMA / 2000)
    assert found.energy.sum() == pytest.approx(
        energy.sum(), rel=1e-12
    )  # all light is accounted for


def test_contacts_belong_to_the_crest_between_the_valleys():
    distance = np.array([1.0, 1.1, 3.0, 3.2, 3.1, 6.0])
    found = echoes_of(distance, [1, 2, 1, 1, 1, 4])
    assert found.energy == pytest.approx([3, 3, 4])


def test_pulses_are_apart_whatever_their_order():
    rng = np.random.default_rng(3)
    pulse = rng.integers(0, 50, 800)
    distance, energy = rng.uniform(5, 9, 800), rng.uniform(0.5, 1, 800)
    together = echoes_of(distance, energy, pulse)
    for number in range(50):
        rows = pulse == number
        alone = echoes_of(distance[rows], energy[rows])
        mine = together.pulse == number
        assert (together.distance[mine] == alone.distance).all()
        assert (together.energy[mine] == alone.energy).all()
    assert (np.diff(together.pulse) >= 0).all()


def test_dense_foliage_within_a_centimetre_is_one_echo():
    distance = 25 + np.random.default_rng(1).uniform(0, 0.01, 500)
    found = echoes_of(distance)
    assert len(found.distance) == 1
    assert found.distance[0] == pytest.approx(distance.mean(), abs=1e-6)


def test_the_sampled_waveform_holds_the_energy():
    time = np.linspace(0, 400e-9, 40001)
    wave = sample(time, np.array([12.0, 31.0]), np.array([2.0, 0.5]), SIGMA)
    total = np.sum(wave) * (time[1] - time[0]) * LIGHT / 2
    assert total == pytest.approx(2.5, rel=1e-9)
    assert time[np.argmax(wave)] == pytest.approx(2 * 12 / LIGHT, abs=1e-11)  # two-way time


def test_the_contact_that_stands_for_an_echo_is_the_innermost_of_the_strong():
    found = find_echoes(
        np.array([3, 1, 0, 2]),
        4,
        np.array([10.0, 10.01, 10.02, 10.03]),
        np.array([1.0, 0.6, 0.1, 0.9]),
        SIGMA,
    )
    assert found.contact.tolist() == [1]


def test_nothing_comes_back():
    found = echoes_of([])
    assert [len(array) for array in (found.pulse, found.distance, found.energy)] == [0, 0, 0]


# ------------------------------------------------------------------------------- whatever comes back


def instruments():
    """Lengths of the pulses of all instruments, metres."""
    tables = [read_scanner(name).tables for name in scanner_names()]
    lengths = {kind["beam"]["pulse_ns"] for table in tables for kind in table.values()}
    return sorted(pulse_length(length) for length in lengths)


# One pulse of 19 sub-rays: its middle crest owns the one contact just before the valley behind it.
HARD_SIGMA = 0.19096520260599778
HARD_DISTANCE = [
    4.603726448587371, 4.606746323905647, 4.585039914057052, 4.604206140163594, 4.607711508584166,
    4.697875275149075, 4.607894887604133, 4.588637505925392, 4.590658047032093, 4.610694575374582,
    4.6992313832892325, 4.605974451488044, 4.608730617181796, 4.697957508946587, 4.612390761619516,
    4.700392540703029, 4.068985619504748, 3.681032491995881, 4.7014040049208266,
]  # fmt: skip
HARD_ENERGY = [
    4.156467178376e-4, 4.150884609011e-4, 2.920888601144e-5, 4.155058845432e-4, 4.149652887694e-4,
    7.900817810521e-4, 4.148196529239e-4, 2.922817088974e-5, 2.899422421653e-5, 4.143808004705e-4,
    7.895927222211e-4, 4.151077079492e-4, 4.148557268778e-4, 7.901177934023e-4, 4.139804121130e-4,
    7.796377293331e-4, 9.878054989664e-4, 1.036429684209e-3, 7.889418956579e-4,
]  # fmt: skip


def test_a_contact_just_before_a_valley_is_its_crests():
    found = echoes_of(HARD_DISTANCE, HARD_ENERGY, sigma=HARD_SIGMA)
    assert len(found.distance) == 3
    assert found.energy[1] == HARD_ENERGY[16]
    assert found.distance == pytest.approx(
        crests_by_grid(HARD_DISTANCE, HARD_ENERGY, HARD_SIGMA), abs=HARD_SIGMA / 2000
    )


def contacts(most=100):
    """Contacts of one pulse: in clumps, far and near, some at the very same place."""
    place = st.one_of(
        st.floats(-30, 30),
        st.integers(-8, 8).map(float),
        st.floats(-2.5, 2.5),
        st.floats(-1e-9, 1e-9),
    )  # in pulse lengths
    return st.lists(
        st.tuples(place, st.floats(0, 5), st.sampled_from([0.0, 0.0, 0.5, 3.0, 40.0])),
        min_size=1,
        max_size=most,
    )


HARD_PULSE = [
    ((x - 40) / HARD_SIGMA, 5 + np.log10(e), 0.0)
    for x, e in zip(HARD_DISTANCE, HARD_ENERGY, strict=True)
]


@pytest.mark.slow
@given(
    sigma=st.sampled_from(instruments()),
    pulses=st.lists(contacts(), min_size=1, max_size=3),
    spread=st.booleans(),
)
@example(sigma=HARD_SIGMA, pulses=[HARD_PULSE], spread=False)
def test_no_pulse_is_lost_and_no_light(sigma, pulses, spread):
    place, decade, blur = (
        np.array([contact[k] for pulse in pulses for contact in pulse]) for k in range(3)
    )
    pulse = np.repeat(np.arange(len(pulses)), [len(contacts) for contacts in pulses])
    distance, energy, blur = 40 + sigma * place, 10 ** (decade - 5), sigma * blur * spread
    subray = np.concatenate([np.arange(len(contacts)) for contacts in pulses])
    found = find_echoes(pulse * 100 + subray, 100, distance, energy, sigma, blur)

    for number in range(len(pulses)):
        mine, its = found.pulse == number, pulse == number
        assert 1 <= mine.sum() <= its.sum()
        assert found.energy[mine].sum() == pytest.approx(energy[its].sum(), rel=1e-12)
        assert (np.diff(found.distance[mine]) > 0).all()
        assert (pulse[found.contact[mine]] == number).all()
        assert found.distance[mine].min() >= distance[its].min()
        assert found.distance[mine].max() <= distance[its].max()
    assert (found.width >= sigma).all()
    assert (found.energy > 0).all()
    assert len(np.unique(found.contact)) == len(found.contact)


@pytest.mark.slow
@given(sigma=st.sampled_from(instruments()), places=contacts(most=45), seed=st.integers(0, 99))
def test_every_contact_is_in_exactly_one_echo(sigma, places, seed):
    # Energies are powers of two from 2^0 to 2^44 in any order: the bits of an echo's energy are its contacts.
    distance = 40 + sigma * np.array([place for place, _, _ in places])
    energy = 2.0 ** np.random.default_rng(seed).permutation(len(places))
    found = echoes_of(distance, energy, sigma=sigma)
    taken = [{k for k in range(45) if int(e) >> k & 1} for e in found.energy]
    assert sum(len(one) for one in taken) == len(places)
    assert set().union(*taken) == set(range(len(places)))
    for one, contact in zip(taken, found.contact, strict=True):
        assert int(np.log2(energy[contact])) in one
    reach = [[distance[energy == 2.0**k][0] for k in one] for one in taken]
    assert all(max(a) <= min(b) for a, b in pairwise(reach))  # in order


@pytest.mark.parametrize("gap", [2.2, 2.4, 3.0, 6.0])
@pytest.mark.parametrize("ratio", [1.0, 0.5])
def test_gaussians_fitted_to_a_record_are_where_the_contacts_are(gap, ratio):
    """A crest is drawn to its neighbour (5.5 cm of two equal ones at 2.4σ of 4 ns), a fit is not."""
    ray, none = np.arange(2), np.zeros(2)
    distance, energy = np.array([10.0, 10.0 + gap * SIGMA]), np.array([1.0, ratio])
    waves = record(ray, 2, distance, energy, none, (SIGMA, np.ones(1), 0), SIGMA / 4)
    time = waves.index * waves.step * 2 / LIGHT
    assert waves.value == pytest.approx(sample(time, distance, energy, SIGMA), abs=1e-7)
    found = fitted_echoes(waves, ray, 2, distance, energy, SIGMA, 0.0)
    if len(found.distance) == 2 or gap > 2.4:
        assert found.distance == pytest.approx(distance, abs=1e-6)
        assert found.energy == pytest.approx(energy, rel=1e-5)
        assert found.width == pytest.approx([SIGMA, SIGMA], rel=1e-5)
        assert found.contact.tolist() == [0, 1]
    else:  # of unequal ones the weaker has no crest yet
        assert ratio < 1
        assert len(echoes_of(distance, energy).distance) == 1


def test_records_and_fits_of_a_pulse_do_not_depend_on_the_others():
    rng = np.random.default_rng(3)
    ray, distance = np.arange(7 * 60), 50 + rng.choice([0.0, 0.9, 4.0, 30.0], 420)
    distance += rng.uniform(0, 0.2, 420)
    energy, blur = rng.random(420) * (rng.random(420) > 0.2), rng.uniform(0, 0.1, 420)
    sent = sent_pulse(Beam(pulse_ns=6.0, pulse_shape=(0.2, 1.0, 0.7, 0.2, 0.05, -0.02)), 0.05)

    def made(some):
        given = ray[some], 7, distance[some], energy[some], blur[some]
        waves = record(*given, sent, 0.05)
        return waves, fitted_echoes(waves, *given[:4], SIGMA, 0.0)

    waves, whole = made(ray >= 0)
    for parts in (ray < 7 * 23, ray >= 7 * 23):
        some, echoes = made(parts)
        of = np.isin(waves.pulse, some.pulse)
        assert (some.value == waves.value[of]).all()
        assert (some.index == waves.index[of]).all()
        rows = np.isin(whole.pulse, echoes.pulse)
        for name in ("pulse", "distance", "energy", "width"):
            assert (getattr(echoes, name) == getattr(whole, name)[rows]).all()


@pytest.mark.parametrize("seed", [160, 481, 487, 528])
def test_a_gaussian_that_finds_nothing_in_noise_ends_no_fit(seed):
    """Crests of noise whose Gaussians narrow to nothing, or to each other's: the echo beside them stands."""
    rng, time = np.random.default_rng(seed), np.arange(64)
    place = rng.uniform(24, 60)
    power = np.exp(-0.5 * ((time - 20) / 2) ** 2) + 0.16 * np.exp(-0.5 * ((time - place) / 2) ** 2)
    power += 0.05 * rng.standard_normal(64)
    found = decompose(Waveforms(0 * time, time, power, 0.15), 1.2, 0.1)
    assert np.isfinite(found).all()
    assert np.abs(found[1] - 20 * 0.15).min() < 0.06


@pytest.mark.parametrize("step_ns", [1.0, 0.3])
def test_a_told_shape_keeps_its_light_and_its_range(step_ns):
    """Of a pulse with a tail: as much light, at the range where a Gaussian fitted to the pulse lies."""
    time = np.arange(60)
    shape = np.exp(-0.5 * ((time - 20) / 5) ** 2) + 0.3 * np.exp(-0.5 * ((time - 31) / 7) ** 2)
    fit, _ = curve_fit(
        lambda t, a, m, s: a * np.exp(-0.5 * ((t - m) / s) ** 2), time, shape, (1, 20, 5)
    )
    step = step_ns * 1e-9 * LIGHT / 2
    sent = sent_pulse(Beam(pulse_ns=12.0, pulse_shape=tuple(shape.tolist())), step)
    ray, distance = np.zeros(1, int), np.array([77.77])
    waves = record(ray, 1, distance, np.ones(1), np.zeros(1), sent, step)
    assert waves.value.sum() * step == pytest.approx(1, abs=2e-3)
    own = fit[1] + (waves.index * step - 77.77) / (1e-9 * LIGHT / 2)
    there = np.interp(own, time, shape, left=0, right=0)
    assert waves.value == pytest.approx(
        there * waves.value.max() / shape.max(), abs=0.01 * waves.value.max()
    )
    found = fitted_echoes(waves, ray, 1, distance, np.ones(1), SIGMA * 3, 0.0)
    assert found.distance == pytest.approx([77.77], abs=2e-3)
