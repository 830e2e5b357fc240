"""Scans of trees in the wind: where pulses meet them, held to the trees' own motion."""

import gc
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

bpy = pytest.importorskip("bpy")

from references.scenes import hide, keyed

from forest_addon import api as forest
from forest_addon.base.trimesh import WOOD, TriMesh
from forest_addon.base.vectors import beside_segments
from forest_addon.blender.files.export import bake
from forest_addon.blender.rays.bvh import BvhCaster
from forest_addon.blender.rays.embree_motion import SwayingPieces, embree_motion
from forest_addon.blender.scene import layout
from forest_addon.blender.scene.instances import TREE_KEY
from forest_addon.blender.scene.meshes import from_mesh
from forest_addon.blender.scene.nodes import show_as
from forest_addon.blender.scene.placing import hide_wind, is_wind, wind_home
from forest_addon.blender.show.wind import show_wind
from forest_addon.growth.sway.shape import _nearest
from forest_addon.sensing.moving import KNOTS, WINDOWS, MovingScene, split_pieces
from forest_addon.sensing.moving_rays import MovingCaster, exactly
from forest_addon.sensing.rays.exact import ExactCaster, Referee
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.stand.wind import sway_of
from forest_addon.ui.forest.wind import forest_of_points

SCAN = forest.Terrestrial(
    position=(0, 0, 1.5),
    angle_step_deg=3.0,
    elevation_deg=(-10, 60),
    pulse_rate=3000.0,
    max_range=60.0,
)
YOUNG = forest.Targets(allometry="pinus-sylvestris", dbh=forest.Normal(mean=0.13, sd=0.01))
STAND = forest.Scene(
    seed=6,  # no pine so slender that it bends by metres
    forest=forest.Forest(size=(16.0, 16.0)),
    plantings=(
        forest.Planting(species="scots-pine", expected=4.0, variants=1, targets=YOUNG),
        forest.Planting(species="maple", expected=5.0, variants=1, scale=(0.8, 1.2)),
    ),
    accuracy=forest.Accuracy(audit=0.0),
)
FEW = 40  # points of a tree of which one in twenty says nothing
WINDY = STAND.changed(wind=forest.Wind(speed=9.0, direction_deg=30.0))
AUDITED = WINDY.changed(accuracy=forest.Accuracy())


@cache
def grown(seed, plantings):
    return forest.Site.of(STAND.changed(seed=seed, plantings=plantings)).grow(None)


def built(scene):
    """The stand in a scene's air: the same trees, whatever blows."""
    trees = grown(scene.seed, scene.plantings)
    return forest.Site.of(scene).build(trees, as_assets=False, looks=False)


@pytest.fixture(scope="module", autouse=True)
def fresh(blender):
    """Frames of other tests' files say nothing here."""
    blender.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


@pytest.fixture(scope="module")
def windy():
    return built(AUDITED)


@pytest.fixture(scope="module")
def result(windy):
    return windy.scan(SCAN)


def displaced(sway, tree, turn, points, time):
    """(N, 3) metres in the world that wood, at rest at (N, 3) in the tree's own frame, is off: as the members
    that it rides on move at times (N,), not the pieces."""
    shape, response = sway.shape(tree), sway.response(tree)
    own, (low, high) = shape.members, shape.ends
    wood, segment = shape.skeleton, _nearest(shape.skeleton, points)[0]
    start = wood.start[segment]
    share, _ = beside_segments(points, start, wood.end[segment] - start)
    bone, ends = own.of_segment[segment], own.along[segment]
    along = (ends[:, 0] + share * (ends[:, 1] - ends[:, 0]))[:, None]
    arm = points - own.start[bone] - along * (own.end - own.start)[bone]
    both = low[bone] + along[:, None] * (high - low)[bone]
    six = np.einsum("nm,nmi->ni", response.exact(time)[0], both)
    x, y, z = (six[:, :3] + np.cross(six[:, 3:], arm)).T
    cos, sin = np.cos(turn), np.sin(turn)
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)


def told_of(world, sway, number, rest, time):
    """The same of the wood of a tree, by its number, at (N, 3) of the world at rest."""
    row = sway.number[number]
    stands = world.forest.transforms()[row]
    own = (rest - stands[:, 3]) @ np.linalg.inv(stands[:, :3]).T
    return displaced(sway, row, world.forest.stand.rotation[row], own, time)


