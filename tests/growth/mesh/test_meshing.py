"""Meshes of whole skeletons against closed forms of cones and cylinders, and against plain tubes. Tubes
against the closed forms of cylinders and cones. Bark in relief: closed, of the same area and volume, as
deep and as oval as asked, and off unless asked. Stand-ins of trees: few triangles that stand where the
tree stands, with its trunk and its crown.
"""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, OTHER, WOOD, TriMesh
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.meshing import Relief, mesh_wood, sides_for, sides_of, tube
from forest_addon.growth.mesh.stand_in import LEVELS, level_for, stand_in
from forest_addon.growth.skeleton import Skeleton, find_axes, first_level
from forest_addon.growth.tree import grow, with_tolerance
from forest_addon.spec import Accuracy, Bark, Detail, Grammar, Planting, Scene, Species
from forest_addon.stand.forest import grow_forest

STEM = Skeleton(
    np.array([[0, 0, 0.0], [0, 0, 2]]),
    np.array([[0, 0, 2.0], [0, 0, 4]]),
    np.array([[0.2, 0.18], [0.18, 0.16]]),
    np.array([-1, 0]),
    np.array([0, 0]),
    np.array([0, 1]),
)
TEXTURES = ("cracked", "smooth", "furrowed", "plated", "peeling")
NOTHING = Skeleton(
    *(np.empty(shape) for shape in ((0, 3), (0, 3), (0, 2))),
    *(np.empty(0, np.int64) for _ in range(3)),
)


def skeleton(start, end, radius, parent, order):
    start, end = np.asarray(start, float), np.asarray(end, float)
    count = len(start)
    radius = np.broadcast_to(np.asarray(radius, float), (count, 2)).copy()
    parent = np.asarray(parent, np.int64)
    return Skeleton(start, end, radius, parent, np.asarray(order, np.int64), np.arange(count))


def chain(points, radius):
    """One axis through points (P, 3) with radii (P,)."""
    points, radius = np.asarray(points, float), np.asarray(radius, float)
    count = len(points) - 1
    return skeleton(
        points[:-1],
        points[1:],
        np.stack([radius[:-1], radius[1:]], 1),
        np.arange(-1, count - 1),
        np.zeros(count),
    )


def random_tree(rng, count=400):
    """A bushy random skeleton: every segment starts at the end of an earlier one, or on it."""
    start, end = np.zeros((count, 3)), np.zeros((count, 3))
    parent, order = np.full(count, -1), np.zeros(count, np.int64)
    radius = np.full((count, 2), 0.2)
    end[0] = (0, 0, 1)
    continued = np.zeros(count, bool)
    for s in range(1, count):
        bearer = int(rng.integers(max(0, s - 30), s))
        parent[s] = bearer
        onward = not continued[bearer] and rng.random() < 0.7
        continued[bearer] |= onward
        order[s] = order[bearer] + (not onward)
        share = 1.0 if onward or rng.random() < 0.5 else rng.random()
        start[s] = start[bearer] + share * (end[bearer] - start[bearer])
        way = end[bearer] - start[bearer] + rng.normal(size=3) * (0.1 if onward else 0.6)
        end[s] = start[s] + way / np.linalg.norm(way) * rng.uniform(0.05, 0.4)
        radius[s, 0] = radius[bearer, 1] * (1.0 if onward else rng.uniform(0.5, 1.1))
        radius[s, 1] = radius[s, 0] * rng.uniform(0.8, 1)
    return Skeleton(start, end, radius, parent, order, np.arange(count))


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ti,ti->", a, np.cross(b, c)) / 6)


def area(mesh):
    return float(np.linalg.norm(mesh.area_vectors(), axis=1).sum())


def assert_watertight(mesh):
    """Every edge is used once in each direction: closed, and wound alike."""
    count = len(mesh.vertices)
    ahead = mesh.triangles[:, [0, 1, 2]].astype(np.int64).ravel()
    after = mesh.triangles[:, [1, 2, 0]].astype(np.int64).ravel()
    keys, times = np.unique(ahead * count + after, return_counts=True)
    assert (times == 1).all()
    assert np.array_equal(keys, np.unique(after * count + ahead))


