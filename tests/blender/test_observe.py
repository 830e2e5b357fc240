"""Every sensor looks at the evaluated scene: a moved tree or a modifier changes what it finds."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.echoes import leaf_discs
from references.scenes import add_collection, add_mesh, keyed, link

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.base.trimesh import GROUND, WOOD
from forest_addon.blender.rays.bvh import BvhCaster
from forest_addon.blender.read.inputs import (
    read_painted,
    read_places,
    read_terrain,
    with_objects,
)
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.layout import GROUND_NAME, TREES, part
from forest_addon.blender.scene.meshes import ground_mesh
from forest_addon.blender.scene.nodes import GROUP
from forest_addon.blender.sensors.moving import curve_points
from forest_addon.blender.sensors.observe import Observer
from forest_addon.growth.library import load_species
from forest_addon.site import ForestSite
from forest_addon.spec import Mobile, Scene, Sonar, SpecError
from forest_addon.stand.forest import grow_forest, leaf_table
from forest_addon.stand.intensity.surface import Heightmap

SCENE = spec.Scene(
    seed=11,
    forest=spec.Forest(size=(4.0, 4.0), margin=10.0),
    plantings=(spec.Planting(species="hazelnut", variants=1, expected=2),),
    sensors=(
        spec.Tractor(
            position=(-3.0, 0.0, 1.0), track=4.0, step=0.1, angle_step_deg=1.0, reach=8.0, top=4.0
        ),
        spec.Terrestrial(position=(-3.0, 2.0, 1.2), angle_step_deg=3.0),
        spec.Sonar(position=(-3.0, 2.0, 1.2), beam_width_deg=(70.0, 70.0), cull=0.01),
        spec.Reverb(
            source=(-4.0, 2.0, 0.2), receiver=(8.0, 2.0, 0.2), sample_rate=8000, duration=0.1
        ),
    ),
)


@pytest.fixture(scope="module")
def grown():
    species = load_species(ASSETS / "species" / "hazelnut.toml")
    forest = grow_forest(SCENE, [species])
    assert len(forest.stand) > 0
    return forest


@pytest.fixture
def trees(grown, empty_blender):
    build(bpy.context.scene, SCENE, grown)
    return list(part(bpy.context.scene, TREES).all_objects)


def look():
    """What each sensor of the scene finds, as one array each."""
    bpy.context.view_layer.update()
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    tractor, terrestrial, sonar, reverb = (observer.observe(s, SCENE) for s in SCENE.sensors)
    return {
        "tractor": tractor.distance,
        "terrestrial": terrestrial.position,
        "sonar": sonar.impulse_response,
        "reverb": reverb.trees,
    }


def differ(before, after):
    return {
        name
        for name in before
        if before[name].shape != after[name].shape
        or not np.allclose(before[name], after[name], rtol=1e-9, atol=0)
    }


@pytest.mark.slow
def test_a_moved_or_bent_tree_is_seen_and_heard_and_nothing_changes_by_itself(trees):
    before = look()
    assert differ(before, look()) == set()
    trees[0].location.x += 1.0
    moved = look()
    assert differ(before, moved) == {"tractor", "terrestrial", "sonar", "reverb"}
    modifier = trees[0].modifiers.new("Wind", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.deform_axis, modifier.angle = "BEND", "X", 0.6
    assert differ(moved, look()) == {"tractor", "terrestrial", "sonar", "reverb"}


@pytest.mark.medium
def test_a_hidden_forest_is_neither_seen_nor_heard(trees):
    for tree in trees:
        tree.hide_viewport = True
    found = look()
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    assert set(observer.observe(SCENE.sensors[2], SCENE).heard.kind) <= {"facet"}  # the ground
    assert not found["reverb"].any()


@pytest.mark.slow
def test_a_wall_of_the_users_own_is_seen_and_blocks_the_direct_sound(trees):
    before = look()
    bpy.ops.mesh.primitive_cube_add(size=2, location=(6.0, 2.0, 0.0), scale=(0.1, 3, 2))
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    reverb = observer.observe(SCENE.sensors[3], SCENE)
    assert not reverb.direct_clear
    assert "tractor" in differ(before, look())


@pytest.mark.medium
def test_truth_and_evaluated_leaves_agree(trees, grown):
    bpy.context.view_layer.update()
    discs = leaf_discs(Observer(bpy.context.evaluated_depsgraph_get()).geometry)
    truth = leaf_table(grown)
    ours = np.lexsort((discs.leaf, discs.tree))
    theirs = np.lexsort((truth["leaf"], truth["tree"]))
    # Blender stores float32: a few micrometres at these coordinates.
    assert np.abs(discs.centre[ours] - truth["centre"][theirs]).max() < 5e-6
    assert discs.radius[ours] == pytest.approx(truth["radius"][theirs], rel=1e-4)
    cosine = np.einsum("li,li->l", discs.normal[ours], truth["normal"][theirs])
    assert np.abs(np.abs(cosine) - 1).max() < 1e-4


@pytest.mark.medium
def test_speakers_empties_and_cameras_are_ends_where_they_are(trees):
    """Also one that follows another object; each channel as if its places were typed."""
    boat = link("Boat", bpy.data.speakers.new("Boat"))
    ear, eye = link("Ear"), link("Eye", bpy.data.cameras.new("E"))
    boat.location, ear.location, eye.location = (-4, 2, 0.25), (8, 2, 0.25), (1, 0, 0.125)
    eye.parent = ear
    bpy.context.view_layer.update()
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    typed = replace(SCENE.sensors[3], source=(-4.0, 2.0, 0.25), receiver=(8.0, 2.0, 0.25))
    named = replace(typed, source_objects="Boat", receiver_objects="Ear, Eye")
    found = observer.observe(named, SCENE)
    names = [channel.channel for channel in found.channels]
    assert names == [f"{s} to {r}" for s in ("source", "Boat") for r in ("receiver", "Ear", "Eye")]
    assert np.array_equal(found.channels[4].samples, observer.observe(typed, SCENE).samples)
    assert found.channels[5].direct_delay == pytest.approx(
        np.hypot(13, 0.125) / SCENE.air.speed(), rel=1e-6
    )
    with pytest.raises(spec.SpecError, match='no Speaker, Empty or Camera "Tree"'):
        observer.observe(replace(typed, source_objects="Tree"), SCENE)


@pytest.mark.medium
def test_stems_sound_without_being_there(trees):
    """None of them covers an end, and nothing is added to Blender's scene."""
    before = len(bpy.data.objects)
    reverb = SCENE.sensors[3]
    settings = replace(SCENE, stems=(spec.Stems(count=300, radius=spec.Normal(mean=0.05)),))
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    bare, full = observer.observe(reverb, SCENE), observer.observe(reverb, settings)
    assert (full.trunks, full.clamped) == (bare.trunks + 300, 0)
    assert full.direct_clear
    assert len(bpy.data.objects) == before
    inside = replace(reverb, receiver=(2.0, 2.0, 0.2))
    assert observer.observe(inside, settings).clamped == 0


