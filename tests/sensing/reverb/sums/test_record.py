"""How long a record is, and what a cut one says of itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.metrics import octave_bands, reverberation_time, room_metrics
from forest_addon.sensing.reverb.response import ImpulseResponse, impulse_response
from forest_addon.sensing.reverb.sums.scattering import direct_sum, trunk_paths
from forest_addon.sensing.reverb.sums.tree_response import (
    AFTER,
    LONGEST,
    RANGE_DB,
    _largest,
    arrival_energies,
    record_length,
    weak_trunks,
)
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb

AIR = Air(sound_speed=343.0)


def forest(count: int, side: float, radius: float = 0.25) -> Trunks:
    place = np.random.default_rng(8).uniform(-side / 2, side / 2, (count, 2))
    return Trunks(place, np.full(count, radius), np.arange(count))


def listen(trunks: Trunks, duration: float) -> ImpulseResponse:
    reverb = Reverb(
        source=(-5.0, 0.0, 1.5), receiver=(5.0, 0.0, 1.5), sample_rate=8e3, duration=duration
    )
    return impulse_response(trunks, reverb, AIR)


def test_a_record_goes_on_until_the_last_trunk() -> None:
    trunks = forest(3000, 600.0)
    found = listen(trunks, 0.0)
    paths = trunk_paths(trunks, np.array([-5.0, 0.0]), np.array([5.0, 0.0]), 2.0, 0.7)
    last = float(paths.length.max()) / 343.0
    assert last < len(found.samples) / 8e3 <= last + AFTER + 1e-3
    assert found.late == 0
    assert (found.left_db == -np.inf).all()


def test_a_record_ends_where_only_the_inaudible_is_left_and_at_the_longest() -> None:
    place = np.array([[0.0, 5.0], [0.0, 300.0], [0.0, 30_000.0]])
    trunks = Trunks(place, np.array([0.3, 1e-6, 0.3]), np.arange(3))
    ends = np.array([-5.0, 0.0]), np.array([5.0, 0.0])
    paths = trunk_paths(trunks, *ends, 2.0, 0.7)
    near = paths.select(np.array([0, 1]))
    assert record_length(near, (10.0,), 8e3, AIR) < 0.15 + AFTER
    assert record_length(paths.select(np.array([2])), (), 8e3, AIR) == LONGEST
    assert RANGE_DB > 65


def test_the_last_trunk_that_is_needed_is_that_of_a_sum_over_all_in_order() -> None:
    trunks = forest(4000, 3000.0)
    paths = trunk_paths(trunks, np.array([-5.0, 0.0]), np.array([5.0, 0.0]), 2.0, 0.7)
    energies, unscattered = arrival_energies(paths, (10.0,), 24e3, AIR)
    order = np.argsort(paths.length)
    left = np.cumsum(energies[:, order[::-1]], axis=1)[:, ::-1]
    allowed = (left[:, :1] + unscattered[:, None]) * 10.0 ** (-RANGE_DB / 10.0)
    last = paths.length[order[np.flatnonzero((left > allowed).any(axis=0))[-1]]]
    assert last < paths.length.max()
    assert record_length(paths, (10.0,), 24e3, AIR) == pytest.approx(last / 343.0 + AFTER)


def test_energies_are_those_of_the_sound() -> None:
    """One trunk at a time is summed; trunks all round, so that the mean over angles is what they have."""
    trunks = forest(400, 60.0, 0.1)
    paths = trunk_paths(trunks, np.array([-5.0, 0.0]), np.array([5.0, 0.0]), 2.0, 0.7)
    angle = np.random.default_rng(2).uniform(0.0, math.pi, 400)
    paths = type(paths)(paths.length, paths.weight, angle, paths.radius, paths.clamped)
    expected = arrival_energies(paths, (), 8e3, AIR)[0].sum(axis=1)
    samples = direct_sum(paths, 8e3, 8000, AIR)
    spectrum = np.square(np.abs(np.fft.rfft(samples)))
    frequency = np.fft.rfftfreq(8000, 1 / 8e3)
    measured = [
        spectrum[(frequency > f / 2**0.5) & (frequency < f * 2**0.5)].sum()
        for f in 31.25 * 2.0 ** np.arange(len(expected))
    ]
    ratio = 10 * np.log10(np.array(measured) / expected)
    assert np.ptp(ratio[2:]) < 4.0  # dB, as random sums are


def test_a_cut_record_says_so_and_has_no_reverberation_time() -> None:
    """The same forest, whole and cut after 0.3 s: its T30 would come out at half or less."""
    trunks = forest(3000, 600.0)
    whole, cut = listen(trunks, 0.0), listen(trunks, 0.3)
    assert cut.late > 2000
    assert (cut.left_db[2:] > -40.0).all()
    energy = [float(np.square(found.samples).sum()) for found in (whole, cut)]
    missing = 10 * math.log10((energy[0] - energy[1]) / energy[0])
    assert cut.left_db[0] == pytest.approx(missing, abs=3.0)
    short = reverberation_time(cut.samples, 8e3)
    assert short < 0.6 * reverberation_time(whole.samples, 8e3)
    measures = room_metrics(cut.samples, 8e3, cut.left_db)
    assert np.isnan(measures.t30).all()
    assert np.isfinite(room_metrics(whole.samples, 8e3, whole.left_db).t30[1:]).all()


def test_measures_are_refused_one_by_one() -> None:
    """What is left -50 dB below changes no T30, but T60; -15 dB below changes the clarity."""
    samples = 10.0 ** (-3.0 * np.arange(32_000) / 8e3 / 1.0)
    count = len(room_metrics(samples, 8e3).band)
    some = room_metrics(samples, 8e3, np.full(count, -50.0))
    assert np.isfinite([some.edt[0], some.t20[0], some.t30[0], some.c50[0]]).all()
    assert np.isnan(some.t60).all()
    few = room_metrics(samples, 8e3, np.full(count, -15.0))
    assert np.isnan([few.edt[0], few.t20[0], few.c50[0], few.centre_time[0]]).all()


CLAP = Reverb(source=(0, 0, 1.5), receiver=(4, 0, 1.5), sample_rate=8000, duration=0.3)


def stand(count=80, low=1e-3, high=0.3, seed=3):
    """Twigs beside trunks: most of them change nothing."""
    rng = stream(seed, "weak")
    place = rng.uniform(-60, 60, (count, 2))
    place = place[np.linalg.norm(place, axis=1) > 5]
    radius = np.exp(rng.uniform(math.log(low), math.log(high), len(place)))
    return Trunks(place, radius, np.arange(len(place)))


def octave_norms(samples, rate):
    power = np.abs(np.fft.rfft(samples)) ** 2 * (rate / len(samples))
    frequency = np.arange(len(power)) * rate / len(samples)
    middles = octave_bands(rate)
    return np.array(
        [
            np.sqrt(power[(frequency >= f / 2**0.5) & (frequency < f * 2**0.5)].sum())
            for f in middles
        ]
    )


@pytest.mark.medium
@pytest.mark.parametrize("model", ["paper", pytest.param("forest", marks=pytest.mark.slow)])
def test_what_is_left_out_is_below_its_bound(model):
    trunks, clap = stand(), CLAP.changed(model=model, tail="none", tolerance=0.0)
    field = ((-60.0, -60.0), (120.0, 120.0))
    whole = impulse_response(trunks, clap, Air(), field=field)
    some = impulse_response(trunks, clap, Air(), field=field, all_trunks=False)
    assert 0 < some.weak < len(trunks)
    assert whole.trunks + whole.late == some.trunks + some.late + some.weak
    apart = octave_norms(whole.trees - some.trees, CLAP.sample_rate)
    heard = octave_norms(some.samples, CLAP.sample_rate)
    assert (apart <= some.weak_bound * heard * 1.001).all()
    assert (apart > 0).any()
    assert some.weak_bound < 3 * 10 ** (-75 / 20)  # what is allowed is set against an estimate


@pytest.mark.medium
def test_the_bound_holds_trunk_by_trunk():
    """Twenty trunks of any size and angle, each alone against its own bound."""
    trunks = stand(20, low=1e-3, high=2.0, seed=5)
    clap = CLAP.changed(duration=1.0, tolerance=0.0)
    paths = trunk_paths(trunks, np.zeros(2), np.array([4.0, 0.0]), clap.strength, clap.spreading)
    norms = _largest(paths, np.array(octave_bands(clap.sample_rate)), Air())
    for row in range(0, len(trunks), 4):
        one = impulse_response(trunks.select(np.array([row])), clap, Air()).trees
        assert (octave_norms(one, clap.sample_rate) <= 1.02 * norms[:, row]).all()


def test_nothing_is_left_out_where_all_matters():
    trunks = stand(12, low=0.2, high=0.3)
    assert impulse_response(trunks, CLAP, Air(), all_trunks=False).weak == 0
    none = Trunks(np.empty((0, 2)), np.empty(0), np.empty(0, int))
    paths = trunk_paths(none, np.zeros(2), np.ones(2), 2.0, 0.7)
    weak = weak_trunks(paths, (1.0,), 8000.0, Air())
    assert weak.bound(np.zeros(100), 8000.0) == 0.0


def test_silence_leaves_nothing_out():
    """With no direct sound, all is relative to the trunks themselves."""
    trunks = Trunks(np.array([[10.0, 0.0], [0.0, 10.0]]), np.array([0.1, 0.0]), np.arange(2))
    paths = trunk_paths(trunks, np.zeros(2), np.array([4.0, 0.0]), 2.0, 0.7)
    assert weak_trunks(paths, (), 8000.0, Air()).rows.tolist() == [False, True]
