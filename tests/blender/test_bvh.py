"""The BVHTree caster against float64 brute force, and on the hard rays of the list in DESIGN."""

import numpy as np
import pytest

pytest.importorskip("bpy")

from references.rays_brute import BruteCaster

from forest_addon.blender.bvh import BvhCaster
from forest_addon.growth.trimesh import LEAF, OTHER, TriMesh, join
from forest_addon.growth.tubes import tube
from forest_addon.rng import stream
from forest_addon.sensing.geometry import SceneGeometry

BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
BOX_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


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


@pytest.mark.parametrize("count", [1, 3, 40])
def test_equals_brute_force_on_random_rays(count):
    scene = forest(count)
    origins, directions = random_rays(4000)
    aimed = scene.transform[np.arange(4000) % count, :, 3] + stream(5, "aim").normal(
        0, 1, (4000, 3)
    )
    directions[::2] = (aimed - origins)[::2]
    ours = BvhCaster(scene).cast(origins, directions, np.inf)
    exact = BruteCaster(scene).cast(origins, directions, np.inf)
    assert exact.found.sum() > 100
    assert (ours.found == exact.found).mean() > 0.999
    same = (ours.instance == exact.instance) & (ours.triangle == exact.triangle) & exact.found
    assert same.sum() / exact.found.sum() > 0.999  # the rest graze an edge
    assert np.abs(ours.distance[same] - exact.distance[same]).max() < 1e-9


def test_utm_offset_loses_nothing():
    near, far = forest(5), forest(5, far=5e5)
    origins, directions = random_rays(3000)
    a = BvhCaster(near).cast(origins, directions, np.inf)
    b = BvhCaster(far).cast(origins + 5e5, directions, np.inf)
    assert (a.found == b.found).mean() > 0.999
    both = (a.triangle == b.triangle) & a.found & b.found
    assert both.sum() / a.found.sum() > 0.999
    # 5e5 m in float64 is spaced by 6e-11 m; a grazing plane multiplies that.
    assert np.quantile(np.abs(a.distance[both] - b.distance[both]), 0.99) < 1e-8


def test_no_leak_through_edges_and_vertices_of_a_closed_mesh():
    rng = stream(3, "edges")
    caster = BvhCaster(scene_of([box()], [pose(np.diag([2.0, 3.0, 1.0]), (5, -2, 7))]))
    share = rng.random((20_000, 1))
    edge = BOX_FACES[rng.integers(12, size=20_000)]
    target = BOX[edge[:, 0]] * share + BOX[edge[:, 1]] * (1 - share)
    target[:2000] = BOX[rng.integers(8, size=2000)]
    target = target * [2, 3, 1] + [5, -2, 7]
    middle = np.array([6.0, -0.5, 7.5])
    assert caster.cast(np.broadcast_to(middle, target.shape), target - middle, np.inf).found.all()


@pytest.mark.parametrize("direction", [(0, 0, 0), (np.nan, 0, 1), (np.inf, 0, 0), (0, 0, -np.inf)])
def test_impossible_directions_hit_nothing(direction):
    caster = BvhCaster(scene_of([box()], [pose()]))
    hits = caster.cast(np.array([[0.5, 0.5, 0.5]]), np.array([direction], float), np.inf)
    assert hits.distance[0] == np.inf
    assert hits.instance[0] == hits.triangle[0] == -1


@pytest.mark.parametrize("length", [1e-20, 1.0, 1e30, 1e-300])
def test_the_length_of_a_direction_does_not_matter(length):
    caster = BvhCaster(scene_of([box()], [pose()]))
    hits = caster.cast(np.array([[0.3, 0.4, -2.0]]), np.array([[0, 0, length]]), np.inf)
    assert hits.distance[0] == pytest.approx(2.0, abs=1e-12)


