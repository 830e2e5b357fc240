"""Both engines against float64 brute force, against each other, and on the hardest rays."""

import gc
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy")

from references.rays import BruteCaster

from forest_addon import kernels
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, OTHER, TriMesh, join
from forest_addon.blender.rays import bvh, casters, embree as embree_library
from forest_addon.blender.rays.bvh import BvhCaster
from forest_addon.blender.rays.casters import make_caster
from forest_addon.blender.rays.embree import EmbreeCaster
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.rays.caster import Hits, hit_normals
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Rays

BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
BOX_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


@pytest.fixture(params=["bvhtree", "embree", "embree without the kernel"])
def engine(request, monkeypatch):
    if request.param == "bvhtree":
        return BvhCaster
    if request.param != "embree":
        monkeypatch.setenv(kernels.SWITCH, "off")
    elif kernels.library() is None:
        pytest.skip(kernels.engine())
    return EmbreeCaster


def scene_of(meshes, transforms, index=None):
    transforms = np.asarray(transforms, float)
    count = len(transforms)
    return SceneGeometry(
        meshes=tuple(meshes),
        transform=transforms,
        mesh_index=np.zeros(count, np.int64) if index is None else np.asarray(index),
        object_name=("x",) * count,
        tree=np.arange(count),
        species=np.zeros(count, np.int64),
    )


def pose(linear=None, shift=(0, 0, 0)):
    return np.column_stack([np.eye(3) if linear is None else linear, shift])


def box():
    return TriMesh.of_part(BOX, BOX_FACES, OTHER)


def crumpled_sphere():
    """A closed mesh, star-shaped about its centre, of 960 triangles of all shapes."""
    rng = stream(11, "sphere")
    rings, columns = 16, 32
    polar = np.pi * np.arange(1, rings)[:, None] / rings
    azimuth = 2 * np.pi * np.arange(columns) / columns
    ball = np.stack(
        [
            np.sin(polar) * np.cos(azimuth),
            np.sin(polar) * np.sin(azimuth),
            np.broadcast_to(np.cos(polar), (rings - 1, columns)),
        ],
        axis=2,
    ).reshape(-1, 3)
    ball *= rng.uniform(0.95, 1.05, (len(ball), 1))
    number = np.arange(len(ball)).reshape(rings - 1, columns)
    right = np.roll(number, -1, axis=1)
    top, bottom = len(ball), len(ball) + 1
    faces = [
        np.stack([number[:-1], number[1:], right[:-1]], axis=2).reshape(-1, 3),
        np.stack([right[:-1], number[1:], right[1:]], axis=2).reshape(-1, 3),
        np.stack([np.full(columns, top), number[0], right[0]], axis=1),
        np.stack([np.full(columns, bottom), right[-1], number[-1]], axis=1),
    ]
    poles = [[0, 0, 1.0], [0, 0, -1.0]]
    return TriMesh.of_part(np.concatenate([ball, poles]), np.concatenate(faces), OTHER)


def small_tree(seed):
    """A bent trunk and a cloud of leaf triangles."""
    rng = stream(seed, "tree")
    line = np.cumsum(rng.normal([0, 0, 0.4], 0.1, (12, 3)), axis=0)
    trunk = TriMesh.of_part(*tube(line, np.linspace(0.2, 0.05, 12), 8), OTHER)
    centre = line[-1] + rng.normal(0, 0.8, (150, 1, 3))
    corners = (centre + rng.normal(0, 0.08, (150, 3, 3))).reshape(-1, 3)
    crown = TriMesh.of_part(corners, np.arange(450).reshape(-1, 3), LEAF)
    return join([trunk, crown])


def forest(count, seed=0, far=0.0):
    rng = stream(seed, "forest")
    poses = []
    for _ in range(count):
        linear = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.5, 2)
        shift = np.array([*rng.uniform(-15, 15, 2), rng.uniform(0, 2)]) + far
        poses.append(pose(linear, shift))
    return scene_of([small_tree(1), small_tree(2)], poses, rng.integers(2, size=count))


