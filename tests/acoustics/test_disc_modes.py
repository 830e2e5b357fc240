"""Discs as sums of modes of a band, against the models themselves and the disc's own equations."""

from __future__ import annotations

import numpy as np
import pytest

from forest_addon.acoustics import chebyshev
from forest_addon.acoustics.disc import backscatter_amplitude
from forest_addon.acoustics.disc_exact import HardDisc
from forest_addon.acoustics.modes.disc_modes import DiscModes, has_rows, modes_of, phase_for

ENDS = (900.0, 1300.0)
LARGEST = 0.022  # one block of radii, so that little is made


def random_discs(count: int, smallest: float = 0.0187) -> tuple[np.ndarray, np.ndarray]:
    """Radii and incidences, a quarter of them near the normal, some at its and at grazing's end."""
    rng = np.random.default_rng(4)
    radius = rng.uniform(smallest, LARGEST, count)
    incidence = np.arccos(rng.uniform(0, 1, count))
    incidence[: count // 4] = rng.uniform(0, 0.1, count // 4)
    incidence[:4] = [0.0, 1e-9, np.pi / 2, np.pi / 2 - 1e-9]
    return radius, incidence


@pytest.mark.parametrize("model", ["exact", "paper"])
@pytest.mark.parametrize("error", [4e-4, 4e-5])
def test_no_value_is_farther_off_than_is_said(model: str, error: float) -> None:
    wavenumber = np.linspace(*ENDS, 23)
    radius, incidence = random_discs(600)
    assert has_rows(radius, ENDS[1]).all()
    table = modes_of(model, ENDS, phase_for(error), LARGEST)
    found = table.amplitude(wavenumber, radius, incidence)
    size = wavenumber[:, None] * radius
    known = backscatter_amplitude(size, incidence, model) / wavenumber[:, None]
    off = np.abs(found - known).max(axis=0)
    bound = table.errors(radius, incidence)
    assert (off <= bound).all()
    assert off.max() > 0.01 * bound.max()  # it is not the model that was asked
    largest = np.abs(known).max(axis=0)
    assert bound.sum() < 4.0 * error * largest.sum()
    turned = table.amplitude(wavenumber, radius[::-1], incidence[::-1])
    np.testing.assert_array_equal(turned[:, ::-1], found)


@pytest.mark.parametrize("model", ["exact", "paper"])
def test_fewer_modes_leave_out_no_more_than_is_said(model: str) -> None:
    wavenumber = np.linspace(*ENDS, 23)
    radius, incidence = random_discs(400)
    table = modes_of(model, ENDS, phase_for(4e-4), LARGEST)
    places = table.places(radius, incidence)
    size = wavenumber[:, None] * radius[places.order]
    known = backscatter_amplitude(size, incidence[places.order], model) / wavenumber[:, None]
    before = np.inf
    for number, rank in enumerate(table.ranks):
        found = (table.shares(places, rank) @ table.at(wavenumber, rank)).T
        off = float(np.abs(found - known).max(axis=0).sum())
        left, missed = table.left_out(places, np.ones(len(radius)))
        assert off <= left[number] + missed
        assert off <= 1.3 * before  # about as many as are needed, the loudest first
        before = off
    assert before < 1e-3 * np.abs(known).max(axis=0).sum()


@pytest.mark.parametrize("model", ["exact", "paper"])
def test_how_loud_a_disc_is_at_least(model: str) -> None:
    wavenumber = np.linspace(*ENDS, 161)
    radius, incidence = random_discs(600)
    table = modes_of(model, ENDS, phase_for(4e-4), LARGEST)
    places = table.places(radius, incidence)
    size = wavenumber[:, None] * radius[places.order]
    known = np.abs(backscatter_amplitude(size, incidence[places.order], model))
    largest = (known / wavenumber[:, None]).max(axis=0)
    told = table.loudest(places).max(axis=1)
    assert told.sum() <= largest.sum()
    assert told.sum() > 0.7 * largest.sum()
    assert (told <= largest).all()


def test_modes_are_orthonormal_and_do_not_depend_on_what_came_before() -> None:
    radius, incidence = random_discs(200, 0.014)
    one, other = (DiscModes("exact", ENDS, phase_for(4e-4), LARGEST) for _ in range(2))
    np.testing.assert_allclose(
        np.conj(one.modes.T) @ one.modes, np.eye(one.modes.shape[1]), atol=1e-9
    )
    small = np.flatnonzero(radius < 0.018)
    other.places(radius[small], incidence[small])  # makes those rows first
    for table in (one, other):
        table.places(radius, incidence)
    found = [table.amplitude(np.linspace(*ENDS, 5), radius, incidence) for table in (one, other)]
    np.testing.assert_array_equal(*found)


def test_against_the_equations_of_the_disc() -> None:
    disc, radius = HardDisc(20.0), 0.02
    incidence = np.array([0.0, 0.3, 1.0, 1.5])
    ends = (850.0, 1050.0)
    table = modes_of("exact", ends, phase_for(1e-5), 0.02)
    found = table.amplitude(np.array([20.0 / radius]), np.full(4, radius), incidence)[0]
    np.testing.assert_allclose(
        found, disc.backscatter(incidence) * radius / 20.0, atol=2e-4 * radius
    )


def test_modes_between_the_points_of_the_band() -> None:
    table = modes_of("paper", ENDS, phase_for(4e-4), LARGEST)
    middle, half = sum(ENDS) / 2, (ENDS[1] - ENDS[0]) / 2
    at = table.at(middle + half * chebyshev.points(table.count), 3)
    np.testing.assert_allclose(at, table.modes[:, :3].T, atol=1e-9)


def test_what_is_too_small_or_too_large_has_no_rows() -> None:
    assert has_rows(np.array([1e-6, 0.003, 0.02, 0.06, 0.2]), 1480.0).tolist() == [
        False,
        False,
        True,
        True,
        False,
    ]