def test_the_limit_is_inclusive():
    caster = BvhCaster(scene_of([box()], [pose()]))
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
def test_instance_matrices_of_every_kind(linear):
    scene = scene_of([box()], [pose(linear, (1, 2, 3))])
    rng = stream(8, "matrix")
    target = rng.random((500, 3)) @ linear.T + [1, 2, 3]
    origins = target + rng.normal(size=(500, 3)) * np.abs(linear).max() * 3
    ours = BvhCaster(scene).cast(origins, target - origins, np.inf)
    exact = BruteCaster(scene).cast(origins, target - origins, np.inf)
    assert ours.found.all()
    assert np.allclose(ours.distance, exact.distance, rtol=1e-9, atol=1e-9 * np.abs(linear).max())


@pytest.mark.parametrize(
    "linear", [np.zeros((3, 3)), np.diag([1.0, 1, 0]), np.full((3, 3), np.nan)]
)
def test_an_instance_without_volume_is_met_by_nothing_and_harms_no_other(linear):
    scene = scene_of([box()], [pose(linear), pose(shift=(0, 0, 5))])
    hits = BvhCaster(scene).cast(np.array([[0.3, 0.4, -2.0]]), np.array([[0, 0, 1.0]]), np.inf)
    assert hits.instance[0] == 1
    assert hits.distance[0] == pytest.approx(7.0)


def test_degenerate_and_nan_geometry_harms_no_other():
    broken = TriMesh.of_part(
        np.concatenate([BOX, [[np.nan, 0, 0], [0.5, 0.5, -1], [0.5, 0.5, -1]]]),
        np.concatenate([[[8, 0, 1], [9, 10, 9], [0, 0, 0]], BOX_FACES]),
        OTHER,
    )
    scene = scene_of([broken], [pose()])
    hits = BvhCaster(scene).cast(np.array([[0.3, 0.4, -2.0]]), np.array([[0, 0, 1.0]]), np.inf)
    assert hits.distance[0] == pytest.approx(2.0)
    assert hits.triangle[0] >= 3


def test_thin_twig_far_away():
    twig = TriMesh.of_part(*tube(np.array([[0, 0, 0], [0, 0, 1.0]]), np.full(2, 0.0005), 8), OTHER)
    scene = scene_of([twig], [pose(shift=(100.0, 0, 0))])
    y = np.linspace(-0.00045, 0.00045, 200)
    target = np.stack([np.full(200, 100.0), y, np.full(200, 0.5)], axis=1)
    hits = BvhCaster(scene).cast(np.zeros((200, 3)), target, np.inf)
    assert hits.found.all()
    assert np.abs(hits.distance - 100).max() < 0.002


def test_grazing_rays_keep_their_distance():
    wide = BOX * [400, 2, 1] - [0, 1, 1]  # top face at z = 0
    scene = scene_of([TriMesh.of_part(wide, BOX_FACES, OTHER)], [pose()])
    start = np.array([[0.0, 0.013, 195 * np.sin(np.deg2rad(0.5))]])
    way = np.array([[np.cos(np.deg2rad(0.5)), 0, -np.sin(np.deg2rad(0.5))]])
    hits = BvhCaster(scene).cast(start, way, np.inf)
    assert hits.distance[0] == pytest.approx(195.0, abs=1e-9)


def test_nothing_to_hit():
    empty = TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), OTHER)
    for scene in (scene_of([], np.empty((0, 3, 4))), scene_of([empty], [pose()])):
        assert not BvhCaster(scene).cast(*random_rays(10), np.inf).found.any()
    assert len(BvhCaster(forest(2)).cast(np.empty((0, 3)), np.empty((0, 3)), np.inf).distance) == 0


def test_order_and_grouping_of_rays_do_not_matter():
    scene = forest(12)
    origins, directions = random_rays(3000)
    caster = BvhCaster(scene)
    whole = caster.cast(origins, directions, np.inf)
    order = stream(2, "order").permutation(3000)
    parts = [caster.cast(origins[o], directions[o], np.inf) for o in np.array_split(order, 7)]
    assert (np.concatenate([p.distance for p in parts]) == whole.distance[order]).all()
    assert (np.concatenate([p.triangle for p in parts]) == whole.triangle[order]).all()