@pytest.mark.medium
def test_a_measured_directivity_is_found_beside_the_scene_file(trees, tmp_path):
    (tmp_path / "mute.csv").write_text("deg,1000\n0,-inf\n180,-inf\n")
    reverb = replace(SCENE.sensors[3], directivity="measured", directivity_file="mute.csv")
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    assert not observer.observe(reverb, SCENE, folder=tmp_path).samples.any()


# ----------------------------------------------------------------------------------------- following
# Sensors that follow something in Blender: curves, keyframes, parents.


def curve(points, name="Way", closed=False):
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions = "3D"
    spline = data.splines.new("POLY")
    spline.points.add(len(points) - 1)
    spline.points.foreach_set("co", [x for p in points for x in (*p, 1.0)])
    spline.use_cyclic_u = closed
    return link(name, data)


def test_a_curve_is_followed_in_the_world(empty_blender):
    way = curve([(0, 0, 0), (3, 0, 0), (3, 4, 0)])
    way.location = (10, 0, 5)
    way.data.bevel_depth = 0.3  # a tube for the eye, not for the scanner
    bpy.context.view_layer.update()
    path = Observer.way(Mobile(follow="Way", speed=2.0))
    assert path.duration == pytest.approx(3.5)
    where, attitude = path.at(np.array([0.0, 1.5, 3.5]))
    assert where == pytest.approx(np.array([[10, 0, 5], [13, 0, 5], [13, 4, 5]]), abs=1e-6)
    assert attitude.apply([1, 0, 0])[2] == pytest.approx([0, 1, 0], abs=1e-6)
    poses = Observer.way(Sonar(follow="Way", poses=8, speed=2.0))
    assert poses.position[[0, 3, 7]] == pytest.approx(where, abs=1e-5)
    assert poses.frames[1, 0] == pytest.approx([1, 0, 0], abs=1e-6)
    assert poses.velocity[7] == pytest.approx([0, 2, 0], abs=1e-6)
    aside = Observer.way(Sonar(follow="Way", poses=3, azimuth_deg=90.0))
    assert aside.frames[0, 0] == pytest.approx([0, 1, 0], abs=1e-6)


