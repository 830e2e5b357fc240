"""Forests built by the button, for real, of three small trees."""

import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import (
    ROOT,
    SENSORS,
    counts,
    facts,
    press,
    run,
    trees,
)

from forest_addon.blender.jobs import Job
from forest_addon.blender.scene import forest as forest_room
from forest_addon.blender.scene import layout
from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene
from forest_addon.ui.forest import build
from forest_addon.ui.settings import exchange


@pytest.mark.medium
def test_build_plants_a_forest(built):
    assert 1 <= len(trees()) <= 12
    assert len({tree.data for tree in trees()}) == 1
    assert facts(built, "forest")["Trees"] == str(len(trees()))
    assert {*SENSORS, "reverb receiver"} == {
        thing.name for thing in layout.part(bpy.context.scene, "Sensors").objects
    }


@pytest.mark.medium
def test_building_again_is_the_same_forest_and_nothing_piles_up(built):
    places = sorted(tuple(tree.matrix_world.translation) for tree in trees())
    before = counts()
    assert press("build") == {"FINISHED"}
    assert sorted(tuple(tree.matrix_world.translation) for tree in trees()) == places
    assert counts() == before
    assert [c.name for c in bpy.context.scene.collection.children] == ["Forest"]


@pytest.mark.slow
def test_another_seed_is_another_forest(built):
    places = sorted(tuple(tree.matrix_world.translation) for tree in trees())
    built.seed += 1
    press("build")
    assert sorted(tuple(tree.matrix_world.translation) for tree in trees()) != places


@pytest.mark.slow
def test_an_update_keeps_objects_and_edits_and_can_be_undone(built):
    tree, ground = trees()[0], bpy.data.objects["Ground"]
    tree.modifiers.new("mine", "DECIMATE").ratio = 0.5
    ground.hide_render = True
    ground.data.materials[0] = bpy.data.materials.new("mine")
    states = []
    for _ in range(3):
        bpy.ops.ed.undo_push(message="step")
        places = {tree.name: tuple(tree.location) for tree in trees()}
        states.append((bpy.context.scene.forest_sensing.seed, places))
        bpy.context.scene.forest_sensing.seed += 1
        assert press("build") == {"FINISHED"}
        assert (bpy.data.objects["Ground"], trees()[0]) == (ground, tree)
    assert len({str(places) for _, places in states}) == 3
    bpy.ops.ed.undo_push(message="step")
    for seed, places in reversed(states):
        bpy.ops.ed.undo()
        assert bpy.context.scene.forest_sensing.seed == seed
        assert {tree.name: tuple(tree.location) for tree in trees()} == places
        assert trees()[0].modifiers["mine"].ratio == 0.5
        ground = bpy.data.objects["Ground"]
        assert (ground.hide_render, ground.data.materials[0].name) == (True, "mine")


@pytest.mark.slow
def test_an_update_that_is_cancelled_changes_nothing(built):
    before, places = counts(), {tree.name: tree.matrix_world.copy() for tree in trees()}
    meshes = {mesh.name: mesh.session_uid for mesh in bpy.data.meshes}
    built.seed += 1
    job = Job("Update", build.FOREST_OT_build.work(None, bpy.context))
    while job.label != "growing trees":
        assert not job.step()
    job.cancel()
    while job.busy:
        pass
    assert counts() == before
    assert {tree.name: tree.matrix_world for tree in trees()} == places
    assert {mesh.name: mesh.session_uid for mesh in bpy.data.meshes} == meshes
    assert press("build") == {"FINISHED"}
    assert {tree.name: tree.matrix_world for tree in trees()} != places


