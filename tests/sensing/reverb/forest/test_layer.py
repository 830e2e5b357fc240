"""Transport in space in the layer of a forest: closed forms, another Monte Carlo, waves among points."""

import math
from dataclasses import replace

import numpy as np
import pytest
from references.reverb import in_layer

from forest_addon.acoustics.foliage import twig_loss
from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.forest.clutter import (
    ANGLES,
    Clutter,
    Scatter,
    Takes,
    level_loss,
    scatter_of,
)
from forest_addon.sensing.reverb.forest.layer import Layer, diffused
from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand
from forest_addon.sensing.reverb.forest.tail import tail_of
from forest_addon.sensing.reverb.forest.transport import Density, PhaseFunction
from forest_addon.spec import Air, Reverb

AIR = Air(sound_speed=343.0)
ALL_WAYS = np.full(ANGLES, 0.25 / math.pi)
HARD = np.array([np.inf + 0j])
TWIGS = Clutter((0.005,), ((2.0,),) * 12, (0.785,), (0.2,) * 12, 0.02)


def around(width: float) -> PhaseFunction:
    """Alike all round the vertical."""
    return PhaseFunction(width, 1.0, np.zeros(1440), np.full(1440, 0.5 / math.pi))


def even(rate: float, layers: int) -> Scatter:
    return Scatter(np.full(layers, rate), np.zeros(layers), ALL_WAYS)


def paasschens(distance: float, length: np.ndarray, free_path: float) -> np.ndarray:
    """Scattered energy of isotropic scatterers in space, of a source 1/r² (Paasschens 1997, eq. 36)."""
    near = 1.0 - (distance / length) ** 2
    y = length / free_path * near**0.75
    spread = (4.0 * math.pi * free_path * length / 3.0) ** -1.5 * near**0.125
    return 4 * math.pi * spread * np.exp(y - length / free_path) * np.sqrt(1.0 + 2.026 / y)


def test_isotropic_scatterers_in_space() -> None:
    edges = np.linspace(10.01, 110.0, 11)
    layer = Layer(0.0, (around(1e-9),), (even(0.1, 2000),), 2000.0, 0.0, HARD)
    ends = np.array([[0.0, 0.0, 1000.0], [10.0, 0.0, 1000.0]])
    found = diffused(layer, *ends, edges, 15_000, np.random.default_rng(1)).mean(0)[0]
    fine = np.linspace(0, 1, 50)[:, None] * np.diff(edges) + edges[:-1]
    apart = 10 * np.log10(found / paasschens(10.0, fine, 10.0).mean(axis=0))
    assert np.abs(apart).max() < 1.2
    assert abs(apart.mean()) < 0.6


@pytest.mark.slow
def test_a_layer_of_trunks_and_branches_by_another_monte_carlo() -> None:
    """Its packets' ways are measured in a ring; trunks keep slopes exactly there."""
    rng = np.random.default_rng(2)
    edges = np.array([9.0, 14.0, 20.0, 30.0, 45.0, 70.0])
    layer = Layer(0.05, (around(1.0),), (even(0.04, 8),), 8.0, 0.0, HARD)
    source, receiver = np.array([0.0, 0.0, 1.5]), np.array([8.0, 0.0, 1.5])
    found = diffused(layer, source, receiver, edges, 20_000, rng).mean(0)[0]
    plain = in_layer(
        0.05,
        lambda g, n: g.uniform(-math.pi, math.pi, n),
        0.04,
        8.0,
        source,
        (7.0, 9.0),
        (0.75, 2.25),
        edges,
        100_000,
        rng,
    )
    assert np.abs(10 * np.log10(found / plain)).max() < 1.0


@pytest.mark.medium
def test_between_mirrors_nothing_is_lost() -> None:
    """The energy that is counted falls as in the plane, 1/x, where all is even over the height."""
    edges = np.geomspace(100.0, 400.0, 6)
    layer = Layer(0.0, (around(1e-9),), (even(0.25, 16),), 16.0, 1.0, HARD)
    ends = np.array([[0.0, 0.0, 6.0], [5.0, 0.0, 9.0]])
    found = diffused(layer, *ends, edges, 5000, np.random.default_rng(3)).mean(0)[0]
    middle = np.sqrt(edges[1:] * edges[:-1])
    plane = 4 * math.pi / 16.0 / (4 * math.pi * middle * 4.0 / 3.0)  # diffusion, D = c·l/3
    apart = 10 * np.log10(found / plane)
    assert np.abs(apart).max() < 1.6
    assert abs(apart.mean()) < 0.7


