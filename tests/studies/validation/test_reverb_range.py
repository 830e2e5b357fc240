"""Levels by distance: a recording made up of known losses is read as such; a stand's curve is its energy."""

import numpy as np
import pytest

from forest_addon.acoustics.air import absorption
from studies.validation.recordings import (
    ALPINE,
    BANDS,
    ExpectedEnergy,
    plausible_stands,
    range_of,
    read_range,
)


def test_a_made_up_recording(tmp_path):
    """0.1 dB a metre over spreading and air; the last distance is below the background."""
    distance = np.array([1.0, 10.0, 20.0, 50.0, 100.0])
    frequency = np.linspace(0.0, 12_000.0, 600)
    air = absorption(BANDS, ALPINE.temperature_c, ALPINE.humidity, ALPINE.pressure_kpa)
    loss = np.interp(frequency, BANDS, air)[:, None] * 8.686
    level = -20 * np.log10(distance) - (0.1 + loss) * distance
    background = np.full(level.shape, 1e-9)
    background[:, -1] = 1.0
    np.savez(
        tmp_path / "made.npz",
        distance_m=distance,
        frequency=frequency / 1000.0,
        signal_psd_mean=10 ** (level / 10) + background,
        background_psd_mean=background,
    )
    found = read_range(tmp_path / "made.npz")
    np.testing.assert_allclose(found.excess[:, 2], 1.0, atol=0.35)
    np.testing.assert_allclose(found.excess[0, 1:4], [0.0, 1.0, 4.0], atol=0.1)
    assert np.isnan(found.excess[:, -1]).all()


@pytest.mark.medium
def test_a_stand_takes_more_the_farther_and_the_higher():
    stand = plausible_stands(4, 1)[0]
    found = range_of(stand, np.array([10.0, 80.0]))
    assert found.excess[3, 1] > 3.0
    np.testing.assert_array_equal(found.excess[:, 0], 0.0)


def test_an_expected_decay_is_read_as_what_it_is():
    """Without direct sound an exponential of T60 0.8 s; with as much direct sound, 3 dB more C50 or so."""
    rate = 6.0 * np.log(10.0) / (0.8 * 340.0)  # a metre
    length = np.geomspace(9.0, 612.0, 4000)
    scattered = np.exp(-rate * (length - 9.0))[None]
    t20, c50 = ExpectedEnergy(np.zeros(1), length, scattered).decay(340.0)
    assert t20[0] == pytest.approx(0.8, rel=0.01)
    late = np.exp(-rate * 0.05 * 340.0)
    assert c50[0] == pytest.approx(10 * np.log10((1 - late) / late), abs=0.05)
    with_direct = ExpectedEnergy(np.array([1.0 / rate]), length, scattered).decay(340.0)[1]
    assert with_direct[0] == pytest.approx(10 * np.log10((2 - late) / late), abs=0.05)