@pytest.mark.medium
def test_a_forest_without_trees_is_a_ground(small):
    small.plantings[0].expected = 0
    assert press("build") == {"FINISHED"}
    assert trees() == []
    assert run("cloud") == {"FINISHED"}
    assert facts(small, "cloud")["Ground"] == "100.0 %"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda p: setattr(p.forest, "size", (0, 6)), r"forest\.size\[0\].*larger than 0"),
        (lambda p: setattr(p.plantings[0], "species", "baobab"), "baobab.*hazelnut"),
        (lambda p: setattr(p.plantings[0], "species", "no.toml"), "no.toml.*no such file"),
        (lambda p: setattr(p.plantings[0], "use_expected", False), "expected.*give a number"),
        (lambda p: setattr(p.plantings[0], "scale", (2, 1)), "smallest, largest"),
    ],
)
def test_a_bad_setting_is_reported_and_the_old_forest_kept(built, spoil, words):
    before, places = counts(), {tree.name: tree.matrix_world.copy() for tree in trees()}
    spoil(built)
    with pytest.raises(RuntimeError, match=words):
        press("build")
    assert counts() == before
    assert {tree.name: tree.matrix_world for tree in trees()} == places
    assert facts(built, "forest")["Trees"] == str(len(places))


@pytest.mark.medium
def test_a_build_that_breaks_midway_takes_back_what_it_made(built, monkeypatch):
    before, names = counts(), {tree.name for tree in trees()}

    def full(*_):
        raise MemoryError

    monkeypatch.setattr(forest_room, "ground_mesh", full)
    with pytest.raises(RuntimeError, match="not enough memory"):
        press("build")
    assert counts() == before
    assert {tree.name for tree in trees()} == names


def test_the_first_press_starts_with_the_demo_scene(props, monkeypatch, tmp_path):
    text = (ROOT / "assets/scenes/demo.toml").read_text().split("[[plantings]]")[0]
    demo = tmp_path / "demo.toml"
    demo.write_text(text)
    monkeypatch.setattr(build, "DEMO", demo)
    assert press("build") == {"FINISHED"}
    assert props.name == "Demo forest"
    assert exchange.to_spec(bpy.context.scene).forest == read_settings(demo, Scene).forest


@pytest.mark.slow
def test_each_scene_has_a_forest_of_its_own(built):
    first = bpy.context.scene
    number = len(trees())
    second = bpy.data.scenes.new("Second")
    with bpy.context.temp_override(scene=second, view_layer=second.view_layers[0]):
        exchange.from_spec(second, exchange.to_spec(first))
        press("build")
    assert layout.root(first) is not None
    assert len(trees()) == 2 * number


@pytest.mark.medium
def test_one_tree_is_no_trees(small):
    small.plantings[0].expected, small.plantings[0].exact = 1, True
    work, outcome = build.FOREST_OT_build.work(None, bpy.context), None
    with pytest.raises(StopIteration, match=r"^1 tree with [\d,]+ leaves in [\d.]+ s$"):
        while True:
            outcome = work.send(outcome).run(lambda done, total: None)


@pytest.mark.medium
def test_a_terrain_that_is_deleted_while_trees_grow_on_it(small):
    """They stand where it was."""
    data = bpy.data.meshes.new("hill")
    data.from_pydata([(-9, -9, 5), (9, -9, 5), (9, 9, 5), (-9, 9, 5)], [], [(0, 1, 2, 3)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("hill", data))
    small.forest.terrain.object = "hill"
    work, outcome = build.FOREST_OT_build.work(None, bpy.context), None
    with pytest.raises(StopIteration, match="trees with"):
        while True:
            task = work.send(outcome)
            outcome = task.run(lambda done, total: None)
            if task.label == "growing trees":
                bpy.data.objects.remove(bpy.data.objects["hill"])
    bpy.context.view_layer.update()
    assert {round(tree.matrix_world.translation.z, 6) for tree in trees()} == {5.0}


@pytest.mark.slow
def test_a_forest_is_built_when_our_collections_were_deleted(built, sensor):
    run("cloud")
    bpy.data.collections.remove(layout.root(bpy.context.scene))
    assert press("build") == {"FINISHED"}
    sensor("terrestrial", name="another", position=(3, 3, 1), angle_step_deg=6)
    assert run("another") == {"FINISHED"}


@pytest.mark.medium
def test_a_new_forest_keeps_the_sensors_where_they_are(built):
    echo = bpy.data.objects["echo"]
    echo.location = (2, 2, 2)
    press("build")
    assert bpy.data.objects["echo"] == echo
    assert tuple(echo.location) == (2, 2, 2)
    assert echo.users_collection[0].name == "Sensors"