def test_a_closed_curve_comes_back(empty_blender):
    curve([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], closed=True)
    points = curve_points(bpy.data.objects["Way"])
    assert points[0] == pytest.approx(points[-1])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(4)
    assert len(bpy.data.curves) == 1  # the probe is gone
    assert len(bpy.data.objects) == 1


def test_a_bezier_circle_has_its_length(empty_blender):
    bpy.ops.curve.primitive_bezier_circle_add(radius=5)
    bpy.context.object.data.resolution_u = 64
    points = curve_points(bpy.context.object)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert length == pytest.approx(2 * np.pi * 5, rel=1e-3)


def test_a_scan_along_a_curve_sees_the_wall_beside_it(empty_blender):
    curve([(0, 0, 1), (4, 0, 1)])
    bpy.ops.mesh.primitive_plane_add(size=100, location=(0, 6, 0), rotation=(np.pi / 2, 0, 0))
    scanner = Mobile(
        follow="Way", speed=1.0, pulse_rate=500.0, line_rate=5.0, field_deg=(-180.0, 180.0)
    )
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    cloud = observer.observe(scanner, Scene())
    assert cloud.pulses == 2000
    assert 800 < len(cloud) < 1000  # half of each turn, but for what passes above and below
    assert cloud.position[:, 1] == pytest.approx(6, abs=1e-5)
    assert cloud.position[:, 0] == pytest.approx(cloud.time, abs=1e-6)


def flat():
    """An object without size has no direction."""
    obj = link("Way")
    obj.scale = (0, 1, 1)


@pytest.mark.parametrize(
    ("begin", "words"),
    [
        (lambda: None, 'there is no object "Way"'),
        (lambda: curve([(1, 1, 1), (1, 1, 1)]), "has no length"),
        (flat, "scale of zero"),
    ],
)
@pytest.mark.parametrize("kind", [Mobile, Sonar])
def test_nowhere_to_go(empty_blender, begin, words, kind):
    begin()
    with pytest.raises(SpecError, match=words):
        Observer.way(kind(follow="Way"))


@pytest.fixture
def bat(empty_blender):
    """An empty that flies 4 m along Y in frames 1 to 25, turning by 90°; 24 frames a second."""
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.render.fps = 1, 25, 24
    obj = link("Bat")
    keyed(obj, "location", {1: (1, 0, 2), 25: (1, 4, 2)})
    keyed(obj, "rotation_euler", {1: (0, 0, 0), 25: (0, 0, math.pi / 2)})
    return obj


def test_an_animated_object_over_the_frames(bat):
    bpy.context.scene.frame_set(7)
    poses = Observer.way(Sonar(follow="Bat", poses=5))
    np.testing.assert_allclose(poses.position, [[1, y, 2] for y in range(5)], atol=1e-5)
    for number, (frame, velocity) in enumerate(zip(poses.frames, poses.velocity, strict=True)):
        angle = math.radians(22.5 * number)
        np.testing.assert_allclose(frame[0], [math.cos(angle), math.sin(angle), 0], atol=1e-6)
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-6)
        np.testing.assert_allclose(velocity, [0, 4, 0], atol=1e-3)  # 4 m in 24 frames
    assert bpy.context.scene.frame_current == 7


def test_a_child_moves_with_its_parent(bat):
    child = link("Nose")
    child.parent, child.location, child.scale = bat, (0.5, 0, 0), (3, 3, 3)
    bpy.context.scene.frame_set(7)
    expected = np.array([[1.5, 0, 2], [1.0, 4.5, 2]])
    poses, path = Observer.way(Sonar(follow="Nose", poses=2)), Observer.way(Mobile(follow="Nose"))
    assert poses.position == pytest.approx(expected, abs=1e-5)
    assert path.duration == pytest.approx(1.0)
    where, attitude = path.at(np.array([0.0, 1.0]))
    assert where == pytest.approx(expected, abs=1e-5)
    assert attitude.apply([1, 0, 0]) == pytest.approx(np.eye(3)[:2], abs=1e-6)
    assert bpy.context.scene.frame_current == 7


