"""Ways of scanners from curves and animated objects."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.sensors.observe import Observer
from forest_addon.blender.sensors.platform import curve_points, path_of_object
from forest_addon.spec import Mobile, Scene, SpecError


def curve(points, name="Way", closed=False):
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions = "3D"
    spline = data.splines.new("POLY")
    spline.points.add(len(points) - 1)
    spline.points.foreach_set("co", [x for p in points for x in (*p, 1.0)])
    spline.use_cyclic_u = closed
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def test_a_curve_is_followed_in_the_world(empty_blender):
    way = curve([(0, 0, 0), (3, 0, 0), (3, 4, 0)])
    way.location = (10, 0, 5)
    way.data.bevel_depth = 0.3  # a tube for the eye, not for the scanner
    bpy.context.view_layer.update()
    path = path_of_object(bpy.context.scene, Mobile(follow="Way", speed=2.0))
    assert path.duration == pytest.approx(3.5)
    where, attitude = path.at(np.array([0.0, 1.5, 3.5]))
    assert where == pytest.approx(np.array([[10, 0, 5], [13, 0, 5], [13, 4, 5]]), abs=1e-6)
    assert attitude.apply([1, 0, 0])[2] == pytest.approx([0, 1, 0], abs=1e-6)


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


def test_an_object_is_followed_frame_by_frame_also_through_its_parent(empty_blender):
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.render.fps = 1, 26, 25
    scene.frame_set(7)
    carrier, head = (bpy.data.objects.new(n, None) for n in ("carrier", "head"))
    for thing in (carrier, head):
        scene.collection.objects.link(thing)
    head.parent = carrier
    head.location, head.scale = (0, 0, 2), (3, 3, 3)
    for frame, x in ((1, 0.0), (26, 10.0)):
        carrier.location = (x, 0, 0)
        carrier.rotation_euler = (0, 0, np.pi / 2)
        carrier.keyframe_insert("location", frame=frame)
        carrier.keyframe_insert("rotation_euler", frame=frame)
    path = path_of_object(scene, Mobile(follow="head"))
    assert path.duration == pytest.approx(1.0)
    where, attitude = path.at(np.array([0.0, 1.0]))
    assert where == pytest.approx(np.array([[0, 0, 2], [10, 0, 2]]), abs=1e-5)
    assert attitude.apply([1, 0, 0])[0] == pytest.approx([0, 1, 0], abs=1e-6)
    assert scene.frame_current == 7


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


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda: None, 'there is no object "Way"'),
        (lambda: curve([(1, 1, 1), (1, 1, 1)]), "has no length"),
    ],
)
def test_nowhere_to_go(empty_blender, spoil, words):
    spoil()
    with pytest.raises(SpecError, match=words):
        path_of_object(bpy.context.scene, Mobile(follow="Way"))


def test_an_object_without_size_has_no_direction(empty_blender):
    thing = bpy.data.objects.new("Way", None)
    thing.scale = (0, 1, 1)
    bpy.context.scene.collection.objects.link(thing)
    with pytest.raises(SpecError, match="scale of zero"):
        path_of_object(bpy.context.scene, Mobile(follow="Way"))
