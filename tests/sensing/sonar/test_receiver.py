"""The receiver of a sonar: its transducer, its noise, and what it makes of echoes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from references.leaf_discs import discs_of
from scipy.stats import chi2, poisson

from forest_addon.sensing.sonar.calls import Call
from forest_addon.sensing.sonar.ping import Echo, ping
from forest_addon.sensing.sonar.receiver import REFERENCE, EchoReceiver, receive
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


@pytest.mark.parametrize("shape", [(), ((20e3, 10.0), (150e3, -20.0))])
@pytest.mark.parametrize("resonance", [0.0, 70e3])
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


def test_a_resonance_has_its_width_at_minus_3_db_one_way() -> None:
    receiver = EchoReceiver(sonar_of(resonance=70e3, bandwidth=4e3))
    length = 1 << 18
    size = np.abs(receiver.response(length)) ** 2
    frequency = np.fft.rfftfreq(length, 1 / RATE)
    assert size.max() == pytest.approx(1.0, abs=1e-5)
    half = frequency[size >= 0.5]
    assert half[-1] - half[0] == pytest.approx(4e3, abs=2 * RATE / length)
    assert math.sqrt(half[0] * half[-1]) == pytest.approx(70e3, abs=2 * RATE / length)


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
    from scipy.signal import hilbert

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


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"source_level_db": None, "self_noise_db": 10.0}, "source_level_db"),
        ({"threshold_db": 10.0}, "threshold_db"),
        ({"ambient": "rain"}, "ambient_level_db"),
        ({"resonance": 50e3, "transducer_file": "a.wav"}, "resonance"),
        ({"gain": ((1.0, 0.0), (0.5, 0.0))}, "gain"),
        ({"gain": ((0.0, 1e6),)}, "gain"),
        (
            {"self_noise_db": 0.0, "self_noise_shape": ((0.0, float("nan")),)},
            "self_noise_shape[0][1]",
        ),
        ({"resonance": 250e3}, "receiver.resonance"),
    ],
)
def test_settings_that_say_nothing_together_are_refused(settings: Any, key: str) -> None:
    with pytest.raises(SpecError) as refused:
        sonar_of(**settings)
    assert refused.value.key == key


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
