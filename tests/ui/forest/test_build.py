"""Forests built by the button, for real, of three small trees."""

from types import SimpleNamespace

import numpy as np
import pytest

from ..test_panels import Layout

bpy = pytest.importorskip("bpy")

from bpy_extras.object_utils import world_to_camera_view
from mathutils import Matrix, Vector
from references.scenes import add_mesh, keyed, link, reopened
from ui.pressing import ROOT, SENSORS, clouds, counts, facts, press, run, trees

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.blender.jobs import Job
from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.blender.scene import forest as room, layout
from forest_addon.blender.scene.instances import TREE_KEY
from forest_addon.blender.scene.layout import TREES, part
from forest_addon.blender.scene.nodes import shown_of
from forest_addon.blender.sensors.objects import sensors_of
from forest_addon.blender.show import intensity
from forest_addon.blender.show.preview import LAWN
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.mesh.stand_in import LEVELS
from forest_addon.site import ForestSite
from forest_addon.spec import Scene
from forest_addon.ui.forest import build, scene_file, start
from forest_addon.ui.forest.start import (
    GALLERY,
    PREVIEWS,
    SCENES,
    draw_gallery,
    draw_presets,
    presets,
)
from forest_addon.ui.forest.wind import forest_of_points
from forest_addon.ui.sensors.run import chosen_things
from forest_addon.ui.settings import exchange


@pytest.mark.medium
def test_build_plants_a_forest(built):
    assert 1 <= len(trees()) <= 12
    assert len({tree.data for tree in trees()}) == 1
    assert facts(built, "forest")["Trees"] == str(len(trees()))
    assert {*SENSORS, "reverb receiver"} == {
        obj.name for obj in layout.part(bpy.context.scene, "Sensors").objects
    }


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


def test_the_first_press_starts_with_the_demo_scene(props, monkeypatch, tmp_path):
    text = (ROOT / "assets/scenes/demo.toml").read_text().split("[[plantings]]")[0]
    demo = tmp_path / "demo.toml"
    demo.write_text(text)
    monkeypatch.setattr(build, "DEMO", demo)
    assert press("build") == {"FINISHED"}
    assert props.name == "Demo forest"
    assert exchange.to_spec(bpy.context.scene).forest == read_settings(demo, Scene).forest


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
    add_mesh("hill", [(-9, -9, 5), (9, -9, 5), (9, 9, 5), (-9, 9, 5)], (0, 1, 2, 3))
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


# ------------------------------------------------------------------------------------------- display
# What views show of a large forest: full trees, stand-ins or dots; sensors see full trees all the same.