def random_rays(count, seed=0, far=0.0):
    rng = stream(seed, "rays")
    return rng.uniform(-20, 20, (count, 3)) + far, rng.normal(size=(count, 3))


@pytest.mark.medium
@pytest.mark.parametrize("count", [1, 40])
def test_equals_brute_force_on_random_rays(engine, count):
    scene = forest(count)
    rays = 12_000 // (count + 10)
    origins, directions = random_rays(rays)
    aimed = scene.transform[np.arange(rays) % count, :, 3] + stream(5, "aim").normal(
        0, 1, (rays, 3)
    )
    directions[::2] = (aimed - origins)[::2]
    ours = engine(scene).cast(origins, directions, np.inf)
    exact = BruteCaster(scene).cast(origins, directions, np.inf)
    assert exact.found.sum() > 30
    same = (ours.instance == exact.instance) & (ours.triangle == exact.triangle)
    assert (~same).sum() < 0.001 * exact.found.sum()
    met = same & exact.found
    assert np.abs(ours.distance[met] - exact.distance[met]).max() < 1e-9
    for ray in np.flatnonzero(~same).tolist():  # they pass an edge within what float32 resolves
        assert min(edge_gap(scene, hits, ray, origins, directions) for hits in (ours, exact)) < 1e-5


def test_utm_offset_loses_nothing(engine):
    near, far = forest(5), forest(5, far=5e5)
    origins, directions = random_rays(3000)
    a = engine(near).cast(origins, directions, np.inf)
    b = engine(far).cast(origins + 5e5, directions, np.inf)
    assert (a.found == b.found).mean() > 0.999
    both = (a.triangle == b.triangle) & a.found & b.found
    assert both.sum() / a.found.sum() > 0.999
    # 5e5 m in float64 is spaced by 6e-11 m; a grazing plane multiplies that.
    assert np.quantile(np.abs(a.distance[both] - b.distance[both]), 0.99) < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("far", [0.0, 5e5])
def test_no_leak_through_edges_and_vertices_of_a_closed_mesh(engine, far):
    """Within a closed crumpled sphere, 120,000 rays for each engine, each fifth at a vertex."""
    rays = 60_000
    rng = stream(3, "edges")
    sphere = crumpled_sphere()
    linear = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag([2.0, 3.0, 1.0])
    scene = scene_of([sphere], [pose(linear, (5 + far, far - 2, 7))])
    corner = sphere.triangles[rng.integers(len(sphere.triangles), size=rays)]
    at_vertex = np.arange(rays) % 5 == 0
    share = np.where(at_vertex, 0.0, rng.random(rays))[:, None]
    target = sphere.vertices[corner[:, 0]] * (1 - share) + sphere.vertices[corner[:, 1]] * share
    target = target @ linear.T + scene.transform[0, :, 3]
    origins = scene.transform[0, :, 3] + rng.uniform(-0.05, 0.05, (rays, 3))
    hits = engine(scene).cast(origins, target - origins)
    # A robust Embree is tight at edges, and all but tight at vertices.
    lost_vertices = 1e-4 if engine is EmbreeCaster else 0.0
    assert hits.found[~at_vertex].all()
    assert (~hits.found[at_vertex]).mean() <= lost_vertices
    aimed = np.linalg.norm(target - origins, axis=1)
    assert (hits.distance - aimed)[hits.found].max() < 1e-4  # beside an edge is the next face


@pytest.mark.parametrize("direction", [(0, 0, 0), (np.nan, 0, 1), (np.inf, 0, 0), (0, 0, -np.inf)])
def test_impossible_directions_hit_nothing(engine, direction):
    caster = engine(scene_of([box()], [pose()]))
    hits = caster.cast(np.array([[0.5, 0.5, 0.5]]), np.array([direction], float), np.inf)
    assert hits.distance[0] == np.inf
    assert hits.instance[0] == hits.triangle[0] == -1


def test_the_limit_is_inclusive(engine):
    caster = engine(scene_of([box()], [pose()]))
    origins, up = np.tile([0.3, 0.4, -2.0], (3, 1)), np.tile([0, 0, 1.0], (3, 1))
    limits = np.array([2.0, np.nextafter(2.0, 0), 2.1])
    assert caster.cast(origins, up, limits).found.tolist() == [True, False, True]
    assert caster.occluded(origins, up, limits).tolist() == [True, False, True]