@pytest.mark.medium
def test_what_was_met_is_where_the_wind_has_it(windy, result):
    """Against the trees' own motion, member by member, which the pieces stand for."""
    cloud, motion = result.found, result.motion
    sway = sway_of(windy.forest, WINDY.wind, WINDY.seed)
    tree, leaf = result.labels["tree"], result.labels["leaf"]
    ours = np.flatnonzero((tree >= 0) & (leaf < 0))
    assert len(ours) > 100
    away = cloud.position - motion["rest"]
    for number in np.unique(tree[ours]).tolist():
        mine = ours[tree[ours] == number]
        if len(mine) < FEW:
            continue
        told = told_of(windy, sway, number, motion["rest"][mine], cloud.time[mine])
        off = np.linalg.norm(away[mine] - told, axis=1)
        assert np.quantile(off, 0.95) < 0.01 + 0.03 * np.linalg.norm(told, axis=1).max()
    assert np.linalg.norm(away[ours], axis=1).max() > 0.02
    fast = np.linalg.norm(motion["velocity"][ours], axis=1)
    assert 0.01 < fast.max() < 10
    ground = tree < 0
    assert not motion["velocity"][ground].any()


def test_a_scan_in_the_wind_builds_nothing_of_its_leaves_at_rest():
    world = built(WINDY)
    assert len(world.scan(SCAN))
    assert "caster" not in vars(world.observer)


@pytest.mark.medium
def test_a_hit_among_swaying_trees_is_a_function_of_its_ray_and_its_time(monkeypatch):
    """In any order, in batches of any size, in C and in numpy, and what float64 finds."""
    world = built(WINDY)
    moving = MovingScene(
        world.observer.geometry, sway=sway_of(world.forest, WINDY.wind, WINDY.seed)
    )
    caster = embree_motion(moving)
    rng, count = np.random.default_rng(9), 6000
    way = rng.normal((0.0, 0.0, 0.3), 1.0, (count, 3))
    origin, time = np.tile([0.0, 0.0, 1.5], (count, 1)), np.sort(rng.uniform(0, 0.4, count))
    whole = caster.cast(origin, way, 60.0, time=time)
    assert (whole.instance >= moving.count).sum() > 500
    order = rng.permutation(count)
    for rows in (*np.array_split(order, 7), np.arange(3000, 3100)):
        other = caster.cast(origin[rows], way[rows], 60.0, time=time[rows])
        for ours, theirs in zip(vars(whole).values(), vars(other).values(), strict=True):
            np.testing.assert_array_equal(ours[rows], theirs)
    monkeypatch.setenv("FOREST_SENSING_KERNELS", "off")
    plain = embree_motion(moving).cast(origin, way, 60.0, time=time)
    np.testing.assert_array_equal(plain.instance, whole.instance)
    np.testing.assert_array_equal(plain.triangle, whole.triangle)
    np.testing.assert_allclose(plain.distance, whole.distance, rtol=0, atol=1e-11)
    np.testing.assert_allclose(plain.normal, whole.normal, rtol=0, atol=1e-9)
    judged = Referee(caster, exactly(caster)).cast(origin, way, 60.0, time=time)
    np.testing.assert_array_equal(judged.instance, whole.instance)
    np.testing.assert_array_equal(judged.triangle, whole.triangle)


def test_a_long_scan_keeps_few_windows_of_pieces():
    world = built(WINDY)
    moving = MovingScene(
        world.observer.geometry, sway=sway_of(world.forest, WINDY.wind, WINDY.seed)
    )
    caster, rng = embree_motion(moving), np.random.default_rng(2)
    for start in range(3 * WINDOWS):
        way, time = rng.normal((0.0, 0.0, 0.3), 1.0, (200, 3)), np.full(200, float(start))
        hits = caster.cast(np.tile([0.0, 0.0, 1.5], (200, 1)), way, 60.0, time=time)
        assert (hits.instance >= moving.count).any()
    held = [one for one in gc.get_objects() if type(one) is SwayingPieces and one._moving is moving]
    assert 0 < len(held) <= WINDOWS


