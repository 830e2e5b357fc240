"""Scene files opened and written by the panel, .blend files saved and opened again."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from .test_hard_cases import (
    HARMLESS,
    SHARES,
    again,
    arguments,
    home,
    operators,
    press as tried,
    unclear,
)
from .test_panels import drawn

bpy = pytest.importorskip("bpy")

from references.scenes import add_collection, add_mesh, link, reopened
from ui import test_panels
from ui.pressing import ROOT, add_cube, counts, facts, press, run, trees

from forest_addon import api, spec
from forest_addon.base.places import ASSETS
from forest_addon.blender.files.export import empty_file
from forest_addon.blender.scene import nodes
from forest_addon.blender.scene.instances import read_points
from forest_addon.blender.scene.layout import (
    CLOUD_KEY,
    COLOUR_BY,
    RADIUS,
    RESULTS,
    SENSORS,
    SHARE,
    TREES,
    find_part,
    root,
)
from forest_addon.blender.sensors.observe import Observer
from forest_addon.flight.woods import Stock
from forest_addon.formats.toml_file import read_settings, table_of, write_settings
from forest_addon.growth.library import find_species, load_species
from forest_addon.spec import (
    Accuracy,
    Flight,
    Forest,
    Normal,
    Output,
    Planting,
    Raster,
    Reverb,
    Scene,
    Sonar,
    Species,
    Targets,
    Terrestrial,
)
from forest_addon.spec.base import with_files
from forest_addon.ui.forest.scene_file import write_scene
from forest_addon.ui.overlay import seen_points
from forest_addon.ui.settings import exchange, references as saved
from forest_addon.ui.species.edit import relocated
from headless.cli import main
from headless.dataset import scene as dataset
from headless.dataset.disk import begin
from headless.dataset.plan import Recipe
from headless.dataset.settings import Ground, Keep

NOTHING = dict.fromkeys(
    ("pictures", "goodness", "leaves", "report", "blend", "glb", "preview"), False
)


@pytest.mark.medium
def test_the_panel_exports_for_other_programs(built, tmp_path):
    assert press("export_others", directory=str(tmp_path / "others")) == {"FINISHED"}
    said = json.loads((tmp_path / "others/scene.json").read_text())
    assert sum(part["tree"] >= 0 for part in said["parts"]) == len(trees())
    assert all((tmp_path / "others" / part["file"]).is_file() for part in said["parts"])
    assert (tmp_path / "others/forest.glb").is_file()


@pytest.mark.slow
def test_species_files_are_found_beside_the_scene_file(props, tmp_path):
    (tmp_path / "species").mkdir()
    shutil.copy(ROOT / "assets/species/hazelnut.toml", tmp_path / "species")
    shutil.copytree(ROOT / "assets/templates/hazelnut", tmp_path / "templates/hazelnut")
    (tmp_path / "scene.toml").write_text(
        '[forest]\nsize = [6, 6]\n[[plantings]]\nspecies = "species/hazelnut.toml"\nexpected = 3\n'
    )
    press("load_scene", filepath=str(tmp_path / "scene.toml"))
    assert press("build") == {"FINISHED"}


@pytest.mark.slow
def test_a_saved_file_brings_everything_back(ran, tmp_path):
    before, figures = exchange.to_spec(bpy.context.scene), facts(ran, "echo")
    props = reopened(tmp_path / "forest.blend").forest_sensing
    assert exchange.to_spec(bpy.context.scene) == before
    assert facts(props, "echo") == figures
    count = counts()
    press("build")
    run("cloud")
    run("echo")
    assert counts() == count


def test_the_offset_that_a_file_asks_for_is_taken_and_undone(small, tmp_path):
    heights = " ".join(["250"] * 2400)
    (tmp_path / "dem.asc").write_text(
        f"ncols 60\nnrows 40\nxllcorner 500000.5\nyllcorner 5400000\ncellsize 1\n{heights}"
    )
    small.folder, small.forest.terrain.file = str(tmp_path), "dem.asc"
    with pytest.raises(RuntimeError, match=r"offset = \[500028, 5400017, 0\] at the top"):
        bpy.ops.forest.build()
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.forest.take_offset("EXEC_DEFAULT", True) == {"FINISHED"}
    assert bpy.context.scene.forest_sensing.offset == "[500028.0, 5400017.0, 0.0]"
    assert bpy.ops.forest.take_offset() == {"FINISHED"}  # there already
    assert bpy.context.scene.forest_sensing.offset == "[500028.0, 5400017.0, 0.0]"
    bpy.ops.ed.undo()
    assert "500028" not in bpy.context.scene.forest_sensing.offset


# -------------------------------------------------------------------------------------- scene export
# Exported scene files: they mean the same wherever they are written, and name the .blend they start from.


@pytest.fixture
def slope(small):
    """A mesh of the user's own, as large as the field and more."""
    corners = [(-9, -9, 0), (15, -9, 1), (15, 15, 2), (-9, 15, 1)]
    obj = add_mesh("slope", corners, (0, 1, 2), (0, 2, 3))
    bpy.context.view_layer.update()
    return obj


