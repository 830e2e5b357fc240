"""Stem labels of one tree's cloud, by circles fitted to layers of it and followed upwards from the ground.

Each circle is found by random sampling near the one below (Fischler & Bolles 1981, RANSAC), then fitted to
its own points by least squares, outliers counting less. A circle that strays from its neighbours takes their
median. Above the first metre and a half in which no circle fits, nothing is labelled: what stem there is
cannot be told from branches by a circle, so those heights do not count in any score.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import least_squares

from forest_addon.base.rng import stream

LAYER = 0.2  # metres, height of a layer
TRIES = 400  # circles drawn in a layer
CLOSE = 0.012  # metres from the circle within which a point is one of its own while it is sought
THICK = (
    0.03  # metres from the circle within which a point is stem: bark, lean within a layer, noise
)
SMALLEST, LARGEST = 0.05, 0.6  # metres, radii
FEWEST = 20  # points on a circle
AROUND = 0.35  # share of the circle's circumference that has points, at least
FLARE = 1.3  # times the median radius of the lowest circles: more is undergrowth or a root, not the stem
LOST = 1.5  # metres without a circle after which the stem is lost


@dataclass(frozen=True)
class Stem:
    """Circles of a stem: height (K,), centre (K, 2), radius (K,), metres; ``top``: up to where they hold."""

    height: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    top: float

    def at(self, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(P, 2) centres and (P,) radii at heights (P,)."""
        x, y = (np.interp(height, self.height, axis) for axis in self.centre.T)
        return np.stack([x, y], axis=1), np.interp(height, self.height, self.radius)

    def holds(self, points: np.ndarray, height: np.ndarray) -> np.ndarray:
        """(P,) whether points are on the stem, or within it."""
        centre, radius = self.at(height)
        away = np.linalg.norm(points[:, :2] - centre, axis=1)
        return np.asarray((away < radius + THICK) & (height < self.top))


def follow_stem(points: np.ndarray, height: np.ndarray, seed: int = 0) -> Stem | None:
    """The stem of the tree that stands nearest to the middle of a cloud; None where no circle fits.

    points : (P, 3) metres. height : (P,) metres above the ground.
    """
    rng = stream(seed, "circles")
    rows, last, misses = [], None, 0
    layers = np.arange(0.3, height.max(), LAYER)
    for low in layers:
        mine = points[(height >= low) & (height < low + LAYER), :2]
        if last is not None:
            mine = mine[np.linalg.norm(mine - last[:2], axis=1) < last[2] + 0.15]
        circle = _circle(mine, last, rng)
        if circle is None:
            misses += last is not None
            if misses * LAYER > LOST:
                break
            continue
        rows.append((low + LAYER / 2, *circle))
        last, misses = np.array(circle), 0
    if len(rows) < 5:
        return None
    found = np.array(rows)
    found = found[found[:, 3] < FLARE * np.median(found[:10, 3])]
    smooth = np.stack([median_filter(axis, 5, mode="nearest") for axis in found[:, 1:].T], axis=1)
    return Stem(found[:, 0], smooth[:, :2], smooth[:, 2], float(found[-1, 0] + LAYER / 2))


def _circle(
    points: np.ndarray, last: np.ndarray | None, rng: np.random.Generator
) -> tuple[float, float, float] | None:
    """Centre and radius of the circle that most points of a layer (N, 2) are on; None: none is good."""
    if len(points) < FEWEST:
        return None
    first = points[rng.integers(len(points), size=TRIES)]
    pick = points[rng.integers(len(points), size=(TRIES, 2))]
    x, y, r = _through(first, pick[:, 0], pick[:, 1])
    good = np.isfinite(r) & (r > SMALLEST) & (r < LARGEST)
    if last is not None:
        good &= (
            (np.hypot(x - last[0], y - last[1]) < 0.08) & (r < 1.1 * last[2]) & (r > 0.7 * last[2])
        )
    if not good.any():
        return None
    x, y, r = x[good], y[good], r[good]
    away = np.hypot(points[:, None, 0] - x, points[:, None, 1] - y) - r
    score = (np.abs(away) < CLOSE).sum(axis=0) - 2.0 * (away < -3 * CLOSE).sum(axis=0)
    best = int(np.argmax(score))
    own = np.abs(away[:, best]) < 2 * CLOSE
    if own.sum() < FEWEST:
        return None
    fitted = least_squares(
        lambda v: np.hypot(points[own, 0] - v[0], points[own, 1] - v[1]) - v[2],
        (x[best], y[best], r[best]),
        loss="soft_l1",
        f_scale=0.01,
    ).x
    turn = np.arctan2(points[own, 1] - fitted[1], points[own, 0] - fitted[0])
    covered = len(np.unique(np.floor(turn / (np.pi / 18)))) / 36
    near = np.hypot(points[:, 0] - fitted[0], points[:, 1] - fitted[1]) < fitted[2] - 3 * CLOSE
    if covered < AROUND or near.sum() > 0.25 * own.sum():
        return None
    return float(fitted[0]), float(fitted[1]), float(fitted[2])


def _through(
    a: np.ndarray, b: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres and radii of circles through three points each (N, 2); infinite where they are on a line."""
    u, v = b - a, c - a
    cross = 2 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (v[:, 1] * (u**2).sum(1) - u[:, 1] * (v**2).sum(1)) / cross
        y = (u[:, 0] * (v**2).sum(1) - v[:, 0] * (u**2).sum(1)) / cross
    return a[:, 0] + x, a[:, 1] + y, np.hypot(x, y)
