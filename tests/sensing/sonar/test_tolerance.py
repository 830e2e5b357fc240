"""The bound on the fast sum: for equal leaves, all errors add up; against the direct sum."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from references.echo_scenes import scene_of
from references.leaf_discs import discs_of

from forest_addon.acoustics.disc import MODELS
from forest_addon.acoustics.disc_exact import HardDisc
from forest_addon.acoustics.disc_table import LAST, table_error, tabulated
from forest_addon.base.trimesh import OTHER, WOOD, TriMesh, join
from forest_addon.sensing.sonar.bands import Band
from forest_addon.sensing.sonar.ping import LeafDiscs, heard_from, ping
from forest_addon.sensing.sonar.poses import posed
from forest_addon.sensing.sonar.station import Equipment, Station
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Sonar

AIR = Air()
QUIET = {"cull": 0.0, "shading": "none", "near_limit": 1e-3}


def equal_leaves(count: int, distance: float, incidence: float, radius: float) -> LeafDiscs:
    """All at one place, so that nothing averages out."""
    normal = [math.cos(incidence), math.sin(incidence), 0.0]
    return discs_of(np.tile([distance, 0, 2.0], (count, 1)), normal, radius)


def largest(discs: LeafDiscs, sonar: Sonar) -> float:
    """Σ max|A| over the band of all pieces, at a few frequencies."""
    station, band = Station(sonar, AIR, posed(sonar), Equipment.of(sonar)), Band(*sonar.band)
    frequency = np.linspace(*sonar.band, 33)
    wavenumber = 2 * np.pi * frequency / station.sound_speed
    return sum(
        float(
            (
                np.abs(group.seen(station, 0).amplitude(wavenumber))
                * group.gain(station, 0, frequency)
            )
            .max(axis=0)
            .sum()
        )
        for group in heard_from(station, EchoTargets.of_discs(discs), band, None, None).groups
    )


def check(discs: LeafDiscs, one: LeafDiscs, count: int, sonar: Sonar) -> None:
    """The error of the fast sum is below its bound, and this below the tolerance where it can be."""
    exact = ping(one, replace(sonar, tolerance=0.0), AIR)
    fast = ping(discs, sonar, AIR)
    # No more than Σ max|A|, which a near leaf's pieces have more of than they add up to.
    size = count * max(np.abs(exact.spectra).max(), largest(one, sonar))
    error = np.abs(fast.spectra - count * exact.spectra).max()
    assert error <= fast.error_bound * size * (1 + 1e-9)
    if sonar.leaf_model != "exact":
        assert fast.error_bound <= sonar.tolerance
    assert fast.table_error == pytest.approx(exact.table_error, rel=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
@settings(max_examples=6)
@given(
    radius=st.floats(0.003, 0.12),
    incidence=st.one_of(st.floats(0.0, math.pi / 2 - 1e-3), st.floats(0.0, 0.02)),
    low=st.floats(20e3, 70e3),
    width=st.sampled_from([200.0, 1e3, 5e3, 20e3, 60e3]),
    distance=st.floats(4.0, 12.0),
    absorption=st.booleans(),
    digits=st.integers(2, 9),
)
@example(0.0915, 0.00796, 30e3, 30e3, 3.4, False, 6)
def test_equal_leaves(model, radius, incidence, low, width, distance, absorption, digits) -> None:
    sonar = Sonar(
        band=(low, low + width),
        leaf_model=model,
        absorption=absorption,
        tolerance=10.0**-digits,
        **QUIET,
    )
    leaves = equal_leaves(150, distance, incidence, radius)
    check(leaves, equal_leaves(1, distance, incidence, radius), 150, sonar)


@pytest.mark.medium
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("order", [1, 2, 5])
def test_nulls_of_the_pattern_in_a_narrow_band(model: str, order: int) -> None:
    """The band's middle is where J₁ vanishes: all that is left is what changes over the band."""
    zero = [3.8317059702075125, 7.015586669815619, 0, 0, 16.470630050877634][order - 1]
    radius, middle = 0.03, 70e3
    incidence = math.asin(zero / (4 * math.pi * middle / AIR.speed() * radius))
    for width, digits in ((500.0, 5), (2e3, 7), (8e3, 6)):
        sonar = Sonar(
            band=(middle - width / 2, middle + width / 2),
            leaf_model=model,
            tolerance=10.0**-digits,
            **QUIET,
        )
        leaves = equal_leaves(500, 5.0, incidence, radius)
        check(leaves, equal_leaves(1, 5.0, incidence, radius), 500, sonar)