def test_files_are_named_from_where_the_scene_file_stands(small, tmp_path):
    home, elsewhere = tmp_path / "home", tmp_path / "else" / "where"
    home.mkdir()
    elsewhere.mkdir(parents=True)
    np.save(home / "hill.npy", np.ones((4, 4)))
    origin = find_species("hazelnut", Path())
    write_settings(
        home / "own.toml", relocated(read_settings(origin, Species), origin.parent, home)
    )
    planting, small.folder = small.plantings[0], str(home)
    exchange.write(planting.rasters.add(), Raster(file="hill.npy"))
    planting.species = "own.toml"
    assert write_scene(bpy.context.scene, elsewhere / "mine.toml") == ""
    back = read_settings(elsewhere / "mine.toml", Scene).plantings[0]
    assert back.rasters[0].file == "../../home/hill.npy"
    species, _ = load_species(elsewhere / back.species)
    assert species.name == "hazelnut"


def test_what_is_shipped_or_missing_keeps_its_name(small, sensor, tmp_path):
    sensor("sonar", name="flying", route="tanveer-eight.csv", call_file="gone.wav")
    sensor("airborne", scanner="riegl-vux-1uav")
    write_scene(bpy.context.scene, tmp_path / "mine.toml")
    back = read_settings(tmp_path / "mine.toml", Scene)
    assert back == exchange.to_spec(bpy.context.scene)
    assert back.plantings[0].species == "hazelnut"


def test_an_object_of_ones_own_needs_a_saved_file(slope, tmp_path):
    path = tmp_path / "mine.toml"
    wanting = write_scene(bpy.context.scene, path)
    assert "slope" in wanting
    assert "save that and export again" in wanting
    assert read_settings(path, Scene).blend == ""
    (tmp_path / "work").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work" / "forest.blend"))
    assert "save that too" not in write_scene(bpy.context.scene, path)
    assert read_settings(path, Scene).blend == "work/forest.blend"


def test_what_sensors_do_not_see_needs_none(slope, tmp_path):
    slope["forest_ignored"] = True
    assert write_scene(bpy.context.scene, tmp_path / "mine.toml") == ""
    bpy.context.scene.forest_sensing.forest.terrain.object = "slope"
    assert "save that and export again" in write_scene(bpy.context.scene, tmp_path / "mine.toml")


