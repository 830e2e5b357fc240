"""The receiver of a sonar: its transducer, its noise, and what it makes of echoes."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from references.echoes import discs_of
from scipy.signal import hilbert, windows
from scipy.stats import chi2, poisson

from forest_addon import api as forest
from forest_addon.drawing.echoes import cochleagram as drawn_cochleagram
from forest_addon.formats.sofa import HeadResponses
from forest_addon.sensing.sonar import calls
from forest_addon.sensing.sonar.beam import MeasuredSphere
from forest_addon.sensing.sonar.calls import Call, resampled, synthesise
from forest_addon.sensing.sonar.echo import Echo
from forest_addon.sensing.sonar.equipment_files import ears_of_head, equip
from forest_addon.sensing.sonar.glance import COLUMNS, cochleagram
from forest_addon.sensing.sonar.ping import fly, ping
from forest_addon.sensing.sonar.receiver import REFERENCE, EchoReceiver, receive
from forest_addon.sensing.sonar.station import SonarPose, posed
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Sonar, SonarReceiver, SpecError

AIR = Air(sound_speed=340.0)
LEAF = discs_of([[2.0, 0, 2]], [1.0, 0, 0], 0.02)
NOWHERE = discs_of([[30.0, 0, 2]], [1.0, 0, 0], 0.02)
RATE = 400e3
FALSE_ALARM = 1e-6  # of each law here


def sonar_of(**settings: Any) -> Sonar:
    """A sonar with a receiver of some settings, in front of which leaves are pistons."""
    given = {"source_level_db": 110.0} | settings
    return Sonar(leaf_model="piston", max_range=5.0, receiver=SonarReceiver(**given))


def heard(sonar: Sonar, discs: Any = LEAF, **given: Any) -> Echo:
    echo = ping(discs, sonar, AIR, **given)
    assert echo.received is not None
    return echo


def silence(sonar: Sonar, count: int = 40_000, seed: int = 0, **given: Any) -> np.ndarray:
    """(N,) what the receiver records where there is no echo."""
    receiver = EchoReceiver(sonar, **given)
    return receive(receiver, np.zeros((1, count)), np.zeros((1, 3)), 340.0, seed).recorded[0]


def test_without_a_receiver_an_echo_is_as_it_was_and_with_one_nothing_else_moves() -> None:
    bare, sonar = ping(LEAF, sonar_of().changed(receiver=None), AIR), sonar_of(self_noise_db=20.0)
    echo = heard(sonar)
    assert bare.received is None
    for name in ("spectra", "called", "responses", "envelopes", "waveforms"):
        assert np.array_equal(getattr(bare, name), getattr(echo, name))


def test_a_plain_receiver_hears_pascals_by_the_source_level() -> None:
    """120 dB re 20 µPa at 0.1 m are 20 Pa there and 2 Pa at 1 m."""
    echo = heard(sonar_of(source_level_db=120.0))
    assert echo.received.pressure == pytest.approx(2.0)
    size = np.abs(echo.waveforms).max()
    np.testing.assert_allclose(echo.received.recorded, 2.0 * echo.waveforms, atol=1e-12 * size)
    assert np.isposinf(echo.received.snr_db).all()
    relative = heard(sonar_of(source_level_db=None))
    np.testing.assert_allclose(relative.received.recorded, echo.waveforms, atol=1e-12 * size)


@pytest.mark.parametrize(
    ("shape", "resonance"), [(((20e3, 10.0), (150e3, -20.0)), 0.0), ((), 70e3)]
)
def test_noise_has_the_spectrum_that_is_asked_for(shape: Any, resonance: float) -> None:
    """2·P/S of a periodogram is χ² of 2 degrees, so is their sum over bins and records."""
    sonar = sonar_of(
        self_noise_db=15.0, self_noise_shape=shape, resonance=resonance, bandwidth=15e3
    )
    count = 40_000
    records = np.array([silence(sonar, count, seed) for seed in range(20)])
    window = np.hanning(count)
    power = np.abs(np.fft.rfft(records * window)) ** 2 * 2 / (RATE * np.sum(window**2))
    frequency = np.fft.rfftfreq(count, 1 / RATE)
    wanted = 1e-12 * 10**1.5 * np.ones(len(frequency))
    if shape:
        wanted *= 10 ** (np.interp(frequency, *np.transpose(shape)) / 10)
    if resonance:
        quality = resonance / 15e3
        off = np.divide(resonance, frequency, where=frequency > 0, out=frequency + 1e9)
        wanted /= 1 + quality**2 * (frequency / resonance - off) ** 2
    bands = np.split(np.arange(400, 18_000), 44)  # 4 to 180 kHz
    for bins in bands:
        bins = bins[::4]  # Hann's lines are independent four apart
        sum_ = np.sum(2 * power[:, bins] / wanted[bins])
        degrees = 2 * len(records) * len(bins)
        low, high = chi2.ppf([FALSE_ALARM / 88, 1 - FALSE_ALARM / 88], degrees)
        assert low < sum_ < high


def test_call_and_echo_pass_the_transducer_as_a_convolution_in_time() -> None:
    rng = np.random.default_rng(1)
    response = np.exp(-np.arange(60) / 12) * rng.normal(size=60)
    sonar = sonar_of(source_level_db=None, transducer_file="t.wav")
    call = Call(np.hanning(300) * np.sin(np.arange(300)), RATE)
    receiver = EchoReceiver(sonar, call, Call(response, RATE))
    waveform = np.zeros(1000)
    waveform[200:500] = 0.3 * call.samples
    got = receive(receiver, waveform[None], np.zeros((1, 3)), 340.0, 0).recorded[0]
    twice = np.convolve(np.convolve(waveform, response), response)[:1000]
    sent = np.abs(_analytic(np.convolve(call.samples, response))).max()
    loudest = np.abs(np.fft.rfft(response, 1 << 16)).max()
    scale = np.abs(got).max()
    np.testing.assert_allclose(got, twice / sent / loudest, atol=2e-3 * scale)


def _analytic(samples: np.ndarray) -> np.ndarray:
    return hilbert(np.pad(samples, 1000))


def test_signal_to_noise_is_that_of_the_closed_form() -> None:
    """White noise of S Pa²/Hz has the mean square S·B in a band of B; the peak is 2·|waveform| Pa."""
    sonar = sonar_of(source_level_db=120.0, self_noise_db=20.0)
    received = heard(sonar).received
    noise = math.sqrt(1e-12 * 100.0 * 20e3)
    peak = 2.0 * ping(LEAF, sonar, AIR).envelopes.max()
    assert received.noise_level == pytest.approx([noise], rel=1e-3)
    assert received.snr_db == pytest.approx([20 * math.log10(peak / noise)], abs=0.01)
    cell = np.argmax(received.range_snr_db[0])
    assert received.range_snr_db[0, cell] == pytest.approx(received.snr_db[0])
    assert received.range[cell] == pytest.approx(2.0, abs=0.1)
    asked = EchoReceiver(sonar).self_noise_for(peak, 10.0)
    again = sonar.changed(receiver=sonar.receiver.changed(self_noise_db=asked))
    assert heard(again).received.snr_db == pytest.approx([10.0], abs=0.02)


def test_noise_is_of_its_ping_and_ear_alone() -> None:
    sonar = sonar_of(self_noise_db=10.0)
    two = sonar.changed(ears=2)
    first = heard(sonar, seed=3).received.recorded[0]
    assert np.array_equal(first, heard(sonar, seed=3).received.recorded[0])
    assert not np.array_equal(first, heard(sonar, seed=4).received.recorded[0])
    assert not np.array_equal(first, heard(sonar, seed=3, number=1).received.recorded[0])
    left, right = heard(two, NOWHERE, seed=3).received.recorded
    assert np.array_equal(left, heard(sonar, NOWHERE, seed=3).received.recorded[0])
    alike = np.corrcoef(left, right)[0, 1] * math.sqrt(len(left))
    assert abs(alike) < 5


def test_a_ping_without_an_echo_is_noise_alone() -> None:
    received = heard(sonar_of(self_noise_db=10.0), NOWHERE).received
    assert received.recorded.all()
    assert np.isneginf(received.snr_db).all()
    assert not heard(sonar_of(), NOWHERE).received.recorded.any()


def test_the_converter_clips_and_rounds() -> None:
    sonar = sonar_of(self_noise_db=40.0, overload_db=40.0, bits=4)
    full = REFERENCE * 100.0
    free = silence(sonar.changed(receiver=sonar.receiver.changed(overload_db=None, bits=0)))
    got = silence(sonar)
    steps = got / full * 8
    assert np.array_equal(steps, np.round(steps))
    assert steps.min() == -8
    assert steps.max() == 7
    np.testing.assert_allclose(got, np.clip(free, -full, full * 7 / 8), atol=full / 16 * 1.001)
    received = receive(EchoReceiver(sonar), np.zeros((1, 40_000)), np.zeros((1, 3)), 340.0, 0)
    assert received.clipped == np.count_nonzero(np.abs(free) > full) > 0


def test_gain_blanking_and_ringing_follow_time() -> None:
    plain = heard(sonar_of()).received.recorded[0]
    time = np.arange(len(plain)) / RATE
    gained = heard(sonar_of(gain=((0.0, 0.0), (0.01, 20.0)))).received.recorded[0]
    np.testing.assert_allclose(gained, plain * 10 ** np.clip(time / 0.01, 0, 1), rtol=1e-9)
    ringing = heard(sonar_of(ringing_db=-20.0, resonance=70e3, bandwidth=5e3)).received.recorded[0]
    echo = heard(sonar_of(resonance=70e3, bandwidth=5e3)).received.recorded[0]
    direct = ringing - echo
    assert np.argmax(np.abs(ringing)) / RATE < 1e-3
    fell = np.abs(direct[time > 1e-3]).max() / np.abs(direct).max()
    assert 1e-7 < fell < 1 / (math.pi * 20**3)  # the pulse's own tails after 20 of its periods
    deaf = heard(sonar_of(ringing_db=-20.0, blanking=0.004, self_noise_db=0.0)).received
    assert not deaf.recorded[0, time < 0.004].any()
    assert deaf.recorded[0, time >= 0.004].all()


def test_the_echo_is_detected_when_and_as_loud_as_it_comes() -> None:
    received = heard(
        sonar_of(source_level_db=130.0, self_noise_db=10.0, threshold_db=20.0)
    ).received
    assert received.detection_time.min() == pytest.approx(4 / 340, abs=2e-4)
    assert received.detection_snr_db.max() == pytest.approx(received.snr_db[0], abs=0.5)


def test_false_alarms_are_as_many_as_rice_says() -> None:
    """An envelope of noise in a band of B rises above x times its rms √(2π)·B/√12·x·e^{-x²/2} times a
    second (Rice 1945), and one crest follows nearly every time; counts are Poisson's."""
    over, seconds = 3.5, 5
    sonar = sonar_of(self_noise_db=10.0, threshold_db=20 * math.log10(over))
    quiet, here = np.zeros((1, round(RATE))), np.zeros((1, 3))
    count = sum(
        len(receive(EchoReceiver(sonar), quiet, here, 340.0, seed).detection_time)
        for seed in range(seconds)
    )
    rate = math.sqrt(2 * math.pi / 12) * 20e3 * over * math.exp(-(over**2) / 2)
    low, high = poisson.ppf(
        [FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], rate * seconds * np.array([1, 1.05])
    )
    assert low <= count <= high


