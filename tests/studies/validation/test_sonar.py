"""The study of the sonar: measures in closed form, a made-up pole that tells its recorder, leaves' areas."""

import argparse
import math
import shutil
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.io import wavfile

from forest_addon.acoustics.air import absorption
from forest_addon.spec import SpecError
from studies.validation import reverb, reverb as reverb_own, run
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
from studies.validation.run import Comparison, Interval, Picture
from studies.validation.sonar import (
    ASPECTS,
    DISTANCES,
    RATE,
    RECORD,
    SPEED,
    beam_by_floor,
    calibrated,
    draw_plant,
    heard,
    leaves_of,
    measures,
    pole_mesh,
    second_echo,
    sounded,
)

TIME = np.arange(RECORD) / RATE


def tone(begin: float, lasts: float, level: float = 1.0, phase: float = 0.0) -> np.ndarray:
    inside = (begin <= TIME) & (begin + lasts > TIME)
    return level * np.where(inside, np.sin(2 * math.pi * 40e3 * (TIME - begin) + phase), 0.0)


def test_measures_are_those_of_tones():
    """Five tones of known energies that begin 1 ms after what is measured, and last 2 ms."""
    levels = np.array([1.0, 2.0, 3.0, 2.0, 1.0])
    begin = 2 * (0.5 - 0.25) / SPEED + 1e-3
    found = measures(np.array([tone(begin, 2e-3, level) for level in levels]), 0.5)
    power = levels**2
    assert found["energy"] == pytest.approx(10 * math.log10(power.mean() * 600), abs=0.05)
    assert found["spread"] == pytest.approx(power.std(ddof=1) / power.mean(), rel=1e-3)
    assert found["first"] == pytest.approx(1.2, abs=0.02)
    assert found["last"] == pytest.approx(2.8, abs=0.02)
    assert found["alike"] == pytest.approx(1.0, abs=1e-6)
    assert found["scintillation"] == pytest.approx(power.var(ddof=1) / power.mean() ** 2, rel=1e-2)


def pulse(time: np.ndarray) -> np.ndarray:
    return np.exp(-0.5 * (time / 0.1e-3) ** 2) * np.cos(2 * math.pi * 40e3 * time)


@pytest.mark.parametrize("width_deg", [40.0, 70.0])
@pytest.mark.parametrize("distance", DISTANCES)
def test_a_pole_and_its_image_tell_the_beam_and_the_height(width_deg, distance):
    """Images in an upright mirror and a hard floor 0.7 m below, a Gaussian beam."""
    radius, height = 0.03, 0.7
    straight = 2 * (distance - radius)
    path = math.hypot(straight, 2 * height)
    off = math.atan2(2 * height, straight)
    twice = 10 ** (-2 * 10 * math.log10(2) * (2 * off / math.radians(width_deg)) ** 2 / 20)

    echo = pulse(TIME - straight / SPEED - 0.3e-3) / straight
    echo += 2 * twice / path * pulse(TIME - path / SPEED - 0.3e-3)
    width, found = beam_by_floor(echo, radius, distance)
    assert found == pytest.approx(height, rel=0.02)
    assert math.degrees(width) == pytest.approx(width_deg, rel=0.03)


def test_the_recorder_gives_the_pole_back():
    """Echoes as recorded but for the window at its own distance, by physics at the other."""
    radius, poles = 0.03, {}
    for distance in DISTANCES:
        straight = 2 * (distance - radius)
        path = math.hypot(straight, 1.4)
        poles[distance] = pulse(TIME - straight / SPEED - 0.3e-3) / straight
        poles[distance] += 0.5 / path * pulse(TIME - path / SPEED - 0.3e-3)
        poles[distance] /= math.sqrt(distance)
    recorder = calibrated(poles, radius)
    for distance, most in zip(DISTANCES, (0.01, 0.05), strict=True):
        mesh = pole_mesh(radius, distance, recorder.height)
        _, transfer = heard([mesh], recorder.width, shading="none")
        again = sounded(recorder, transfer)
        peaks = [second_echo(each)[0] for each in (poles[distance], again)]
        assert peaks[1] == pytest.approx(peaks[0], abs=2 / RATE)
        air = math.exp(-0.15 * 2 * (distance - DISTANCES[0]))  # of 40 kHz, not in the images
        first = poles[distance][: round(RATE * (peaks[0] + 1e-3))]
        assert np.abs(again).max() == pytest.approx(air * np.abs(first).max(), rel=most)


def test_leaves_keep_their_area_flat_and_bent():
    plant = draw_plant(1, 3)
    area = math.pi * plant.length * plant.width
    flat, bent = (leaves_of(plant, curved) for curved in (False, True))
    size = np.linalg.norm(flat.area_vectors(), axis=1)
    assert np.bincount(flat.leaf, size) == pytest.approx(area, rel=1e-6)
    whole = np.linalg.norm(bent.area_vectors(), axis=1).reshape(len(area), -1).sum(axis=1)
    assert whole == pytest.approx(area, rel=0.03)
    assert (bent.leaf == -1).all()
    assert ASPECTS == 5