@pytest.mark.slow
@pytest.mark.parametrize("terrain", ["", "slope"])
def test_without_a_window_the_exported_scene_gives_the_same_bytes(slope, tmp_path, terrain):
    """Every result, bit for bit; on a terrain of one's own from the .blend file that has it."""
    props = bpy.context.scene.forest_sensing
    slope["forest_ignored"], props.forest.terrain.object = not terrain, terrain
    bpy.data.objects["cloud"].location.z = 2
    panel, out, path = (tmp_path / name for name in ("new/panel", "headless", "scenes/mine.toml"))
    props.output = str(panel)
    assert press("build") == {"FINISHED"}
    assert press("run") == {"FINISHED"}
    told = {result.name: result.file for result in props.results if result.kind != "forest"}
    names = {"scan": "scan.npz", "cloud": "cloud.laz", "echo": "echo.npz", "reverb": "reverb.wav"}
    assert told == {name: str(panel / file) for name, file in names.items()}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "forest.blend"))
    path.parent.mkdir()
    assert press("save_scene", filepath=str(path)) == {"FINISHED"}
    off = "".join(f"{name} = false\n" for name in NOTHING if not (terrain and name == "blend"))
    path.write_text(f"{path.read_text()}\n[output]\n{off}")
    assert main(["run", str(path), "--out", str(out), "--quiet"]) == 0
    results = sorted(file.name for file in panel.glob("[!.]*"))
    assert len(results) == 6
    for name in results:
        ours, theirs = ((where / name).read_bytes() for where in (panel, out))
        if name.endswith(".npz"):  # an archive also holds when it was written
            ours, theirs = ({k: v.tobytes() for k, v in np.load(where / name).items()}
                            for where in (panel, out))  # fmt: skip
        assert ours == theirs, name
    if terrain:
        with bpy.data.libraries.load(str(out / "forest.blend")) as (inside, _):
            sensors = [name for name in inside.objects if name.split(".")[0] in names]
        assert sorted(sensors) == sorted(names)  # each stands there once


def test_a_scene_of_instanced_collections_starts_from_its_blend(props, tmp_path):
    home = bpy.data.collections.new("library")
    add_mesh("stone", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], (0, 1, 2), home=home)
    empty = link("instance")
    empty.instance_type, empty.instance_collection = "COLLECTION", home
    props.seed = 3
    assert "instance" in write_scene(bpy.context.scene, tmp_path / "a.toml")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "here.blend"))
    write_scene(bpy.context.scene, tmp_path / "a.toml")
    assert read_settings(tmp_path / "a.toml", Scene).blend == "here.blend"


@pytest.mark.parametrize("preset", ["tanveer-five-trees", "rioja-pines"])
def test_no_route_leads_into_the_extensions_folder(props, tmp_path, preset):
    """Files that a set-up of the add-on names go along, so that the scene file works on another machine."""
    assert bpy.ops.forest.start(preset=preset) == {"FINISHED"}
    before = exchange.to_spec(bpy.context.scene)
    write_scene(bpy.context.scene, tmp_path / "mine.toml")
    for file in tmp_path.rglob("*.toml"):
        text = file.read_text("utf-8")
        assert "../" not in text
        assert str(ASSETS) not in text
    named = []
    with_files(
        read_settings(tmp_path / "mine.toml", Scene), lambda file: named.append(file) or file
    )
    ours = [file for file in named if "mine-files/" in file]
    assert ours
    for file in ours:
        assert (tmp_path / file).read_bytes() == next(ASSETS.rglob(Path(file).name)).read_bytes()
    elsewhere = tmp_path / "else"
    (tmp_path / "mine.toml").rename(tmp_path / "moved.toml")
    elsewhere.mkdir()
    bpy.ops.forest.load_scene(filepath=str(tmp_path / "moved.toml"))
    assert len(exchange.to_spec(bpy.context.scene).sensors) == len(before.sensors)


def test_files_that_are_dropped_are_taken(props, tmp_path):
    """Handlers name operators that there are, and take a file at once."""
    known = {"FOREST_FH_load_scene", "FOREST_FH_take_ground", "FOREST_FH_import_tree"}
    handlers = {name: getattr(bpy.types, name) for name in known}
    endings = " ".join(handler.bl_file_extensions for handler in handlers.values())
    assert {".toml", ".laz", ".stl"} <= set(endings.replace(";", " ").split())
    for handler in handlers.values():
        room, _, name = handler.bl_import_operator.partition(".")
        operator = getattr(getattr(bpy.ops, room), name).get_rna_type()
        assert "filepath" in operator.properties
        assert operator.properties["filepath"].is_skip_save
    assert bpy.ops.forest.take_ground(filepath=str(tmp_path / "hill.laz")) == {"FINISHED"}
    assert exchange.to_spec(bpy.context.scene).forest.terrain.file == str(tmp_path / "hill.laz")