def test_a_file_of_noise_comes_by_the_direct_path() -> None:
    """A click 1 m from its source arrives r/c later and 1/r as loud at every ear, behind each other."""
    rng = np.random.default_rng(2)
    noise = Call(rng.normal(size=50_000) * 0.01, RATE)
    sonar = sonar_of(noise_file="p.wav", noise_from=(0.0, 0.3, 0.0)).changed(
        ears=2, ear_spacing=0.17, band=(20e3, 80e3)
    )
    receiver = EchoReceiver(sonar, noise=noise)
    ears = np.array([[0, 0.085, 0], [0, -0.085, 0]])
    left, right = receive(receiver, np.zeros((2, 8000)), ears, 340.0, 0).recorded
    assert np.std(left) / np.std(right) == pytest.approx(0.385 / 0.215, rel=0.01)
    late = round(0.17 / 340 * RATE)
    assert np.corrcoef(left[:-late], right[late:])[0, 1] > 0.999
    level = receive(receiver, np.zeros((2, 8000)), ears, 340.0, 0).noise_level
    assert level == pytest.approx(0.01 * math.sqrt(60 / 200) / np.array([0.215, 0.385]), rel=0.02)


def test_wind_and_insects_have_their_published_levels() -> None:
    """Levels over the frequencies at which they were measured, evenly spread."""
    for ambient, settings, level, width in (
        ("wind", {"wind_speed": 10.0}, 45.3, 19e3),
        ("insects", {}, 60.0, 78e3),
        ("rain", {"ambient_level_db": 50.0}, 50.0, 19e3),
    ):
        receiver = EchoReceiver(sonar_of(ambient=ambient, **settings))
        top = width + (2e3 if ambient == "insects" else 1e3)
        even, octave = receiver.density(np.array([5e3, 2 * top]))
        assert 10 * math.log10(even * width / REFERENCE**2) == pytest.approx(level)
        assert even / octave == pytest.approx(4.0)


