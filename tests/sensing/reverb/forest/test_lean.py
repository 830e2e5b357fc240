"""Trunks that lean, against waves along their axes; plants on the floor, against limits of a layer."""

from __future__ import annotations

import numpy as np
import pytest

from forest_addon.acoustics.ground import surface_impedance, under_leaves
from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand, lean_coherence
from forest_addon.spec import Air, Reverb

HEIGHT, REFLECTED = 1.5, -0.9
Z = np.linspace(0.0, 60.0, 6001)[1:]
FADE = np.cos(np.clip((Z - 20.0) / 40.0, 0.0, 1.0) * np.pi / 2) ** 2


def along_the_axis(k: float, legs: tuple[float, float], turn: float, slope: np.ndarray) -> float:
    """|p|² of sound that an axis scatters, from a source and its image to a receiver and its image."""
    ends = np.array([[-legs[0], 0.0], legs[1] * np.array([np.cos(turn), np.sin(turn)])])
    place = np.outer(Z - HEIGHT, slope)
    waves = []
    for end in ends:
        level = np.hypot(*(place - end).T)
        way = [np.hypot(level, Z - z) for z in (HEIGHT, -HEIGHT)]
        waves.append(
            np.exp(1j * k * way[0]) / way[0] + REFLECTED * np.exp(1j * k * way[1]) / way[1]
        )
    return float(abs((waves[0] * waves[1] * FADE).sum()) ** 2)


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [500.0, 1000.0, 2000.0])
def test_energy_over_a_ground_of_trunks_that_lean(frequency: float) -> None:
    """Mean over leans, turns, places on the way and a third of an octave, re upright trunks; 1.2 dB."""
    rng, lean, x = np.random.default_rng(1), 0.05, 30.0
    leaning = upright = formula = plain = 0.0
    detour = np.hypot(x, 2 * HEIGHT) - x
    for n in range(320):
        k = 2 * np.pi * frequency / 340.0 * 2 ** rng.uniform(-1 / 6, 1 / 6)
        share = (n % 16 + 0.5) / 16
        turn = 2 * np.arcsin(np.sqrt(1 - rng.random() ** 2)) * rng.choice((-1, 1))
        given = k, (share * x, (1 - share) * x), turn
        scale = share * (1 - share) * k
        leaning += scale * along_the_axis(*given, lean * rng.normal(size=2))
        upright += scale * along_the_axis(*given, np.zeros(2))
        left = lean_coherence(np.array(k), np.array(x), (HEIGHT, HEIGHT), lean, np.array(1e-5))
        turned = 2 * REFLECTED * np.cos(k * detour)
        formula += 1 + REFLECTED**2 + left * turned
        plain += 1 + REFLECTED**2 + turned
    apart = 10 * np.log10(leaning / upright) - 10 * np.log10(formula / plain)
    assert abs(apart) < 1.2
    if frequency > 600:
        assert abs(10 * np.log10(leaning / upright)) > 0.3


def test_upright_trunks_keep_all_coherence_and_more_meetings_leave_less() -> None:
    k, x = np.geomspace(0.2, 300.0, 60), np.array(60.0)
    none = lean_coherence(k, x, (1.5, 1.5), 1e-6, np.array(1.0))
    np.testing.assert_allclose(none, 1.0, atol=1e-3)
    once, twice = (lean_coherence(k, x, (1.5, 1.2), 0.03, np.array(m)) for m in (1e-5, 2.0))
    assert (twice <= once + 1e-12).all()
    assert once[0] > 0.99
    assert once[-1] < 0.1


def test_a_layer_without_leaves_is_the_ground_alone() -> None:
    frequency = np.array([200.0, 1000.0, 8000.0])
    ground = surface_impedance(frequency, 60.0)
    for sine in (0.01, 0.3, 0.9):
        found = under_leaves(frequency, sine, ground, 0.3, np.zeros(3), 343.0)
        np.testing.assert_allclose(found, ground, rtol=1e-9)


def test_a_dense_layer_hides_the_ground_but_for_waves_that_come_level() -> None:
    """From above, leaves that take all leave next to nothing; level waves are turned back at their top."""
    frequency, loss = np.array([4000.0]), np.array([3.0])
    for sine, low, high in ((0.8, 0.0, 0.1), (0.001, 0.95, 1.0)):
        z = under_leaves(frequency, sine, np.array([1e9 + 0j]), 2.0, loss, 343.0)
        reflected = abs((z * sine - 1) / (z * sine + 1))[0]
        assert low <= reflected <= high


def test_herbs_take_from_the_ground_at_high_frequencies_alone() -> None:
    ends = np.array([[0.0, 0.0, 1.5], [30.0, 0.0, 1.5]])
    bare, herbs = (
        Losses.of(
            Reverb(model="forest", turbulence=0.0, lean_deg=0.0),
            Air(),
            TrunkStand(floor_leaf_area=area),
            *ends,
        )
        for area in (0.0, 2.0)
    )
    frequency = np.array([250.0, 4000.0])
    share = np.abs(herbs.bounce(frequency, 30.0) / bare.bounce(frequency, 30.0))
    assert share[0] > 0.98
    assert share[1] < 0.75
