"""The window that trees were mapped in: a polygon, with holes if need be, and what integrals over it need.

A rectangle is a polygon of four corners. Moments of Gaussians over it are closed: the triangle between the
centre and a piece of an edge at distance d, from its foot to t, holds atan(t/d)/2π - T(d, t/d) of a
standard normal (Owen's T; Owen 1956), and higher moments follow from the divergence theorem.

Kernel estimate of an intensity from a map of trees.

λ(s) = Σ κ_σ(s - x_i) / e(x_i), κ_σ an isotropic normal, e(x) = ∫_W κ_σ(v - x)dv the share of it within the
window: the edge correction of Jones (1993) and Diggle, which keeps ∫_W λ = n. Points are spread linearly on
pixels no wider than σ/4 and filtered, so the time hardly grows with their number. σ maximises the Poisson
likelihood of every tree given the others (likelihood cross-validation; Loader 1999, ch. 5), in which trees
at one place count as one tree, so that double entries do not draw σ to 0.

Maximum-likelihood Gaussian mixture of an inhomogeneous Poisson process seen through a window.

λ(s) = base + Σ C·exp(-(x-a)²/h² - (y-b)²/l²), Tanveer et al.'s squared form, maximises Σ log λ(x_i) - ∫_W
λ. A hill is followed by N, the trees that it puts *within* the window W, so that what it would put
outside, unseen, does not pull its centre inwards (a truncated mixture; Lee & Scott 2012). Mass and
derivatives over W are closed (``Window.gaussian_moments``); L-BFGS climbs. Hills are added one by one
where trees are most in excess of the fit, without any draw, and their number has the smallest BIC, -2 log
L + p log n.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from scipy.optimize import minimize, minimize_scalar
from scipy.spatial import cKDTree
from scipy.special import ndtr, owens_t

from ...base.rng import stream
from ...base.vectors import column
from ..intensity.functions import Mixture, Polygon

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
        return np.asarray(self.rings[0].min(axis=0))

    @cached_property
    def high(self) -> np.ndarray:
        """(2,) largest x and y."""
        return np.asarray(self.rings[0].max(axis=0))

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
            return np.asarray(((points >= self.low) & (points <= self.high)).all(axis=1))
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
            low, high = (self.low - centre) / deviation, (self.high - centre) / deviation
            mass, below, above = ndtr(high) - ndtr(low), _density(low), _density(high)
            other = mass[:, ::-1]  # x and y are independent
            square = (mass + low * below - high * above) * other
            return mass.prod(axis=1), (below - above) * other, square
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
        return np.asarray(filled.reshape(rows, lines, columns).mean(axis=1))

    def middles(self, shape: tuple[int, int]) -> np.ndarray:
        """(rows · columns, 2) middles of the cells of the bounding box, the southern row first."""
        cell = self.extent[::-1] / shape
        y, x = (
            low + (np.arange(count) + 0.5) * step
            for low, count, step in zip(self.low[::-1], shape, cell, strict=True)
        )
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    def set_covariance(self, shift: np.ndarray) -> np.ndarray:
        """(N,) area of the window that overlaps with itself moved by shift (N, 2), m².

        Closed for a rectangle; else read from a table, to 1e-3 of the area.
        """
        if self.is_rectangle:
            return np.asarray(np.maximum(self.extent - np.abs(shift), 0.0).prod(axis=1))
        return overlap_at(*self._overlap_table, shift)

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
    product = np.fft.irfft2(power, (2 * rows, 2 * columns))
    return np.roll(product, (rows - 1, columns - 1), axis=(0, 1))[:-1, :-1]


def overlap_at(table: np.ndarray, cell: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(N,) of a table of ``overlaps``, between whole cells (2,) of x and y, at shifts (N, 2)."""
    at = shift[:, ::-1] / cell[::-1] + (np.array(table.shape) - 1) / 2
    return np.asarray(scipy.ndimage.map_coordinates(table, at.T, order=1, mode="constant"))


def _triangle(distance: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Signed mass of a standard normal between its centre and a line, from the line's foot to ``along``."""
    far = np.maximum(np.abs(distance), 1e-300)
    ratio = along / far
    mass = np.arctan2(along, far) / (2 * np.pi) - owens_t(far, ratio)
    return np.asarray(np.sign(distance) * mass)


def _density(z: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi))


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
    minimum = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 0.02})
    return float(np.exp(minimum.x if minimum.fun < losses[best] else steps[best]))


def _estimate(points: np.ndarray, window: Window, sigma: float) -> KernelEstimate:
    longest = float(window.extent.max())  # pixels at most σ/4 wide, neither coarse nor slow
    along = np.clip(np.ceil(PIXELS_PER_SIGMA * longest / sigma), COARSEST, FINEST)
    columns, rows = np.maximum(np.rint(along * window.extent / longest), 4).astype(int)
    inner = int(rows), int(columns)
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
    return np.asarray(taps / taps.sum())


