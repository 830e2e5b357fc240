"""Decay, reverberation time and clarity against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from forest_addon.sensing.metrics import (
    clarity_db,
    energy_decay_db,
    onset,
    reverberation_time,
)

RATE = 8000.0


def exponential(seconds_per_60_db: float, length: float = 3.0, delay: float = 0.0) -> np.ndarray:
    time = np.arange(round(length * RATE)) / RATE - delay
    return np.where(time >= -1e-12, 10.0 ** (-3.0 * time / seconds_per_60_db), 0.0)


@pytest.mark.parametrize("t60", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("delay", [0.0, 0.25])
def test_exponential_decay(t60: float, delay: float) -> None:
    samples = exponential(t60, 4.0, delay)
    assert reverberation_time(samples, RATE) == pytest.approx(t60, rel=1e-4)
    assert reverberation_time(samples, RATE, (-5.0, -25.0)) == pytest.approx(t60, rel=1e-4)
    early = 1 - 10.0 ** (-6.0 * 0.05 / t60)
    assert clarity_db(samples, RATE) == pytest.approx(
        10 * math.log10(early / (1 - early)), abs=1e-6
    )
    decay = energy_decay_db(samples)
    assert decay[0] == 0
    at = round((delay + t60 / 2) * RATE)
    assert decay[at] == pytest.approx(-30.0, abs=1e-6)


def test_noise_decay() -> None:
    rng = np.random.default_rng(3)
    samples = exponential(0.8) * rng.normal(size=round(3.0 * RATE))
    assert reverberation_time(samples, RATE) == pytest.approx(0.8, rel=0.05)


def test_onset_at_minus_20_db() -> None:
    samples = np.array([0.0, 0.05, -0.1, 0.3, 1.0, 0.5])
    assert onset(samples) == 2
    assert onset(np.zeros(4)) == 0
    # What is below -20 dB before the onset neither moves it nor is late.
    lead = np.concatenate([np.full(100, 0.01), exponential(1.0)])
    assert clarity_db(lead, RATE) == pytest.approx(clarity_db(exponential(1.0), RATE), abs=1e-3)


def test_no_decay_to_read() -> None:
    assert math.isnan(reverberation_time(np.zeros(100), RATE))
    assert math.isnan(reverberation_time(np.empty(0), RATE))
    assert math.isnan(reverberation_time(np.array([1.0, 0, 0, 0]), RATE))  # at once
    short = exponential(1.0, 0.01)
    assert energy_decay_db(short)[-1] > -35
    assert math.isnan(reverberation_time(short, RATE))


def test_silence_and_no_late_sound() -> None:
    assert math.isnan(clarity_db(np.zeros(100), RATE))
    assert clarity_db(np.array([1.0, 0.0]), RATE) == math.inf
    assert (energy_decay_db(np.zeros(3)) == -np.inf).all()
