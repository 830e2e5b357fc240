"""What cannot be done is said in words, and nothing is another than before."""

import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import SENSORS, add_cube, counts, facts, press, settings_of, trees

from forest_addon import spec
from forest_addon.blender.scene import forest as room
from forest_addon.ui.settings import exchange
from forest_addon.ui.shell import running


def settle(path, **values):
    """Change settings: of the scene, of one of its groups or lists, or of a sensor."""

    def change(props, _folder, _patch):
        group = (
            settings_of(path) if path in SENSORS else props.path_resolve(path) if path else props
        )
        for key, value in values.items():
            setattr(group, key, value)

    return change


def nothing(_props, _folder, _patch):
    pass


def editing(_props, _folder, _patch):
    bpy.context.view_layer.objects.active = add_cube()
    bpy.ops.object.mode_set(mode="EDIT")


def without_scipy(_props, _folder, patch):
    patch.setattr(running, "missing", lambda: ("scipy",))


def full_memory(_props, _folder, patch):
    def full(*_):
        raise MemoryError

    patch.setattr(room, "ground_mesh", full)


def scanner(follow):
    def add(_props, _folder, _patch):
        exchange.add_sensor(bpy.context.scene, spec.Mobile(follow=follow))

    return add


def excluded(_props, _folder, _patch):
    bpy.context.view_layer.layer_collection.children["Forest"].exclude = True


def names_alike(props, folder, _patch):
    props.output = str(folder)
    bpy.data.objects["cloud"].name, bpy.data.objects["echo"].name = "echo.1", "echo-1"


def three_frames(_props, _folder, _patch):
    bpy.context.scene.frame_end = 3


def below_a_file(props, folder, _patch):
    (folder / "file").write_text("x")
    props.output = str(folder / "file" / "results")


def chosen(name):
    def choose(_props, _folder, _patch):
        bpy.ops.object.select_all(action="DESELECT")
        bpy.context.view_layer.objects.active = bpy.data.objects[name]

    return choose


def no_plantings(props, _folder, _patch):
    props.plantings.clear()


def points_gone(props, _folder, _patch):
    bpy.data.objects.remove(bpy.data.objects[props.results["cloud"].shown])


def scene_file(text):
    def write(_props, folder, _patch):
        (folder / "bad.toml").write_text(text)

    return write


ANY = {"sensor": "cloud"}
BAD = {"filepath": "{}/bad.toml"}
REFUSED = [
    ("build", {}, settle("forest", size=(0, 6)), r"forest\.size\[0\].*larger than 0"),
    ("build", {}, settle("plantings[0]", species="baobab"), "baobab.*hazelnut"),
    ("build", {}, settle("plantings[0]", species="no.toml"), "no.toml.*no such file"),
    ("build", {}, settle("plantings[0]", use_expected=False), "expected.*give a number"),
    ("build", {}, settle("plantings[0]", scale=(2, 1)), "smallest, largest"),
    ("build", {}, full_memory, "not enough memory"),
    ("build", {}, editing, "Object Mode"),
    ("build", {}, without_scipy, "scipy is missing"),
    ("run", {}, editing, "Object Mode"),
    ("run", {}, without_scipy, "scipy is missing"),
    ("run", {}, names_alike, '"echo-1" is taken'),
    ("run", {"again": True}, nothing, "no result is from before"),
    ("run", ANY, excluded, "nothing to sense"),
    ("run", ANY, settle("cloud", azimuth_deg=(90, 10)), "from < to"),
    ("run", {"sensor": "scan"}, settle("scan", top=0.5), r"scan\.top.*above the scanner"),
    ("run", {"sensor": "echo"}, settle("echo", band=(1e5, 3e5)), r"echo\.band.*sample_rate"),
    ("run", {"sensor": "track"}, scanner(""), "give poses, or the object to follow"),
    ("run", {"sensor": "track"}, scanner("Nothing"), 'no object "Nothing"'),
    ("run", ANY, below_a_file, r"Save To.*cannot be made"),
    (
        "run",
        {**ANY, "frames": "RANGE"},
        three_frames,
        r"Save To.*choose a folder, or Keep.*3 frames",
    ),
    ("run_frames", ANY, three_frames, "choose a folder"),
    ("lock_trees", {}, chosen("cloud"), "Select trees of the forest"),
    ("paint", {}, settle("forest.terrain", object="nowhere"), 'no object "nowhere"'),
    ("paint", {}, no_plantings, "no planting yet"),
    ("grow_again", {}, chosen("cloud"), "no tree of Add"),
    ("new", {"preset": "baobab"}, nothing, r"There is no scene .baobab."),
    ("fly", {"policy": "gap"}, nothing, "no flyer yet; add one"),
    ("edit_species", {}, settle("plantings[0]", species="gone.toml"), "there is no such file"),
    ("save_species", {"filepath": "x.toml"}, nothing, "Press Edit first"),
    ("add_source", {}, chosen("cloud"), "Choose a reverb"),
    ("apply_preset", {"kind": "wind", "values": '{"speed": 400}'}, nothing, "speed"),
    ("export_result", {"result": "cloud", "filepath": "{}/a.doc"}, nothing, r"use \.laz"),
    (
        "export_result",
        {"result": "cloud", "filepath": "{}/a.laz"},
        points_gone,
        "Run its sensor again",
    ),
    ("play", {"sensor": "reverb"}, settle("", dry="FILE", dry_file="none.wav"), "no such file"),
    ("show_result", {"result": "forest"}, nothing, "no points"),
    ("look_through", {}, chosen("reverb"), "no eyes"),
    ("load_scene", BAD, nothing, "no such file"),
    ("load_scene", BAD, scene_file("["), "not TOML"),
    ("load_scene", BAD, scene_file("seed = -1"), "seed"),
    ("load_scene", BAD, scene_file("forrest = 1"), "did you mean"),
    ("load_scene", BAD, scene_file("seed = 9999999999"), "too large for the panel"),
]


def state(props):
    """How many blocks there are, where trees stand, what was found, and the mode."""
    places = {tree.name: tree.matrix_world.copy() for tree in trees()}
    found = {result.name: facts(props, result.name) for result in props.results}
    return counts(), places, found, bpy.context.mode


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "given", "situation", "words"), REFUSED, ids=[f"{row[0]}: {row[3]}" for row in REFUSED]
)
def test_what_cannot_be_done_is_said_and_changes_nothing(
    ran, tmp_path, monkeypatch, name, given, situation, words
):
    situation(ran, tmp_path, monkeypatch)
    bpy.context.view_layer.update()
    given = {k: v.format(tmp_path) if k == "filepath" else v for k, v in given.items()}
    before, files = state(ran), sorted(tmp_path.rglob("*"))
    with pytest.raises(RuntimeError, match=words):
        press(name, **given)
    assert state(ran) == before
    assert sorted(tmp_path.rglob("*")) == files
