"""Rays that go side by side, as packets, against the same rays among others; and faces of no thickness."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

bpy = pytest.importorskip("bpy")

from references.rays import BruteCaster, scene_with

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import OTHER, WOOD, TriMesh
from forest_addon.blender.rays import embree
from forest_addon.blender.rays.bvh import BvhCaster
from forest_addon.blender.rays.casters import make_caster
from forest_addon.blender.rays.embree import EmbreeCaster
from forest_addon.blender.rays.embree_motion import embree_motion
from forest_addon.sensing.lidar.scan import scan
from forest_addon.sensing.moving import MovingScene, moved
from forest_addon.sensing.moving_rays import MovingCaster
from forest_addon.sensing.rays.exact import ExactCaster
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.rays.paths import RigidPath, SceneMotion, ShapePath
from forest_addon.spec import Beam, Rays, Surfaces, Terrestrial

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


@given(seed=st.integers(0, 2**32 - 1))
def test_rays_all_around_a_place_are_met_as_rays_alone(seed):
    """As a flyer's: 0 along an axis or two, or of any sign, which no pyramid holds together."""
    rng = stream(seed, "around")
    scene, count = scene_of(rng), 4000
    place = scene.transform[rng.integers(len(scene)), :, 3] + rng.normal(size=3)
    ways = rng.normal(size=(count, 3)) * (rng.random((count, 3)) < rng.choice([0.5, 0.8, 1.0]))
    origins = place + 10 ** rng.uniform(-9, -0.5) * rng.normal(size=(count, 3))
    caster = EmbreeCaster(scene)
    together = caster.cast(origins, ways)
    caster._described.intersect8 = None
    alone = caster.cast(origins, ways)
    other = together.distance != alone.distance
    other |= (together.triangle != alone.triangle) | (together.instance != alone.instance)
    assert not other.any()


def test_an_embree_without_packets_casts_rays_one_by_one(monkeypatch):
    rng = stream(0, "alone")
    scene = scene_of(rng)
    origins, ways = (rays.reshape(-1, 3) for rays in beams(rng, scene, 500, 8)[:2])
    together = EmbreeCaster(scene).cast(origins, ways).distance
    monkeypatch.setattr(embree, "PACKETS", (1, 65))  # Blender's Embree culls no backs of faces
    without = EmbreeCaster(scene)
    assert not without._described.intersect8
    np.testing.assert_array_equal(without.cast(origins, ways).distance, together)


# -------------------------------------------------------------------------------------- moving rays
# Rays in time against closed forms: a plate that moves and turns.

RATE, SPEED = 1.3, 20.0  # rad/s about Z, m/s along X
SIZE = np.array([2.0, 3.0, 0.5])
ENGINES = [
    lambda moving: MovingCaster(moving, lambda scene: make_caster(scene, Rays())),
    lambda moving: MovingCaster(moving, BvhCaster),
    lambda moving: MovingCaster(moving, ExactCaster),
    embree_motion,
]


def plates(transforms):
    corners = np.array([[0.0, -5, -5], [0, 5, -5], [0, 5, 5], [0, -5, 5]])
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), OTHER)
    count = len(transforms)
    nothing = np.full(count, -1)
    names = tuple("plate" for _ in transforms)
    mesh_index = np.zeros(count, np.int64)
    return SceneGeometry((mesh,), np.array(transforms), mesh_index, names, nothing, nothing)


def turning(time):
    """(K, 3, 4) of a plate that starts 30 m ahead, nears at SPEED and turns at RATE."""
    found = np.zeros((len(time), 3, 4))
    c, s = np.cos(RATE * time), np.sin(RATE * time)
    found[:, 0, 0], found[:, 0, 1], found[:, 1, 0], found[:, 1, 1] = c, -s, s, c
    found[:, 2, 2] = 1.0
    found[:, :, :3] *= SIZE
    found[:, 0, 3] = 30.0 - SPEED * time
    return found


