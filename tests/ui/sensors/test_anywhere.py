"""A sensor is a sensor wherever it is: moved, copied, appended, linked, in another scene's forest."""

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.scene.layout import TREES, find_part, grove, part, root
from forest_addon.blender.sensors import objects as sensors
from forest_addon.ui.settings import exchange
from forest_addon.ui.shell.views import chosen_sensor

from ..pressing import press


@pytest.fixture
def scene(props):
    return props.id_data


def added(kind, **settings):
    press("add_sensor", kind=kind)
    thing = bpy.context.view_layer.objects.active
    for name, value in settings.items():
        setattr(getattr(thing.forest_sensor, kind), name, value)
    return thing


def send(thing, home):
    for old in list(thing.users_collection):
        old.objects.unlink(thing)
    home.objects.link(thing)
    bpy.context.view_layer.update()


def test_in_any_collection_it_is_listed_chosen_and_removed(scene):
    thing = added("terrestrial")
    own = bpy.data.collections.new("instruments")
    scene.collection.children.link(own)
    for home in (own, scene.collection, part(scene, TREES), grove(scene, "oak")):
        send(thing, home)
        assert sensors.sensors_of(scene) == [thing]
        bpy.context.view_layer.objects.active = thing
        assert chosen_sensor(bpy.context) == thing
        listed = sensors.home_of(scene).objects
        assert listed[scene.forest_sensing.active_sensor] == thing
    other = added("sonar")
    scene.forest_sensing.active_sensor = list(sensors.home_of(scene).objects).index(thing)
    assert chosen_sensor(bpy.context) == thing
    assert [s.kind for s in exchange.to_spec(scene).sensors] == ["sonar", "terrestrial"]
    press("remove_sensor")
    assert sensors.sensors_of(scene) == [other]


def test_among_many_trees_it_is_seen_as_it_comes_and_goes(scene):
    oaks = grove(scene, "oak")
    for _ in range(12):
        oaks.objects.link(bpy.data.objects.new("oak", None))
    assert sensors.sensors_of(scene) == []
    thing = added("terrestrial")
    send(thing, oaks)
    assert sensors.sensors_of(scene) == [thing]
    copy = thing.copy()
    oaks.objects.link(copy)
    assert set(sensors.sensors_of(scene)) == {thing, copy}
    thing.name = "renamed"
    assert {s.name for s in sensors.sensors_of(scene)} == {"renamed", copy.name}
    bpy.data.objects.remove(copy)
    assert sensors.sensors_of(scene) == [thing]


def saved(tmp_path, kind, **settings):
    """A file with one sensor, and the sensor's name."""
    thing = added(kind, **settings)
    name = thing.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "field.blend"))
    bpy.ops.wm.read_homefile(app_template="", use_empty=True)
    return name


def loaded(tmp_path, name, link):
    with bpy.data.libraries.load(str(tmp_path / "field.blend"), link=link) as (_, target):
        target.objects = [name]
    (thing,) = target.objects
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.objects.active = thing
    bpy.context.view_layer.update()
    return thing


def test_pasted_into_another_file_it_runs_with_its_settings(scene, tmp_path):
    """As Append and Paste do it: into the scene's own collection, what it points to into none."""
    name = saved(tmp_path, "terrestrial", angle_step_deg=7.5)
    thing = loaded(tmp_path, name, link=False)
    assert sensors.sensors_of(bpy.context.scene) == [thing]
    (settings,) = exchange.to_spec(bpy.context.scene).sensors
    assert settings.angle_step_deg == 7.5
    assert find_part(bpy.context.scene, TREES) is None  # no forest is needed


def test_a_pasted_reverb_says_that_its_receiver_is_missing_and_adopts_it(scene, tmp_path):
    name = saved(tmp_path, "reverb")
    thing = loaded(tmp_path, name, link=False)
    receiver = sensors.receiver_of(thing)
    assert receiver is not None
    assert not receiver.users_scene
    assert sensors.is_foreign(bpy.context.scene, thing)
    assert press("adopt_sensor") == {"FINISHED"}
    assert not sensors.is_foreign(bpy.context.scene, thing)
    assert receiver.users_scene == (bpy.context.scene,)
    place = tuple(receiver.location)
    (settings,) = exchange.to_spec(bpy.context.scene).sensors
    assert settings.receiver == pytest.approx(place)


def test_a_linked_sensor_is_adopted(scene, tmp_path):
    name = saved(tmp_path, "sonar", ears=2)
    thing = loaded(tmp_path, name, link=True)
    assert sensors.sensors_of(bpy.context.scene) == []
    assert sensors.is_foreign(bpy.context.scene, thing)
    assert press("adopt_sensor") == {"FINISHED"}
    (made,) = sensors.sensors_of(bpy.context.scene)
    assert made.library is None
    assert made.forest_sensor.sonar.ears == 2
    assert len([t for t in bpy.context.scene.objects if sensors.kind_of(t)]) == 1
    assert not bpy.ops.forest.adopt_sensor.poll()


def test_one_of_another_scenes_forest_is_copied(scene):
    thing = added("terrestrial")
    other = bpy.data.scenes.new("other")
    part(other, "Sensors")
    other.collection.children.link(root(scene))  # shown there, too
    assert sensors.sensors_of(other) == []
    assert sensors.is_foreign(other, thing)
    made = sensors.adopt(other, thing)
    assert made != thing
    assert sensors.sensors_of(other) == [made]
    assert sensors.sensors_of(scene) == [thing]
