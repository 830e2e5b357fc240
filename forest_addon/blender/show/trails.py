"""Flights as Blender objects: a flyer that moves with the frames, and its trail, coloured by what it sensed.

The trail is a thin tube whose colour runs from red, where something was as near as ``NEAR``, to blue. Both
are kept from the sensors. A flyer is an empty that sensors can be parented to, or follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from ...growth.mesh.meshing import tube
from ..scene.attributes import plain_mesh, write
from ..scene.instances import IGNORED_KEY
from ..scene.layout import own
from ..scene.materials import coloured

NEAR, FAR = 0.5, 6.0  # metres: reddest, bluest
THICK = 0.03  # metres, a trail's radius
COLOUR = "sensed"
MATERIAL = "Flight trail"
FLIGHT_KEY = "forest_flight"  # on what shows flights, with the name of the flight


def show_flights(
    home: bpy.types.Collection,
    tracks: Sequence[Any],
    name: str = "Flight",
    flyer: bpy.types.Object | None = None,
) -> list[bpy.types.Object]:
    """Put flights into a collection in place of those of before; returns the flyers.

    tracks : see ``flight.flying.Track``. flyer : moves along the only track, in place of a new object.
    """
    old = [obj for obj in home.objects if FLIGHT_KEY in obj]
    meshes = [obj.data for obj in old if obj.type == "MESH"]
    bpy.data.batch_remove([obj for obj in old if obj is not flyer])
    bpy.data.batch_remove([mesh for mesh in meshes if not mesh.users])
    fps = bpy.context.scene.render.fps / bpy.context.scene.render.fps_base
    last, flyers = 1.0, []
    for number, track in enumerate(tracks):
        label = f"{name} {number:03d}" if len(tracks) > 1 else name
        obj = flyer
        if obj is None:
            obj = bpy.data.objects.new(label, None)
            obj.empty_display_type, obj.empty_display_size = "SINGLE_ARROW", 0.6
            home.objects.link(obj)
            obj[FLIGHT_KEY] = label
        animate(obj, track, fps)
        flyers.append(obj)
        if len(track.position) > 1:
            from scipy.spatial import cKDTree  # here: enabling the add-on does not wait for it

            moved = np.append(True, np.linalg.norm(np.diff(track.position, axis=0), axis=1) > 1e-6)
            place, near = track.position[moved], track.nearest[moved]
            vertices, triangles = tube(place, np.full(len(place), THICK), 6)
            coat = bpy.data.materials.get(MATERIAL) or own(coloured(MATERIAL, COLOUR, 0.6))
            data = plain_mesh(f"{label} trail", vertices, triangles, coat)
            of_vertex = cKDTree(place).query(vertices)[1]
            write(data, COLOUR, colours(near)[of_vertex], "FLOAT_COLOR")
            trail = bpy.data.objects.new(f"{label} trail", data)
            trail[FLIGHT_KEY], trail[IGNORED_KEY] = label, True
            home.objects.link(trail)
        last = max(last, 1 + track.seconds * fps)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, int(np.ceil(last))
    return flyers


def animate(obj: bpy.types.Object, track: Any, fps: float) -> None:
    """Key an object's place and heading along a flight; X looks ahead."""
    obj.animation_data_clear()
    obj.rotation_mode = "XYZ"
    heading = np.unwrap(track.heading)
    for number, (place, turn) in enumerate(zip(track.position, heading, strict=True)):
        frame = 1 + number * track.step * fps
        obj.location, obj.rotation_euler = place, (0.0, 0.0, turn)
        obj.keyframe_insert("location", frame=frame)
        obj.keyframe_insert("rotation_euler", index=2, frame=frame)


def colours(nearest: np.ndarray) -> np.ndarray:
    """(P, 4) from red (near) over white to blue (far); grey where nothing was sensed."""
    share = np.clip((nearest - NEAR) / (FAR - NEAR), 0.0, 1.0)
    red, white, blue = np.array([[0.8, 0.02, 0.01], [0.9, 0.85, 0.7], [0.02, 0.12, 0.8]])
    half = np.where(share < 0.5, 2 * share, 2 - 2 * share)[:, None]
    end = np.where((share < 0.5)[:, None], red, blue)
    shade = np.where(np.isnan(share)[:, None], 0.4, end + (white - end) * half)
    return np.column_stack([shade, np.ones(len(shade))])
