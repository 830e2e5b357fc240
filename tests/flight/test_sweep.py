"""A swept sphere against closed forms, and against dense samples in float64 that share no code with it."""

import numpy as np
import pytest

from forest_addon.base.trimesh import LEAF, WOOD, TriMesh, join
from forest_addon.flight.obstacles import (
    MeshObstacles,
    Solid,
    distances,
    stopping,
    touched,
    touches,
)
from forest_addon.flight.stems import PlaneTrunks
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.rays.geometry import SceneGeometry

FLOOR = np.array([[[-9.0, -9, 0], [9, -9, 0], [0, 20, 0]]])


def first_touch(start, way, radius, corners):
    return touches(start, way, radius, corners).min(initial=np.inf)


def nearest_by_samples(point, corners, steps=60):
    """Distance to points strewn densely over triangles."""
    u, v = (g.ravel() for g in np.meshgrid(*[np.linspace(0, 1, steps)] * 2))
    keep = u + v <= 1 + 1e-12
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    places = a[:, None] + u[keep, None] * (b - a)[:, None] + v[keep, None] * (c - a)[:, None]
    return np.linalg.norm(places - point, axis=2).min(axis=1)


@pytest.mark.parametrize(
    ("start", "way", "share"),
    [
        ((0.0, 0, 2), (0.0, 0, -4), 1.5 / 4),  # face: the plane, a radius before it
        ((0.0, 0, -2), (0.0, 0, 4), 1.5 / 4),  # from behind
        ((0.0, -12, 0), (0.0, 6, 0), 2.5 / 6),  # edge, in its plane
        ((-12.0, -9, 0), (6.0, 0, 0), 2.5 / 6),  # corner
        ((0.0, 0, 2), (0.0, 0, 4), np.inf),  # away
        ((0.0, 0, 2), (5.0, 0, 0), np.inf),  # alongside
        ((0.0, 0, 0.4), (0.0, 0, 4), 0.0),  # touches already
        ((0.0, 0, 2), (0.0, 0, 0), np.inf),  # stands still
        ((0.0, 0, 500), (0.0, 0, -1e6), 499.5 / 1e6),  # a very long step
    ],
)
def test_closed_forms(start, way, share):
    found = first_touch(np.array(start), np.array(way), 0.5, FLOOR)
    assert found == pytest.approx(share, rel=1e-12)


def test_distances_are_those_of_dense_samples():
    rng = np.random.default_rng(1)
    corners = rng.normal(0, 1, (40, 3, 3))
    for point in rng.normal(0, 2, (12, 3)):
        exact, sampled = distances(point, corners), nearest_by_samples(point, corners)
        assert (exact <= sampled + 1e-12).all()
        assert (sampled - exact < 0.08).all()  # steps of at most 4 m / 60


@pytest.mark.medium
def test_touch_is_where_the_distance_first_is_the_radius():
    """At the share the sphere touches, before it never does (40 places along), and misses are misses."""
    rng = np.random.default_rng(2)
    met = 0
    for _ in range(50):
        corners = rng.normal(0, 1, (9, 3, 3)) * rng.uniform(0.01, 1.5)
        start, radius = rng.normal(0, 3, 3), rng.uniform(0.01, 0.5)
        way = corners.mean(axis=(0, 1)) - start + rng.normal(0, 0.5, 3)
        share = first_touch(start, way, radius, corners)
        end = min(share, 1.0)
        along = [distances(start + s * way, corners).min() for s in np.linspace(0, end, 40)[:-1]]
        assert min(along) > radius - 1e-9 or share == 0
        if 0 < share <= 1:
            met += 1
            assert distances(start + share * way, corners).min() == pytest.approx(radius, abs=1e-9)
    assert met > 10


def test_degenerate_triangles_are_points_and_lines():
    point = np.zeros((1, 3, 3))
    line = np.array([[[0.0, -5, 0], [0, 5, 0], [0, 0, 0]]])
    for corners in (point, line):
        assert first_touch(np.array([4.0, 0, 0]), np.array([-8.0, 0, 0]), 1.0, corners) == 3 / 8


