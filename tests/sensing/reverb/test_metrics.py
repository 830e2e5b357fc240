"""Decay, reverberation time and clarity against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from forest_addon.sensing.reverb.metrics import (
    clarity_db,
    echo_density,
    energy_decay_db,
    octave,
    octave_bands,
    onset,
    reverberation_time,
    room_metrics,
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


@pytest.mark.parametrize("t60", [0.4, 1.5])
def test_measures_of_an_exponential_decay(t60: float) -> None:
    """Closed forms: with δ = 6·ln 10/t60, D50 = 1 - e^{-δ·50 ms} and the centre is at 1/δ."""
    found = room_metrics(exponential(t60, 4 * t60, 0.1), RATE)
    decay = 6 * math.log(10) / t60
    assert found.band[0] == 0
    for seconds in (found.edt, found.t20, found.t30, found.t60):
        assert seconds[0] == pytest.approx(t60, rel=1e-4)
    assert found.d50[0] == pytest.approx(1 - math.exp(-0.05 * decay), rel=1e-6)
    early = 1 - math.exp(-0.08 * decay)
    assert found.c80[0] == pytest.approx(10 * math.log10(early / (1 - early)), abs=1e-6)
    assert found.centre_time[0] == pytest.approx(1 / (math.exp(decay / RATE) - 1) / RATE, rel=1e-6)


def test_each_octave_has_its_own_time() -> None:
    """Tones that decay at different rates, one an octave."""
    time = np.arange(round(2.0 * RATE)) / RATE
    times = {250.0: 1.2, 500.0: 0.9, 1000.0: 0.7, 2000.0: 0.5}
    tones = [
        10.0 ** (-3.0 * time / t60) * np.sin(2 * math.pi * f * time) for f, t60 in times.items()
    ]
    found = room_metrics(np.sum(tones, axis=0), RATE)
    for f, t60 in times.items():
        band = found.band.tolist().index(f)
        assert found.t30[band] == pytest.approx(t60, rel=0.02)
        assert found.t20[band] == pytest.approx(t60, rel=0.02)


def test_octaves_share_the_energy() -> None:
    rng = np.random.default_rng(5)
    bands = octave_bands(48_000.0)
    assert bands[0] == 31.25
    assert bands[-1] == 8000.0
    noise = np.zeros(60_000)
    noise[5000:-5000] = rng.normal(size=50_000)
    frequency = np.fft.rfftfreq(60_000, 1 / 48_000)
    spectrum = np.fft.rfft(noise) * ((frequency > 40) & (frequency < 9500))
    noise = np.fft.irfft(spectrum)
    parts = [octave(noise, 48_000.0, band) for band in bands]
    assert sum(np.sum(part**2) for part in parts) == pytest.approx(np.sum(noise**2), rel=1e-3)
    # White noise has energy in proportion to the width of the octave (5000 dof: 3 sigma = 6 %).
    white = rng.normal(size=60_000)
    share = np.sum(octave(white, 48_000.0, 4000.0) ** 2) / np.sum(white**2)
    assert share == pytest.approx(4000 * (math.sqrt(2) - math.sqrt(0.5)) / 24_000, rel=0.06)


def test_octaves_have_no_phase() -> None:
    click = np.zeros(8001)
    click[4000] = 1.0
    for band in octave_bands(RATE)[2:]:
        answer = octave(click, RATE, band)
        assert np.argmax(np.abs(answer)) == 4000
        np.testing.assert_allclose(answer, answer[::-1], atol=1e-9)


def test_bands_end_below_the_roll_off() -> None:
    for rate in (1000.0, 8000.0, 24_000.0, 192_000.0):
        assert all(band * 2**0.5 < 0.45 * rate for band in octave_bands(rate))
    assert max(octave_bands(24_000.0)) == 4000.0
    assert max(octave_bands(192_000.0)) == 16_000.0


def test_echo_density_of_noise_is_1() -> None:
    """4800 samples a frame: the mean over 90 frames is within 0.02 with better than 5 sigma."""
    rng = np.random.default_rng(6)
    noise = rng.normal(size=24_000) * np.exp(-np.arange(24_000) / 6000.0)
    time, density = echo_density(noise, 24_000.0)
    assert time[0] == pytest.approx(0.1)
    assert time[-1] == pytest.approx(0.9, abs=0.01)
    assert np.mean(density) == pytest.approx(1.0, abs=0.02)
    assert np.abs(density - 1).max() < 0.1


def test_echo_density_counts_echoes() -> None:
    """Of sparse Gaussian echoes it is the share of samples that sound, however loud each is."""
    rng = np.random.default_rng(7)
    for share in (0.002, 0.02, 0.2):
        sparse = np.where(rng.random(48_000) < share, rng.normal(size=48_000), 0.0)
        found = np.nanmean(echo_density(sparse, 24_000.0)[1])
        if share < 0.01:  # about one echo a window: all are levelled alike, up to 1/2 of the place
            assert share < found < 0.5 / (0.5 - 1 / math.pi) * share
        else:
            assert found == pytest.approx(share, rel=0.15)
    pulse = np.zeros(9600)
    pulse[::480] = 1.0  # 10 echoes a frame of 4800
    assert np.nanmedian(echo_density(pulse, 24_000.0)[1]) == pytest.approx(
        5 / 4800 / (0.5 - 1 / math.pi), rel=0.15
    )


def test_echo_density_of_silence_and_short_records() -> None:
    assert np.isnan(echo_density(np.zeros(24_000), 24_000.0)[1]).all()
    assert len(echo_density(np.ones(10), 24_000.0)[1]) == 1
    silent = room_metrics(np.zeros(8000), RATE)
    assert np.isnan(silent.d50).all()
    assert np.isnan(silent.t30).all()


def test_against_pyroomacoustics() -> None:
    """Its reverberation time is read at two levels of the same decay rather than from a line."""
    room = pytest.importorskip("pyroomacoustics")
    rng = np.random.default_rng(8)
    for t60 in (0.5, 1.2):
        plain = exponential(t60, 4 * t60)
        assert reverberation_time(plain, RATE) == pytest.approx(
            room.experimental.measure_rt60(plain, int(RATE), decay_db=30), rel=2e-3
        )
        noise = plain * rng.normal(size=len(plain))
        assert reverberation_time(noise, RATE) == pytest.approx(
            room.experimental.measure_rt60(noise, int(RATE), decay_db=30), rel=0.06
        )
