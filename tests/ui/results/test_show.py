"""What the icons of a result do."""

import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import (
    LIDARS,
    add_cube,
    clouds,
    facts,
    press,
    run,
)


@pytest.mark.medium
def test_the_dice_and_the_sound(built):
    seed = built.seed
    assert press("new_seed") == {"FINISHED"}
    assert built.seed != seed
    with pytest.raises(RuntimeError, match="Run it again"):
        press("play", sensor="reverb")
    run("reverb")
    sound = bpy.data.objects["reverb"].data.sound
    assert sound.packed_file is not None


@pytest.mark.slow
@pytest.mark.parametrize("name", LIDARS)
def test_points_are_shown_and_selected_on_request(built, name):
    cube = add_cube()
    cube.select_set(True)
    run(name)
    (cloud,) = clouds()
    assert cloud.visible_get()
    assert bpy.context.selected_objects == [cube]
    assert press("select_result", shown=cloud.name) == {"FINISHED"}
    assert bpy.context.selected_objects == [cloud]
    assert bpy.context.view_layer.objects.active == cloud
    assert len(cloud.data.vertices) == int(facts(built, name)["Points"].replace(",", ""))
    assert {"tree", "organ", "distance"} <= set(cloud.data.attributes.keys())


@pytest.mark.medium
def test_a_cloud_shows_even_where_its_collection_was_hidden(built):
    layer = bpy.context.view_layer.layer_collection.children["Forest"]
    for name in ("Results", "Sensors"):
        made = bpy.data.collections.new(f"mine in {name}")
        layer.children[name].collection.children.link(made)
        layer.children[name].children[made.name].exclude = True
    layer.children["Results"].exclude = True
    run("cloud")
    (cloud,) = clouds()
    assert cloud.visible_get()
    assert not layer.children["Results"].exclude
    for name in ("Results", "Sensors"):
        assert layer.children[name].children[f"mine in {name}"].exclude
    assert press("select_result", shown=cloud.name) == {"FINISHED"}
    assert cloud.select_get()
