"""Every operator of ours in every situation that it may be pressed in.

Operators are taken from what is registered, so that none can be forgotten. Each must do its job or say in
one sentence why not, and one that does not leaves Blender's data as it was. A situation is a function that
changes a file with a small forest, four sensors and their results.
"""

import shutil
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.disks import files_up_to
from references.scenes import add_collection
from ui import pressing, test_panels
from ui.pressing import ROOT, add_cube, excluded

from forest_addon import spec, ui
from forest_addon.blender.jobs import Job
from forest_addon.blender.scene import assets, layout
from forest_addon.blender.scene.instances import TREE_KEY
from forest_addon.blender.scene.layout import CLOUD_KEY
from forest_addon.blender.sensors import objects as sensors
from forest_addon.drawing import strips as plots
from forest_addon.ui.forest import build
from forest_addon.ui.settings import exchange
from forest_addon.ui.shell import running
from forest_addon.ui.species import edit

TWIG = """
name = "twig"
[rules]
axiom = "A"
productions = ["A -> F[+A][-A]/(90)A"]
generations = 2
"""
WEDGE = "solid w\n" + "".join(
    f"facet normal 0 0 1\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nendloop\nendfacet\n"
    for a, b, c in (("0 0 0", "1 0 0", "0 0 4"), ("0 0 0", "0 1 0", "0 0 4"))
) + "endsolid w\n"  # fmt: skip
# After these a situation is still what it was.
HARMLESS = {
    *("add_distance", "add_gaussian", "add_raster", "add_stems", "new_seed", "remove_distance"),
    *("remove_raster", "remove_stems", "save_scene", "make_library", "add_library"),
    *("export_others", "export_result", "play", "show_picture", "clear_cache"),
}
READING = {
    *("save_scene", "export_others", "export_result", "show_result", "select_result", "play"),
    *("show_picture", "clear_cache"),
}
LONG = "Wäldchen-森-" * 20  # more than the 63 bytes of a name, or 255 in Blender 5


@cache
def operators():
    """Names of all our operators that a user can reach."""
    return tuple(
        sorted(
            cls.bl_idname.partition(".")[2]
            for cls in ui._classes()
            if issubclass(cls, bpy.types.Operator)
            and "INTERNAL" not in getattr(cls, "bl_options", ())
        )
    )


def arguments(name, folder):
    """What a file selector, a list or a button hands to an operator; nothing for most."""
    return {
        "load_scene": {"filepath": str(folder / "scene.toml")},
        "save_scene": {"filepath": str(folder / "exported.toml")},
        "save_species": {"filepath": str(folder / "own.toml")},
        "export_others": {"directory": str(folder / "others")},
        "import_tree": {"filepath": str(folder / "wedge.stl"), "title": "wedge"},
        "make_species": {"wood": str(folder / "wedge.stl"), "title": "wedge"},
        "start": {"preset": "demo"},
        "make_library": {"variants": 1},
        "add_tree": {"species": "abop-monopodial-a", "generations": 2},
        "play": {"sensor": "reverb"},
        "select_result": {"shown": "cloud points"},
        "show_picture": {"result": "echo"},
        "show_result": {"result": "cloud"},
        "export_result": {"result": "cloud", "filepath": str(folder / "cloud.ply")},
        "remove_result": {"result": "cloud"},
    }.get(name, {})


def press(name, **settings):
    """Whether an operator finished, and what it said if it did not."""
    try:
        return getattr(bpy.ops.forest, name)(**settings) == {"FINISHED"}, ""
    except RuntimeError as refusal:
        return False, str(refusal).removeprefix("Error: ").strip()


def unclear(words):
    """What is wrong with a refusal: no reason, Python's words, or a page of them."""
    if not words or "context is incorrect" in words:
        return "no reason is given"
    foreign = ("Traceback", "bpy_prop", "PosixPath", "NoneType", "object has no", "'str'", "Errno")
    if any(word in words for word in foreign):
        return words[-600:]
    return words if len(words) > 400 else ""


def counts():
    """Return numbers of blocks of each kind and of entries in the panel's lists."""
    lists = bpy.context.scene.forest_sensing
    found = {name: len(getattr(lists, name)) for name in ("plantings", "stems", "edited")}
    return pressing.counts() | found


@pytest.fixture(scope="module")
def home(registered, tmp_path_factory):
    """A folder with forest.blend, its species, and a scene file."""
    folder = tmp_path_factory.mktemp("hard")
    (folder / "twig.toml").write_text(TWIG)
    (folder / "wedge.stl").write_text(WEDGE)
    (folder / "scene.toml").write_text("seed = 5\n[forest]\nsize = [5, 5]\n")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    fill(bpy.context.scene, folder)
    with pytest.MonkeyPatch.context() as patch:
        small_pictures(patch)
        assert press("build") == (True, "")
        assert press("run") == (True, "")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "forest.blend"))
    return folder


