"""The hulls of a mesh lose no ray that meets one of its triangles, and leave out some others."""

import numpy as np
import pytest
from references.rays_brute import ray_parameters

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.rays.boxes import Hulls


def bare_tree(seed, size):
    """A trunk and twelve branches, a few metres across times ``size``."""
    rng = stream(seed, "hulls", "tree")
    meshes = []
    for number in range(13):
        step = [0.0, 0.0, 1.0] if number == 0 else [*rng.normal(0, 0.4, 2), 0.2]
        line = np.cumsum(np.tile(step, (9, 1)) + rng.normal(0, 0.05, (9, 3)), axis=0)
        line[:, 2] += 0.0 if number == 0 else 7.0
        meshes.append(tube(size * line, np.linspace(0.1, 0.02, 9) * size, 6))
    first = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [faces + start for (_, faces), start in zip(meshes, first, strict=False)]
    return TriMesh.of_part(np.concatenate([v for v, _ in meshes]), np.concatenate(faces), OTHER)


def through(mesh, count, seed):
    """Rays between points of the box around a mesh, from a little outside of it."""
    rng = stream(seed, "hulls", "rays")
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    start, end = rng.uniform(low, high, (2, count, 3))
    way = end - start
    way[: count // 10, rng.integers(3, size=count // 10)] = 0.0
    return start - 1.5 * way, way


@pytest.mark.medium
@pytest.mark.parametrize(
    "size",
    [pytest.param(1e-3, marks=pytest.mark.slow), 1.0, pytest.param(1e4, marks=pytest.mark.slow)],
)
def test_no_ray_that_meets_a_triangle_is_lost_and_some_that_meet_none_are_left_out(size):
    meshes = [bare_tree(1, size), bare_tree(2, size)]
    hulls = Hulls(meshes)
    for number, mesh in enumerate(meshes):
        origin, way = through(mesh, 1500, number)
        kept = hulls.met(origin.T, way.T, hulls.take(np.full(len(origin), number)))
        t = ray_parameters(origin, way, mesh.vertices[mesh.triangles])
        hit = np.isfinite(t).any(axis=1)
        assert 50 < hit.sum() < 1000
        assert kept[hit].all()
        assert kept[~hit].mean() < 0.9


def test_triangles_that_are_not_finite_are_in_no_hull():
    mesh = bare_tree(3, 1.0)
    vertices = mesh.vertices.copy()
    vertices[::50] = np.nan
    hulls = Hulls([TriMesh.of_part(vertices, mesh.triangles, OTHER)])
    low, high = hulls.take(np.zeros(1, np.int64))
    assert np.isfinite(low).all()
    assert (high.max(axis=(1, 2)) < mesh.vertices.max(axis=0) + 1e-3).all()


def test_a_mesh_without_triangles_is_met_by_nothing():
    hulls = Hulls([TriMesh.of_part(np.zeros((0, 3)), np.zeros((0, 3), np.int64), OTHER)])
    way = np.eye(3)
    assert not hulls.met(-way, way, hulls.take(np.zeros(3, np.int64))).any()
