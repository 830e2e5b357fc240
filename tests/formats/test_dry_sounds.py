"""What a reverb sounds like: a clap or a call that is a clap or a call, convolved as the sum says."""

import numpy as np
import pytest

from forest_addon.formats.wav import write_wav
from forest_addon.results.dry_sounds import CALL, PEAK_DB, dry_sound
from forest_addon.sensing.reverb.auralise import auralise, normalised


def direct(response, dry):
    """The convolution, sample by sample."""
    wet = np.zeros(len(response) + len(dry) - 1)
    for n, value in enumerate(response):
        wet[n : n + len(dry)] += value * dry
    return wet


def test_a_clap_is_short_and_where_hands_resonate():
    samples, rate = dry_sound("clap")
    assert np.abs(samples).max() == pytest.approx(1)
    energy = np.cumsum(samples**2) / np.sum(samples**2)
    assert np.searchsorted(energy, 0.95) / rate < 0.010  # Repp 1987: a few milliseconds
    power = np.abs(np.fft.rfft(samples, 8192)) ** 2
    centre = np.sum(np.fft.rfftfreq(8192, 1 / rate) * power) / power.sum()
    assert 500 < centre < 3500
    assert (dry_sound("clap")[0] == samples).all()


def test_a_call_is_twenty_times_slower_and_falls():
    samples, rate = dry_sound("call")
    assert len(samples) / rate == pytest.approx(20 * CALL.call_duration, rel=1e-3)
    pieces = np.array_split(samples, 8)
    pitch = [np.count_nonzero(np.diff(np.sign(p))) / 2 / (len(p) / rate) for p in pieces]
    assert pitch == sorted(pitch, reverse=True)
    assert 1200 < pitch[-1] < pitch[0] < 4000


@pytest.mark.parametrize("channels", [1, 3])
def test_it_is_the_sum_of_shifted_copies(channels):
    rng = np.random.default_rng(2)
    response, dry_rate = rng.standard_normal((40, channels)), 48_000.0
    dry, rate = dry_sound("clap")
    assert rate == dry_rate
    wet, _ = normalised(auralise(response, dry, rate, rate), PEAK_DB)
    expected = np.column_stack([direct(row, dry) for row in response.T])
    expected *= 10 ** (PEAK_DB / 20) / np.abs(expected).max()
    assert np.abs(wet - expected).max() < 1e-12


def test_a_file_of_ones_own(tmp_path):
    dry = np.array([0.5, 0.0, -0.25])
    write_wav(tmp_path / "dry.wav", dry, 8000)
    samples, rate = dry_sound("file", tmp_path / "dry.wav")
    assert rate == 8000
    wet = auralise(np.array([0.0, 1.0]), samples, rate, rate)[:, 0]
    assert wet == pytest.approx([0, 0.5, 0, -0.25], abs=1e-6)


def test_silence_stays():
    assert normalised(np.zeros(10), PEAK_DB) == (pytest.approx(0), 0)