BENT = np.cumsum(np.random.default_rng(3).normal(size=(12, 3)) * 0.2 + [0, 0, 1.0], axis=0)


@pytest.mark.parametrize(
    ("points", "radius", "tolerance"),
    [([[0, 0, 0], [0, 0, 2.5]], 0.2, 0.001), (BENT, 0.05, 0.0002)],
    ids=["straight", "bent"],
)
def test_cylinder_has_the_area_and_volume_of_its_prism(points, radius, tolerance):
    """Rings are as long as their circle, and mitred: a bent tube too has its volume exactly."""
    mesh = mesh_wood(chain(points, np.full(len(points), radius)), tolerance)
    n = int(sides_of(np.array([radius]), tolerance)[0])
    widened = radius * np.pi / (n * np.sin(np.pi / n))
    cap = n / 2 * widened**2 * np.sin(2 * np.pi / n)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert volume(mesh) == pytest.approx(cap * length, rel=1e-9)  # positive: outward facing
    side = area(mesh) - 2 * cap
    assert side == pytest.approx(
        2 * np.pi * radius * length, rel=1e-12 if len(points) == 2 else 0.02
    )
    assert_watertight(mesh)
    assert (mesh.part == WOOD).all()
    assert (mesh.leaf == -1).all()
    assert (mesh.order == 0).all()


def test_rings_of_a_plain_tube_are_as_long_as_their_circle():
    ring = tube(np.array([[0, 0, 0], [0, 0, 1.0]]), np.full(2, 0.2), 7)[0][:7]
    sides = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1)
    assert sides.sum() == pytest.approx(2 * np.pi * 0.2)


@pytest.mark.parametrize("tolerance", [0.005, 0.0002])
def test_cone_converges_to_its_closed_form(tolerance):
    mesh = mesh_wood(chain([[0, 0, 0], [1, 2, 2]], [0.3, 0.0]), tolerance)
    assert_watertight(mesh)
    exact = np.pi * 0.3**2 * 3 / 3
    n = int(sides_of(np.array([0.3]), tolerance)[0])
    assert volume(mesh) == pytest.approx(exact, rel=4 / n**2)


def test_no_twist_jumps_along_a_helix_and_a_random_walk():
    t = np.linspace(0, 4 * np.pi, 200)
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.normal(size=(200, 3)) * 0.02 + [0, 0, 0.1], axis=0)
    for points in (np.stack([np.cos(t), np.sin(t), 0.3 * t], axis=1), walk):
        mesh = mesh_wood(chain(points, np.full(200, 0.02)), 1e-5)
        n = int(sides_of(np.array([0.02]), 1e-5)[0])
        rings = mesh.vertices[:-2].reshape(200, n, 3) - points[:, None]
        rings /= np.linalg.norm(rings, axis=2, keepdims=True)
        turn = np.einsum("rki,rki->rk", rings[:-1], rings[1:])
        step = np.diff(points, axis=0)
        step /= np.linalg.norm(step, axis=1, keepdims=True)
        bend = np.einsum("ri,ri->r", step[:-1], step[1:]).min()
        assert turn.min() > np.cos(1.6 * np.arccos(bend)) - 1e-6


def test_every_axis_of_a_tree_is_a_closed_tube():
    tree = random_tree(np.random.default_rng(1))
    mesh = mesh_wood(tree, 0.002, sunk=0.1)
    assert np.isfinite(mesh.vertices).all()
    assert_watertight(mesh)
    assert set(np.unique(mesh.order)) == set(np.unique(tree.order))
    assert mesh.vertices[:, 2].min() < -0.09  # sunk
    euler = len(mesh.vertices) - 3 * len(mesh.triangles) // 2 + len(mesh.triangles)
    assert euler == 2 * len(find_axes(tree))  # as many spheres as axes


