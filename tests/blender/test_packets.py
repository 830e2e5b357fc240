"""Rays that go side by side, as packets, against the same rays among others; and faces of no thickness."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

pytest.importorskip("bpy")

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.blender.rays import embree
from forest_addon.blender.rays.embree import EmbreeCaster
from forest_addon.sensing.rays.geometry import SceneGeometry

CARD = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float), [[0, 1, 2], [0, 2, 3]]
BOX = (
    np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float),
    [[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5]],
)  # fmt: skip
TURNS = np.eye(3)[[[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1]]]


def grid(rng, rough):
    """Ground of 8 x 8 cells between 0 and 1."""
    x, y = np.meshgrid(np.arange(9) / 8, np.arange(9) / 8)
    first = np.arange(72).reshape(8, 9)[:, :-1].ravel()[:, None]
    points = np.stack([x, y, rough * rng.normal(size=x.shape)], axis=2).reshape(-1, 3)
    return points, np.concatenate(
        [first + np.array(corners) for corners in ([0, 1, 10], [0, 10, 9])]
    )


def leaves(rng, flat):
    points = rng.uniform(-1, 1, (100, 1, 3)) + 0.05 * rng.normal(size=(100, 3, 3)) * flat
    return points.reshape(-1, 3), np.arange(300).reshape(-1, 3)


def scene_of(rng):
    """Cards, walls of boxes, tiles of ground or leaves: along the axes or turned, small or large."""
    kind, count, size = rng.integers(4), rng.integers(2, 60), 10 ** rng.uniform(-1.3, 1.5)
    linear = TURNS[rng.integers(4, size=count)] * size
    shift = rng.uniform(-1, 1, (count, 3)) * 10 ** rng.uniform(0, 3)
    meshes = (CARD, leaves(rng, [1, 1, 0]))
    if kind == 1:
        meshes, shift = (BOX, CARD), np.round(rng.uniform(-4, 4, (count, 3))) * size
    elif kind == 2:
        meshes = grid(rng, 0.0), grid(rng, 1e-3)
        linear[:] = np.eye(3) * size
        shift = np.stack([np.arange(count) % 7, np.arange(count) // 7, np.zeros(count)], 1) * size
    elif kind == 3:
        meshes = leaves(rng, [1, 1, 1]), CARD
        linear = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0] * size
    shift = shift + rng.choice([0.0, 1e3, 1e5]) * rng.normal(size=3)
    meshes = tuple(TriMesh.of_part(points, np.array(rows), OTHER) for points, rows in meshes)
    place, nothing = np.concatenate([linear, shift[:, :, None]], axis=2), np.full(count, -1)
    return SceneGeometry(
        meshes, place, rng.integers(2, size=count), ("x",) * count, nothing, nothing
    )


def beams(rng, scene, count, rays):
    """Origins and ways (count, rays, 3) of beams, 1 µm to 10 m before a point of a triangle; (count,) how
    far before, and by how much the first ray is within it, m; 0 for one nearly in its plane."""
    instance = rng.integers(len(scene), size=count)
    size = np.array([len(mesh.triangles) for mesh in scene.meshes])[scene.mesh_index[instance]]
    corner = scene.corners(instance, rng.integers(size))
    place = scene.transform[instance]
    corner = np.einsum("nij,nkj->nki", place[:, :, :3], corner) + place[:, None, :, 3]
    weight = rng.dirichlet(np.ones(3), count)
    weight[::4] = [0.5, 0.5, 0.0]  # on an edge
    weight[1::4] = [1.0, 0.0, 0.0]  # a corner
    sides = corner[:, [1, 2, 2]] - corner[:, [0, 0, 1]]
    normal = np.cross(sides[:, 0], sides[:, 1])
    double = np.linalg.norm(normal, axis=1)
    height = double / np.linalg.norm(sides, axis=2).max(axis=1)
    normal /= double[:, None]
    way = rng.normal(size=(count, 3))
    way[::3] = normal[::3] + 10 ** rng.uniform(-4, 0) * way[::3]
    way[1::5] = corner[1::5, 1] - corner[1::5, 0]  # in the plane
    way[2::5] = np.eye(3)[rng.integers(3)]
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    before = 10 ** rng.uniform(-6, 1, count)
    start = np.einsum("nk,nki->ni", weight, corner) - before[:, None] * way
    ways = way[:, None] + 10 ** rng.uniform(-9, -1.6, (count, 1, 1)) * rng.normal(
        size=(count, rays, 3)
    )
    near = 10 ** rng.uniform(-9, -1.6, (count, 1, 1)) * rng.normal(size=(count, rays, 3))
    near[:, 0], ways[:, 0] = 0.0, way
    steep = np.abs((way * normal).sum(axis=1)) > 0.05
    return start[:, None] + near, ways, before, weight.min(axis=1) * height * steep


@given(seed=st.integers(0, 2**32 - 1))
def test_what_a_ray_meets_does_not_depend_on_those_beside_it(seed):
    rng = stream(seed, "packets")
    caster, rays = EmbreeCaster(scene_of(rng)), int(rng.choice([8, 19]))
    origins, ways, before, within = beams(rng, caster.scene, 500, rays)
    found = caster.cast(origins.reshape(-1, 3), ways.reshape(-1, 3))
    apart = np.arange(500 * rays).reshape(500, rays).T.ravel()  # rays of other beams beside each
    mixed = rng.permuted(np.arange(500 * rays).reshape(500, rays), axis=1).ravel()[3:]
    beam = np.arange(500 * rays) // rays
    aimed = (beam % 4 < 2) | (beam % 5 == 1)  # at an edge or a corner, or along one
    for order in (apart, mixed):
        again = caster.cast(origins.reshape(-1, 3)[order], ways.reshape(-1, 3)[order])
        other = np.zeros(len(order), bool)
        for name, values in vars(again).items():
            off = values != getattr(found, name)[order]
            other |= (off & (values == values)).reshape(len(order), -1).any(axis=1)
        assert not other[~aimed[order]].any()
        assert other.mean() < 1e-3  # within a µm of an outline
    inner = within > 10 * caster._slack
    assert (found.distance.reshape(500, rays)[inner, 0] <= before[inner] + 4 * caster._slack).all()


@given(seed=st.integers(0, 2**32 - 1))
def test_fans_whose_rays_lie_in_a_plane_are_met_as_rays_alone(seed):
    """As an aircraft's lines: along an axis a way is 0 but for rounding."""
    rng = stream(seed, "fans")
    scene, count = scene_of(rng), 4000
    plane = np.eye(3)[rng.permutation(3)] + 1e-18 * rng.normal(size=(3, 3))
    angle = rng.uniform(-1, 1) + np.arange(count) % 500 * 10 ** rng.uniform(-6, -1.5)
    ways = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1) @ plane.T
    away = 10 ** rng.uniform(-2, 1) * ways.mean(axis=0)
    start = scene.transform[rng.integers(len(scene)), :, 3] - away
    origins = start + np.outer(np.arange(count) * 10 ** rng.uniform(-6, -2), plane[:, 1])
    order = rng.permutation(count)
    caster = EmbreeCaster(scene)
    alone = caster.cast(origins[order], ways[order]).distance
    np.testing.assert_array_equal(caster.cast(origins, ways).distance[order], alone)


def test_an_embree_without_packets_casts_rays_one_by_one(monkeypatch):
    rng = stream(0, "alone")
    scene = scene_of(rng)
    origins, ways = (rays.reshape(-1, 3) for rays in beams(rng, scene, 500, 8)[:2])
    together = EmbreeCaster(scene).cast(origins, ways).distance
    monkeypatch.setattr(embree, "PACKETS", (1, 65))  # Blender's Embree culls no backs of faces
    without = EmbreeCaster(scene)
    assert not without._described.intersect8
    np.testing.assert_array_equal(without.cast(origins, ways).distance, together)