@pytest.mark.parametrize(
    "linear",
    [
        np.diag([-1.0, 1, 1]),
        np.diag([3.0, 0.1, 1]),
        np.array([[1, 0.7, 0], [0, 1, 0.3], [0, 0, 1]]),
        np.eye(3) * 1e-3,
        np.eye(3) * 1e4,
    ],
    ids=["mirrored", "non-uniform", "sheared", "tiny", "huge"],
)
def test_instance_matrices_of_every_kind(engine, linear):
    scene = scene_of([box()], [pose(linear, (1, 2, 3))])
    rng = stream(8, "matrix")
    target = rng.random((500, 3)) @ linear.T + [1, 2, 3]
    origins = target + rng.normal(size=(500, 3)) * np.abs(linear).max() * 3
    ours = engine(scene).cast(origins, target - origins, np.inf)
    exact = BruteCaster(scene).cast(origins, target - origins, np.inf)
    assert ours.found.all()
    assert np.allclose(ours.distance, exact.distance, rtol=1e-9, atol=1e-9 * np.abs(linear).max())


@pytest.mark.parametrize(
    "linear", [np.zeros((3, 3)), np.diag([1.0, 1, 0]), np.full((3, 3), np.nan)]
)
def test_an_instance_without_volume_is_met_by_nothing_and_harms_no_other(engine, linear):
    scene = scene_of([box()], [pose(linear), pose(shift=(0, 0, 5))])
    hits = engine(scene).cast(np.array([[0.3, 0.4, -2.0]]), np.array([[0, 0, 1.0]]), np.inf)
    assert hits.instance[0] == 1
    assert hits.distance[0] == pytest.approx(7.0)


def test_degenerate_and_nan_geometry_harms_no_other(engine):
    broken = TriMesh.of_part(
        np.concatenate([BOX, [[np.nan, 0, 0], [0.5, 0.5, -1], [0.5, 0.5, -1]]]),
        np.concatenate([[[8, 0, 1], [9, 10, 9], [0, 0, 0]], BOX_FACES]),
        OTHER,
    )
    scene = scene_of([broken], [pose()])
    hits = engine(scene).cast(np.array([[0.3, 0.4, -2.0]]), np.array([[0, 0, 1.0]]), np.inf)
    assert hits.distance[0] == pytest.approx(2.0)
    assert hits.triangle[0] >= 3


def test_collinear_triangles_hide_nothing(engine):
    """Triangles of 5 cm without height but for rounding, a real one by each; rays pass along the lines."""
    rng = stream(15, "collinear")
    count = 300
    first = rng.normal([0, 0, 8], 4, (count, 3))
    along = rng.normal(0, 0.03, (count, 3))
    line = first[:, None] + np.linspace(0, 1, 3)[:, None] ** 1.3 * along[:, None]
    real = first[:, None] + rng.normal(0, 0.3, (count, 3, 3))
    corners = np.concatenate([line, real]).astype(np.float32).astype(float).reshape(-1, 3)
    mesh = TriMesh.of_part(corners, np.arange(6 * count).reshape(-1, 3), OTHER)
    scene = scene_of([mesh], [pose()])
    share = rng.uniform(-3, 4, (count, 7, 1))
    target = (first[:, None] + share * along[:, None]).reshape(-1, 3)
    ways = rng.normal(size=target.shape)
    origins = target - 50 * ways / np.linalg.norm(ways, axis=1)[:, None]
    hits = engine(scene).cast(origins, ways)
    alone = scene_of([mesh.select(np.arange(2 * count) >= count)], [pose()])
    exact = BruteCaster(alone).cast(origins, ways)
    assert exact.found.sum() > 500
    assert (hits.triangle[hits.found] >= count).all()
    assert (hits.found == exact.found).mean() > 0.999
    same = hits.found & (hits.triangle == exact.triangle + count)
    assert np.abs(hits.distance[same] - exact.distance[same]).max() < 1e-9


