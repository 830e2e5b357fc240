"""Results are written in a format of one's choice, called otherwise, removed with their points."""

import csv

import laspy
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.scene.layout import RADIUS
from forest_addon.blender.scene.nodes import has_input
from forest_addon.blender.show.cloud_nodes import GROUP
from forest_addon.formats.wav import read_wav
from forest_addon.results.dry_sounds import PEAK_DB, dry_sound
from forest_addon.results.kinds import RESULTS
from forest_addon.results.points import POINT
from forest_addon.sensing.reverb.auralise import auralise, normalised
from forest_addon.sensing.reverb.response import channels_of
from forest_addon.ui.results import finding, panel

from ..pressing import add_cube, press, run


def test_every_format_of_a_result_has_its_words():
    assert {ending for kind in RESULTS.values() for ending in kind.endings} == set(panel.WORDS)


@pytest.mark.medium
def test_a_cloud_is_exported_as_one_chooses(built, tmp_path):
    run("cloud")
    built.offset = "[1000, 2000, 0]"
    run("cloud")
    for ending in ("laz", "las", "ply", "npz", "csv"):
        path = tmp_path / f"mine.{ending}"
        assert press("export_result", result="cloud", filepath=str(path)) == {"FINISHED"}
        assert path.stat().st_size > 100
    points = bpy.data.objects[built.results["cloud"].shown]
    las = laspy.read(tmp_path / "mine.laz")
    assert len(las) == len(points.data.vertices)
    assert float(las.x.min()) > 900
    with pytest.raises(RuntimeError, match=r"use \.laz"):
        press("export_result", result="cloud", filepath=str(tmp_path / "mine.doc"))


@pytest.mark.slow
def test_what_is_too_large_to_be_kept_says_so(built, tmp_path, monkeypatch):
    monkeypatch.setattr(finding, "MOST", 1000)
    run("echo")
    with pytest.raises(RuntimeError, match="Run its sensor again"):
        press("export_result", result="echo", filepath=str(tmp_path / "mine.wav"))


@pytest.mark.medium
def test_points_have_a_radius(built):
    run("cloud")
    points = bpy.data.objects[built.results["cloud"].shown]
    assert has_input(points.modifiers[0], RADIUS)
    assert points.modifiers[0].node_group.name.startswith(GROUP)


@pytest.mark.medium
def test_an_echo_can_be_heard(built):
    run("echo")
    samples, rate = panel.heard_of(built.results["echo"])
    assert rate == 20_000  # 400 kHz, twenty times slower
    assert samples.shape[1] == 1
    assert 0.85 < abs(samples).max() <= 1.0
    assert press("play", sensor="echo") == {"FINISHED"}
    assert panel._playing[1].specs[0] == rate
    assert np.abs(panel._playing[1].data() - samples).max() < 1e-6


@pytest.mark.medium
def test_a_reverb_is_played_as_the_chosen_sound_is_heard(built, tmp_path):
    """What Blender's audio library was given is the convolution; the exported WAV has it, too."""
    run("reverb")
    _, found, _ = finding.unpack(built.results["reverb"].found)
    responses = channels_of(found).reshape(len(found.samples), -1)
    for choice in ("CLAP", "CALL"):
        built.dry = choice
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
    built.dry = "NONE"
    press("play", sensor="reverb")
    click = panel._playing[1].data()[:, 0]
    assert np.argmax(np.abs(click)) == np.argmax(np.abs(responses[:, 0]))
    built.dry, built.dry_file = "FILE", str(tmp_path / "CLAP.wav")
    assert press("play", sensor="reverb") == {"FINISHED"}
    built.dry_file = str(tmp_path / "none.wav")
    with pytest.raises(RuntimeError, match=r"none\.wav: cannot be read"):
        press("play", sensor="reverb")


@pytest.fixture
def painted(props, sensor):
    """A cube with two materials, an object without one, and what a scanner found of them."""
    add_cube().name = "my house"
    house = bpy.data.objects["my house"]
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
def test_species_have_their_names_and_class_stays_as_it_was(built, tmp_path):
    run("cloud")
    press("export_result", result="cloud", filepath=str(tmp_path / "a.laz"), labels="SPECIES")
    las, number, names = classes(tmp_path / "a.laz")
    assert names[64] == "hazelnut"
    np.testing.assert_array_equal(number == 64, np.asarray(las["species"]) == 0)
    assert set(number.tolist()) == {1, 64}
    press("export_result", result="cloud", filepath=str(tmp_path / "b.laz"))
    las = laspy.read(tmp_path / "b.laz")
    assert set(np.asarray(las.classification).tolist()) <= {1, 2, 5}
    assert not [vlr for vlr in las.vlrs if vlr.record_id == 0 and vlr.user_id == "LASF_Spec"]