def small_pictures(patch):
    """Have results and trees drawn with few pixels: nobody looks at them here, and files open sooner."""
    patch.setattr(plots, "WIDE", 64)
    patch.setattr(plots, "HIGH", 32)
    patch.setattr(assets, "DOTS", 500)


def fill(scene, folder):
    """A forest of a few twigs and one sensor of each kind, coarse."""
    props = scene.forest_sensing
    props.folder = str(folder)
    props.seed, props.forest.size, props.forest.margin = 3, (6, 6), 2
    planting = props.plantings.add()
    planting.species, planting.variants = "twig.toml", 1
    planting.use_expected, planting.expected = True, 4
    hill = planting.gaussians.add()
    hill.centre, hill.width = (3, 3), (3, 3)
    coarse = {
        "terrestrial": {"position": (3, 3, 1), "angle_step_deg": 10},
        "tractor": {"position": (-2, 0, 1), "track": 6, "step": 2, "angle_step_deg": 10},
        "sonar": {"position": (3, 3, 1), "max_range": 1.5, "band": (5e3, 9e3), "sample_rate": 2e4},
        "reverb": {"source": (1, 1, 1), "receiver": (5, 5, 1), "sample_rate": 4000,
                   "duration": 0.05},
    }  # fmt: skip
    for kind, settings in coarse.items():
        exchange.add_sensor(scene, spec.SENSORS[kind](**settings))
    scene.frame_end = 2
    for layer in scene.view_layers:
        layer.update()


@pytest.fixture
def again(home, tmp_path, monkeypatch):
    """Opens the forest as it was, with copies of its files in a folder of the test's own."""
    folder = tmp_path / "files"
    monkeypatch.setattr(build, "DEMO", folder / "scene.toml")  # smaller than the real one
    monkeypatch.setattr(edit, "FIRST", ("abop-monopodial-a",))
    small_pictures(monkeypatch)

    def open_again():
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(home, folder)
        bpy.ops.wm.open_mainfile(filepath=str(folder / "forest.blend"))
        bpy.context.scene.forest_sensing.folder = str(folder)
        return folder

    return open_again


# ------------------------------------------------------------------------------------- situations


def thing_of(kind):
    return next(t for t in bpy.data.objects if sensors.kind_of(t) == kind)


def as_it_is(_):
    pass


def no_active_object(_):
    bpy.context.view_layer.objects.active = None
    for obj in bpy.context.selected_objects:
        obj.select_set(False)


def mode(name):
    def enter(_):
        bpy.context.view_layer.objects.active = add_cube()
        bpy.ops.object.mode_set(mode=name)

    enter.__name__ = f"in_{name.lower()}"
    return enter


def editing_a_tree(_):
    bpy.context.view_layer.objects.active = next(t for t in bpy.data.objects if TREE_KEY in t)
    bpy.ops.object.mode_set(mode="EDIT")


def nothing_of_ours(_):
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


def factory_start(_):
    bpy.ops.wm.read_homefile(use_factory_startup=True)


def linked_scene(folder):
    nothing_of_ours(folder)
    with bpy.data.libraries.load(str(folder / "forest.blend"), link=True) as (source, target):
        target.scenes = source.scenes
    bpy.context.window.scene = target.scenes[0]
    assert not bpy.context.scene.is_editable


def linked_forest(folder, override=False):
    nothing_of_ours(folder)
    with bpy.data.libraries.load(str(folder / "forest.blend"), link=True) as (_, target):
        target.collections = ["Forest"]
    scene, forest = bpy.context.scene, target.collections[0]
    scene.collection.children.link(forest)
    if override:
        assert forest.override_hierarchy_create(scene, bpy.context.view_layer) is not None
    scene.forest_sensing.seed = 3


def overridden_forest(folder):
    linked_forest(folder, override=True)


def hidden(_):
    layout.root(bpy.context.scene).hide_viewport = True


def another_view_layer(_):
    scene = bpy.context.scene
    layer = scene.view_layers.new("Other")
    layer.layer_collection.children["Forest"].exclude = True
    bpy.context.window.view_layer = layer


def another_scene(_):
    bpy.context.window.scene = bpy.data.scenes.new("Other")


def copied_scene(_):
    bpy.ops.scene.new(type="FULL_COPY")


def linked_copy_of_the_scene(_):
    bpy.ops.scene.new(type="LINK_COPY")


