"""Exported scene files: they mean the same wherever they are written, and name the .blend they start from."""

from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.base.places import ASSETS
from forest_addon.formats.toml_file import read_settings, write_settings
from forest_addon.growth.library import find_species, load_species
from forest_addon.spec import Raster, Scene, Species
from forest_addon.spec.base import with_files
from forest_addon.ui.forest.scene_file import write_scene
from forest_addon.ui.settings import exchange
from forest_addon.ui.species.edit import relocated
from headless.cli import main

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def slope(small):
    """A mesh of the user's own, as large as the field and more."""
    data = bpy.data.meshes.new("slope")
    corners = [(-9, -9, 0), (15, -9, 1), (15, 15, 2), (-9, 15, 1)]
    data.from_pydata(corners, [], [(0, 1, 2), (0, 2, 3)])
    thing = bpy.data.objects.new("slope", data)
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.update()
    return thing


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
def test_with_its_blend_file_the_scene_gives_the_same_bytes(slope, tmp_path):
    """A built forest on a terrain of one's own, exported to another folder."""
    props = bpy.context.scene.forest_sensing
    props.forest.terrain.object = "slope"
    props.output = str(tmp_path / "panel")
    bpy.data.objects["cloud"].location.z = 2
    assert bpy.ops.forest.build() == {"FINISHED"}
    assert bpy.ops.forest.run() == {"FINISHED"}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "forest.blend"))
    path = tmp_path / "scenes" / "mine.toml"
    path.parent.mkdir()
    assert bpy.ops.forest.save_scene(filepath=str(path)) == {"FINISHED"}
    off = ("glb", "preview", "pictures", "goodness", "leaves", "report")
    text = path.read_text() + "\n[output]\n" + "".join(f"{name} = false\n" for name in off)
    path.write_text(text)
    out = tmp_path / "headless"
    assert main(["run", str(path), "--out", str(out), "--quiet"]) == 0
    for name in ("cloud.laz", "reverb.wav", "echo.wav"):
        assert (out / name).read_bytes() == (tmp_path / "panel" / name).read_bytes(), name
    with bpy.data.libraries.load(str(out / "forest.blend")) as (inside, _):
        sensors = [name for name in inside.objects if name.split(".")[0] in out_names()]
    assert sorted(sensors) == sorted(out_names())


def out_names():
    """The sensors of the small forest: each stands there once."""
    return {"cloud", "scan", "echo", "reverb"}


def test_a_scene_of_instanced_collections_starts_from_its_blend(props, tmp_path):
    home = bpy.data.collections.new("library")
    data = bpy.data.meshes.new("stone")
    data.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    home.objects.link(bpy.data.objects.new("stone", data))
    empty = bpy.data.objects.new("instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", home
    bpy.context.scene.collection.objects.link(empty)
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