def test_programs_are_told_how_points_of_trees_move(windy):
    """Wood against its members' own motion, velocities against differences; leaves flutter besides."""
    sway = sway_of(windy.forest, WINDY.wind, WINDY.seed)
    rng, stand = np.random.default_rng(1), windy.forest.stand
    for number in (int(np.flatnonzero(stand.species == kind)[0]) for kind in (0, 1)):
        at = sway.anchors(number)
        at = at.select(rng.integers(0, len(at.leaf), 300))
        time, tree = rng.uniform(0.0, 100.0, 300), np.full(300, number)
        off, wood = sway.displacement(tree, at, time), at.leaf < 0
        told = displaced(sway, number, stand.rotation[number], at.point[wood], time[wood])
        apart = np.linalg.norm(off[wood] - told, axis=1)
        assert np.quantile(apart, 0.95) < 0.01 + 0.03 * np.linalg.norm(told, axis=1).max()
        later, sooner = (sway.displacement(tree, at, time + d) for d in (1e-5, -1e-5))
        speed = sway.velocity(tree, at, time)
        assert speed == pytest.approx((later - sooner) / 2e-5, abs=1e-6)
        alone = [
            sway.displacement(tree[:1], at.select(slice(k, k + 1)), time[k : k + 1]) for k in (0, 7)
        ]
        assert np.concatenate(alone) == pytest.approx(off[[0, 7]], abs=1e-12)


@pytest.mark.slow
def test_the_engines_agree_and_the_audit_holds(result):
    assert result.audit.kept, str(result.audit)
    assert result.audit.checked > 20
    other = built(WINDY.changed(rays=forest.Rays(engine="bvhtree"))).scan(SCAN)
    assert np.array_equal(other.found.pulse, result.found.pulse)
    assert np.abs(other.found.true_range - result.found.true_range).max() < 1e-5
    same = other.found.returns.instance == result.found.returns.instance
    assert same.mean() > 0.999
    assert np.allclose(other.motion["velocity"], result.motion["velocity"], atol=1e-3)


@pytest.mark.slow
def test_any_moment_alone_is_the_same(result):
    """The second half of the pulses alone, and the same seed in another world."""
    from forest_addon.sensing.lidar.scan import Scan

    world = built(WINDY)
    assert np.array_equal(world.scan(SCAN).points, result.points)
    work = Scan.of(world.observer.job(SCAN, WINDY))
    half = work.look(work.pulses // 2, work.pulses)
    late = result.found.pulse >= work.pulses // 2
    assert np.array_equal(half.position, result.found.position[late])


@pytest.mark.slow
def test_without_wind_nothing_changes_and_other_sensors_say_so():
    still = built(STAND).scan(SCAN)
    calm = built(STAND.changed(wind=forest.Wind(speed=0.0, turbulence=0.1))).scan(SCAN)
    assert np.array_equal(still.points, calm.points)
    assert calm.motion == {}
    row = built(WINDY).scan(forest.Tractor(position=(-8, 0, 1), track=2.0))
    assert any("trees stand still" in words for words in row.warnings)


@pytest.mark.slow
def test_a_later_frame_is_a_later_moment():
    world, coarse = built(WINDY), SCAN.changed(angle_step_deg=3.0)
    first = world.scan(coarse)
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + 48)
    later = world.scan(coarse)
    assert not np.array_equal(first.points, later.points)
    bpy.context.scene.frame_set(bpy.context.scene.frame_start)
    assert np.array_equal(world.scan(coarse).points, first.points)


@pytest.mark.slow
def test_a_ping_hears_trees_where_the_wind_has_them():
    bat = forest.Sonar(
        position=(0, 0, 2),
        max_range=4.5,
        wood=True,
        shading="trunks",
        cull=0.02,
        band=(20e3, 50e3),
        sample_rate=150e3,
    )
    world = built(AUDITED)
    found = world.ping(bat)
    assert found.audit.kept
    assert not found.warnings
    speed = np.concatenate([np.linalg.norm(g.velocity, axis=1) for g in found.found.groups])
    assert 0.01 < speed.max() < 10
    start = bpy.context.scene.frame_start
    bpy.context.scene.frame_set(start + 12)
    later = world.ping(bat)
    bpy.context.scene.frame_set(start)
    assert len(later.found.heard) > 0
    assert not np.array_equal(later.found.responses[:, :500], found.found.responses[:, :500])
    still = built(STAND).ping(bat)
    assert still.found.groups[0].velocity.shape[1] == 0


