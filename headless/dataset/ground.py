"""A random ground: a sum of smooth waves in all directions, each octave half as long and somewhat lower."""

from __future__ import annotations

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.spec import Forest
from forest_addon.stand.intensity.terrain import Heightmap

from .settings import Ground

WAVES = 12  # of an octave
FILE = "terrain.npy"


def heights_of(
    ground: Ground, seed: int, forest: Forest
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights (rows, columns) in metres, first row the north edge, with low corner (2,) and size (2,).

    They reach over the field and its margin, and lie between 0 and the relief on the field.
    """
    margin = min(forest.margin, 2 * max(forest.size))
    low = np.array(forest.origin) - margin
    size = np.array(forest.size) + 2 * margin
    count = np.maximum(2, np.ceil(size / ground.step).astype(int))
    x = low[0] + (np.arange(count[0]) + 0.5) * size[0] / count[0]
    y = low[1] + (np.arange(count[1])[::-1] + 0.5) * size[1] / count[1]
    total = np.zeros((count[1], count[0]))
    rng = stream(seed, "terrain")
    octaves = max(1, int(np.log2(max(ground.wavelength / (4 * ground.step), 1.0))) + 1)
    for octave in range(octaves):
        length = ground.wavelength / 2**octave
        turn, phase = 2 * np.pi * rng.random((2, WAVES))
        for a, p in zip(turn, phase, strict=True):
            along = (np.cos(a) * x[None, :] + np.sin(a) * y[:, None]) * (2 * np.pi / length)
            total += ground.roughness**octave * np.sin(along + p)
    inside = (x >= forest.origin[0]) & (x <= forest.origin[0] + forest.size[0])
    across = (y >= forest.origin[1]) & (y <= forest.origin[1] + forest.size[1])
    field = total[np.ix_(across, inside)] if inside.any() and across.any() else total
    spread = float(np.ptp(field)) or 1.0
    return ground.relief * (total - field.min()) / spread, low, size


def terrain_of(heights: np.ndarray, low: np.ndarray, size: np.ndarray) -> Heightmap:
    """The ground of these heights."""
    return Heightmap(heights, low, size, FILE)
