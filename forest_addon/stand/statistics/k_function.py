"""Do trees stand as their intensity says? The inhomogeneous K and L functions, and the quadrat test.

K(r) counts, about a tree, the others within r, each weighted by 1/λ: for a Poisson process with that λ it
is πr², more where trees keep company, less where they keep apart (Baddeley, Møller & Waagepetersen 2000,
eq. 2). Pairs that the window cannot show are made up for by translation: a pair x_i, x_j counts
1/|W ∩ (W + x_j - x_i)|, which is unbiased. L(r) = √(K/π) has a steadier variance and is r for Poisson.

A tree counts 1/λ in the inhomogeneous K function, so a few trees far out on a hill would outweigh all
others. Pairs are therefore counted within a region where λ is not small, by Kaneko & Gamper's own
definition with that region as the window.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy
from scipy.spatial import cKDTree
from scipy.special import chdtr, chdtrc

from .intensity import Window, overlaps

BLOCK = 16384  # trees whose neighbours are held at once
NEIGHBOURS = 50  # of a tree, on average, within the largest radius that is chosen by itself
STEPS = 60  # radii that are chosen by themselves
FEWEST = 5.0  # expected trees of a quadrat; those with fewer are pooled (Cochran)
FINE = 512  # points along the longer side by which λ is integrated over quadrats

At = Callable[[np.ndarray], np.ndarray]  # λ (N,) at points (N, 2)


class Extent(Protocol):
    """A window as pairs see it."""

    @property
    def area(self) -> float: ...

    @property
    def extent(self) -> np.ndarray: ...

    def set_covariance(self, shift: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True)
class KFunction:
    """radius : (R,) metres. value : (R,) K in m². pairs : how many were counted."""

    radius: np.ndarray
    value: np.ndarray
    pairs: int

    @property
    def l_function(self) -> np.ndarray:
        """(R,) L = √(K/π), metres."""
        root: np.ndarray = np.sqrt(np.maximum(self.value, 0) / np.pi)
        return root


@dataclass(frozen=True)
class QuadratTest:
    """Pearson's X² of counts against what λ, scaled to the number of trees, expects.

    count, expected : (rows, columns), row 0 in the south. classes : quadrats, those pooled as one.
    p_value : two-sided; small too when the counts are more even than chance. NaN with one class.
    """

    count: np.ndarray
    expected: np.ndarray
    statistic: float
    classes: int
    p_value: float


def inhomogeneous_k(
    points: np.ndarray,
    intensity: np.ndarray,
    window: Extent,
    radius: np.ndarray,
    *,
    renormalise: bool = True,
) -> KFunction:
    """K at radii (R,), rising, from points (N, 2) with λ (N,) at each; use leave-one-out λ if estimated.

    renormalise : divide by Σ_{i≠j} 1/(λ_i λ_j), whose mean is |W|², in place of |W|²: a factor in λ no
    longer matters, and K varies less. Its bias is of the order of 1/n.

    Raises
    ------
    ValueError : λ is not positive at a tree; fewer than two trees.
    """
    if len(points) < 2:
        raise ValueError(f"K needs at least 2 trees, there are {len(points)}")
    if not (np.isfinite(intensity) & (intensity > 0)).all():
        where = points[int(np.argmin(np.where(intensity > 0, np.inf, 0)))]
        raise ValueError(
            f"the intensity is not positive at the tree at ({where[0]:g}, {where[1]:g}); "
            "K needs one that is"
        )
    total, pairs = np.zeros(len(radius)), 0
    weight = 1 / intensity
    for i, j in _near_pairs(points, float(radius[-1])):
        shift = points[j] - points[i]
        distance = np.hypot(shift[:, 0], shift[:, 1])
        step = np.searchsorted(radius, distance)  # the first radius that reaches it
        share = 2 * weight[i] * weight[j] / window.set_covariance(shift)
        near = step < len(radius)
        total += np.bincount(step[near], share[near], minlength=len(radius))
        pairs += int(near.sum())
    value = np.cumsum(total)
    if renormalise:
        value *= window.area**2 / (weight.sum() ** 2 - (weight**2).sum())
    return KFunction(radius, value, pairs)


def choose_radii(points: np.ndarray, window: Extent) -> np.ndarray:
    """(``STEPS``,) radii up to a quarter of the shorter side, or to where a tree has ``NEIGHBOURS``."""
    even = np.sqrt(NEIGHBOURS * window.area / (np.pi * max(len(points), 1)))
    largest = min(float(window.extent.min()) / 4, float(np.sqrt(window.area)) / 4, float(even))
    tree = cKDTree(points - points[:1])
    some = tree.data[:: max(1, len(points) // 2000)]
    while len(some) and largest > 1e-6 * window.extent.max():  # less where trees crowd
        if tree.query_ball_point(some, largest, return_length=True).mean() <= NEIGHBOURS + 1:
            break
        largest /= np.sqrt(2)
    return np.linspace(largest / STEPS, largest, STEPS)


def quadrat_test(points: np.ndarray, expected: np.ndarray, window: Window) -> QuadratTest:
    """Test the counts of points (N, 2) in quadrats of equal size against ∫λ over each (rows, columns),
    as ``integrate_by_quadrat`` gives it.
    """
    expected = expected * (len(points) / max(float(expected.sum()), 1e-300))
    rows, columns = expected.shape
    place = ((points - window.low) / window.extent * [columns, rows]).astype(int)
    place = np.minimum(place, [columns - 1, rows - 1])
    number = place[:, 1] * columns + place[:, 0]
    count = np.bincount(number, minlength=rows * columns)
    have, want = _pool(count, expected.ravel())
    statistic = float(((have - want) ** 2 / want).sum())
    above, below = chdtrc(len(want) - 1, statistic), chdtr(len(want) - 1, statistic)
    p_value = 2 * min(above, below) if len(want) > 1 else float("nan")
    return QuadratTest(count.reshape(rows, columns), expected, statistic, len(want), float(p_value))


def choose_quadrats(count: int, window: Window) -> tuple[int, int]:
    """Rows and columns of quadrats, so many that each has ten of ``count`` trees, up to 20 along a side."""
    longest = float(window.extent.max())
    across = np.sqrt(count / 10 * longest**2 / float(np.prod(window.extent)))
    shape = np.maximum(np.rint(np.clip(across, 1, 20) * window.extent / longest), 1).astype(int)
    return int(shape[1]), int(shape[0])


def integrate_by_quadrat(at: At, window: Window, shape: tuple[int, int]) -> np.ndarray:
    """(rows, columns) ∫λ over the part of each quadrat that lies in the window, by the midpoint rule."""
    rows, columns = shape
    fine = int(np.ceil(FINE / max(shape)))
    cell = window.extent / [columns * fine, rows * fine]
    x = window.low[0] + (np.arange(columns * fine) + 0.5) * cell[0]
    y = window.low[1] + (np.arange(rows * fine) + 0.5) * cell[1]
    middle = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    cover = window.coverage((rows * fine, columns * fine))
    mass = at(middle).reshape(cover.shape) * cover * cell.prod()
    blocks: np.ndarray = mass.reshape(rows, fine, columns, fine).sum(axis=(1, 3))
    return blocks


def _near_pairs(points: np.ndarray, reach: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Every pair nearer than ``reach`` once, as two arrays of point numbers, block by block along x."""
    order = np.argsort(points[:, 0], kind="stable")
    sorted_points = points[order] - points[order[0]]  # far from 0 (UTM), digits stay
    for first in range(0, len(points), BLOCK):
        block = min(BLOCK, len(points) - first)
        end = sorted_points[first + block - 1, 0] + reach
        stop = int(np.searchsorted(sorted_points[:, 0], end, side="right"))
        tree = cKDTree(sorted_points[first:stop])
        pairs = tree.query_pairs(reach, output_type="ndarray")
        pairs = pairs[pairs[:, 0] < block]  # a pair of later trees comes with their own block
        yield order[first + pairs[:, 0]], order[first + pairs[:, 1]]