def sensors_deleted(_):
    for obj in [t for t in bpy.data.objects if sensors.kind_of(t)]:
        bpy.data.objects.remove(obj)


def sensors_unlinked(_):
    home = sensors.home_of(bpy.context.scene)
    for obj in list(home.objects):
        home.objects.unlink(obj)


def sensor_elsewhere(_):
    obj = thing_of("sonar")
    sensors.home_of(bpy.context.scene).objects.unlink(obj)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj


def sensors_renamed(_):
    for obj in sensors.sensors_of(bpy.context.scene):
        obj.name = f"mein {obj.name}/é"


def receiver_deleted(_):
    bpy.data.objects.remove(sensors.receiver_of(thing_of("reverb")))


def receiver_unlinked(_):
    receiver = sensors.receiver_of(thing_of("reverb"))
    for home in list(receiver.users_collection):
        home.objects.unlink(receiver)


def sensors_home_deleted(_):
    bpy.data.collections.remove(sensors.home_of(bpy.context.scene))


def root_deleted(_):
    bpy.data.collections.remove(layout.root(bpy.context.scene))


def root_unlinked(_):
    bpy.context.scene.collection.children.unlink(layout.root(bpy.context.scene))


def everything_deleted(_):
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes, *bpy.data.collections])


def pictures_deleted(_):
    bpy.data.batch_remove([*bpy.data.images, *bpy.data.sounds])


def species_file_removed(folder):
    (folder / "twig.toml").unlink()


def stl_removed(folder):
    shutil.copytree(ROOT / "assets/templates/hazelnut", folder / "hazelnut")
    text = (ROOT / "assets/species/hazelnut.toml").read_text()
    (folder / "twig.toml").write_text(text.replace("../templates/", ""))
    (folder / "hazelnut" / "wood.stl").unlink()
    (folder / "wedge.stl").unlink()


def scene_file_removed(folder):
    (folder / "scene.toml").unlink()


def output_below_a_file(folder):
    bpy.context.scene.forest_sensing.output = str(folder / "twig.toml" / "results")


def output_is_a_file(folder):
    bpy.context.scene.forest_sensing.output = str(folder / "twig.toml")


def output_where_nobody_writes(_):
    bpy.context.scene.forest_sensing.output = "/proc/forest"


def output_beside_an_unsaved_file(_):
    nothing_of_ours(_)
    fill(bpy.context.scene, Path("/"))
    add_cube()
    bpy.context.scene.forest_sensing.output = "//results"


def imperial(_):
    bpy.context.scene.unit_settings.system = "IMPERIAL"


def centimetres(_):
    bpy.context.scene.unit_settings.scale_length = 0.01


def frame_zero(_):
    bpy.context.scene.frame_set(0)


def frame_below_zero(_):
    bpy.context.scene.frame_start = -3
    bpy.context.scene.frame_end = -2
    bpy.context.scene.frame_set(-3)


def frame_between(_):
    bpy.context.scene.frame_set(1, subframe=0.5)


def long_names(folder):
    scene = bpy.context.scene
    scene.name = scene.forest_sensing.name = LONG
    for obj in sensors.sensors_of(scene):
        obj.name = LONG
    long = folder / ("ü" * 60 + ".toml")
    shutil.copy2(folder / "twig.toml", long)
    scene.forest_sensing.plantings[0].species = long.name
    scene.forest_sensing.output = str(folder / "out")


def names_like_ours(_):
    for name in ("Ground", "twig 0000", "echo", "cloud points", "Trees"):
        add_cube(name)
    for name in ("Forest", "Trees", "Sensors", "Results"):
        add_collection(name)


def planting_chosen_that_is_gone(_):
    bpy.context.scene.forest_sensing.active_plantings = 7


def no_plantings(_):
    bpy.context.scene.forest_sensing.plantings.clear()


def empty_species(_):
    bpy.context.scene.forest_sensing.plantings[0].species = ""


def being_edited(_):
    assert press("edit_species") == (True, "")


def edited_and_its_stl_gone(folder):
    shutil.copytree(ROOT / "assets/templates/hazelnut", folder / "hazelnut", dirs_exist_ok=True)
    text = (ROOT / "assets/species/hazelnut.toml").read_text()
    (folder / "twig.toml").write_text(text.replace("../templates/", ""))
    being_edited(folder)
    shutil.rmtree(folder / "hazelnut")


def moving_scanner_chosen(_):
    bpy.ops.forest.add_sensor(kind="mobile")


def after_undo(_):
    bpy.ops.ed.undo_push(message="before")
    assert press("build") == (True, "")
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()