def drawn():
    """Triangles that a view draws of trees, how many instances, and how many dots."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    (obj,) = part(bpy.context.scene, TREES).objects
    geometry = obj.evaluated_get(depsgraph).evaluated_geometry()
    instances = geometry.instances_pointcloud()
    sources = [o.data for o in geometry.instance_references() if hasattr(o, "data")]
    dots = len(geometry.pointcloud.points) if geometry.pointcloud is not None else 0
    return sources, 0 if instances is None else len(instances.points), dots


@pytest.mark.medium
def test_display_says_and_sets_what_views_show(built):
    assert forest_of_points(bpy.context.scene) is None  # objects: nothing to choose
    assert built.display == "FULL"
    built.forest.instancing = "points"
    press("build")
    count = int(built.results["forest"].figures["Trees"].value)
    run("cloud")
    seen = len(bpy.data.objects[built.results["cloud"].shown].data.vertices)
    for display in ("LIGHT", "DOTS", "FULL"):
        built.display = display
        assert shown_of(forest_of_points(bpy.context.scene)) == built.display == display
        sources, instances, dots = drawn()
        assert (instances, dots) == ((0, count) if display == "DOTS" else (count, 0))
        if display == "LIGHT":
            assert all(0 < len(data.polygons) <= LEVELS[0].most for data in sources)
        run("cloud")  # sensors see full trees
        assert len(bpy.data.objects[built.results["cloud"].shown].data.vertices) == seen
    built.display = "DOTS"
    built.seed += 1
    press("build")
    assert built.display == "DOTS"  # what was chosen stays


@pytest.mark.medium
def test_many_triangles_become_points_shown_by_stand_ins(built, monkeypatch):
    assert len(trees()) == 3
    monkeypatch.setattr(room, "SHOWN_IN_FULL", 100)
    press("build")
    assert built.display == "LIGHT"
    assert trees() == []
    built.forest.instancing = "objects"  # asked for: the user's own choice
    press("build")
    assert len(trees()) == 3


def test_triangles_are_counted_as_they_are_drawn(built):
    forest = ForestSite.read(exchange.to_spec(bpy.context.scene)).grow()
    shown = [len(obj.data.polygons) for obj in trees()]
    assert room.triangles_of(forest) == np.sum(shown)


# -------------------------------------------------------------------------------------------- beside
# A forest beside the start cube is the same forest, with its sensors, moved.

WAY = np.array((11.0, -18.0))


@pytest.mark.slow
@pytest.mark.parametrize("preset", [*GALLERY])
def test_trees_and_sensors_keep_their_places_among_each_other(preset):
    path = ASSETS / "scenes" / f"{preset}.toml"
    there = read_settings(path, Scene)
    assert not scene_file._is_bound(there)
    moved = scene_file.moved(there, tuple(WAY))
    stands = [ForestSite.read(s, path.parent).plan() for s in (there, moved)]
    assert len(stands[0]) == len(stands[1]) > 0
    np.testing.assert_allclose(
        stands[1].position[:, :2], stands[0].position[:, :2] + WAY, atol=1e-6
    )
    for before, after in zip(there.sensors, moved.sensors, strict=True):
        several = before.kind == "mobile"
        poses = zip(before.poses, after.poses, strict=True) if several else ()
        for one, other in ((before, after), *poses):
            for name in ("position", "source", "receiver"):
                if isinstance(getattr(one, name, None), tuple):
                    way = np.subtract(getattr(other, name), getattr(one, name))
                    np.testing.assert_allclose(way, (*WAY, 0.0), atol=1e-9)


def test_only_the_cube_of_a_new_file_in_a_window_moves_a_forest(empty_blender, monkeypatch):
    demo = read_settings(ASSETS / "scenes" / "demo.toml", Scene)
    scene = bpy.context.scene
    assert scene_file.beside_cube(scene, demo) == demo
    bpy.ops.mesh.primitive_cube_add()
    assert scene_file.beside_cube(scene, demo) == demo  # no window
    assert scene_file._is_start(scene)
    scene.objects["Cube"].location.x = 3.0
    assert not scene_file._is_start(scene)


# -------------------------------------------------------------------------------------- results stay
# Results outlive a new forest: they are marked, and one click runs their sensors again.


@pytest.mark.medium
def test_results_stay_marked_until_they_are_run_again(built, tmp_path):
    run("cloud")
    run("scan")
    (points,) = [obj for obj in clouds() if obj.name == built.results["cloud"].shown]
    count = len(points.data.vertices)
    built.seed += 1
    press("build")
    assert {r.name: r.stale for r in built.results} == {
        "forest": False,
        "cloud": True,
        "scan": True,
    }
    assert len(points.data.vertices) == count  # what was found is still shown
    press("export_result", result="cloud", filepath=str(tmp_path / "before.ply"))  # and exported
    run("cloud")
    assert [r.name for r in built.results if r.stale] == ["scan"]
    assert [t.name for t in chosen_things(bpy.context.scene, "", again=True)] == ["scan"]
    assert press("run", again=True) == {"FINISHED"}
    assert not any(r.stale for r in built.results)
    assert set(built.results.keys()) == {"forest", "cloud", "scan"}  # the others were not run


@pytest.mark.slow
def test_a_click_in_the_gallery_grows_and_clears_nothing(props):
    bpy.ops.mesh.primitive_cube_add()
    mine = bpy.context.object
    press("add_sensor", kind="terrestrial")
    tripod = bpy.context.view_layer.objects.active
    assert press("start", preset="tanveer-table-1-one", grow=True) == {"FINISHED"}
    assert props.results["forest"].figures["Trees"].value
    assert mine.name in bpy.context.scene.objects
    assert tripod in sensors_of(bpy.context.scene)
    assert len(sensors_of(bpy.context.scene)) > 1


# ------------------------------------------------------------------------------------------- gallery
# The gallery: every card has a scene, a small picture and a sentence, and draws them.

LARGEST = 15_000  # bytes of a picture


@pytest.mark.parametrize("preset", GALLERY)
def test_a_card_has_a_scene_a_small_picture_and_a_sentence(preset):
    assert (SCENES / f"{preset}.toml").is_file()
    picture = (PREVIEWS / f"{preset}.jpg").read_bytes()
    assert picture[:2] == b"\xff\xd8"
    assert len(picture) <= LARGEST
    assert all(GALLERY[preset])


@pytest.mark.parametrize("operator", ["forest.start", "forest.new"])
def test_the_gallery_shows_them_all(registered, operator):
    seen = []
    draw_gallery(Layout(seen), operator)
    assert {title for title, _ in GALLERY.values()} <= set(seen)


def test_an_entry_says_what_it_is_for(props):
    given = type("Given", (), {"preset": "hedge-bat"})()
    assert start._start.description(bpy.context, given) == GALLERY["hedge-bat"][1]


@pytest.mark.parametrize("operator", ["forest.start", "forest.new"])
def test_the_menu_has_names_and_every_preset_once(registered, operator):
    """A name of a paper's scene says what stands there before it says whose it is."""
    seen, direct = [], []
    draw_presets(Layout(seen), operator)
    layout = Layout(direct)
    layout.menu = lambda *_, **__: None
    draw_presets(layout, operator)
    assert len(direct) <= 10
    others = {title for file, title in presets() if file not in GALLERY}
    assert others <= set(seen)
    assert len(seen) == len(set(seen))
    for title in others:
        assert not title.startswith(("T20", "Fig", "Table")), title
        assert title[0].isupper()
        assert "-" not in title