@pytest.mark.slow
def test_a_second_strip_sees_trees_at_another_moment():
    """Two strips over the same ground: each point is off its rest as the wind has it at its own time."""
    flight = forest.Airborne(
        position=(-8, 0, 40),
        heading_deg=0.0,
        track=16.0,
        strips=2,
        spacing=1e-3,
        speed=8.0,
        pulse_rate=2000.0,
        line_rate=20.0,
        max_range=100.0,
    )
    world = built(WINDY)
    result = world.scan(flight)
    cloud, motion, tree = result.found, result.motion, result.labels["tree"]
    sway = sway_of(world.forest, WINDY.wind, WINDY.seed)
    second = cloud.time >= 2.0
    assert cloud.time.max() > 3.5
    off = cloud.position - motion["rest"]
    assert np.abs(off[tree < 0]).max() < 1e-12
    checked = 0
    for number in np.unique(tree[tree >= 0]).tolist():
        ours = (tree == number) & (result.labels["leaf"] < 0)
        if min((ours & second).sum(), (ours & ~second).sum()) < 3:
            continue
        rest, time = motion["rest"][ours], cloud.time[ours]
        apart, wrong = (  # at its own time, and as on the other strip
            np.linalg.norm(off[ours] - told_of(world, sway, number, rest, t), axis=1).mean()
            for t in (time, 4.0 - time)
        )
        assert apart < wrong / 2  # pieces stand for members to about a millimetre
        checked += 1
    assert checked > 0


@pytest.mark.slow
def test_trees_sway_and_a_plate_nears_for_one_ping():
    """Wind and motion at once: trees as without the plate, the plate at its own speed."""
    bat = forest.Sonar(position=(0, 0, 2), max_range=8.0, shading="none", cull=1e-5, motion=True)
    world = built(AUDITED)
    bpy.ops.mesh.primitive_plane_add(size=0.5, location=(2, 0, 2), rotation=(0, np.pi / 2, 0))
    plate = bpy.context.object
    keyed(plate, "location", {1: (2, 0, 2), 49: (6, 0, 2)})
    bpy.context.scene.frame_set(13)
    result = world.ping(bat)
    names = np.array(world.objects)
    speed = {True: [], False: []}
    for group in result.found.groups:
        ours = names[group.instance] == plate.name
        for mine in (True, False):
            speed[mine] += group.velocity[ours == mine].tolist()
    where = float(plate.matrix_world.translation.x)
    groups = [g for g in result.found.groups if (names[g.instance] == plate.name).any()]
    nearest = min(g.paths.distance[names[g.instance] == plate.name].min() for g in groups)
    assert nearest == pytest.approx(where, abs=1e-4)
    assert min(v[0] for v in speed[True]) > 1.0  # m/s away
    trees = np.linalg.norm(speed[False], axis=1)
    assert 0.001 < trees.max() < 10
    assert result.audit.kept, str(result.audit)


@pytest.mark.slow
def test_what_comes_back_among_swaying_trees_is_met_again():
    """A shell around the scanner is there for four frames, away for four, and there again for four."""
    world = built(AUDITED)
    bpy.ops.mesh.primitive_ico_sphere_add(radius=1.0, location=SCAN.position)
    shell = bpy.context.object
    hide(shell, {1: False, 5: True, 9: False, 13: True})
    bpy.context.scene.frame_set(1)
    result = world.scan(SCAN.changed(angle_step_deg=3.0, motion=True))
    ours = np.array(world.objects)[result.labels["object"]] == shell.name
    frame = result.found.time * bpy.context.scene.render.fps
    there = (frame < 4) | ((frame >= 8) & (frame < 12))
    assert np.array_equal(ours, there)
    assert (frame[ours] >= 8).sum() > 400
    assert (result.labels["tree"][ours] == -1).all()
    assert result.audit.kept, str(result.audit)


@pytest.mark.slow
def test_trees_that_lean_far_are_said(result):
    """A pine of 35 m with a stem of 33 cm, alone in the wind."""
    coarse = forest.Terrestrial(position=(0, 0, 1.5), angle_step_deg=5.0, pulse_rate=3000.0)
    slender = built(WINDY.changed(seed=4, plantings=STAND.plantings[:1])).scan(coarse)
    assert any("lean by more than a fifth" in words for words in slender.warnings)
    assert not any("lean by more" in words for words in result.warnings)


