"""Echoes against sampled waveforms and closed forms."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from forest_addon.sensing.lidar.waveform import LIGHT, find_echoes, pulse_length, sample

SIGMA = 0.3


def echoes_of(distance, energy=None, pulse=None, sigma=SIGMA):
    distance = np.asarray(distance, float)
    energy = np.ones(len(distance)) if energy is None else np.asarray(energy, float)
    pulse = np.zeros(len(distance), np.int64) if pulse is None else np.asarray(pulse)
    return find_echoes(pulse, np.arange(len(distance)), distance, energy, sigma)


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
        np.zeros(4, int),
        np.array([3, 1, 0, 2]),
        np.array([10.0, 10.01, 10.02, 10.03]),
        np.array([1.0, 0.6, 0.1, 0.9]),
        SIGMA,
    )
    assert found.contact.tolist() == [1]


def test_nothing_comes_back():
    found = echoes_of([])
    assert [len(array) for array in (found.pulse, found.distance, found.energy)] == [0, 0, 0]
