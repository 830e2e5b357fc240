"""Echoes that flyers hear, by closed forms: trunks, noise, filters, and ways to tell; no Blender."""

import numpy as np
import pytest

from forest_addon.acoustics.air import absorption
from forest_addon.flight.bodies import at_rest
from forest_addon.flight.listening import (
    SONAR,
    EchoTask,
    Listener,
    area_under_curve,
    discriminant,
    network,
    noisy,
    sensed,
)
from forest_addon.flight.policies import SIZE, Trained
from forest_addon.flight.senses import SONAR as EARS, EarSense
from forest_addon.flight.stems import StemWorld
from forest_addon.sensing.sonar.calls import synthesise
from forest_addon.spec import Air, Flight, SpecError

AIR = Air()
LOW, HIGH = SONAR.band
FLIGHT = Flight(start=(0.0, 0.0, 1.5), position_sd=0.1, distance=5.0)
HEARS = EARS.changed(call="impulse", band=(30e3, 50e3), sample_rate=125e3, max_range=4.0)


def trunk(ahead, radius):
    return StemWorld(np.array([[ahead, 0.0]]), np.array([radius]), np.zeros(2), np.ones(2))


def loss(frequency, metres):
    """Share of the pressure that is left after so many metres of air."""
    return float(np.exp(-absorption(frequency) * metres))


@pytest.mark.parametrize("radius", [0.05, 0.2])
def test_a_trunk_sounds_as_a_large_cylinder_does(radius):
    """Geometrical acoustics: sqrt(a/(a + r))/(2r) at r from the near side; the first echo at 2r/c."""
    ears, ahead = EarSense(HEARS.changed(ears=1, ear_turn_deg=0.0), AIR), 2.0
    state = at_rest(FLIGHT, np.array([[0.0, 0.0, 1.5]]), np.zeros(1))
    echo = ears.ping(trunk(ahead, radius), state)
    near = ahead - radius
    expected = np.sqrt(radius / ahead) / (2 * near)
    peak = echo.envelopes[0].max()
    assert 0.9 * loss(50e3, 2 * near) < peak / expected < 1.1 * loss(30e3, 2 * near)
    at = echo.time[echo.envelopes[0].argmax()]
    assert at == pytest.approx(2 * near / AIR.speed(), abs=1 / 20e3)


def test_a_pole_adds_its_echo_to_the_leaves():
    task = EchoTask("pole", 1.4, 0.1)
    pole = task.heard(3, 5, True) - task.heard(3, 5, False)
    first = np.flatnonzero(np.abs(pole[0]) > 0.1 * np.abs(pole).max())[0] / SONAR.sample_rate
    assert 2 * 1.4 / AIR.speed() < first < 2 * 1.75 / AIR.speed()
    with pytest.raises(SpecError, match="not known"):
        EchoTask("tunnel")


def test_noise_is_as_far_below_the_peak_as_is_said():
    """The root mean square of the lines within the band, of 40 drawn records."""
    silent, loudness, snr = np.zeros((1, 3300)), 0.03, 12.0
    drawn = np.array([noisy(silent, snr, loudness, 1, number)[0] for number in range(40)])
    assert np.array_equal(drawn[3], noisy(silent, snr, loudness, 1, 3)[0])
    lines = np.abs(np.fft.rfft(drawn)) ** 2
    frequency = np.fft.rfftfreq(3300, 1 / SONAR.sample_rate)
    inside = (frequency >= LOW) & (frequency <= HIGH)
    power = 2 * lines[:, inside].sum(axis=1).mean() / 3300**2
    # Each record has some 1,650 independent numbers: 66,000 in all, so 1 % is 2.6 standard errors or more.
    assert np.sqrt(power) == pytest.approx(loudness * 10 ** (-snr / 20), rel=0.02)


def test_a_matched_filter_finds_the_call_and_keeps_its_peak():
    call = synthesise(SONAR).samples
    sound, at = np.zeros((1, 3300)), 1234
    sound[0, at : at + len(call)] = 0.5 * call
    power = sensed(sound)
    assert np.all(np.abs(power[1:-1].argmax(axis=1) - at) <= 4)
    assert sensed(2 * sound) == pytest.approx(4 * power, rel=1e-4, abs=1e-12)
    early = power[:, : at - 400].max()
    assert early < 1e-3 * power.max()


def test_a_network_tells_what_no_plane_can():
    rng = np.random.default_rng(0)
    inputs = rng.normal(0, 1, (600, 2))
    is_it = inputs[:, 0] * inputs[:, 1] > 0
    weights = network(inputs[:300], is_it[:300], np.random.default_rng(1))
    first = weights[:-9].reshape(8, 3)
    score = np.tanh(inputs @ first[:, :2].T + first[:, 2]) @ weights[-9:-1] + weights[-1]
    assert area_under_curve(score[300:], is_it[300:]) > 0.95
    plane = discriminant(inputs[:300], is_it[:300])
    assert area_under_curve(inputs[300:] @ plane[:2], is_it[300:]) < 0.65


def test_listeners_tell_what_their_feature_holds():
    """Noise of which half is twice as strong, or begins later: energy, or first crossing, tells it."""
    rng, is_it = np.random.default_rng(2), np.arange(80) % 2 == 1
    power = rng.exponential(1e-6, (80, 8, 640))
    louder, later = power.copy(), power.copy()
    louder[is_it] *= 2.0
    later[is_it, :, :200] *= 1e-6
    later[is_it] *= power[is_it].sum(axis=(1, 2), keepdims=True) / later[is_it].sum(
        axis=(1, 2), keepdims=True
    )
    for name, told, blind in (("energy", louder, later), ("first crossing", later, None)):
        listener = Listener(name)
        score = listener.fit(told[:40], is_it[:40]).score(told[40:])
        assert area_under_curve(score, is_it[40:]) > 0.95
        assert ((score > 0) == is_it[40:]).mean() > 0.9
        if blind is not None:
            score = listener.fit(blind[:40], is_it[:40]).score(blind[40:])
            assert 0.2 < area_under_curve(score, is_it[40:]) < 0.8
    with pytest.raises(SpecError, match="not known"):
        Listener("luck")


def test_a_policy_by_ear_feels_which_side_is_louder():
    sense = EarSense(HEARS, AIR)
    policy = Trained(FLIGHT, sense, np.zeros(SIZE))
    assert policy.sensors == ("sonar",)
    felt = []
    for side in (0.3, -0.3):
        state = at_rest(FLIGHT, np.array([[0.0, 0.0, 1.5]]), np.zeros(1))
        place = StemWorld(np.array([[1.5, side]]), np.array([0.1]), np.zeros(2), np.ones(2))
        told = {"sonar": sense.listen(place, state)}
        felt.append(policy.felt(told)[0])
    left, right = felt
    assert left[:7].max() > 0.3
    assert right[:7].min() < -0.3
    assert left[-1] == pytest.approx(right[-1], abs=0.01)  # from the other side as loud
    with pytest.raises(SpecError, match="two ears"):
        Trained(FLIGHT, EarSense(HEARS, AIR, "waveforms"), np.zeros(SIZE))