# ------------------------------------------------------------------------------------------ new file
# File > New > Forest: start scenes in a file of their own.


def in_picture(scene, corners):
    """Coordinates of places in the camera's picture, 0 to 1."""
    bpy.context.view_layer.update()
    for corner in corners:
        seen = world_to_camera_view(scene, scene.camera, Vector(corner))
        assert seen.z > 0
        yield seen.xy


def ground_of(scene):
    """The corners of the field."""
    (x, y), (wide, deep) = scene.forest_sensing.forest.origin, scene.forest_sensing.forest.size
    return [(x, y, 0), (x + wide, y, 0), (x, y + deep, 0), (x + wide, y + deep, 0)]


def crowns_of(scene):
    """The corners of the boxes about its trees."""
    trees = [obj for obj in scene.objects if TREE_KEY in obj]
    return [tree.matrix_world @ Vector(corner) for tree in trees for corner in tree.bound_box]


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "trees"), [("tanveer-one-tree", 1), ("paper-100k", 0)])
def test_a_start_scene_stands_built_and_lit(props, preset, trees):
    bpy.data.meshes.new("of the old file").use_fake_user = True
    assert bpy.ops.forest.new(preset=preset) == {"FINISHED"}
    scene = bpy.context.scene
    assert "of the old file" not in bpy.data.meshes
    assert sum(TREE_KEY in obj for obj in scene.objects) == trees
    assert "forest" in scene.forest_sensing.results
    assert scene.forest_sensing.name == read_settings(SCENES / f"{preset}.toml", Scene).name
    assert scene.world is not None
    assert [obj.data.type for obj in scene.objects if obj.type == "LIGHT"] == ["SUN"]
    assert scene.view_settings.exposure > 0.5  # the evening's sun is weak
    for place in in_picture(scene, crowns_of(scene) if trees else ground_of(scene)):
        assert min(place) >= -0.15  # boxes are larger than crowns
        assert max(place) <= 1.15
    assert (scene.camera.location.z < 5) == bool(trees)  # among trees at the height of eyes
    sensors = {sensor.name for sensor in read_settings(SCENES / f"{preset}.toml", Scene).sensors}
    assert sensors <= {obj.name for obj in scene.objects}
    if trees:
        lawn = scene.objects[LAWN]  # for pictures: views do not show it, and no sensor meets it
        assert (lawn.hide_viewport, lawn.hide_render) == (True, False)
        assert LAWN not in read_scene(bpy.context.evaluated_depsgraph_get()).object_name


def test_the_empty_one_has_light_a_camera_and_nothing_else(props):
    assert bpy.ops.forest.new(preset="") == {"FINISHED"}
    assert {obj.type for obj in bpy.context.scene.objects} == {"LIGHT", "CAMERA"}


