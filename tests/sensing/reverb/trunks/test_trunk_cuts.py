"""Trunks at the height where the sound passes them: cones, leaning stems, ends above the canopy."""

from __future__ import annotations

import numpy as np
import pytest

from forest_addon.base.trimesh import WOOD, TriMesh
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.reverb.trunks import STEP, TrunkCuts


def cone(height: float, foot: float, lean: float = 0.0, sides: int = 48) -> TriMesh:
    """A stem from z = 0 to a point; its axis leans along x by ``lean`` metres a metre."""
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([foot * np.cos(turn), foot * np.sin(turn), np.zeros(sides)])
    vertices = np.vstack([ring, [[lean * height, 0.0, height]]])
    following = (np.arange(sides) + 1) % sides
    triangles = np.column_stack([np.arange(sides), following, np.full(sides, sides)])
    return TriMesh.of_part(vertices, triangles, WOOD)


def scene(mesh: TriMesh, *places: tuple[float, float]) -> SceneGeometry:
    transform = np.tile(np.eye(3, 4), (len(places), 1, 1))
    transform[:, :2, 3] = places
    number = np.arange(len(places))
    names = tuple(f"tree {n}" for n in number)
    return SceneGeometry((mesh,), transform, np.zeros(len(places), np.int64), names, number, number)


def test_ends_of_one_height_are_one_cut() -> None:
    cuts = TrunkCuts(scene(cone(10.0, 0.4), (3, 1), (7, -1)), 0.0)
    trunks = cuts.between(np.array([0.0, 0, 2.0]), np.array([10.0, 0, 2.2]))
    assert len(trunks) == 2
    np.testing.assert_allclose(trunks.radius, 0.4 * (1 - 2.1 / 10), rtol=2e-3)


def test_each_trunk_is_cut_where_the_path_meets_it() -> None:
    """The path from 1 m up to 9 m over 40 m; a cut is at most half a step off."""
    places = [(x, 0.5) for x in (4, 12, 20, 28, 36)]
    cuts = TrunkCuts(scene(cone(12.0, 0.6, lean=0.1), *places), 0.0)
    source, receiver = np.array([0.0, 0, 1.0]), np.array([40.0, 0, 9.0])
    trunks = cuts.between(source, receiver)
    assert sorted(trunks.tree) == [0, 1, 2, 3, 4]
    for x, radius, tree in zip(trunks.position[:, 0], trunks.radius, trunks.tree, strict=True):
        height = 1.0 + 8.0 * x / 40
        assert abs(radius - 0.6 * (1 - height / 12)) < 0.6 / 12 * STEP / 2 + 2e-3
        assert abs(x - (places[tree][0] + 0.1 * height)) < 0.1 * STEP / 2 + 1e-3


def test_a_receiver_above_the_canopy() -> None:
    """The path passes over trees near the receiver and meets those near the source."""
    cuts = TrunkCuts(scene(cone(10.0, 0.4), (2, 0), (5, 0), (9, 0), (11, 0)), 0.0)
    trunks = cuts.between(np.array([0.0, 0.3, 1.5]), np.array([12.0, 0.3, 25.0]))
    heard = [1.5 + 23.5 * x / 12 < 10 for x in (2, 5, 9, 11)]
    assert sorted(trunks.tree) == list(np.flatnonzero(heard)) == [0]
    assert len(cuts.between(np.array([0.0, 0, 30.0]), np.array([12.0, 0, 40.0]))) == 0


@pytest.mark.parametrize("low", [1.0, 30.0])
def test_there_and_back_are_the_same_trunks(low: float) -> None:
    cuts = TrunkCuts(scene(cone(12.0, 0.6), (4, 1), (12, 2), (20, -3), (20, 0)), 0.0)
    ends = np.array([0.0, 0, low]), np.array([30.0, 5, 6.0])
    there, back = cuts.between(*ends), cuts.between(*ends[::-1])
    for part in ("tree", "radius"):
        np.testing.assert_allclose(sorted(getattr(there, part)), sorted(getattr(back, part)))
