"""Results are written in a format of one's choice, called otherwise, removed with their points."""

import laspy
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.cloud_nodes import GROUP
from forest_addon.blender.layout import RADIUS
from forest_addon.blender.nodes import has_input
from forest_addon.formats.dry_sounds import wet_sound
from forest_addon.formats.wav import read_wav
from forest_addon.sensing.reverb.response import channels_of
from forest_addon.ui.results import held, show

from ..pressing import press, run


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
def test_sounds_are_exported_too(built, tmp_path):
    for name in ("echo", "reverb"):
        run(name)
        for ending in ("wav", "csv"):
            path = tmp_path / f"{name}.{ending}"
            assert press("export_result", result=name, filepath=str(path)) == {"FINISHED"}


def test_what_is_held_no_longer_says_so(built, tmp_path):
    run("cloud")
    held.let_go()
    with pytest.raises(RuntimeError, match="Run its sensor again"):
        press("export_result", result="cloud", filepath=str(tmp_path / "mine.laz"))


def test_a_result_is_removed_with_its_points(built):
    before = len(bpy.data.objects), len(bpy.data.meshes)
    run("cloud")
    shown = built.results["cloud"].shown
    press("remove_result", result="cloud")
    assert "cloud" not in built.results
    assert shown not in bpy.data.objects
    assert (len(bpy.data.objects), len(bpy.data.meshes)) == before


def test_points_have_a_radius(built):
    run("cloud")
    points = bpy.data.objects[built.results["cloud"].shown]
    assert has_input(points.modifiers[0], RADIUS)
    assert points.modifiers[0].node_group.name.startswith(GROUP)


def test_an_echo_can_be_heard(built):
    run("echo")
    samples, rate = show.heard_of(bpy.context.scene, "echo")
    assert rate == 20_000  # 400 kHz, twenty times slower
    assert samples.shape[1] == 1
    assert 0.85 < abs(samples).max() <= 1.0
    assert press("play", sensor="echo") == {"FINISHED"}
    assert show._playing[1].specs[0] == rate
    assert np.abs(show._playing[1].data() - samples).max() < 1e-6


def test_a_reverb_is_played_as_the_chosen_sound_is_heard(built, tmp_path):
    """What Blender's audio library was given is the convolution; the exported WAV has it, too."""
    run("reverb")
    _, found, _ = held.find(bpy.context.scene, "reverb")
    responses = channels_of(found).reshape(len(found.samples), -1)
    for choice in ("CLAP", "CALL"):
        built.dry = choice
        assert press("play", sensor="reverb") == {"FINISHED"}
        played = show._playing[1]
        wet = wet_sound(responses, found.sample_rate, choice.lower())
        assert played.specs[0] == found.sample_rate
        assert np.abs(played.data() - wet).max() < 1e-6
        path = str(tmp_path / f"{choice}.wav")
        assert press("export_result", result="reverb", filepath=path, heard=True) == {"FINISHED"}
        samples, rate = read_wav(tmp_path / f"{choice}.wav")
        assert rate == found.sample_rate
        assert np.abs(samples - wet[:, 0]).max() < 1e-6
    built.dry = "NONE"
    press("play", sensor="reverb")
    click = show._playing[1].data()[:, 0]
    assert np.argmax(np.abs(click)) == np.argmax(np.abs(responses[:, 0]))
    built.dry, built.dry_file = "FILE", str(tmp_path / "CLAP.wav")
    assert press("play", sensor="reverb") == {"FINISHED"}
    built.dry_file = str(tmp_path / "none.wav")
    with pytest.raises(RuntimeError, match=r"none\.wav: cannot be read"):
        press("play", sensor="reverb")


def test_a_reverb_of_an_earlier_session_is_taken_from_its_speaker(built):
    run("reverb")
    fresh, rate = show.heard_of(bpy.context.scene, "reverb")
    held.let_go()
    kept, same = show.heard_of(bpy.context.scene, "reverb")
    assert (same, kept.shape) == (rate, fresh.shape)
    assert np.abs(kept - fresh).max() < 1e-5