class Rises:
    """A tree of three pieces, the middle one of which rises and the last leans as time goes on."""

    number = {7: 0}  # noqa: RUF012

    def moves(self, _tree):
        return True

    def pieces(self, _tree, mesh):
        return mesh.vertices[mesh.triangles].mean(axis=1)[:, 1].round().astype(np.int64)

    def places(self, _tree, knot):
        found = np.tile(np.eye(3, 4), (len(knot), 3, 1, 1))
        found[:, 1, 2, 3] = 0.3 * np.asarray(knot) / KNOTS
        found[:, 2, 0, 2] = 0.2 * np.asarray(knot) / KNOTS
        return found

    def most(self, _tree, _low, _high, _knot=None):
        return 5.0


@pytest.mark.medium
def test_engines_meet_pieces_that_sway_where_they_are():
    corners = np.array([[0.0, -0.5, -1], [0, 0.5, -1], [0, 0, 1]])
    shifts = np.array([[0.0, k, 0] for k in range(3)])
    every = np.concatenate([*(corners + shift for shift in shifts), np.zeros((3, 3))])
    mesh = TriMesh.of_part(every, np.arange(12).reshape(4, 3), WOOD)  # the last has no area
    place = np.tile(np.eye(3, 4), (2, 1, 1))
    place[:, 0, 3] = 5.0, 9.0
    nothing = np.full(2, -1)
    scene = SceneGeometry(
        (mesh,), place, np.zeros(2, np.int64), ("", ""), np.array([7, -1]), nothing
    )
    moving = MovingScene(scene, sway=Rises())
    rng = np.random.default_rng(2)
    count = 2000
    way = np.column_stack(
        [np.full(count, 5.0), rng.uniform(-1, 3, count), rng.uniform(-1, 1, count)]
    )
    time, origin = rng.uniform(0, 2, count), np.zeros((count, 3))
    exact = MovingCaster(moving, ExactCaster).cast(origin, way, time=time)
    assert len(np.unique(exact.instance)) == 5
    for caster in (embree_motion(moving), MovingCaster(moving, BvhCaster)):
        found = caster.cast(origin, way, time=time)
        same = (found.instance == exact.instance) & (found.triangle == exact.triangle)
        assert same.mean() > 0.995  # but for rays that pass an edge within single precision
        assert np.abs(found.distance[same] - exact.distance[same])[exact.found[same]].max() < 1e-9
        judged = Referee(caster, exactly(caster)).cast(origin, way, time=time)
        assert np.array_equal(judged.instance, found.instance)
        behind = caster.cast(origin, way, time=time, min_distance=found.distance, leaving=found)
        assert (behind.distance >= found.distance).all()


@pytest.mark.medium
@pytest.mark.parametrize("engine", ["embree", "bvhtree"])
def test_a_stand_in_which_nothing_sways_is_seen_as_without_wind(engine):
    """A lying log has no axis that bends."""
    here = forest.HandTree(position=(2.0, 1.0))
    log = forest.Planting(species="log", expected=0.0, variants=1, by_hand=(here,))
    scene = forest.Scene(
        forest=forest.Forest(size=(4.0, 4.0)),
        plantings=(log,),
        rays=forest.Rays(engine=engine),
    )
    tripod = forest.Terrestrial(position=(2.0, -1.0, 1.0), angle_step_deg=5.0, motion=True)
    calm, windy = (
        forest.build(scene.changed(wind=forest.Wind(speed=speed))).scan(tripod)
        for speed in (0.0, 6.0)
    )
    assert (calm.labels["tree"] >= 0).any()
    np.testing.assert_array_equal(windy.labels["tree"], calm.labels["tree"])
    np.testing.assert_allclose(windy.points, calm.points, atol=1e-9)


# ---------------------------------------------------------------------------------------- wind view
# Trees in the wind in views and renders: held to the motion that sensors meet, and gone without a trace.

VIEWED = forest.Scene(
    seed=6,
    forest=forest.Forest(size=(16.0, 16.0)),
    plantings=(
        forest.Planting(species="scots-pine", expected=3.0, variants=1, scale=(0.8, 1.2)),
        forest.Planting(species="whorl-8", expected=3.0, variants=1),
    ),
    wind=forest.Wind(speed=9.0, direction_deg=30.0),
    accuracy=forest.Accuracy(audit=0.0),
)
LOOK = forest.Terrestrial(
    position=(0, 0, 1.5),
    angle_step_deg=6.0,
    elevation_deg=(-10, 60),
    pulse_rate=3000.0,
    max_range=60.0,
)