@pytest.mark.parametrize("make", ENGINES)
def test_ranges_of_a_turning_plate_are_those_of_the_closed_form(make):
    samples = np.linspace(0, 1, 25)
    path = RigidPath(samples, turning(samples))
    wall = np.eye(3, 4)
    wall[0, 3] = 50.0
    scene = plates([wall, turning(np.zeros(1))[0]])
    caster = make(MovingScene(scene, SceneMotion({1: path})))
    rng = np.random.default_rng(5)
    time = rng.uniform(0, 1, 4000)
    way = np.column_stack([np.ones(4000), rng.uniform(-0.09, 0.09, (4000, 2))])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    origins = np.zeros((4000, 3))
    hits = caster.cast(origins, way, time=time)
    normal = np.column_stack([np.cos(RATE * time), np.sin(RATE * time), np.zeros(4000)])
    place = 30.0 - SPEED * time
    distance = place * normal[:, 0] / (way * normal).sum(axis=1)
    point = distance[:, None] * way - np.column_stack([place, 0 * time, 0 * time])
    across = -np.sin(RATE * time) * point[:, 0] + np.cos(RATE * time) * point[:, 1]
    meets = (np.abs(across) < 15) & (np.abs(point[:, 2]) < 2.5) & (distance > 0)
    assert (~meets).any()
    assert meets.sum() > 500
    np.testing.assert_array_equal(hits.instance, np.where(meets, 1, 0))
    expected = np.where(meets, distance, 50.0 / way[:, 0])
    np.testing.assert_allclose(hits.distance, expected, rtol=0, atol=1e-9)
    behind = caster.cast(origins, way, time=time, min_distance=hits.distance, leaving=hits)
    np.testing.assert_array_equal(behind.instance, np.where(meets, 0, -1))


def test_velocity_is_that_of_a_turning_body():
    samples = np.linspace(0, 1, 25)
    path = RigidPath(samples, turning(samples))
    rng = np.random.default_rng(6)
    time, own = rng.uniform(0, 1, 500), rng.normal(size=(500, 3))
    arm = np.einsum("rij,rj->ri", turning(time)[:, :, :3], own)
    expected = np.cross([0, 0, RATE], arm) + np.array([-SPEED, 0, 0])
    got = moved(path.rate(time), own)
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-10)
    assert not path.rate(time + 2).any()


def test_velocity_of_what_speeds_up_is_that_at_the_time():
    """Against closed forms: the mean of a step is off by half of what it speeds up meanwhile, 0.04 m/s."""
    samples, spin = np.linspace(0, 1, 97), 3.0

    def at(time):
        angle = spin * time**2
        found = np.zeros((len(time), 3, 4))
        found[:, 0, 0] = found[:, 1, 1] = np.cos(angle)
        found[:, 1, 0] = np.sin(angle)
        found[:, 0, 1] = -found[:, 1, 0]
        found[:, 2, 2] = 1.0
        found[:, :, 3] = np.column_stack([4 * time**3, np.sin(3 * time), time])
        return found

    path = RigidPath(samples, at(samples))
    rng = np.random.default_rng(6)
    time, own = rng.uniform(0, 1, 500), rng.normal(size=(500, 3))
    arm = np.einsum("rij,rj->ri", at(time)[:, :, :3], own)
    turning = np.zeros((500, 3))
    turning[:, 2] = 2 * spin * time
    expected = np.cross(turning, arm)
    expected += np.column_stack([12 * time**2, 3 * np.cos(3 * time), np.ones(500)])
    assert np.abs(moved(path.rate(time), own) - expected).max() < 2e-3


def test_velocity_carries_nothing_over_where_a_motion_breaks():
    samples = np.linspace(0, 1, 25)
    place = np.abs(samples - samples[9])
    transform = np.tile(np.eye(3, 4), (25, 1, 1))
    transform[:, 0, 3] = place
    time = np.random.default_rng(8).uniform(0, 1, 300)
    got = RigidPath(samples, transform).rate(time)[:, :, 3]
    np.testing.assert_allclose(got[:, 0], np.sign(time - samples[9]), rtol=1e-12)


