"""Rough ground: bumps and hollows of a few decimetres to metres on whatever the ground is otherwise.

Heights are a sum of cosine waves of 0.6 to 4.8 m in all directions, each octave with the amplitude that its
length has in a surface of Hurst exponent 0.7, of which the standard deviation is a quarter of the roughness:
what lies within two of them is 95 % of the ground. Beyond the field it fades, so that its edge is level.
"""

from __future__ import annotations

import numpy as np

from ...base.rng import stream
from ...spec import Forest, SpecError
from .terrain import Flat, GroundSurface, Heightmap

STEP, MOST = (
    0.2,
    600,
)  # metres between heights; heights along a side at most, then the step is larger
LONGEST, OCTAVES, WAVES = 4.8, 4, 16
HURST = 0.7
BEYOND, FADE = 6.0, 4.0  # metres beyond the field that are rough, the last of them ever less


def roughened(ground: GroundSurface, forest: Forest, roughness: float, seed: int) -> GroundSurface:
    """The ground with bumps; of 0, as it is.

    roughness : metres between the lower and the higher ground, four standard deviations.

    Raises
    ------
    SpecError : the ground is a surface of triangles.
    """
    if roughness <= 0:
        return ground
    if isinstance(ground, Heightmap):
        low, high = ground.grid.low, ground.grid.high
    elif isinstance(ground, Flat):
        beyond = min(BEYOND, forest.margin)
        low = np.array(forest.origin, dtype=float) - beyond
        high = np.array(forest.origin, dtype=float) + np.array(forest.size) + beyond
    else:
        raise SpecError(
            "forest.terrain.roughness",
            "needs level ground or a heightmap; model the roughness of a surface in its triangles, or give 0",
        )
    span = high - low
    count = np.clip(np.ceil(span / STEP).astype(int), 2, MOST)
    x, y = (low[k] + (np.arange(count[k]) + 0.5) * span[k] / count[k] for k in range(2))
    y = y[::-1]
    place = np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x))])
    base = ground.height(place).reshape(len(y), len(x))
    bumps = _bumps(x, y, seed)
    inner_low, inner_high = np.array(forest.origin), np.array(forest.origin) + np.array(forest.size)
    fade = np.ones_like(bumps)
    for axis, along in ((1, x), (0, y)):
        k = 1 - axis
        away = np.maximum(np.maximum(inner_low[k] - along, along - inner_high[k]), 0)
        fall = np.clip(1 - away / FADE, 0, 1)
        fade *= fall[None, :] if axis == 1 else fall[:, None]
    heights = base + roughness / 4 * bumps * fade
    return Heightmap(heights, low, span, "rough ground")


def _bumps(x: np.ndarray, y: np.ndarray, seed: int) -> np.ndarray:
    """(Y, X) heights of standard deviation 1 at places x (X,) and y (Y,)."""
    rng = stream(seed, "rough ground")
    total = np.zeros((len(y), len(x)))
    for octave in range(OCTAVES):
        length = LONGEST / 2**octave
        turn, phase = 2 * np.pi * rng.random((2, WAVES))
        wide = length * (0.7 + 0.6 * rng.random(WAVES))
        for a, p, w in zip(turn, phase, wide, strict=True):
            kx, ky = 2 * np.pi / w * np.cos(a), 2 * np.pi / w * np.sin(a)
            wave = np.exp(1j * (kx * x + p))[None, :] * np.exp(1j * ky * y)[:, None]
            total += (0.5**octave) ** HURST * wave.real
    power = sum(0.5 ** (2 * HURST * octave) for octave in range(OCTAVES)) * WAVES / 2
    return np.asarray(total / np.sqrt(power))