def _smooth(image: np.ndarray, kernel: list[np.ndarray]) -> np.ndarray:
    for axis, taps in enumerate(kernel):
        image = scipy.ndimage.correlate1d(image, taps, axis=axis, mode="constant")
    return image


MAX_HILLS = 12
TREES_A_HILL = 6  # fewer trees than a hill has parameters say nothing of it
NARROWEST, WIDEST = 1e-4, 10.0  # standard deviation of a hill, in longer sides of the window
CROWDED = 0.05  # share of the trees whose nearest neighbour is taken to be near
OUTSIDE = 2.0  # how far from the window's middle a centre may lie, in longer sides
SKETCH = 4000  # trees from which starting points are judged
REFINING = 60  # steps of a fit that starts from a good one
PIXELS = 64  # of the picture in which an excess of trees is sought
SCALES = (0.03, 0.08, 0.2)  # at which it is, in longer sides


@dataclass(frozen=True)
class FittedMixture:
    """A fitted intensity.

    base : trees/m². peak : (G,) trees/m². centre, width : (G, 2) metres, as in ``spec.Gaussian``.
    window : where the trees were mapped. trees : how many. log_likelihood, bic : of the fit.
    """

    base: float
    peak: np.ndarray
    centre: np.ndarray
    width: np.ndarray
    window: Window
    trees: int
    log_likelihood: float
    bic: float

    @property
    def expected(self) -> float:
        """∫λ over the window."""
        mass = self.window.gaussian_moments(self.centre, self.width / np.sqrt(2))[0]
        hills = self.peak * np.pi * self.width.prod(axis=1) * mass
        return float(self.base * self.window.area + hills.sum())

    def at(self, points: np.ndarray) -> np.ndarray:
        """λ (N,) at points (N, 2); 0 outside the window."""
        hills = Mixture(self.peak, self.centre, self.width).at(points)
        return np.where(self.window.contains(points), self.base + hills, 0.0)


def fit_mixture(points: np.ndarray, window: Window, hills: int | None = None) -> FittedMixture:
    """Fit λ to points (N, 2) in a window, with a given number of hills or that of the smallest BIC.

    Every hill holds at least ``TREES_A_HILL`` trees. The order of the points does not matter.

    Raises
    ------
    ValueError : a point outside the window; more hills asked for than the trees can tell apart.
    """
    if not window.contains(points).all():
        raise ValueError("a tree lies outside the window; leave it out, or widen the window")
    if hills is not None and hills * TREES_A_HILL > len(points):
        raise ValueError(
            f"{hills} hills need at least {hills * TREES_A_HILL} trees, there are {len(points)}; "
            "ask for fewer"
        )
    data = _Data.of(points, window)
    fits = list(_ladder(data, hills))
    if hills is not None:
        fits = [fit for fit in fits if len(fit.hill) == hills]
        if not fits:
            raise ValueError(
                f"{hills} hills of at least {TREES_A_HILL} trees could not be told apart; ask for fewer"
            )
    return data.mixture(min(fits, key=data.bic))


def refit(mixture: FittedMixture, points: np.ndarray) -> FittedMixture:
    """The same mixture fitted to other points (N, 2) in the same window, starting from its hills."""
    data = _Data.of(points, mixture.window)
    if not len(points):
        return data.mixture(_Fit(0.0, np.empty((0, 5)), 0.0))
    deviation = mixture.width / np.sqrt(2)
    mass = data.window.gaussian_moments(mixture.centre, deviation)[0]
    trees = mixture.peak * np.pi * mixture.width.prod(axis=1) * mass
    hill = np.column_stack(
        [
            np.log(np.maximum(trees, 1e-3)),
            (mixture.centre - data.middle) / data.side,
            np.log(deviation / data.side),
        ]
    )
    start = _Fit(mixture.base * data.window.area, hill, mixture.log_likelihood)
    return data.mixture(data.climb(start.scaled(len(points)), REFINING))


@dataclass(frozen=True)
class _Fit:
    """base : trees in the window. hill : (G, 5) log trees in the window, centre x y, log deviation x y,
    in window units. score : log likelihood."""

    base: float
    hill: np.ndarray
    score: float

    @property
    def parameters(self) -> int:
        return int(self.base > 0) + self.hill.size

    def scaled(self, trees: float) -> _Fit:
        """Put that many trees in the window."""
        factor = trees / (self.base + np.exp(column(self.hill, 0)).sum())
        shift = np.array([np.log(factor), 0, 0, 0, 0])
        return _Fit(self.base * factor, self.hill + shift, self.score)