def test_a_sonar_flies_where_a_scanner_drives_whatever_is_drawn_around_the_curve(empty_blender):
    """A bevelled curve is a tube, and other splines are no part of the way: positions are those of the bare
    line to the bit, at an even speed, also for the scanner at the same times."""
    obj = curve([(0, 0, 2), (4, 0, 2), (4, 3, 3)])
    sonar = Sonar(follow="Way", poses=9, speed=2.0)
    bare = Observer.way(sonar)
    obj.data.bevel_depth, obj.data.bevel_resolution = 0.3, 4
    other = obj.data.splines.new("POLY")
    other.points.add(1)
    other.points[1].co = (9, 9, 9, 1)
    bpy.context.view_layer.update()
    tube = Observer.way(sonar)
    for name in ("position", "frames", "velocity"):
        assert np.array_equal(getattr(tube, name), getattr(bare, name)), name
    steps = np.linalg.norm(np.diff(tube.position, axis=0), axis=1)
    assert steps[:4] == pytest.approx(np.full(4, steps[0]))
    driven = Observer.way(Mobile(follow="Way", speed=2.0))
    where, _ = driven.at(np.linspace(0.0, driven.duration, 9))
    np.testing.assert_allclose(tube.position, where, atol=1e-12)


def test_a_closed_curve_is_pinged_along_once(empty_blender):
    curve([(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)], closed=True)
    poses = Observer.way(Sonar(follow="Way", poses=4))
    np.testing.assert_allclose(
        poses.position, [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]], atol=1e-6
    )


# ------------------------------------------------------------------------------------------- inputs
# What a stand takes from a scene: the ground under trees, painted weights, places of objects.


def depsgraph():
    bpy.context.view_layer.update()
    return bpy.context.evaluated_depsgraph_get()


def slab(name, z, low=0.0, high=10.0):
    corners = [(low, low, z), (high, low, z), (high, high, z), (low, high, z)]
    return add_mesh(name, corners, (0, 1, 2, 3))


# ------------------------------------------------------------------------------------------ terrain


def test_a_moved_turned_object_is_terrain_where_it_stands(empty_blender):
    obj = add_mesh("hill", [(0, 0, 0), (8, 0, 0), (0, 8, 4)], (0, 1, 2))  # z = y / 2
    obj.location, obj.rotation_euler = (100, 200, 5), (0, 0, np.pi / 2)
    ground = read_terrain("hill", depsgraph())
    inside = np.array([[99.0, 201.0], [96.0, 203.0]])  # local y is 100 - x
    assert np.allclose(ground.height(inside), 5 + (100 - inside[:, 0]) / 2, atol=1e-5)
    assert np.isnan(ground.height(np.array([[101.0, 201.0]]))).all()


def test_modifiers_of_the_terrain_count(empty_blender):
    obj = slab("flat", 0.0)
    obj.modifiers.new("Up", "DISPLACE").mid_level = 0.25  # 1 - 0.25 along the normal
    assert read_terrain("flat", depsgraph()).height(np.array([[5.0, 5.0]]))[0] == pytest.approx(
        0.75, abs=1e-6
    )


def test_the_topmost_surface_counts_below_an_overhang(empty_blender):
    corners = [(0, 0, 1), (10, 0, 1), (10, 10, 1), (0, 10, 1)]
    roof = [(0, 0, 6), (5, 0, 6), (5, 10, 6), (0, 10, 6)]
    add_mesh("cliff", corners + roof, (0, 1, 2, 3), (4, 5, 6, 7))
    ground = read_terrain("cliff", depsgraph())
    assert ground.height(np.array([[2.0, 5.0], [8.0, 5.0]])).tolist() == [6, 1]


def forest_on(name, **changes):
    settings = spec.Scene(
        seed=5,
        forest=spec.Forest(size=(10.0, 10.0), terrain=spec.Terrain(object=name), **changes),
        plantings=(
            spec.Planting(species="abop-monopodial-a", variants=1, expected=40, exact=True),
        ),
    )
    inputs = with_objects(ForestSite(settings), depsgraph()).inputs
    species = load_species(ASSETS / "species" / "abop-monopodial-a.toml")
    return settings, inputs, grow_forest(settings, [species], inputs=inputs)


