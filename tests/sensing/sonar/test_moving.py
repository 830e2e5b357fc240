"""Echoes of objects that move and turn: delay of each ping and Doppler against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references.echo_scenes import scene_of, square_leaves

from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.sensing.moving import MovingScene
from forest_addon.sensing.moving_rays import MovingCaster
from forest_addon.sensing.rays.exact import ExactCaster
from forest_addon.sensing.rays.paths import RigidPath, SceneMotion, ShapePath
from forest_addon.sensing.sonar.ping import fly, ping
from forest_addon.sensing.sonar.station import Equipment, Station, posed
from forest_addon.sensing.sonar.summation import factors
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.sensing.sonar.windy import EchoMotion
from forest_addon.spec import Air, Sonar

C = 340.0
AIR = Air(sound_speed=C)
FAR, SPEED, TURN = 6.0, -2.0, 0.9  # m, m/s away, rad/s
SONAR = Sonar(
    position=(0, 0, 0),
    beam="omni",
    absorption=False,
    call="fm",
    doppler=True,
    max_range=15,
    cull=0.0,
    tolerance=1e-8,
)


def plate(half=1.0):
    corners = np.array([[0, -half, -half], [0, half, -half], [0, half, half], [0, -half, half]])
    return TriMesh.of_part(corners.astype(float), np.array([[0, 1, 2], [0, 2, 3]]), OTHER)


def at(x, angle=0.0):
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0, x], [sin, cos, 0, 0], [0, 0, 1, 0]], dtype=float)


def targets_in(scene, motion):
    still = EchoTargets(scene)
    moving = MovingCaster(MovingScene(scene, motion), ExactCaster)
    return EchoTargets(scene, still, None, EchoMotion(moving.moving)), moving


def nearing(mesh, x=FAR):
    scene = scene_of(mesh, at(x))
    path = RigidPath(np.array([0.0, 2.0]), np.array([at(x), at(x + 2 * SPEED)]))
    return targets_in(scene, SceneMotion({0: path}))


def poses_at(times):
    return [replace(posed(SONAR), time=time) for time in times]


def alpha_of(echo, group):
    return factors(group, Station(SONAR, AIR, echo.pose, Equipment.of(SONAR)), 0)


@pytest.mark.medium
def test_each_ping_hears_a_plate_where_it_is_then():
    targets, moving = nearing(plate())
    times = [0.0, 0.31, 1.0, 1.77]
    echoes = fly(targets, SONAR, AIR, poses_at(times), moving).echoes
    for time, echo in zip(times, echoes, strict=True):
        (group,) = echo.groups
        glint = int(np.argmin(group.paths.distance))
        place = FAR + SPEED * time
        assert group.paths.length[glint, 0] / C == pytest.approx(2 * place / C, rel=1e-12)
        assert alpha_of(echo, group)[glint] == pytest.approx((C - SPEED) / (C + SPEED), rel=1e-12)
        plain = SONAR.changed(call="impulse", doppler=False, record=0.06)
        there = ping(targets, plain, AIR, moving, pose=poses_at([time])[0]).spectra
        still = ping(EchoTargets(scene_of(plate(), at(place))), plain, AIR).spectra
        assert np.abs(there - still).max() < 1e-9 * np.abs(still).max()


def test_a_plate_that_turns_is_heard_by_the_rate_of_its_height():
    """Turned by θ about the vertical at FAR, its plane is FAR·cos(θ) away, at the rate −FAR·θ'·sin(θ)."""
    scene = scene_of(plate(20.0), at(FAR))
    times = np.linspace(0.0, 1.0, 5)
    path = RigidPath(times, np.array([at(FAR, TURN * t) for t in times]))
    targets, _ = targets_in(scene, SceneMotion({0: path}))
    time = 0.37
    echo = ping(targets, SONAR.changed(shading="none"), AIR, pose=poses_at([time])[0])
    (group,) = echo.groups
    glint = int(np.argmin(group.paths.distance))
    height, rate = FAR * np.cos(TURN * time), -FAR * TURN * np.sin(TURN * time)
    assert group.paths.distance[glint] == pytest.approx(height, rel=1e-9)
    assert alpha_of(echo, group)[glint] == pytest.approx((C - rate) / (C + rate), rel=1e-9)


def test_leaves_that_are_carried_are_heard_as_laid_out_there():
    rng = np.random.default_rng(3)
    mesh = square_leaves(rng.normal(0, 0.5, (200, 3)), rng.normal(size=(200, 3)), 0.04)
    targets, _ = nearing(mesh)
    sonar = SONAR.changed(shading="none", call="impulse", doppler=False, record=0.06)
    echo = ping(targets, sonar, AIR, pose=poses_at([0.8])[0])
    laid = ping(EchoTargets(scene_of(mesh, at(FAR + 0.8 * SPEED))), sonar, AIR)
    assert np.abs(echo.spectra - laid.spectra).max() < 1e-9 * np.abs(laid.spectra).max()
    assert np.allclose(echo.groups[0].velocity, (SPEED, 0, 0))


