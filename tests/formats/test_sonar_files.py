"""Patterns, routes and calls from files, and echoes into files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.echoes import discs_of
from scipy.io import wavfile

from forest_addon.formats.wav import write_wav
from forest_addon.results.kinds import RESULTS, labelled_of
from forest_addon.results.reverb import CALL, PEAK_DB, dry_sound
from forest_addon.results.sonar import write_echo
from forest_addon.sensing.reverb.auralise import auralise, normalised
from forest_addon.sensing.sonar.equipment_files import equip, find, read_patterns, read_route
from forest_addon.sensing.sonar.ping import fly, ping
from forest_addon.sensing.sonar.station import posed, poses_of
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Sonar, SonarReceiver, SpecError

LEAVES = discs_of([[2, 0, 2], [3, 0.2, 2]], [1.0, 0, 0], 0.02)


def test_a_pattern_is_read_in_degrees_hertz_and_decibels(tmp_path: Path) -> None:
    path = tmp_path / "beam.csv"
    path.write_text("# a sonarhead\nangle_deg,60000,80000\n0,0,0\n30,-3,-6\n180,-40,-50\n")
    (pattern,) = read_patterns(path)
    np.testing.assert_allclose(pattern.angle, np.deg2rad([0, 30, 180]))
    assert pattern.frequency.tolist() == [60000, 80000]
    assert pattern.level.tolist() == [[0, 0], [-3, -6], [-40, -50]]


def test_routes(tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    path.write_text(
        "x_m,y_m,z_m,azimuth_deg,elevation_deg,beam_width_deg\n0,0,1,90,0,30\n0,2,1,90,0,65\n"
    )
    first, last = poses_of(read_route(path, 4.0))
    np.testing.assert_allclose(first.frame[0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(first.velocity, [0, 4, 0])
    assert np.rad2deg([first.width, last.width]) == pytest.approx([30, 65])
    assert last.time == pytest.approx(0.5)  # 2 m at 4 m/s
    timed = "x_m,y_m,z_m,azimuth_deg,elevation_deg,time_s\n0,0,1,90,0,{}\n0,2,1,90,0,{}\n"
    path.write_text(timed.format(1.5, 4))
    assert [pose.time for pose in poses_of(read_route(path, 4.0))] == [1.5, 4.0]
    with pytest.raises(SpecError, match="is not in"):
        find("no.csv", tmp_path, "route")
    assert find("tanveer-eight.csv", tmp_path, "route").is_file()


def test_a_call_from_a_wav_file(tmp_path: Path) -> None:
    rate, count = 250_000, 500
    tone = np.sin(2 * np.pi * 70e3 * np.arange(count) / rate) * np.hanning(count)
    wavfile.write(tmp_path / "call.wav", rate, (2000 * tone).astype(np.int16))
    sonar = Sonar(call="file", call_file="call.wav")
    call = equip(sonar, tmp_path).call
    assert call is not None
    assert call.duration == pytest.approx(count / rate)
    echo = ping(LEAVES, sonar, Air(), equipment=equip(sonar, tmp_path))
    assert np.abs(echo.waveforms).max() > 0
    wavfile.write(tmp_path / "call.wav", rate, np.zeros(10, np.int16))
    with pytest.raises(SpecError, match="silent"):
        equip(sonar, tmp_path)
    (tmp_path / "call.wav").write_bytes(b"no sound")
    with pytest.raises(SpecError, match="cannot be read as a WAV file"):
        equip(sonar, tmp_path)


def test_an_echo_in_files(tmp_path: Path) -> None:
    sonar = Sonar(contributions=True, time_expansion=20.0)
    echo = ping(LEAVES, sonar, Air())
    arrays, sound, heard = write_echo(tmp_path, sonar, echo)
    with np.load(arrays) as data:
        assert data["impulse_response"].shape == data["time"].shape
        np.testing.assert_array_equal(data["spectrum"], echo.spectrum)
        assert str(data["time_unit"]) == "s"
        gain = float(data["wav_gain"])
    rate, samples = wavfile.read(sound)
    assert rate == 20_000
    np.testing.assert_allclose(samples / gain, echo.impulse_response, atol=1e-7 / gain)
    assert np.abs(samples).max() == pytest.approx(0.9, rel=1e-6)
    with np.load(heard) as data:
        assert data["number"].tolist() == [0, 1]
        assert data["kind"].tolist() == ["leaf", "leaf"]
        assert str(data["amplitude_unit"]) == "re call at 1 m"


def test_a_flight_in_files(tmp_path: Path) -> None:
    sonar = Sonar(ears=2, contributions=True)
    flight = fly(EchoTargets.of_discs(LEAVES), sonar, Air(), [posed(sonar)] * 3)
    arrays, sound, heard = write_echo(tmp_path, sonar, flight)
    with np.load(arrays) as data:
        assert data["impulse_response"].shape == (3, 2, len(data["time"]))
        assert data["position"].shape == data["axis"].shape == (3, 3)
    _, samples = wavfile.read(sound)
    assert samples.shape == (3 * len(flight.time), 2)
    with np.load(heard) as data:
        assert np.bincount(data["pose"]).tolist() == [2, 2, 2]


def test_what_a_receiver_recorded_in_files(tmp_path: Path) -> None:
    receiver = SonarReceiver(source_level_db=120.0, self_noise_db=20.0, threshold_db=10.0)
    sonar = Sonar(ears=2, receiver=receiver)
    targets = EchoTargets.of_discs(LEAVES)
    flight = fly(targets, sonar, Air(), [posed(sonar)] * 3, seed=5)
    arrays, sound = write_echo(tmp_path, sonar, flight)
    with np.load(arrays) as data:
        for number, echo in enumerate(flight.echoes):
            assert echo.received is not None
            np.testing.assert_allclose(data["recorded"][number], echo.received.recorded)
            assert np.array_equal(data["snr_db"][number], echo.received.snr_db)
            mine = data["detection_ping"] == number
            assert np.array_equal(data["detection_time"][mine], echo.received.detection_time)
        assert str(data["recorded_unit"]) == "Pa"
        assert data["range_snr_db"].shape == (3, 2, len(data["range"]))
        gain, pressure = float(data["wav_gain"]), float(data["call_pressure"])
        recorded = data["recorded"]
    _, samples = wavfile.read(sound)
    np.testing.assert_allclose(
        samples[: recorded.shape[2]] * (pressure / gain), recorded[0].T, atol=1e-6 * pressure / gain
    )
    shown = {each.short: each.text for each in RESULTS["sonar"].figures(sonar, flight, None)}
    assert shown["Over Noise"] == f"{max(e.received.snr_db.max() for e in flight.echoes):.1f} dB"
    assert not np.array_equal(recorded[0], recorded[1])
    variables, _ = labelled_of(sonar, flight)
    dims, values, unit = variables["recorded"]
    assert np.array_equal(values, recorded)
    assert (dims, unit) == (("ping", "ear", "time"), "Pa")
    assert "recorded" not in labelled_of(Sonar(), ping(LEAVES, Sonar(), Air()))[0]
    ahead = ping(targets, sonar, Air(), seed=5, number=2, pose=posed(sonar)).received
    assert np.array_equal(ahead.recorded, flight.echoes[2].received.recorded)
    bare = write_echo(tmp_path, Sonar(name="bare"), ping(LEAVES, Sonar(), Air()))[0]
    with np.load(bare) as data:
        assert not {name for name in data if "snr" in name or "recorded" in name}


@pytest.mark.parametrize("key", ["transducer_file", "noise_file"])
def test_sounds_of_a_receiver_are_read(tmp_path: Path, key: str) -> None:
    samples = np.sin(np.arange(2000) * 2 * np.pi * 70e3 / 300e3) * np.hanning(2000)
    wavfile.write(tmp_path / "sound.wav", 300_000, samples.astype(np.float32))
    given = {"source_level_db": 110.0, key: "sound.wav"}
    if key == "noise_file":
        given["noise_level_db"] = 60.0
    sonar = Sonar(receiver=SonarReceiver(**given))
    receiver = equip(sonar, tmp_path).receiver
    read = receiver.noise or receiver.transducer
    assert len(read.samples) == round(2000 * 4 / 3)
    if key == "noise_file":
        assert np.sqrt(np.mean(read.samples**2)) == pytest.approx(20e-6 * 1000)
    with pytest.raises(SpecError, match=f"receiver.{key}"):
        equip(sonar, tmp_path / "elsewhere")
    with pytest.raises(ValueError, match=key):
        ping(LEAVES, sonar, Air())


def test_a_sum_is_warned_of_where_it_decides_how_sure_the_result_is() -> None:
    sonar = Sonar(tolerance=1e-6)
    echo = replace(ping(LEAVES, sonar, Air()), cull_bound=1e-4, table_error=2e-5)
    assert echo.error_bound <= 1e-6
    doubts = RESULTS["sonar"].doubts
    assert doubts(sonar, echo) == ()
    assert doubts(sonar, replace(echo, error_bound=1.5e-4)) == ()
    (warning,) = doubts(sonar, replace(echo, error_bound=3e-4))
    assert "3.0e-04" in warning
    assert "1e-06 was asked for" in warning
    (warning,) = doubts(sonar, replace(echo, error_bound=2e-6, cull_bound=0.0, table_error=0.0))
    assert "Set tolerance to 1e-05" in warning
    assert doubts(sonar.changed(tolerance=0.0), replace(echo, error_bound=3e-4)) == ()


def test_silence_can_be_written(tmp_path: Path) -> None:
    sonar = Sonar(max_range=1.0)
    files = write_echo(tmp_path, sonar, ping(LEAVES, sonar, Air()))
    assert not wavfile.read(files[1])[1].any()


# ---------------------------------------------------------------------------------------- dry sounds
# What a reverb sounds like: a clap or a call that is a clap or a call, convolved as the sum says.


def direct(response, dry):
    """The convolution, sample by sample."""
    wet = np.zeros(len(response) + len(dry) - 1)
    for n, value in enumerate(response):
        wet[n : n + len(dry)] += value * dry
    return wet


def test_a_clap_is_short_and_where_hands_resonate():
    samples, rate = dry_sound("clap")
    assert np.abs(samples).max() == pytest.approx(1)
    energy = np.cumsum(samples**2) / np.sum(samples**2)
    assert np.searchsorted(energy, 0.95) / rate < 0.010  # Repp 1987: a few milliseconds
    power = np.abs(np.fft.rfft(samples, 8192)) ** 2
    centre = np.sum(np.fft.rfftfreq(8192, 1 / rate) * power) / power.sum()
    assert 500 < centre < 3500
    assert (dry_sound("clap")[0] == samples).all()


def test_a_call_is_twenty_times_slower_and_falls():
    samples, rate = dry_sound("call")
    assert len(samples) / rate == pytest.approx(20 * CALL.call_duration, rel=1e-3)
    pieces = np.array_split(samples, 8)
    pitch = [np.count_nonzero(np.diff(np.sign(p))) / 2 / (len(p) / rate) for p in pieces]
    assert pitch == sorted(pitch, reverse=True)
    assert 1200 < pitch[-1] < pitch[0] < 4000


@pytest.mark.parametrize("channels", [1, 3])
def test_it_is_the_sum_of_shifted_copies(channels):
    rng = np.random.default_rng(2)
    response, dry_rate = rng.standard_normal((40, channels)), 48_000.0
    dry, rate = dry_sound("clap")
    assert rate == dry_rate
    wet, _ = normalised(auralise(response, dry, rate, rate), PEAK_DB)
    expected = np.column_stack([direct(row, dry) for row in response.T])
    expected *= 10 ** (PEAK_DB / 20) / np.abs(expected).max()
    assert np.abs(wet - expected).max() < 1e-12


def test_a_file_of_ones_own(tmp_path):
    dry = np.array([0.5, 0.0, -0.25])
    write_wav(tmp_path / "dry.wav", dry, 8000)
    samples, rate = dry_sound("file", tmp_path / "dry.wav")
    assert rate == 8000
    wet = auralise(np.array([0.0, 1.0]), samples, rate, rate)[:, 0]
    assert wet == pytest.approx([0, 0.5, 0, -0.25], abs=1e-6)


def test_silence_stays():
    assert normalised(np.zeros(10), PEAK_DB) == (pytest.approx(0), 0)
