"""Directed sources: the products are the table, and every path has the gain of its departure angle."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from forest_addon.sensing.reverb.directivity import CARDIOID, OMNI, Directivity, read_directivity
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb, SpecError

AIR = Air(sound_speed=343.0)


def loudspeaker() -> Directivity:
    """A baffled piston of 10 cm: narrower towards high frequencies."""
    frequency = np.array([125.0, 500.0, 1000.0, 2000.0, 4000.0])
    angle = np.deg2rad(np.arange(0, 181, 10))
    x = 2 * np.pi * frequency / 343.0 * 0.1 * np.sin(np.minimum(angle, np.pi / 2))[:, None]
    return Directivity(angle, frequency, np.exp(-(x**2) / 8) + 0.01)


def test_omni_and_cardioid_are_one_product() -> None:
    cosine = np.cos(np.linspace(0, np.pi, 37))
    for pattern, expected in ((OMNI, np.ones(37)), (CARDIOID, (1 + cosine) / 2)):
        (term,) = pattern.terms(1e-9)
        assert term.flat
        np.testing.assert_allclose(term.gains(cosine) * term.of_frequency[0], expected, atol=1e-15)


def test_products_are_the_interpolated_table() -> None:
    speaker = loudspeaker()
    frequency = np.geomspace(50, 10_000, 80)  # also beyond the table
    for cosine in np.cos(np.linspace(0, np.pi, 23)):
        sums = sum(
            term.gains(np.array([cosine])) * term.spectrum(frequency)
            for term in speaker.terms(1e-12)
        )
        np.testing.assert_allclose(sums, speaker.at(cosine, frequency), atol=1e-12)
    assert len(speaker.terms(1e-2)) < len(speaker.terms(1e-12))
    row = 3
    angle, middle = speaker.angle[row], speaker.frequency
    np.testing.assert_allclose(speaker.at(math.cos(angle), middle), speaker.gain[row], rtol=1e-12)


def test_silence_is_allowed() -> None:
    mute = Directivity(np.array([0.0, np.pi]), np.array([1.0]), np.zeros((2, 1)))
    assert not listen(trunks(5), mute).samples.any()


def trunks(count: int) -> Trunks:
    rng = np.random.default_rng(3)
    return Trunks(rng.uniform(-12, 32, (count, 2)), np.full(count, 0.2), np.arange(count))


def listen(forest: Trunks, directivity: Directivity, **settings: float):
    reverb = Reverb(**{"duration": 0.4, "sample_rate": 8000.0, **settings})
    return impulse_response(forest, reverb, AIR, directivity=directivity)


@pytest.mark.slow
def test_each_path_has_the_gain_of_its_departure() -> None:
    """One trunk at a time, and 40 at once by either sum: cardioid that points away from the receiver."""
    forest = trunks(40)
    away = forest.position - (5.0, 10.0)
    gain = 0.5 - 0.5 * away[:, 0] / np.hypot(*away.T)
    apart = [
        g * listen(forest.select(np.array([m])), OMNI, tolerance=0.0).trees
        for m, g in enumerate(gain)
    ]
    expected = np.sum(apart, axis=0)
    free = listen(forest, OMNI).ground
    for tolerance in (0.0, 1e-6):
        together = listen(forest, CARDIOID, facing_azimuth_deg=180.0, tolerance=tolerance)
        assert np.linalg.norm(together.trees - expected) < 2e-5 * np.linalg.norm(expected)
        assert np.abs(together.direct).max() < 1e-15
        # The bounce leaves downwards by atan(1.5/5) from the horizon: a little of it is heard.
        share = 0.5 - 0.5 * 5 / math.hypot(5, 1.5)
        np.testing.assert_allclose(together.ground, share * free, atol=1e-15)


def test_a_directivity_by_frequency_filters_direct_and_trees() -> None:
    speaker, one = loudspeaker(), trunks(1)
    facing = {"facing_azimuth_deg": 60.0, "duration": 2.0}
    directed, free = listen(one, speaker, **facing), listen(one, OMNI, **facing)
    frequency = np.fft.rfftfreq(16_000, 1 / 8000.0)
    heard = (frequency > 200) & (frequency < 3000)
    away = one.position[0] - (5.0, 10.0)
    turn = math.atan2(away[1], away[0]) - math.pi / 3
    for part, cosine in (("direct", 0.5), ("trees", math.cos(turn))):
        ratio = np.fft.rfft(getattr(directed, part)) / np.fft.rfft(getattr(free, part))
        np.testing.assert_allclose(ratio[heard], speaker.at(cosine, frequency[heard]), atol=3e-3)


def test_a_file(tmp_path: Path) -> None:
    file = tmp_path / "speaker.csv"
    file.write_text("angle_deg, 500, 2000\n0, 0, 0\n90, -6.0206, -20\n180, -inf, -40\n")
    found = read_directivity(file)
    np.testing.assert_allclose(found.gain, [[1, 1], [0.5, 0.1], [0, 0.01]], atol=1e-5)
    np.testing.assert_allclose(found.frequency, [500, 2000])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("angle,500\n0,0\n", "two rows"),
        ("angle,500\n0,0\n90,0\n", "0 to 180"),
        ("angle,500\n0,0\n180,loud\n", '"loud" is not a number'),
        ("angle,500\n0,0\n180,nan\n", "NaN"),
        ("angle,500\n0,0\n180,0,0\n", "3 cells"),
        ("angle,500,250\n0,0,0\n180,0,0\n", "must rise"),
        ("angle,500\n0,900\n180,0\n", "200 dB"),
    ],
)
def test_bad_files_are_refused_in_words(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(SpecError, match=said):
        read_directivity(file)
    with pytest.raises(SpecError, match="no such file"):
        read_directivity(tmp_path / "none.csv")