# --------------------------------------------------------------------------------------------- calls
# Calls and their echoes: sweeps, records, Doppler, against sums in time.


def calls_sonar_of(**settings: Any) -> Sonar:
    plain = {"position": (0, 0, 0), "absorption": False, "leaf_model": "piston", "beam": "omni"}
    return Sonar(**(plain | settings))


@pytest.mark.parametrize("kind", ["fm", "cf-fm"])
def test_calls_fall_from_the_top_of_the_band_to_its_foot(kind: str) -> None:
    call = synthesise(calls_sonar_of(call=kind, call_duration=0.005))
    assert np.abs(call.samples).max() == 1
    assert call.duration == pytest.approx(0.005)
    turned = np.diff(np.unwrap(np.angle(hilbert(call.samples)))) * 400e3 / (2 * math.pi)
    frequency = turned[200:-200]  # the fades aside
    assert np.diff(frequency[::40]).max() < 400
    assert frequency[0] == pytest.approx(79e3 if kind == "cf-fm" else 76.5e3, rel=0.02)
    assert frequency[-1] == pytest.approx(62.8e3 if kind == "fm" else 70e3, rel=0.05)
    tone = frequency[: int(0.6 * len(frequency))]
    assert (np.ptp(tone) < 300) == (kind == "cf-fm")