@cache
def forest_of(scene):
    return forest.Site.of(scene).grow(None)


def blown(scene=VIEWED):
    world = forest.Site.of(scene).build(forest_of(scene), as_assets=False, looks=False)
    place = bpy.context.scene
    place.frame_start, place.frame_end = 1, 30
    place.frame_set(1)
    return place, world, sway_of(world.forest, scene.wind, scene.seed)


def seen(place):
    """Return the places that the depsgraph gives the pieces of each tree, by the tree's number."""
    found = {}
    for one in bpy.context.evaluated_depsgraph_get().object_instances:
        if one.is_instance and one.parent is not None and TREE_KEY in one.parent.original:
            number = one.parent.original[TREE_KEY]
            found.setdefault(number, []).append(np.array(one.matrix_world, dtype=np.float64))
    return found


def pieces_drawn(place):
    """Count the triangles of pieces that a view draws."""
    found = 0
    for one in bpy.context.evaluated_depsgraph_get().object_instances:
        if one.is_instance and one.object.type == "MESH":
            found += len(one.object.data.polygons)
    return found


@pytest.mark.slow
def test_pieces_are_where_sensors_meet_them():
    """At frames and between them, against the maps that rays are cast at, in float64."""
    place, _, sway = blown()
    made = show_wind(place, sway, KNOTS)
    assert made.trees == len(sway.number)
    things = {t[TREE_KEY]: t for t in bpy.data.objects if TREE_KEY in t}
    moved = 0.0
    for frame, part in ((1, 0.0), (12, 0.37), (29, 0.5)):
        place.frame_set(frame, subframe=part)
        found = seen(place)
        assert sorted(found) == sorted(sway.number)
        knot = (frame + part - 1) / place.render.fps * KNOTS
        for number, pieces in found.items():
            low, high = sway.places(sway.number[number], np.floor(knot) + np.array([0.0, 1.0]))
            local = low + (knot - np.floor(knot)) * (high - low)
            stands = np.array(things[number].matrix_world, dtype=np.float64)
            told = np.stack([stands @ np.vstack([one, [0, 0, 0, 1]]) for one in local])
            rounded = 1e-6 * max(10.0, np.abs(told).max())  # single precision
            assert np.abs(np.stack(pieces) - told).max() < rounded
            moved = max(moved, np.abs(told - stands).max())
    assert moved > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("trees", ["objects", "points"])
def test_sensors_see_the_same_with_and_without_the_view(trees):
    place, world, sway = blown(*([POINTS] * (trees == "points")))
    before = world.scan(LOOK)
    show_wind(place, sway, KNOTS)
    assert np.array_equal(world.scan(LOOK).points, before.points)


@pytest.mark.slow
def test_it_goes_without_a_trace():
    place, _, sway = blown()
    kinds = (bpy.data.objects, bpy.data.meshes, bpy.data.collections)
    before = [sorted(block.name for block in kind) for kind in kinds]
    show_wind(place, sway, KNOTS)
    assert wind_home(place)
    show_wind(place, sway, KNOTS)
    hide_wind(place)
    assert [sorted(block.name for block in kind) for kind in kinds] == before
    assert not wind_home(place)
    assert not seen(place)


POINTS = VIEWED.changed(
    forest=forest.Forest(size=(16.0, 16.0), instancing="points"), plantings=VIEWED.plantings[1:]
)


def told(place, world, sway, shape):
    """Corners of the pieces of all trees at the frame of a scene, as sensors meet them; shape : gives the
    mesh of a tree, by its row in the stand."""
    knot = np.array([(place.frame_current - 1) / place.render.fps * KNOTS])
    assert knot == np.floor(knot)
    found = []
    for row, stands in enumerate(world.forest.transforms()):
        maps = sway.places(row, knot)[0]
        mesh = shape(row)
        for piece, rows in split_pieces(mesh, sway.pieces(row, mesh)):
            part = mesh.select(rows)
            moved = part.vertices @ maps[piece, :, :3].T + maps[piece, :, 3]
            found.append(moved @ stands[:, :3].T + stands[:, 3])
    return np.concatenate(found)


