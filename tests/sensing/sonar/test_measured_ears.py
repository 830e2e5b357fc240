"""Ears that were measured all round: from arrays, CSV and SOFA, at what was measured and between."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from references.leaf_discs import discs_of

from forest_addon import api as forest
from forest_addon.formats.sofa import HeadResponses
from forest_addon.sensing.sonar.beam import MeasuredSphere
from forest_addon.sensing.sonar.equipment_files import ears_of_head, equip
from forest_addon.sensing.sonar.ping import Echo, ping
from forest_addon.spec import Air, Sonar, SpecError

BAND = (30e3, 60e3)
FREQUENCY = np.array([30e3, 40e3, 50e3, 60e3])


def directions(count: int, seed: int = 1) -> np.ndarray:
    towards = np.random.default_rng(seed).normal(size=(count, 3))
    return towards / np.linalg.norm(towards, axis=1, keepdims=True)


def level_at(towards: np.ndarray, frequency: np.ndarray, left: float = 1.0) -> np.ndarray:
    """A smooth pattern, (D, F) dB: loudest to one side, narrower at high frequencies."""
    side = 0.8 * towards[:, 0] + 0.6 * left * towards[:, 1]
    return 12.0 * (side[:, None] - 1.0) * (frequency / 40e3)


def angles(towards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation, degrees."""
    return (
        np.degrees(np.arctan2(towards[:, 1], towards[:, 0])),
        np.degrees(np.arcsin(np.clip(towards[:, 2], -1, 1))),
    )