def test_own_samples_are_brought_to_the_rate_and_stay_as_loud() -> None:
    tone = np.sin(2 * math.pi * 50e3 * np.arange(500) / 250e3) * 7000
    call = resampled(np.stack([tone, 0 * tone], 1), 250e3, calls_sonar_of())
    assert len(call.samples) == 800
    assert np.abs(call.samples[100:-100]).max() == pytest.approx(7000, rel=1e-2)
    peak = np.argmax(np.abs(np.fft.rfft(call.samples)))
    assert np.fft.rfftfreq(800, 1 / 400e3)[peak] == pytest.approx(50e3, abs=600)
    with pytest.raises(ValueError, match="silent"):
        resampled(np.zeros(10), 250e3, calls_sonar_of())


@pytest.mark.parametrize("record", [0.005, 0.0118, 0.05])
def test_a_given_record_cuts_and_never_wraps(record: float) -> None:
    """Leaves at 1 m and 3 m: 5.9 and 17.6 ms."""
    discs = discs_of([[1, 0, 0], [3, 0.1, 0]], [1.0, 0, 0], 0.01)
    echo = ping(discs, calls_sonar_of(record=record), AIR)
    assert len(echo.time) == math.ceil(record * 400e3)
    assert echo.late == sum(2 * r / 340 > record for r in (1.0, math.hypot(3, 0.1)))
    whole = ping(discs, calls_sonar_of(), AIR)
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
    sonar = calls_sonar_of(call="fm", call_duration=0.002, doppler=True)
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


