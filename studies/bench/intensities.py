"""Intensities that the benches of stands sample: four hills or a raster on a square of 300 m.

A file of its own, so that a process that samples one (``cold``) imports no more than that takes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..inside import Intensity, Mixture, RasterIntensity, stream

SIDE = 300.0
CENTRES = np.array([[61.0, 91.0], [62.0, 141.0], [71.0, 221.0], [205.0, 103.0]])  # Wahed et al.'s


class Thinned(Intensity):
    """The same intensity as a stranger, known by its values and bounds alone: it is thinned."""

    def __init__(self, of: Intensity) -> None:
        self.of = of

    def at(self, points: np.ndarray) -> np.ndarray:
        return self.of.at(points)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.of.bounds(low, high)

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float | None:
        return self.of.closed_integral(low, high)


def _hills(sigma: float) -> Mixture:
    return Mixture(np.ones(4), CENTRES, np.full((4, 2), sigma * np.sqrt(2)))


def _raster() -> RasterIntensity:
    """Hills of 44.7 m, in pixels that differ from their neighbours by noise."""
    side = (np.arange(512) + 0.5) * SIDE / 512
    x, y = np.meshgrid(side, side[::-1])
    value = _hills(44.7).at(np.column_stack([x.ravel(), y.ravel()])).reshape(512, 512)
    value *= stream(1, "bench", "raster").uniform(0.5, 1.5, value.shape)
    return RasterIntensity(value, np.zeros(2), np.full(2, SIDE))


KINDS: dict[str, Callable[[], Intensity]] = {
    "wide hills, σ = 44.7 m, by component": lambda: _hills(44.7),
    "narrow hills, σ = 0.5 m, by component": lambda: _hills(0.5),
    "wide hills, thinned": lambda: Thinned(_hills(44.7)),
    "narrow hills, thinned": lambda: Thinned(_hills(0.5)),
    "raster, 512 x 512": _raster,
}
