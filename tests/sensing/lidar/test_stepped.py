"""Parts that move by steps, as rays meet them, held against the still scene of each pulse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.formats.helios.motion import STILL, PartMotion
from forest_addon.sensing.lidar.surveys.stepped import SteppedPath
from forest_addon.sensing.moving import MovingScene
from forest_addon.sensing.moving_rays import MovingCaster
from forest_addon.sensing.rays.caster import hit_normals
from forest_addon.sensing.rays.exact import ExactCaster, cast_exactly
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.rays.paths import SceneMotion

RATE = 1000.0
PLATE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.2], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.4]])


def two_that_step() -> tuple[SceneGeometry, SceneMotion]:
    """A plate that stands, one that turns every 60 pulses and one that goes every 40."""
    mesh = TriMesh.of_part(PLATE, np.array([[0, 1, 2], [0, 2, 3]]), OTHER)
    transform = np.tile(np.eye(4)[:3], (3, 1, 1))
    transform[:, :, 3] = [[0.0, 0.0, -2.0], [1.5, 0.0, 0.0], [-1.5, 0.0, 0.0]]
    none = np.full(3, -1, dtype=np.int64)
    scene = SceneGeometry(
        (mesh,), transform, np.zeros(3, dtype=np.int64), ("a", "b", "c"), none, none.copy()
    )
    turn = Rotation.from_euler("xyz", [9, 5, 20], degrees=True).as_matrix()
    turns, goes = STILL.copy(), STILL.copy()
    turns[0, :3, :3], goes[1, :3, 3] = turn, [0.05, 0.1, 0.02]
    steps = {1: (turns, 60), 2: (goes, 40)}
    paths = {
        part: SteppedPath(
            transform[part],
            transform[part, :, 3],
            PartMotion((step,), (0,), 1, every),
            RATE,
            (30, 600),
        )
        for part, (step, every) in steps.items()
    }
    return scene, SceneMotion(paths)


def test_rays_meet_parts_where_their_steps_have_taken_them() -> None:
    """Against the still scene of each pulse."""
    scene, motion = two_that_step()
    rng = np.random.default_rng(8)
    count = 600
    time = (rng.permutation(count) + 1) / RATE
    origin = rng.uniform([-3, -1.5, 3], [3, 1.5, 4], (count, 3))
    way = rng.normal([0, 0, -3], 0.4, (count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    moving = MovingScene(scene, motion)
    found = MovingCaster(moving, ExactCaster).cast(origin, way, 20.0, time=time)
    assert set(found.instance.tolist()) == {-1, 0, 1, 2}
    normals = moving.normals(found, time)
    for row in range(0, count, 3):
        places = scene.transform.copy()
        for part, path in motion.paths.items():
            places[part] = path.at(time[[row]])[0]
        still = replace(scene, transform=places)
        one = cast_exactly(still, origin[[row]], way[[row]])
        assert one.instance[0] == found.instance[row] or one.distance[0] > 20.0
        if found.found[row]:
            assert one.triangle[0] == found.triangle[row]
            assert abs(one.distance[0] - found.distance[row]) < 1e-9
            np.testing.assert_allclose(hit_normals(still, one)[0], normals[row], atol=1e-9)
    met = np.flatnonzero(found.instance == 2)
    points = origin[met] + found.distance[met, None] * way[met]
    asked = points, found.instance[met], found.triangle[met], time[met]
    velocity, rest = moving.velocities(*asked)
    np.testing.assert_allclose(velocity, np.tile([0.05, 0.1, 0.02], (len(met), 1)) * RATE / 40)
    went = motion.paths[2].at(time[met])[:, :, 3] - scene.transform[2, :, 3]
    np.testing.assert_allclose(points - went, rest, atol=1e-9)