# --------------------------------------------------------------------------------------------- saved
# Files that are saved and loaded: of today, of a later version, of somebody else.


def test_a_file_of_a_newer_version_says_so(props, tmp_path, caplog):
    props.seed, props.layout = 5, saved.LAYOUT + 1
    for _ in range(2):  # also when it was saved here
        props = reopened(tmp_path / "newer.blend").forest_sensing
        assert props.notice.startswith("Saved by a newer version")
        assert "Update Forest Sensing" in props.notice
        assert "newer version" in caplog.text
        assert props.layout == saved.LAYOUT + 1
        assert "Saved by a newer version" in test_panels.drawn()
    assert props.seed == 5
    assert bpy.ops.forest.take_note() == {"FINISHED"}
    assert not props.notice
    assert not bpy.ops.forest.take_note.poll()


def test_a_file_without_settings_of_ours_is_not_touched(props, tmp_path, caplog):
    test_panels.drawn()  # drawing makes empty groups in Blender 4.5
    scene = reopened(tmp_path / "own.blend")
    assert exchange.untouched(scene.forest_sensing)
    assert not scene.forest_sensing.is_property_set("layout")
    assert len(bpy.data.objects) == 0
    assert caplog.text == ""


def test_handlers_go_with_the_add_on(registered):
    from forest_addon import ui

    handlers = bpy.app.handlers
    lists = (handlers.load_post, handlers.blend_import_post, handlers.save_pre)
    assert all(any(h.__module__ == saved.__name__ for h in hooked) for hooked in lists)
    ui.unregister()
    try:
        assert not any(h.__module__ == saved.__name__ for hooked in lists for h in hooked)
        assert not bpy.app.timers.is_registered(saved._look_at_all)
    finally:
        ui.register()


def test_what_is_shown_in_other_units_is_not_stored(props, tmp_path, caplog):
    """Angles, kHz and the instruments' names convert what a file has, and leave it in its units."""
    props.seed = 4
    scene = bpy.context.scene
    for sensor in (spec.Sonar(beam_width_deg=(40, 40)), spec.Terrestrial(angle_step_deg=6)):
        exchange.add_sensor(scene, sensor)
    bpy.context.view_layer.update()
    before = exchange.to_spec(scene)
    bat = bpy.data.objects["echo"].forest_sensor.sonar
    cloud = bpy.data.objects["cloud"].forest_sensor.terrestrial
    assert list(bat.band_shown) == [60.0, 80.0]
    assert cloud.angle_step_deg_shown == pytest.approx(math.radians(6))
    for name in ("band_shown", "sample_rate_shown", "beam_width_deg_shown"):
        setattr(bat, name, getattr(bat, name))
    cloud.angle_step_deg_shown = cloud.angle_step_deg_shown
    assert exchange.to_spec(scene) == before
    scene = reopened(tmp_path / "today.blend")
    assert exchange.to_spec(scene) == before
    assert scene.forest_sensing.layout == saved.LAYOUT
    assert (scene.forest_sensing.notice, caplog.text) == ("", "")


# --------------------------------------------------------------------------------------------- doors
# One scene through every door (API, panel, dataset, flight, command) is one forest, to the bit.

