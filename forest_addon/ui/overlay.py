"""Overlays of the 3D view, from the bottom up: intensity, outlines of sensors, points of results.

Each drawing makes anew what Blender says has changed and hands finished batches to the graphics card. One
that fails is left out until something changes, and takes no other along. Nothing is added to the scene, and
nothing is left when the add-on is disabled.

A point of 15 mm is smaller than a pixel from where one sees a forest, and Solid shading knows one colour for
all. So points are drawn as small squares of so many pixels, in every shading, as long as overlays are shown;
those that are larger than the modifier's radius, as loud ones of an echo are, have as many times more.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from ..blender.scene.attributes import read
from ..blender.scene.layout import CLOUD_KEY, GAMMA, RADIUS, RESULTS, find_part
from ..blender.scene.nodes import has_input, input_of
from ..blender.sensors.objects import kind_of, sensors_of
from ..sensing.kinds import KINDS, outline
from ..spec import Scene, SpecError
from .settings import exchange
from .settings.drawing import OnceStarted, is_narrow, split
from .settings.exchange import forestless
from .shell.running import panel
from .shell.views import chosen_sensor, draw_lines, draw_no_more, draw_over, line_shader

CELLS = 96  # of the intensity along the longer side of the field
LIFT = 0.05  # m above the ground, so that the two do not flicker
FAINT, STRONG = np.array([0.2, 0.5, 0.2, 0.0]), np.array([0.95, 0.9, 0.2, 0.55])

Drawing = Callable[[bpy.types.Context], None]
_made_for: dict[
    Drawing, int
] = {}  # the scene, by session_uid, that a drawing is of since it changed last
_drawn: tuple[Any, Any] = (None, None)  # the settings that the batch is of, the batch


def _is_new(drawing: Drawing, scene: bpy.types.Scene) -> bool:
    """Return whether something changed, or there is another scene, since a drawing asked last."""
    known, _made_for[drawing] = _made_for.get(drawing), scene.session_uid
    return known != scene.session_uid


def draw_intensity(context: bpy.types.Context) -> None:
    """Draw the intensity of the scene, where that is asked for."""
    global _drawn
    if not context.scene.forest_sensing.show_intensity:
        return
    if _is_new(draw_intensity, context.scene):
        before, _drawn = _drawn, (None, None)  # nothing, should this fail
        _drawn = _renewed(before, context.evaluated_depsgraph_get())
    if _drawn[1] is not None:
        shader, batch = _drawn[1]
        batch.draw(shader)


def intensity_surface(intensity: Any, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, ...]:
    """Vertices (V, 3), colours (V, 4) and triangles (T, 3) of an intensity over a field."""
    extent = high - low
    cells = np.maximum(1, np.round(CELLS * extent / extent.max())).astype(int)
    x, y = (np.linspace(low[k], high[k], cells[k] + 1) for k in range(2))
    across, along = np.meshgrid(x, y, indexing="ij")
    places = np.column_stack([across.ravel(), along.ravel()])
    value = intensity(places)
    share = (value / (value.max() or 1.0))[:, None]
    vertices = np.column_stack([places, np.full(len(places), LIFT)])
    corner = (np.arange(cells[0])[:, None] * len(y) + np.arange(cells[1])).ravel()
    quads = np.stack([corner, corner + len(y), corner + len(y) + 1, corner + 1], axis=1)
    return (
        vertices,
        FAINT + share * (STRONG - FAINT),
        np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]),
    )


def _renewed(drawn: tuple[Any, Any], depsgraph: bpy.types.Depsgraph) -> tuple[Any, Any]:
    """The batch that was made of the same settings, or a new one; None of settings that cannot be used."""
    scene = depsgraph.scene.original
    try:
        settings = exchange.to_spec(scene, [])
    except SpecError:
        return None, None  # the panel says what is wrong when the forest is built
    folder = bpy.path.abspath(scene.forest_sensing.folder)
    key = (scene.session_uid, folder, settings.offset, settings.forest, settings.plantings)
    objects = settings.forest.terrain.object or any(p.painted for p in settings.plantings)
    if drawn[0] == key and not objects:  # which may have changed
        return drawn
    return key, _batch_of(settings, Path(folder), depsgraph)


def _batch_of(settings: Scene, folder: Path, depsgraph: bpy.types.Depsgraph) -> Any:
    from ..blender.read.inputs import with_objects
    from ..site import ForestSite
    from ..stand.compose import corners_of, process_of
    from ..stand.files import read_inputs

    try:
        site = ForestSite(settings, folder, inputs=read_inputs(settings, folder))
        site = with_objects(site, depsgraph)
        scattered = [p for p in settings.plantings if p.layout not in ("rows", "list")]
        processes = [process_of(planting, settings.forest, site.inputs) for planting in scattered]
    except (SpecError, ValueError, OSError):
        return None
    if not processes:
        return None

    def together(places: np.ndarray) -> np.ndarray:
        return np.sum([process.at(places) for process in processes], axis=0)

    places, colours, triangles = intensity_surface(together, *corners_of(settings.forest))
    height = site.ground.height(places[:, :2])
    places[:, 2] += np.where(np.isfinite(height), height, settings.forest.terrain.base)
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    return shader, batch_for_shader(
        shader,
        "TRIS",
        {"pos": places.astype(np.float32), "color": colours.astype(np.float32)},
        indices=np.ascontiguousarray(triangles, dtype=np.int32),
    )


WIDTH, CHOSEN = 1.5, 2.5  # pixels, of the chosen sensor's lines
FAINT_LINES = 0.3  # share of the strength of a line that the other sensors' have

log = logging.getLogger(__name__)

_outlines: list[tuple[Any, tuple[float, ...], str]] = []


def draw_outlines(context: bpy.types.Context) -> None:
    """Draw the lines of the scene's sensors, where that is asked for."""
    if not context.scene.forest_sensing.show_sensors:
        return
    shader = line_shader()
    if _is_new(draw_outlines, context.scene):
        _outlines.clear()
        for obj, ends in lines(context.scene):
            batch = batch_for_shader(shader, "LINES", {"pos": ends})
            _outlines.append((batch, KINDS[kind_of(obj)].colour, obj.name))
    obj = chosen_sensor(context)
    name = "" if obj is None else obj.name
    for batch, colour, of in sorted(_outlines, key=lambda batch: batch[2] == name):
        draw_lines(shader, batch, *strength(colour, of == name))