def after_undo_and_redo(folder):
    after_undo(folder)
    bpy.ops.ed.redo()


def in_local_view(_):
    area = next((a for a in bpy.context.screen.areas if a.type == "VIEW_3D"), None)
    if area is None:
        pytest.skip("this Blender has no 3D view")
    region = next(r for r in area.regions if r.type == "WINDOW")
    cube = bpy.context.view_layer.objects.active = add_cube()
    cube.location.z = -1000.0  # no sensor sees it
    cube.select_set(True)
    with bpy.context.temp_override(area=area, region=region):
        bpy.ops.view3d.localview()
    assert area.spaces.active.local_view is not None


SITUATIONS = [
    *(as_it_is, no_active_object, mode("EDIT"), mode("SCULPT"), mode("WEIGHT_PAINT")),
    *(editing_a_tree, nothing_of_ours, factory_start, linked_scene, linked_forest),
    *(overridden_forest, excluded, hidden, another_view_layer, another_scene, copied_scene),
    *(linked_copy_of_the_scene, sensors_deleted, sensors_unlinked, sensor_elsewhere),
    *(sensors_renamed, receiver_deleted, receiver_unlinked, sensors_home_deleted, root_deleted),
    *(root_unlinked, everything_deleted, pictures_deleted, species_file_removed, stl_removed),
    *(scene_file_removed, output_below_a_file, output_is_a_file, output_where_nobody_writes),
    *(output_beside_an_unsaved_file, imperial, centimetres, frame_zero, frame_below_zero),
    *(frame_between, long_names, names_like_ours, planting_chosen_that_is_gone, no_plantings),
    *(empty_species, being_edited, edited_and_its_stl_gone, moving_scanner_chosen, after_undo),
    *(after_undo_and_redo, in_local_view),
]

SHARES = 7  # of the operators, one of which a situation meets


@pytest.mark.slow
@pytest.mark.parametrize("situation", SITUATIONS, ids=lambda s: s.__name__)
def test_every_operator_works_or_says_why_not(again, situation):
    complaints, fresh = [], False
    for name in operators()[SITUATIONS.index(situation) % SHARES :: SHARES]:
        if not fresh:
            folder = again()
            situation(folder)
        before = counts()
        done, words = press(name, **arguments(name, folder))
        fresh = not done or name in HARMLESS
        if not done and unclear(words):
            complaints.append(f"{name}: {unclear(words)}")
        if not done and counts() != before:
            changed = {k: (before[k], n) for k, n in counts().items() if n != before[k]}
            complaints.append(f"{name}: refused, but left {changed}")
            fresh = False
    test_panels.drawn()
    assert not complaints, "\n".join(complaints)


@pytest.mark.medium
def test_the_frame_range_from_every_frame(again):
    for at in (frame_below_zero, frame_between):
        folder = again()
        at(folder)
        scene = bpy.context.scene
        scene.forest_sensing.output = str(folder / "out")
        now = scene.frame_current_final
        scene.frame_end = scene.frame_start + 1
        assert press("run", sensor="cloud", frames="RANGE") == (True, "")
        assert scene.frame_current_final == now
        assert len(list((folder / "out").glob("[!.]*"))) == 2


@pytest.mark.medium
def test_a_linked_scene_is_not_changed(again):
    folder = again()
    linked_scene(folder)
    before, settings = counts(), exchange.to_spec(bpy.context.scene)
    for name in operators():
        if name == "new":  # starts another file
            continue
        done, _ = press(name, **arguments(name, folder))
        assert not done or name in READING, f"{name} changes a linked scene"
    assert counts() == before
    assert exchange.to_spec(bpy.context.scene) == settings


@pytest.mark.slow
@pytest.mark.parametrize("link", [linked_forest, overridden_forest])
def test_a_linked_forest_is_sensed_and_stays(again, link):
    link(again())
    others = {obj.name_full for obj in bpy.data.objects}
    press("add_sensor", kind="terrestrial")
    assert press("run") == (True, "")
    assert others < {obj.name_full for obj in bpy.data.objects}
    points = next(t for t in bpy.data.objects if CLOUD_KEY in t and t.library is None
                  and t.override_library is None)  # fmt: skip
    assert len(points.data.vertices) > 0


def test_local_view_hides_nothing_from_a_sensor(again):
    folder = again()
    press("run", sensor="cloud")
    before = points_of("cloud")
    in_local_view(folder)
    assert press("run", sensor="cloud") == (True, "")
    assert points_of("cloud") == before


def points_of(name):
    (cloud,) = (t for t in bpy.data.objects if t.get(CLOUD_KEY) == name)
    return len(cloud.data.vertices)