def test_the_menu_is_there_and_offers_what_add_offers(registered):
    drawn = bpy.types.TOPBAR_MT_file_new._dyn_ui_initialize()
    assert start.draw_in_new in drawn
    offered = []

    class Offers(Layout):
        def operator(self, name, *words, **style):
            assert name in ("forest.new", "forest.gallery")
            offered.append(super().operator(name, *words, **style))
            return offered[-1]

    start.new.draw(SimpleNamespace(layout=Offers([])), bpy.context)
    presets_offered = [entry.preset for entry in offered if hasattr(entry, "preset")]
    assert sorted(presets_offered) == sorted(["", *(file for file, _ in presets())])


def chosen_anew(_folder):
    start.draw_in_new(SimpleNamespace(layout=Layout([])), None)


@pytest.mark.parametrize(
    ("before", "expected"),
    [
        (lambda _: None, ["demo"]),
        (lambda folder: reopened(folder / "other.blend"), []),
        (chosen_anew, []),
    ],
    ids=["as asked", "another file first", "chosen anew"],
)
def test_the_new_file_that_was_asked_for_is_furnished_and_no_other(
    registered, monkeypatch, tmp_path, before, expected
):
    """In a Blender that has a window; one that comes later is left as it is."""
    furnished = []
    monkeypatch.setattr(start, "_furnish_soon", furnished.append)
    monkeypatch.setattr(start, "_awaited", "demo")
    before(tmp_path)
    for _ in range(2):
        bpy.ops.wm.read_homefile(app_template="")
        assert furnished == expected


def test_add_forest_keeps_the_sensors_that_are_there(small):
    """Add > Forest adds; only who chooses to replaces."""
    before = sensors_of(bpy.context.scene)
    assert bpy.ops.forest.start(preset="demo") == {"FINISHED"}
    bpy.context.view_layer.update()
    after = sensors_of(bpy.context.scene)
    assert set(before) < set(after)
    bpy.ops.forest.start(preset="demo")  # those of the preset are there by now
    assert set(sensors_of(bpy.context.scene)) == set(after)
    bpy.ops.forest.start(preset="demo", sensors="REPLACE")
    assert len(sensors_of(bpy.context.scene)) == len(after) - len(before)


def test_an_opened_scene_file_says_that_sensors_went_or_keeps_them(small, capfd):
    before, demo = set(sensors_of(bpy.context.scene)), str(SCENES / "demo.toml")
    assert bpy.ops.forest.load_scene(filepath=demo, keep_sensors=True) == {"FINISHED"}
    assert before < set(sensors_of(bpy.context.scene))
    count = len(sensors_of(bpy.context.scene))
    assert bpy.ops.forest.load_scene(filepath=demo) == {"FINISHED"}
    assert f"took the place of {count}; undo brings those back" in capfd.readouterr().out


# -------------------------------------------------------------------------------------------- hills
# Hills and their handles: whatever moves one moves the other, and neither is ever left alone.


def gaussian(peak, centre, width):
    return spec.Gaussian(peak=peak, centre=centre, width=width)


HILLS = (gaussian(2.0, (1.0, 2.0), (3.0, 4.0)), gaussian(1.0, (5.0, 4.0), (1.5, 2.5)))


def update():
    bpy.context.view_layer.update()


def said():
    """Every hill as the settings have it."""
    update()
    return [hill for p in exchange.to_spec(bpy.context.scene, []).plantings for hill in p.gaussians]


def circles():
    """Every handle in the scene."""
    things = bpy.context.scene.objects
    return sorted((t for t in things if intensity.HANDLE_KEY in t), key=lambda t: t.name)


def choose(*things):
    for obj in bpy.context.scene.objects:
        obj.select_set(obj in things)
    bpy.context.view_layer.objects.active = things[0]


@pytest.fixture
def hilly(small):
    """The small forest with two hills and their handles."""
    exchange.fill(small.plantings[0], "gaussians", HILLS)
    small.drag_hills = True
    update()
    return small


@pytest.fixture
def hill(hilly):
    return hilly.plantings[0].gaussians[0]


def test_handles_lie_where_hills_are(hilly):
    assert [obj.name for obj in circles()] == ["Hazelnut hill", "Hazelnut hill.001"]
    for obj, hill in zip(circles(), HILLS, strict=True):
        assert (*obj.location[:2], *obj.scale[:2]) == (*hill.centre, *hill.width)
        assert obj.empty_display_size == 1
        assert [home.name for home in obj.users_collection] == [layout.INTENSITY]
    assert said() == list(HILLS)


def test_switched_off_nothing_stays(hilly):
    before = len(bpy.data.objects)
    hilly.drag_hills = False
    assert circles() == []
    assert len(bpy.data.objects) == before - 2
    assert said() == list(HILLS)