def test_axes_follow_equal_orders_and_first_levels_are_counted():
    rng = np.random.default_rng(5)
    tree = random_tree(rng, 120)
    axes = find_axes(tree)
    assert sorted(axes.segment.tolist()) == list(range(120))
    for a in range(len(axes)):
        member = axes.segment[axes.first[a] : axes.first[a + 1]]
        assert len(set(tree.order[member].tolist())) == 1
        assert (tree.parent[member[1:]] == member[:-1]).all()
        np.testing.assert_allclose(tree.start[member[1:]], tree.end[member[:-1]], atol=1e-6)
    number = first_level(tree)
    for s in range(120):
        up = s
        while tree.order[up] > 1 or (tree.order[up] == 1 and tree.order[tree.parent[up]] == 1):
            up = int(tree.parent[up])
        if tree.order[up] == 0:
            assert number[s] == -1
        else:
            firsts = np.flatnonzero((tree.order == 1) & (tree.order[tree.parent] == 0))
            assert firsts[number[s]] == up


def test_a_branch_that_leaves_at_a_fork_starts_within_its_mother():
    """Parent ends at (0,0,2); two children leave at 40°: their feet are inside her, below the fork."""
    way = np.array([[np.sin(0.7), 0, np.cos(0.7)], [-np.sin(0.7), 0, np.cos(0.7)]])
    tip = np.array([0, 0, 2.0])
    tree = skeleton([[0, 0, 0], tip, tip], [tip, *(tip + way)], 0.1, [-1, 0, 0], [0, 1, 1])
    mesh = mesh_wood(tree, 0.001)
    assert_watertight(mesh)
    inside = mesh.vertices[np.unique(mesh.triangles[mesh.order == 1])]
    low = inside[inside[:, 2] < 1.92]
    assert len(low)
    assert np.hypot(low[:, 0], low[:, 1]).max() < 0.1
    # no gap: around the fork every direction across the bisecting wedge meets wood
    widest = inside[np.abs(inside[:, 2] - 2.0) < 0.08]
    assert np.hypot(widest[:, 0], widest[:, 1]).max() >= 0.1 - 1e-3


def test_s_internodes_step_from_cylinder_to_cylinder():
    """Radii that jump at a node: two rings there, and the volume is the sum of the cylinders'."""
    tree = skeleton(
        [[0, 0, 0], [0, 0, 1]], [[0, 0, 1], [0, 0, 2]], [[0.2, 0.2], [0.1, 0.1]], [-1, 0], [0, 0]
    )
    mesh = mesh_wood(tree, 1e-4)
    assert_watertight(mesh)
    assert volume(mesh) == pytest.approx(np.pi * (0.04 + 0.01), rel=2e-3)


def test_rings_in_line_are_left_out_within_the_tolerance():
    points = np.stack([np.zeros(101), np.zeros(101), np.linspace(0, 10, 101)], 1)
    straight = mesh_wood(chain(points, np.linspace(0.2, 0.1, 101)), 0.001)
    assert len(straight.triangles) < 200
    assert volume(straight) == pytest.approx(np.pi * 10 / 3 * (0.04 + 0.01 + 0.02), rel=0.02)
    t = np.linspace(0, 1, 2001)
    arc = np.stack([10 * np.cos(t), 10 * np.sin(t), 0 * t], 1)
    coarse = mesh_wood(chain(arc, np.full(2001, 0.01)), 0.002)
    assert len(coarse.triangles) < 2001
    middle = np.hypot(coarse.vertices[:, 0], coarse.vertices[:, 1])
    assert np.abs(middle - 10).max() < 0.0145 + 0.002


def test_hard_skeletons():
    nothing = skeleton(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 2)), [], [])
    assert len(mesh_wood(nothing).triangles) == 0
    zero = chain([[0, 0, 0], [0, 0, 1]], [0.0, 0.0])
    assert len(mesh_wood(zero).triangles) == 0
    same = chain([[0, 0, 0], [0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, 2]], np.full(5, 0.1))
    mesh = mesh_wood(same, 0.001)
    assert np.isfinite(mesh.vertices).all()
    assert_watertight(mesh)
    back = chain([[0, 0, 0], [0, 0, 1], [0, 1e-9, 0.2], [0.5, 0, 0.2]], np.full(4, 0.1))
    assert np.isfinite(mesh_wood(back, 0.001).vertices).all()
    # shorter than its parent's radius, and tips of a hundredth of a millimetre
    short = skeleton(
        [[0, 0, 0], [0, 0, 0.5], [0, 0, 0.5]],
        [[0, 0, 1], [0.05, 0, 0.5], [1, 0, 0.6]],
        [[0.2, 0.2], [0.02, 0.02], [5e-5, 1e-5]],
        [-1, 0, 0],
        [0, 1, 1],
    )
    mesh = mesh_wood(short, 0.001)
    assert_watertight(mesh)
    assert np.linalg.norm(mesh.area_vectors(), axis=1).min() > 0


