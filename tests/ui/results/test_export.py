"""Results are written in a format of one's choice, called otherwise, removed with their points."""

import csv

import laspy
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import bmesh
from references.scenes import add_collection, keyed, reopened, values
from ui.pressing import (
    add_cube,
    clouds,
    counts,
    facts,
    press,
    run,
    settings_of,
)

from forest_addon.blender.scene.layout import CLOUD_KEY, RADIUS
from forest_addon.blender.scene.nodes import has_input, set_input
from forest_addon.blender.show.cloud_nodes import GROUP
from forest_addon.formats.wav import read_wav
from forest_addon.results.kinds import RESULTS
from forest_addon.results.points import ENDINGS, POINT, can_write
from forest_addon.results.reverb import PEAK_DB, dry_sound
from forest_addon.sensing.reverb.auralise import auralise, normalised
from forest_addon.sensing.reverb.channels import channels_of
from forest_addon.ui.results import finding, panel
from forest_addon.ui.results.keep import follow_names, points_of
from forest_addon.ui.results.panel import endings_of, heard_of


def test_every_format_of_a_result_has_its_words():
    assert {ending for kind in RESULTS.values() for ending in kind.endings} == set(panel.WORDS)


@pytest.mark.medium
def test_a_cloud_is_exported_as_one_chooses(built, tmp_path):
    built.offset = "[1000, 2000, 0]"
    run("cloud")
    path = str(tmp_path / "mine.laz")
    assert press("export_result", result="cloud", filepath=path) == {"FINISHED"}
    points = bpy.data.objects[built.results["cloud"].shown]
    las = laspy.read(path)
    assert len(las) == len(points.data.vertices)
    assert float(las.x.min()) > 900


@pytest.mark.slow
def test_what_is_too_large_to_be_kept_says_so(built, tmp_path, monkeypatch):
    monkeypatch.setattr(finding, "MOST", 1000)
    run("echo")
    with pytest.raises(RuntimeError, match="Run its sensor again"):
        press("export_result", result="echo", filepath=str(tmp_path / "mine.wav"))


@pytest.mark.medium
def test_an_echo_can_be_heard(ran):
    samples, rate = panel.heard_of(ran.results["echo"])
    assert rate == 20_000  # 400 kHz, twenty times slower
    assert samples.shape[1] == 1
    assert 0.85 < abs(samples).max() <= 1.0
    assert press("play", sensor="echo") == {"FINISHED"}
    assert panel._playing[1].specs[0] == rate
    assert np.abs(panel._playing[1].data() - samples).max() < 1e-6


@pytest.mark.medium
def test_a_reverb_is_played_as_the_chosen_sound_is_heard(ran, tmp_path):
    """What Blender's audio library was given is the convolution; the exported WAV has it, too."""
    _, found, _ = finding.unpack(ran.results["reverb"].found)
    responses = channels_of(found).reshape(len(found.samples), -1)
    for choice in ("CLAP", "CALL"):
        ran.dry = choice
        assert press("play", sensor="reverb") == {"FINISHED"}
        played = panel._playing[1]
        dry, dry_rate = dry_sound(choice.lower())
        wet = normalised(auralise(responses, dry, found.sample_rate, dry_rate), PEAK_DB)[0]
        assert played.specs[0] == found.sample_rate
        assert np.abs(played.data() - wet).max() < 1e-6
        path = str(tmp_path / f"{choice}.wav")
        assert press("export_result", result="reverb", filepath=path, heard=True) == {"FINISHED"}
        samples, rate = read_wav(tmp_path / f"{choice}.wav")
        assert rate == found.sample_rate
        assert np.abs(samples - wet[:, 0]).max() < 1e-6
    ran.dry = "NONE"
    press("play", sensor="reverb")
    click = panel._playing[1].data()[:, 0]
    assert np.argmax(np.abs(click)) == np.argmax(np.abs(responses[:, 0]))
    ran.dry, ran.dry_file = "FILE", str(tmp_path / "CLAP.wav")
    assert press("play", sensor="reverb") == {"FINISHED"}


@pytest.fixture
def painted(props, sensor):
    """A cube with two materials, an object without one, and what a scanner found of them."""
    house = add_cube("my house")
    for name in ("brick", "glass"):
        house.data.materials.append(bpy.data.materials.new(name))
    for face in house.data.polygons:
        face.material_index = face.index % 2
    bpy.ops.mesh.primitive_plane_add(size=20)
    sensor("terrestrial", name="cloud", position=(4, -3, 2), angle_step_deg=2)
    run("cloud")
    return props