def strength(colour: tuple[float, ...], chosen: bool) -> tuple[tuple[float, ...], float]:
    """Colour and width of a sensor's lines: the chosen one's are strong, the others' faint."""
    return (*colour[:3], 1.0 if chosen else FAINT_LINES * colour[3]), CHOSEN if chosen else WIDTH


def lines(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Object, np.ndarray]]:
    """Sensors and ends of their lines, (2 N, 3) float32 with N > 0, of every sensor that has any."""
    for obj in sensors_of(scene):
        try:
            ends = outline(exchange.sensor_of(obj)).reshape(-1, 3).astype(np.float32)
        except (SpecError, ValueError):
            continue  # the panel says what is wrong when it is run
        except Exception:  # a fault of ours: other sensors are drawn all the same
            log.exception("Forest Sensing cannot draw where %s looks", obj.name)
            continue
        if len(ends) and np.isfinite(ends).all():
            yield obj, ends


# After projection, in depth of the view's: points lie on surfaces, and would be half hidden by them.
NEARER = Matrix.Translation((0.0, 0.0, -2e-4))

SIZES = 6  # sizes that points of one cloud are drawn in

_points: dict[int, list[tuple[float, Any]]] = {}  # of a cloud, by its session_uid: size, points


def draw_points(context: bpy.types.Context) -> None:
    """Draw the clouds that the view shows, where that is asked for."""
    if not context.scene.forest_sensing.show_points:
        return
    home = find_part(context.scene, RESULTS)
    clouds = [obj for obj in home.objects if CLOUD_KEY in obj] if home else ()
    shader = gpu.shader.from_builtin("POINT_FLAT_COLOR")
    for obj in clouds:
        if not obj.visible_get(viewport=context.space_data):
            continue
        for size, batch in _batch(obj, shader, context):
            with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
                gpu.matrix.load_projection_matrix(NEARER @ gpu.matrix.get_projection_matrix())
                gpu.matrix.multiply_matrix(obj.matrix_world)
                gpu.state.point_size_set(size * context.scene.forest_sensing.point_size)
                batch.draw(shader)


