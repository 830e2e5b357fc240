"""Echoes between leaves: two leaves in closed form, six by a matrix, shadows, energy, and who is asked."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import j1

from forest_addon.acoustics.disc import backscatter_amplitude
from forest_addon.results.sonar import SONAR
from forest_addon.sensing.sonar.leaves import FAR, LeafDiscs, LeafEchoes
from forest_addon.sensing.sonar.ping import Echo, ping
from forest_addon.sensing.sonar.rescattering import (
    DENSE,
    LEAVES,
    density_of,
    nearest_leaves,
    rescattering,
)
from forest_addon.sensing.sonar.search import SearchGroup
from forest_addon.sensing.sonar.station import Equipment, Station
from forest_addon.spec import Air, Sonar

AIR = Air(sound_speed=340.0)
TONE = Sonar(
    position=(0, 0, 0), band=(40e3, 40e3), beam="omni", absorption=False, shading="none", cull=0.0
)
K = 2 * math.pi * 40e3 / 340.0


def pinged(centre: np.ndarray, normal: np.ndarray, radius: np.ndarray, sonar: Sonar = TONE) -> Echo:
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    number = np.arange(len(radius))
    leaves = LeafDiscs(
        centre, normal, np.asarray(radius, float), 0 * number, number, 0 * number - 1
    )
    return ping(leaves, sonar, AIR)


def solved(centre: np.ndarray, normal: np.ndarray, radius: np.ndarray):
    echo = pinged(centre, normal, radius)
    leaves = SearchGroup.joined([g for g in echo.groups if isinstance(g.scatterers, LeafEchoes)])
    station = Station(TONE, AIR, echo.pose, Equipment.of(TONE))
    return rescattering(leaves, station, pairs=1), leaves


def scattered(normal, radius, k, came: np.ndarray, goes: np.ndarray) -> complex:
    """f of a disc of sound that travels along ``came`` and leaves along ``goes``."""
    change = k * (goes - came)
    along = radius * np.linalg.norm(change - (change @ normal) * normal)
    lobe = 2 * j1(along) / along if along > 1e-9 else 1.0
    one, other = -came @ normal, goes @ normal
    return 0.5j * k * radius**2 * np.sign(one * other) * math.sqrt(abs(one * other)) * lobe


def by_matrix(centre, normal, radius, k: float) -> complex:
    """The echo at the origin, every wave from leaf to leaf an unknown of one dense system."""
    count, far = len(centre), np.linalg.norm(centre, axis=1)
    unit = centre / far[:, None]
    near = (1 + np.maximum((k * radius**2 / (2 * far)) ** 2 - (2 * FAR) ** -2, 0)) ** -0.25
    sent = near * np.exp(-1j * k * far) / far
    pairs = [(i, j) for i in range(count) for j in range(count) if i != j]
    row = {pair: n for n, pair in enumerate(pairs)}

    def way(i, j):
        apart = centre[j] - centre[i]
        r = np.linalg.norm(apart)
        return apart / r, np.exp(-1j * k * r) / (r + 0.5j * k * (radius[i] ** 2 + radius[j] ** 2))

    matrix, right = np.eye(len(pairs), dtype=complex), np.zeros(len(pairs), complex)
    for i, j in pairs:
        towards, _ = way(i, j)
        right[row[i, j]] = scattered(normal[i], radius[i], k, unit[i], towards) * sent[i]
        for m in range(count):
            if m != i:
                came, factor = way(m, i)
                matrix[row[i, j], row[m, i]] -= (
                    scattered(normal[i], radius[i], k, came, towards) * factor
                )
    waves = np.linalg.solve(matrix, right)
    echo = 0j
    for i in range(count):
        echo += scattered(normal[i], radius[i], k, unit[i], -unit[i]) * sent[i] ** 2
        for m in range(count):
            if m != i:
                came, factor = way(m, i)
                back = scattered(normal[i], radius[i], k, came, -unit[i])
                echo += back * factor * waves[row[m, i]] * sent[i]
    return echo


@pytest.mark.parametrize("count", [2, 6])
def test_few_leaves_are_solved_as_by_a_dense_matrix(count):
    rng = np.random.default_rng(count)
    centre = np.array([1.0, 0, 0]) + rng.uniform(-0.1, 0.1, (count, 3))
    normal = rng.normal(size=(count, 3))
    radius = rng.uniform(0.01, 0.04, count)
    found, leaves = solved(centre, normal, radius)
    order = leaves.scatterers
    exact = by_matrix(
        order.centre, order.normal, order.radius, 2 * math.pi * found.frequency[0, 0] / 340
    )
    assert found.every[0, 0] == pytest.approx(exact, rel=1e-3)
    assert abs(found.every[0, 0] - found.once[0, 0]) > 1e-3 * abs(exact)


def test_a_leaf_alone_is_the_piston_and_leaves_far_apart_do_not_meet():
    one = np.array([[1.0, 0.1, 0.0]])
    found, _ = solved(one, np.array([[1.0, 0.3, 0.2]]), np.array([0.005]))
    turn = math.acos(abs((1.0 + 0.03) / math.sqrt(1.01 * 1.13)))
    size = abs(backscatter_amplitude(K * 0.005, turn, "piston")) / K / 1.01
    assert abs(found.every[0, 0]) == pytest.approx(size, rel=1e-3)
    assert found.relative == pytest.approx(0, abs=1e-6)
    rng = np.random.default_rng(3)
    centre = np.array([9.0, 0, 0]) + 4 * rng.normal(size=(12, 3))
    far, _ = solved(centre, rng.normal(size=(12, 3)), np.full(12, 0.005))
    assert far.relative < 2e-3
    assert abs(far.level_db) < 0.02


def test_a_large_leaf_hides_a_small_one_right_behind_it():
    """Sound sent on straight ahead cancels the call: 1 - a²/(a² + b²) is left, each way."""
    centre, normal = np.array([[1.0, 0, 0], [1.02, 0, 0]]), np.array([[1.0, 0, 0]] * 2)
    screen, _ = solved(centre[:1], normal[:1], np.array([0.06]))
    both, _ = solved(centre, normal, np.array([0.06, 0.01]))
    open_, _ = solved(centre[1:], normal[1:], np.array([0.01]))
    behind = abs(both.every[0, 0] - screen.every[0, 0]) / abs(open_.every[0, 0])
    assert behind < 0.3
    assert abs(both.once[0, 0] - screen.once[0, 0]) == pytest.approx(
        abs(open_.every[0, 0]), rel=1e-3
    )


def foliage(density: float, side: float = 0.4, seed: int = 1) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    count = int(density * side**3 / (math.pi * 0.02**2))
    centre = np.array([2.0, 0, 0]) + rng.uniform(-side / 2, side / 2, (count, 3))
    return centre, rng.normal(size=(count, 3)), np.full(count, 0.02)


def test_a_report_warns_of_dense_leaves_and_of_no_others():
    sonar = Sonar(position=(0, 0, 0), shading="none")
    thin, thick = (pinged(*foliage(u), sonar) for u in (2.0, 25.0))
    taken = nearest_leaves(thick.groups)
    assert len(taken) == LEAVES
    assert np.hypot(*taken.paths.offset[:, 0].T).max() < 0.1
    assert density_of(taken) > DENSE
    assert SONAR.doubts(sonar, thin) == ()
    (said,) = SONAR.doubts(sonar, thick)
    assert f"{density_of(taken):.0f} m² a m³" in said
    assert nearest_leaves(pinged(*(part[:3] for part in foliage(1.0))).groups) is None