def classes(path):
    las = laspy.read(path)
    (lookup,) = (vlr for vlr in las.vlrs if vlr.record_id == 0 and vlr.user_id == "LASF_Spec")
    return las, np.asarray(las.classification), lookup.lookups


def nearest_face(point):
    """The material of the cube's face that a point lies on, by brute force; None: of the plane."""
    house = bpy.data.objects["my house"]
    for face in house.data.polygons:
        corner = house.data.vertices[face.vertices[0]].co
        low = np.min([house.data.vertices[v].co for v in face.vertices], axis=0)
        high = np.max([house.data.vertices[v].co for v in face.vertices], axis=0)
        off = abs(np.dot(point - np.array(corner), face.normal))
        if off < 2e-4 and (point > low - 2e-4).all() and (point < high + 2e-4).all():
            return house.data.materials[face.material_index].name
    return None


@pytest.mark.medium
def test_points_are_labelled_by_material_with_names(painted, tmp_path):
    path = str(tmp_path / "a.laz")
    press("export_result", result="cloud", filepath=path, labels="MATERIAL")
    las, number, names = classes(path)
    assert {names[64], names[65]} == {"brick", "glass"}
    where = np.column_stack([las.x, las.y, las.z])
    found = [names.get(n) if n >= 64 else None for n in number.tolist()]
    assert {"brick", "glass", None} == set(found)
    edge = (np.abs(where - np.round(where)) < 1e-3).sum(axis=1) > 1  # of two faces
    for place, name in zip(where[~edge], np.array(found)[~edge], strict=True):
        assert name == nearest_face(place)


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["las", "ply", "npz", "csv"])
def test_points_are_labelled_by_object_with_names(painted, tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    press("export_result", result="cloud", filepath=str(path), labels="OBJECT")
    if ending == "las":
        las, number, lookup = classes(path)
        found, height = [lookup[n] for n in number.tolist()], np.asarray(las.z)
    elif ending == "npz":
        data = np.load(path)
        found, height = data["label_name"][data["label"]].tolist(), data["z"]
    elif ending == "csv":
        rows = list(csv.DictReader(path.open(encoding="utf-8")))
        found, height = [row["label"] for row in rows], np.array([float(r["z_m"]) for r in rows])
    else:
        head, _, body = path.read_bytes().partition(b"end_header\n")
        lines = [line.split(maxsplit=3) for line in head.decode().splitlines()]
        names = {int(line[2]): line[3] for line in lines if line[:2] == ["comment", "label"]}
        kinds = [(name, "<f4" if name in "xyz" else kind) for name, kind in POINT.descr]
        rows = np.frombuffer(body, [*kinds, ("label", "<i4")])
        found, height = [names[n] for n in rows["label"].tolist()], rows["z"]
    assert set(found) == {"my house", "Plane"}
    assert {name for name, z in zip(found, height, strict=True) if z > 1e-3} == {"my house"}


@pytest.mark.medium
def test_species_have_their_names_and_class_stays_as_it_was(ran, tmp_path):
    press("export_result", result="cloud", filepath=str(tmp_path / "a.laz"), labels="SPECIES")
    las, number, names = classes(tmp_path / "a.laz")
    assert names[64] == "hazelnut"
    np.testing.assert_array_equal(number == 64, np.asarray(las["species"]) == 0)
    assert set(number.tolist()) == {1, 64}
    press("export_result", result="cloud", filepath=str(tmp_path / "b.laz"))
    las = laspy.read(tmp_path / "b.laz")
    assert set(np.asarray(las.classification).tolist()) <= {1, 2, 5}
    assert not [vlr for vlr in las.vlrs if vlr.record_id == 0 and vlr.user_id == "LASF_Spec"]


# -------------------------------------------------------------------------------------------- frames
# Frame ranges that are kept in the file: the timeline shows each frame's points.


@pytest.fixture
def moving(props, sensor):
    """A scanner, and a cube that goes 1 m along X in every frame."""
    keyed(add_cube(), "location", {1: (1, 0, 0), 3: (3, 0, 0)})
    sensor("terrestrial", name="cloud", position=(2, -5, 0.5), angle_step_deg=2)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 3
    scene.frame_set(1)
    return props


def cloud():
    return next(obj for obj in bpy.data.objects if CLOUD_KEY in obj)


def middle():
    """Of the points along X."""
    return float(np.median(values(cloud().data, "position")[:, 0]))


@pytest.mark.medium
def test_each_frame_shows_its_points(moving):
    assert run("cloud", frames="RANGE", keep=True) == {"FINISHED"}
    assert [each.frame for each in moving.results["cloud"].frames] == [1, 2, 3]
    found = {}
    for frame in (3, 1, 2, 1, 9, 0):
        bpy.context.scene.frame_set(frame)
        found[frame] = middle()
    assert [found[frame] - found[1] for frame in (2, 3)] == pytest.approx([1, 2], abs=0.35)
    assert (found[9], found[0]) == (found[3], found[1])
    assert len([obj for obj in bpy.data.objects if CLOUD_KEY in obj]) == 1


@pytest.mark.medium
def test_what_was_done_to_the_points_stays_over_frames(moving):
    run("cloud")
    obj = cloud()
    mine = bpy.data.materials.new("mine")
    obj.data.materials[0] = mine
    set_input(obj.modifiers[0], "Radius", 0.07)
    run("cloud", frames="RANGE", keep=True)
    for frame in (1, 2, 3):
        bpy.context.scene.frame_set(frame)
        assert cloud() == obj
        assert list(obj.data.materials) == [mine]


@pytest.mark.slow
def test_the_last_run_alone_is_kept(moving):
    run("cloud", frames="RANGE", keep=True)
    bpy.context.scene.frame_start = 2
    run("cloud", frames="RANGE", keep=True)
    assert [each.frame for each in moving.results["cloud"].frames] == [2, 3]
    assert len([mesh for mesh in bpy.data.meshes if "cube" not in mesh.name]) == 2
    run("cloud")
    assert not moving.results["cloud"].frames
    assert len([mesh for mesh in bpy.data.meshes if "cube" not in mesh.name]) == 1
    bpy.context.scene.frame_set(3)
    here = middle()
    bpy.context.scene.frame_set(1)
    assert middle() == here  # one run of one frame stands still


@pytest.mark.medium
def test_a_kept_frame_costs_little_beside_its_points_and_goes_with_its_result(moving):
    """The pixels of a picture, 3 MB, are in memory only while they are looked at."""
    before = counts()
    run("cloud", frames="RANGE", keep=True)
    pictures = [each.picture for each in moving.results["cloud"].frames]
    assert len(set(pictures)) == 3
    assert not any(picture.has_data for picture in pictures)
    assert all(picture.packed_file.size < 1e5 for picture in pictures)
    pixels = np.array(pictures[0].pixels[:])
    assert 0.01 < pixels.mean() < 0.99
    assert len(pixels) == 4 * np.prod(pictures[0].size)
    press("remove_result", result="cloud")
    kinds = ("objects", "meshes", "images")
    assert [counts()[kind] for kind in kinds] == [before[kind] for kind in kinds]


# ----------------------------------------------------------------------------------------- one state
# What is shown, told, drawn, played and exported is one state: undo, frames and reopening change it all.

FINER = {
    "cloud": {"angle_step_deg": 3},
    "echo": {"max_range": 3},
}
CLOCKED = ("Time", "Checked", "Audit")


def result_of(name):
    return bpy.context.scene.forest_sensing.results[name]


def state(name, folder):
    """Everything that a user can have of a result."""
    result = result_of(name)
    assert {".npz", ".csv"} < set(endings_of(result))
    files = []
    for ending in (".npz", ".csv"):
        path = folder / f"mine{ending}"
        assert press("export_result", result=name, filepath=str(path)) == {"FINISHED"}
        files.append(path.read_bytes())
    obj, heard = points_of(result), heard_of(result)
    speaker = bpy.data.objects[name]
    return {
        "shown": None if obj is None else values(obj.data, "position").tobytes(),
        "told": [(f.name, f.value) for f in result.figures if f.name not in CLOCKED],
        "legend": [(e.name, e.choice, tuple(e.colour)) for e in result.legend] or None,
        "drawn": result.picture.packed_file.data,
        "exported": files,
        "played": None if heard is None else (heard[0].tobytes(), heard[1]),
        "speaker": speaker.data.sound.packed_file.data if speaker.type == "SPEAKER" else None,
    }


def differing(one, other):
    return [key for key in one if one[key] != other[key]]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cloud", "echo"])
def test_undo_redo_and_reopening_change_all_of_a_result(ran, tmp_path, name):
    bpy.ops.ed.undo_push(message="first")
    first = state(name, tmp_path)
    for key, value in FINER[name].items():
        setattr(settings_of(name), key, value)
    run(name)
    bpy.ops.ed.undo_push(message="second")
    second = state(name, tmp_path)
    told = [key for key in first if first[key] is not None and key != "legend"]
    assert set(differing(first, second)) - {"legend"} == set(told)  # a legend may be the same
    bpy.ops.ed.undo()
    assert differing(state(name, tmp_path), first) == []
    bpy.ops.ed.redo()
    assert differing(state(name, tmp_path), second) == []
    reopened(tmp_path / "forest.blend")
    assert differing(state(name, tmp_path), second) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scan", "echo", "reverb"])
def test_each_kept_frame_exports_its_own(built, tmp_path, name):
    """At each frame all of a result is what a run of that frame alone gives."""
    wall = add_cube("wall")
    wall.scale = 2, 2, 2
    keyed(wall, "location", {1: (0.5, 2, 0), 2: (0, 2, 0)})
    if name == "reverb":
        keyed(bpy.data.objects[name], "location", {1: (1, 1, 1), 2: (2, 1, 1)})
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 2
    alone = {}
    for frame in (1, 2):
        scene.frame_set(frame)
        run(name)
        alone[frame] = state(name, tmp_path)
    assert differing(alone[1], alone[2])
    run(name, frames="RANGE", keep=True)
    for frame in (1, 2, 1):
        scene.frame_set(frame)
        assert differing(state(name, tmp_path), alone[frame]) == []
    bpy.ops.ed.undo_push(message="kept")
    scene.frame_set(2)
    bpy.ops.ed.undo_push(message="another frame")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert differing(state(name, tmp_path), alone[scene.frame_current]) == []
    reopened(tmp_path / "forest.blend")
    for frame in (2, 1):
        bpy.context.scene.frame_set(frame)
        assert differing(state(name, tmp_path), alone[frame]) == []


# ------------------------------------------------------------------------------------------ reopened
# Clouds outlive the session: exported from a reopened file in every format; results follow their sensors.


@pytest.mark.medium
def test_every_format_is_offered_and_written(ran, tmp_path):
    for ending in ENDINGS:
        if can_write(ending):
            path = tmp_path / f"again{ending}"
            for labels in ("CLASS", "SPECIES", "MATERIAL"):
                press("export_result", result="cloud", filepath=str(path), labels=labels)
            assert path.stat().st_size > 100


@pytest.mark.medium
def test_points_that_were_deleted_by_hand_are_not_written(ran, tmp_path):
    points = bpy.data.objects[ran.results["cloud"].shown]
    count = len(points.data.vertices)
    shape = bmesh.new()
    shape.from_mesh(points.data)
    bmesh.ops.delete(shape, geom=list(shape.verts)[:10], context="VERTS")
    shape.to_mesh(points.data)
    press("export_result", result="cloud", filepath=str(tmp_path / "less.ply"))
    assert f"element vertex {count - 10}".encode() in (tmp_path / "less.ply").read_bytes()[:3000]


@pytest.mark.medium
def test_a_result_follows_its_sensor(ran, tmp_path):
    obj, points = bpy.data.objects["cloud"], bpy.data.objects[ran.results["cloud"].shown]
    obj.name = "north tripod"
    bpy.context.view_layer.update()
    follow_names(bpy.context.scene)
    result = ran.results["north tripod"]
    assert "cloud" not in ran.results
    assert (result.title, result.shown, points.name) == (
        "north tripod",
        *["north-tripod points"] * 2,
    )
    press("export_result", result="north tripod", filepath=str(tmp_path / "named.laz"))
    count = len(bpy.data.objects)
    run("north tripod")  # in place of what it found before
    assert len(bpy.data.objects) == count
    assert [r.name for r in ran.results if r.kind == "terrestrial"] == ["north tripod"]


# ---------------------------------------------------------------------------------------------- show
# What the icons of a result do.


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


@pytest.mark.medium
def test_points_are_shown_and_selected_on_request(built):
    cube = add_cube()
    cube.select_set(True)
    run("cloud")
    (cloud,) = clouds()
    assert cloud.visible_get()
    assert bpy.context.selected_objects == [cube]
    assert press("select_result", shown=cloud.name) == {"FINISHED"}
    assert bpy.context.selected_objects == [cloud]
    assert bpy.context.view_layer.objects.active == cloud
    assert len(cloud.data.vertices) == int(facts(built, "cloud")["Points"].replace(",", ""))
    assert {"tree", "organ", "distance"} <= set(cloud.data.attributes.keys())
    assert has_input(cloud.modifiers[0], RADIUS)
    assert cloud.modifiers[0].node_group.name.startswith(GROUP)


@pytest.mark.medium
def test_a_cloud_shows_even_where_its_collection_was_hidden(built):
    layer = bpy.context.view_layer.layer_collection.children["Forest"]
    for name in ("Results", "Sensors"):
        made = add_collection(f"mine in {name}", layer.children[name].collection)
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
