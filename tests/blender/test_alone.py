"""Hits of rays through Embree are those that each ray has alone, with the kernel and without."""

import numpy as np
import pytest

pytest.importorskip("bpy")

from references.rays_brute import BruteCaster

from forest_addon import kernels
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.blender.rays.embree import EmbreeCaster
from forest_addon.sensing.rays.geometry import SceneGeometry


def crumbs(fine):
    """Four turned copies of 150 triangles strewn in a ball; coordinates that float32 holds, or does not."""
    rng = stream(3, "crumbs")
    corners = rng.normal(size=(150, 1, 3)) + 0.2 * rng.normal(size=(150, 3, 3))
    if not fine:
        corners = corners.astype(np.float32).astype(float)
    mesh = TriMesh.of_part(corners.reshape(-1, 3), np.arange(450).reshape(-1, 3), OTHER)
    turned = np.linalg.qr(rng.normal(size=(4, 3, 3)))[0]
    place = np.concatenate([turned, 3 * rng.normal(size=(4, 3, 1))], axis=2)
    some = np.arange(4)
    return SceneGeometry((mesh,), place, np.zeros(4, np.int64), ("x",) * 4, some, some)


def beams(count, rays=19, width=0.0005):
    """Rays of narrow beams from a point outside, one beam after the other, as a scanner's mirror has them."""
    column, row = np.divmod(np.arange(count), 20)
    axis = np.stack([np.ones(count), 0.04 * (column - count / 40), 0.003 * (row - 10)], axis=1)
    way = axis[:, None] + width * stream(4, "beams").normal(size=(count, rays, 3))
    way = way.reshape(-1, 3) / np.linalg.norm(way.reshape(-1, 3), axis=1)[:, None]
    return np.tile([-12.0, 0.3, 0.1], (len(way), 1)), way


@pytest.mark.medium
@pytest.mark.parametrize("fine", [False, True])
def test_rays_of_beams_meet_what_brute_force_says(fine):
    scene = crumbs(fine)
    origin, way = beams(300)
    found, right = EmbreeCaster(scene).cast(origin, way), BruteCaster(scene).cast(origin, way)
    assert 0.2 < right.found.mean() < 0.9
    np.testing.assert_array_equal(found.found, right.found)
    there = right.found
    np.testing.assert_allclose(found.distance[there], right.distance[there], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.triangle, right.triangle)
    assert (scene.table.vertices.dtype == np.float32) is not fine


@pytest.mark.parametrize("fine", [False, True])
def test_the_kernel_and_numpy_find_the_same_bytes(fine, monkeypatch):
    if kernels.library() is None:
        pytest.skip(kernels.engine())
    caster = EmbreeCaster(crumbs(fine))
    origin, way = beams(100)
    near = stream(9, "near").uniform(0, 12, len(way))

    def chain():
        first = caster.cast(origin, way, 14.0)
        yield first
        yield caster.cast(origin, way, 13.0, min_distance=near)
        yield caster.cast(origin, way, min_distance=first.distance, leaving=first)

    ours = list(chain())
    monkeypatch.setenv(kernels.SWITCH, "off")
    for one, other in zip(ours, chain(), strict=True):
        assert one.found.any()
        for name, column in vars(one).items():
            assert column.tobytes() == getattr(other, name).tobytes()


def test_beams_in_any_order_meet_the_same():
    origin, way = beams(300)
    caster, order = EmbreeCaster(crumbs(False)), stream(5, "order").permutation(300 * 19)
    beside, apart = caster.cast(origin, way).select(order), caster.cast(origin[order], way[order])
    np.testing.assert_array_equal(beside.distance, apart.distance)
    np.testing.assert_array_equal(beside.triangle, apart.triangle)


def lattice():
    """Two grids with steps of quarters, coplanar here and there: in float32 rays hit their edges exactly."""
    place = np.arange(41.0)
    x, y = np.meshgrid(place, place, indexing="ij")
    number = np.arange(x.size).reshape(x.shape)
    cells = (number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:])
    faces = np.concatenate(
        [
            np.stack([cells[k] for k in some], axis=2).reshape(-1, 3)
            for some in ((0, 1, 2), (1, 3, 2))
        ]
    )
    rough = 0.25 * stream(7, "rough").integers(0, 3, x.shape)
    heights = (rough, np.full(x.shape, 0.25))
    meshes = tuple(
        TriMesh.of_part(np.stack([x, y, z], axis=2).reshape(-1, 3), faces, OTHER) for z in heights
    )
    some = np.arange(2)
    return SceneGeometry(meshes, np.eye(3, 4)[None].repeat(2, 0), some, ("x",) * 2, some, some)


def test_a_hit_depends_on_its_ray_alone():
    """Also where rays hit edges and coplanar faces exactly, and the order of a search would decide."""
    scene, rng, count = lattice(), stream(8, "lattice"), 20_000
    mesh = scene.meshes[0]
    edge = mesh.vertices[mesh.triangles[rng.integers(len(mesh.triangles), size=count), :2]]
    share = rng.choice([0.0, 0.25, 0.5, 1.0], (count, 1))
    target = edge[:, 0] * (1 - share) + edge[:, 1] * share
    origins = target + np.column_stack([rng.integers(-8, 9, (count, 2)), np.full(count, 16.0)])
    caster = EmbreeCaster(scene)
    whole = caster.cast(origins, target - origins)
    assert whole.found.mean() > 0.95
    for _ in range(3):
        order = rng.permutation(count)
        apart = caster.cast(origins[order], (target - origins)[order])
        for name, column in vars(whole.select(order)).items():
            assert column.tobytes() == getattr(apart, name).tobytes()
    for row in range(0, count, 100):
        alone = caster.cast(origins[[row]], (target - origins)[[row]])
        assert (alone.instance[0], alone.triangle[0]) == (whole.instance[row], whole.triangle[row])


@pytest.mark.parametrize("before", [1e-6, 6e-5, 1e-3, 1e-2])
def test_no_ray_slips_through_a_flat_face_close_before_it(before):
    """Coherent packets of Embree lose a third of those that start 1e-6 m before it."""
    rng, count = stream(10, "close"), 20_000
    corners = np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), OTHER)
    place = np.eye(3, 4)[None].repeat(2, 0)
    place[1] *= 30
    place[1, 0, 3] = 28.0
    none = np.arange(2)
    scene = SceneGeometry((mesh,), place, 0 * none, ("x",) * 2, none, none)
    way = np.column_stack([np.ones(count), rng.uniform(-0.3, 0.3, (count, 2))])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    start = np.column_stack([np.zeros(count), rng.uniform(-0.8, 0.8, (count, 2))]) - before * way
    assert (EmbreeCaster(scene).cast(start, way).instance == 0).all()
