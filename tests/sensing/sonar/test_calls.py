"""Calls and their echoes: sweeps, records, Doppler, against sums in time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from references.leaf_discs import discs_of
from scipy.signal import windows

from forest_addon.sensing.sonar import calls
from forest_addon.sensing.sonar.beam import MeasuredBeam
from forest_addon.sensing.sonar.calls import Call, resampled, synthesise
from forest_addon.sensing.sonar.ping import EchoTargets, fly, ping
from forest_addon.sensing.sonar.station import Equipment, SonarPose, posed
from forest_addon.spec import Air, Sonar

AIR = Air(sound_speed=340.0)


def sonar_of(**settings: Any) -> Sonar:
    plain = {"position": (0, 0, 0), "absorption": False, "leaf_model": "piston", "beam": "omni"}
    return Sonar(**(plain | settings))


@pytest.mark.parametrize("kind", ["fm", "cf-fm"])
def test_calls_fall_from_the_top_of_the_band_to_its_foot(kind: str) -> None:
    call = synthesise(sonar_of(call=kind, call_duration=0.005))
    assert np.abs(call.samples).max() == 1
    assert call.duration == pytest.approx(0.005)
    from scipy.signal import hilbert

    turned = np.diff(np.unwrap(np.angle(hilbert(call.samples)))) * 400e3 / (2 * math.pi)
    frequency = turned[200:-200]  # the fades aside
    assert np.diff(frequency[::40]).max() < 400
    assert frequency[0] == pytest.approx(79e3 if kind == "cf-fm" else 76.5e3, rel=0.02)
    assert frequency[-1] == pytest.approx(62.8e3 if kind == "fm" else 70e3, rel=0.05)
    tone = frequency[: int(0.6 * len(frequency))]
    assert (np.ptp(tone) < 300) == (kind == "cf-fm")


def test_spectrum_is_the_transform() -> None:
    call = Call(np.random.default_rng(0).normal(size=300), 400e3)
    frequency = np.linspace(60e3, 80e3, 41)
    steps = np.outer(frequency, np.arange(300) / 400e3)
    np.testing.assert_allclose(
        call.spectrum(frequency), np.exp(-2j * math.pi * steps) @ call.samples, atol=1e-9
    )


def test_an_echo_of_a_call_is_the_call_delayed_and_weaker() -> None:
    """A leaf at 1.7 m, 10 ms; the call's own samples come back, filtered by k (d/dt of the call)."""
    sonar = sonar_of(call="fm", call_duration=0.003)
    echo = ping(discs_of([[1.7, 0, 0]], [1.0, 0, 0], 0.02), sonar, AIR)
    call = synthesise(sonar)
    rate = 400e3
    # |A| = k a²/2r², k·f = i·(ka)²/2: the echo is the derivative of the call over c, times a²/2r².
    slope = np.gradient(call.samples) * rate / 340.0 * 0.02**2 / (2 * 1.7**2)
    start = round(2 * 1.7 / 340 * rate)
    mine = echo.waveforms[0][start : start + len(slope)]
    inner = slice(150, -150)
    fine = np.corrcoef(mine[inner], slope[inner])[0, 1]
    assert fine > 0.99
    assert np.abs(mine[inner]).max() == pytest.approx(
        np.abs(mine[inner] @ slope[inner])
        / np.abs(slope[inner] @ slope[inner])
        * np.abs(slope[inner]).max(),
        rel=0.1,
    )
    assert not np.allclose(echo.waveforms, echo.responses)
    assert np.abs(echo.waveforms[0][: start - 400]).max() < 1e-2 * np.abs(mine).max()


def test_own_samples_are_brought_to_the_rate_and_stay_as_loud() -> None:
    tone = np.sin(2 * math.pi * 50e3 * np.arange(500) / 250e3) * 7000
    call = resampled(np.stack([tone, 0 * tone], 1), 250e3, sonar_of())
    assert len(call.samples) == 800
    assert np.abs(call.samples[100:-100]).max() == pytest.approx(7000, rel=1e-2)
    peak = np.argmax(np.abs(np.fft.rfft(call.samples)))
    assert np.fft.rfftfreq(800, 1 / 400e3)[peak] == pytest.approx(50e3, abs=600)
    with pytest.raises(ValueError, match="silent"):
        resampled(np.zeros(10), 250e3, sonar_of())


@pytest.mark.parametrize("record", [0.005, 0.0118, 0.05])
def test_a_given_record_cuts_and_never_wraps(record: float) -> None:
    """Leaves at 1 m and 3 m: 5.9 and 17.6 ms."""
    discs = discs_of([[1, 0, 0], [3, 0.1, 0]], [1.0, 0, 0], 0.01)
    echo = ping(discs, sonar_of(record=record), AIR)
    assert len(echo.time) == math.ceil(record * 400e3)
    assert echo.late == sum(2 * r / 340 > record for r in (1.0, math.hypot(3, 0.1)))
    whole = ping(discs, sonar_of(), AIR)
    shared = min(len(echo.time), len(whole.time), round(0.009 * 400e3))
    size = whole.envelope.max()
    if echo.late < 2:
        np.testing.assert_allclose(
            echo.responses[0, :shared], whole.responses[0, :shared], atol=1e-5 * size
        )
    else:
        assert not echo.responses.any()