@pytest.mark.parametrize("lead", [0.0, 7e-4])
def test_spectra_of_a_call_on_a_grid_are_those_at_each_speed(lead: float) -> None:
    call, speeds = (
        synthesise(calls_sonar_of(call="fm", call_duration=0.002)),
        np.array([0.97, 1.0, 1.04]),
    )
    frequency = 60e3 + 37.0 * np.arange(500)
    time = np.arange(len(call.samples)) / call.sample_rate - lead
    found = call.spectra_on(60e3, 37.0, 500, speeds, lead)
    for speed, spectrum in zip(speeds, found, strict=True):
        turns = np.outer(frequency / speed, time)
        exact = np.exp(-2j * np.pi * turns) @ call.samples / speed
        np.testing.assert_allclose(spectrum, exact, rtol=0, atol=1e-11 * np.abs(exact).max())
    back = np.exp(2j * np.pi * frequency * lead)
    np.testing.assert_allclose(call.spectrum(frequency) * back, found[1], rtol=0, atol=1e-9)


def test_a_flight_is_stacked_to_one_length() -> None:
    discs = discs_of([[1, 0, 0], [6, 0.1, 0]], [1.0, 0, 0], 0.02)
    sonar = calls_sonar_of(beam="gaussian", beam_width_deg=(60, 60), ears=2)
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
    echo = ping(discs, calls_sonar_of(), AIR)
    peak = echo.time[np.argmax(echo.envelope)]
    (row,) = echo.heard.around(float(peak), echo.sample_rate)
    assert echo.heard.number[row] == 1
    assert (np.diff(echo.heard.amplitude) <= 0).all()
    assert echo.heard.delay[row] == pytest.approx(2 * math.hypot(1.2, 0.001) / 340)


@pytest.mark.parametrize("count", [2, 3, 100, 801])
def test_a_call_fades_as_scipys_window_does(count: int) -> None:
    expected = windows.tukey(count + 2, 2 * calls.EDGE)[1:-1]
    np.testing.assert_allclose(calls._fade(count), expected, rtol=0, atol=1e-13)


# -------------------------------------------------------------------------------------------- glance
# A glance of a sonar's ears: pulses show at their distances, tones in their channels, at their levels.

SPEED = 343.0
FREQUENCY = np.arange(30e3, 90e3, 10.0)
CENTRE = np.geomspace(30e3, 90e3, 40)
LASTS = 2 * 10.0 / SPEED


def at(distance, gain):
    """The spectrum of an echo from a distance."""
    return gain * np.exp(-2j * np.pi * FREQUENCY * 2 * distance / SPEED)


def test_two_pulses_are_where_they_come_from_and_as_loud_as_they_are():
    level = cochleagram(FREQUENCY, (at(2.0, 0.1) + at(7.0, 0.01))[None], CENTRE, LASTS)[0]
    assert level.shape == (40, COLUMNS)
    slices = [round(d / 10 * COLUMNS) for d in (2.0, 7.0)]
    for row in level[8:-8]:
        first = int(row.argmax())
        second = int(row[150:].argmax()) + 150
        assert abs(first - slices[0]) <= 1
        assert abs(second - slices[1]) <= 1
        assert (row[first], row[second]) == pytest.approx((-20, -40), abs=0.5)


def test_an_echo_of_part_of_the_band_is_in_those_channels():
    """The filter whose centre is nearest to 50 kHz is loudest; an octave away it is not there."""
    spectrum = at(3.0, 1.0) * (np.abs(FREQUENCY - 50e3) < 1500)
    peak = cochleagram(FREQUENCY, spectrum[None], CENTRE, LASTS)[0].max(axis=1)
    assert abs(CENTRE[int(peak.argmax())] - 50e3) < 1500
    assert peak[CENTRE > 85e3].max() < peak.max() - 20


def test_silence_is_silence_and_ears_are_apart():
    level = cochleagram(FREQUENCY, np.stack([0 * FREQUENCY, at(5, 1.0)]), CENTRE, LASTS)
    assert level[0].max() == level.min()
    assert np.isneginf(cochleagram(FREQUENCY, 0j * FREQUENCY[None], CENTRE, LASTS)).all()


def test_the_end_of_an_echo_is_not_heard_at_its_beginning():
    """Channels of the report's picture, of a click that they still ring of as the echo ends."""
    rate, click = 250_000.0, np.zeros((1, 8192))
    click[0, -60] = 1.0
    echo = SimpleNamespace(
        frequency=np.array([25e3, 80e3]), sample_rate=rate, heard_waveforms=click
    )
    _, level = drawn_cochleagram(echo)
    assert level[:, -2:].max() > level.max() - 10.0
    assert level[:, :200].max() < level.max() - 80.0


