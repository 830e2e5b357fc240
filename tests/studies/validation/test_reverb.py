"""The reverb's validation: laws of decay, plausible stands, maps of trees, and exact ensembles."""

import argparse

import numpy as np
import pytest
from scipy.io import wavfile

from forest_addon.acoustics.air import absorption
from forest_addon.spec import SpecError
from studies.validation import reverb, reverb as reverb_own
from studies.validation.recordings import (
    ALPINE,
    BANDS as OCTAVES,
    ExpectedEnergy,
    decay_of,
    plausible_stands,
    range_of,
    read_range,
    read_recording,
)
from studies.validation.reverb import Ensemble, judge

RATE = 16e3
BANDS = np.array([1000.0])


def noise(level):
    return np.random.default_rng(1).standard_normal(len(level)) * level


def test_an_exponential_and_a_power_law_are_told_apart():
    time = np.arange(int(1.2 * RATE)) / RATE
    fast = decay_of(noise(10.0 ** (-3.0 * time / 0.6)), RATE, BANDS)
    assert fast.exponential[0] < 0.7 * fast.power[0]
    assert fast.t20[0] == pytest.approx(0.6, rel=0.1)
    slow = decay_of(noise((0.01 + time) ** -1.5), RATE, BANDS)
    assert slow.power[0] < 0.7 * slow.exponential[0]
    assert slow.exponent[0] == pytest.approx(3.0, rel=0.1)


def test_a_recording_begins_shortly_before_its_onset(tmp_path):
    samples = np.zeros(40_000, np.float32)
    samples[30_000] = 1.0
    wavfile.write(tmp_path / "clap.wav", 32_000, samples)
    found = read_recording(tmp_path / "clap.wav", RATE)
    assert np.argmax(np.abs(found)) == pytest.approx(0.002 * RATE, abs=3)
    (tmp_path / "none.wav").write_bytes(b"no sound")
    with pytest.raises(SpecError, match="no WAV"):
        read_recording(tmp_path / "none.wav", RATE)


def test_a_map_says_what_it_lacks(tmp_path):
    trees = "x,y,dbh,what,z\n1,2,20,,\n5,-3,30,tree,\n-4,6,25,,\n0,0,,source,1.5\n"
    (tmp_path / "trees.csv").write_text(trees)
    with pytest.raises(SpecError, match="receiver"):
        reverb_own.read_stand(tmp_path / "trees.csv")
    (tmp_path / "trees.csv").write_text(trees + "8,0,,receiver,1.2\n")
    trunks, source, receiver = reverb_own.read_stand(tmp_path / "trees.csv")
    np.testing.assert_allclose(trunks.radius, [0.1, 0.15, 0.125])
    np.testing.assert_allclose((source, receiver), [[0, 0, 1.5], [8, 0, 1.2]])
    (tmp_path / "trees.csv").write_text(trees.replace("20", "thick"))
    with pytest.raises(SpecError, match="line 2"):
        reverb_own.read_stand(tmp_path / "trees.csv")


@pytest.mark.slow
def test_a_recording_of_ones_own(tmp_path, monkeypatch):
    monkeypatch.setattr(reverb_own, "SEVERAL", 1)
    monkeypatch.setattr(reverb_own, "REACH", 20.0)
    rng = np.random.default_rng(2)
    rows = [f"{x:.2f},{y:.2f},0.12,," for x, y in rng.uniform(-15, 15, (20, 2))]
    ends = ["-4,0,,source,1.5", "4,0,,receiver,1.5"]
    (tmp_path / "trees.csv").write_text("\n".join(["x,y,radius,what,z", *rows, *ends]))
    decay = noise(10.0 ** (-3.0 * np.arange(32_000) / 32_000 / 0.5)).astype(np.float32)
    wavfile.write(tmp_path / "clap.wav", 32_000, decay)
    own = argparse.Namespace(file=tmp_path / "clap.wav", stand=tmp_path / "trees.csv", seed=1)
    found = reverb.validate(tmp_path, tmp_path, own)
    assert found[0].quantity == "T20 at 250 Hz"
    assert found[1].measured.value == pytest.approx(0.5, rel=0.15)
    assert found[0].pictures[0].file.is_file()


@pytest.mark.slow
def test_transport_is_what_exact_multiple_scattering_has_on_average():
    """60 trunks, ka 0.5: transport within 2.5 dB at all times; single scattering loses it late."""
    found = judge(Ensemble(60, 0.15, 8.0, 0.5, stands=2, sources=3), np.geomspace(5.5, 36.0, 7))
    assert np.abs(found.level["transport"]).max() < 2.5
    assert np.abs(found.level["transport without shadow"]).max() < 2.5
    assert np.abs(found.level["single"][:3]).max() < 2.5
    assert found.level["single"][-1] < -6.0
    assert (found.level["single, coherent extinction"][2:] < found.level["single"][2:]).all()


# -------------------------------------------------------------------------------------------- range
# Levels by distance: a recording made up of known losses is read as such; a stand's curve is its energy.


def test_a_made_up_recording(tmp_path):
    """0.1 dB a metre over spreading and air; the last distance is below the background."""
    distance = np.array([1.0, 10.0, 20.0, 50.0, 100.0])
    frequency = np.linspace(0.0, 12_000.0, 600)
    air = absorption(OCTAVES, ALPINE.temperature_c, ALPINE.humidity, ALPINE.pressure_kpa)
    loss = np.interp(frequency, OCTAVES, air)[:, None] * 8.686
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