def test_without_branches_all_is_as_in_the_plane() -> None:
    reverb = Reverb(model="forest", branches=False, foliage=False)
    ends = np.array([[0.0, 0.0, 1.5], [9.0, 0.0, 1.5]])
    losses = Losses.of(reverb, AIR, TrunkStand(0.1, (0.1,)), *ends)
    tail = tail_of(reverb, losses, Density.even(0.1), *ends, 0.2, (1,), 200)
    assert tail.diffuse is None
    np.testing.assert_array_equal(losses.of_clutter(np.array([100.0, 8000.0])), 0.0)


def test_branches_send_energy_into_the_noise_and_take_it_from_paths() -> None:
    reverb = Reverb(model="forest")
    ends = np.array([[0.0, 0.0, 1.5], [9.0, 0.0, 1.5]])
    losses = Losses.of(reverb, AIR, TrunkStand(0.1, (0.1,), 0.2, 12.0, TWIGS), *ends)
    tail = tail_of(reverb, losses, Density.even(0.1), *ends, 0.3, (1,), 300)
    assert (tail.diffuse[-1] > 0).sum() > 20
    bare = replace(losses, scattered=False)
    taken = losses.along(np.array([8000.0])) - bare.along(np.array([8000.0]))
    scatter = scatter_of(TWIGS, 8000.0, 343.0, Takes(bark=reverb.bark, boundary=True))
    whole = scatter.scattered[1] + scatter.absorbed[1]
    np.testing.assert_allclose(2 * taken, whole, rtol=1e-3)


def test_phase_functions_hold_all_energy_and_grow_with_frequency() -> None:
    solid = -2 * math.pi * np.diff(np.cos(np.linspace(0, math.pi, ANGLES + 1)))
    wide = []
    for frequency in (500.0, 2000.0, 8000.0):
        found = scatter_of(TWIGS, frequency, 343.0, Takes(0.0015))
        assert abs(found.density @ solid - 1) < 1e-3
        wide.append(found.scattered[0])
    assert wide[0] < wide[1] < wide[2]
    assert level_loss(Clutter(), 1.5, 343.0, Takes()) is None


def test_bark_of_twigs_takes_what_an_impedance_takes() -> None:
    """Small cylinders see the same pressure all round: 2πa·Re β a metre, of a share 1 - |(1-β)/(1+β)|²."""
    share, small = 0.05, Clutter((1e-4,), ((100.0,),), (1.0,), (0.0,), 0.02)
    beta = (1 - math.sqrt(1 - share)) / (1 + math.sqrt(1 - share))
    found = scatter_of(small, 2000.0, 343.0, Takes(bark=share))
    assert found.absorbed[0] == pytest.approx(100.0 * 2 * math.pi * 1e-4 * beta, rel=0.02)
    assert scatter_of(small, 2000.0, 343.0, Takes()).absorbed[0] == 0
    wet = scatter_of(small, 2000.0, 343.0, Takes(boundary=True))
    assert wet.absorbed[0] == pytest.approx(100.0 * twig_loss(np.array([1e-4]), 2000.0, 343.0)[0])


def test_litter_and_a_canopy_that_returns() -> None:
    edges, ends = np.linspace(10, 60, 5), np.array([[0.0, 0.0, 1.5], [9.0, 0.0, 1.5]])
    layer = Layer(0.05, (around(0.3),), (even(0.02, 8),), 8.0, 0.0, HARD)
    levels = [
        diffused(each, *ends, edges, 3000, stream(1, "test")).mean(0)[0].sum()
        for each in (layer, replace(layer, back=0.8), replace(layer, rough=0.3))
    ]
    assert levels[1] > 1.1 * levels[0]
    assert levels[2] > levels[0]
