"""Clouds say what their colours mean, start with what there is, and are seen in renders."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.scene.layout import CLOUD_KEY, COLOUR_BY, COLOUR_MAP, SHARE
from forest_addon.blender.scene.nodes import choose_input, chosen_input, set_input
from forest_addon.blender.show.cloud_nodes import on_map
from forest_addon.stand.plan import PLANTS
from forest_addon.ui.overlay import GAMMA, seen_points
from forest_addon.ui.results import panel
from forest_addon.ui.results.panel import SIDE, pixels_of

from ..pressing import add_cube, run
from ..test_panels import drawn


def points_of(props, name):
    return bpy.data.objects[props.results[name].shown]


def colours(thing):
    """Of the points as they are drawn, linear."""
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return seen_points(evaluated)[1][:, :3] ** (1 / GAMMA)


def labels(thing, name):
    out = np.empty(len(thing.data.vertices), np.int32)
    thing.data.attributes[name].data.foreach_get("value", out)
    return out


@pytest.mark.medium
@pytest.mark.parametrize("choice", ["Organ", "Species", "Object"])
def test_each_name_stands_beside_the_colour_of_its_points(built, choice):
    run("cloud")
    thing, legend = points_of(built, "cloud"), built.results["cloud"].legend
    choose_input(thing.modifiers[0], COLOUR_BY, choice)
    assert chosen_input(thing.modifiers[0], COLOUR_BY) == choice
    seen = colours(thing)
    entries = [entry for entry in legend if entry.choice == choice]
    assert entries
    for entry in entries:
        assert np.abs(seen - np.array(entry.colour)).max(axis=1).min() < 2e-3
    names = {entry.name for entry in entries}
    if choice == "Organ":
        assert names == {
            ("other", "wood", "leaf", "ground")[n] for n in set(labels(thing, "organ"))
        }
    elif choice == "Species":
        assert names == {"hazelnut"}
    else:
        assert names <= {each.name for each in bpy.data.objects}
    assert names <= set(drawn())


@pytest.mark.slow
@pytest.mark.parametrize("instancing", ["objects", "points"])
def test_undergrowth_is_named_as_well(small, instancing):
    small.forest.undergrowth, small.forest.instancing = "sparse", instancing
    assert bpy.ops.forest.build() == {"FINISHED"}
    run("cloud")
    named = {e.name: e.colour for e in small.results["cloud"].legend if e.choice == "Species"}
    met = set(labels(points_of(small, "cloud"), "species")) - {-1}
    assert len(named) == len(met) > 2  # each species that was met has a name
    assert {"hazelnut"} < set(named) <= {"hazelnut", *PLANTS}


@pytest.mark.medium
def test_a_measure_has_its_smallest_and_largest_value(built):
    run("cloud")
    found = [e.name for e in built.results["cloud"].legend if e.choice == "Distance"]
    distance = np.empty(len(points_of(built, "cloud").data.vertices), np.float32)
    points_of(built, "cloud").data.attributes["distance"].data.foreach_get("value", distance)
    said = [float(words.removesuffix(" m").replace(",", "")) for words in (found[0], found[-1])]
    step = float(np.ptp(distance)) / (len(found) - 1)
    np.testing.assert_allclose(said, [distance.min(), distance.max()], atol=step / 10)


@pytest.mark.medium
def test_a_foreign_scene_starts_with_objects(props, sensor):
    add_cube()
    sensor("terrestrial", name="cloud", position=(3, 0.5, 0.5), angle_step_deg=2)
    run("cloud")
    (modifier,) = points_of(props, "cloud").modifiers
    assert chosen_input(modifier, COLOUR_BY) == "Object"
    assert [e.name for e in props.results["cloud"].legend if e.choice == "Object"] == ["cube"]
    choose_input(modifier, COLOUR_BY, "Distance")
    run("cloud")
    assert chosen_input(modifier, COLOUR_BY) == "Distance"  # what the user chose stays


@pytest.mark.medium
def test_an_echo_offers_what_it_has(built):
    run("echo")
    thing = points_of(built, "echo")
    (modifier,) = thing.modifiers
    assert chosen_input(modifier, COLOUR_BY) == "Loudness"
    by_loudness = colours(thing)
    level = np.empty(len(by_loudness), np.float32)
    thing.data.attributes["level"].data.foreach_get("value", level)
    assert by_loudness[np.argmax(level), 0] > by_loudness[np.argmin(level), 0]
    choose_input(modifier, COLOUR_BY, "Delay")
    assert np.abs(colours(thing) - by_loudness).max() > 0.1
    menu = next(n for n in modifier.node_group.nodes if n.type == "MENU_SWITCH")
    offered = [item.name for item in menu.enum_items]
    assert offered == ["Loudness", "Tree", "Delay", "Distance", "Height"]
    assert {entry.choice for entry in built.results["echo"].legend} <= set(offered)


def test_a_swatch_is_the_colour_of_the_screen():
    pixels = pixels_of((0.5, 0.0, 1.0))
    assert pixels[SIDE // 2, SIDE // 2] == pytest.approx([0.5**GAMMA, 0.0, 1.0, 1.0])
    assert pixels[0, 0, 3] == 0


@pytest.mark.parametrize("grey", [0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0])
@pytest.mark.parametrize(
    "panel", [0.16, 0.19, 0.45, 0.6, 0.7, 0.8]
)  # of themes, as the screen has it
def test_a_swatch_is_seen_on_any_theme(grey, panel):
    """Its rim or its middle is apart from the panel, and the rim from the middle."""
    shown = pixels_of((grey,) * 3)[SIDE // 2, :, :]
    filled = shown[shown[:, 3] == 1][:, 0]
    assert abs(filled - panel).max() > 0.24
    assert np.ptp(filled) > 0.35


@pytest.mark.slow
def test_cycles_renders_points_where_that_is_asked_for(props, sensor, tmp_path):
    """EEVEE needs a graphics card: the session in the window renders there."""
    cube = add_cube()
    sensor("terrestrial", name="cloud", position=(3, 0.5, 0.5), angle_step_deg=1)
    run("cloud")
    cube.hide_render = True
    scene, thing = bpy.context.scene, points_of(props, "cloud")
    set_input(thing.modifiers[0], "Radius", 0.05)
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    eye.location, eye.rotation_euler = (4, 0.5, 0.5), (np.pi / 2, 0, np.pi / 2)
    scene.collection.objects.link(eye)
    scene.camera, scene.render.engine = eye, "CYCLES"
    scene.cycles.samples, scene.render.film_transparent = 1, True
    scene.render.resolution_x = scene.render.resolution_y = 32
    covered = []
    for hidden in (True, False):
        thing.hide_render = hidden
        scene.render.filepath = str(tmp_path / f"{hidden}.png")
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(scene.render.filepath)
        covered.append(float(np.array(picture.pixels[:])[3::4].mean()))
    assert covered[0] == 0
    assert covered[1] > 0.1


@pytest.mark.slow
def test_there_is_one_object_a_sensor(built):
    for _ in range(2):
        run("cloud")
        run("echo")
    assert len([thing for thing in bpy.data.objects if CLOUD_KEY in thing]) == 2


@pytest.mark.medium
def test_the_legend_follows_the_scale_of_colours(built):
    run("cloud")
    thing = points_of(built, "cloud")
    (modifier,) = thing.modifiers
    choose_input(modifier, COLOUR_BY, "Distance")
    choose_input(modifier, COLOUR_MAP, "Heat")
    assert {COLOUR_MAP, SHARE} <= set(drawn())
    distance = np.empty(len(thing.data.vertices), np.float32)
    thing.data.attributes["distance"].data.foreach_get("value", distance)
    seen = colours(thing)
    for end, share in ((np.argmin(distance), 0.0), (np.argmax(distance), 1.0)):
        assert seen[end] == pytest.approx(on_map("Heat", share), abs=2e-3)
    shown = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(panel, "_icon", lambda colour: shown.append(colour) or 0)
        drawn()
    assert [c for c in shown if c == tuple(on_map("Heat", 1.0))]
    choose_input(modifier, COLOUR_BY, "Organ")
    assert COLOUR_MAP not in drawn()


def test_a_scale_says_numbers_as_one_writes_them():
    from forest_addon.blender.show import cloud

    def said(low, high):
        return [entry.name for entry in cloud._scaled("Height", np.array([low, high]), "m")]

    assert said(-4.44e-16, 11.7) == ["0.0 m", "3.9 m", "7.8 m", "11.7 m"]
    assert said(0.0, 90_000.0) == ["0 m", "30,000 m", "60,000 m", "90,000 m"]
    assert said(1.0, 1.006) == ["1.0000 m", "1.0020 m", "1.0040 m", "1.0060 m"]


def test_things_that_are_called_alike_stand_once_in_a_legend():
    from forest_addon.blender.show import cloud

    numbers = np.repeat([0, 1, 2, 3], [5, 9, 7, 1])
    entries = cloud._named("Object", numbers, ("Ground", "rock", "rock", "rock"), cloud._of_number)
    assert [entry.name for entry in entries] == ["rock", "Ground"]
    assert entries[0].colour == cloud._of_number(1)


@pytest.mark.parametrize(
    ("value", "unit", "words"),
    [(2e-14, "m", "< 0.001 mm"), (0.0123, "m", "12.300 mm"), (3e-9, "of all", "< 0.0001 %"),
     (6.7e-05, "", "0.0067 %"), (float("inf"), "m", "inf m")],
)  # fmt: skip
def test_an_audit_says_errors_as_one_does(value, unit, words):
    from forest_addon.ui.results.finding import plain

    assert plain(value, unit) == words


@pytest.mark.medium
def test_what_renders_do_not_show_and_sensors_meet_is_said(built):
    from forest_addon.ui.sensors.run import names_unrendered

    layer = bpy.context.view_layer
    assert names_unrendered(layer) == ""
    cube = add_cube()
    cube.hide_render = True
    run("cloud")
    assert names_unrendered(layer) == "Hidden in renders, and sensed all the same: cube"
    cube.forest_seen = False
    assert names_unrendered(layer) == ""
