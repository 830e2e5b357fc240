"""What paths lose: against a field in space, the direct sum, and integrals done another way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references.trunk_in_space import scattered_in_space

from forest_addon.acoustics.cylinder import transfer
from forest_addon.acoustics.ground import spherical_reflection, surface_impedance, under_leaves
from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand, lean_coherence
from forest_addon.sensing.reverb.sums.path_gain import PathGain
from forest_addon.sensing.reverb.sums.scattering import (
    scattered_spectrum,
    spectrum_by_nodes,
    trunk_paths,
)
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb

AIR = Air(sound_speed=343.0)
SOURCE, RECEIVER = np.array([-5.0, 0.0, 1.5]), np.array([5.0, 0.0, 1.8])
STAND = TrunkStand(0.07, (0.1, 0.2), 0.3, 15.0)


def losses_of(stand=STAND, source=SOURCE, receiver=RECEIVER, **changes):
    given = {"model": "forest", "surface": "forest floor"}
    return Losses.of(Reverb(**(given | changes)), AIR, stand, source, receiver)


@pytest.mark.slow
@pytest.mark.parametrize("rise", [0.0, 3.0])
def test_a_trunk_in_space(rise):
    """Both the weight and a path that rises, by an integral over vertical wavenumbers; far away to 1/kr."""
    k, radius, legs, turned = 8.0, 0.15, (18.0, 24.0), 2.2
    x = sum(legs)
    exact = scattered_in_space(k, radius, legs, turned, rise)
    frequency = np.array([k * 343.0 / (2.0 * np.pi)])
    level = losses_of(
        TrunkStand(), SOURCE, SOURCE + np.array([0, 0, rise]), path_ground=False, turbulence=0.0
    )
    shared = transfer(frequency * np.cos(np.arctan(rise / x)), turned, radius, 343.0)[0]
    carried = level.of_ground(frequency, np.array([x]))[0]
    found = shared * carried * np.exp(-1j * k * x) / np.sqrt(x * legs[0] * legs[1])
    assert abs(np.conj(found) - exact) < 0.015 * abs(exact)


def test_over_a_hard_ground_each_path_is_heard_twice():
    """Ends on a hard ground: twice the pressure, at any distance."""
    low = SOURCE * [1, 1, 1e-4]
    hard = losses_of(TrunkStand(), low, low, surface="constant", ground=1.0, turbulence=0.0)
    gain = hard.gain(np.array([[100.0], [5000.0]]), np.array([20.0, 300.0]))
    np.testing.assert_allclose(gain, 2.0, rtol=1e-3)


def test_the_ground_of_a_path_is_that_of_the_direct_sound_as_far_away():
    frequency, x = np.array([200.0, 2000.0]), 80.0
    found = losses_of(TrunkStand(), SOURCE, SOURCE, turbulence=0.0, lean_deg=0.0).of_ground(
        frequency, np.array(x)
    )
    path = np.hypot(x, 3.0)
    q = spherical_reflection(frequency, path, 3.0, surface_impedance(frequency, 50.0), 343.0)
    loss = losses_of(TrunkStand(), SOURCE, SOURCE).along(frequency)
    k = 2.0 * np.pi * frequency / 343.0
    there = 1.0 + q * x / path * np.exp(-(loss + 1j * k) * (path - x))
    np.testing.assert_allclose(found, there, rtol=1e-9)


def test_turbulence_keeps_the_energy_of_both_ways():
    """The mean over both states of the air is |p₁|² + |p₂|² + 2Γ·Re p₁p₂*; none where Γ = 0."""
    frequency, length = np.array([[500.0], [8000.0]]), np.array([30.0, 200.0])
    still = losses_of(TrunkStand(), turbulence=0.0)
    wild = losses_of(TrunkStand(), turbulence=100.0)
    first = replace(still, ground=False).of_ground(frequency, length)
    second = still.of_ground(frequency, length) - first
    apart = np.abs(first) ** 2 + np.abs(second) ** 2
    found = wild.mean_square(frequency, length)
    np.testing.assert_allclose(found[1], apart[1], rtol=1e-3)


def test_where_trunks_end_the_fresnel_integral_does():
    """Against e^{-iαz²} over a trunk and its image, summed over heights that differ."""
    frequency, x, top = 250.0, 120.0, 12.0
    low = SOURCE * [1, 1, 1e-6]
    stand = TrunkStand(0.0, (), 0.0, top)
    found = losses_of(stand, low, low).of_ends(np.array(frequency), np.array(x))
    bend = 2.0 * (2.0 * np.pi * frequency / 343.0) / x
    heights = top * (1.0 + 0.2 * np.linspace(-5, 5, 201))
    share = np.exp(-0.5 * np.linspace(-5, 5, 201) ** 2)
    z = np.linspace(0.0, 2.0 * top, 40_001)
    below = np.cumsum(np.exp(-1j * bend * z**2)) * (z[1] - z[0])
    summed = np.interp(heights, z, below.real) + 1j * np.interp(heights, z, below.imag)
    expected = 2.0 * (share @ summed) / share.sum() / np.sqrt(np.pi / (1j * bend))
    assert abs(found - expected) < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extinction", "lean", "surface", "bound"),
    [
        ("none", 0.0, "snow", 1e-11),
        ("none", 0.0, "asphalt", 1e-11),
        ("energy", 0.0, "asphalt", 1e-7),
        ("none", 2.0, "snow", 1e-5),
    ],
)
@pytest.mark.parametrize(("spacing", "top"), [(0.05, 320.0), (5.0, 10_240.0)])
def test_losses_between_nodes_are_those_of_every_frequency(
    extinction, lean, bound, surface, spacing, top
):
    """In every octave; extinction comes from a cubic spline, whose knots leave a tenth of what is allowed."""
    rng = np.random.default_rng(5)
    radius = np.array([0.03, 0.05, 0.2, 0.45, 0.0])
    trunks = Trunks(rng.uniform(-40, 40, (5, 2)), radius, np.arange(5))
    paths = trunk_paths(trunks, SOURCE[:2], RECEIVER[:2], 2.0, 0.7, None, True)
    losses = losses_of(
        surface=surface, turbulence=10.0, bark=0.05, extinction=extinction, lean_deg=lean
    )
    lowest, highest = round(10 / spacing), round(top / spacing)
    loss = losses.along(np.arange(highest + 1) * spacing)
    exact = scattered_spectrum(
        paths, spacing, loss, AIR.speed(), None, losses.gain, losses.bark, lowest
    )
    found = spectrum_by_nodes(paths, spacing, lowest, highest, losses)
    for first in lowest * 2 ** np.arange(round(np.log2(highest / lowest))):
        octave = slice(first, 2 * first)
        error = np.linalg.norm(found[octave] - exact[octave]) / np.linalg.norm(exact[octave])
        assert error < bound


def test_nothing_changes_where_all_is_off():
    """The losses of a bare stand are the air's alone."""
    bare = losses_of(
        TrunkStand(), SOURCE, SOURCE, extinction="none", path_ground=False, bark=0.0, turbulence=0.0
    )
    assert bare.passes
    frequency = np.array([100.0, 5000.0])
    np.testing.assert_array_equal(bare.removed(frequency), 0.0)
    np.testing.assert_array_equal(bare.gain(frequency, np.array([10.0, 50.0])), 1.0)


