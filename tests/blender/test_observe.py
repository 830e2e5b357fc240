"""Every sensor looks at the evaluated scene: a moved tree or a modifier changes what it finds."""

import math
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.echoes import leaf_discs
from references.scenes import keyed, link

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.layout import TREES, part
from forest_addon.blender.sensors.moving import curve_points
from forest_addon.blender.sensors.observe import Observer
from forest_addon.growth.library import load_species
from forest_addon.spec import Mobile, Scene, Sonar, SpecError
from forest_addon.stand.forest import grow_forest, leaf_table

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
