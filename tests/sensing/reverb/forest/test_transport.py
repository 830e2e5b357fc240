"""Energy of sound scattered again and again: a closed form, balance, stands that are not even."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from references.reverb import in_layer
from scipy.integrate import quad

from forest_addon.acoustics.foliage import twig_loss
from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.forest.clutter import (
    ANGLES as WAYS,
    Clutter,
    Scatter,
    Takes,
    level_loss,
    scatter_of,
)
from forest_addon.sensing.reverb.forest.layer import Layer, diffused
from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand
from forest_addon.sensing.reverb.forest.tail import tail_of
from forest_addon.sensing.reverb.forest.transport import (
    ANGLES,
    Density,
    PhaseFunction,
    Turns,
    transported_bands,
)
from forest_addon.sensing.reverb.metrics import octave
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb

ANGLE = math.pi * (np.arange(ANGLES) + 0.5) / ANGLES
ALIKE = PhaseFunction(0.4, 1.0, ANGLE, np.full(ANGLES, 0.5 / math.pi))
RECEIVER = np.array([10.0, 0.0])


def transported(phase, density, source, receiver, edges, packets, rng, *sent):
    """The energy of one band, through all bins."""
    given = (source, receiver), edges, (len(edges) - 1,), packets, rng, sent
    return transported_bands((phase,), density, *given)[0]


def isotropic(distance, length, free_path):
    """Once and more than once scattered energy a metre, 2π·P/x, of a free path (Paasschens 1997).

    distance : m between source and receiver. length : (X,) metres of path, larger than that.
    """
    root = np.sqrt(np.maximum(length**2 - distance**2, 1e-300))
    once = np.exp(-length / free_path) / (free_path * root * length)
    return once, once * np.expm1(root / free_path)


def test_packets_follow_the_closed_form():
    """30,000 packets: bins within 25 % (3.5 standard deviations of the worst), all together within 5 %."""
    edges = np.geomspace(12.0, 200.0, 9)
    rng = np.random.default_rng(2)
    found = transported(ALIKE, Density.even(0.07), np.zeros(2), RECEIVER, edges, 30_000, rng)
    for number, part in enumerate((found.once, found.again)):
        true = [
            quad(lambda x, n: isotropic(10.0, np.array([x]), 1 / 0.028)[n][0], a, b, number)[0]
            / (b - a)
            for a, b in pairwise(edges)
        ]
        np.testing.assert_allclose(part, true, rtol=0.25)
        assert (part / true).mean() == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("way", ["energy", "coherent"])
def test_what_bark_does_not_keep_is_scattered(way):
    rigid = PhaseFunction.of(2000.0, np.array([0.1]), 343.0, 0.0, way)
    assert rigid.kept == pytest.approx(1.0, abs=2e-3)
    barky = PhaseFunction.of(2000.0, np.array([0.1]), 343.0, 0.1, way)
    assert 0.8 < barky.kept < 0.97


def test_turns_are_drawn_as_the_phase_functions_have_them():
    """Two bands side by side: sums of the drawn angles up to each of 24, within 0.01 (20,000 draws)."""
    both = [PhaseFunction.of(f, np.array([0.1]), 343.0, 0.0, "energy") for f in (250.0, 4000.0)]
    band = np.repeat([0, 1], 20_000)
    drawn = Turns(np.array([phase.density for phase in both])).draw(band, np.random.default_rng(1))
    assert abs(np.sign(drawn).mean()) < 0.02
    for row, phase in enumerate(both):
        share = np.cumsum(phase.density) / phase.density.sum()
        for cell in range(59, 1440, 60):
            found = (np.abs(drawn[band == row]) < math.pi * (cell + 1) / 1440).mean()
            assert found == pytest.approx(share[cell], abs=0.01)


@pytest.mark.medium
def test_cells_of_one_density_are_an_even_stand():
    edges = np.geomspace(12.0, 60.0, 4)
    cells = Density(np.full((40, 40), 0.07), (-200.0, -200.0), (10.0, 10.0), 0.07)
    some = [
        transported(ALIKE, density, np.zeros(2), RECEIVER, edges, 60_000, np.random.default_rng(3))
        for density in (cells, Density.even(0.07))
    ]
    np.testing.assert_allclose(some[0].again[1:], some[1].again[1:], rtol=0.16)


def test_a_clearing_is_quiet_until_its_edge_answers():
    """No trunk within 30 m: nothing before the way to the edge and back, and sound after it."""
    place = np.arange(80) * 5.0 - 197.5
    clear = np.hypot(*np.meshgrid(place, place, indexing="ij")) < 34.0
    density = Density(np.where(clear, 0.0, 0.1), (-200.0, -200.0), (5.0, 5.0), 0.1)
    edges = np.array([11.0, 40.0, 55.0, 75.0, 120.0])
    found = transported(
        ALIKE, density, np.zeros(2), RECEIVER, edges, 3_000, np.random.default_rng(1)
    )
    assert found.once[0] == 0
    assert found.once[2] > 0
    assert found.again[0] == 0


def test_one_cell_is_as_many_of_its_density() -> None:
    """A stand with edges and nothing around it; the source outside of it, and within."""
    edges = np.array([12.0, 25.0, 60.0, 150.0])
    whole = Density(np.full((1, 1), 0.07), (-30.0, -20.0), (60.0, 40.0), 0.0)
    cells = Density(np.full((30, 20), 0.07), (-30.0, -20.0), (2.0, 2.0), 0.0)
    for source in (np.zeros(2), np.array([-34.0, 3.0])):
        first, second = (
            transported(ALIKE, d, source, RECEIVER, edges, 12_000, np.random.default_rng(5))
            for d in (whole, cells)
        )
        together = np.array([one.once + one.again for one in (first, second)])
        heard = (together > 0).all(axis=0)
        assert heard.sum() >= 2
        assert np.abs(10 * np.log10(together[0, heard] / together[1, heard])).max() < 0.5
    way = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    place = np.array([[40.0, 0.0], [0.0, 0.0], [40.0, 0.0]])
    np.testing.assert_array_equal(whole.left(place, way), [True, False, False])
    ways = np.array([[0.0, 0.0], [-60.0, 0.0]])
    np.testing.assert_allclose(
        whole.between(ways, np.array([60.0, 0.0])), [0.07 * 30, 0.07 * 60], rtol=1e-12
    )


def test_an_opaque_stand_and_one_without_trunks():
    edges = np.array([11.0, 20.0, 40.0])
    rng = np.random.default_rng(1)
    opaque = transported(ALIKE, Density.even(20.0), np.zeros(2), RECEIVER, edges, 50, rng)
    assert np.isfinite(opaque.again).all()
    empty = transported(ALIKE, Density.even(0.0), np.zeros(2), RECEIVER, edges, 50, rng)
    assert not empty.again.any()


def test_a_source_that_sends_one_way_sends_as_much_late_energy_as_its_mean() -> None:
    """Cardioid in energy: half of the axis in the mean, wherever it points, once all is mixed."""
    edges = np.array([60.0, 120.0])

    def sum_of(turn: float) -> float:
        sent = lambda way: 0.5 + 0.5 * (way[:, 0] * np.cos(turn) + way[:, 1] * np.sin(turn))  # noqa: E731
        rng = np.random.default_rng(9)
        given = ALIKE, Density.even(0.5), np.zeros(2), np.array([0.5, 0.0]), edges, 4000, rng
        return float(transported(*given, sent).again.sum())

    rng = np.random.default_rng(9)
    given = ALIKE, Density.even(0.5), np.zeros(2), np.array([0.5, 0.0]), edges, 4000, rng
    alike = float(transported(*given).again.sum())
    for turn in (0.0, np.pi):
        assert abs(10 * np.log10(sum_of(turn) / (0.5 * alike))) < 0.7


# ---------------------------------------------------------------------------------------------- tail
# Sound scattered more than once, as noise: its energy, its joint, and stands that are hard.

AIR = Air(sound_speed=343.0)
TWIGS = Clutter((0.005,), ((2.0,),) * 12, (0.785,), (0.2,) * 12, 0.02)
SOURCE, TAIL_RECEIVER = np.array([-5.0, 0.0, 1.5]), np.array([5.0, 0.0, 1.5])
SETTINGS = {
    "model": "forest",
    "source": (-5.0, 0.0, 1.5),
    "receiver": (5.0, 0.0, 1.5),
    "sample_rate": 4e3,
    "tolerance": 1e-3,
}


def stand_of(count, extent, radius=0.15, seed=1):
    place = np.random.default_rng(seed).uniform(-extent, extent, (count, 2))
    trunks = Trunks(place, np.full(count, radius), np.full(count, -1))
    return trunks.clear_of(np.array([SOURCE[:2], TAIL_RECEIVER[:2]]))


def tail(rate=4e3, **changes):
    reverb = Reverb(**(SETTINGS | {"sample_rate": rate} | changes))
    losses = Losses.of(reverb, AIR, TrunkStand(0.1, (0.15,)), SOURCE, TAIL_RECEIVER)
    return tail_of(reverb, losses, Density.even(0.1), SOURCE, TAIL_RECEIVER, 0.6, (1, "test"), 1500)


def test_noise_has_the_energy_of_transport():
    """In an octave, over 0.15 to 0.4 s, mean of 12 draws: 500 degrees of freedom each, within 12 %."""
    made = tail(multiple_share=1.0, path_ground=False, turbulence=0.0)
    count, step = int(0.6 * 4e3), 343.0 / 4e3
    found = np.zeros(count)
    for number in range(12):
        found += octave(made.samples(4e3, count, AIR, stream(number, "draw")), 4e3, 500.0) ** 2 / 12
    rows = np.arange(int(0.15 * 4e3), int(0.4 * 4e3))
    _, again = made.energies(rows * step)
    band = int(np.flatnonzero(made.band == 500.0)[0])
    lost = np.exp(-2.0 * made.losses.along(made.band[[band]]) * rows * step)
    share = 500.0 / 2000.0 * math.log(2.0)  # of white noise, by the octave's power gain
    assert found[rows].sum() == pytest.approx((again[band] * lost * step * share).sum(), rel=0.15)


@pytest.mark.medium
def test_the_standard_error_is_the_spread_between_keys():
    """Of the level from the joint on, 12 keys: within a factor of 2 in octaves that it knows within 1 dB.

    Where a few packets bear all of it, as in low octaves, it is told too small.
    """
    reverb = Reverb(**SETTINGS)
    losses = Losses.of(
        reverb, AIR, TrunkStand(0.1, (0.15,), 0.2, 12.0, TWIGS), SOURCE, TAIL_RECEIVER
    )
    given = reverb, losses, Density.even(0.1), SOURCE, TAIL_RECEIVER, 0.6
    drawn = [tail_of(*given, (key, "spread"), 1200) for key in range(12)]
    joint = np.median([each.joint for each in drawn])
    length, width = drawn[0].energy[0].middle, np.diff(drawn[0].energy[0].edges)
    late = [(each.heard(length)[1] * width)[:, length >= joint].sum(axis=1) for each in drawn]
    told = np.median([each.spread for each in drawn], axis=0)
    known = told < 1.0
    assert known.sum() >= 3, told
    between = (10 * np.log10(np.array(late)[:, known])).std(axis=0, ddof=1)
    assert (np.abs(np.log2(told[known] / between)) < 1.0).all(), (told, between)


def test_nothing_comes_before_the_direct_sound():
    samples = tail().samples(4e3, 2000, AIR, stream(1, "draw"))
    assert not samples[: int(10.0 / 343.0 * 4e3)].any()
    assert samples.any()


@pytest.mark.parametrize("share", [0.02, 0.9, 1.0])
def test_energy_does_not_jump_at_the_joint(share):
    """Noise and what is left of the trunks' sum have transport's energy, whenever the joint comes."""
    made = tail(multiple_share=share)
    length = np.geomspace(12.0, 190.0, 40)
    once, again = made.energies(length)
    kept = made.kept(length) ** 2 * once * np.exp(made.lift[:, None] * length)
    noise = np.maximum(once + again - kept, 0.0)
    np.testing.assert_allclose(noise + kept, once + again, rtol=1e-9)
    assert math.isinf(made.joint) == (share == 1.0)


@pytest.mark.parametrize("changes", [{}, {"turbulence": 0.0}, {"multiple_share": 0.5}])
def test_what_noise_replaces_is_bounded_in_every_octave(changes):
    """Summed anew, band by band and at every length from the joint on, over a grid of its own."""
    made = tail(**changes)
    share = changes.get("multiple_share", 0.9)
    last = made.energy[0].edges[-1]
    length = np.geomspace(10.001, last, 4000)
    once, several = made.heard(length)
    width = np.gradient(length)
    to_come = np.cumsum((once * width)[:, ::-1], axis=1)[:, ::-1]
    all_to_come = np.cumsum(((once + several) * width)[:, ::-1], axis=1)[:, ::-1]
    after = length >= 1.1 * made.joint  # a bin of the rule
    assert after.any()
    direct = made.losses.unthinned.mean_square(made.band, np.array(10.0)) / 100.0
    direct *= np.exp(-10 * (2 * made.losses.along(made.band) + made.losses.removed(made.band)))
    whole = direct + all_to_come[:, 0]
    over = to_come > 1.2 * np.maximum((1 - share) * all_to_come, 1e-4 * whole[:, None])
    assert not over[:, after].any()
    assert over[:, length < made.joint / 1.2].any()  # nor does it come later than it must


@pytest.mark.medium
def test_trunks_after_the_joint_are_not_summed():
    """Trunks stand on beyond the joint, and are heard there where all of them are summed."""
    trunks = stand_of(9000, 150.0)
    given = SETTINGS | {"duration": 1.0}
    found = impulse_response(trunks, Reverb(**given), AIR)
    assert found.joint < 0.7
    late = int(1.3 * found.joint * 4e3)
    np.testing.assert_allclose(found.trees[late:], found.tail[late:], atol=1e-12)
    whole = impulse_response(trunks, Reverb(**(given | {"multiple_share": 1.0})), AIR)
    assert np.abs(whole.trees - whole.tail)[late : late + 400].max() > 1e-6


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_few_trunks_have_no_tail(count):
    trunks = Trunks(
        np.array([[0.0, 6.0], [4.0, -9.0]])[:count], np.full(count, 0.2), np.arange(count)
    )
    found = impulse_response(trunks, Reverb(**SETTINGS, duration=0.1), AIR)
    assert found.tail is None
    assert np.isfinite(found.samples).all()
    assert found.trees.any() == (count > 0)


def test_an_opaque_stand():
    """More than 4 trunks a square metre: finite, and quiet soon."""
    trunks = stand_of(900, 7.5, 0.1)
    found = impulse_response(trunks, Reverb(**SETTINGS, duration=0.2), AIR)
    assert np.isfinite(found.samples).all()
    assert found.samples.any()


@pytest.mark.medium
def test_the_same_seed_gives_the_same_noise_and_channels_their_own():
    trunks = stand_of(60, 15.0)
    reverb = Reverb(**SETTINGS, duration=0.1, array=2)
    one, two = (impulse_response(trunks, reverb, AIR, key=(seed, "a")) for seed in (3, 3))
    np.testing.assert_array_equal(one.samples, two.samples)
    assert np.abs(one.tail - one.further[0].tail).max() > 0.5 * np.abs(one.tail).max()
    other = impulse_response(trunks, replace(reverb, array=1), AIR, key=(4, "a"))
    assert not np.array_equal(other.tail, one.tail)


def test_a_scene_of_before_is_as_it_was():
    """Without a model, no loss, no noise: K's weights."""
    trunks = stand_of(60, 15.0)
    plain = {key: value for key, value in SETTINGS.items() if key != "model"}
    found = impulse_response(trunks, Reverb(**plain, duration=0.1), AIR)
    assert found.tail is None
    again = impulse_response(
        trunks, Reverb(**plain, duration=0.1, bark=0.5, turbulence=9.0, trunk_height=3.0), AIR
    )
    np.testing.assert_array_equal(found.samples, again.samples)


# --------------------------------------------------------------------------------------------- layer
# Transport in space in the layer of a forest: closed forms, another Monte Carlo, waves among points.

ALL_WAYS = np.full(WAYS, 0.25 / math.pi)
HARD = np.array([np.inf + 0j])


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
    found = diffused(layer, *ends, edges, 60_000, np.random.default_rng(1)).mean(0)[0]
    fine = np.linspace(0, 1, 50)[:, None] * np.diff(edges) + edges[:-1]
    apart = 10 * np.log10(found / paasschens(10.0, fine, 10.0).mean(axis=0))
    assert np.median(np.abs(apart)) < 0.5
    assert np.abs(apart).max() < 3.0  # a packet or two that turned next to the receiver
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
    solid = -2 * math.pi * np.diff(np.cos(np.linspace(0, math.pi, WAYS + 1)))
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
    bare = replace(layer, scatters=(even(1e-4, 8),))
    levels = [
        diffused(each, *ends, edges, 3000, stream(1, "test")).mean(0)[0].sum()
        for each in (layer, replace(layer, back=0.8), bare, replace(bare, rough=0.3))
    ]
    assert levels[1] > 1.1 * levels[0]
    assert levels[3] > 2.0 * levels[2]