@dataclass(frozen=True)
class _Data:
    """Points in window units (its middle 0, its longer side 1) and their features 1, x, y, x², y².

    narrowest : smallest standard deviation of a hill, half the distance between near neighbours, so that
    no hill settles on one row of an orchard.
    """

    window: Window
    unit: Window
    middle: np.ndarray
    side: float
    points: np.ndarray
    features: np.ndarray
    narrowest: float

    @staticmethod
    def of(points: np.ndarray, window: Window) -> _Data:
        middle, side = (window.low + window.high) / 2, float(window.extent.max())
        unit = Window(tuple((ring - middle) / side for ring in window.rings))
        scaled = (points - middle) / side
        scaled = scaled[np.lexsort(scaled.T)]
        places, narrowest = np.unique(scaled, axis=0), NARROWEST
        if len(places) > 1:
            nearest = cKDTree(places).query(places, k=2)[0][:, 1]
            narrowest = float(np.clip(np.quantile(nearest, CROWDED) / 2, NARROWEST, 0.1))
        return _Data(window, unit, middle, side, scaled, _features(scaled), narrowest)

    def bic(self, fit: _Fit) -> float:
        return -2 * fit.score + fit.parameters * float(np.log(max(len(self.points), 1)))

    def mixture(self, fit: _Fit) -> FittedMixture:
        """A fit in metres. Its likelihood is that of trees per square metre."""
        deviation = np.exp(fit.hill[:, 3:].copy())
        mass = self.unit.gaussian_moments(fit.hill[:, 1:3], deviation)[0]
        width = deviation * np.sqrt(2) * self.side
        scale = 2 * len(self.points) * np.log(self.side)
        return FittedMixture(
            base=fit.base / self.window.area,
            peak=np.exp(column(fit.hill, 0)) / (np.pi * width.prod(axis=1) * mass),
            centre=fit.hill[:, 1:3] * self.side + self.middle,
            width=width,
            window=self.window,
            trees=len(self.points),
            log_likelihood=fit.score - scale,
            bic=self.bic(fit) + 2 * scale,
        )

    def flat(self) -> _Fit:
        """The fit without hills: n/|W| everywhere."""
        count = len(self.points)
        score = count * np.log(count / self.unit.area) - count if count else 0.0
        return _Fit(float(count), np.empty((0, 5)), float(score))

    def climb(self, start: _Fit, iterations: int = 500) -> _Fit:
        """The nearest maximum of the likelihood, with a base if the start has one."""
        count, based = len(self.points), bool(start.base > 0)
        tree_range = (np.log(1e-3), np.log(10.0 * count))
        spread = (np.log(self.narrowest), np.log(WIDEST))
        bounds = [tree_range] * based
        bounds += [tree_range, (-OUTSIDE, OUTSIDE), (-OUTSIDE, OUTSIDE), spread, spread] * len(
            start.hill
        )
        low, high = np.array(bounds).T
        first = np.concatenate([[np.log(start.base)] if based else [], start.hill.ravel()])
        minimum = minimize(
            lambda theta: self._loss(theta, based),
            np.clip(first, low, high),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": iterations, "ftol": 1e-10, "gtol": 1e-6, "maxcor": 20},
        )
        base = float(np.exp(minimum.x[0])) if based else 0.0
        # At a maximum ∫λ = n; setting it so only removes what the last step left.
        fit = _Fit(base, minimum.x[based:].reshape(-1, 5), 0.0).scaled(count)
        theta = np.concatenate([[np.log(fit.base)] if based else [], fit.hill.ravel()])
        return _Fit(fit.base, fit.hill, -self._loss(theta, based)[0] * count)

    def _loss(self, theta: np.ndarray, based: bool) -> tuple[float, np.ndarray]:
        """Minus the log likelihood a tree, and its gradient."""
        count, hill = len(self.points), theta[based:].reshape(-1, 5)
        trees, centre, deviation = np.exp(column(hill, 0)), hill[:, 1:3], np.exp(hill[:, 3:].copy())
        mass, mean, square = self.unit.gaussian_moments(centre, deviation)
        mass = np.maximum(mass, 1e-12)
        peak = hill[:, 0] - np.log(2 * np.pi * mass) - hill[:, 3:].sum(axis=1)
        terms = self.features @ _quadratic(peak, centre, deviation)
        if based:
            terms = np.column_stack([np.full(count, theta[0] - np.log(self.unit.area)), terms])
        top = terms.max(axis=1)
        share = np.exp(terms - top[:, None])
        total = share.sum(axis=1)
        share /= total[:, None]
        inside = trees.sum() + (np.exp(theta[0]) if based else 0.0)
        score = float((top + np.log(total)).sum() - inside)

        sums = share[:, int(based) :].T @ self.features  # (G, 5)
        held, first, second = sums[:, :1], sums[:, 1:3], sums[:, 3:]
        z_mean = (first - centre * held) / deviation
        z_square = (second - 2 * centre * first + centre**2 * held) / deviation**2
        gradient = np.empty_like(hill)
        gradient[:, 0] = held[:, 0] - trees
        gradient[:, 1:3] = (z_mean - held * mean / mass[:, None]) / deviation
        gradient[:, 3:] = z_square - held * square / mass[:, None]
        whole = gradient.ravel()
        if based:
            whole = np.concatenate([[share[:, 0].sum() - np.exp(theta[0])], whole])
        return -score / count, -whole / count