def test_texture_runs_in_metres_along_the_stem():
    mesh = mesh_wood(chain([[0, 0, 0], [0, 0, 2], [0, 1, 3]], [0.4, 0.3, 0.1]), 0.001)
    assert mesh.uv.shape == (len(mesh.triangles), 3, 2)
    assert mesh.uv[..., 1].min() == 0
    assert mesh.uv[..., 1].max() == pytest.approx(2 + np.sqrt(2), rel=1e-6)
    assert mesh.uv[..., 0].max() == pytest.approx(round(2 * np.pi * 0.4), rel=1e-6)
    flat = mesh.vertices[mesh.triangles][..., 2]
    below = flat < 1e-9
    np.testing.assert_allclose(mesh.uv[..., 1][below], 0, atol=1e-6)


@pytest.mark.parametrize(("radius", "tolerance"), [(0.2, 0.001), (0.05, 0.002), (0.5, 0.0005)])
def test_sides_keep_the_tolerance(radius, tolerance):
    n = sides_for(radius, tolerance)
    assert radius * (1 - np.cos(np.pi / n)) <= tolerance or n == 64
    assert radius * (1 - np.cos(np.pi / (n - 1))) > tolerance
    assert sides_for(tolerance / 4, tolerance) == 3


def rings(mesh, height, within=0.004):
    """Radii and angles of vertices near a height."""
    near = mesh.vertices[np.abs(mesh.vertices[:, 2] - height) < within]
    near = near[np.hypot(near[:, 0], near[:, 1]) > 0.01]
    return np.hypot(near[:, 0], near[:, 1]), np.arctan2(near[:, 1], near[:, 0])


@pytest.mark.medium
@pytest.mark.parametrize("texture", TEXTURES)
def test_a_stem_in_relief_is_closed_and_keeps_its_volume(texture):
    relief = Relief(texture, 0.05, 0.02, 0.06, 1.0, seed=3)
    mesh = mesh_wood(STEM, 0.002, relief=relief)
    assert_watertight(mesh)
    length = 2.0
    exact = sum(
        np.pi * length / 3 * (a * a + a * b + b * b) for a, b in ((0.2, 0.18), (0.18, 0.16))
    )
    assert volume(mesh) == pytest.approx(exact, rel=0.01)
    assert np.linalg.norm(mesh.area_vectors(), axis=1).min() > 0
    far = np.abs(
        np.hypot(*mesh.vertices[:, :2].T) - np.interp(mesh.vertices[:, 2], [0, 4], [0.2, 0.16])
    )
    on_axis = np.hypot(*mesh.vertices[:, :2].T) < 1e-9
    assert far[~on_axis].max() < relief.most(0.2)
    again = mesh_wood(STEM, 0.002, relief=relief)
    assert np.array_equal(again.vertices, mesh.vertices)


