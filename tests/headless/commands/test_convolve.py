"""The commands that let one hear a forest, and the findings of the paper's figures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from headless.cli import main
from headless.commands.convolve import convolve
from studies.papers.reverb_figures import Study, draw_figures, findings, responses

ROOT = Path(__file__).resolve().parents[3]
CLAP = ROOT / "assets" / "sounds" / "clap.wav"


def test_convolve_from_the_command_line(headless, tmp_path):
    response = tmp_path / "ir.wav"
    wavfile.write(response, 48_000, np.array([[0, 1.0], [0.5, 0]], np.float32))
    ended = headless("convolve", response, CLAP)
    assert ended.returncode == 0, ended.stderr
    rate, wet = wavfile.read(tmp_path / "ir-clap.wav")
    _, dry = wavfile.read(CLAP)
    assert (rate, wet.dtype) == (48_000, np.float32)
    np.testing.assert_allclose(wet[1:, 0], 0.5 * dry / 32768, atol=1e-7)
    np.testing.assert_allclose(wet[:-1, 1], dry / 32768, atol=1e-7)
    assert headless("convolve", tmp_path / "none.wav", CLAP).returncode == 2


@pytest.mark.parametrize(
    ("name", "said"), [("wet.mp3", "must end in .wav"), ("dry.wav", "is read by")]
)
def test_no_file_of_another_kind_and_none_that_is_read_is_written(tmp_path, capsys, name, said):
    dry = tmp_path / "dry.wav"
    dry.write_bytes(b"a recording")
    out = ("--out", str(tmp_path / name))
    assert main(["convolve", str(tmp_path / "ir.wav"), str(dry), *out]) == 2
    assert said in capsys.readouterr().err
    assert dry.read_bytes() == b"a recording"
    assert [path.name for path in tmp_path.iterdir()] == ["dry.wav"]


@pytest.mark.parametrize(
    ("name", "said"),
    [("ir.wav", "that can be read: its header is broken"), (".", "Is a directory")],
)
def test_what_is_no_impulse_response_is_said_in_our_words(
    tmp_path, capsys, monkeypatch, name, said
):
    monkeypatch.chdir(tmp_path)
    Path("ir.wav").write_bytes(b"RIFF\0\0\0\0WAVE")
    assert main(["convolve", name, str(CLAP)]) == 2
    assert said in capsys.readouterr().err


def test_levels_above_full_scale_stay_unless_normalised(tmp_path):
    said = []
    wavfile.write(tmp_path / "ir.wav", 24_000, np.array([40.0], np.float32))
    convolve(tmp_path / "ir.wav", CLAP, tmp_path / "new" / "a.wav", None, said.append)
    assert np.abs(wavfile.read(tmp_path / "new" / "a.wav")[1]).max() > 10
    assert "resampled from 48000 to 24000 Hz" in said[0]
    assert "clip" in said[-1]
    convolve(tmp_path / "ir.wav", CLAP, tmp_path / "b.wav", -1.0, said.append)
    peak = np.abs(wavfile.read(tmp_path / "b.wav")[1]).max()
    assert peak == pytest.approx(10 ** (-0.05), rel=1e-5)


@pytest.mark.slow
def test_figures_and_findings(tmp_path, monkeypatch):
    """A tiny study: files, and verdicts that follow the responses they are given."""
    tiny = Study((300, 900), (10.0, 40.0), (1,))
    monkeypatch.setattr("studies.papers.reverb_figures.QUICK", tiny)
    sentences = draw_figures(tmp_path, quick=True, say=lambda _: None)
    assert len(list(tmp_path.glob("figure-*.png"))) == 4
    assert (tmp_path / "findings.txt").read_text(encoding="utf-8").splitlines() == sentences

    found = responses(tiny)
    noise = np.random.default_rng(0).standard_normal(96_000)
    time = np.arange(96_000) / 24e3

    sparse = noise * (np.arange(96_000) % 64 == 0) * 8.0  # of the same energy

    def decaying(number, distance):
        """Noise whose decay takes longer with more trees and with distance; of many, soon sparse."""
        seconds = (0.6 if number == 300 else 1.2) + distance / 40
        heard = np.where((time > 0.7) & (number == 900), sparse, noise)
        zero = np.zeros(96_000)
        return {"direct": zero, "ground": zero, "trees": heard * 10 ** (-3 * time / seconds)}

    made = {key: replace(each, **decaying(*key[:2])) for key, each in found.items()}
    verdicts = [": reproduced" in sentence for sentence in findings(tiny, made)]
    assert verdicts == [False, False, True, True]  # more trees, longer; C50 does not fall
