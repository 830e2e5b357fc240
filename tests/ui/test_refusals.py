"""Refusals of the panel: each in words, after which nothing is changed."""

from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import add_cube, counts, facts, press, settings_of, trees

from forest_addon import spec
from forest_addon.blender.scene import forest as room
from forest_addon.ui.settings import exchange
from forest_addon.ui.shell import running


def as_it_is(_at):
    pass


def settle(path, **values):
    """Change settings: those on the object of a sensor, or a group or the item of a list of the scene's."""

    def change(at):
        group = settings_of(path) if path in bpy.data.objects else at.props.path_resolve(path)
        for key, value in values.items():
            setattr(group, key, value)

    return change


def scanner(**settings):
    return lambda _: exchange.add_sensor(bpy.context.scene, spec.Mobile(**settings))


def scene_file(text):
    return lambda at: (at.folder / "bad.toml").write_text(text)


def without_scipy(at):
    at.patch.setattr(running, "missing", lambda: ("scipy",))


def full_memory(at):
    def full(*_):
        raise MemoryError

    at.patch.setattr(room, "ground_mesh", full)


def editing(_):
    bpy.context.view_layer.objects.active = add_cube()
    bpy.ops.object.mode_set(mode="EDIT")


def chosen(name):
    def choose(_):
        bpy.ops.object.select_all(action="DESELECT")
        bpy.context.view_layer.objects.active = bpy.data.objects[name]

    return choose


def excluded(_):
    bpy.context.view_layer.layer_collection.children["Forest"].exclude = True


def names_alike(at):
    at.props.output = str(at.folder)
    bpy.data.objects["cloud"].name, bpy.data.objects["echo"].name = "echo.1", "echo-1"


def below_a_file(at):
    (at.folder / "file").write_text("x")
    at.props.output = str(at.folder / "file" / "results")


def three_frames(_):
    bpy.context.scene.frame_end = 3


def points_gone(at):
    bpy.data.objects.remove(bpy.data.objects[at.props.results["cloud"].shown])


def dry_file_gone(at):
    at.props.dry, at.props.dry_file = "FILE", str(at.folder / "none.wav")


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
    ("run", {"again": True}, as_it_is, "no result is from before"),
    ("run", ANY, excluded, "nothing to sense"),
    ("run", ANY, settle("cloud", azimuth_deg=(90, 10)), "from < to"),
    ("run", {"sensor": "scan"}, settle("scan", top=0.5), r"scan\.top.*above the scanner"),
    ("run", {"sensor": "echo"}, settle("echo", band=(1e5, 3e5)), r"echo\.band.*sample_rate"),
    ("run", {"sensor": "track"}, scanner(), "give poses, or the object to follow"),
    ("run", {"sensor": "track"}, scanner(follow="Nothing"), 'no object "Nothing"'),
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
    ("paint", {}, lambda at: at.props.plantings.clear(), "no planting yet"),
    ("grow_again", {}, chosen("cloud"), "no tree of Add"),
    ("new", {"preset": "baobab"}, as_it_is, r"There is no scene .baobab."),
    ("fly", {"policy": "gap"}, as_it_is, "no flyer yet; add one"),
    ("edit_species", {}, settle("plantings[0]", species="gone.toml"), "there is no such file"),
    ("save_species", {"filepath": "x.toml"}, as_it_is, "Press Edit first"),
    ("add_source", {}, chosen("cloud"), "Choose a reverb"),
    ("apply_preset", {"kind": "wind", "values": '{"speed": 400}'}, as_it_is, "speed"),
    ("export_result", {"result": "cloud", "filepath": "{}/a.doc"}, as_it_is, r"use \.laz"),
    (
        "export_result",
        {"result": "cloud", "filepath": "{}/a.laz"},
        points_gone,
        "Run its sensor again",
    ),
    ("play", {"sensor": "reverb"}, dry_file_gone, r"none\.wav: there is no such file"),
    ("show_result", {"result": "forest"}, as_it_is, "no points"),
    ("look_through", {}, chosen("reverb"), "no eyes"),
    ("load_scene", BAD, as_it_is, "no such file"),
    ("load_scene", BAD, scene_file("["), "not TOML"),
    ("load_scene", BAD, scene_file("seed = -1"), "seed"),
    ("load_scene", BAD, scene_file("forrest = 1"), "did you mean"),
    ("load_scene", BAD, scene_file("seed = 9999999999"), "too large for the panel"),
]


def state(props):
    """Return numbers of blocks, places of trees, settings, results and the mode."""
    places = {tree.name: tree.matrix_world.copy() for tree in trees()}
    found = {result.name: facts(props, result.name) for result in props.results}
    settings = [said(group) for group in (props, props.forest, props.wind, *props.plantings)]
    return counts(), places, found, settings, bpy.context.mode


def said(group):
    """The settings of a group, but for groups within it."""
    plain = [p for p in group.bl_rna.properties if p.type not in ("POINTER", "COLLECTION")]
    values = {known.identifier: getattr(group, known.identifier) for known in plain}
    return {k: tuple(v) if type(v).__name__ == "bpy_prop_array" else v for k, v in values.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "given", "situation", "words"), REFUSED, ids=[f"{row[0]}: {row[3]}" for row in REFUSED]
)
def test_what_cannot_be_done_is_said_and_changes_nothing(
    ran, tmp_path, monkeypatch, name, given, situation, words
):
    situation(SimpleNamespace(props=ran, folder=tmp_path, patch=monkeypatch))
    bpy.context.view_layer.update()
    given = {k: v.format(tmp_path) if k == "filepath" else v for k, v in given.items()}
    before, files = state(ran), sorted(tmp_path.rglob("*"))
    with pytest.raises(RuntimeError, match=words):
        press(name, **given)
    assert state(ran) == before
    assert sorted(tmp_path.rglob("*")) == files
