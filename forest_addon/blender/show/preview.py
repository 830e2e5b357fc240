"""Pictures by Cycles on the CPU: of a forest and its surroundings, by a walker; of trees, on a sheet or near.

On a sheet trees hang in a grid before an orthographic camera that looks slightly down on them; the
background stays transparent. ``render_sheet`` says where each came to stand in the picture, so that labels
can be drawn below. Close-ups show a fork, the bark of the stem, a twig against the light.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from ... import spec
from ...base.progress import Progress
from ...base.rng import stream
from ...base.trimesh import TriMesh, join
from ...base.vectors import azimuth_of
from ...formats.atomic import replacing
from ...growth.library import find_species, load_species
from ...growth.skeleton import Skeleton
from ...growth.tree import Tree, grow
from ..files.export import empty_file
from ..scene import materials
from ..scene.attributes import plain_mesh
from ..scene.instances import IGNORED_KEY, read_points
from ..scene.layout import TREES, objects_in, part
from ..scene.meshes import to_mesh
from ..scene.nodes import Graph, tree_of

Field = tuple[tuple[float, float], tuple[float, float]]
LEVEL, FROM_ABOVE = -0.055, -0.45  # how much a camera looks down, a metre forward
WHOLE = 1.06  # of the picture for what is seen from above: all of it, with an edge
CAMERA, SUN, SKY = "Forest camera", "Forest sun", "Forest sky"
LAWN, SUNK, FAR = "Forest lawn", 0.03, 3000.0  # m below the ground, m to each side
HAZE, WARM = (
    (0.78, 0.87, 0.94),
    (0.95, 0.78, 0.60),
)  # of the sky at the horizon, by day, in the evening
EVENING = 1.0  # stops that a picture is brighter when the sun is low
FILL = 0.95  # of the picture; boxes are larger than crowns
CYCLES = {
    "device": "CPU",
    "use_denoising": True,
    "use_adaptive_sampling": True,
    "adaptive_threshold": 0.05,
    "max_bounces": 4,
    "use_fast_gi": True,  # light below the crowns by the sky that a point sees
    "fast_gi_method": "REPLACE",
    "ao_bounces_render": 1,
    "caustics_reflective": False,
    "caustics_refractive": False,
    "seed": 0,
}


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
    depsgraph = bpy.context.evaluated_depsgraph_get()
    boxes = []
    for obj in objects_in(part(scene, TREES)):
        placed = read_points(obj.evaluated_get(depsgraph))
        for number, source in enumerate(placed.source):
            boxes.append(_corners(placed.transform[placed.index == number], source))
        if not len(placed):
            boxes.append(_corners(np.array(obj.matrix_world)[None, :3], obj))
    bare = np.array([[x, y, z] for x in (0, 10) for y in (0, 10) for z in (0, 4)], float)
    corners = np.concatenate(boxes) if boxes else bare
    if field is None:
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        middle[2] = 0.47 * corners[:, 2].max()
        _point_camera(scene, corners, middle, LEVEL, FILL)
    else:
        low, extent = np.array(field[0]), np.array(field[1])
        ground = [(*(low + extent * (x, y)), 0.0) for x in (0, 1) for y in (0, 1)]
        corners = np.concatenate([corners, ground])
        _point_camera(scene, corners, corners.mean(axis=0), FROM_ABOVE, WHOLE)
    high, energy, colour = (75, 7.5, (1.0, 0.74, 0.42)) if golden else (50, 6.5, (1.0, 0.88, 0.70))
    _replace(scene, _sun(SUN, energy, 0.6, colour, (high, 0, -75)))
    if golden:
        scene.view_settings.view_transform = "AgX"
        scene.view_settings.look = "AgX - Medium High Contrast"
        scene.view_settings.exposure = EVENING

    world = bpy.data.worlds.get(SKY) or bpy.data.worlds.new(SKY)
    graph = Graph(tree_of(world))
    graph.tree.nodes.clear()
    # A gradient from haze at the horizon to blue above; the same in every version of Blender.
    colours = WARM if golden else HAZE, (0.16, 0.38, 0.78)
    sky = graph.ramp(graph.axis(graph.place("Generated"), "Z"), colours, 0.0, 0.30)
    graph.add("OutputWorld", {"Surface": graph.value("Background", sky, 1.1)})
    # A smooth sky is found by chance: aiming at it takes four times as long.
    if hasattr(world, "cycles"):
        world.cycles.sampling_method = "NONE"
    scene.world = world


def lay_lawn(scene: bpy.types.Scene, height: float) -> None:
    """Ground as far as the horizon, below that of the forest, for pictures alone.

    Views do not show it, so that *View All* frames the forest; sensors do not meet it.
    """
    coat = bpy.data.materials.get(LAWN) or materials.ground(LAWN)
    _lay(scene.collection, LAWN, _flat(LAWN, FAR, height - SUNK, coat))


def _flat(name: str, far: float, height: float, coat: bpy.types.Material) -> bpy.types.Mesh:
    """A level square that reaches so many metres to each side."""
    corners = [(-far, -far, height), (far, -far, height), (far, far, height), (-far, far, height)]
    return plain_mesh(name, corners, [(0, 1, 2, 3)], coat)


def _lay(home: bpy.types.Collection, name: str, data: bpy.types.Mesh) -> bpy.types.Object:
    """An object for pictures alone: views do not show it, sensors do not meet it."""
    obj = bpy.data.objects.new(name, data)
    obj[IGNORED_KEY] = obj.hide_viewport = obj.hide_select = True
    home.objects.link(obj)
    return obj


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
    for name, value in CYCLES.items():
        setattr(scene.cycles, name, value)
    scene.cycles.samples = output.preview_samples
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


def _corners(transform: np.ndarray, obj: bpy.types.Object) -> np.ndarray:
    """(8 N, 3) corners of an object's bounding box where it stands N times (N, 3, 4)."""
    box = np.column_stack([np.array(obj.bound_box), np.ones(8)])
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


