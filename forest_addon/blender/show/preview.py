"""A picture of the forest: camera, sun and sky, rendered by Cycles on the CPU."""

from __future__ import annotations

import math
import os

import bpy
import numpy as np
from mathutils import Vector

from ... import spec
from ...base.progress import Progress
from ...formats.atomic import replacing
from ..scene import materials
from ..scene.instances import read_points
from ..scene.layout import TREES, objects_in, part
from ..scene.standings import IGNORED_KEY

Field = tuple[tuple[float, float], tuple[float, float]]
LEVEL, FROM_ABOVE = -0.055, -0.45  # how much a camera looks down, a metre forward
WHOLE = 1.06  # of the picture for what is seen from above: all of it, with an edge
CAMERA, SUN, SKY = "Forest camera", "Forest sun", "Forest sky"
LAWN, SUNK, FAR = "Forest lawn", 0.03, 3000.0  # m below the ground, m to each side
FAR_CORNERS = ((-FAR, -FAR), (FAR, -FAR), (FAR, FAR), (-FAR, FAR))
HAZE, WARM = (
    (0.78, 0.87, 0.94),
    (0.95, 0.78, 0.60),
)  # of the sky at the horizon, by day, in the evening
EVENING = 1.0  # stops that a picture is brighter when the sun is low
FILL = 0.80  # of the picture; boxes are larger than crowns, so below 1 nothing is cut


def set_stage(
    scene: bpy.types.Scene,
    size: tuple[int, int],
    field: Field | None = None,
    golden: bool = False,
) -> None:
    """Give a scene a camera that sees every tree from the south-west, a low sun and a sky.

    size : width and height of the picture, pixels.
    field : corner and extent of ground that is seen whole, from above; None: from a person's height.
    golden : the sun stands as low as an hour before it sets.
    """
    scene.render.resolution_x, scene.render.resolution_y = size
    corners = _tree_corners(scene)
    if field is None:
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        middle[2] = 0.47 * corners[:, 2].max()
        _point_camera(scene, corners, middle, LEVEL, FILL)
    else:
        low, extent = np.array(field[0]), np.array(field[1])
        ground = [(*(low + extent * (x, y)), 0.0) for x in (0, 1) for y in (0, 1)]
        corners = np.concatenate([corners, ground])
        _point_camera(scene, corners, corners.mean(axis=0), FROM_ABOVE, WHOLE)
    _light(scene, golden)


def lay_lawn(scene: bpy.types.Scene, height: float) -> None:
    """Ground as far as the horizon, below that of the forest, for pictures alone.

    Views do not show it, so that *View All* frames the forest; sensors do not meet it.
    """
    data = bpy.data.meshes.new(LAWN)
    z = height - SUNK
    data.from_pydata([(x, y, z) for x, y in FAR_CORNERS], [], [(0, 1, 2, 3)])
    data.materials.append(bpy.data.materials.get(LAWN) or materials.ground(LAWN))
    lawn = bpy.data.objects.new(LAWN, data)
    lawn[IGNORED_KEY] = lawn.hide_viewport = lawn.hide_select = True
    scene.collection.objects.link(lawn)


def render(
    scene: bpy.types.Scene,
    output: spec.Output,
    path: str | os.PathLike[str],
    progress: Progress | None = None,
    exposure: float = 0.35,
) -> None:
    """Render to a PNG file.

    exposure : stops; more where the sun is low.

    Raises
    ------
    OSError : the picture could not be written.
    """
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = output.preview_samples
    scene.cycles.use_denoising = True
    scene.cycles.use_adaptive_sampling = True
    scene.cycles.adaptive_threshold = 0.05
    scene.cycles.max_bounces = 4
    scene.cycles.use_fast_gi = True  # light below the crowns by the sky that a point sees
    scene.cycles.fast_gi_method = "REPLACE"
    scene.cycles.ao_bounces_render = 1
    scene.cycles.caustics_reflective = scene.cycles.caustics_refractive = False
    scene.cycles.seed = 0
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "PNG"
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.view_settings.exposure = exposure

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