def test_ovality_is_the_spread_of_diameters():
    """The caliper widths of an oval ring: (largest - smallest) / mean, of harmonics 2 to 4."""
    mesh = mesh_wood(STEM, 0.002, relief=Relief("smooth", 0.05, 0.0, 0.08, 1.0, seed=1))
    height = mesh.vertices[len(mesh.vertices) // 2, 2]
    radius, angle = rings(mesh, height)
    turn = np.pi * np.arange(180) / 180
    points = radius[:, None] * np.exp(1j * angle[:, None])
    width = [np.ptp((points * np.exp(-1j * t)).real) for t in turn]
    assert (max(width) - min(width)) / np.mean(width) == pytest.approx(0.08, abs=0.015)


@pytest.mark.parametrize("depth", [0.01, 0.03])
def test_furrows_are_as_deep_as_asked(depth):
    relief = Relief("plated", 0.06, depth, 0.0, 1.0, seed=2)
    factor = relief.factor(128, np.full(200, 0.2), np.linspace(0, 2, 200), 0, False)
    low, high = np.percentile(0.2 * factor, [1, 99])
    assert high - low == pytest.approx(depth, rel=0.2)
    assert np.mean(factor * np.roll(factor, 1, axis=1), axis=1) == pytest.approx(1, abs=1e-12)
    thin = relief.factor(64, np.full(200, 0.06), np.linspace(0, 2, 200), 0, False)
    low, high = np.percentile(0.06 * thin, [1, 99])
    assert high - low == pytest.approx(depth / 2, rel=0.25)  # a thin stem has shallower ones


def test_a_stem_in_relief_stands_on_roots():
    """At the ground the outline is that of a few roots; above them, and in area everywhere, the cone's."""
    relief = Relief("smooth", 0.05, 0.0, 0.0, 1.0, seed=1, roots=1.5)
    up = np.linspace(0, 2, 200)
    factor = relief.factor(256, np.full(200, 0.2), up, 0, True)
    peaks = (factor > np.roll(factor, 1, axis=1)) & (factor > np.roll(factor, -1, axis=1))
    assert 4 <= peaks[0].sum() <= 6
    assert factor[0].max() > 1.3 > 0.9 > factor[0].min()
    assert factor[up >= relief.highest(0.2)] == pytest.approx(1, abs=1e-12)
    assert np.mean(factor * np.roll(factor, 1, axis=1), axis=1) == pytest.approx(1, abs=1e-12)
    limb = relief.factor(256, np.full(200, 0.2), up, 0, False)
    assert limb == pytest.approx(1, abs=1e-12)


def test_there_is_none_unless_a_species_asks():
    plain = Species(name="plain", grammar=Grammar(generations=3, radius=0.1))
    rough = plain.changed(detail=Detail(relief=True), bark=Bark(texture="furrowed", relief=0.02))
    smooth, tree = (grow(kind, None, stream(1, "relief")) for kind in (plain, rough))
    assert smooth.relief is None
    assert np.array_equal(tree.skeleton.end, smooth.skeleton.end)
    assert np.array_equal(tree.leaves.centre, smooth.leaves.centre)
    assert len(tree.mesh.vertices) > 2 * len(smooth.mesh.vertices)
    coarse = with_tolerance(tree, 0.02)
    radius, _ = rings(coarse.mesh, 1.0, 0.02)
    assert np.ptp(radius) > 0.008  # it stays at a coarser tolerance


def test_a_scene_asks_for_relief_of_all_its_species():
    rough = Species(name="rough", grammar=Grammar(generations=3, radius=0.1))
    planting = Planting(species="rough", layout="rows", variants=1)
    forests = [
        grow_forest(Scene(plantings=(planting,), accuracy=Accuracy(relief=on)), [(rough, None)])
        for on in (False, True)
    ]
    smooth, bark = (next(iter(forest.variants.values())) for forest in forests)
    assert smooth.relief is None
    assert bark.relief is not None
    assert np.array_equal(forests[0].stand.position, forests[1].stand.position)


def sky(mesh, places):
    """The share of level rays at places (N, 2) that meet no leaf, from one side: by brute force."""
    corners = mesh.vertices[:, 1:][mesh.triangles[mesh.part == LEAF]]  # seen along x
    least, most = (np.ascontiguousarray(end(corners, axis=1).T) for end in (np.min, np.max))
    met = []
    for y, z in places:
        rows = np.flatnonzero((least[0] <= y) & (y <= most[0]))
        rows = rows[(least[1][rows] <= z) & (z <= most[1][rows])]
        a, b, c = (corners[rows, k] - (y, z) for k in range(3))
        turns = np.stack(
            [u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] for u, v in ((a, b), (b, c), (c, a))]
        )
        met.append(((turns >= 0).all(axis=0) | (turns <= 0).all(axis=0)).any())
    return 1 - np.mean(met)


