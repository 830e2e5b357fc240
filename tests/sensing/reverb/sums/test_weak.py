"""Trunks that are left out of a response: their bound holds against the direct sum of what they add."""

import math

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.metrics import octave_bands
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.sums.scattering import trunk_paths
from forest_addon.sensing.reverb.sums.tree_response import _largest, weak_trunks
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb

CLAP = Reverb(source=(0, 0, 1.5), receiver=(4, 0, 1.5), sample_rate=8000, duration=0.4)


def stand(count=150, low=1e-3, high=0.3, seed=3):
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