def _tree_corners(scene: bpy.types.Scene) -> np.ndarray:
    """(P, 3) corners of the bounding boxes of all trees; a small field where there is none."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    corners = []
    for thing in objects_in(part(scene, TREES)):
        placed = read_points(thing.evaluated_get(depsgraph))
        for number, source in enumerate(placed.source):
            corners.append(_corners(placed.transform[placed.index == number], source))
        if not len(placed):
            corners.append(_corners(np.array(thing.matrix_world)[None, :3], thing))
    bare = np.array([[x, y, z] for x in (0, 10) for y in (0, 10) for z in (0, 4)], float)
    return np.concatenate(corners) if corners else bare


def _corners(transform: np.ndarray, thing: bpy.types.Object) -> np.ndarray:
    """(8 N, 3) corners of an object's bounding box where it stands N times (N, 3, 4)."""
    box = np.column_stack([np.array(thing.bound_box), np.ones(8)])
    return np.asarray((transform @ box.T).transpose(0, 2, 1).reshape(-1, 3))


def _point_camera(
    scene: bpy.types.Scene, corners: np.ndarray, target: np.ndarray, fall: float, fill: float
) -> None:
    """Look at a target along a fixed direction from as near as all corners fit into the picture."""
    forward = _unit(np.array([0.45, 1.0, fall]))
    right = _unit(np.cross(forward, [0.0, 0.0, 1.0]))
    up = np.cross(right, forward)

    data = bpy.data.cameras.new(CAMERA)
    data.lens = 35.0
    data.clip_end = 10_000.0
    across = 0.5 * data.sensor_width / data.lens
    width, height = scene.render.resolution_x, scene.render.resolution_y
    offset = corners - target
    target = target + right * (offset @ right).mean()
    offset = corners - target
    wide = np.abs(offset @ right) / across
    tall = np.abs(offset @ up) / (across * height / width)
    distance = float((np.maximum(wide, tall) * fill - offset @ forward).max())

    camera = bpy.data.objects.new(CAMERA, data)
    place = target - forward * distance
    place[2] = max(place[2], 1.5)
    camera.location = place
    camera.rotation_euler = Vector(target - place).to_track_quat("-Z", "Y").to_euler()
    _replace(scene, camera)
    scene.camera = camera


def _light(scene: bpy.types.Scene, golden: bool) -> None:
    sun_data = bpy.data.lights.new(SUN, "SUN")
    sun_data.energy = 6.5
    sun_data.angle = math.radians(0.6)
    sun_data.color = (1.0, 0.88, 0.70)
    sun = bpy.data.objects.new(SUN, sun_data)
    sun.rotation_euler = (math.radians(50), 0.0, math.radians(-75))
    if golden:
        sun_data.energy, sun_data.color = 7.5, (1.0, 0.74, 0.42)
        sun.rotation_euler.x = math.radians(75)
        scene.view_settings.view_transform = "AgX"
        scene.view_settings.look = "AgX - Medium High Contrast"
        scene.view_settings.exposure = EVENING
    _replace(scene, sun)

    world = bpy.data.worlds.get(SKY) or bpy.data.worlds.new(SKY)
    if world.node_tree is None:
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    # A gradient from haze at the horizon to blue above; the same in every version of Blender.
    place = nodes.new("ShaderNodeTexCoord")
    split = nodes.new("ShaderNodeSeparateXYZ")
    ramp = nodes.new("ShaderNodeValToRGB")
    sky, output = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeOutputWorld")
    first, last = ramp.color_ramp.elements
    first.position, first.color = 0.0, (*(WARM if golden else HAZE), 1.0)
    last.position, last.color = 0.30, (0.16, 0.38, 0.78, 1.0)
    sky.inputs["Strength"].default_value = 1.1
    links.new(place.outputs["Generated"], split.inputs["Vector"])
    links.new(split.outputs["Z"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], sky.inputs["Color"])
    links.new(sky.outputs["Background"], output.inputs["Surface"])
    if hasattr(
        world, "cycles"
    ):  # a smooth sky is found by chance: aiming at it takes four times as long
        world.cycles.sampling_method = "NONE"
    scene.world = world


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


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
