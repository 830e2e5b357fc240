"""Decay, reverberation time and clarity against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from references.reverb import sum_at_length

from forest_addon.base.rng import stream
from forest_addon.sensing.audit import held
from forest_addon.sensing.reverb.audit import parts_of_response
from forest_addon.sensing.reverb.metrics import (
    clarity_db,
    echo_density,
    energy_decay_db,
    octave,
    octave_bands,
    onset,
    reverberation_time,
    room_metrics,
)
from forest_addon.sensing.reverb.model_error import model_error
from forest_addon.sensing.reverb.response import impulse_response, pairs_of
from forest_addon.sensing.reverb.sums.fast_scattering import Expansions, octave_errors
from forest_addon.sensing.reverb.sums.scattering import trunk_paths
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb

RATE = 8000.0


def exponential(seconds_per_60_db: float, length: float = 3.0, delay: float = 0.0) -> np.ndarray:
    time = np.arange(round(length * RATE)) / RATE - delay
    return np.where(time >= -1e-12, 10.0 ** (-3.0 * time / seconds_per_60_db), 0.0)


def test_onset_at_minus_20_db() -> None:
    samples = np.array([0.0, 0.05, -0.1, 0.3, 1.0, 0.5])
    assert onset(samples) == 2
    assert onset(np.zeros(4)) == 0
    # What is below -20 dB before the onset neither moves it nor is late.
    lead = np.concatenate([np.full(100, 0.01), exponential(1.0)])
    assert clarity_db(lead, RATE) == pytest.approx(clarity_db(exponential(1.0), RATE), abs=1e-3)


def test_no_decay_to_read() -> None:
    assert math.isnan(reverberation_time(np.zeros(100), RATE))
    assert math.isnan(reverberation_time(np.empty(0), RATE))
    assert math.isnan(reverberation_time(np.array([1.0, 0, 0, 0]), RATE))  # at once
    short = exponential(1.0, 0.01)
    assert energy_decay_db(short)[-1] > -35
    assert math.isnan(reverberation_time(short, RATE))


def test_silence_and_no_late_sound() -> None:
    assert math.isnan(clarity_db(np.zeros(100), RATE))
    assert clarity_db(np.array([1.0, 0.0]), RATE) == math.inf
    assert (energy_decay_db(np.zeros(3)) == -np.inf).all()


@pytest.mark.parametrize("t60", [0.4, 1.5])
def test_measures_of_an_exponential_decay(t60: float) -> None:
    """Closed forms: with δ = 6·ln 10/t60, D50 = 1 - e^{-δ·50 ms} and the centre is at 1/δ."""
    samples = exponential(t60, 4 * t60, 0.1)
    found = room_metrics(samples, RATE)
    decay = 6 * math.log(10) / t60
    assert reverberation_time(samples, RATE) == pytest.approx(t60, rel=1e-4)
    assert energy_decay_db(samples)[round((0.1 + t60 / 2) * RATE)] == pytest.approx(-30.0, abs=1e-6)
    early = 1 - math.exp(-0.05 * decay)
    assert clarity_db(samples, RATE) == pytest.approx(
        10 * math.log10(early / (1 - early)), abs=1e-6
    )
    assert found.band[0] == 0
    for seconds in (found.edt, found.t20, found.t30, found.t60):
        assert seconds[0] == pytest.approx(t60, rel=1e-4)
    assert found.d50[0] == pytest.approx(1 - math.exp(-0.05 * decay), rel=1e-6)
    early = 1 - math.exp(-0.08 * decay)
    assert found.c80[0] == pytest.approx(10 * math.log10(early / (1 - early)), abs=1e-6)
    assert found.centre_time[0] == pytest.approx(1 / (math.exp(decay / RATE) - 1) / RATE, rel=1e-6)


def test_each_octave_has_its_own_time() -> None:
    """Tones that decay at different rates, one an octave."""
    time = np.arange(round(2.0 * RATE)) / RATE
    times = {250.0: 1.2, 500.0: 0.9, 1000.0: 0.7, 2000.0: 0.5}
    tones = [
        10.0 ** (-3.0 * time / t60) * np.sin(2 * math.pi * f * time) for f, t60 in times.items()
    ]
    found = room_metrics(np.sum(tones, axis=0), RATE)
    for f, t60 in times.items():
        band = found.band.tolist().index(f)
        assert found.t30[band] == pytest.approx(t60, rel=0.02)
        assert found.t20[band] == pytest.approx(t60, rel=0.02)


def test_octaves_share_the_energy() -> None:
    rng = np.random.default_rng(5)
    bands = octave_bands(48_000.0)
    assert bands[0] == 31.25
    assert bands[-1] == 8000.0
    noise = np.zeros(60_000)
    noise[5000:-5000] = rng.normal(size=50_000)
    frequency = np.fft.rfftfreq(60_000, 1 / 48_000)
    spectrum = np.fft.rfft(noise) * ((frequency > 40) & (frequency < 9500))
    noise = np.fft.irfft(spectrum)
    parts = [octave(noise, 48_000.0, band) for band in bands]
    assert sum(np.sum(part**2) for part in parts) == pytest.approx(np.sum(noise**2), rel=1e-3)
    # White noise has energy in proportion to the width of the octave (5000 dof: 3 sigma = 6 %).
    white = rng.normal(size=60_000)
    share = np.sum(octave(white, 48_000.0, 4000.0) ** 2) / np.sum(white**2)
    assert share == pytest.approx(4000 * (math.sqrt(2) - math.sqrt(0.5)) / 24_000, rel=0.06)


def test_octaves_have_no_phase() -> None:
    click = np.zeros(8001)
    click[4000] = 1.0
    for band in octave_bands(RATE)[2:]:
        answer = octave(click, RATE, band)
        assert np.argmax(np.abs(answer)) == 4000
        np.testing.assert_allclose(answer, answer[::-1], atol=1e-9)


def test_bands_end_below_the_roll_off() -> None:
    for rate in (1000.0, 8000.0, 24_000.0, 192_000.0):
        assert all(band * 2**0.5 < 0.45 * rate for band in octave_bands(rate))
    assert max(octave_bands(24_000.0)) == 4000.0
    assert max(octave_bands(192_000.0)) == 16_000.0


def test_echo_density_of_noise_is_1() -> None:
    """4800 samples a frame: the mean over 90 frames is within 0.02 with better than 5 sigma."""
    rng = np.random.default_rng(6)
    noise = rng.normal(size=24_000) * np.exp(-np.arange(24_000) / 6000.0)
    time, density = echo_density(noise, 24_000.0)
    assert time[0] == pytest.approx(0.1)
    assert time[-1] == pytest.approx(0.9, abs=0.01)
    assert np.mean(density) == pytest.approx(1.0, abs=0.02)
    assert np.abs(density - 1).max() < 0.1


def test_echo_density_counts_echoes() -> None:
    """Of sparse Gaussian echoes it is the share of samples that sound, however loud each is."""
    rng = np.random.default_rng(7)
    for share in (0.002, 0.02, 0.2):
        sparse = np.where(rng.random(48_000) < share, rng.normal(size=48_000), 0.0)
        found = np.nanmean(echo_density(sparse, 24_000.0)[1])
        if share < 0.01:  # about one echo a window: all are levelled alike, up to 1/2 of the place
            assert share < found < 0.5 / (0.5 - 1 / math.pi) * share
        else:
            assert found == pytest.approx(share, rel=0.15)
    pulse = np.zeros(9600)
    pulse[::480] = 1.0  # 10 echoes a frame of 4800
    assert np.nanmedian(echo_density(pulse, 24_000.0)[1]) == pytest.approx(
        5 / 4800 / (0.5 - 1 / math.pi), rel=0.15
    )


def test_echo_density_of_silence_and_short_records() -> None:
    assert np.isnan(echo_density(np.zeros(24_000), 24_000.0)[1]).all()
    assert len(echo_density(np.ones(10), 24_000.0)[1]) == 1
    silent = room_metrics(np.zeros(8000), RATE)
    assert np.isnan(silent.d50).all()
    assert np.isnan(silent.t30).all()


def test_against_pyroomacoustics() -> None:
    """Its reverberation time is read at two levels of the same decay rather than from a line."""
    room = pytest.importorskip("pyroomacoustics")
    rng = np.random.default_rng(8)
    for t60 in (0.5, 1.2):
        plain = exponential(t60, 4 * t60)
        assert reverberation_time(plain, RATE) == pytest.approx(
            room.experimental.measure_rt60(plain, int(RATE), decay_db=30), rel=2e-3
        )
        noise = plain * rng.normal(size=len(plain))
        assert reverberation_time(noise, RATE) == pytest.approx(
            room.experimental.measure_rt60(noise, int(RATE), decay_db=30), rel=0.06
        )


# --------------------------------------------------------------------------------------- model error
# Which trunks are solved exactly, and how far single scattering is from them.

ENDS = np.array([[-5.0, 0.0], [5.0, 0.0]])
SOME = np.array([125.0, 250.0, 500.0])


def forest(count: int, side: float, radius: float = 0.15, seed: int = 0) -> Trunks:
    rng = np.random.default_rng(seed)
    place = rng.uniform(-side / 2, side / 2, (count, 2))
    return Trunks(place, np.full(count, radius), np.arange(count))


@pytest.mark.slow
def test_dense_stands_scatter_more_than_once() -> None:
    """15 to 30 % at 0.01 trunks/m², more at 0.05 (PHYSICS 5.5)."""
    found = {}
    for density in (0.01, 0.05):
        side = np.sqrt(25 / density)
        errors = [
            model_error(forest(25, side, seed=seed), *ENDS, 25, Air(), SOME[::2]).relative
            for seed in range(5)
        ]
        found[density] = np.median(errors)
    assert 0.1 < found[0.01] < 0.4
    assert found[0.05] > 1.2 * found[0.01]


def test_one_trunk_and_none() -> None:
    one = model_error(forest(1, 4.0), *ENDS, 10, Air(), SOME)
    assert one.relative == 0
    assert one.level_db == 0
    none = model_error(forest(0, 4.0), *ENDS, 10, Air(), SOME)
    assert (none.relative, none.level_db, len(none.trunks)) == (0.0, 0.0, 0)


def test_nearest_trunks_that_can_be_solved() -> None:
    rows = [(0, 3, 0.2), (0.1, 3, 0.3), (0, -6, 0.1), (5.05, 0, 0.1), (0, 90, 0.2), (1, 1, 0.0)]
    table = np.array(rows)
    trunks = Trunks(table[:, :2], table[:, 2], np.arange(len(rows)))
    found = model_error(trunks, *ENDS, 5, Air(), SOME)
    assert found.trunks.tolist() == [1, 2]  # 0 overlaps the thicker 1, 3 covers the receiver
    assert found.left_out == 2
    assert found.relative > 0
    np.testing.assert_array_equal(found.frequency, SOME)


@pytest.mark.medium
def test_frequencies_that_are_too_high_are_left_out() -> None:
    steps: list[tuple[int, int]] = []
    found = model_error(
        forest(60, 200.0, 0.5),
        *ENDS,
        60,
        Air(),
        np.array([30.0, 20e3]),
        progress=lambda done, total: steps.append((done, total)),
    )
    assert found.frequency.tolist() == [30.0]
    assert steps == [(1, 1)]


# --------------------------------------------------------------------------------------------- audit
# A response's audit: silent on what is right, loud on what is wrong; stands of any radii.

AIR = Air()
HERE, THERE = np.array([0.0, 0, 1.5]), np.array([9.0, 0, 1.5])
CLAP = Reverb(source=(0, 0, 1.5), receiver=(9, 0, 1.5), sample_rate=8000, duration=0.25)


def stand(radius):
    rng = stream(3, "audit stand")
    place = rng.uniform(-50, 50, (len(radius), 2))
    far = np.linalg.norm(place, axis=1) > 3
    return Trunks(place[far], radius[far], np.arange(far.sum()))


def audit(trunks, sensor, wrong=lambda found: found):
    """Of a response, or what is made of it."""
    made = Expansions()
    found = wrong(impulse_response(trunks, sensor, AIR, expansions=made))
    sensor = sensor.changed(duration=len(found.samples) / sensor.sample_rate)
    parts = parts_of_response(found, pairs_of(trunks, sensor, AIR), made, 0.25)
    return held(parts, stream(1, "a"), 8.0)


@pytest.fixture
def soon_fast(monkeypatch):
    """The fast sum also where the exact one would take no longer: so few trunks are compared with it."""
    monkeypatch.setattr("forest_addon.sensing.reverb.sums.tree_response.FEW_SUMMANDS", 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tolerance", "spread"), [(1e-2, True), (1e-4, False), (1e-6, True), (0.0, False)]
)
def test_what_is_right_is_kept(soon_fast, tolerance, spread):
    rng = stream(4, "radii")
    radius = np.exp(rng.uniform(np.log(1e-3), np.log(2.0), 150)) if spread else np.full(500, 0.15)
    found = audit(stand(radius), CLAP.changed(tolerance=tolerance))
    assert found.kept, str(found)
    assert found.checked > 5


@pytest.mark.slow
def test_what_only_the_direct_sum_keeps_is_kept_and_its_audit_tells_the_truth():
    """Against a sum that nothing wraps around in; the audit is of what the transforms cut off."""
    trunks = stand(np.exp(stream(1, "radii").uniform(np.log(1e-3), np.log(2.0), 8)))
    sensor = CLAP.changed(tolerance=1e-8, sample_rate=1000)
    found = impulse_response(trunks, sensor, AIR)
    paths = trunk_paths(trunks, HERE[:2], THERE[:2], sensor.strength, sensor.spreading)
    truth = sum_at_length(paths, 1000.0, len(found.trees), AIR, seconds=200.0)
    errors = octave_errors(found.trees - truth, truth, 1000.0, 1e-9)
    assert found.exact
    assert max(errors.values()) <= 1e-8
    assert np.linalg.norm(found.trees - truth) <= 1e-8 * np.linalg.norm(truth)
    checked = audit(trunks, sensor)
    assert checked.kept, str(checked)
    assert checked.error < 1e-8


@pytest.mark.medium
def test_direct_sound_among_dense_leaves_and_twigs_is_kept():
    """It rings 400 samples away at 1e-5 of itself, as a loss by the root of the frequency does."""
    dense = CLAP.changed(
        model="forest",
        tail="none",
        sample_rate=48000,
        leaf_area_density=0.45,
        branch_area_density=0.5,
        branch_radius=0.003,
        leaf_radius=0.023,
    )
    found = audit(stand(np.full(20, 0.1)), dense)
    said = [check for check in found.checks if "direct sound by its Fourier" in check.what]
    assert said
    assert all(check.kept for check in said), str(found)


@pytest.mark.slow
def test_slow_ringing_of_near_trunks_is_no_error_of_late_sound_that_others_thin_out():
    """0.1 trunks per m² and no leaves: the last pieces are 40 dB below the first; 3 % more is found."""
    rng = stream(3, "stems")
    radius = np.clip(rng.normal(0.15, 0.04, 2560), 0.02, None)
    trunks = Trunks(rng.uniform(-80, 80, (2560, 2)), radius, np.full(2560, -1))
    clap = CLAP.changed(model="forest", sample_rate=1000, duration=0.0)
    trunks = trunks.clear_of(np.array([HERE[:2], THERE[:2]]))
    field, made = ((-80.0, -80.0), (160.0, 160.0)), Expansions()
    found = impulse_response(trunks, clap, AIR, expansions=made, field=field)
    late = np.arange(len(found.trees)) > 0.3 * 1000
    noise, pairs = found.tail, pairs_of(trunks, clap, AIR, field=field)
    for louder in (1.0, 1.03):
        heard = replace(found, trees=noise + (found.trees - noise) * np.where(late, louder, 1.0))
        parts = parts_of_response(heard, pairs, made, 0.01)
        (pieces,) = held(parts[-1:], stream(1, "a"), 8.0).checks
        assert pieces.what.startswith("pieces")
        assert pieces.kept == (louder == 1.0), str(pieces)


@pytest.mark.medium
@pytest.mark.parametrize("planted", [0.0, 1e-3])
def test_low_octaves_of_a_long_record_that_is_loud_at_its_begin(planted):
    """5 s of trunks that sound within 0.1 s: silent on what is right, loud on a tone of 30 Hz."""
    trunks = stand(np.full(25, 0.2))
    clap = CLAP.changed(sample_rate=24000, duration=5.0)
    time = np.arange(120_000) / 24000

    def wrong(found):
        below = np.linalg.norm(octave(found.trees, 24000.0, 31.25))
        tone = np.sin(2 * np.pi * 30 * time)
        return replace(found, trees=found.trees + tone * (planted * below / np.linalg.norm(tone)))

    found = audit(trunks, clap, wrong)
    (low,) = [check for check in found.checks if check.what.startswith("octaves up to")]
    assert low.kept == (planted == 0.0), str(found)


def test_no_trunks():
    found = audit(Trunks(np.empty((0, 2)), np.empty(0), np.empty(0, int)), CLAP)
    assert found.kept


def test_a_trunk_that_sounds_after_the_record_is_not_held_against_it():
    """The record holds only the spread of the band's end before its arrival."""
    clap = Reverb(
        source=(0, 0, 1.5),
        receiver=(5, 0, 1.5),
        sample_rate=8000.0,
        duration=0.05,
        model="forest",
        tail="none",
    )
    sound, path = AIR.speed() / clap.sample_rate, 400 + 12.0  # metres and samples
    away = math.sqrt((path * sound / 2) ** 2 - 2.5**2)
    trunk = Trunks(np.array([[2.5, away]]), np.array([0.1]), np.array([0]))
    found = audit(trunk, clap)
    assert found.kept, str(found)
    assert not any(check.checked == 0 and check.error for check in found.checks)


def test_errors_by_octave():
    """A tone of 1 kHz that is off by 1 % and one of 100 Hz that is off by 10 %."""
    time = np.arange(8000) / 8000
    low, high = np.sin(2 * np.pi * 100 * time), np.sin(2 * np.pi * 1000 * time)
    errors = octave_errors(0.1 * low + 0.01 * high, low + high, 8000.0, 1e-9)
    assert errors == {80.0: pytest.approx(0.1), 640.0: pytest.approx(0.01)}