@pytest.mark.medium
@pytest.mark.parametrize("size", [1, 3, 16, 17, 500])
def test_a_batch_of_any_size_finds_the_same_bytes(engine, size):
    """Few rays go another way than many: ray by ray, into packets that are kept."""
    caster = engine(forest(40))
    origins, directions = random_rays(2500)
    whole = caster.cast(origins, directions, 30.0, min_distance=0.2)
    parts = [slice(k, k + size) for k in range(0, min(len(origins), 60 * size), size)]
    found = [caster.cast(origins[k], directions[k], 30.0, min_distance=0.2) for k in parts]
    for part, each in zip(parts, found, strict=True):  # what was found stays when others are cast
        for name in ("distance", "instance", "triangle"):
            assert getattr(each, name).tobytes() == getattr(whole, name)[part].tobytes()


def test_small_batches_of_many_threads_do_not_disturb_each_other():
    caster = EmbreeCaster(forest(40))
    origins, directions = random_rays(2560)
    whole = caster.cast(origins, directions)

    def look(first):
        part = slice(first, first + 32)
        return caster.cast(origins[part], directions[part]).distance

    with ThreadPoolExecutor(8) as pool:
        found = np.concatenate(list(pool.map(look, range(0, 2560, 32))))
    assert found.tobytes() == whole.distance.tobytes()


def edge_gap(scene, hits, ray, origins, directions):
    """How far a ray passes from the nearest edge of the triangle it is said to hit, metres."""
    instance = hits.instance[ray]
    if instance < 0:
        return np.inf
    mesh, transform = scene.meshes[scene.mesh_index[instance]], scene.transform[instance]
    corners = mesh.vertices[mesh.triangles[hits.triangle[ray]]] @ transform[:, :3].T
    corners = corners + transform[:, 3] - origins[ray]
    way = directions[ray] / np.linalg.norm(directions[ray])
    gaps = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = np.cross(way, b - a)
        gaps.append(abs(a @ normal) / np.linalg.norm(normal))
    return min(gaps)


def test_rays_that_start_on_a_surface_or_at_a_limit_count_it(engine):
    caster = engine(scene_of([box()], [pose(shift=(3e5, 4e5, 5))]))
    start = np.tile([3e5 + 0.3, 4e5 + 0.4, 5.0], (4, 1)) + np.array(
        [[0, 0, z] for z in (0, 0, -2, -2)]
    )
    up = np.tile([0, 0, 1.0], (4, 1))
    near = np.array([0.0, np.nextafter(0, 1), 2.0, np.nextafter(2.0, 3)])
    hits = caster.cast(start, up, np.inf, min_distance=near)
    assert hits.distance == pytest.approx([0, 1, 2, 3], abs=1e-9)
    hits = caster.cast(start, up, 2.5, min_distance=near)
    assert hits.found.tolist() == [True, True, True, False]


@pytest.mark.parametrize("bad", [np.nan, -1.0])
def test_impossible_limits_hit_nothing(engine, bad):
    caster = engine(scene_of([box()], [pose()]))
    start, up = np.array([[0.3, 0.4, -2.0]]), np.array([[0, 0, 1.0]])
    assert not caster.cast(start, up, bad).found.any()
    assert not caster.cast(start, up, 1.9, min_distance=2.1).found.any()
    assert not caster.cast(start * np.nan, up).found.any()
    assert not caster.cast(start, up, np.inf, min_distance=np.nan).found.any()


@pytest.mark.slow
def test_chained_rays_pass_every_surface_once(engine):
    """Along one line through a forest: what brute force finds one behind the other."""
    scene = forest(12)
    origins, _ = random_rays(200, seed=4)
    target = scene.transform[np.arange(200) % 12, :, 3] + stream(6, "aim").normal(0, 1, (200, 3))
    directions = target - origins
    caster, brute = engine(scene), BruteCaster(scene)
    ours, exact = caster.cast(origins, directions), brute.cast(origins, directions)
    for _ in range(4):
        same = (ours.instance == exact.instance) & (ours.triangle == exact.triangle)
        assert same.mean() > 0.995  # what float32 sees otherwise at edges adds up
        both = same & exact.found
        assert np.abs(ours.distance[both] - exact.distance[both]).max() < 1e-9
        last = exact
        ours, exact = (
            c.cast(origins, directions, min_distance=last.distance, leaving=last)
            for c in (caster, brute)
        )
        assert (ours.distance > last.distance)[ours.found].all()


