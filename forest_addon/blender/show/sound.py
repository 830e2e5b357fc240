"""Sounds on a Speaker: press play in Blender and hear the forest.

Samples go in; they are packed into the .blend as a 32-bit float WAV, and the Speaker plays them from frame 1.
The mixer brings several channels to one, because a Speaker is a point in Blender's own sound scene; levels
stay below full scale.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

from ...formats.wav import write_wav
from ...sensing.reverb.auralise import normalised

PEAK_DB = -1.0  # of the largest sample
KEY = "forest_sound"  # custom property of our Sounds: the sensor's name


def add_speaker(name: str, position: Sequence[float]) -> bpy.types.Object:
    """A new Speaker with the track that makes it play, which Blender's operator alone can make."""
    if bpy.ops.object.speaker_add(location=tuple(position)) != {"FINISHED"}:
        raise ValueError("a Speaker can be added in Object Mode only; leave this mode first")
    speaker = bpy.context.view_layer.objects.active
    speaker.name = speaker.data.name = name
    return speaker


def give_sound(
    speaker: bpy.types.Object, name: str, samples: np.ndarray, sample_rate: float
) -> bpy.types.Sound:
    """Make a Speaker sound like samples (N,) or (N, C), in place of what an earlier run gave it.

    name : of the sensor; the Sound is named after it.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sound.wav"  # a sensor's name may be too long for a file
        write_wav(path, normalised(samples, PEAK_DB)[0], sample_rate)
        sound = bpy.data.sounds.load(str(path))
        sound.pack()
    sound.filepath = f"//{name}.wav"
    sound[KEY] = name
    earlier = speaker.data.sound
    speaker.data.sound = sound
    if earlier is not None and earlier.get(KEY) == name and not earlier.users:
        bpy.data.sounds.remove(earlier)
    sound.name = name
    return sound
