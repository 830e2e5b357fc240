"""Stretches in which no part steps, held against rays that are taken to each part at their own time."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.formats.helios.parts import MotionSequence, MotionStep, PartMotion
from forest_addon.sensing.lidar.surveys.held import HeldCaster, stretch_of
from forest_addon.sensing.lidar.surveys.stepped import SteppedMotion, SteppedPath
from forest_addon.sensing.rays.exact import ExactCaster
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.rays.moving import MovingCaster

RATE = 1000.0
PLATE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.2], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.4]])


def two_that_step() -> tuple[SceneGeometry, SteppedMotion]:
    """A plate that stands, one that turns every 60 pulses and one that goes every 40."""
    mesh = TriMesh.of_part(PLATE, np.array([[0, 1, 2], [0, 2, 3]]), OTHER)
    transform = np.tile(np.eye(4)[:3], (3, 1, 1))
    transform[:, :, 3] = [[0.0, 0.0, -2.0], [1.5, 0.0, 0.0], [-1.5, 0.0, 0.0]]
    none = np.full(3, -1, dtype=np.int64)
    scene = SceneGeometry(
        (mesh,), transform, np.zeros(3, dtype=np.int64), ("a", "b", "c"), none, none.copy()
    )
    turn = Rotation.from_euler("xyz", [9, 5, 20], degrees=True).as_matrix()
    steps = {
        1: (MotionStep(turn, np.eye(3), np.zeros(3)), 60),
        2: (MotionStep(np.eye(3), np.eye(3), np.array([0.05, 0.1, 0.02])), 40),
    }
    paths = {
        part: SteppedPath(
            transform[part],
            transform[part, :, 3],
            PartMotion((MotionSequence("m", step, 0, ""),), every),
            RATE,
            (30, 600),
        )
        for part, (step, every) in steps.items()
    }
    return scene, SteppedMotion(paths)


def test_stretches_meet_what_each_ray_meets_at_its_own_time() -> None:
    scene, motion = two_that_step()
    assert stretch_of(motion) == 20
    rng = np.random.default_rng(8)
    count = 600
    time = (rng.permutation(count) + 1) / RATE
    origin = rng.uniform([-3, -1.5, 3], [3, 1.5, 4], (count, 3))
    way = rng.normal([0, 0, -3], 0.4, (count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    held, own = HeldCaster(scene, motion, ExactCaster), MovingCaster(scene, motion, ExactCaster)
    one, other = (caster.cast(origin, way, 20.0, time=time) for caster in (held, own))
    assert set(other.instance.tolist()) == {-1, 0, 1, 2}
    np.testing.assert_array_equal(one.instance, other.instance)
    np.testing.assert_array_equal(one.triangle, other.triangle)
    np.testing.assert_allclose(one.distance, other.distance, atol=1e-9)
    np.testing.assert_allclose(held.normals(one, time), own.normals(other, time), atol=1e-9)
    met = np.flatnonzero(one.found)
    points = origin[met] + one.distance[met, None] * way[met]
    asked = points, one.instance[met], one.triangle[met], time[met]
    for mine, theirs in zip(held.velocities(*asked), own.velocities(*asked), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-9)
    behind = one.select(met)
    again, true = (
        caster.cast(
            origin[met],
            way[met],
            20.0,
            time=time[met],
            min_distance=behind.distance,
            leaving=behind,
        )
        for caster in (held, own)
    )
    np.testing.assert_array_equal(again.instance, true.instance)
    np.testing.assert_allclose(again.distance, true.distance, atol=1e-9)


def test_a_scan_of_stretches_may_be_cut_anywhere() -> None:
    scene, motion = two_that_step()
    caster = HeldCaster(scene, motion, ExactCaster)
    time = np.arange(1, 201) / RATE
    origin = np.tile([1.2, 0.1, 4.0], (200, 1))
    way = np.tile([0.0, 0.0, -1.0], (200, 1))
    whole = caster.cast(origin, way, time=time)
    for rows in (slice(0, 77), slice(77, 200)):
        part = caster.cast(origin[rows], way[rows], time=time[rows])
        np.testing.assert_array_equal(part.distance, whole.distance[rows])
    assert len(np.unique(whole.distance)) > 2
