"""Scatterers by blocks of instances against all leaves laid out in the world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references.echo_scenes import scene_of, square_leaves

from forest_addon.acoustics.disc import MODELS
from forest_addon.sensing.sonar.leaves import BETWEEN, VIEWS
from forest_addon.sensing.sonar.ping import leaf_discs, ping
from forest_addon.sensing.sonar.scatterers import Sight, cluster
from forest_addon.sensing.sonar.station import Equipment, SonarPose, Station, posed
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Sonar

AIR = Air(sound_speed=340.0)


def turn(seed: int) -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


LINEAR = {
    "turned": turn(1),
    "larger": 1.7 * turn(2),
    "smaller": 0.3 * turn(3),
    "mirrored": np.diag([-1.0, 1.0, 1.0]) @ turn(4),
    "squeezed": np.diag([1.0, 0.2, 2.0]) @ turn(5),
    "sheared": np.array([[1.0, 0.5, 0.2], [0.0, 0.3, -1.0], [0.7, 0.0, 2.0]]),
    "flattened": np.diag([1.0, 1.0, 0.0]),
    "gone": np.zeros((3, 3)),
}


def crown(count: int = 1500, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 1.0, (count, 3))


def grove(count: int = 1500) -> EchoTargets:
    """One tree, eight times: turned, scaled, mirrored, squeezed, sheared, flattened, shrunk to a point."""
    rng = np.random.default_rng(9)
    mesh = square_leaves(crown(count), rng.normal(size=(count, 3)), 0.05)
    shifts = np.array(
        [[4, 0, 2], [5, 3, 2], [3, -2, 2], [7, 1, 3], [4, 4, 1], [6, -3, 2], [2, 1, 3], [3, 3, 3]]
    )
    placed = [np.column_stack([m, s]) for m, s in zip(LINEAR.values(), shifts, strict=True)]
    return EchoTargets(scene_of(mesh, *placed))


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_blocks_find_what_all_leaves_sum_up_to(model: str) -> None:
    targets = grove()
    discs = leaf_discs(targets.scene)
    for width in (10.0, 40.0):
        sonar = Sonar(
            leaf_model=model, beam_width_deg=(width, width), cull=0.0, shading="none", wood=False
        )
        ours, all_of_them = ping(targets, sonar, AIR), ping(discs, sonar, AIR)
        scale = all_of_them.heard.amplitude.sum()
        assert len(ours.heard) == len(all_of_them.heard)
        error = np.abs(ours.spectrum - all_of_them.spectrum).max()
        assert error < (1e-4 if model == "exact" else 1e-6) * scale
        assert ours.leaves == len(discs)


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("cull", [1e-3, 0.05])
def test_what_is_left_out_is_within_the_bound(model: str, cull: float) -> None:
    targets = grove()
    sonar = Sonar(leaf_model=model, cull=cull, shading="none")
    part, whole = ping(targets, sonar, AIR), ping(targets, replace(sonar, cull=0.0), AIR)
    assert len(part.heard) < len(whole.heard)
    assert 0 < part.cull_bound <= cull
    promised = part.cull_bound * part.heard.amplitude.sum()
    assert whole.heard.amplitude.sum() - part.heard.amplitude.sum() <= promised
    assert np.abs(whole.spectrum[:: len(whole.spectrum) - 1]).all()


@pytest.mark.medium
@pytest.mark.parametrize("model", MODELS)
def test_no_block_is_louder_than_its_ceiling(model: str) -> None:
    """Whatever the transform and wherever the sonar, from within a crown to far off."""
    targets = grove(600)
    sonar = Sonar(leaf_model=model, wood=False, beam="omni", ears=2, ear_spacing=0.1)
    rng = np.random.default_rng(3)
    for point in rng.uniform([-2, -4, 0], [9, 5, 5], (6, 3)):
        pose = SonarPose(point, posed(sonar).frame, np.zeros(3))
        station = Station(sonar, AIR, pose, Equipment.of(sonar))
        lowest, highest = station.wavenumbers
        blocks, _ = targets.candidates(sonar, point, lowest, highest)
        ceiling = station.ceiling(blocks)
        sight = Sight(point, highest, sonar.max_range, sonar.near_limit)
        for row in range(len(blocks)):
            one = blocks.select(np.array([row]))
            total = 0.0
            for made, _, _ in targets.scatterers(sonar, one, sight):
                distance = np.linalg.norm(made.centre - point, axis=1)
                made = made.select((distance > sonar.near_limit) & (distance < sonar.max_range))
                size = made.seen(point).bound(lowest, highest)
                total += float((station.paths(made.centre).bound(station) * size).sum())
            assert total <= ceiling[row] * (1 + 1e-9)


def test_views_leave_no_direction_alone() -> None:
    way = np.random.default_rng(0).normal(size=(50_000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    assert np.arccos(np.abs(way @ VIEWS.T).max(axis=1)).max() < BETWEEN


def test_leaves_of_trees_out_of_range_are_counted_not_moved() -> None:
    rng = np.random.default_rng(1)
    mesh = square_leaves(crown(500), rng.normal(size=(500, 3)), 0.05)
    placed = [np.column_stack([np.eye(3), [x, 0, 2]]) for x in (5.0, 40.0, 200.0)]
    echo = ping(EchoTargets(scene_of(mesh, *placed)), Sonar(cull=0.0), AIR)
    assert echo.far == 1000
    assert set(echo.heard.tree) == {3}


@pytest.mark.parametrize("count", [0, 1, 95, 96, 97, 5000])
def test_blocks_hold_every_point_once(count: int) -> None:
    points = np.random.default_rng(2).normal(size=(count, 3))
    extent = np.full(count, 0.1)
    blocks = cluster(points, extent)
    np.testing.assert_array_equal(np.sort(blocks.order), np.arange(count))
    for block in range(len(blocks)):
        rows = blocks.order[blocks.first[block] : blocks.first[block + 1]]
        away = np.linalg.norm(points[rows] - blocks.centre[block], axis=1) + 0.1
        assert (away <= blocks.radius[block] * (1 + 1e-12)).all()


def test_identical_points_make_blocks_too() -> None:
    blocks = cluster(np.zeros((1000, 3)), np.zeros(1000))
    assert blocks.count.sum() == 1000


def test_broken_leaves_do_not_open_the_forest() -> None:
    """One vertex that is not a number: its leaf is counted, the others are found as before."""
    rng = np.random.default_rng(1)
    mesh = square_leaves(crown(400) + np.array([5.0, 0, 2]), rng.normal(size=(400, 3)), 0.05)
    sonar = Sonar(cull=0.0, shading="none")
    whole = ping(EchoTargets(scene_of(mesh)), sonar, AIR)
    vertices = mesh.vertices.copy()
    vertices[0] = np.nan
    broken = ping(EchoTargets(scene_of(replace(mesh, vertices=vertices))), sonar, AIR)
    assert broken.broken == 1
    assert set(whole.heard.number) - set(broken.heard.number) == {0}
    assert np.isfinite(broken.impulse_response).all()