# ------------------------------------------------------------------------------------- measured ears
# Ears that were measured all round: from arrays, CSV and SOFA, at what was measured and between.

BAND = (30e3, 60e3)
MEASURED_EARS_FREQUENCY = np.array([30e3, 40e3, 50e3, 60e3])


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


def measured_ears_heard(
    ears: int, places: np.ndarray, file: str, folder: Path, **settings: object
) -> Echo:
    sonar = Sonar(
        position=(0, 0, 0), absorption=False, leaf_model="piston", beam="omni", band=BAND, ears=ears,
        hearing="file", hearing_file=file, **({"cull": 0.0} | settings),
    )  # fmt: skip
    leaves = discs_of(places, places, 0.01)
    return ping(leaves, sonar, Air(sound_speed=340.0), equipment=equip(sonar, folder))


def test_what_was_measured_is_met_and_between_it_is_mixed() -> None:
    measured = directions(2500)
    pattern = MeasuredSphere.all_round(
        measured, MEASURED_EARS_FREQUENCY, level_at(measured, MEASURED_EARS_FREQUENCY)
    )
    assert len(pattern.direction) == 2500  # nothing to fill
    gain = pattern.gain(*offsets(measured), MEASURED_EARS_FREQUENCY)
    np.testing.assert_allclose(20 * np.log10(gain.T), pattern.level, atol=1e-7)
    asked = directions(4000, 2)
    gain = pattern.gain(*offsets(asked), np.array([35e3]))
    wrong = 20 * np.log10(gain[0]) - level_at(asked, np.array([35e3]))[:, 0]
    assert np.abs(wrong).max() < 0.15  # dB, of 21: the sag of a plane between directions 5° apart


def test_what_was_not_measured_is_as_the_nearest_that_was() -> None:
    azimuth = np.radians(np.arange(-90, 91, 5.0))  # a half circle ahead alone
    measured = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
    level = np.linspace(-10, 0, len(azimuth))[:, None]
    pattern = MeasuredSphere.all_round(measured, MEASURED_EARS_FREQUENCY[:1], level)
    behind = np.array([[-0.5, math.sqrt(0.75), 0.0], [-0.5, -math.sqrt(0.75), 0.0]])
    found = 20 * np.log10(pattern.gain(*offsets(behind), BAND[:1])[0])
    np.testing.assert_allclose(found, [0, -10], atol=0.6)


@pytest.mark.medium
def test_the_fast_sum_keeps_its_tolerance_with_ears_all_round(tmp_path: Path) -> None:
    measured = directions(300)
    level = np.stack([level_at(measured, MEASURED_EARS_FREQUENCY, left) for left in (1.0, -1.0)])
    azimuth, elevation = angles(measured)
    file = forest.save_pattern(
        tmp_path / "ears.csv",
        MEASURED_EARS_FREQUENCY,
        level,
        azimuth_deg=azimuth,
        elevation_deg=elevation,
    )
    places = directions(400, 3) * np.random.default_rng(4).uniform(1, 4, (400, 1))
    fast = measured_ears_heard(2, places, file, tmp_path, tolerance=1e-5)
    exact = measured_ears_heard(2, places, file, tmp_path, tolerance=0.0)
    wrong = np.abs(fast.spectra - exact.spectra).max(axis=1)
    assert (wrong <= 1e-5 * exact.size).all()
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
        echo = measured_ears_heard(2, place, "head.sofa", tmp_path, ear_spacing=0.0)
        flat = forest.save_pattern(tmp_path / "flat.csv", [40e3], [[0.0]] * 2, angle_deg=[0, 180])
        plain = measured_ears_heard(2, place, flat, tmp_path, ear_spacing=0.0)
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
        measured_ears_heard(3, np.ones((1, 3)), file, tmp_path)
    with pytest.raises(SpecError, match="a beam takes one"):
        equip(Sonar(beam="file", beam_file=file), tmp_path)
    (tmp_path / "bad.csv").write_text("ear,azimuth_deg,elevation_deg,40000\n1,0,0,0\n")
    with pytest.raises(SpecError, match="number ears from 0"):
        measured_ears_heard(1, np.ones((1, 3)), "bad.csv", tmp_path)


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
