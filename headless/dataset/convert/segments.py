"""Segments of a scene's preview: for each pixel the class of FOR-instance and the tree that it shows.

Rays go from the camera through the middle of each pixel to the first surface; the render's own filter
blends over a pixel's edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

from forest_addon.formats.atomic import replacing
from forest_addon.formats.raster_file import write_png
from forest_addon.sensing.lidar.cloud import label
from forest_addon.sensing.rays.caster import RayCaster
from forest_addon.spec import Planting
from forest_addon.stand.forest import GrownForest

from ..for_instance import classes_of, orders_of
from .panoptic import EIGHT

MOST = 2**24 - 1  # that three bytes hold: two million trees
AT_ONCE = 200_000  # rays


def camera_rays(scene: bpy.types.Scene) -> tuple[np.ndarray, np.ndarray]:
    """(3,) place of the camera, metres, and (H, W, 3) unit ways through its pixels, upper row first."""
    camera, render = scene.camera, scene.render
    share = render.resolution_percentage / 100
    wide, high = (int(size * share) for size in (render.resolution_x, render.resolution_y))
    corners = np.array(camera.data.view_frame(scene=scene))  # upper right, lower right, lower left
    right, lower, left = corners[0], corners[1], corners[2]
    x = ((np.arange(wide) + 0.5) / wide)[None, :, None]
    y = ((np.arange(high) + 0.5) / high)[:, None, None]
    ways = left + (lower - right) * (y - 1) + (lower - left) * x
    turn = np.array(camera.matrix_world)
    ways = ways @ turn[:3, :3].T
    return turn[:3, 3], ways / np.linalg.norm(ways, axis=2, keepdims=True)


def write_segments(
    path: Path,
    scene: bpy.types.Scene,
    caster: RayCaster,
    forest: GrownForest,
    plantings: Sequence[Planting],
) -> None:
    """Write segments of what the camera of a scene sees, as the colours of a PNG.

    Raises
    ------
    OSError : it cannot be written.
    """
    place, ways = camera_rays(scene)
    flat = ways.reshape(-1, 3)
    found = []
    for first in range(0, len(flat), AT_ONCE):
        some = flat[first : first + AT_ONCE]
        hits = caster.cast(np.broadcast_to(place, some.shape), some)
        returns = label(caster.scene, hits, some)
        order = orders_of(returns, caster.scene, forest)
        classes, tree = classes_of(returns, order, plantings)
        segment = tree.astype(np.int64) * EIGHT + classes
        found.append(np.where(hits.found & (segment <= MOST), segment, 0))
    numbers = np.concatenate(found).reshape(ways.shape[:2])
    colours = np.stack([numbers & 255, numbers >> 8 & 255, numbers >> 16], axis=2)
    with replacing(path) as partial:
        partial.write_bytes(write_png(colours / 255.0))
