"""The window that trees were mapped in: a polygon, with holes if need be, and what integrals over it need.

A rectangle is a polygon of four corners. Moments of Gaussians over it are closed: the triangle between the
centre and a piece of an edge at distance d, from its foot to t, holds atan(t/d)/2π - T(d, t/d) of a
standard normal (Owen's T; Owen 1956), and higher moments follow from the divergence theorem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from scipy.special import ndtr, owens_t

from ..intensity.polygon import Polygon

TOUCH = 1e-9  # part of the longer side within which a point is on an edge
TABLE = 1024  # cells along the longer side from which a polygon's set covariance is read


@dataclass(frozen=True)
class Window:
    """A polygon with holes.

    rings : the outline, then its holes; each (V, 2) corners in order, metres, either way round.

    Raises
    ------
    ValueError : a ring with fewer than three corners or without area, edges that cross, a hole outside.
    """

    rings: tuple[np.ndarray, ...]

    def __post_init__(self) -> None:
        if not (self.is_rectangle and self.area > 0):
            self._polygon  # noqa: B018  refuses what is no polygon

    @staticmethod
    def rectangle(low: Sequence[float] | np.ndarray, high: Sequence[float] | np.ndarray) -> Window:
        """The rectangle between two corners."""
        (x0, y0), (x1, y1) = low, high
        return Window((np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float),))

    @staticmethod
    def around(points: np.ndarray) -> Window:
        """The rectangle that points (N, 2) were probably mapped in: their bounding box, widened by
        (n + 1)/(n - 1) about its middle (Ripley & Rasson 1977), at least 1 m wide.
        """
        if not len(points):
            raise ValueError("there are no points to lay a window around; give the window")
        low, high = points.min(axis=0), points.max(axis=0)
        ratio = (len(points) + 1) / max(len(points) - 1, 1)
        half = np.maximum((high - low) / 2 * ratio, 0.5)
        return Window.rectangle((low + high) / 2 - half, (low + high) / 2 + half)

    @cached_property
    def low(self) -> np.ndarray:
        """(2,) smallest x and y."""
        low: np.ndarray = self.rings[0].min(axis=0)
        return low

    @cached_property
    def high(self) -> np.ndarray:
        """(2,) largest x and y."""
        high: np.ndarray = self.rings[0].max(axis=0)
        return high

    @property
    def extent(self) -> np.ndarray:
        """(2,) sides of the bounding box, metres."""
        return self.high - self.low

    @cached_property
    def area(self) -> float:
        """Square metres."""
        start, end = self._edges
        return float((start[:, 0] * end[:, 1] - end[:, 0] * start[:, 1]).sum() / 2)

    @cached_property
    def is_rectangle(self) -> bool:
        """Return whether it fills its bounding box."""
        return bool(abs(self.area - np.prod(self.extent)) <= 1e-12 * self.area)

    @cached_property
    def _polygon(self) -> Polygon:
        return Polygon(self.rings[0], self.rings[1:], "window")

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Starts and ends (E, 2) of all edges, metres from ``low``, the inside on their left."""
        starts, ends = [], []
        for number, ring in enumerate(self.rings):
            corners = ring - self.low
            x, y = corners.T
            left_turning = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) > 0
            if left_turning != (number == 0):
                corners = corners[::-1]
            starts.append(corners)
            ends.append(np.roll(corners, -1, axis=0))
        return np.concatenate(starts), np.concatenate(ends)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """(N,) bool of points (N, 2), inside or on an edge."""
        if self.is_rectangle:
            rectangle: np.ndarray = ((points >= self.low) & (points <= self.high)).all(axis=1)
            return rectangle
        within: np.ndarray = self._polygon.at(points) > 0
        outside = np.flatnonzero(~within)
        start, end = self._edges
        along = end - start
        for edge in range(len(start)):  # corners are often trees
            from_start = points[outside] - self.low - start[edge]
            part = np.clip(from_start @ along[edge] / (along[edge] @ along[edge]), 0, 1)
            away = np.linalg.norm(from_start - part[:, None] * along[edge], axis=1)
            within[outside[away <= TOUCH * self.extent.max()]] = True
        return within

    def gaussian_moments(
        self, centre: np.ndarray, deviation: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mass (G,), first and second moments (G, 2) within the window of normals of independent x, y.

        centre, deviation : (G, 2) means and standard deviations. The moments are those of
        z = (x - centre) / deviation. Absolute error 1e-15 a corner.
        """
        if self.is_rectangle:
            return _moments_over_rectangle(
                (self.low - centre) / deviation, (self.high - centre) / deviation
            )
        start, end = (
            (corner[None] - (centre - self.low)[:, None]) / deviation[:, None]
            for corner in self._edges
        )
        along = end - start
        length = np.linalg.norm(along, axis=2)
        with np.errstate(invalid="ignore", divide="ignore"):
            ux, uy = np.where(length[:, :, None] > 0, along / length[:, :, None], 0.0).transpose(
                2, 0, 1
            )
        distance = start[:, :, 0] * uy - start[:, :, 1] * ux  # of the edge, right of the centre
        first = start[:, :, 0] * ux + start[:, :, 1] * uy
        last = end[:, :, 0] * ux + end[:, :, 1] * uy
        mass = (_triangle(distance, last) - _triangle(distance, first)).sum(axis=1)
        density = np.exp(-(distance**2) / 2) / np.sqrt(2 * np.pi)
        flux = density * (ndtr(last) - ndtr(first))
        drift = density * (_density(first) - _density(last))
        mean = np.stack([-(uy * flux).sum(axis=1), (ux * flux).sum(axis=1)], axis=1)
        square = np.stack(
            [
                mass - (uy * (ux * drift + uy * distance * flux)).sum(axis=1),
                mass + (ux * (uy * drift - ux * distance * flux)).sum(axis=1),
            ],
            axis=1,
        )
        return np.maximum(mass, 0.0), mean, square

    def coverage(self, shape: tuple[int, int]) -> np.ndarray:
        """(rows, columns) share of each cell of the bounding box that lies inside, row 0 in the south.

        Exact along x, by 8 scan lines a row along y.
        """
        rows, columns = shape
        if self.is_rectangle:
            return np.ones(shape)
        lines = 8
        height, width = self.extent[1], self.extent[0] / columns
        y = (np.arange(rows * lines) + 0.5) / (rows * lines) * height
        (x0, y0), (x1, y1) = (corner.T for corner in self._edges)
        line, edge = np.nonzero((y0 <= y[:, None]) != (y1 <= y[:, None]))
        x = x0[edge] + (y[line] - y0[edge]) / (y1 - y0)[edge] * (x1 - x0)[edge]
        # An edge that goes down has the inside on its right in x, one that goes up on its left.
        sign = np.where(y1[edge] < y0[edge], 1.0, -1.0)
        cell = np.clip(x / width, 0, columns)
        column = np.minimum(cell.astype(int), columns - 1)
        share = np.zeros((rows * lines, columns + 1))
        np.add.at(share, (line, column), sign * (column + 1 - cell))
        np.add.at(share, (line, column + 1), sign * (cell - column))
        filled = np.cumsum(share, axis=1)[:, :columns]
        mean: np.ndarray = filled.reshape(rows, lines, columns).mean(axis=1)
        return mean

    def set_covariance(self, shift: np.ndarray) -> np.ndarray:
        """(N,) area of the window that overlaps with itself moved by shift (N, 2), m².

        Closed for a rectangle; else read from a table, to 1e-3 of the area.
        """
        if self.is_rectangle:
            overlap: np.ndarray = np.maximum(self.extent - np.abs(shift), 0.0).prod(axis=1)
            return overlap
        table, cell = self._overlap_table
        middle = (np.array(table.shape) - 1) / 2
        at = shift[:, ::-1] / cell[::-1] + middle
        read: np.ndarray = scipy.ndimage.map_coordinates(table, at.T, order=1, mode="constant")
        return read

    @cached_property
    def _overlap_table(self) -> tuple[np.ndarray, np.ndarray]:
        columns, rows = np.maximum(np.ceil(TABLE * self.extent / self.extent.max()), 16).astype(int)
        cell = self.extent / [columns, rows]
        return overlaps(self.coverage((rows, columns))) * np.prod(cell), cell


def overlaps(image: np.ndarray) -> np.ndarray:
    """(2R - 1, 2C - 1) sums of an image (R, C) times itself moved by whole pixels, unmoved in the middle.

    By numpy's transform: scipy.signal, which has a function for it, takes most of a second to import.
    """
    rows, columns = image.shape
    power = np.abs(np.fft.rfft2(image, (2 * rows, 2 * columns))) ** 2
    found = np.fft.irfft2(power, (2 * rows, 2 * columns))
    return np.roll(found, (rows - 1, columns - 1), axis=(0, 1))[:-1, :-1]


def _moments_over_rectangle(
    low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same between corners (G, 2) in units of z: x and y are independent."""
    mass, below, above = ndtr(high) - ndtr(low), _density(low), _density(high)
    other = mass[:, ::-1]
    return mass.prod(axis=1), (below - above) * other, (mass + low * below - high * above) * other


def _triangle(distance: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Signed mass of a standard normal between its centre and a line, from the line's foot to ``along``."""
    far = np.maximum(np.abs(distance), 1e-300)
    ratio = along / far
    mass = np.arctan2(along, far) / (2 * np.pi) - owens_t(far, ratio)
    signed: np.ndarray = np.sign(distance) * mass
    return signed


def _density(z: np.ndarray) -> np.ndarray:
    density: np.ndarray = np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
    return density