@pytest.mark.slow
def test_reflected_rays_do_not_meet_the_face_they_leave(engine):
    """In a closed room every ray meets another wall, again and again, wherever the room stands."""
    rng = stream(9, "room")
    for far in (0.0, 5e5):
        scene = scene_of([box()], [pose(np.diag([4.0, 5.0, 3.0]), (far, far, 0))])
        caster = engine(scene)
        points = np.array([far, far, 0]) + rng.uniform(0.5, 2.5, (2000, 3))
        ways = rng.normal(size=(2000, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        hits = caster.cast(points, ways)
        for _ in range(20):
            assert hits.found.all()
            points = points + hits.distance[:, None] * ways
            normal = hit_normals(scene, hits)
            ways = ways - 2 * np.einsum("ri,ri->r", ways, normal)[:, None] * normal
            last, hits = hits, caster.cast(points, ways, leaving=hits)
            assert (hits.triangle != last.triangle).all()
        inside = points - [far, far, 0]
        assert (inside > -1e-6).all()
        assert (inside < np.array([4, 5, 3]) + 1e-6).all()


def test_faces_that_lie_on_each_other_are_passed_together(engine):
    double = TriMesh.of_part(
        np.concatenate([BOX, BOX]), np.concatenate([BOX_FACES, BOX_FACES + 8]), OTHER
    )
    caster = engine(scene_of([double, box()], [pose(), pose()], [0, 1]))
    start, up = np.array([[0.3, 0.4, -2.0]]), np.array([[0, 0, 1.0]])
    first = caster.cast(start, up)
    second = caster.cast(start, up, min_distance=first.distance, leaving=first)
    third = caster.cast(start, up, min_distance=second.distance, leaving=second)
    assert (first.distance[0], second.distance[0], third.found[0]) == (2.0, 3.0, False)


def test_both_faces_are_hit_and_normals_are_of_the_world(engine):
    mirrored = np.diag([-1.0, 2.0, 0.5])
    scene = scene_of([box()], [pose(mirrored, (1, 2, 3))])
    middle = np.tile([0.5, 3.0, 3.25], (6, 1)) + 0.01
    ways = np.concatenate([np.eye(3), -np.eye(3)])
    hits = engine(scene).cast(middle, ways)
    assert hits.found.all()
    assert np.abs(np.einsum("ri,ri->r", hit_normals(scene, hits), ways)) == pytest.approx(1)


def test_occlusion_says_what_cast_finds(engine):
    scene = forest(20)
    origins, directions = random_rays(5000)
    caster = engine(scene)
    hits = caster.cast(origins, directions)
    limit = np.where(hits.found, hits.distance, 20.0)
    rows = np.flatnonzero(hits.found)
    assert (caster.occluded(origins, directions, limit) == hits.found).all()
    short = np.nextafter(limit, 0)
    assert not caster.occluded(origins[rows], directions[rows], short[rows]).any()
    passed = caster.occluded(origins, directions, 30.0, min_distance=limit, leaving=hits)
    behind = caster.cast(origins, directions, 30.0, min_distance=limit, leaving=hits)
    assert (passed == behind.found).all()


def test_far_origins_and_near_ones_meet_the_same(engine):
    """Rays of an airborne scanner, from 5 km and from 50 m."""
    scene = forest(20)
    rng = stream(13, "far")
    target = scene.transform[np.arange(4000) % 20, :, 3] + rng.normal(0, 1, (4000, 3))
    way = rng.normal([0, 0, -1], 0.2, (4000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    caster = engine(scene)
    near, far = (caster.cast(target - way * d, way) for d in (50.0, 5000.0))
    assert near.found.sum() > 300
    same = (near.instance == far.instance) & (near.triangle == far.triangle)
    assert same.mean() > 0.998
    both = same & near.found
    assert np.abs(near.distance[both] + 4950.0 - far.distance[both]).max() < 1e-8


@pytest.mark.slow
def test_a_ground_among_many_instances(engine):
    """One box as large as the scene above hundreds of small ones: all are met."""
    rng = stream(14, "ground")
    plane = TriMesh.of_part(BOX * [400, 400, 0.1] - [200, 200, 0.1], BOX_FACES, OTHER)
    poses = [pose(), *(pose(shift=(*xy, 0)) for xy in rng.uniform(-190, 190, (300, 2)))]
    scene = scene_of([plane, box()], poses, [0, *[1] * 300])
    xy = rng.uniform(-195, 195, (900, 2))
    xy[:300] = scene.transform[1:, :2, 3] + 0.5
    origins = np.column_stack([xy, np.full(900, 50.0)])
    down = np.tile([0, 0, -1.0], (900, 1))
    ours, exact = engine(scene).cast(origins, down), BruteCaster(scene).cast(origins, down)
    assert exact.distance.min() == 49
    assert (np.abs(ours.distance - exact.distance) < 1e-9).all()


@pytest.mark.slow
def test_embree_gives_its_memory_back():
    resource = pytest.importorskip("resource")
    page = resource.getpagesize()

    def used():
        return int(Path("/proc/self/statm").read_text().split()[1]) * page

    if not Path("/proc/self/statm").exists():
        pytest.skip("memory is read from /proc")
    scene = forest(30)
    for _ in range(5):
        EmbreeCaster(scene)
    before = used()
    for _ in range(200):
        EmbreeCaster(scene)
    gc.collect()
    assert used() - before < 200 * 20_000  # bytes; its triangles alone take more


def test_garbage_is_collected_again_wherever_a_cancelled_job_was(monkeypatch):
    def interrupted(pause=gc.disable):
        pause()
        raise KeyboardInterrupt

    monkeypatch.setattr(bvh.gc, "disable", interrupted)
    with pytest.raises(KeyboardInterrupt):
        BvhCaster(scene_of([box()], [pose()])).cast(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]))
    assert gc.isenabled()


def test_only_rays_whose_hit_does_not_count_are_searched_again(engine, monkeypatch):
    scene = scene_of([box()], [pose()])
    origins = np.array([[0.0, 0.0, 1.0 + 5e-4]] + [[0.3, 0.1, 3.0]] * 20)  # the first: just above
    searched = []
    nearest = engine._nearest

    def counting(self, origins, *rest):
        searched.append(origins.shape[1])
        return nearest(self, origins, *rest)

    monkeypatch.setattr(engine, "_nearest", counting)
    ways = np.array([[0.0, 0.0, 1.0]] + [[0.0, 0.0, -1.0]] * 20)
    found = engine(scene).cast(origins, ways)
    assert not found.found[0]
    assert found.found[1:].all()
    if not searched:  # the kernel refuses such hits while Embree is on its way
        return
    assert searched[0] == 21
    assert sum(searched) <= 25


# --------------------------------------------------------------------------------------------- alone
# Hits of rays through Embree are those that each ray has alone, with the kernel and without.


def crumbs(fine):
    """Four turned copies of 150 triangles strewn in a ball; vertices in float32, or finer."""
    rng = stream(3, "crumbs")
    corners = rng.normal(size=(150, 1, 3)) + 0.2 * rng.normal(size=(150, 3, 3))
    mesh = TriMesh.of_part(corners.reshape(-1, 3), np.arange(450).reshape(-1, 3), OTHER)
    if not fine:
        mesh = replace(mesh, vertices=mesh.vertices.astype(np.float32))
    turned = np.linalg.qr(rng.normal(size=(4, 3, 3)))[0]
    return scene_of([mesh], np.concatenate([turned, 3 * rng.normal(size=(4, 3, 1))], axis=2))


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
    assert (scene.meshes[0].points.dtype == np.float32) is not fine


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
    meshes = [
        TriMesh.of_part(np.stack([x, y, z], axis=2).reshape(-1, 3), faces, OTHER) for z in heights
    ]
    return scene_of(meshes, [pose(), pose()], [0, 1])


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
    scene = scene_of([mesh], [pose(), pose(30 * np.eye(3), (28, 0, 0))])
    way = np.column_stack([np.ones(count), rng.uniform(-0.3, 0.3, (count, 2))])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    start = np.column_stack([np.zeros(count), rng.uniform(-0.8, 0.8, (count, 2))]) - before * way
    assert (EmbreeCaster(scene).cast(start, way).instance == 0).all()


# ------------------------------------------------------------------------------------------ engines
# Which engine casts: chosen, found wherever Blender keeps it, refused when it is not to be trusted.

TRIAL = casters._trial_scene()


@pytest.fixture
def tried_anew():
    """Load and try the library again in each test, and after the last."""
    for known in (embree_library.load, casters.embree_problem):
        known.cache_clear()
    yield
    for known in (embree_library.load, casters.embree_problem):
        known.cache_clear()


@pytest.mark.usefixtures("tried_anew")
def test_settings_choose_the_engine():
    assert make_caster(TRIAL, Rays()).engine == "embree"
    assert make_caster(TRIAL, Rays(engine="embree", threads=3)).threads == 3
    assert make_caster(TRIAL, Rays(engine="bvhtree")).engine == "bvhtree"


@pytest.mark.usefixtures("tried_anew")
def test_without_the_library_auto_falls_back_and_embree_says_why(monkeypatch):
    monkeypatch.setattr(embree_library, "_places", lambda: iter(["no-such-library.so"]))
    assert make_caster(TRIAL, Rays()).engine == "bvhtree"
    with pytest.raises(ValueError, match="no Embree 4 beside Blender") as error:
        make_caster(TRIAL, Rays(engine="embree"))
    assert "no-such-library.so" in str(error.value)


@pytest.mark.usefixtures("tried_anew")
def test_a_library_that_is_no_embree_is_passed_over(monkeypatch):
    other = sys.modules["_ctypes"].__file__
    if other is None:
        pytest.skip("ctypes is built in here")
    places = [other, *embree_library._places()]
    monkeypatch.setattr(embree_library, "_places", lambda: iter(places))
    assert make_caster(TRIAL, Rays()).engine == "embree"


@pytest.mark.usefixtures("tried_anew")
def test_another_version_is_refused(monkeypatch):
    monkeypatch.setattr(embree_library, "VERSION_PROPERTY", 1)  # its major number alone: 4
    assert make_caster(TRIAL, Rays()).engine == "bvhtree"
    assert "version 0, not 4" in casters.embree_problem()


@pytest.mark.usefixtures("tried_anew")
def test_an_engine_that_finds_something_else_is_not_trusted(monkeypatch):
    def wrong(self, origins, directions, *limits, **more):
        return Hits.misses(len(np.asarray(origins)))

    monkeypatch.setattr(EmbreeCaster, "cast", wrong)
    assert make_caster(TRIAL, Rays()).engine == "bvhtree"
    assert casters.embree_problem() == "it does not find what is there"


@pytest.mark.usefixtures("tried_anew")
@pytest.mark.skipif(sys.platform != "linux", reason="the layout of official builds for Linux")
@pytest.mark.parametrize("folder", ["lib", "blender.shared", "."])
def test_the_library_is_found_in_every_layout(tmp_path, monkeypatch, folder):
    here = Path(next(embree_library._places()))
    assert here.name.startswith("libembree4.so")
    place = tmp_path / folder
    place.mkdir(exist_ok=True)
    shutil.copy(here, place)
    monkeypatch.setattr(
        embree_library.bpy.utils, "resource_path", lambda kind: str(tmp_path / "5.2")
    )
    assert Path(next(embree_library._places())).resolve() == (place / here.name).resolve()


@pytest.mark.usefixtures("tried_anew")
def test_the_engines_share_one_search():
    rays = (TRIAL.transform[:, :, 3] - [0, 0, 5.0], np.tile([0.01, 0.02, 1.0], (3, 1)))
    first, second = (engine(TRIAL).cast(*rays) for engine in (BvhCaster, EmbreeCaster))
    assert first.found.any()
    assert (first.distance == second.distance).all()
