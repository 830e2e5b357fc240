"""The paint button: a canvas over the field, a layer for each planting, and what is painted is planted."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.blender.scene.instances import TREE_KEY
from forest_addon.blender.show.intensity import CELLS, LIFT
from forest_addon.ui.settings import exchange


def press():
    return bpy.ops.forest.paint()


def canvas():
    return bpy.data.objects["Canvas"]


def vertices():
    """(V, 3) of the canvas in the world."""
    bpy.context.view_layer.update()
    thing = canvas()
    local = np.array([vertex.co for vertex in thing.data.vertices])
    return local @ np.array(thing.matrix_world)[:3, :3].T + np.array(thing.matrix_world)[:3, 3]


def weigh(layer, inside):
    """Paint 1 where ``inside`` of the places says so."""
    chosen = np.flatnonzero(inside(vertices()[:, 0], vertices()[:, 1])).tolist()
    canvas().vertex_groups[layer].add(chosen, 1.0, "REPLACE")


@pytest.fixture
def painting(small):
    small.forest.origin = (-2, 1)
    small.forest.size = (20, 10)
    yield small
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def test_the_button_gives_the_brush_and_takes_it_back(painting):
    assert press() == {"FINISHED"}
    assert bpy.context.mode == "PAINT_WEIGHT"
    assert bpy.context.view_layer.objects.active == canvas()
    assert canvas().vertex_groups.active.name == "hazelnut"
    assert painting.plantings[0].painted == "Canvas:hazelnut"
    assert canvas().show_in_front
    assert press() == {"FINISHED"}
    assert bpy.context.mode == "OBJECT"
    assert (canvas().show_in_front, canvas().display_type) == (False, "BOUNDS")


def test_the_canvas_is_put_away_however_the_mode_is_left(painting):
    press()
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    assert (canvas().show_in_front, canvas().display_type) == (False, "BOUNDS")


def test_the_canvas_covers_the_field_at_its_height(painting):
    painting.forest.terrain.base = 3.0
    press()
    places = vertices()
    assert len(places) == (CELLS + 1) ** 2
    assert places.min(axis=0) == pytest.approx((-2, 1, 3 + LIFT))
    assert places.max(axis=0) == pytest.approx((18, 11, 3 + LIFT))


def test_the_canvas_lies_on_a_terrain_and_beyond_it_at_its_base(painting):
    data = bpy.data.meshes.new("slope")
    data.from_pydata([(-9, -9, 0), (8, -9, 8.5), (8, 20, 8.5), (-9, 20, 0)], [], [(0, 1, 2, 3)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("slope", data))
    painting.forest.terrain.object = "slope"
    press()
    x, _, z = vertices().T
    on = x < 7.9
    assert z[on] == pytest.approx((x[on] + 9) / 2 + LIFT, abs=1e-5)
    assert z[x > 8.1] == pytest.approx(LIFT)


@pytest.mark.slow
def test_what_is_painted_is_planted_there_and_nowhere_else(painting):
    painting.plantings[0].expected = 40
    press()
    weigh("hazelnut", lambda x, _: x > 10)
    press()
    assert bpy.ops.forest.build() == {"FINISHED"}
    x = [thing.location.x for thing in bpy.data.objects if TREE_KEY in thing]
    assert len(x) > 10
    assert min(x) > 10 - 20 / CELLS


def test_neither_sensors_nor_renders_see_the_canvas(painting):
    press()
    press()
    bpy.context.view_layer.update()
    seen = read_scene(bpy.context.evaluated_depsgraph_get())
    assert "Canvas" not in seen.object_name
    assert canvas().hide_render


def test_pressed_again_the_same_canvas_follows_the_field(painting):
    press()
    weigh("hazelnut", lambda x, _: x > 10)
    press()
    painting.forest.size = (4, 4)
    press()
    assert [t.name for t in bpy.data.objects if t.name.startswith("Canvas")] == ["Canvas"]
    assert len(canvas().vertex_groups) == 1
    assert vertices().max(axis=0)[:2] == pytest.approx((2, 5))
    weights = [bool(vertex.groups) for vertex in canvas().data.vertices]
    assert 0 < sum(weights) < len(weights)


def test_each_planting_has_a_layer_of_its_own(painting):
    press()
    press()
    for species in ("maple", "hazelnut"):
        painting.plantings.add().species = species
        painting.active_plantings += 1
        press()
        press()
    assert [p.painted for p in painting.plantings] == [
        "Canvas:hazelnut",
        "Canvas:maple",
        "Canvas:hazelnut 2",
    ]


@pytest.mark.slow
def test_the_canvas_survives_a_build_and_undo(painting):
    press()
    weigh("hazelnut", lambda x, _: x > 10)
    press()
    bpy.ops.ed.undo_push(message="painted")
    bpy.ops.forest.build()
    bpy.ops.ed.undo_push(message="built")
    assert [home.name for home in canvas().users_collection] == ["Intensity"]
    bpy.ops.ed.undo()
    assert sum(bool(vertex.groups) for vertex in canvas().data.vertices) > 0


def test_a_scene_file_with_a_painting_says_that_it_needs_blender(painting, tmp_path):
    press()
    press()
    settings = exchange.to_spec(bpy.context.scene, [])
    assert settings.plantings[0].painted == "Canvas:hazelnut"
    assert isinstance(settings, spec.Scene)


def test_it_says_why_it_cannot_paint(painting):
    painting.forest.terrain.object = "nowhere"
    with pytest.raises(RuntimeError, match='no object "nowhere"'):
        press()
    assert bpy.context.mode == "OBJECT"
    painting.plantings.clear()
    with pytest.raises(RuntimeError, match="no planting yet"):
        press()


def test_an_object_of_the_next_file_that_has_the_name_of_the_canvas_is_left_alone(painting):
    press()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mine = bpy.data.objects.new("Canvas", bpy.data.meshes.new("Canvas"))
    bpy.context.scene.collection.objects.link(mine)
    bpy.context.view_layer.update()
    assert mine.display_type == "TEXTURED"