@pytest.mark.slow
@pytest.mark.parametrize("species", ["silver-birch", "apple-leafless"])
def test_a_stand_in_is_its_tree_at_a_glance(species):
    tree = grow(*load_species(find_species(species, Path())), stream(2, "outline"))
    leaves = tree.mesh.vertices[tree.mesh.triangles[tree.mesh.part == LEAF].ravel()]
    places, true = None, 1.0
    if len(leaves):
        middle, half = leaves[:, 1:].mean(axis=0), 1.2 * leaves[:, 1:].std(axis=0)
        places = np.random.default_rng(1).uniform(middle - half, middle + half, (40, 2))
        true = sky(tree.mesh, places)
    for number, level in enumerate(LEVELS):
        rough = looks_like(tree, leaves, level, 1.0 + 0.5 * number)
        if len(leaves):  # sky through the crown, of 1
            assert abs(true - sky(rough, places)) < (0.22 if level is LEVELS[0] else 0.3)


def looks_like(tree, leaves, level, slack):
    """Hold a stand-in to its tree, a coarse one less strictly; returns it."""
    mesh, rough = tree.mesh, stand_in(tree.mesh, tree.skeleton, level)
    assert level.most / 10 < len(rough.triangles) <= level.most
    assert np.isfinite(rough.vertices).all()
    assert ((rough.material == 1) == (rough.part == LEAF)).all()
    top = mesh.vertices[:, 2].max()
    assert rough.vertices[:, 2].max() == pytest.approx(top, rel=0.12 * slack)
    wood = rough.vertices[rough.triangles[rough.part == WOOD].ravel()]
    low = np.abs(wood[:, 2] - 0.05 * top) < 0.06 * top  # the trunk stands at the foot, as thick
    assert np.linalg.norm(wood[low][:, :2].mean(axis=0)) < 0.05 * top
    assert (rough.part == LEAF).any() == bool(len(leaves))
    if not len(leaves):
        return rough
    cards = rough.vertices[rough.triangles[rough.part == LEAF].ravel()]
    assert np.allclose(cards.mean(axis=0), leaves.mean(axis=0), atol=0.06 * slack * top)
    spread = leaves.std(axis=0)
    assert np.allclose(cards.std(axis=0), spread, rtol=0.25 * slack, atol=0.02 * top)
    return rough


def test_many_trees_have_coarser_stand_ins():
    assert level_for(0, 0) is LEVELS[0]
    assert level_for(250, 125_000) is LEVELS[0]
    for trees in (251, 1001, 20_000, 10**6):
        level = level_for(trees, 125_000)
        finer = LEVELS[: LEVELS.index(level)]
        assert all(trees * better.most > 125_000 for better in finer)
        assert trees * level.most <= 125_000 or level is LEVELS[-1]


def test_what_has_no_skeleton_has_a_trunk_all_the_same():
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    ring = np.column_stack([0.2 * np.cos(angle) + 3, 0.2 * np.sin(angle) - 1])
    heights = np.linspace(0, 6, 13)
    vertices = np.concatenate([np.column_stack([ring, np.full(48, z)]) for z in heights])
    corner = np.arange(48 * 12)
    pole = TriMesh.of_part(vertices, np.column_stack([corner, corner + 1, corner + 48]), WOOD)
    rough = stand_in(pole, NOTHING)
    foot = rough.vertices[rough.vertices[:, 2] < 1e-9]
    foot = foot[np.linalg.norm(foot[:, :2] - [3, -1], axis=1) > 1e-3]  # without the cap's middle
    assert np.abs(np.linalg.norm(foot[:, :2] - [3, -1], axis=1) - 0.2).max() < 0.03
    assert (rough.part == WOOD).all()


@pytest.mark.parametrize(
    "vertices", [np.empty((0, 3)), np.zeros((3, 3)), np.array([[0, 0, -1], [1, 0, -1], [0, 1, -2]])]
)
def test_what_does_not_stand_up_has_no_stand_in(vertices):
    triangles = np.array([[0, 1, 2]]) if len(vertices) else np.empty((0, 3))
    assert len(stand_in(TriMesh.of_part(vertices, triangles, OTHER), NOTHING).triangles) == 0