def test_vertices_that_speed_up_have_the_speed_of_the_time():
    samples = np.linspace(0, 1, 49)
    vertices = np.stack([samples**2, samples, 0 * samples], axis=1)[:, None, :]
    time = np.random.default_rng(9).uniform(0, 1, 200)
    got = ShapePath(samples, vertices).velocity(np.zeros((200, 1), int), time)[:, 0]
    np.testing.assert_allclose(got[:, 0], 2 * time, atol=1e-9)
    np.testing.assert_allclose(got[:, 1], 1.0, atol=1e-9)


def test_a_mirrored_part_keeps_its_samples():
    rng = np.random.default_rng(7)
    transform = np.concatenate([turning(np.linspace(0, 1, 5)), rng.normal(size=(5, 3, 4))])
    transform[2, :, 0] *= -1
    path = RigidPath(np.arange(10.0), transform)
    np.testing.assert_allclose(path.at(np.arange(10.0)), transform, atol=1e-12)


def test_a_part_never_leaves_the_box_it_sweeps():
    """Turns by up to 2 rad a sample, shears, an origin far off: its points lie within; it is not loose."""
    rng = np.random.default_rng(8)
    for step in (0.02, 0.5, 2.0):
        axis = rng.normal(size=3)
        turn = Rotation.from_rotvec(np.outer(step * np.arange(6), axis / np.linalg.norm(axis)))
        shear = 0.1 * rng.normal(size=(6, 3, 3))
        shape = np.eye(3) + shear + shear.transpose(0, 2, 1)
        matrix = np.concatenate([turn.as_matrix() @ shape, rng.normal(size=(6, 3, 1))], axis=2)
        path = RigidPath(np.arange(6.0), matrix)
        own = rng.uniform(-1, 1, (20_000, 3)) * (1, 0.2, 3) + (4, 0, -2)
        low, high = path.swept(own.min(axis=0), own.max(axis=0))
        at = path.at(rng.uniform(0, 5, len(own)))
        place = np.einsum("rij,rj->ri", at[:, :, :3], own) + at[:, :, 3]
        assert (place > low).all()
        assert (place < high).all()
        if step == 0.02:
            assert (high - low < 1.6 * np.ptp(place, axis=0)).all()


# -------------------------------------------------------------------------------- bounces by engines
# Bounces by Blender's engines: what brute force finds, and a whole .blend with a mirror.


def quads(seed, count=40, part=OTHER):
    """Squares of 1 to 4 m about the origin, 5 to 20 m away, turned at random."""
    rng = np.random.default_rng(seed)
    corners, faces = [], []
    for k in range(count):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        centre = turn[0] * rng.uniform(5, 20)
        u, v = (np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(1, 4))[:2]
        corners += [centre, centre + u, centre + u + v, centre + v]
        faces += [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]
    return TriMesh.of_part(np.array(corners), np.array(faces), part)


@pytest.mark.medium
@pytest.mark.parametrize("engine", [BvhCaster, EmbreeCaster], ids=["bvhtree", "embree"])
def test_both_engines_find_what_brute_force_finds(engine):
    scene = scene_with(quads(1, 15), quads(2, 15), quads(3, 15), quads(4, 150, WOOD))
    optics = np.full((4, 4), np.nan)
    optics[:3, 0], optics[:3, 3] = (0, 1, 2), 0.1
    scene = type(scene)(**vars(scene) | {"optics": optics})
    sees = Terrestrial(
        position=(0, 0, 0),
        angle_step_deg=5,
        max_range=60,
        bounces=True,
        surfaces=Surfaces(other=0.0),
        beam=Beam(subrays=3, divergence_mrad=(1.0, 1.0), max_returns=15),
    )
    ours, right = (scan(sees, make(scene)) for make in (engine, BruteCaster))
    assert set(right.bounce.tolist()) == {0, 1, 2, 3}
    assert right.unfollowed == ours.unfollowed > 5
    assert np.array_equal(ours.bounce, right.bounce)
    assert np.array_equal(ours.pulse, right.pulse)
    assert ours.true_range == pytest.approx(right.true_range, abs=1e-9)
    assert ours.intensity == pytest.approx(right.intensity, rel=1e-7)