def test_a_handle_that_is_moved_and_scaled_moves_its_hill(hill):
    hill.handle.location, hill.handle.scale = (-2.5, 7.25, 3.0), (0.5, 6.5, 1.0)
    assert said() == [gaussian(2.0, (-2.5, 7.25), (0.5, 6.5)), HILLS[1]]


def test_numbers_that_are_typed_move_the_handle(hill):
    hill.centre, hill.width = (0.1, 0.7), (0.3, 12.3)
    assert (*hill.handle.location[:2], *hill.handle.scale[:2]) == pytest.approx(
        (0.1, 0.7, 0.3, 12.3)
    )
    assert said()[0] == gaussian(2.0, (0.1, 0.7), (0.3, 12.3))


def test_a_mirrored_or_flat_handle_is_a_hill_that_can_be_built(hill):
    hill.handle.scale = (-3.0, 0.0, 1.0)
    assert said()[0].width == (3.0, intensity.LEAST)


def test_a_parent_moves_a_hill_and_numbers_hold_beside_it(hill):
    parent = link("cart")
    parent.matrix_world = Matrix.Translation((10, 0, 0)) @ Matrix.Rotation(1.5707963, 4, "Z")
    hill.handle.parent = parent
    found = said()[0]
    assert found.centre == pytest.approx((8.0, 1.0), abs=1e-5)
    assert found.width == pytest.approx((4.0, 3.0), abs=1e-5)  # a quarter turn
    hill.centre = (2.2, 3.3)
    assert said()[0].centre == (2.2, 3.3)
    assert hill.handle.matrix_world.translation[:2] == pytest.approx((2.2, 3.3), abs=1e-5)


def test_a_keyed_handle_takes_its_hill_along(hill):
    keyed(hill.handle, "location", {1: (0, 2, 0), 11: (5, 2, 0)})
    for frame, x in ((1, 0.0), (11, 5.0), (1, 0.0)):
        bpy.context.scene.frame_set(frame)
        assert hill.centre[0] == pytest.approx(x)


@pytest.mark.parametrize("how", ["exclude", "hide_viewport", "hide_set"])
def test_a_hidden_handle_says_nothing(hill, how):
    home = bpy.context.view_layer.layer_collection.children["Forest"].children["Intensity"]

    def hide(hidden):
        hill.handle.hide_set(hidden) if how == "hide_set" else setattr(home, how, hidden)

    hide(True)
    update()
    hill.centre = (3.0, 3.5)
    assert said()[0].centre == (3.0, 3.5)
    hide(False)
    assert said()[0].centre == (3.0, 3.5)
    hill.handle.location.x = 2.0
    assert said()[0].centre == (2.0, 3.5)


def test_the_list_adds_and_removes_handles(hilly):
    bpy.ops.forest.add_gaussian()
    assert len(circles()) == 3
    assert circles()[-1].location[:2] == (3.0, 3.0)
    hilly.plantings[0].active_gaussians = 0
    bpy.ops.forest.remove_gaussian()
    assert said()[0] == HILLS[1]
    assert len(circles()) == 2
    bpy.ops.forest.remove_planting()
    assert circles() == []


def test_a_scene_file_brings_handles_of_its_own(hilly):
    settings = exchange.to_spec(bpy.context.scene)
    (planting,) = settings.plantings
    one = spec.Planting(species="maple", expected=2.0, gaussians=(HILLS[1],))
    exchange.from_spec(bpy.context.scene, spec.Scene(plantings=(planting, one)))
    assert [t.name for t in circles()] == ["Hazelnut hill", "Hazelnut hill.001", "Maple hill"]
    assert said() == [*HILLS, HILLS[1]]


def test_deleting_a_handle_deletes_its_hill(hilly):
    choose(circles()[0])
    bpy.ops.object.delete()
    assert said() == [HILLS[1]]
    assert len(circles()) == 1
    hilly.drag_hills = False
    hilly.drag_hills = True
    assert said() == [HILLS[1]]
    assert len(circles()) == 1


def test_hills_stay_when_the_whole_collection_is_deleted(hilly):
    bpy.data.collections.remove(layout.root(bpy.context.scene))
    assert said() == list(HILLS)