BUSH = Planting(species="hazelnut", variants=2, expected=3, exact=True)
SAPLING = Planting(
    species="scots-pine",
    variants=2,
    expected=2,
    exact=True,
    targets=Targets(dbh=Normal(mean=0.05, sd=0.01), height=4.0),
)
CLAP = Reverb(source=(1, 1, 1), receiver=(5, 5, 1), sample_rate=4000, duration=0.05)
BAT = Sonar(position=(-1.0, 3.0, 1.0), max_range=2.0)
# Whether leaves are there: of a reverb without leaves none, of a bat at the edge those of near variants.
SCENES = {
    "full": ((BUSH,), (CLAP,), "full"),
    "unheard": ((BUSH,), (CLAP,), "auto"),
    "near": ((BUSH,), (BAT,), "auto"),
    "looked at": ((BUSH,), (CLAP, Terrestrial(position=(3, 3, 1), angle_step_deg=20)), "auto"),
    "measured": ((SAPLING, BUSH), (), "full"),
}


def scene_of(name):
    plantings, sensors, detail = SCENES[name]
    return Scene(
        name="Doors",
        seed=5,
        forest=Forest(size=(6.0, 6.0), margin=2.0, instancing="points"),
        plantings=plantings,
        sensors=sensors,
        accuracy=Accuracy(detail=detail, audit=0.0),
        flight=Flight(distance=5.0),
        output=Output(**NOTHING),
    )


def seen():
    """The geometry that stands in Blender now."""
    return Observer(bpy.context.evaluated_depsgraph_get()).geometry


def by_api(scene, _folder):
    empty_file()
    api.build(scene)
    return seen()


def by_panel(scene, folder):
    empty_file()
    path = folder / "scene.toml"
    write_settings(path, scene)
    assert press("load_scene", filepath=str(path)) == {"FINISHED"}
    assert press("build") == {"FINISHED"}
    return seen()


def by_dataset(scene, folder):
    recipe = Recipe(
        number=0,
        split="train",
        seed=0,
        base="doors",
        scene=table_of(scene.changed(sensors=())),
        folder=str(folder),
        ground=Ground(),
        places=[],
        keep=Keep(),
        library=None,
        varied={},
    )
    recipe.scene["sensors"] = table_of(scene).get("sensors", [])
    out = folder / "dataset"
    dataset.make(recipe, begin(out, 0), out, dataset.Session(), threads=1)
    return seen()


def by_flight(scene, _folder):
    empty_file()
    around = Stock(scene).surroundings()
    around.world()
    standing = seen()
    same(around.geometry, standing)
    return standing


def by_command(scene, folder):
    path = folder / "command.toml"
    write_settings(path, scene)
    assert main(["run", str(path), "--out", str(folder / "out"), "--quiet"]) == 0
    return seen()