def _sun(
    name: str, energy: float, angle: float, colour: materials.Colour, turn: tuple[float, ...]
) -> bpy.types.Object:
    """A new sun that no scene has yet; its angle and turn in degrees."""
    data = bpy.data.lights.new(name, "SUN")
    data.energy, data.angle, data.color = energy, math.radians(angle), colour
    sun = bpy.data.objects.new(name, data)
    sun.rotation_euler = [math.radians(degrees) for degrees in turn]
    return sun


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _replace(scene: bpy.types.Scene, obj: bpy.types.Object) -> None:
    """Link an object into the scene in place of an earlier one of the same name."""
    name = obj.data.name.split(".")[0]
    old = scene.objects.get(name)
    if old is not None and old is not obj:
        data, home = old.data, bpy.data.cameras if old.type == "CAMERA" else bpy.data.lights
        bpy.data.objects.remove(old)
        home.remove(data)
    obj.name = obj.data.name = name
    scene.collection.objects.link(obj)


HORIZON = "Forest horizon"
RINGS = (
    (130.0, 8.0, 1.5),
    (520.0, 27.0, 1.5),
    (1300.0, 70.0, 2.2),
)  # beyond the field, height, crowns; m
CORNERS = 1440
PLAIN, PLAIN_CORNERS = f"{HORIZON} plain", 64
BELOW = 0.3  # metres: the plain lies below the field's own ground
VISIBILITY = 700.0  # m
WOODED, AIR = (0.050, 0.085, 0.030), (0.62, 0.72, 0.80)  # colours


