"""What is heard becomes a packed Sound on a Speaker, and survives saving."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from scipy.io import wavfile

from forest_addon.blender.show.sound import add_speaker, give_sound


def test_a_speaker_plays_what_is_packed(empty_blender, tmp_path):
    samples = np.random.default_rng(0).standard_normal((480, 2)) * 3
    speaker = add_speaker("reverb", (1, 2, 3))
    sound = give_sound(speaker, "reverb", samples, 48_000)
    (track,) = speaker.animation_data.nla_tracks
    assert [strip.type for strip in track.strips] == ["SOUND"]
    assert (speaker.data.sound, sound.name, tuple(speaker.location)) == (sound, "reverb", (1, 2, 3))

    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "heard.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "heard.blend"))
    packed = bpy.data.objects["reverb"].data.sound.packed_file.data
    (tmp_path / "heard.wav").write_bytes(packed)
    rate, heard = wavfile.read(tmp_path / "heard.wav")
    assert rate == 48_000
    assert np.abs(heard).max() == pytest.approx(10 ** (-1 / 20), rel=1e-6)
    expected = samples / np.abs(samples).max() * np.abs(heard).max()
    np.testing.assert_allclose(heard, expected, atol=1e-6)


def test_a_second_run_replaces_the_sound(empty_blender):
    speaker = add_speaker("reverb", (0, 0, 1))
    for level in (1.0, 0.5):
        give_sound(speaker, "reverb", np.full(100, level), 8000)
    assert [sound.name for sound in bpy.data.sounds] == ["reverb"]