@pytest.mark.medium
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # of zipfile
def test_a_full_disk_leaves_no_half_files(again):
    folder = again()
    bpy.context.scene.forest_sensing.output = str(folder / "out")
    press("edit_species")
    with files_up_to(64):
        for sensor in ("scan", "cloud", "echo"):
            assert press("run", sensor=sensor) == (True, "")  # its results are in the panel
        for name in ("save_scene", "save_species"):
            done, words = press(name, **arguments(name, folder))
            assert not done
            assert not unclear(words), words
        before, heard = counts(), figures("reverb")
        done, words = press("run", sensor="reverb")  # a sound passes through a file
        assert not done
        assert not unclear(words), words
        assert (counts(), figures("reverb")) == (before, heard)
    assert list((folder / "out").iterdir()) == []
    assert not (folder / "exported.toml").exists()
    assert not (folder / "own.toml").exists()
    assert not [file for file in folder.rglob("*") if "partial" in file.name]


@pytest.mark.medium
@pytest.mark.parametrize(("system", "scale"), [("METRIC", 0.01), ("IMPERIAL", 1.0), ("NONE", 1.0)])
def test_a_unit_counts_as_a_metre_and_the_panel_says_so(again, system, scale):
    again()
    press("run", sensor="echo")
    before = figures("echo")
    units = bpy.context.scene.unit_settings
    units.system, units.scale_length = system, scale
    press("run", sensor="echo")
    assert figures("echo") == before
    assert exchange.to_spec(bpy.context.scene).forest.size == (6, 6)
    assert ("A unit counts as 1 m here:" in test_panels.drawn()) == (scale != 1)


CLOCKED = ("Time", "Checked", "Audit")  # an audit checks as many as its share of the time allows


def figures(name):
    result = bpy.context.scene.forest_sensing.results[name]
    return {figure.name: figure.value for figure in result.figures if figure.name not in CLOCKED}


@pytest.mark.medium
@pytest.mark.parametrize("instancing", ["objects", "points"])
def test_a_full_copy_is_a_forest_of_its_own_and_no_second_one(again, instancing):
    """Building there leaves the first alone, and nothing stands twice: trees, points, library, results."""
    again()
    first = bpy.context.scene
    first.forest_sensing.forest.instancing = instancing
    assert press("build") == (True, "")
    trees = {t: np.array(t.matrix_world) for t in layout.root(first).all_objects}
    copied_scene(None)
    scene, everything = bpy.context.scene, counts()
    for seed in (0, 1):
        scene.forest_sensing.seed += seed
        assert press("build") == (True, "")
        if not seed:
            assert (counts(), len(scene.objects)) == (everything, len(first.objects))
        roles = [obj[layout.ROLE_KEY] for obj in scene.objects if layout.ROLE_KEY in obj]
        assert len(roles) == len(set(roles))
    assert {t: t.matrix_world for t in layout.root(first).all_objects}.keys() == trees.keys()
    assert all(np.array_equal(obj.matrix_world, place) for obj, place in trees.items())


def test_a_tree_that_was_renamed_and_moved_or_deleted_in_a_copy_is_no_second_tree(again):
    again()
    press("build")
    copied_scene(None)
    scene = bpy.context.scene
    moved, gone = [
        t for t in scene.objects if TREE_KEY in t and layout.TREES in t[layout.ROLE_KEY]
    ][:2]
    count = sum(TREE_KEY in obj for obj in scene.objects)
    moved.name, moved.location[:2] = "the old oak", (-3.0, -3.0)
    bpy.data.objects.remove(gone)
    assert press("build") == (True, "")
    assert sum(TREE_KEY in obj for obj in scene.objects) == count - 1
    places = [tuple(t.location[:2]) for t in scene.objects if TREE_KEY in t]
    assert ((-3.0, -3.0) in places, len(set(places))) == (True, len(places))
    assert "the old oak" in scene.objects


def test_a_fault_in_a_job_does_not_block_the_next(registered, monkeypatch):
    def work():
        raise KeyError("a fault of ours")
        yield

    job, left = Job("Run Sensor", work()), []
    monkeypatch.setattr(running, "_current", job)
    begun_in = bpy.context.scene, bpy.context.view_layer.name
    button = SimpleNamespace(_job=job, _begun_in=begun_in, _leave=left.append)
    with pytest.raises(KeyError):
        running.Working.modal(button, bpy.context, SimpleNamespace(type="TIMER", value="NOTHING"))
    assert left == [bpy.context]
    assert running.current() is None
    assert running.obstacle(bpy.context) == ""