def lay_horizon(scene: bpy.types.Scene, middle: np.ndarray, reach: float, height: float) -> None:
    """Put hills around a field, in place of those that are there.

    middle : (2,) of the field, metres. reach : of the field and what stands on it. height : of its ground.
    """
    for obj in [t for t in scene.objects if t.name.startswith(HORIZON)]:
        data = obj.data
        bpy.data.objects.remove(obj)
        bpy.data.meshes.remove(data)
    for number, (beyond, high, jag) in enumerate(RINGS):
        vertices, faces = _ring(number, reach + beyond, high, jag)
        name = f"{HORIZON} {number}"
        material = bpy.data.materials.get(name) or bpy.data.materials.new(name)
        graph = Graph(tree_of(material))
        graph.tree.nodes.clear()
        air = 1 - np.exp(-beyond / VISIBILITY)  # a flat colour: leaves seen through so much air
        colour = tuple(float(w + air * (a - w)) for w, a in zip(WOODED, AIR, strict=True))
        graph.add("OutputMaterial", {"Surface": graph.value("Emission", colour)})
        vertices += [*middle, height]
        data = plain_mesh(HORIZON, vertices, faces, material)
        ring = _lay(scene.collection, HORIZON, data)
        ring.visible_shadow = ring.visible_diffuse = ring.visible_glossy = False
    around = 2 * np.pi * np.arange(PLAIN_CORNERS) / PLAIN_CORNERS
    rim = (reach + RINGS[0][0]) * np.stack([np.cos(around), np.sin(around)], axis=1)
    places = np.column_stack([rim + middle, np.full(PLAIN_CORNERS, height - BELOW)])
    coat = bpy.data.materials.get(PLAIN) or materials.meadow(PLAIN)
    _lay(scene.collection, PLAIN, plain_mesh(HORIZON, places, [range(PLAIN_CORNERS)], coat))


def ridge_of(number: int, high: float, jag: float) -> tuple[np.ndarray, np.ndarray]:
    """(C,) angles around a ring of hills, and (C,) its heights there, m."""
    rng = stream(7, "horizon", number)
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    ridge = np.full(CORNERS, 0.62)
    for waves in range(2, 24):
        size = 0.55 / waves**1.1
        ridge += size * rng.normal() * np.sin(waves * angle + 2 * np.pi * rng.random())
    crowns = jag * np.abs(np.convolve(rng.normal(size=CORNERS), [0.5, 1.0, 0.5], mode="same"))
    return angle, high * np.clip(ridge, 0.25, 1.4) + crowns


