"""The intensity that trees are scattered by, drawn over the 3D view as a coloured surface on the ground.

It is made anew only when what it is made of has changed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...spec import Scene, SpecError
from ..settings import exchange

CELLS = 96  # of the intensity along the longer side of the field
LIFT = 0.05  # m above the ground, so that the two do not flicker
FAINT, STRONG = np.array([0.2, 0.5, 0.2, 0.0]), np.array([0.95, 0.9, 0.2, 0.55])

_looked_at: int | None = None  # the scene whose settings nothing has changed since
_drawn: tuple[Any, Any] = (None, None)  # the settings that the batch is of, the batch


def forget(_depsgraph: bpy.types.Depsgraph | None = None) -> None:
    """Something changed: look at the settings again before the next drawing."""
    global _looked_at
    _looked_at = None


def draw(context: bpy.types.Context) -> None:
    """Draw the intensity of the scene, where that is asked for."""
    global _looked_at, _drawn
    if not context.scene.forest_sensing.show_intensity:
        return
    if _looked_at != context.scene.session_uid:
        _looked_at = context.scene.session_uid
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
    if drawn[0] == key and not _takes_from_scene(settings):
        return drawn
    return key, _batch_of(settings, Path(folder), depsgraph)


def _takes_from_scene(settings: Scene) -> bool:
    """Return whether the intensity depends on objects, which may have changed."""
    return bool(settings.forest.terrain.object or any(p.painted for p in settings.plantings))


def _batch_of(settings: Scene, folder: Path, depsgraph: bpy.types.Depsgraph) -> Any:
    from ...blender.site import with_objects
    from ...site import ForestSite
    from ...stand.compose import corners_of, process_of
    from ...stand.files import read_inputs

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
