"""Beams of call and ears, several ears, poses."""

import math
from typing import Any

import numpy as np
import pytest
from references.echoes import discs_of

from forest_addon.sensing.sonar.beam import (
    BeamPattern,
    GaussianBeam,
    Horseshoe,
    MeasuredBeam,
    MeasuredSphere,
    Omni,
)
from forest_addon.sensing.sonar.echo import Echo
from forest_addon.sensing.sonar.ping import ping
from forest_addon.sensing.sonar.station import Equipment, SonarPose, poses_of
from forest_addon.sensing.trajectory import looking
from forest_addon.spec import Air, Sonar

AIR = Air(sound_speed=340.0)
BAND = (60e3, 80e3)


def echo_of(places: Any, **settings: Any) -> Echo:
    """Of small leaves that face the origin."""
    sonar = {"position": (0, 0, 0), "absorption": False, "leaf_model": "piston", "cull": 0.0}
    places = np.asarray(places, np.float64).reshape(-1, 3)
    return ping(discs_of(places, places, 0.01), Sonar(**(sonar | settings)), AIR)


def measured() -> MeasuredBeam:
    """A pattern with a notch at 20° and a side lobe at 40°, narrower at high frequencies."""
    angle = np.deg2rad([0, 10, 20, 40, 90, 180])
    level = np.array(
        [[0, -3, -40, -12, -30, -45], [0, -6, -30, -18, -40, -50], [0, -9, -35, -25, -50, -60.0]]
    )
    return MeasuredBeam(angle, np.array([60e3, 70e3, 80e3]), level.T)


