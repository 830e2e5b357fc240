"""Intensities from what lies on the ground: images, painted meshes, and limits of the terrain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .functions import Intensity, IntensityError, Mask
from .surface import Grid, GroundSurface, IntensitySurface, Pyramid, refuse_pixels


@dataclass(frozen=True)
class Painted:
    """Weights on a mesh, in world coordinates.

    vertices : (V, 3) metres. triangles : (T, 3). weight : (V,), 0 or larger.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    weight: np.ndarray


class RasterIntensity(Intensity):
    """An image with bilinear meaning, zero beyond it.

    Bounds come from a pyramid of its patches, and are exact for cells of up to two patches a side; its
    integral is closed.
    """

    def __init__(
        self, pixels: np.ndarray, low: np.ndarray, size: np.ndarray, name: str = "raster"
    ) -> None:
        """pixels : (rows, columns) trees/m², the first row the north edge.

        Raises
        ------
        IntensityError : a pixel is negative or not finite; says where.
        """
        refuse_pixels(
            ~(np.isfinite(pixels) & (pixels >= 0)), pixels, low, size, name, "0 or larger"
        )
        self.grid = Grid.of_image(pixels, low, size)
        self._ranges = self.grid.value_ranges()

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.where(self.grid.inside(points), self.grid.at(points), 0.0)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first, last = self.grid.patches_of(low, high)
        lower, upper = self._ranges.over(first, last)
        small = ((last - first) <= 1).all(axis=1)
        lower[small], upper[small] = self.grid.exact_range(low[small], high[small])
        lower[((low < self.grid.low) | (high > self.grid.high)).any(axis=1)] = 0.0
        upper[((high < self.grid.low) | (low > self.grid.high)).any(axis=1)] = 0.0
        return lower, upper

    def closed_integral(self, low: np.ndarray, high: np.ndarray) -> float:
        return self.grid.integral(low, high)


class RasterMask(Mask):
    """1 where an image reaches a threshold, 0 elsewhere and beyond it."""

    def __init__(self, raster: RasterIntensity, threshold: float) -> None:
        self.raster, self.threshold = raster, threshold

    def at(self, points: np.ndarray) -> np.ndarray:
        inside = self.raster.grid.inside(points)
        return (inside & (self.raster.at(points) >= self.threshold)).astype(float)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = self.raster.bounds(low, high)
        grid = self.raster.grid
        within = ((low >= grid.low) & (high <= grid.high)).all(axis=1)
        beyond = ((high < grid.low) | (low > grid.high)).any(axis=1)
        # A hair's breadth of the threshold is left undecided: bounds and values round differently.
        room = 1e-9 * max(self.threshold, upper.max(initial=0.0))
        sure = within & (lower >= self.threshold + room)
        maybe = ~beyond & (upper >= self.threshold - room)
        return sure.astype(float), maybe.astype(float)


class PixelMask(Mask):
    """1 on some pixels of a raster, to their edges, 0 on others and beyond."""

    def __init__(self, chosen: np.ndarray, low: np.ndarray, size: np.ndarray) -> None:
        """chosen : (rows, columns) bool, the first row the north edge."""
        self.low, self.step = low, size / chosen.shape[::-1]
        self._chosen = np.pad(chosen[::-1], 1).astype(float)
        self._ranges = Pyramid(self._chosen, self._chosen)

    def _pixel(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) row and column of points (N, 2), in the grid with an edge of zeros."""
        place = np.floor((points - self.low) / self.step + 1)[:, ::-1]
        return np.clip(place, 0, np.array(self._chosen.shape) - 1).astype(np.int64)

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.asarray(self._chosen[tuple(self._pixel(points).T)])

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        inner = np.maximum(high - 1e-9 * self.step, low)  # an edge belongs to the pixel behind it
        return self._ranges.over(self._pixel(low), self._pixel(inner))


class PaintedMesh(Intensity):
    """Weights on a mesh, linear over its triangles as seen from above, zero beside it."""

    def __init__(self, painted: Painted, value: float, name: str = "painted mesh") -> None:
        """value : trees/m² of the ground plan where the weight is 1.

        Raises
        ------
        IntensityError : a weight is negative or not finite, the mesh has no area; says where.
        """
        bad = ~(np.isfinite(painted.weight) & (painted.weight >= 0))
        if bad.any():
            k = int(np.argmax(bad))
            raise IntensityError(
                f"{name}: the weight of vertex {k} at {painted.vertices[k].tolist()} is "
                f"{painted.weight[k]:g}; it must be 0 or larger"
            )
        try:
            self.surface = IntensitySurface(painted.vertices, painted.triangles)
        except ValueError as problem:
            raise IntensityError(f"{name}: {problem}") from None
        self.weight = value * np.asarray(painted.weight, dtype=np.float64)
        corners = self.weight[self.surface.triangles]
        self._ranges = self.surface.ranges(np.zeros(len(corners)), corners.max(axis=1))

    def at(self, points: np.ndarray) -> np.ndarray:
        return np.maximum(np.nan_to_num(self.surface.interpolate(points, self.weight)), 0.0)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        upper = self._ranges.over(*self.surface.bins_of(low, high))[1]
        beyond = ((high < self.surface.low) | (low > self.surface.high)).any(axis=1)
        return np.zeros(len(low)), np.where(beyond, 0.0, np.maximum(upper, 0.0))


class TerrainLimits(Mask):
    """1 where slope and altitude of the ground are within limits, 0 elsewhere and where there is none."""

    def __init__(
        self, terrain: GroundSurface, slope: tuple[float, float], altitude: tuple[float, float]
    ) -> None:
        """slope : radians, lowest and highest. altitude : metres, the same."""
        self.terrain, self.altitude = terrain, altitude
        self.steepness = (np.tan(slope[0]), np.tan(slope[1]) if slope[1] < np.pi / 2 else np.inf)

    def at(self, points: np.ndarray) -> np.ndarray:
        height = self.terrain.height(points)
        steepness = np.linalg.norm(self.terrain.gradient(points), axis=1)
        good = (height >= self.altitude[0]) & (height <= self.altitude[1])
        good &= (steepness >= self.steepness[0]) & (steepness <= self.steepness[1])
        return good.astype(float)

    def bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        upper = np.ones(len(low))
        for limits, (least, most) in (
            (self.altitude, self.terrain.height_bounds(low, high)),
            (self.steepness, self.terrain.steepness_bounds(low, high)),
        ):
            room = 1e-9 * max(1.0, *(abs(limit) for limit in limits if np.isfinite(limit)))
            upper[(most < limits[0] - room) | (least > limits[1] + room)] = 0.0
        return np.zeros(len(low)), upper
