"""Energy of sound scattered again and again: a closed form, balance, stands that are not even."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, trapezoid

from forest_addon.sensing.reverb.forest.transport import (
    ANGLES,
    Density,
    PhaseFunction,
    Turns,
    transported,
)

ANGLE = math.pi * (np.arange(ANGLES) + 0.5) / ANGLES
ALIKE = PhaseFunction(0.4, 1.0, ANGLE, np.full(ANGLES, 0.5 / math.pi))
RECEIVER = np.array([10.0, 0.0])


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


def test_the_closed_form_keeps_all_energy():
    """∫P over the plane and what has not met a trunk yet are 1 (2πP/x·x, over r)."""
    for x in (5.0, 60.0, 400.0):
        r = x * np.sin(np.linspace(0.0, 0.5 * math.pi, 20_001))[1:-1]
        each = np.array([sum(isotropic(v, np.array([x]), 30.0)).item() for v in r[::40]])
        scattered = trapezoid(each * x * r[::40], r[::40])
        assert scattered + math.exp(-x / 30.0) == pytest.approx(1.0, abs=0.02)


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
    drawn = Turns(both).draw(band, np.random.default_rng(1))
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
