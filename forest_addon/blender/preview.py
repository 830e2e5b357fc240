"""A picture of the forest: camera, sun and sky, rendered by Cycles on the CPU."""

from __future__ import annotations

import math
import os
from collections.abc import Callable

import bpy
import numpy as np
from mathutils import Vector

from .. import spec
from ..formats.atomic import replacing

Progress = Callable[[int, int], None]


def set_stage(scene: bpy.types.Scene, settings: spec.Scene, height: float) -> None:
    """Give a scene a camera that sees the field from its south-west corner, a low sun and a sky.

    height : of the highest tree, metres.
    """
    _point_camera(scene, settings.forest, max(height, 2.0))
    _light(scene)


def render(
    scene: bpy.types.Scene,
    output: spec.Output,
    path: str | os.PathLike[str],
    progress: Progress | None = None,
) -> None:
    """Render to a PNG file.

    Raises
    ------
    OSError : the picture could not be written.
    """
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = output.preview_samples
    scene.cycles.use_denoising = True
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.max_bounces = 6
    scene.cycles.seed = 0
    scene.render.resolution_x, scene.render.resolution_y = output.preview_size
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "PNG"
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"

    def tell(stats: str, *_: object) -> None:
        if progress and "Sample " in stats:
            done, total = stats.rsplit("Sample ", 1)[1].split("/")[:2]
            progress(int(done), int("".join(c for c in total if c.isdigit())))

    bpy.app.handlers.render_stats.append(tell)
    try:
        with replacing(path) as partial:
            scene.render.filepath = str(partial)
            bpy.ops.render.render(write_still=True, scene=scene.name)
    finally:
        bpy.app.handlers.render_stats.remove(tell)
        scene.render.filepath = ""


def _point_camera(scene: bpy.types.Scene, field: spec.Forest, height: float) -> None:
    low, size = np.array(field.origin), np.array(field.size)
    middle = low + size / 2
    reach = float(np.linalg.norm(size)) / 2
    away = np.array([-0.75, -1.0]) / math.hypot(0.75, 1.0)
    place = middle + away * (reach + 0.9 * height)
    data = bpy.data.cameras.new("Forest camera")
    data.lens = 32.0
    data.clip_end = 10_000.0
    camera = bpy.data.objects.new("Forest camera", data)
    camera.location = (*place, 0.42 * height + 0.6)
    target = Vector((*middle, 0.42 * height))
    camera.rotation_euler = (target - camera.location).to_track_quat("-Z", "Y").to_euler()
    _replace(scene, camera)
    scene.camera = camera


def _light(scene: bpy.types.Scene) -> None:
    sun_data = bpy.data.lights.new("Forest sun", "SUN")
    sun_data.energy = 4.5
    sun_data.angle = math.radians(0.7)
    sun_data.color = (1.0, 0.89, 0.74)
    sun = bpy.data.objects.new("Forest sun", sun_data)
    sun.rotation_euler = (math.radians(52), 0.0, math.radians(-85))
    _replace(scene, sun)

    world = bpy.data.worlds.get("Forest sky") or bpy.data.worlds.new("Forest sky")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    # A gradient from haze at the horizon to blue above; the same in every version of Blender.
    place = nodes.new("ShaderNodeTexCoord")
    split = nodes.new("ShaderNodeSeparateXYZ")
    ramp = nodes.new("ShaderNodeValToRGB")
    sky, output = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeOutputWorld")
    first, last = ramp.color_ramp.elements
    first.position, first.color = 0.0, (0.80, 0.87, 0.93, 1.0)
    last.position, last.color = 0.55, (0.16, 0.36, 0.74, 1.0)
    sky.inputs["Strength"].default_value = 0.9
    links.new(place.outputs["Generated"], split.inputs["Vector"])
    links.new(split.outputs["Z"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], sky.inputs["Color"])
    links.new(sky.outputs["Background"], output.inputs["Surface"])
    scene.world = world


def _replace(scene: bpy.types.Scene, thing: bpy.types.Object) -> None:
    """Link an object into the scene in place of an earlier one of the same name."""
    name = thing.data.name.split(".")[0]
    old = scene.objects.get(name)
    if old is not None and old is not thing:
        data, home = old.data, bpy.data.cameras if old.type == "CAMERA" else bpy.data.lights
        bpy.data.objects.remove(old)
        home.remove(data)
    thing.name = thing.data.name = name
    scene.collection.objects.link(thing)