@pytest.mark.medium
@pytest.mark.parametrize("beam", ["omni", "horseshoe"])
@pytest.mark.parametrize("model", MODELS)
def test_spread_leaves_at_one_distance(model: str, beam: str) -> None:
    rng = np.random.default_rng(8)
    way = rng.normal(size=(800, 3)) * [0.2, 0.2, 0.2] + [1, 0, 0]
    way *= 5.0 / np.linalg.norm(way, axis=1, keepdims=True)
    discs = discs_of(
        way + np.array([0, 0, 2]), rng.normal(size=(800, 3)), rng.uniform(0.003, 0.06, 800)
    )
    exact = ping(discs, Sonar(leaf_model=model, beam=beam, tolerance=0.0, **QUIET), AIR)
    size = float(exact.heard.amplitude.sum())  # no larger than Σ max|A|
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-9):
        fast = ping(discs, Sonar(leaf_model=model, beam=beam, tolerance=tolerance, **QUIET), AIR)
        error = np.abs(fast.spectra - exact.spectra).max()
        assert error <= fast.error_bound * 3 * size
        if model != "exact":
            assert fast.error_bound <= tolerance
        else:
            assert fast.error_bound <= max(tolerance, 1e-2)
            assert 0 < fast.table_error < 1e-3


@pytest.mark.slow
def test_wood_and_facets() -> None:
    """A pole and a board, many times at one place."""
    turn = np.linspace(0, 2 * np.pi, 13)[:-1]
    ring = 0.03 * np.stack([np.cos(turn), np.sin(turn), np.zeros(12)], axis=1)
    rings = np.concatenate([ring + np.array([4, 0, z]) for z in np.linspace(1.2, 2.8, 9)])
    first = np.arange(12)
    quads = np.stack([first, (first + 1) % 12, 12 + (first + 1) % 12, 12 + first], axis=1)
    quads = (quads + 12 * np.arange(8)[:, None, None]).reshape(-1, 4)
    pole = TriMesh.of_part(rings, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]), WOOD)
    corners = np.array([(5, -1, 1.0), (5.2, 1, 1.0), (5.2, 1, 3), (5, -1, 3)])
    board = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), OTHER)
    mesh = join([pole, board])
    one, many = EchoTargets(scene_of(mesh)), EchoTargets(scene_of(mesh, *[np.eye(3, 4)] * 30))
    for kinds in ({"wood": False}, {"facets": False}, {}):
        for digits in (2, 4, 6, 9):
            sonar = Sonar(tolerance=10.0**-digits, **QUIET, **kinds)
            exact = ping(one, replace(sonar, tolerance=0.0), AIR)
            fast = ping(many, sonar, AIR)
            size = 90 * float(exact.heard.amplitude.sum())  # a Hann mean is a third of the largest
            assert np.abs(fast.spectra - 30 * exact.spectra).max() <= fast.error_bound * size
            # The cylinders' table is smooth to 1e-7 of the largest, and says so.
            assert fast.error_bound <= max(sonar.tolerance, 1e-6 if "wood" not in kinds else 0.0)


def test_error_of_the_table_is_bounded() -> None:
    rng = np.random.default_rng(2)
    for ka in [*np.exp(rng.uniform(np.log(0.01), np.log(LAST), 25)), 0.99 * LAST]:
        angle = np.concatenate(
            [rng.uniform(0, np.pi / 2, 300), rng.uniform(0, min(1.5, 9 / ka), 99)]
        )
        off = np.abs(HardDisc(float(ka)).backscatter(angle) - tabulated(np.full(399, ka), angle))
        assert (off / ka <= table_error(np.full(399, ka), angle)).all()


@pytest.mark.parametrize("incidence", [0.05, 0.9, 1.55])
def test_exact_leaves_looked_up_for_a_band_keep_the_tolerance(incidence: float) -> None:
    """At grazing the looked up rows are too rough for so faint leaves, and are not used."""
    sonar = Sonar(band=(40e3, 80e3), leaf_model="exact", tolerance=1e-3, beam="omni", **QUIET)
    count = 400
    leaves, one = (equal_leaves(n, 4.0, incidence, 0.02) for n in (count, 1))
    exact = ping(one, replace(sonar, tolerance=0.0), AIR)
    fast = ping(leaves, sonar, AIR)
    error = np.abs(fast.spectra - count * exact.spectra).max()
    assert 1e-12 < error / (count * np.abs(exact.spectra).max()) <= fast.error_bound <= 1e-3