def test_no_tree_stands_over_a_hole_and_the_missing_are_counted(empty_blender):
    strip = [(0, 0, 2), (10, 0, 2), (10, 4, 2), (0, 4, 2)]
    other = [(0, 6, 2), (10, 6, 2), (10, 10, 2), (0, 10, 2)]
    add_mesh("strips", strip + other, (0, 1, 2, 3), (4, 5, 6, 7))
    _, _, forest = forest_on("strips")
    y = forest.stand.position[:, 1]
    assert not ((y > 4) & (y < 6)).any()
    assert (forest.stand.position[:, 2] == 2).all()
    assert len(forest.stand) + forest.stand.off_ground.sum() == 40
    assert forest.stand.off_ground.sum() > 0


@pytest.mark.medium
@pytest.mark.parametrize("instancing", ["points", "objects"])
def test_on_a_slope_no_gap_shows_under_a_trunk(empty_blender, instancing):
    """Rays along the slope, just above it, meet the foot of every tree before they could pass below."""
    obj = add_mesh("slope", [(0, 0, 0), (10, 0, 6), (10, 10, 6), (0, 10, 0)], (0, 1, 2, 3))
    settings, inputs, forest = forest_on("slope", instancing=instancing)
    build(bpy.context.scene, settings, forest, inputs.terrain)
    assert obj.name in bpy.context.scene.objects
    assert not part(bpy.context.scene, GROUND_NAME).objects
    scene = Observer(depsgraph()).geometry
    base = forest.transforms()[:, :, 3]
    ground = inputs.terrain.height(base[:, :2])
    radius = np.array([t.skeleton.radius[0, 0] for t in forest.variants.values()])[0]
    radius = radius * forest.stand.scale
    assert (base[:, 2] <= ground - 0.6 * radius + 1e-9).all()
    down = np.column_stack([-np.ones(len(base)), np.zeros(len(base)), np.full(len(base), -0.6)])
    level = inputs.terrain.height(base[:, :2] + [0.8, 0]) + 0.002
    origins = np.column_stack([base[:, 0] + 0.8, base[:, 1], level])
    inside = np.isfinite(level)
    hits = BvhCaster(scene).cast(origins[inside], down[inside], 1.2)
    parts = [
        scene.meshes[scene.mesh_index[i]].part[t]
        for i, t in zip(hits.instance, hits.triangle, strict=True)
        if i >= 0
    ]
    assert inside.sum() > 20
    assert len(parts) == inside.sum()
    assert set(parts) == {WOOD}


def test_a_ground_that_we_made_and_that_is_named_as_terrain_stays(empty_blender):
    settings, _, forest = forest_on("")
    build(bpy.context.scene, settings, forest)
    settings, inputs, forest = forest_on("Ground")
    for _ in range(2):
        build(bpy.context.scene, settings, forest, inputs.terrain)
        assert "Ground" in bpy.data.objects
        assert len(part(bpy.context.scene, GROUND_NAME).objects) == 1


def test_a_heightmap_becomes_a_ground_with_a_margin(empty_blender):
    field = spec.Forest(size=(10.0, 10.0), origin=(100.0, 0.0), margin=7.0)
    pixels = np.arange(12.0).reshape(3, 4)
    terrain = Heightmap(pixels, np.array([100.0, 0.0]), np.array([10.0, 10.0]), "map")
    mesh = ground_mesh(field, terrain)
    assert mesh.vertices[:, :2].min(axis=0).tolist() == [93, -7]
    assert mesh.vertices[:, :2].max(axis=0).tolist() == [117, 17]
    assert (mesh.part == GROUND).all()
    assert (mesh.area_vectors()[:, 2] > 0).all()  # nothing folds over
    assert mesh.area_vectors()[:, 2].sum() == pytest.approx(24 * 24)
    within = (np.abs(mesh.vertices[:, :2] - [105, 5]) < 5).all(axis=1)
    vertices = mesh.vertices[within]
    assert len(vertices) == 12
    assert np.allclose(vertices[:, 2], terrain.height(vertices[:, :2]))


