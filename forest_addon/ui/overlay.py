"""Drawn over the 3D view: where sensors look, the intensity that trees are scattered by, points of results.

What is drawn is made anew only when Blender says that something changed, and the intensity only when what
it is made of did; a redraw hands finished batches to the graphics card. Nothing is added to the scene, and
nothing is left when the add-on is disabled.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..blender.sensors import sensors_of
from ..spec import Scene, SpecError
from . import exchange, point_overlay

COLOURS = {
    "tractor": (0.35, 0.75, 1.0, 0.8),
    "terrestrial": (0.35, 0.75, 1.0, 0.8),
    "mobile": (0.35, 0.75, 1.0, 0.8),
    "airborne": (0.35, 0.75, 1.0, 0.8),
    "sonar": (1.0, 0.75, 0.25, 0.8),
    "reverb": (0.75, 0.55, 1.0, 0.9),
}
LINE = 1.5  # pixels
CELLS = 96  # of the intensity along the longer side of the field
LIFT = 0.05  # m above the ground, so that the two do not flicker
FAINT, STRONG = np.array([0.2, 0.5, 0.2, 0.0]), np.array([0.95, 0.9, 0.2, 0.55])

_handle: Any = None
_batches: list[tuple[Any, Any, tuple[float, ...] | None]] = []
_intensity: tuple[Any, Any] = (None, None)  # the settings that the intensity is of, its batch
_drawn_for: Any = None  # the scene that the batches are of; None: make them anew


def register() -> None:
    """Draw from now on, and hear of changes."""
    global _handle
    if bpy.app.background:  # there is no view to draw over
        return
    _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")
    for handlers in _handlers():
        handlers.append(_forget)


def unregister() -> None:
    """Take everything back."""
    global _handle, _intensity
    if _handle is None:
        return
    bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = None
    for handlers in _handlers():
        if _forget in handlers:
            handlers.remove(_forget)
    _batches.clear()
    _intensity = (None, None)
    point_overlay.forget()


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


def _handlers() -> tuple[list, ...]:
    handlers = bpy.app.handlers
    return (
        handlers.depsgraph_update_post,
        handlers.frame_change_post,
        handlers.undo_post,
        handlers.redo_post,
        handlers.load_post,
    )


@bpy.app.handlers.persistent
def _forget(_scene: object = None, depsgraph: bpy.types.Depsgraph | None = None) -> None:
    global _drawn_for
    _drawn_for = None
    point_overlay.forget(depsgraph)


def _draw() -> None:
    global _drawn_for
    context = bpy.context
    if not context.space_data.overlay.show_overlays:
        return
    if _drawn_for != context.scene.session_uid:
        _make(context.scene)
        _drawn_for = context.scene.session_uid
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    for shader, batch, colour in _batches:
        shader.bind()
        if colour is not None:
            shader.uniform_float("color", colour)
            shader.uniform_float("lineWidth", LINE)
            shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
        batch.draw(shader)
    if context.scene.forest_sensing.show_points:
        point_overlay.draw(context)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def _make(scene: bpy.types.Scene) -> None:
    """The batches of a scene, from its settings."""
    _batches.clear()
    props = scene.forest_sensing
    if props.show_intensity:
        _add_intensity(bpy.context.evaluated_depsgraph_get())
    if props.show_sensors:
        from ..sensing.outline import outline

        lines = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
        for thing in sensors_of(scene):
            try:
                sensor = exchange.sensor_of(thing)
            except (SpecError, ValueError):
                continue  # the panel says what is wrong when it is run
            ends = outline(sensor).reshape(-1, 3)
            batch = batch_for_shader(lines, "LINES", {"pos": ends.astype(np.float32)})
            _batches.append((lines, batch, COLOURS[sensor.kind]))


def _add_intensity(depsgraph: bpy.types.Depsgraph) -> None:
    """The intensity's batch: the one that was made of the same settings, or a new one."""
    global _intensity
    scene = depsgraph.scene.original
    try:
        settings = exchange.to_spec(scene, [])
    except SpecError:
        return  # the panel says what is wrong when the forest is built
    folder = bpy.path.abspath(scene.forest_sensing.folder)
    key = (scene.session_uid, folder, settings.offset, settings.forest, settings.plantings)
    if _intensity[0] != key or _takes_from_scene(settings):
        _intensity = (key, _intensity_batch(settings, Path(folder), depsgraph))
    if _intensity[1] is not None:
        _batches.append(_intensity[1])


def _takes_from_scene(settings: Scene) -> bool:
    """Whether the intensity depends on objects, which may have changed."""
    return bool(settings.forest.terrain.object or any(p.painted for p in settings.plantings))


def _intensity_batch(settings: Scene, folder: Path, depsgraph: bpy.types.Depsgraph) -> Any:
    from ..blender.inputs import inputs_from_scene
    from ..formats.stand_files import read_inputs
    from ..stand.compose import corners_of, process_of

    try:
        inputs = inputs_from_scene(settings, depsgraph, read_inputs(settings, folder))
        scattered = [p for p in settings.plantings if p.layout == "poisson"]
        processes = [process_of(planting, settings.forest, inputs) for planting in scattered]
    except (SpecError, ValueError, OSError):
        return None
    if not processes:
        return None

    def together(places: np.ndarray) -> np.ndarray:
        return np.sum([process.at(places) for process in processes], axis=0)

    ground = inputs.ground(settings.forest.terrain.base)
    places, colours, triangles = intensity_surface(together, *corners_of(settings.forest))
    height = ground.height(places[:, :2])
    places[:, 2] += np.where(np.isfinite(height), height, settings.forest.terrain.base)
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch = batch_for_shader(
        shader,
        "TRIS",
        {"pos": places.astype(np.float32), "color": colours.astype(np.float32)},
        indices=np.ascontiguousarray(triangles, dtype=np.int32),
    )
    return shader, batch, None