def offsets(towards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    off = np.arccos(towards[:, 0])
    side = np.hypot(towards[:, 1], towards[:, 2])
    return off * towards[:, 1] / side, off * towards[:, 2] / side


def heard(ears: int, places: np.ndarray, file: str, folder: Path, **settings: object) -> Echo:
    sonar = Sonar(
        position=(0, 0, 0), absorption=False, leaf_model="piston", beam="omni", band=BAND, ears=ears,
        hearing="file", hearing_file=file, **({"cull": 0.0} | settings),
    )  # fmt: skip
    leaves = discs_of(places, places, 0.01)
    return ping(leaves, sonar, Air(sound_speed=340.0), equipment=equip(sonar, folder))


def test_what_was_measured_is_met_and_between_it_is_mixed() -> None:
    measured = directions(2500)
    pattern = MeasuredSphere.all_round(measured, FREQUENCY, level_at(measured, FREQUENCY))
    assert len(pattern.direction) == 2500  # nothing to fill
    gain = pattern.gain(*offsets(measured), FREQUENCY)
    np.testing.assert_allclose(20 * np.log10(gain.T), pattern.level, atol=1e-7)
    asked = directions(4000, 2)
    gain = pattern.gain(*offsets(asked), np.array([35e3]))
    wrong = 20 * np.log10(gain[0]) - level_at(asked, np.array([35e3]))[:, 0]
    assert np.abs(wrong).max() < 0.15  # dB, of 21: the sag of a plane between directions 5° apart


def test_what_was_not_measured_is_as_the_nearest_that_was() -> None:
    azimuth = np.radians(np.arange(-90, 91, 5.0))  # a half circle ahead alone
    measured = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
    level = np.linspace(-10, 0, len(azimuth))[:, None]
    pattern = MeasuredSphere.all_round(measured, FREQUENCY[:1], level)
    behind = np.array([[-0.5, math.sqrt(0.75), 0.0], [-0.5, -math.sqrt(0.75), 0.0]])
    found = 20 * np.log10(pattern.gain(*offsets(behind), BAND[:1])[0])
    np.testing.assert_allclose(found, [0, -10], atol=0.6)


@pytest.mark.medium
def test_the_fast_sum_keeps_its_tolerance_with_ears_all_round(tmp_path: Path) -> None:
    measured = directions(300)
    level = np.stack([level_at(measured, FREQUENCY, left) for left in (1.0, -1.0)])
    azimuth, elevation = angles(measured)
    file = forest.save_pattern(
        tmp_path / "ears.csv", FREQUENCY, level, azimuth_deg=azimuth, elevation_deg=elevation
    )
    places = directions(400, 3) * np.random.default_rng(4).uniform(1, 4, (400, 1))
    fast = heard(2, places, file, tmp_path, tolerance=1e-5)
    exact = heard(2, places, file, tmp_path, tolerance=0.0)
    alone = [np.abs(heard(2, places[i : i + 1], file, tmp_path).spectra).max() for i in range(8)]
    wrong = np.abs(fast.spectra - exact.spectra).max()
    assert wrong <= 1e-5 * 400 * max(alone)
    assert not np.allclose(exact.spectra[0], exact.spectra[1], rtol=0.1)


def test_a_heads_file_gives_each_ear_its_own_levels(tmp_path: Path) -> None:
    """The echo of a leaf over what ears make of it that hear all alike, against the file's DFT."""
    sofar = pytest.importorskip("sofar")
    rate, measured = 192e3, directions(200)
    rng = np.random.default_rng(8)
    taps = rng.normal(size=(200, 2, 4)) * [[1.0], [0.4]] + [4.0, 0, 0, 0]
    azimuth, elevation = angles(measured)
    file = sofar.Sofa("SimpleFreeFieldHRIR")
    file.Data_IR, file.Data_SamplingRate = taps, rate
    file.SourcePosition = np.column_stack([azimuth % 360, elevation, np.ones(200)])
    sofar.write_sofa(str(tmp_path / "head.sofa"), file)
    for row in (3, 77):
        place = 2.0 * measured[row : row + 1]
        echo = heard(2, place, "head.sofa", tmp_path, ear_spacing=0.0)
        flat = forest.save_pattern(tmp_path / "flat.csv", [40e3], [[0.0]] * 2, angle_deg=[0, 180])
        plain = heard(2, place, flat, tmp_path, ear_spacing=0.0)
        gain = 20 * np.log10(np.abs(echo.spectra / plain.spectra))
        turn = np.exp(-2j * np.pi * np.outer(np.arange(4), echo.frequency) / rate)
        wanted = 20 * np.log10(np.abs(taps[row] @ turn))
        off = (gain - wanted)[:, (echo.frequency >= BAND[0]) & (echo.frequency <= BAND[1])]
        np.testing.assert_allclose(off[0].mean(), off[1].mean(), atol=0.2)  # one reference for both
        assert np.abs(off - off.mean()).max() < 0.5  # dB: the polynomial over the frequency


def test_what_cannot_be_heard_is_said(tmp_path: Path) -> None:
    head = HeadResponses(directions(50), np.ones((50, 2, 8)), 44100.0)
    with pytest.raises(SpecError, match="up to 22,050 Hz and the band goes to 60,000 Hz"):
        ears_of_head(head, BAND, "head.sofa")
    with pytest.raises(SpecError, match="silent"):
        ears_of_head(HeadResponses(directions(50), np.zeros((50, 2, 8)), 2e5), BAND, "head.sofa")
    level = np.zeros((2, 50, 1))
    azimuth, elevation = angles(directions(50))
    file = forest.save_pattern(
        tmp_path / "ears.csv", [40e3], level, azimuth_deg=azimuth, elevation_deg=elevation
    )
    with pytest.raises(SpecError, match="set ears = 2"):
        heard(3, np.ones((1, 3)), file, tmp_path)
    with pytest.raises(SpecError, match="a beam takes one"):
        equip(Sonar(beam="file", beam_file=file), tmp_path)
    (tmp_path / "bad.csv").write_text("ear,azimuth_deg,elevation_deg,40000\n1,0,0,0\n")
    with pytest.raises(SpecError, match="number ears from 0"):
        heard(1, np.ones((1, 3)), "bad.csv", tmp_path)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"level_db": [[0], [0]]}, "takes angle_deg, or"),
        ({"level_db": [[0], [0]], "angle_deg": [0, 90, 180]}, r"shape \(2, 1\); give \(3, 1\)"),
        ({"level_db": [[0], [math.nan]], "angle_deg": [0, 90]}, "finite"),
        ({"level_db": [[[0], [0]]], "angle_deg": [0, 90]}, "needs azimuth_deg"),
        ({"level_db": [["loud"]], "angle_deg": [0]}, "arrays of numbers"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tmp_path: Path, given: dict, words: str) -> None:
    with pytest.raises(SpecError, match=words):
        forest.save_pattern(tmp_path / "x.csv", [40e3], **given)
    assert not list(tmp_path.iterdir())