def forest(count=30, seed=3):
    """Bent trunks with twigs and leaves, turned and scaled."""
    rng = np.random.default_rng(seed)
    way = np.stack([np.linspace(0, 0.5, 9), np.zeros(9), np.linspace(0, 4, 9)], axis=1)
    trunk = TriMesh.of_part(*tube(way, np.linspace(0.2, 0.1, 9), 8), WOOD)
    twig = TriMesh.of_part(*tube(way[::4] * [3, 1, 0.1] + [0, 0, 2], np.full(3, 0.004), 5), WOOD)
    leaf = TriMesh.of_part(
        np.array([[1.0, 0, 2], [2, 0, 2], [1, 1, 2]]), np.array([[0, 1, 2]]), LEAF
    )
    turn, scale = rng.uniform(0, 6.3, count), rng.uniform(0.7, 1.3, count)
    transform = np.zeros((count, 3, 4))
    transform[:, 0, 0] = transform[:, 1, 1] = scale * np.cos(turn)
    transform[:, 1, 0] = scale * np.sin(turn)
    transform[:, 0, 1] = -transform[:, 1, 0]
    transform[:, 2, 2] = scale
    transform[:, :2, 3] = rng.uniform(0, 12, (count, 2))
    none = np.full(count, -1)
    meshes = (join([trunk, twig, leaf]),)
    return SceneGeometry(meshes, transform, np.zeros(count, int), ("t",) * count, none, none)


def test_leaves_and_thin_twigs_do_not_stop():
    mesh = forest().meshes[0]
    assert (mesh.part[stopping(mesh, 0.0)] == WOOD).all()
    thick = stopping(mesh, 0.02)
    assert len(thick) == len(tube(np.zeros((9, 3)) + np.arange(9)[:, None], np.ones(9), 8)[1])
    assert mesh.vertices[mesh.triangles[thick]].max() > 3.9


@pytest.mark.medium
@pytest.mark.parametrize("step", [0.3, 10.0])
def test_forests_are_met_as_all_their_triangles_are(step):
    """Cells, boxes and the map lose nothing: all triangles of all trees, one by one, say the same."""
    scene = forest()
    solid = Solid(scene.meshes[0], 0.02)
    obstacles = MeshObstacles(scene, [solid])
    every = np.concatenate([solid.corners @ m[:, :3].T + m[:, 3] for m in scene.transform])
    rng = np.random.default_rng(4)
    start = np.column_stack([rng.uniform(-1, 13, (40, 2)), rng.uniform(0.2, 3, 40)])
    start[:20] = scene.transform[:20, :, 3] + rng.uniform(-0.7, 0.7, (20, 3)) + [0, 0, 1]
    way = rng.normal(0, 1, (40, 3)) * [1, 1, 0.2]
    way *= step / np.linalg.norm(way, axis=1, keepdims=True)
    found = touched(obstacles, start, start + way, 0.1)
    truth = np.array([first_touch(p, w, 0.1, every) for p, w in zip(start, way, strict=True)])
    assert np.allclose(found, truth, atol=1e-9)
    assert np.isfinite(truth).any()
    exact = np.array([distances(p, every).min() for p in start])
    room = obstacles.room(start)
    assert (room <= exact + 1e-12).all()
    far = exact > 1.0
    assert (room[far] > 0.5).all()  # a bound that is of use
    assert obstacles.distance(start[0], 50.0) == pytest.approx(exact[0])


def test_trunks_of_a_plan_are_circles():
    stems = PlaneTrunks(np.array([[5.0, 0.0], [5.0, 9.0]]), np.array([0.5, 1.0]))
    start, end = (
        np.array([[0.0, 0, 1], [0, 3, 1], [0, 0.8, 1]]),
        np.array([[10.0, 0, 1], [10, 3, 1], [10, 0.8, 1]]),
    )
    found = touched(stems, start, end, 0.5)
    assert found == pytest.approx([0.4, np.inf, (5 - np.sqrt(1 - 0.64)) / 10], rel=1e-12)
    inside = touched(stems, np.array([[5.0, 0.2, 1]]), np.array([[6.0, 0, 1]]), 0.1)
    assert inside[0] == 0


def test_nothing_stands_in_an_empty_world():
    nothing = np.empty(0, dtype=np.int64)
    scene = SceneGeometry((), np.empty((0, 3, 4)), nothing, (), nothing, nothing)
    for empty in (MeshObstacles(scene, []), PlaneTrunks(np.empty((0, 2)), np.empty(0))):
        assert touched(empty, np.zeros((1, 3)), np.full((1, 3), 1e4), 1.0)[0] == np.inf
