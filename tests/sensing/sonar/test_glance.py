"""A glance of a sonar's ears: pulses show at their distances, tones in their channels, at their levels."""

from types import SimpleNamespace

import numpy as np
import pytest

from forest_addon.drawing.echoes import cochleagram as drawn_cochleagram
from forest_addon.sensing.sonar.glance import COLUMNS, cochleagram

SPEED = 343.0
FREQUENCY = np.arange(30e3, 90e3, 10.0)
CENTRE = np.geomspace(30e3, 90e3, 40)
LASTS = 2 * 10.0 / SPEED


def at(distance, gain):
    """The spectrum of an echo from a distance."""
    return gain * np.exp(-2j * np.pi * FREQUENCY * 2 * distance / SPEED)


def test_two_pulses_are_where_they_come_from_and_as_loud_as_they_are():
    level = cochleagram(FREQUENCY, (at(2.0, 0.1) + at(7.0, 0.01))[None], CENTRE, LASTS)[0]
    assert level.shape == (40, COLUMNS)
    slices = [round(d / 10 * COLUMNS) for d in (2.0, 7.0)]
    for row in level[8:-8]:
        first = int(row.argmax())
        second = int(row[150:].argmax()) + 150
        assert abs(first - slices[0]) <= 1
        assert abs(second - slices[1]) <= 1
        assert (row[first], row[second]) == pytest.approx((-20, -40), abs=0.5)


def test_an_echo_of_part_of_the_band_is_in_those_channels():
    """Where a filter's centre is nearest to 50 kHz, that part is loudest; an octave away it is not there."""
    spectrum = at(3.0, 1.0) * (np.abs(FREQUENCY - 50e3) < 1500)
    peak = cochleagram(FREQUENCY, spectrum[None], CENTRE, LASTS)[0].max(axis=1)
    assert abs(CENTRE[int(peak.argmax())] - 50e3) < 1500
    assert peak[CENTRE > 85e3].max() < peak.max() - 20


def test_silence_is_silence_and_ears_are_apart():
    level = cochleagram(FREQUENCY, np.stack([0 * FREQUENCY, at(5, 1.0)]), CENTRE, LASTS)
    assert level[0].max() == level.min()
    assert np.isneginf(cochleagram(FREQUENCY, 0j * FREQUENCY[None], CENTRE, LASTS)).all()


def test_the_end_of_an_echo_is_not_heard_at_its_beginning():
    """Channels of the report's picture, of a click that they still ring of as the echo ends."""
    rate, click = 250_000.0, np.zeros((1, 8192))
    click[0, -60] = 1.0
    echo = SimpleNamespace(
        frequency=np.array([25e3, 80e3]), sample_rate=rate, heard_waveforms=click
    )
    _, level = drawn_cochleagram(echo)
    assert level[:, -2:].max() > level.max() - 10.0
    assert level[:, :200].max() < level.max() - 80.0
