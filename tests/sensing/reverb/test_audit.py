"""A response's audit: silent on what is right, loud on what is wrong; stands of any radii."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from references.trunks_at_length import sum_at_length

from forest_addon.base.rng import stream
from forest_addon.sensing.audit import held
from forest_addon.sensing.reverb.audit import octave_errors, parts_of_response
from forest_addon.sensing.reverb.response import impulse_response, pairs_of
from forest_addon.sensing.reverb.sums.fast_scattering import Expansions
from forest_addon.sensing.reverb.sums.scattering import trunk_paths
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb

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
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 0.0])
@pytest.mark.parametrize("spread", [False, True])
def test_what_is_right_is_kept(soon_fast, tolerance, spread):
    rng = stream(4, "radii")
    radius = np.exp(rng.uniform(np.log(1e-3), np.log(2.0), 150)) if spread else np.full(500, 0.15)
    found = audit(stand(radius), CLAP.changed(tolerance=tolerance))
    assert found.kept, str(found)
    assert found.checked > 5


@pytest.mark.slow
@example(power=-6.0, thickest=2.0, seed=2)
@settings(max_examples=2)
@given(
    power=st.floats(-6, -2),
    thickest=st.sampled_from([0.001, 0.05, 0.5, 2.0]),
    seed=st.integers(0, 1000),
)
def test_what_was_asked_is_kept_always(soon_fast, power, thickest, seed):
    """The whole and each octave, against the direct sum; radii from 1 mm to 2 m."""
    rng = stream(seed, "radii")
    radius = np.exp(rng.uniform(np.log(1e-3), np.log(thickest), 100))
    sensor = CLAP.changed(tolerance=10**power, sample_rate=16000)
    trunks = stand(radius)
    found = impulse_response(trunks, sensor, AIR, expansions=Expansions())
    exact = impulse_response(trunks, sensor.changed(tolerance=0.0), AIR)
    assert octave_errors(found.trees - exact.trees, exact.trees, 16000).max() <= 10**power


@pytest.mark.slow
@example(power=-8.0, thickest=2.0, seed=1)
@settings(max_examples=1)
@given(
    power=st.floats(-8, -6.1),
    thickest=st.sampled_from([0.02, 0.2, 2.0]),
    seed=st.integers(0, 1000),
)
def test_what_only_the_direct_sum_keeps_is_kept_and_its_audit_tells_the_truth(
    power, thickest, seed
):
    """Against a sum that nothing wraps around in; the audit is of what the transforms cut off."""
    rng = stream(seed, "radii")
    trunks = stand(np.exp(rng.uniform(np.log(1e-3), np.log(thickest), 8)))
    sensor = CLAP.changed(tolerance=10**power, sample_rate=1000)
    found = impulse_response(trunks, sensor, AIR)
    paths = trunk_paths(trunks, HERE[:2], THERE[:2], sensor.strength, sensor.spreading)
    truth = sum_at_length(paths, 1000.0, len(found.trees), AIR, seconds=200.0)
    errors = octave_errors(found.trees - truth, truth, 1000.0)
    assert found.exact
    assert errors.max() <= 10**power
    checked = audit(trunks, sensor)
    assert checked.kept, str(checked)
    assert checked.error < 10**power


@pytest.mark.slow
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


@pytest.mark.medium
def test_a_wrong_sum_is_found():
    def louder(found):
        return replace(found, trees=1.001 * found.trees)

    found = audit(stand(np.full(1500, 0.15)), CLAP, louder)
    assert not found.kept
    assert found.error == pytest.approx(1e-3, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("louder", [1.0, 1.03])
def test_slow_ringing_of_near_trunks_is_no_error_of_late_sound_that_others_thin_out(louder):
    """0.1 trunks per m² and no leaves: the last pieces are 40 dB below the first; 3 % more is found."""
    rng = stream(3, "stems")
    radius = np.clip(rng.normal(0.15, 0.04, 4000), 0.02, None)
    trunks = Trunks(rng.uniform(-100, 100, (4000, 2)), radius, np.full(4000, -1))
    clap = CLAP.changed(model="forest", sample_rate=1000, duration=0.0)
    trunks = trunks.clear_of(np.array([HERE[:2], THERE[:2]]))
    field, made = ((-100.0, -100.0), (200.0, 200.0)), Expansions()
    found = impulse_response(trunks, clap, AIR, expansions=made, field=field)
    late = np.arange(len(found.trees)) > 0.3 * 1000
    noise = found.tail
    found = replace(found, trees=noise + (found.trees - noise) * np.where(late, louder, 1.0))
    parts = parts_of_response(found, pairs_of(trunks, clap, AIR, field=field), made, 0.02)
    (pieces,) = held(parts[-1:], stream(1, "a"), 8.0).checks
    assert pieces.what.startswith("pieces")
    assert pieces.kept == (louder == 1.0), str(pieces)


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
    errors = octave_errors(0.1 * low + 0.01 * high, low + high, 8000.0)
    assert errors[0] == pytest.approx(np.sqrt((0.1**2 + 0.01**2) / 2))
    assert sorted(errors[1:].round(4)) == pytest.approx([0.01, 0.1], abs=1e-3)
