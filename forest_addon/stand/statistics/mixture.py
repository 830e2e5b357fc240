"""Maximum-likelihood Gaussian mixture of an inhomogeneous Poisson process seen through a window.

λ(s) = base + Σ C·exp(-(x-a)²/h² - (y-b)²/l²), Tanveer et al.'s squared form, maximises Σ log λ(x_i) - ∫_W
λ. A hill is followed by N, the trees that it puts *within* the window W, so that what it would put
outside, unseen, does not pull its centre inwards (a truncated mixture; Lee & Scott 2012). Mass and
derivatives over W are closed (``Window.gaussian_moments``); L-BFGS climbs. Hills are added one by one
where trees are most in excess of the fit, without any draw, and their number has the smallest BIC, -2 log
L + p log n.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy
from scipy.optimize import minimize
from scipy.spatial import cKDTree

from ...base.rng import stream
from ...base.vectors import column
from .window import Window

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
        value = np.full(len(points), self.base)
        for peak, centre, width in zip(self.peak, self.centre, self.width, strict=True):
            value += peak * np.exp(-(((points - centre) / width) ** 2).sum(axis=1))
        return np.where(self.window.contains(points), value, 0.0)


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
    start = data.fit_of(mixture)
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
        return _Data(window, unit, middle, side, scaled, _features(scaled), _narrowest(scaled))

    def sketch(self) -> _Data:
        """Itself, or a part that is fast to fit and the same for the same points."""
        if len(self.points) <= SKETCH:
            return self
        chosen = stream(0, "mixture sketch").permutation(len(self.points))[:SKETCH]
        return replace(self, points=self.points[chosen], features=self.features[chosen])

    def bic(self, fit: _Fit) -> float:
        return -2 * fit.score + fit.parameters * float(np.log(max(len(self.points), 1)))

    def fit_of(self, mixture: FittedMixture) -> _Fit:
        deviation = mixture.width / np.sqrt(2)
        mass = self.window.gaussian_moments(mixture.centre, deviation)[0]
        trees = mixture.peak * np.pi * mixture.width.prod(axis=1) * mass
        hill = np.column_stack(
            [
                np.log(np.maximum(trees, 1e-3)),
                (mixture.centre - self.middle) / self.side,
                np.log(deviation / self.side),
            ]
        )
        return _Fit(mixture.base * self.window.area, hill, mixture.log_likelihood)

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
        found = minimize(
            lambda theta: self._loss(theta, based),
            np.clip(first, low, high),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": iterations, "ftol": 1e-10, "gtol": 1e-6, "maxcor": 20},
        )
        base = float(np.exp(found.x[0])) if based else 0.0
        # At a maximum ∫λ = n; setting it so only removes what the last step left.
        fit = _Fit(base, found.x[based:].reshape(-1, 5), 0.0).scaled(count)
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
    sketch, current, risen = data.sketch(), best, 0
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
    x, y = (unit.low[k] + (np.arange(n) + 0.5) * cell[k] for k, n in enumerate((columns, rows)))
    middle = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    law = _density(fit, unit, middle).reshape(rows, columns) * unit.coverage((rows, columns))
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


def _density(fit: _Fit, unit: Window, points: np.ndarray) -> np.ndarray:
    deviation = np.exp(fit.hill[:, 3:].copy())
    mass = np.maximum(unit.gaussian_moments(fit.hill[:, 1:3], deviation)[0], 1e-12)
    peak = fit.hill[:, 0] - np.log(2 * np.pi * mass) - fit.hill[:, 3:].sum(axis=1)
    terms = np.exp(_features(points) @ _quadratic(peak, fit.hill[:, 1:3], deviation))
    density: np.ndarray = fit.base / unit.area + terms.sum(axis=1)
    return density


def _narrowest(points: np.ndarray) -> float:
    places = np.unique(points, axis=0)
    if len(places) < 2:
        return NARROWEST
    nearest = cKDTree(places).query(places, k=2)[0][:, 1]
    return float(np.clip(np.quantile(nearest, CROWDED) / 2, NARROWEST, 0.1))


def _features(points: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(points)), points, points**2])


def _quadratic(peak: np.ndarray, centre: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """(5, G) coefficients of log(hill) in 1, x, y, x², y²."""
    precision = deviation**-2
    constant = peak - (centre**2 * precision).sum(axis=1) / 2
    return np.vstack([constant, (centre * precision).T, -precision.T / 2])