def _ladder(data: _Data, hills: int | None) -> Iterator[_Fit]:
    """Fits with 0, 1, 2, … hills, each with and without a base, until BIC has risen twice."""
    best = data.flat()
    yield best
    most = min(MAX_HILLS if hills is None else hills, len(data.points) // TREES_A_HILL)
    sketch, current, risen = data, best, 0
    if len(data.points) > SKETCH:  # a part that is fast to fit, the same for the same points
        chosen = stream(0, "mixture sketch").permutation(len(data.points))[:SKETCH]
        sketch = replace(data, points=data.points[chosen], features=data.features[chosen])
    for _ in range(most):
        starts = list(_with_another_hill(data, current))
        if not starts:
            return
        tried = [sketch.climb(s.scaled(len(sketch.points)), 100) for s in starts]
        start = max(tried, key=lambda fit: fit.score).scaled(len(data.points))
        current = data.climb(start)
        bare = data.climb(_Fit(0.0, current.hill, 0.0).scaled(len(data.points)))
        if np.exp(column(current.hill, 0)).min() < TREES_A_HILL:
            return
        yield current
        yield bare
        lowest = min(current, bare, key=data.bic)
        risen = 0 if data.bic(lowest) < data.bic(best) else risen + 1
        best = min(best, lowest, key=data.bic)
        if hills is None and risen == 2:
            return


def _with_another_hill(data: _Data, fit: _Fit) -> Iterator[_Fit]:
    """The fit with one hill more, at each scale where trees are most in excess of it."""
    unit = data.unit
    columns, rows = np.maximum(np.rint(PIXELS * unit.extent), 1).astype(int)
    cell = unit.extent / [columns, rows]
    place = np.clip((data.points - unit.low) / cell, 0, [columns - 1, rows - 1]).astype(int)
    number = place[:, 1] * columns + place[:, 0]
    seen = np.bincount(number, minlength=rows * columns).reshape(rows, columns).astype(float)
    middle = unit.middles((rows, columns))
    law = _density_of_mixture(fit, unit, middle).reshape(rows, columns) * unit.coverage(
        (rows, columns)
    )
    law *= len(data.points) / max(law.sum(), 1e-300)
    for scale in SCALES:
        near = (scale / cell)[::-1]
        have, want = (
            scipy.ndimage.gaussian_filter(image, near, mode="constant") * 2 * np.pi * near.prod()
            for image in (seen, law)
        )
        at = middle[int(np.argmax((have - want) / np.sqrt(want + 1)))]
        close = data.points[np.linalg.norm(data.points - at, axis=1) < 1.5 * scale]
        if not len(close):
            continue
        spread = np.clip(np.maximum(close.std(axis=0), 0.1 * scale), data.narrowest, WIDEST)
        trees = np.clip(0.5 * len(close), 1.0, 0.5 * len(data.points))
        hill = np.concatenate([[np.log(trees)], close.mean(axis=0), np.log(spread)])
        yield _Fit(max(fit.base, 1.0), np.vstack([fit.hill, hill]), 0.0)


def _density_of_mixture(fit: _Fit, unit: Window, points: np.ndarray) -> np.ndarray:
    deviation = np.exp(fit.hill[:, 3:].copy())
    mass = np.maximum(unit.gaussian_moments(fit.hill[:, 1:3], deviation)[0], 1e-12)
    peak = fit.hill[:, 0] - np.log(2 * np.pi * mass) - fit.hill[:, 3:].sum(axis=1)
    terms = np.exp(_features(points) @ _quadratic(peak, fit.hill[:, 1:3], deviation))
    return np.asarray(fit.base / unit.area + terms.sum(axis=1))


def _features(points: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(points)), points, points**2])


def _quadratic(peak: np.ndarray, centre: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """(5, G) coefficients of log(hill) in 1, x, y, x², y²."""
    precision = deviation**-2
    constant = peak - (centre**2 * precision).sum(axis=1) / 2
    return np.vstack([constant, (centre * precision).T, -precision.T / 2])