def seen_points(obj: bpy.types.Object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of an evaluated cloud: (N, 3) places, of the object's own space, (N, 4) colours for the screen,
    and (N,) sizes in those of its modifier's radius."""
    geometry = obj.evaluated_geometry()  # its points are gone with it
    points = geometry.pointcloud
    known = points.attributes if points is not None else {}
    if "colour" not in known or "position" not in known:  # its modifier was removed or changed
        return np.empty((0, 3), np.float32), np.empty((0, 4), np.float32), np.empty(0, np.float32)
    colour = read(points, "colour", "FLOAT_COLOR")
    colour[:, :3] **= GAMMA
    modifier = next((m for m in obj.modifiers if has_input(m, RADIUS)), None)
    usual = float(input_of(modifier, RADIUS)) if modifier is not None else 0.0
    size = read(points, "radius") / usual if usual > 0 else np.ones(len(colour), np.float32)
    return read(points, "position", "FLOAT_VECTOR"), colour, size


def _batch(
    obj: bpy.types.Object, shader: gpu.types.GPUShader, context: Any
) -> list[tuple[float, Any]]:
    """Points to draw, by their size."""
    key = obj.session_uid
    if key not in _points:
        evaluated = obj.evaluated_get(context.evaluated_depsgraph_get())
        position, colour, size = seen_points(evaluated)
        step = max(float(np.ptp(size)), 1e-3) / SIZES if len(size) else 1.0
        group = np.round(size / step)
        _points[key] = [
            (
                float(size[group == number].mean()),
                batch_for_shader(
                    shader,
                    "POINTS",
                    {"pos": position[group == number], "color": colour[group == number]},
                ),
            )
            for number in np.unique(group)
        ]
    return _points[key]


DRAWINGS: tuple[Drawing, ...] = (draw_intensity, draw_outlines, draw_points)  # the layers
_broken: set[Drawing] = set()  # what failed since something changed


@panel("Overlays", OnceStarted, bl_parent_id="FOREST_PT_results")
def view(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    """Switches of the overlays of the 3D view."""
    props = context.scene.forest_sensing
    row = tab.layout.column(align=True) if is_narrow() else tab.layout.row(align=True)
    for name in ("show_sensors", "show_intensity", "show_points"):
        if name != "show_intensity" or not forestless(props):
            row.prop(props, name, toggle=True)
    if props.show_points:
        split(tab.layout).prop(props, "point_size")


def register() -> None:
    """Draw from now on, where there is a view to draw over."""
    draw_over(_draw)


def unregister() -> None:
    """Take everything back."""
    draw_no_more(_draw)
    forget()


def draw(drawings: Iterable[Drawing], context: bpy.types.Context) -> None:
    """Draw each of them, whatever becomes of the others."""
    for drawing in drawings:
        if drawing in _broken:
            continue
        try:
            drawing(context)
        except Exception:
            _broken.add(drawing)  # or it would fail, and say so, at every redraw
            log.exception("Forest Sensing cannot draw a part of its overlays")


@bpy.app.handlers.persistent
def forget(_scene: object = None, depsgraph: bpy.types.Depsgraph | None = None) -> None:
    """Something changed: make it anew, and try again what failed. Without a depsgraph, all has changed."""
    _broken.clear()
    _made_for.clear()
    if depsgraph is None:
        _points.clear()
    for update in depsgraph.updates if depsgraph is not None else ():
        if update.is_updated_geometry and isinstance(update.id, bpy.types.Object):
            _points.pop(update.id.original.session_uid, None)


WINDOW_HANDLERS = tuple(
    (f"{name}_post", forget)
    for name in ("depsgraph_update", "frame_change", "undo", "redo", "load")
)


def _draw() -> None:
    context = bpy.context
    if not context.space_data.overlay.show_overlays:
        return
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    draw(DRAWINGS, context)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")
