"""A dry sound in the forest: convolution, rates, levels, files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from forest_addon.formats.wav import read_wav, write_wav
from forest_addon.sensing.reverb.auralise import auralise, normalised, resample
from forest_addon.spec import SpecError


@pytest.mark.medium
def test_convolution_by_its_definition() -> None:
    rng = np.random.default_rng(0)
    response, dry = rng.standard_normal((30, 2)), rng.standard_normal(50)
    wet = auralise(response, dry, 8000, 8000)
    for channel in range(2):
        np.testing.assert_allclose(wet[:, channel], np.convolve(response[:, channel], dry))


def test_a_unit_impulse_changes_nothing_and_channels_are_mixed() -> None:
    dry = np.random.default_rng(0).standard_normal((40, 2))
    np.testing.assert_allclose(
        auralise(np.array([1.0]), dry, 8000, 8000)[:, 0], dry.mean(axis=1), atol=1e-15
    )


@pytest.mark.parametrize("rates", [(44_100.0, 48_000.0), (48_000.0, 24_000.0), (8000.0, 192_000.0)])
def test_a_tone_keeps_pitch_and_level_at_another_rate(rates: tuple[float, float]) -> None:
    old, new = rates
    tone = np.sin(2 * math.pi * 1000.0 * np.arange(int(old / 2)) / old)
    heard = resample(tone, old, new)
    middle = slice(int(0.1 * new), int(0.4 * new))
    expected = np.sin(2 * math.pi * 1000.0 * np.arange(len(heard)) / new)
    np.testing.assert_allclose(heard[middle], expected[middle], atol=1e-3)


def test_what_lies_above_the_new_band_is_gone() -> None:
    tone = np.sin(2 * math.pi * 15_000.0 * np.arange(48_000) / 48_000)
    heard = resample(tone, 48_000, 24_000)
    assert np.abs(heard[2400:-2400]).max() < 1e-3


def test_normalising_says_its_gain() -> None:
    samples = np.array([0.5, -4.0, 1.0])
    louder, gain = normalised(samples, -6.0)
    assert np.abs(louder).max() == pytest.approx(10 ** (-0.3))
    assert gain == pytest.approx(-6.0 - 20 * math.log10(4.0))
    assert normalised(np.zeros(3), -1.0)[1] == 0.0


def test_a_wav_that_would_clip_keeps_its_peaks(tmp_path: Path) -> None:
    samples = np.array([[0.1, 7.5], [-3.0, 0.2]])
    for rate in (4000, 192_000):
        write_wav(tmp_path / "loud.wav", samples, rate)
        found, told = read_wav(tmp_path / "loud.wav")
        assert told == rate
        np.testing.assert_array_equal(found, samples.astype(np.float32))


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        (np.int16, [-32768, 0, 16384], [-1, 0, 0.5]),
        (np.uint8, [0, 128, 192], [-1, 0, 0.5]),
        (np.int32, [-(2**31), 0, 2**30], [-1, 0, 0.5]),
    ],
)
def test_whole_numbers_become_shares_of_full_scale(
    tmp_path: Path, kind: type, values: list[int], expected: list[float]
) -> None:
    wavfile.write(tmp_path / "a.wav", 8000, np.array(values, kind))
    np.testing.assert_allclose(read_wav(tmp_path / "a.wav")[0], expected)


def test_bad_files_are_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "text.wav").write_text("no sound")
    wavfile.write(tmp_path / "empty.wav", 8000, np.empty(0, np.int16))
    wavfile.write(tmp_path / "nan.wav", 8000, np.array([np.nan], np.float32))
    for name, said in (
        ("none", "cannot be read"),
        ("text", "not a WAV"),
        ("empty", "no sound"),
        ("nan", "NaN"),
    ):
        with pytest.raises(SpecError, match=said):
            read_wav(tmp_path / f"{name}.wav")