def test_what_nears_hides_what_stands_behind_it_then():
    """A wall moves aside; leaves behind it are hidden before and heard after that."""
    wall = plate(0.6)
    leaves = square_leaves(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), 0.05)
    scene = scene_of(wall, at(2.0))
    scene = replace(
        scene,
        meshes=(wall, leaves),
        transform=np.array([at(2.0), at(4.0)]),
        mesh_index=np.array([0, 1]),
        object_name=("wall", "leaf"),
        tree=np.array([-1, -1]),
        species=np.array([-1, -1]),
        object_index=np.arange(2),
        reflectance=np.full(2, np.nan),
    )
    aside = at(2.0)
    aside[1, 3] = 3.0
    path = RigidPath(np.array([0.0, 1.0]), np.array([at(2.0), aside]))
    targets, moving = targets_in(scene, SceneMotion({0: path}))
    sonar = SONAR.changed(facets=False, leaf_model="piston")
    wood = MovingCaster(moving.moving.solid(), ExactCaster)
    echoes = fly(targets, sonar, AIR, poses_at([0.0, 1.0]), wood).echoes
    assert [echo.hidden for echo in echoes] == [1, 0]
    assert [echo.leaves_heard if echo.groups else 0 for echo in echoes] == [0, 1]


def test_what_is_away_or_bends_sounds_as_it_is_at_each_ping():
    """Two runs of one object: it is there from 0 to 1 s, and its shape moves 1 m towards the sonar."""
    mesh = plate()
    scene = scene_of(mesh, at(FAR))
    shift = np.stack([mesh.vertices, mesh.vertices - (1.0, 0, 0)])
    motion = SceneMotion(
        {0: RigidPath(np.zeros(1), at(FAR)[None])},
        {0: ShapePath(np.array([0.0, 1.0]), shift)},
        {0: (-np.inf, 1.0)},
    )
    targets, moving = targets_in(scene, motion)
    assert moving.moving.motion.shapes
    early, late, gone = fly(
        targets, SONAR.changed(shading="none"), AIR, poses_at([0.0, 0.5, 1.5])
    ).echoes
    for echo, place in ((early, FAR), (late, FAR - 0.5)):
        assert echo.groups[0].paths.distance.min() == pytest.approx(place, rel=1e-12)
    assert not gone.groups
    assert moving.moving.solid().motion.shapes[0].vertices.shape == (2, 4, 3)


@pytest.mark.medium
def test_doppler_knows_how_a_plate_bends():
    """Its middle comes nearer at 1 m/s while its edge stands, and lay 0.5 m farther off at rest."""
    grid = np.linspace(-1, 1, 21)
    y, z = (side.ravel() for side in np.meshgrid(grid, grid, indexing="ij"))
    flat = np.stack([np.zeros_like(y), y, z], axis=1)
    number = np.arange(441).reshape(21, 21)
    first, across = number[:-1, :-1].ravel(), number[1:, 1:].ravel()
    sides = (number[1:, :-1].ravel(), across), (across, number[:-1, 1:].ravel())
    triangles = np.concatenate([np.stack([first, *side], axis=1) for side in sides])
    mesh = TriMesh.of_part(flat, triangles, OTHER)
    dome = flat.copy()
    dome[:, 0] -= 1 - np.hypot(y, z) ** 2 / 2
    scene = scene_of(mesh, at(FAR))
    shift = ShapePath(np.array([0.0, 1.0]), np.stack([flat, dome]))
    motion = SceneMotion({0: RigidPath(np.zeros(1), at(FAR)[None])}, {0: shift})
    targets, _ = targets_in(scene, motion)
    echo = ping(targets, SONAR.changed(shading="none"), AIR, pose=poses_at([0.5])[0])
    (group,) = echo.groups
    y, z = group.scatterers.centre[:, 1:].T
    inside = np.hypot(y, z) < 0.9
    expected = -(1 - np.hypot(y, z) ** 2 / 2)
    assert inside.sum() > 100
    assert np.abs(group.velocity[:, 0] - expected)[inside].max() < 0.02
    assert np.abs(group.motion[inside, 3] - FAR).max() < 1e-6
    glint = int(np.argmin(group.paths.distance))
    u = group.velocity[glint, 0]
    assert u == pytest.approx(-1.0, abs=0.01)
    assert alpha_of(echo, group)[glint] == pytest.approx((C - u) / (C + u), rel=1e-4)