def shown(place):
    """Corners of what a view shows of trees that are points."""
    obj = next(t for t in bpy.data.objects if any(is_wind(m) for m in t.modifiers))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    found = [from_mesh(obj.evaluated_get(depsgraph).data).vertices]
    for one in depsgraph.object_instances:
        if one.parent is not None and one.parent.original == obj and one.object.type == "MESH":
            at = np.array(one.matrix_world, dtype=np.float64)
            found.append(from_mesh(one.object.data).vertices @ at[:3, :3].T + at[:3, 3])
    return np.concatenate(found)


@pytest.mark.medium
@pytest.mark.parametrize("display", [pytest.param("FULL", marks=pytest.mark.slow), "LIGHT", "DOTS"])
def test_trees_that_are_points_sway_as_they_are_displayed(display):
    """Full trees and stand-ins are where sensors meet their pieces; dots stand still."""
    place, world, sway = blown(POINTS)
    instancer = forest_of_points(place)
    show_as(instancer, display)
    made = show_wind(place, sway, KNOTS)
    assert made.trees == len(sway.number)
    place.frame_set(13)  # at a knot
    if display == "DOTS":
        assert not len(shown(place))
        return
    outlines = sorted(layout.part(place, layout.OUTLINES).objects, key=lambda obj: obj.name)
    number = {key: k for k, key in enumerate(world.forest.variants)}
    light = {key: from_mesh(outlines[k].data) for key, k in number.items()}
    shape = sway.rest if display == "FULL" else lambda row: light[sway.variant(row)]
    there, wanted = shown(place), told(place, world, sway, shape)
    assert there.shape == wanted.shape
    # As sets of places: in any order, each has one of the other within rounding.
    off = max(cKDTree(a).query(b)[0].max() for a, b in ((there, wanted), (wanted, there)))
    assert off < 2e-5
    place.frame_set(1)
    assert cKDTree(shown(place)).query(wanted)[0].max() > 0.02
    show_as(instancer, "DOTS")
    assert not len(shown(place))
    hide_wind(place)
    assert not [one for one in instancer.id_data.data.attributes if "wind" in one.name]


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".usdc", ".abc"])
def test_a_baked_file_moves_as_the_view_does(tmp_path, ending):
    """Read back by Blender's importer (Alembic) or by pxr (USD): every piece's place and triangles."""
    place, _, sway = blown(VIEWED.changed(plantings=VIEWED.plantings[1:]))
    place.frame_end = 4
    show_wind(place, sway, KNOTS)
    path = tmp_path / f"wind{ending}"
    bake(place, path)
    assert path.is_file()
    places, size = {}, pieces_drawn(place)
    assert size > 10_000
    for frame in (1, 4):
        place.frame_set(frame)
        every = [m for pieces in seen(place).values() for m in pieces]
        places[frame] = np.sort(np.stack(every)[:, 0, 3])
    back = {1: [], 4: []}
    if ending == ".abc":
        bpy.ops.wm.read_homefile(use_empty=True)
        bpy.ops.wm.alembic_import(filepath=str(path), as_background_job=False)
        for frame in back:
            bpy.context.scene.frame_set(frame)
            things = bpy.context.evaluated_depsgraph_get().objects
            back[frame] = [t.matrix_world[0][3] for t in things if t.type == "MESH"]
        meshes = [obj for obj in things if obj.type == "MESH"]
        written = sum(len(obj.data.polygons) for obj in meshes)
    else:
        pxr = pytest.importorskip("pxr")
        from pxr import Usd, UsdGeom  # noqa: F401

        stage = pxr.Usd.Stage.Open(str(path))
        for frame in back:
            cache = pxr.UsdGeom.XformCache(frame)
            back[frame] = [
                cache.GetLocalToWorldTransform(prim)[3][0]
                for prim in stage.Traverse()
                if prim.IsInstance() or prim.IsA(pxr.UsdGeom.Mesh)
            ]
        prims = [UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
        written = sum(len(mesh.GetFaceVertexCountsAttr().Get() or ()) for mesh in prims)
    assert size <= written < 1.1 * size  # the ground, and the trees' own points
    for frame, told in places.items():
        got = np.sort(np.array(back[frame]))
        assert len(got) >= len(told)
        off = np.abs(got[:, None] - told).min(axis=0)
        assert off.max() < 1e-3
    assert np.abs(places[1] - places[4]).max() > 1e-3