def shifted(call: Call, factor: float, delay: float, count: int) -> np.ndarray:
    """The call played faster, later, sample by sample with a windowed sinc."""
    time = factor * (np.arange(count) / call.sample_rate - delay) * call.sample_rate
    n = np.arange(len(call.samples))
    return np.array([np.sum(call.samples * np.sinc(t - n)) for t in time])


@pytest.mark.parametrize("speed", [0.0, 5.0, -5.0])
def test_doppler_is_a_stretch_of_time(speed: float) -> None:
    sonar = sonar_of(call="fm", call_duration=0.002, doppler=True)
    pose = SonarPose(np.zeros(3), np.eye(3), np.array([speed, 0, 0]))
    echo = ping(discs_of([[0.5, 0, 0]], [1.0, 0, 0], 0.01), sonar, AIR, pose=pose)
    call = synthesise(sonar)
    alpha = (340 + speed) / (340 - speed)
    delayed = shifted(call, alpha, 2 * 0.5 / 340, len(echo.time))
    expected = np.gradient(delayed) * 400e3 / 340.0 * 0.01**2 / (2 * 0.5**2)
    mine = echo.waveforms[0]
    inner = slice(*(np.array([0.0032, 0.0046]) * 400e3).astype(int))
    fit = (mine[inner] @ expected[inner]) / (expected[inner] @ expected[inner])
    assert np.corrcoef(mine[inner], expected[inner])[0, 1] > 0.995
    assert 0.98 < fit < 1.25  # np.gradient is low at these frequencies, by sin x/x


@pytest.mark.medium
def test_doppler_of_many_leaves_is_the_sum_of_each() -> None:
    rng = np.random.default_rng(1)
    places = rng.normal(size=(12, 3))
    places *= (rng.uniform(0.3, 1.5, 12) / np.linalg.norm(places, axis=1))[:, None]
    sonar = sonar_of(call="cf-fm", call_duration=0.004, doppler=True, record=0.02, cull=0.0)
    pose = SonarPose(np.zeros(3), np.eye(3), np.array([7.0, 2.0, 0]))
    whole = ping(discs_of(places, places, 0.02), sonar, AIR, pose=pose)
    parts = sum(
        ping(discs_of(p[None], p[None], 0.02), sonar, AIR, pose=pose).waveforms for p in places
    )
    size = np.abs(whole.waveforms).max()
    np.testing.assert_allclose(whole.waveforms, parts, atol=2e-4 * size)


@pytest.mark.medium
@pytest.mark.parametrize(
    "known",
    [
        (60e3, 80e3),
        *(pytest.param(k, marks=pytest.mark.slow) for k in ((55e3, 90e3), (64e3, 71e3))),
    ],
)
@pytest.mark.parametrize("model", ["exact", "piston"])
def test_doppler_with_measured_ears_keeps_the_tolerance(known, model) -> None:
    """Against the sum of every path at every bin; the pattern has kinks where its frequencies end."""
    rng = np.random.default_rng(3)
    places = rng.normal(size=(300, 3)) * 0.4 + [2.0, 0, 0]
    angle = np.radians(np.arange(0.0, 181.0, 15.0))
    level = -np.minimum(30.0, 20.0 * angle**2)[:, None] + rng.normal(0, 1.5, (len(angle), 5))
    ears = MeasuredBeam(angle, np.linspace(*known, 5), level)
    sonar = sonar_of(
        call="fm", doppler=True, cull=0.0, ears=2, ear_turn_deg=25, leaf_model=model, tolerance=0.0
    )
    pose = SonarPose(np.zeros(3), np.eye(3), np.array([9.0, 3.0, 0]))
    discs = discs_of(places, rng.normal(size=(300, 3)), rng.uniform(0.003, 0.05, 300))
    given = {"pose": pose, "equipment": Equipment.of(sonar, hears=(ears,))}
    exact = ping(discs, sonar, AIR, **given)
    size = exact.size[:, None]
    loudest = np.abs(synthesise(sonar).spectrum(exact.frequency)).max()
    for tolerance in (1e-3, 1e-6):
        fast = ping(discs, sonar.changed(tolerance=tolerance), AIR, **given)
        assert (np.abs(fast.spectra - exact.spectra) <= tolerance * size).all()
        assert (np.abs(fast.called - exact.called) <= tolerance * loudest * size).all()


