"""What settings name of the scene: pointers that outlive a rename, names in scene files and older files."""

import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import add_cube

from forest_addon import spec
from forest_addon.ui.settings import exchange, references


def names(scene=None):
    """Every name that the scene's settings say."""
    settings = exchange.to_spec(scene or bpy.context.scene)
    by_kind = {sensor.kind: sensor for sensor in settings.sensors}
    planting, reverb = settings.plantings[0], by_kind["reverb"]
    return {
        "object": settings.forest.terrain.object,
        "painted": planting.painted,
        "collection": planting.collection,
        "mobile": by_kind["mobile"].follow,
        "sonar": by_kind["sonar"].follow,
        "source_objects": reverb.source_objects,
        "receiver_objects": reverb.receiver_objects,
    }


@pytest.fixture
def naming(small, sensor):
    """A scene whose settings name something each, by their texts as a script sets them."""
    link = bpy.context.scene.collection.objects.link
    hill = add_cube()
    hill.name = "hill"
    hill.vertex_groups.new(name="weights")
    home = bpy.data.collections.new("orchard")
    bpy.context.scene.collection.children.link(home)
    link(bpy.data.objects.new("way", bpy.data.curves.new("way", "CURVE")))
    for name in ("ear", "eye"):
        link(bpy.data.objects.new(name, None))
    link(bpy.data.objects.new("bell", bpy.data.speakers.new("bell")))
    sensor("mobile", follow="way")
    bpy.data.objects["echo"].forest_sensor.sonar.follow = "way"
    reverb = bpy.data.objects["reverb"].forest_sensor.reverb
    reverb.source_objects, reverb.receiver_objects = "bell", "ear, eye"
    small.forest.terrain.object = "hill"
    small.plantings[0].painted, small.plantings[0].collection = "hill:weights", "orchard"
    bpy.context.view_layer.update()
    return small


NAMED = {
    "object": "hill", "painted": "hill:weights", "collection": "orchard", "mobile": "way",
    "sonar": "way", "source_objects": "bell", "receiver_objects": "ear, eye",
}  # fmt: skip
RENAMED = {
    "object": "mound", "painted": "mound:weights", "collection": "grove", "mobile": "path",
    "sonar": "path", "source_objects": "gong", "receiver_objects": "left, eye",
}  # fmt: skip


def rename():
    for old, new in {"hill": "mound", "way": "path", "bell": "gong", "ear": "left"}.items():
        bpy.data.objects[old].name = new
    bpy.data.collections["orchard"].name = "grove"


def test_every_setting_that_names_something_is_known():
    """The class of the fault: a text whose help speaks of the Blender scene is a reference."""
    classes = {*spec.SENSORS.values(), spec.Forest, spec.Terrain, spec.Planting, spec.Stems}
    for cls in classes:
        for field in exchange.fields_of(cls):
            words, known = ("blender scene", "object that", "names of"), field.param
            text = field.kind is str and not known.choices
            if text and any(word in known.help.lower() for word in words):
                assert field.name in references.REFERENCES, f"{cls.__name__}.{field.name}"


def test_a_rename_is_followed(naming):
    assert names() == NAMED
    rename()
    assert names() == RENAMED


def test_a_copy_of_a_sensor_follows_too(naming):
    copy = bpy.data.objects["reverb"].copy()
    bpy.data.objects["ear"].name = "left"
    assert exchange.sensor_of(copy).receiver_objects == "left, eye"


def test_a_picked_object_is_named(naming):
    other = add_cube()
    other.name = "slope"
    naming.forest.terrain.object_pointer = other
    assert naming.forest.terrain.object == "slope"
    naming.plantings[0].painted_pointer = other
    naming.plantings[0].painted_layer = ""
    assert exchange.to_spec(bpy.context.scene).plantings[0].painted == "slope"
    naming.forest.terrain.object_pointer = None
    assert exchange.to_spec(bpy.context.scene).forest.terrain.object == ""


def test_a_name_that_nothing_has_yet_stays_a_name(naming):
    naming.forest.terrain.object = "later"
    reverb = bpy.data.objects["reverb"].forest_sensor.reverb
    reverb.receiver_objects = "ear, later"
    assert references.is_lost(naming.forest.terrain, "object")
    assert names()["object"] == "later"
    assert names()["receiver_objects"] == "ear, later"
    assert "Not Here" in drawn()


def drawn():
    from ui import test_panels

    return test_panels.drawn()


def test_what_was_deleted_is_said(naming):
    hill = bpy.data.objects["hill"]
    bpy.context.scene.collection.objects.unlink(hill)  # as deleting in a view does
    with pytest.raises(spec.SpecError, match=r'"hill" was deleted') as caught:
        exchange.to_spec(bpy.context.scene)
    assert caught.value.key == "forest.terrain.object"


def test_objects_that_are_further_ends_are_added_and_removed(naming):
    bpy.context.view_layer.objects.active = bpy.data.objects["reverb"]
    reverb = bpy.data.objects["reverb"].forest_sensor.reverb
    assert bpy.ops.forest.add_receiver_object() == {"FINISHED"}
    reverb.receiver_objects_pointers[2].thing = bpy.data.objects["cloud"]
    assert exchange.sensor_of(bpy.data.objects["reverb"]).receiver_objects == "ear, eye, cloud"
    for _ in range(3):
        assert bpy.ops.forest.remove_receiver_object() == {"FINISHED"}
    assert exchange.sensor_of(bpy.data.objects["reverb"]).receiver_objects == ""


def test_a_saved_file_says_the_names_of_today(naming, tmp_path):
    rename()
    assert names() == RENAMED
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "today.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "today.blend"))
    props = bpy.context.scene.forest_sensing
    assert props.forest.terrain.object == "mound"  # for whoever reads the text
    bpy.data.objects["mound"].name = "hill"
    assert names()["object"] == "hill"