def same(one, other):
    """Two geometries, instance by instance, whatever the order of meshes."""
    assert len(one) == len(other)
    for name in ("transform", "tree", "species"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    for a, b in zip(one.mesh_index.tolist(), other.mesh_index.tolist(), strict=True):
        for name in ("vertices", "triangles", "part", "leaf"):
            ours, theirs = (getattr(g.meshes[k], name) for g, k in ((one, a), (other, b)))
            assert np.array_equal(ours, theirs), name


def leaves_of(geometry):
    """Triangles of leaves that stand."""
    each = np.array([(mesh.leaf >= 0).sum() for mesh in geometry.meshes])
    return int(each[geometry.mesh_index].sum())


@pytest.fixture(scope="module")
def grown():
    """Scenes as the API makes them."""
    kept = {}

    def made(name):
        if name not in kept:
            kept[name] = by_api(scene_of(name), None)
        return kept[name]

    return made


@pytest.mark.slow
@pytest.mark.parametrize(
    ("door", "name", "like"),
    [
        *((by_panel, name, name) for name in ("measured", "near")),
        *((by_dataset, name, name) for name in ("looked at", "full")),
        *((by_command, name, name) for name in ("near", "unheard")),
        # A flyer may come near any tree, so that all have full detail, whatever other sensors need.
        *((by_flight, "unheard", "full"), (by_flight, "measured", "measured")),
    ],
)
def test_every_door_opens_on_the_same_forest(props, grown, door, name, like, tmp_path):
    same(door(scene_of(name), tmp_path), grown(like))


def test_who_hears_no_leaf_grows_none(grown):
    assert leaves_of(grown("full")) > 1000
    assert leaves_of(grown("unheard")) == 0
    assert leaves_of(grown("looked at")) == leaves_of(grown("full"))


# --------------------------------------------------------------------------------------- first nodes
# Files with the first node groups. data/first-nodes.blend was saved with them, in Blender 4.5. Six trees as
# points of one object, a cloud that was coloured by distance with points of 70 mm, an echo.

FIRST = Path(__file__).with_name("data") / "first-nodes.blend"


@pytest.fixture
def first(registered):
    bpy.ops.wm.open_mainfile(filepath=str(FIRST))
    yield bpy.context.scene
    bpy.ops.wm.read_factory_settings(use_empty=True)


def placed(obj):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    return read_points(obj.evaluated_get(depsgraph))


def first_nodes_trees(scene):
    (obj,) = find_part(scene, TREES).objects
    return obj


def cloud():
    return next(t for t in bpy.data.objects if t.get(CLOUD_KEY) == "cloud")


def test_its_trees_stand_as_they_stood_and_in_the_new_group_too(first):
    obj = first_nodes_trees(first)
    (modifier,) = obj.modifiers
    was = placed(obj)
    assert (modifier.node_group.name, len(was)) == ("Forest Instancer", 6)
    libraries = [nodes._input(modifier, name)[0] for name in (nodes.VARIANTS, nodes.OUTLINES)]
    obj.modifiers.remove(modifier)
    nodes.give_instancer(obj, *libraries, light=False)
    assert obj.modifiers[0].node_group.name == nodes.INSTANCER
    now = placed(obj)
    assert now.transform.tobytes() == was.transform.tobytes()
    assert [s.name for s in now.source] == [s.name for s in was.source]
    for column in ("index", "tree", "species"):
        assert (getattr(now, column) == getattr(was, column)).all()


def test_light_views_of_the_first_group_are_read_in_full(first):
    obj = first_nodes_trees(first)
    nodes.set_input(obj.modifiers[0], nodes.LIGHT, True)
    assert {source.name[-7:] for source in placed(obj).source} == {"outline"}
    depsgraph = bpy.context.evaluated_depsgraph_get()
    with nodes.in_full(depsgraph):
        inside = read_points(obj.evaluated_get(depsgraph))
        assert "outline" not in {source.name[-7:] for source in inside.source}
    assert nodes.is_light(obj.modifiers[0])


@pytest.mark.medium
def test_its_cloud_is_drawn_and_takes_new_points_as_it_is(first):
    obj = cloud()
    (modifier,) = obj.modifiers
    group = modifier.node_group
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    position, colour, _ = seen_points(obj.evaluated_get(depsgraph))
    assert len(position) == len(obj.data.vertices) > 400
    assert len(np.unique(colour.round(3), axis=0)) > 50  # by distance
    assert {"Distance", "Radius"} <= {nodes.chosen_input(modifier, COLOUR_BY), *drawn()}
    assert run("cloud") == {"FINISHED"}
    assert (cloud(), list(obj.modifiers)) == (obj, [modifier])
    assert modifier.node_group == group
    assert nodes.chosen_input(modifier, COLOUR_BY) == "Distance"
    assert nodes._input(modifier, RADIUS)[0] == pytest.approx(0.07)


@pytest.mark.medium
def test_a_new_cloud_in_such_a_file_has_the_new_inputs(first):
    bpy.data.objects.remove(cloud())
    assert run("cloud") == {"FINISHED"}
    assert nodes.has_input(cloud().modifiers[0], SHARE)


# -------------------------------------------------------------------------------------- users scene
# Nothing of the user's is touched: a scene full of a user's objects before and after every operator.
#
# What is compared is read from Blender's own description of its data: every property of every block that
# the user has made, orphans too, of the scenes, of their view layers' collections, and what is selected,
# active and in which mode. What an operator is for may differ, and is listed in ``FOR``.

__all__ = ["again", "home"]  # fixtures

CHOSEN = {"active", "selected"}  # it adds or selects one object, as Blender's own operators do
FOR = {
    "add_flight": CHOSEN,
    "add_sensor": CHOSEN,
    "add_tree": CHOSEN,
    "load_scene": CHOSEN,
    "paint": CHOSEN | {"mode"},
    "scan_here": CHOSEN,
    "select_result": CHOSEN,
    "start": CHOSEN,
}
OTHER_FILE = {"new"}  # it starts another file, and Blender asks what becomes of this one
FURTHER = {  # operators whose settings decide what they do
    "run frames": ("run", {"sensor": "cloud", "frames": "RANGE", "keep": True}),
    "add_sensor reverb": ("add_sensor", {"kind": "reverb"}),
    "add_sensor mobile": ("add_sensor", {"kind": "mobile"}),
}
PASSING = {
    "objects",
    "users",
    "is_evaluated",
    "preview",
    "tag",
    "session_uid",
    "rna_type",
    "bl_rna",
}


def users_work():
    """Fill the scene with a user's own things, half of them hidden in some way; returns the blocks."""
    scene, layer = bpy.context.scene, bpy.context.view_layer
    before = set(blocks())
    top = scene.collection
    for parent in (top, root(scene), find_part(scene, RESULTS), find_part(scene, SENSORS)):
        for state in ("shown", "excluded", "hidden", "off"):
            made = add_collection(f"my {state}", parent)
            add_cube(f"my {state} thing", made)
            (way,) = (
                lc for lc in layer_collections(layer.layer_collection) if lc.collection == made
            )
            way.exclude, way.hide_viewport = state == "excluded", state == "hidden"
            made.hide_viewport = state == "off"
    for state in ("hide_viewport", "hide_render", "hide_select", "hidden", "picked", "active"):
        obj = add_cube(f"my {state}")
        if state.startswith("hide_"):
            setattr(obj, state, True)
    obj.data.materials.append(bpy.data.materials.new("mine"))
    obj.modifiers.new("mine", "SUBSURF")
    obj.location = 30, 30, 0
    obj.keyframe_insert("location", frame=1)
    bpy.data.objects["my picked"].parent = obj
    for kind in (bpy.data.meshes, bpy.data.materials, bpy.data.collections, bpy.data.texts):
        kind.new("my orphan")
    bpy.data.images.new("my orphan", 4, 4).pixels.foreach_set(
        np.linspace(0, 1, 64, dtype=np.float32)
    )
    bpy.data.node_groups.new("my orphan", "GeometryNodeTree")
    bpy.data.objects.new("my orphan", bpy.data.meshes["my orphan"])
    bpy.data.actions.new("my orphan")
    other = bpy.data.scenes.new("my scene")
    other.collection.objects.link(obj)
    scene.camera = link("my camera", bpy.data.cameras.new("my camera"))
    scene.world = bpy.data.worlds.new("my world")
    scene.timeline_markers.new("mine", frame=2)
    scene.cursor.location, scene.cursor.rotation_euler = (3, 2, 0), (0, 0, 1)
    scene.render.filepath, scene.render.resolution_x = "//mine", 321
    scene.frame_end = 2
    scene.frame_set(1, subframe=0.25)
    for one in list(layer.objects.selected):
        one.select_set(False)
    for name in ("my picked", "my active"):
        bpy.data.objects[name].select_set(True)
    layer.objects.active = obj
    bpy.data.objects["my hidden"].hide_set(True)
    layer.update()
    return [block for block in dict.fromkeys(blocks()) if block not in before]


def blocks():
    """Every block of the file."""
    kinds = (
        getattr(bpy.data, p.identifier)
        for p in bpy.data.bl_rna.properties
        if p.type == "COLLECTION"
    )
    return [block for kind in kinds for block in kind if not isinstance(block, WINDOWS)]


WINDOWS = (bpy.types.WindowManager, bpy.types.Screen, bpy.types.WorkSpace, bpy.types.Library)


def layer_collections(top):
    yield top
    for child in top.children:
        yield from layer_collections(child)


def told(value, deep=2):
    """What Blender tells of a block or a group of settings, without what we added to it."""
    if isinstance(value, bpy.types.ID) and deep < 2:
        return value.name_full
    if not isinstance(value, bpy.types.bpy_struct):
        if hasattr(value, "keys") or type(value).__name__ == "bpy_prop_collection":
            return len(value)
        return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
    if not deep:
        return None
    said = {}
    for known in type(value).bl_rna.properties:
        name = known.identifier
        if name in PASSING or known.is_runtime or name.startswith("forest_"):
            continue
        said[name] = told(getattr(value, name), deep - 1)
    return said


def snapshot(mine):
    """Everything of the user's as it is now, by what it is of."""
    context, found = bpy.context, {}
    alive = set(blocks())
    for block, name in mine:
        found[name] = told(block) if block in alive else "gone"
        if block in alive and isinstance(block, bpy.types.Mesh):
            place = np.empty(3 * len(block.vertices), np.float32)
            block.vertices.foreach_get("co", place)
            found[f"{name} places"] = place.tobytes()
    for scene in bpy.data.scenes:
        found[f"scene {scene.name}"] = told(scene)
    scene, layer = context.scene, context.view_layer
    found["frame"] = scene.frame_current, scene.frame_subframe
    found["cursor"] = tuple(scene.cursor.location), tuple(scene.cursor.rotation_euler)
    found["mode"], found["scene"], found["layer"] = context.mode, scene.name, layer.name
    found["active"] = layer.objects.active and layer.objects.active.name
    objects = [b for b, _ in mine if b in alive and isinstance(b, bpy.types.Object)]
    found["selected"] = [t.name for t in objects if t.select_get()]
    found["seen"] = [(t.name, t.hide_get(), t.visible_get()) for t in objects]
    ours = {block for block, _ in mine}
    found["collections"] = [
        (c.collection.name, c.exclude, c.hide_viewport, c.holdout, c.indirect_only)
        for c in layer_collections(layer.layer_collection)
        if c.collection in ours or c.collection == scene.collection
    ]
    return found


CASES = {name: (name, None) for name in operators() if name not in OTHER_FILE} | FURTHER


def changes(case, folder, mine, before):
    """Press a button; returns whether it did something, and what of the user's is another then."""
    name, settings = CASES[case]
    done, words = tried(name, **(arguments(name, folder) if settings is None else settings))
    after = snapshot(mine)
    allowed = FOR.get(name, set()) if done else set()
    changed = {key: difference(before[key], after.get(key)) for key in before
               if before[key] != after.get(key) and key not in allowed}  # fmt: skip
    return done, {words or case: changed} if changed else {}


def changed_file(again, mode):
    folder = again()
    mine = [(block, f"{type(block).__name__} {block.name_full}") for block in users_work()]
    bpy.ops.object.mode_set(mode=mode)
    return folder, mine, snapshot(mine)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # every property is read, old ones too
@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
@pytest.mark.parametrize("share", range(SHARES))
def test_nothing_of_the_users_is_touched(again, mode, share):
    """Pressed once more, a button works again or says why not. A file serves until one has changed it."""
    fresh = True
    for case in [*CASES][share::SHARES]:
        if fresh:
            folder, mine, before = changed_file(again, mode)
        done, changed = changes(case, folder, mine, before)
        assert changed == {}, case
        name, settings = CASES[case]
        once_more, words = tried(
            name, **(arguments(name, folder) if settings is None else settings)
        )
        assert once_more or not unclear(words), words
        fresh = (done or once_more) and name not in HARMLESS


def difference(one, other):
    """What differs between two snapshots of one thing."""
    if not (isinstance(one, dict) and isinstance(other, dict)):
        return one, other
    return {key: difference(one[key], other.get(key)) for key in one if one[key] != other.get(key)}