# ------------------------------------------------------------------------------------------- weights


def test_a_vertex_group_is_read_by_name_or_as_the_active_one(empty_blender):
    obj = slab("field", 0.0)
    for name, weight in (("oaks", 0.5), ("ash", 1.0)):
        group = obj.vertex_groups.new(name=name)
        group.add([1, 2], weight, "REPLACE")
    assert read_painted("field:oaks", depsgraph()).weight.tolist() == [0, 0.5, 0.5, 0]
    assert read_painted("field", depsgraph()).weight.tolist() == [0, 1, 1, 0]  # the last made


@pytest.mark.parametrize(
    ("kind", "domain", "key", "values", "expected"),
    [
        ("FLOAT", "POINT", "value", [0.0, 1, 2, 3], [0, 1, 2, 0, 2, 3]),
        ("FLOAT", "CORNER", "value", [4.0, 5, 6, 7], [4, 5, 6, 4, 6, 7]),
        ("FLOAT", "FACE", "value", [2.5], [2.5] * 6),
        ("INT", "POINT", "value", [0, 1, 2, 3], [0, 1, 2, 0, 2, 3]),
        ("BOOLEAN", "FACE", "value", [True], [1] * 6),
        ("FLOAT_COLOR", "POINT", "color", [[1, 1, 1, 1]] * 4, [1] * 6),
        ("FLOAT_COLOR", "CORNER", "color", [[0, 1, 0, 1]] * 4, [0.7152] * 6),
        ("BYTE_COLOR", "CORNER", "color", [[1, 0, 0, 1]] * 4, [0.2126] * 6),
    ],
)
def test_attributes_of_every_kind_weigh(empty_blender, kind, domain, key, values, expected):
    obj = slab("field", 0.0)
    attribute = obj.data.attributes.new("w", kind, domain)
    attribute.data.foreach_set(key, np.ravel(values))
    painted = read_painted("field:w", depsgraph())
    found = painted.weight[painted.triangles]
    corner = painted.vertices[painted.triangles].reshape(-1, 3)
    order = {(0, 0): 0, (10, 0): 1, (10, 10): 2, (0, 10): 3}
    by_corner = {}
    for place, weight in zip(corner, found.ravel(), strict=True):
        by_corner[order[tuple(place[:2].round().astype(int))]] = weight
    wanted = dict(zip([0, 1, 2, 0, 2, 3], expected, strict=True))
    assert by_corner == pytest.approx(wanted, abs=1e-6)


def test_a_name_with_a_colon_is_an_object_where_there_is_one(empty_blender):
    obj = slab("field", 0.0)
    obj.name = "site: north"
    obj.vertex_groups.new(name="w").add([0], 1.0, "REPLACE")
    assert read_painted("site: north", depsgraph()).weight.tolist() == [1, 0, 0, 0]
    assert read_painted("site: north:w", depsgraph()).weight.tolist() == [1, 0, 0, 0]


@pytest.mark.medium
def test_trees_stand_where_it_is_painted(empty_blender):
    obj = slab("field", 0.0)
    obj.location = (20, 0, 0)
    obj.vertex_groups.new(name="w").add([1, 2], 1.0, "REPLACE")  # grows along x
    settings = spec.Scene(
        seed=1,
        forest=spec.Forest(size=(40.0, 20.0)),
        plantings=(spec.Planting(species="apple", painted="field:w", expected=900, exact=True),),
    )
    from forest_addon.stand.plan import plan_stand

    inputs = with_objects(ForestSite(settings), depsgraph()).inputs
    stand = plan_stand(settings.seed, settings.forest, settings.plantings, inputs)
    x = stand.position[:, 0] - 20
    assert ((x >= 0) & (x <= 10)).all()
    # λ grows like x, so that (x/10)² is uniform: its mean is 1/2 ± 0.29/30; 5 σ.
    assert np.mean((x / 10) ** 2) == pytest.approx(0.5, abs=5 * 0.29 / 30)


# -------------------------------------------------------------------------------------------- places