# ------------------------------------------------------------------------------------------- reverb
# The reverb's validation: laws of decay, plausible stands, maps of trees, and exact ensembles.

HERTZ = 16e3
BANDS = np.array([1000.0])


def noise(level):
    return np.random.default_rng(1).standard_normal(len(level)) * level


def test_an_exponential_and_a_power_law_are_told_apart():
    time = np.arange(int(1.2 * HERTZ)) / HERTZ
    fast = decay_of(noise(10.0 ** (-3.0 * time / 0.6)), HERTZ, BANDS)
    assert fast.exponential[0] < 0.7 * fast.power[0]
    assert fast.t20[0] == pytest.approx(0.6, rel=0.1)
    slow = decay_of(noise((0.01 + time) ** -1.5), HERTZ, BANDS)
    assert slow.power[0] < 0.7 * slow.exponential[0]
    assert slow.exponent[0] == pytest.approx(3.0, rel=0.1)


def test_a_recording_begins_shortly_before_its_onset(tmp_path):
    samples = np.zeros(40_000, np.float32)
    samples[30_000] = 1.0
    wavfile.write(tmp_path / "clap.wav", 32_000, samples)
    found = read_recording(tmp_path / "clap.wav", HERTZ)
    assert np.argmax(np.abs(found)) == pytest.approx(0.002 * HERTZ, abs=3)
    (tmp_path / "none.wav").write_bytes(b"no sound")
    with pytest.raises(SpecError, match="no WAV"):
        read_recording(tmp_path / "none.wav", HERTZ)


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


# -------------------------------------------------------------------------------------------- frame
# The frame of ``validate``: what a subject returns is printed, kept whole, and joined to a page.


def arguments(**given):
    plain = {"data": None, "file": None, "stand": None, "scene": None, "seed": 1, "docs": None}
    return argparse.Namespace(**(plain | given))


@pytest.fixture
def subject(monkeypatch):
    """A subject of its own in place of that of leaves, which draws a picture."""

    def validate(data, out, arguments):
        picture = out / "angles.png"
        picture.write_bytes(b"picture")
        return [
            Comparison(
                *("mean", "deg", Interval(34.0, 33.0, 35.0), Interval(36.0, 35.5, 37.0), False),
                words="it stands steeper",
                before=Interval(60.0),
                pictures=(Picture(picture, "Angles."),),
            ),
            Comparison("spread", "deg", None, Interval(20.0), None),
        ]

    module = ModuleType("studies.validation.leaves")
    module.TITLE, module.SUMMARY, module.validate = "Leaves", "How they face.", validate
    monkeypatch.setitem(sys.modules, module.__name__, module)


def test_what_is_kept_is_read_as_it_was(subject, tmp_path):
    said = []
    chosen = arguments(data=tmp_path, docs=tmp_path / "docs")
    chosen.docs.mkdir()
    parts = run.run_sections(["leaves"], chosen, tmp_path / "out", said.append)
    assert (
        run._read(tmp_path / "out" / "leaves" / run.KEPT, tmp_path / "out" / "leaves") == parts[0]
    )
    text = "\n".join(said)
    assert "mean, deg" in text
    assert "34 (33 to 35)" in text
    assert "it stands steeper" in text
    page = (chosen.docs / "validation.md").read_text(encoding="utf-8")
    assert "0 agree, 1 do not and 0 cannot" in page
    assert "pictures/validation/angles.png" in page
    assert (chosen.docs / "pictures" / "validation" / "angles.png").read_bytes() == b"picture"


def test_the_page_of_the_documentation_is_what_its_kept_parts_give(tmp_path):
    docs = Path(__file__).parents[3] / "docs"
    shutil.copytree(docs / "validation", tmp_path / "validation")
    page = run.write_page(tmp_path / "elsewhere", tmp_path)
    assert page.read_text(encoding="utf-8") == (docs / "validation.md").read_text(encoding="utf-8")


def test_what_cannot_be_asked_for(tmp_path):
    with pytest.raises(SpecError, match=r".leafs. is not known; did you mean .leaves.\?"):
        run.run_sections(["leafs"], arguments(data=tmp_path), tmp_path)
    with pytest.raises(SpecError, match="is no folder; give that of the measurements"):
        run.run_sections(["leaves"], arguments(data=tmp_path / "none"), tmp_path)


@pytest.mark.parametrize(
    ("measured", "simulated", "verdict"),
    [
        (Interval(10.0, 9.0, 11.0), Interval(10.5, 9.5, 11.5), run.AGREES),  # tells a fifth
        (Interval(17.9, 6.2, 23.9), Interval(8.02, 7.94, 9.0), run.UNTOLD),  # tells a half
        (Interval(10.0), Interval(10.5, 4.0, 17.0), run.AGREES),  # what a row says
    ],
)
def test_intervals_that_any_value_would_meet_do_not_agree(measured, simulated, verdict):
    assert (
        Comparison("height", "m", measured, simulated, measured.meets(simulated)).verdict == verdict
    )