def test_hills_stay_when_another_such_collection_is_made_later(hilly):
    bpy.data.collections.remove(layout.find_part(bpy.context.scene, layout.INTENSITY))
    assert said() == list(HILLS)
    assert bpy.ops.forest.paint() == {"FINISHED"}
    assert bpy.ops.forest.paint() == {"FINISHED"}
    assert said() == list(HILLS)


def test_a_copied_handle_is_a_new_hill(hilly):
    choose(circles()[0])
    bpy.ops.object.duplicate_move(TRANSFORM_OT_translate={"value": (2, 1, 0)})
    assert said() == [*HILLS, gaussian(2.0, (3.0, 3.0), (3.0, 4.0))]
    assert hilly.plantings[0].active_gaussians == 2
    choose(*circles())
    bpy.ops.object.duplicate()
    assert len(said()) == len(circles()) == 6
    assert len({hill.handle for hill in hilly.plantings[0].gaussians}) == 6


def test_a_renamed_handle_is_still_the_same(hilly):
    circles()[0].name = "clearing"
    update()
    choose(bpy.data.objects["clearing"])
    bpy.ops.object.duplicate()
    assert said() == [*HILLS, HILLS[0]]


def test_list_and_view_choose_the_same(hilly):
    planting = hilly.plantings[0]
    planting.active_gaussians = 1
    assert bpy.context.view_layer.objects.active == planting.gaussians[1].handle
    assert bpy.context.selected_objects == [planting.gaussians[1].handle]
    other = hilly.plantings.add()
    hilly.active_plantings = 1
    update()
    assert hilly.active_plantings == 1  # choosing in the list is not undone by what is active
    choose(planting.gaussians[0].handle)
    update()
    assert (hilly.active_plantings, planting.active_gaussians) == (0, 0)
    assert len(other.gaussians) == 0


def test_undo_and_redo_bring_both_back(hilly):
    def step(change):
        change()
        bpy.ops.ed.undo_push(message="step")

    def first():
        return bpy.context.scene.forest_sensing.plantings[0].gaussians[0]

    step(lambda: None)
    step(lambda: setattr(first().handle, "location", (2, 2, 0)))  # undo is older than the update
    update()
    step(lambda: setattr(first(), "centre", (4, 4)))
    step(lambda: (choose(circles()[0]), bpy.ops.object.delete()))
    assert len(said()) == 1
    expected = [(4.0, 4.0), (2.0, 2.0), (1.0, 2.0)]
    for centre in expected:
        bpy.ops.ed.undo()
        assert said()[0].centre == centre
        assert tuple(first().handle.location[:2]) == centre
        assert len(circles()) == 2
    for centre in [(2.0, 2.0), (4.0, 4.0)]:
        bpy.ops.ed.redo()
        assert said()[0].centre == centre
        assert tuple(first().handle.location[:2]) == centre
    bpy.ops.ed.redo()
    assert said() == [HILLS[1]]


@pytest.mark.medium
def test_a_build_leaves_handles_alone_and_results_do_not_know_them(hilly):
    def built():
        bpy.ops.forest.build()
        return sorted(tuple(t.location) for t in bpy.data.objects if TREE_KEY in t)

    things = circles()
    with_handles = built()
    assert circles() == things
    assert [home.name for home in things[0].users_collection] == [layout.INTENSITY]
    assert [c.name for c in layout.root(bpy.context.scene).children].count(layout.INTENSITY) == 1
    hilly.drag_hills = False
    assert built() == with_handles
    assert len(bpy.data.collections[layout.INTENSITY].objects) == 0


def test_a_saved_file_opens_with_its_handles(hill, tmp_path):
    hill.handle.location.x = 2.5
    before = said()
    reopened(tmp_path / "hills.blend")
    assert said() == before
    circles()[0].location.x = 4.5
    assert said()[0].centre == (4.5, 2.0)


def test_hills_of_a_forest_that_is_shown_in_another_scene_are_left_to_it(hilly):
    here, there = bpy.context.scene, bpy.data.scenes.new("there")
    layout.part(there, layout.TREES)  # a forest of its own
    there.collection.children.link(layout.root(here))
    exchange.fill(there.forest_sensing.plantings.add(), "gaussians", HILLS[:1])
    there.forest_sensing.drag_hills = True
    assert len(circles()) == 2  # in the scene here
    assert layout.find_part(there, layout.INTENSITY) != layout.find_part(here, layout.INTENSITY)
    there.forest_sensing.drag_hills = False
    assert len(circles()) == 2