def _ring(number: int, radius: float, high: float, jag: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (2 C, 3) and quads (C, 4) of one ring about the origin."""
    angle, ridge = ridge_of(number, high, jag)
    around = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    foot = np.column_stack([around, np.full(CORNERS, -0.05 * high - 2.0)])
    corner = np.arange(CORNERS)
    after = (corner + 1) % CORNERS
    faces = np.stack([corner, after, CORNERS + after, CORNERS + corner], axis=1)
    return np.concatenate([foot, np.column_stack([around, ridge])]), faces


NAME = "Forest undergrowth"
EYE, LENS = 1.65, 27.0  # metres above the ground; millimetres
HALF_VIEW = math.radians(30.0)
SIDE, AHEAD, TURNS = 2.5, 45.0, 24  # metres between places, as far as stems count, directions
CLEAR, ROOM = 3.0, 6.5  # metres to any stem, and to those in view; twice that to shrubs
SHRUB = 5.0  # metres of height, below which a plant hides what is behind it
UP = 0.09  # how much the eye looks up, a metre forward
SUN_HEIGHT, SUN_ASIDE = math.radians(32.0), math.radians(105.0)  # to the right of straight ahead
WALKER_FAR, FULL = 34.0, 9.0  # metres as far as anything grows, and as far as everything does
NEAR, THINNEST = 0.9, 0.2  # metres from the eye; share of what grows far away
CELL = 0.8  # metres between patches
PATCH = 0.55  # metres from the middle of a patch to its plants


# Undergrowth, each by waves of the ground of its own: species, plants of a patch, patches to choose from,
# share of the ground, least and largest size.
PLANTS = (
    ("grass", 16, 4, 0.52, (0.6, 1.25)),
    ("bilberry", 14, 3, 0.38, (0.7, 1.3)),
    ("fern", 1, 4, 0.10, (0.6, 1.2)),
    ("litter", 1, 4, 0.16, (0.7, 1.1)),
)


def walkers_view(
    stems: np.ndarray, tall: np.ndarray, middle: np.ndarray, reach: float
) -> tuple[np.ndarray, float]:
    """Place (2,) and direction, radians from +X, from which a walker sees most of a forest.

    stems : (N, 2) metres. tall : (N,) their heights. middle : (2,) of the field. reach : to its sides.
    """
    window = min(reach, 20.0) + ROOM
    some = np.abs(stems - middle).max(axis=1) < window + AHEAD
    near, tree = stems[some], tall[some] > SHRUB
    ticks = np.arange(-window, window + SIDE, SIDE)
    places = middle + np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    turn = 2 * np.pi * np.arange(TURNS) / TURNS
    if not len(near):
        return middle - [0.0, reach], np.pi / 2
    best = (-np.inf, places[0], 0.0)
    for place in places:
        offset = near - place
        far = np.hypot(offset[:, 0], offset[:, 1])
        if far.min() < CLEAR:
            continue
        azimuth = azimuth_of(offset)
        aside = np.abs((azimuth[None] - turn[:, None] + np.pi) % (2 * np.pi) - np.pi)
        seen = (aside < HALF_VIEW) & (far < AHEAD)
        weight = tree / (1 + (far / 14.0) ** 2)
        hidden = far < np.where(tree, ROOM, 2 * ROOM)
        crowd = (seen & hidden).sum(axis=1) + 2.0 * ((aside < 0.12) & (far < 9.0)).sum(axis=1)
        score = (seen * weight).sum(axis=1) - 0.5 * crowd
        if score.max() > best[0]:
            best = (float(score.max()), place, float(turn[score.argmax()]))
    return best[1], best[2]


def stand_walker(
    scene: bpy.types.Scene,
    stems: np.ndarray,
    tall: np.ndarray,
    middle: np.ndarray,
    reach: float,
    height: Callable[[np.ndarray], np.ndarray],
) -> tuple[np.ndarray, float]:
    """Move the scene's camera and sun to where a walker sees most, and return place and direction of the eye.

    stems, tall, middle, reach : as of ``walkers_view``. height : of the ground (N,) at places (N, 2).
    """
    place, turn = walkers_view(stems, tall, middle, reach)
    way = np.array([math.cos(turn), math.sin(turn), UP])
    ground = float(np.nan_to_num(height(place[None]))[0])
    camera, sun = scene.camera, scene.objects[SUN]
    camera.location = (*place, ground + EYE)
    camera.rotation_euler = Vector(way).to_track_quat("-Z", "Y").to_euler()
    camera.data.lens, camera.data.clip_start = LENS, 0.05
    side = turn - SUN_ASIDE
    flat = math.cos(SUN_HEIGHT)
    light = Vector((flat * math.cos(side), flat * math.sin(side), math.sin(SUN_HEIGHT)))
    sun.rotation_euler = light.to_track_quat("Z", "Y").to_euler()
    return place, turn


def grow_around(
    scene: bpy.types.Scene,
    place: np.ndarray,
    turn: float,
    height: Callable[[np.ndarray], np.ndarray],
    reach: float = WALKER_FAR,
) -> None:
    """Put patches of undergrowth, for the picture alone, where an eye sees the ground.

    place : (2,) of the eye, metres. turn : where it looks, radians from +X. height : of the ground (N,) at
    places (N, 2). reach : metres as far as anything grows.
    """
    home = bpy.data.collections.new(NAME)
    scene.collection.children.link(home)
    rng = stream(11, "undergrowth")
    cells = np.arange(-reach, reach, CELL)
    spots = np.stack(np.meshgrid(cells, cells), axis=-1).reshape(-1, 2)
    spots = spots + rng.uniform(-0.5, 0.5, spots.shape) * CELL
    far = np.hypot(spots[:, 0], spots[:, 1])
    aside = np.abs((azimuth_of(spots) - turn + np.pi) % (2 * np.pi) - np.pi)
    spots, far = (spots + place)[keep := (far > NEAR) & (far < reach) & (aside < 0.75)], far[keep]
    thinned = np.clip((reach - far) / (reach - FULL), THINNEST, 1.0)
    ground = height(spots)
    for sort, (species, plants, count, share, size) in enumerate(PLANTS):
        waves = _waves(spots, sort)
        grows = (waves < np.quantile(waves, share)) if len(waves) else np.empty(0, bool)
        grows &= (rng.random(len(spots)) < thinned) & np.isfinite(ground)
        patches = _patches(species, plants, count)
        for number in np.flatnonzero(grows):
            obj = _lay(home, NAME, patches[int(rng.integers(len(patches)))])
            obj.location = (*spots[number], float(ground[number]) - 0.01)
            obj.rotation_euler.z = float(rng.uniform(0, 2 * np.pi))
            obj.scale = (float(rng.uniform(*size)),) * 3


def _waves(spots: np.ndarray, sort: int) -> np.ndarray:
    """(N,) numbers that change over metres, of their own for every sort of plant."""
    rng = stream(12, "waves", sort)
    total = np.zeros(len(spots))
    for wide in (9.0, 5.0, 2.6, 1.5):
        for _ in range(3):
            turn, phase = rng.uniform(0, 2 * np.pi, 2)
            along = spots @ [np.cos(turn), np.sin(turn)]
            total += wide**0.5 * np.sin(2 * np.pi * along / wide + phase)
    return total


def _patches(name: str, plants: int, count: int) -> list[bpy.types.Mesh]:
    """Meshes of patches, each of a few plants that were grown for it."""
    species, kind = load_species(find_species(name, Path()))
    coats = materials.coats_of(species)
    made = []
    for number in range(count):
        rng = stream(13, name, number)
        grown = [grow(species, kind, rng).mesh for _ in range(min(3, plants))]
        parts = [_set_down(grown[k % len(grown)], rng, plants > 1) for k in range(plants)]
        made.append(to_mesh(NAME, join(parts), coats))
    return made


def _set_down(mesh: TriMesh, rng: np.random.Generator, apart: bool) -> TriMesh:
    """A plant turned about the vertical, somewhere in its patch."""
    turn, size = rng.uniform(0, 2 * np.pi), rng.uniform(0.7, 1.15)
    cos, sin = size * np.cos(turn), size * np.sin(turn)
    matrix = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, size]])
    out = PATCH * np.sqrt(rng.random()) * apart
    around = rng.uniform(0, 2 * np.pi)
    foot = np.array([out * np.cos(around), out * np.sin(around), 0.0])
    return replace(mesh, vertices=mesh.vertices @ matrix.T + foot, edges=None)


TILT = math.radians(7.0)
FIELD = (1.0, 1.28)  # width and height of a cell, Blender's units
IN_CELL = (0.90, 0.98)  # of a tree in its cell
DEEP = 0.5  # of its extent away from the eye, that counts as width
FOOT = 0.20  # of a tree above the lower edge of its cell, for a label


def render_sheet(
    trees: Sequence[tuple[spec.Species, Tree]],
    columns: int,
    width: int,
    path: str | os.PathLike[str],
    samples: int = 16,
    progress: Progress | None = None,
    one_scale: bool = False,
) -> list[tuple[float, float]]:
    """Render trees of species in rows; returns where the foot of each is, in pixels from the upper left.

    width : of the picture, pixels. one_scale : all as large as the largest needs, not each as its cell
        allows.

    Raises
    ------
    OSError : the picture could not be written.
    """
    empty_file()
    scene = bpy.context.scene
    rows = max(math.ceil(len(trees) / columns), 1)
    pixels = width / (columns * FIELD[0])
    high = rows * FIELD[1]
    scene.render.resolution_x, scene.render.resolution_y = width, round(high * pixels)
    cells = []
    least = min((_fit(tree) for _, tree in trees), default=1.0)
    for number, (species, tree) in enumerate(trees):
        row, column = divmod(number, columns)
        x = (column + 0.5) * FIELD[0]
        up = high - (row + 1) * FIELD[1] + FOOT  # on the picture; the camera's tilt shortens z
        size = least if one_scale else _fit(tree)
        _hang(scene, species, tree, x, up / math.cos(TILT), size)
        cells.append((x * pixels, (high - up) * pixels))
    _aim(scene, columns * FIELD[0], high)
    # Sun from the front left, so that no tree shades its neighbour much, and a bright sky
    scene.collection.objects.link(_sun("Sheet sun", 5.5, 3.0, (1.0, 0.92, 0.80), (52, 0, -38)))
    scene.world = world = bpy.data.worlds.new("Sheet sky")
    sky = next(n for n in tree_of(world).nodes if n.type == "BACKGROUND")
    sky.inputs["Color"].default_value = (0.75, 0.86, 1.0, 1.0)
    sky.inputs["Strength"].default_value = 0.8
    scene.render.film_transparent = True
    scene.render.image_settings.color_mode = "RGBA"
    render(scene, spec.Output(preview_samples=samples), path, progress)
    return cells


def _fit(tree: Tree) -> float:
    """The scale at which a tree fills its cell."""
    corners = tree.mesh.vertices
    wide = max(float(np.ptp(corners[:, 0])), DEEP * float(np.ptp(corners[:, 1])), 1e-3)
    tall = max(float(corners[:, 2].max()), 1e-3)
    return float(min(IN_CELL[0] / wide, IN_CELL[1] / tall))


def _hang(
    scene: bpy.types.Scene,
    species: spec.Species,
    tree: Tree,
    x: float,
    z: float,
    size: float,
) -> None:
    """Put a tree with its foot at (x, 0, z), scaled to this size."""
    low, top = tree.mesh.vertices.min(axis=0), tree.mesh.vertices.max(axis=0)
    middle = (low[0] + top[0]) / 2
    above = tree.mesh.vertices * [1, 1, 0] + np.maximum(tree.mesh.vertices * [0, 0, 1], 0.0)
    whole = replace(tree.mesh, vertices=above)  # without its sunk foot
    mesh = to_mesh(species.name, whole, materials.coats_of(species))
    obj = bpy.data.objects.new(species.name, mesh)
    obj.scale = (size, size, size)
    obj.location = (x - middle * size, 0.0, z)
    scene.collection.objects.link(obj)


def _aim(scene: bpy.types.Scene, wide: float, high: float) -> None:
    """A camera whose picture is (0..wide, 0..high) of the plane y = 0, seen slightly from above."""
    data = bpy.data.cameras.new("Sheet camera")
    data.type = "ORTHO"
    data.ortho_scale = max(wide, high)
    data.clip_end = 1000.0
    camera = bpy.data.objects.new("Sheet camera", data)
    middle = np.array([wide / 2, 0.0, high / 2 / math.cos(TILT)])
    camera.location = middle + 50.0 * np.array([0.0, -math.cos(TILT), math.sin(TILT)])
    camera.rotation_euler = (math.pi / 2 - TILT, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera


BEHIND, NEAREST, FARTHEST = 60, 7.0, 55.0  # trees behind, metres


@dataclass(frozen=True)
class View:
    """An eye, its target and where light comes from, metres; a lens, millimetres, and its f-number."""

    eye: np.ndarray
    target: np.ndarray
    sun: np.ndarray
    lens: float
    stop: float


def render_closeup(
    species: spec.Species,
    tree: Tree,
    shot: str,
    path: str | os.PathLike[str],
    *,
    size: tuple[int, int] = (800, 1000),
    samples: int = 48,
) -> None:
    """Render one of ``SHOTS`` of a tree to a PNG file.

    Raises
    ------
    SpecError : the tree has nothing of the kind: no fork, no stem at eye height, no leaf.
    OSError : the picture could not be written.
    """
    view = SHOTS[shot](species, tree)
    empty_file()
    scene = bpy.context.scene
    mesh = to_mesh(species.name, tree.mesh, materials.coats_of(species))
    scene.collection.objects.link(bpy.data.objects.new(species.name, mesh))
    set_stage(scene, size)
    lay_horizon(scene, np.zeros(2), FARTHEST, 0.0)
    floor = _flat("Close-up ground", FARTHEST + 100, 0.0, materials.ground("Close-up ground"))
    scene.collection.objects.link(bpy.data.objects.new("Close-up ground", floor))
    rng = stream(3, "closeup")
    way = view.target - view.eye
    turn = math.atan2(way[1], way[0]) + rng.uniform(-0.7, 0.7, BEHIND)
    far = np.sqrt(rng.uniform(NEAREST**2, FARTHEST**2, BEHIND))
    for angle, distance in zip(turn, far, strict=True):
        obj = bpy.data.objects.new("Behind", mesh)
        x, y = view.eye[:2] + distance * np.array([np.cos(angle), np.sin(angle)])
        if math.hypot(x, y) < 0.7 * NEAREST:
            continue
        obj.location = (x, y, 0.0)
        obj.rotation_euler.z = float(rng.uniform(0, 2 * np.pi))
        obj.scale = (float(rng.uniform(0.85, 1.1)),) * 3
        scene.collection.objects.link(obj)
    grow_around(scene, view.eye[:2], math.atan2(way[1], way[0]), lambda place: np.zeros(len(place)))
    camera, data = scene.camera, scene.camera.data
    camera.location = view.eye
    camera.rotation_euler = Vector(view.target - view.eye).to_track_quat("-Z", "Y").to_euler()
    data.lens, data.clip_start = view.lens, 0.02
    data.dof.use_dof, data.dof.aperture_fstop = True, view.stop
    data.dof.focus_distance = float(np.linalg.norm(view.target - view.eye))
    scene.objects[SUN].rotation_euler = Vector(view.sun).to_track_quat("Z", "Y").to_euler()
    render(scene, spec.Output(preview_samples=samples), path, exposure=1.0)


def _fork(species: spec.Species, tree: Tree) -> View:
    """A heavy limb at its stem, from the side and a little below."""
    wood = tree.skeleton
    parent = np.maximum(wood.parent, 0)
    heads = np.flatnonzero((wood.order == 1) & (wood.order[parent] == 0) & ~wood.is_dead)
    if not len(heads):
        raise spec.SpecError(species.name, "has no limb, so no fork can be shown")
    own, thick = wood.radius[heads, 0], wood.radius[parent[heads], 1]
    head = heads[np.argmax(own * np.minimum(own / thick, 0.85))]
    limb = wood.axis(int(head))[:12]
    foot, thick_here = wood.start[head], float(wood.radius[parent[head], 1])
    way = _unit(wood.end[limb[-1]] - foot)
    side = _unit(np.cross(way, [0.0, 0.0, 1.0]))
    target = foot + 2.2 * thick_here * way + [0.0, 0.0, 0.5 * thick_here]
    eye = target + 13.0 * thick_here * side + [0.0, 0.0, -2.5 * thick_here]
    sun = _unit(0.9 * side + 0.45 * way + [0.0, 0.0, 0.45])
    return View(eye, target, sun, 42.0, 5.6)


def _bark(species: spec.Species, tree: Tree) -> View:
    """The stem's bark at eye height, from a metre away."""
    centre, radius = _stem_at(tree.skeleton, 1.5)
    if not radius:
        raise spec.SpecError(species.name, "has no stem 1.5 m above the ground to be looked at")
    back = _unit(np.array([-0.45, -1.0, 0.0]))
    target = centre + radius * back
    sun = _unit(np.array([-1.0, -0.35, 0.85]))
    return View(target + 1.0 * back + [0.0, 0.0, 0.06], target, sun, 44.0, 4.0)


def _twig(species: spec.Species, tree: Tree) -> View:
    """Leaves at the edge of the crown between the eye and the sun."""
    leaves = tree.leaves
    if not len(leaves):
        raise spec.SpecError(species.name, "bears no leaves, so no twig can be shown")
    far = np.hypot(leaves.centre[:, 0], leaves.centre[:, 1])
    low, high = np.percentile(leaves.centre[:, 2], [8, 45])
    rim = np.where((leaves.centre[:, 2] > low) & (leaves.centre[:, 2] < high), far, 0.0)
    leaf = int(np.argmax(rim))
    near = np.linalg.norm(leaves.centre - leaves.centre[leaf], axis=1) < 0.3
    target = leaves.centre[near].mean(axis=0)
    out = _unit(np.array([*target[:2], 0.0]))
    along = np.array([-out[1], out[0], 0.0])
    eye = target - 0.75 * along + 0.12 * out + [0.0, 0.0, -0.10]
    sun = _unit(along + 0.35 * out + [0.0, 0.0, 0.65])
    return View(eye, target, sun, 45.0, 5.6)


SHOTS: dict[str, Callable[[spec.Species, Tree], View]] = {
    "fork": _fork,
    "bark": _bark,
    "twig": _twig,
}


def _stem_at(wood: Skeleton, height: float) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of the stem at a height; radius 0 where it does not reach it."""
    on = np.flatnonzero(
        (wood.order == 0) & (wood.start[:, 2] <= height) & (wood.end[:, 2] > height)
    )
    if not len(on):
        return np.zeros(3), 0.0
    row = on[0]
    share = (height - wood.start[row, 2]) / (wood.end[row, 2] - wood.start[row, 2])
    centre = wood.start[row] + share * (wood.end[row] - wood.start[row])
    return centre, float(wood.radius[row, 0] + share * (wood.radius[row, 1] - wood.radius[row, 0]))