@pytest.mark.slow
@pytest.mark.parametrize("hearing", ["omni", "measured"])
@pytest.mark.parametrize("model", ["paper", "piston", "exact"])
def test_doppler_of_echoes_that_are_alike_keeps_the_tolerance(model: str, hearing: str) -> None:
    """Of two kinds, at two speeds, so that all errors add up: against every path at every bin."""
    count, angle = 700, np.radians([0.0, 60.0, 180.0])
    sonar = sonar_of(
        call="fm", doppler=True, cull=0.0, leaf_model=model, absorption=True, sample_rate=200e3
    )
    levels = np.array([[0.0, -1.0, 1.0], [-3.0, -8.0, -6.0], [-12.0, -15.0, -20.0]])
    ears = MeasuredBeam(angle, np.array([5e4, 7e4, 1e5]), levels)
    equipment = Equipment.of(sonar, hears=(ears,) if hearing == "measured" else ())
    pose = SonarPose(np.zeros(3), np.eye(3), np.array([9.0, 3.0, 0]))
    places, normals = (
        np.array([[2.0, 0.3, 0], [1.2, -1.5, 0.4]]),
        np.array([[1.0, 0.5, 0], [0, 1, 1]]),
    )
    size = np.array([0.012, 0.02])
    few = discs_of(places, normals, size)
    many = discs_of(np.tile(places, (count, 1)), np.tile(normals, (count, 1)), np.tile(size, count))
    given = {"pose": pose, "equipment": equipment}
    exact = ping(few, sonar.changed(tolerance=0.0), AIR, **given)
    loudest = np.abs(synthesise(sonar).spectrum(exact.frequency)).max()
    for tolerance in (1e-3, 1e-5):
        fast = ping(many, sonar.changed(tolerance=tolerance), AIR, **given)
        off = np.abs(fast.called - count * exact.called).max() / (loudest * count * exact.size[0])
        assert 1e-12 < off <= tolerance


@pytest.mark.parametrize("lead", [0.0, 7e-4])
def test_spectra_of_a_call_on_a_grid_are_those_at_each_speed(lead: float) -> None:
    call, speeds = synthesise(sonar_of(call="fm", call_duration=0.002)), np.array([0.97, 1.0, 1.04])
    frequency = 60e3 + 37.0 * np.arange(500)
    time = np.arange(len(call.samples)) / call.sample_rate - lead
    found = call.spectra_on(60e3, 37.0, 500, speeds, lead)
    for speed, spectrum in zip(speeds, found, strict=True):
        turns = np.outer(frequency / speed, time)
        exact = np.exp(-2j * np.pi * turns) @ call.samples / speed
        np.testing.assert_allclose(spectrum, exact, rtol=0, atol=1e-11 * np.abs(exact).max())


def test_a_flight_is_stacked_to_one_length() -> None:
    discs = discs_of([[1, 0, 0], [6, 0.1, 0]], [1.0, 0, 0], 0.02)
    sonar = sonar_of(beam="gaussian", beam_width_deg=(60, 60), ears=2)
    poses = [posed(sonar), SonarPose(np.array([3.0, 0, 0]), np.eye(3), np.zeros(3))]
    flight = fly(EchoTargets.of_discs(discs), sonar, AIR, poses)
    stacked = flight.stacked("responses")
    assert stacked.shape == (2, 2, len(flight.time))
    for row, echo in zip(stacked, flight.echoes, strict=True):
        np.testing.assert_array_equal(row[:, : len(echo.time)], echo.responses)
        assert not row[:, len(echo.time) :].any()
    position, axis = flight.poses()
    np.testing.assert_array_equal(position, [[0, 0, 0], [3, 0, 0]])
    np.testing.assert_array_equal(axis, [[1, 0, 0], [1, 0, 0]])
    with pytest.raises(ValueError, match="at least one pose"):
        fly(EchoTargets.of_discs(discs), sonar, AIR, [])


def test_who_made_this_peak() -> None:
    discs = discs_of([[2, 0, 0], [1.2, 0.001, 0], [3, 0, 0]], [1.0, 0, 0], [0.01, 0.02, 0.03])
    echo = ping(discs, sonar_of(), AIR)
    peak = echo.time[np.argmax(echo.envelope)]
    (row,) = echo.heard.around(float(peak), echo.sample_rate)
    assert echo.heard.number[row] == 1
    assert (np.diff(echo.heard.amplitude) <= 0).all()
    assert echo.heard.delay[row] == pytest.approx(2 * math.hypot(1.2, 0.001) / 340)


@pytest.mark.parametrize("count", [2, 3, 100, 801])
def test_a_call_fades_as_scipys_window_does(count: int) -> None:
    expected = windows.tukey(count + 2, 2 * calls.EDGE)[1:-1]
    np.testing.assert_allclose(calls._fade(count), expected, rtol=0, atol=1e-13)