@pytest.mark.parametrize("height", [1.5, 0.0])
def test_the_mean_energy_is_that_of_both_states_of_the_air(height):
    """By its own formula, against the mean of two whole gains whose phases turn either way."""
    end = SOURCE * [1, 1, 0] + [0, 0, height or 0.02]
    losses = losses_of(source=SOURCE, receiver=end, lean_deg=2.0, turbulence=3.0)
    frequency, length = np.array([[125.0], [2000.0], [9000.0]]), np.array([11.0, 60.0, 700.0])
    both = [replace(losses, back=back).gain(frequency, length) for back in (False, True)]
    mean = 0.5 * sum(np.abs(one) ** 2 for one in both)
    np.testing.assert_allclose(losses.mean_square(frequency, length), mean, rtol=1e-9)


@pytest.mark.parametrize("number", [3, 8])
def test_filters_of_a_whole_transform_are_those_of_each_frequency(number):
    """Read from a spline, of a near zone's ground path and of a far zone."""
    losses = losses_of(lean_deg=2.0, floor_leaf_area=1.0, leaf_area_density=0.2)
    gain = PathGain(losses, 12e3, 1e-4, whole=True)
    zone = [zone for zone, _ in gain.zones(np.array([1.5 * 2.0**number]))][-1]
    every = np.arange(4001) * 3.0
    found = gain.filters(zone, every)
    some = np.arange(7, 4001, 333)  # as few as are computed one by one
    exact = PathGain(losses, 12e3, 1e-4, whole=True).filters(zone, every[some])
    gap = np.linalg.norm(found[:, some] - exact, axis=1)
    assert gap.max() < 1e-4 * np.linalg.norm(exact)


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