def test_objects_say_where_trees_stand(empty_blender):
    home = add_collection("surveyed")
    for number, (x, size) in enumerate([(1, 1.0), (5, 2.0), (7, 0.5)]):
        peg = link(f"peg {number}", home=home)
        peg.location, peg.scale = (x, 2, 3), (size,) * 3
        peg.rotation_euler = (0, 0, 0.1 * number)
    found = read_places("surveyed", depsgraph())
    assert found.position.tolist() == [[1, 2, 3], [5, 2, 3], [7, 2, 3]]
    assert found.scale == pytest.approx([1, 2, 0.5])
    assert found.rotation == pytest.approx([0, 0.1, 0.2])
    settings = spec.Scene(
        forest=spec.Forest(size=(10.0, 10.0)),
        plantings=(spec.Planting(species="apple", layout="list", collection="surveyed"),),
    )
    inputs = with_objects(ForestSite(settings), depsgraph()).inputs
    forest = grow_forest(settings, [load_species(ASSETS / "species" / "apple.toml")], inputs=inputs)
    assert np.allclose(forest.stand.position, found.position)
    assert np.allclose(forest.stand.scale, found.scale)


def test_a_mirrored_peg_is_refused(empty_blender):
    link("left", home=add_collection("surveyed")).scale.x = -1
    with pytest.raises(SpecError, match='"left" is mirrored'):
        read_places("surveyed", depsgraph())


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: read_terrain("hill", depsgraph()), 'no object "hill".*field'),
        (lambda: read_terrain("edge", depsgraph()), '"edge".*no area from above'),
        (lambda: read_painted("hill:w", depsgraph()), 'no object "hill"'),
        (lambda: read_painted("field:w", depsgraph()), 'no layer "w" of weights'),
        (lambda: read_painted("field", depsgraph()), "no painted layer"),
        (lambda: read_places("pegs", depsgraph()), 'no collection "pegs"'),
    ],
)
def test_what_is_not_there_is_named_with_what_is(empty_blender, ask, words):
    slab("field", 0.0)
    add_mesh("edge", [(0, 0, 0), (1, 0, 0), (0, 0, 1)], (0, 1, 2))
    with pytest.raises(SpecError, match=words):
        ask()


# -------------------------------------------------------------------------------------- ground nodes
# A ground to the horizon: views show what is around the forest, sensors all of it.

HORIZON = spec.Scene(forest=spec.Forest(size=(36.0, 20.0), origin=(5.0, -3.0), margin=1000.0))


def plant(settings=HORIZON):
    build(bpy.context.scene, settings, grow_forest(settings, []))
    return part(bpy.context.scene, GROUND_NAME).objects["Ground"]


def near(settings=HORIZON):
    return replace(settings, forest=replace(settings.forest, margin=20.0))


def box(obj):
    """Corners of what a view shows, which View All frames."""
    bpy.context.view_layer.update()
    corners = np.array(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).bound_box)
    return corners.min(axis=0), corners.max(axis=0)


def read():
    """All that sensors are given of a scene."""
    found = Observer(bpy.context.evaluated_depsgraph_get()).geometry
    arrays = [getattr(found, f.name) for f in fields(found) if f.name != "meshes"]
    for mesh in found.meshes:
        arrays += [mesh.vertices, mesh.triangles, mesh.part]
    return [array.tobytes() if isinstance(array, np.ndarray) else repr(array) for array in arrays]


def test_views_show_a_quarter_of_the_field_around_it(empty_blender):
    low, high = box(plant())
    assert low == pytest.approx([5 - 9, -3 - 9, 0])
    assert high == pytest.approx([5 + 36 + 9, -3 + 20 + 9, 0])


def test_sensors_are_given_the_same_bytes_as_without_the_nodes(empty_blender):
    # An object that comes before the ground by name, and so among instances.
    add_mesh("a rock", [(0, 0, 1), (1, 0, 1), (0, 1, 2)], (0, 1, 2))
    ground = plant()
    with_nodes, shown = read(), box(ground)
    assert (box(ground)[1] == shown[1]).all()  # views are as they were
    assert ground.modifiers[0].show_viewport
    ground.modifiers.clear()
    assert with_nodes == read()
    assert box(ground)[1] == pytest.approx([1041, 1017, 0])


def test_a_near_ground_has_no_nodes_and_what_was_taken_away_stays_away(empty_blender):
    assert not plant(near()).modifiers
    assert [m.name for m in plant().modifiers] == [GROUP]
    assert [m.name for m in plant().modifiers] == [GROUP]
    assert not plant(near()).modifiers
    plant().modifiers.clear()
    assert not plant().modifiers