def _pool(count: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts and expectations of classes: quadrats that expect few trees are put together, in the order
    of what they expect, so that each class expects at least ``FEWEST``."""
    order = np.argsort(expected, kind="stable")
    have, want = count[order].astype(float), expected[order]
    few = int(np.searchsorted(want, FEWEST))
    group = (np.cumsum(want[:few]) / FEWEST).astype(int)
    label = np.concatenate([group, np.arange(few, len(want)) + len(want)])
    _, label = np.unique(label, return_inverse=True)
    have, want = np.bincount(label, have), np.bincount(label, want)
    while len(want) > 1 and want.min() < FEWEST:  # a rest joins the class beside it
        rest = int(np.argmin(want))
        other = rest + 1 if rest + 1 < len(want) else rest - 1
        have[other] += have[rest]
        want[other] += want[rest]
        have, want = np.delete(have, rest), np.delete(want, rest)
    return have, want


PIXELS = 256  # along the longer side of the window
SMALLEST = 0.1  # λ within the region, over the mean of λ over trees


@dataclass(frozen=True)
class Region:
    """filled : (rows, columns) bool, pixels that belong, row 0 in the south. low, cell : (2,) metres."""

    filled: np.ndarray
    low: np.ndarray
    cell: np.ndarray

    @property
    def area(self) -> float:
        """m²."""
        return float(self.filled.sum() * self.cell.prod())

    @property
    def extent(self) -> np.ndarray:
        """(2,) sides of its bounding box, metres."""
        rows, columns = (np.flatnonzero(self.filled.any(axis=k)) for k in (1, 0))
        span = np.array([np.ptp(columns) + 1, np.ptp(rows) + 1])
        return np.asarray(span * self.cell)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """(N,) bool of points (N, 2) within the window's bounding box."""
        rows, columns = self.filled.shape
        place = ((points - self.low) / self.cell).astype(int)
        x, y = np.clip(place, 0, [columns - 1, rows - 1]).T
        return np.asarray(self.filled[y, x])

    def set_covariance(self, shift: np.ndarray) -> np.ndarray:
        """(N,) area that it shares with itself moved by shift (N, 2), m²; exact, as between whole pixels
        the overlap of pixels is bilinear."""
        middle = np.array(self._overlaps.shape) // 2
        at = shift[:, ::-1] / self.cell[::-1] + middle
        read: np.ndarray = scipy.ndimage.map_coordinates(
            self._overlaps, at.T, order=1, mode="constant"
        )
        return read

    @cached_property
    def _overlaps(self) -> np.ndarray:
        return np.pad(np.rint(overlaps(self.filled)) * self.cell.prod(), 1)


def region_of(at: At, window: Window) -> Region:
    """The pixels wholly within a window where λ is at least a tenth of its mean over trees."""
    columns, rows = np.maximum(np.ceil(PIXELS * window.extent / window.extent.max()), 4).astype(int)
    cell = window.extent / [columns, rows]
    x, y = (window.low[k] + (np.arange(n) + 0.5) * cell[k] for k, n in enumerate((columns, rows)))
    value = at(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(rows, columns)
    value = value * (window.coverage((rows, columns)) > 1 - 1e-9)
    mean = float((value**2).sum() / max(value.sum(), 1e-300))
    return Region((value > 0) & (value >= SMALLEST * mean), window.low, cell)
