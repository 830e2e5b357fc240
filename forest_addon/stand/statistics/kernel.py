"""Kernel estimate of an intensity from a map of trees.

λ(s) = Σ κ_σ(s - x_i) / e(x_i), κ_σ an isotropic normal, e(x) = ∫_W κ_σ(v - x)dv the share of it within the
window: the edge correction of Jones (1993) and Diggle, which keeps ∫_W λ = n. Points are spread linearly on
pixels no wider than σ/4 and filtered, so the time hardly grows with their number. σ maximises the Poisson
likelihood of every tree given the others (likelihood cross-validation; Loader 1999, ch. 5), in which trees
at one place count as one tree, so that double entries do not draw σ to 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from scipy.optimize import minimize_scalar

from .window import Window

FINEST, COARSEST = 2048, 96  # pixels along the longer side
PIXELS_PER_SIGMA = 4.0
STEPS, WORSE = (
    16,
    3,
)  # of the search from the widest to the narrowest kernel; worse ones that end it
REACH = 6.0  # standard deviations at which the kernel ends


@dataclass(frozen=True)
class KernelEstimate:
    """An intensity on pixels.

    value : (rows, columns) trees/m² at the middles of pixels of the window's bounding box and of one ring
    of pixels around it, row 0 in the south.
    bandwidth : σ, metres. window : where the trees were mapped. expected : ∫λ over the window.
    leave_one_out : (N,) λ at every tree from the trees at other places.
    """

    value: np.ndarray
    bandwidth: float
    window: Window
    expected: float
    leave_one_out: np.ndarray

    @property
    def pixels(self) -> np.ndarray:
        """``value`` of the bounding box alone."""
        return self.value[1:-1, 1:-1]

    def at(self, points: np.ndarray) -> np.ndarray:
        """λ (N,) at points (N, 2), bilinear between pixels; 0 outside the window."""
        corner, share, _ = _spread(points, self.window, self.value.shape)
        read = (self.value.ravel()[corner] * share).sum(axis=1)
        return np.where(self.window.contains(points), read, 0.0)


def kernel_estimate(
    points: np.ndarray, window: Window, bandwidth: float | None = None
) -> KernelEstimate:
    """Estimate λ from points (N, 2) in a window; without a bandwidth the data choose it.

    Raises
    ------
    ValueError : no points, a point outside the window, a bandwidth that is not positive.
    """
    if not len(points):
        raise ValueError("a kernel estimate needs at least one tree")
    if not window.contains(points).all():
        raise ValueError("a tree lies outside the window; leave it out, or widen the window")
    if bandwidth is None:
        bandwidth = choose_bandwidth(points, window)
    elif not bandwidth > 0:
        raise ValueError(f"a bandwidth of {bandwidth:g} m cannot be used; give one larger than 0")
    return _estimate(points, window, bandwidth)


def choose_bandwidth(points: np.ndarray, window: Window) -> float:
    """σ in metres that maximises the cross-validated likelihood Σ log λ_{-i}(x_i) - ∫λ.

    With the edge correction ∫λ is always n. Searched from the longer side of the window down, until it
    has become worse over a factor of 3.5 in σ; where trees stand at fewer than two places it is an eighth of
    the shorter side.
    """
    if len(np.unique(points, axis=0)) < 2:
        return float(window.extent.min()) / 8
    longest = float(window.extent.max())
    steps = np.log(np.geomspace(longest, PIXELS_PER_SIGMA * longest / FINEST, STEPS))
    mean = len(points) / window.area

    def loss(log_sigma: float) -> float:
        left = _estimate(points, window, float(np.exp(log_sigma))).leave_one_out
        return -float(np.log(np.maximum(left / mean, 1e-12)).sum())

    losses: list[float] = []
    best = 0
    for step in steps:
        losses.append(loss(step))
        best = int(np.argmin(losses))
        if len(losses) - 1 - best == WORSE:
            break
    high, low = steps[max(best - 1, 0)], steps[min(best + 1, len(steps) - 1)]
    found = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 0.02})
    return float(np.exp(found.x if found.fun < losses[best] else steps[best]))


def _estimate(points: np.ndarray, window: Window, sigma: float) -> KernelEstimate:
    inner = _shape(window, sigma)
    cell = window.extent[::-1] / inner  # along y, along x
    kernel = [_taps(width) for width in sigma / cell]
    cover = np.pad(window.coverage(inner), 1)
    shape = cover.shape
    corner, share, part = _spread(points, window, shape)
    weight = 1 / (_smooth(cover, kernel).ravel()[corner] * share).sum(axis=1)
    mass = np.bincount(corner.ravel(), (share * weight[:, None]).ravel(), minlength=cover.size)
    value = _smooth(mass.reshape(shape), kernel) / cell.prod()
    _, place, trees = np.unique(points, axis=0, return_inverse=True, return_counts=True)
    own = weight * trees[place.ravel()] / cell.prod()
    for axis, taps in enumerate(kernel):
        f = part[:, axis]
        middle = len(taps) // 2
        own = own * ((f**2 + (1 - f) ** 2) * taps[middle] + 2 * f * (1 - f) * taps[middle + 1])
    left = (value.ravel()[corner] * share).sum(axis=1) - own
    expected = float((value * cover).sum() * cell.prod())
    return KernelEstimate(value, sigma, window, expected, np.maximum(left, 0.0))


def _shape(window: Window, sigma: float) -> tuple[int, int]:
    """Rows and columns of pixels at most σ/3 wide, within what is neither coarse nor slow."""
    longest = float(window.extent.max())
    along = np.clip(np.ceil(PIXELS_PER_SIGMA * longest / sigma), COARSEST, FINEST)
    columns, rows = np.maximum(np.rint(along * window.extent / longest), 4).astype(int)
    return int(rows), int(columns)


def _spread(
    points: np.ndarray, window: Window, shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flat number (N, 4) of the pixels about each point, its share (N, 4) in them, and its part (N, 2) of
    the way to the next row and column. ``shape`` counts the ring around the window."""
    rows, columns = shape
    place = ((points - window.low) / window.extent)[:, ::-1] * [rows - 2, columns - 2] + 0.5
    low = np.clip(place.astype(int), 0, [rows - 2, columns - 2])
    part = np.clip(place - low, 0, 1)
    corner = low[:, :1] * columns + low[:, 1:] + np.array([0, 1, columns, columns + 1])
    (down, left), (up, right) = (1 - part).T, part.T
    return corner, np.stack([down * left, down * right, up * left, up * right], axis=1), part


def _taps(width: float) -> np.ndarray:
    """A normal of standard deviation ``width`` pixels, sampled, of sum 1, less the variance of 1/6 that
    points have by being spread linearly."""
    reach = int(np.ceil(REACH * width))
    taps = np.exp(-0.5 * np.arange(-reach, reach + 1) ** 2 / (width**2 - 1 / 6))
    normed: np.ndarray = taps / taps.sum()
    return normed


def _smooth(image: np.ndarray, kernel: list[np.ndarray]) -> np.ndarray:
    for axis, taps in enumerate(kernel):
        image = scipy.ndimage.correlate1d(image, taps, axis=axis, mode="constant")
    return image