def all_round() -> MeasuredSphere:
    """A pattern without any order, from 60 directions."""
    rng = np.random.default_rng(5)
    towards = rng.normal(size=(60, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    at = np.array([60e3, 70e3, 80e3])
    return MeasuredSphere.all_round(towards, at, rng.uniform(-40, 0, (60, 3)))


def test_horseshoe_widths_are_those_of_the_paper() -> None:
    width = np.rad2deg(Horseshoe().width(np.array([60e3, 70e3, 80e3])))
    cubic = [0.011333 * f**3 - 2.3219 * f**2 + 156.15 * f - 3402.7 for f in (60, 70, 80)]
    np.testing.assert_allclose(width, cubic, rtol=1e-12)
    half = np.deg2rad(width) / 2
    gain = Horseshoe().gain(half, np.zeros(3), np.array([60e3, 70e3, 80e3]))
    np.testing.assert_allclose(20 * np.log10(np.diag(gain)), -3.0, atol=1e-9)


def test_measured_patterns_pass_through_what_was_measured() -> None:
    pattern = measured()
    gain = pattern.gain(pattern.angle, 0 * pattern.angle, pattern.frequency)
    np.testing.assert_allclose(20 * np.log10(gain.T), pattern.level, atol=1e-9)
    single = MeasuredBeam(pattern.angle, np.array([70e3]), pattern.level[:, :1])
    assert single.gain(np.zeros(1), np.zeros(1), np.array([1e3, 9e4])).shape == (2, 1)


@pytest.mark.parametrize(
    "beam", [GaussianBeam((0.5, 0.2)), Horseshoe(), measured(), all_round(), Omni()], ids=type
)
def test_no_gain_exceeds_its_bounds(beam: BeamPattern) -> None:
    rng = np.random.default_rng(0)
    off, side = rng.uniform(0, math.pi, 3000), rng.uniform(0, 2 * math.pi, 3000)
    az, el = off * np.cos(side), off * np.sin(side)
    gain = beam.gain(az, el, np.linspace(*BAND, 41)).max(axis=0)
    assert (gain <= beam.loudest(az, el, BAND) * (1 + 1e-9)).all()
    for nearer in (0.0, 0.1, 0.7):
        away = np.maximum(off - nearer, 0)
        assert (gain <= beam.ceiling(away, BAND) * (1 + 1e-9)).all()


def test_emission_and_reception_are_separate() -> None:
    place = 2 * np.array([[math.cos(0.3), math.sin(0.3), 0.0]])
    both = echo_of(place, beam_width_deg=(40, 40))
    deaf = echo_of(place, beam_width_deg=(40, 40), hearing="omni")
    wide = echo_of(place, beam_width_deg=(40, 40), hearing="gaussian", hearing_width_deg=(80, 80))
    none = echo_of(place, beam="omni")
    one_way = np.abs(deaf.spectrum / none.spectrum)
    np.testing.assert_allclose(np.abs(both.spectrum / none.spectrum), one_way**2, rtol=1e-6)
    np.testing.assert_allclose(np.abs(wide.spectrum / none.spectrum), one_way**1.25, rtol=1e-6)


def test_beam_by_frequency_colours_the_echo() -> None:
    place = 2 * np.array([[math.cos(0.3), math.sin(0.3), 0.0]])
    coloured, plain = echo_of(place, beam="horseshoe"), echo_of(place, beam="omni")
    gain = np.abs(coloured.spectrum / plain.spectrum)
    width = np.deg2rad(np.polyval([0.011333, -2.3219, 156.15, -3402.7], coloured.frequency / 1e3))
    np.testing.assert_allclose(20 * np.log10(gain), -2 * 3 * (0.3 / (width / 2)) ** 2, atol=1e-6)


def test_a_measured_beam_is_heard() -> None:
    place = 2 * np.array([[math.cos(0.3), math.sin(0.3), 0.0]])
    sonar = Sonar(
        position=(0, 0, 0), absorption=False, beam="file", beam_file="x", leaf_model="piston"
    )
    discs = discs_of(place, place, 0.01)
    with pytest.raises(ValueError, match="has not been read"):
        ping(discs, sonar, AIR)
    equipment = Equipment(measured(), (measured(),), None)
    gain = (
        ping(discs, sonar, AIR, equipment=equipment).spectrum / echo_of(place, beam="omni").spectrum
    )
    at = echo_of(place, beam="omni").frequency
    expected = measured().gain(np.array([0.3]), np.zeros(1), at)[:, 0] ** 2
    np.testing.assert_allclose(np.abs(gain), expected, rtol=1e-5)


def test_two_ears_hear_a_leaf_to_the_left_apart() -> None:
    """The left ear first, by the difference of the paths; each with its own spreading."""
    place = np.array([0.8, 0.6, 0.0])
    echo = echo_of(place, beam="omni", ears=2, ear_spacing=0.04)
    legs = [np.linalg.norm(place - [0, y, 0]) for y in (0.02, -0.02)]
    turned = np.exp(-2j * math.pi * echo.frequency * (1.0 + legs[0]) / 340)
    assert np.abs(np.angle(echo.spectra[0] / (1j * turned))).max() < 0.02
    phase = np.unwrap(np.angle(echo.spectra[1] / echo.spectra[0]))
    later = -np.polyfit(echo.frequency, phase, 1)[0] / (2 * math.pi)
    assert later == pytest.approx((legs[1] - legs[0]) / 340, rel=0.01)
    level = np.abs(echo.spectra[1] / echo.spectra[0]).mean()
    assert level == pytest.approx(legs[0] / legs[1], rel=2e-3)
    assert echo.responses.shape == echo.envelopes.shape == (2, len(echo.time))


def test_a_leaf_ahead_is_the_same_at_both_ears_and_turned_ears_differ() -> None:
    echo = echo_of([1.5, 0, 0], ears=2, beam_width_deg=(40, 40))
    np.testing.assert_allclose(echo.spectra[0], echo.spectra[1], rtol=1e-9)
    aside = echo_of([1.5, 0.5, 0], ears=2, ear_turn_deg=20.0, beam_width_deg=(40, 40))
    assert np.abs(aside.spectra[0]).mean() > 1.5 * np.abs(aside.spectra[1]).mean()
    many = echo_of([1.5, 0.5, 0], ears=7, ear_spacing=0.3)
    assert many.spectra.shape[0] == 7


def test_poses_look_and_fly() -> None:
    position = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1.0]])
    beam = np.array([0.1, 0.2, 0.3])
    flown = looking(position, np.zeros(3), np.zeros(3), beam, speed=3.0)
    gone = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert np.diff(flown.time) == pytest.approx(gone / 3.0)
    assert looking(position, np.zeros(3), np.zeros(3)).time == pytest.approx([0, 1, 2])
    poses = poses_of(flown)
    assert [pose.width for pose in poses] == [0.1, 0.2, 0.3]
    np.testing.assert_allclose([np.linalg.norm(pose.velocity) for pose in poses], 3.0)
    np.testing.assert_allclose(poses[0].velocity, [3, 0, 0])
    (alone,) = poses_of(looking(position[:1], np.array([math.pi / 2]), np.zeros(1), speed=2.0))
    np.testing.assert_allclose(alone.velocity, [0, 2, 0], atol=1e-15)


def test_a_pose_of_its_own_width() -> None:
    place = np.array([[2.0, 0.6, 0.0]])
    discs = discs_of(place, place, 0.01)
    sonar = Sonar(position=(0, 0, 0), leaf_model="piston", beam_width_deg=(20, 20))
    wide = Sonar(position=(0, 0, 0), leaf_model="piston", beam_width_deg=(60, 60))
    pose = SonarPose(np.zeros(3), np.eye(3), np.zeros(3), math.radians(60))
    np.testing.assert_allclose(
        ping(discs, sonar, AIR, pose=pose).spectrum, ping(discs, wide, AIR).spectrum
    )


def test_a_tone_has_one_bin() -> None:
    echo = echo_of([2, 0, 0], band=(70e3, 70e3), record=0.02)
    k = 2 * math.pi * 70e3 / 340
    assert echo.frequency.tolist() == [70e3]
    assert abs(echo.spectrum[0]) == pytest.approx(k * 0.01**2 / 2 / 4, rel=1e-9)
    assert len(echo.time) == 8000
    np.testing.assert_allclose(echo.envelope, abs(echo.spectrum[0]), rtol=1e-9)
