"""Height, crown and leaf area of trees from the diameters of their stems, each with residuals of its own.

log y = a + b·x + c·x², x = log(D/0.2 m), plus a residual that is normal on either side of 0 with its own
spread, so that it goes through the 5, 50 and 95 % points of the measured ones; a law goes on straight
beyond the diameters that were measured. Of the crown base y is base/(height - base), so that a crown always
has a length. Residuals of a tree are correlated as measured (a Gaussian copula), cut at 1.9 standard
deviations; what is known of a tree counts for what is drawn of it (conditional normal).
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

from ...spec import Allometry, Law
from ...spec.allometry import DBH

MEASURES = ("height", "crown_width", "crown_base", "leaf_area")  # columns, in this order
Z90 = 1.6448536269514722  # 90 % of a normal lie within ± this
LIMIT = 1.9  # standard deviations at which residuals are cut
PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def middle(law: Law, dbh: np.ndarray) -> np.ndarray:
    """(N,) log y that half the trees of these diameters (N,), metres, lie below."""
    x = np.log(np.asarray(dbh, dtype=float) / DBH)
    inside = np.clip(x, *np.log(np.array(law.dbh) / DBH))
    slope = law.slope + 2 * law.curve * inside
    return np.asarray(
        law.intercept + law.slope * inside + law.curve * inside**2 + slope * (x - inside)
    )


def band(kind: Allometry, dbh: np.ndarray) -> np.ndarray:
    """(2, N, 4) what 5 % of measured trees of these diameters (N,) lie below, and above, in ``MEASURES``.

    The crown's base is that of a tree of the law's own height.
    """
    z = np.full((len(dbh), 4), Z90)
    high = measures(kind, dbh, z * [0, 1, 1, 1])
    low = measures(kind, dbh, -z * [0, 1, 1, 1])
    high[:, 0], low[:, 0] = measures(kind, dbh, z)[:, 0], measures(kind, dbh, -z)[:, 0]
    return np.stack([low, high])


def measures(kind: Allometry, dbh: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(N, 4) the measures of trees of these diameters (N,) with normal scores (N, 4)."""
    found = np.empty(z.shape)
    for column, name in enumerate(MEASURES):
        law: Law = getattr(kind, name)
        found[:, column] = np.exp(middle(law, dbh) + _residual(law, z[:, column]))
    found[:, 2] *= found[:, 0] / (1 + found[:, 2])
    return found


def scores(kind: Allometry, dbh: np.ndarray, given: np.ndarray) -> np.ndarray:
    """(N, 4) normal scores of what is given (N, 4) of trees of these diameters; NaN stays NaN.

    The crown's base needs a height; where that is not given either, the law's counts.
    """
    height = np.where(np.isfinite(given[:, 0]), given[:, 0], np.exp(middle(kind.height, dbh)))
    found = np.full(given.shape, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        for column, name in enumerate(MEASURES):
            law: Law = getattr(kind, name)
            value = given[:, column]
            if name == "crown_base":
                value = value / (height - value)
            residual = np.log(value) - middle(law, dbh)
            found[:, column] = Z90 * np.where(
                residual < 0, -residual / law.low, residual / law.high
            )
    return found


def draw(
    kind: Allometry,
    dbh: np.ndarray,
    given: np.ndarray,
    uniform: np.ndarray,
    stand: np.ndarray | None = None,
) -> np.ndarray:
    """(N, 4) the measures of trees: those given (N, 4) as they are, the others, NaN, drawn.

    uniform : (N, 4) numbers between 0 and 1, from the stream of each tree. stand : (4,) normals that
    the trees of a stand share, by which they differ as studies do (``Law.within``); None: of many stands.
    """
    known = np.isfinite(given)
    z = np.clip(scores(kind, dbh, given), -4, 4)
    noise = ndtri(uniform)
    own = np.array([getattr(kind, name).within for name in MEASURES])
    matrix = correlation_matrix(kind)
    for pattern in np.unique(known, axis=0):
        rows = np.flatnonzero((known == pattern).all(axis=1))
        told, free = np.flatnonzero(pattern), np.flatnonzero(~pattern)
        if not len(free):
            continue
        inner, across = matrix[np.ix_(told, told)], matrix[np.ix_(free, told)]
        weight = across @ np.linalg.pinv(inner)
        left = matrix[np.ix_(free, free)] - weight @ across.T
        value, vector = np.linalg.eigh(left)
        # The symmetric root: noise of a measure stays that measure's (competition is in it), whatever
        # signs and order the eigenvectors come in.
        root = (vector * np.sqrt(np.maximum(value, 0.0))) @ vector.T
        drawn = noise[np.ix_(rows, free)] @ root.T
        if stand is not None:
            drawn = own[free] * drawn + np.sqrt(1 - own[free] ** 2) * (root @ stand[free])
        z[np.ix_(rows, free)] = _cut(z[np.ix_(rows, told)] @ weight.T + drawn)
    found = measures(kind, dbh, z)
    share = found[:, 2] / found[:, 0]
    found = np.where(known, given, found)
    base = share * found[:, 0]  # of the height that the tree has
    found[:, 2] = np.where(known[:, 2], given[:, 2], base)
    return found


def correlation_matrix(kind: Allometry) -> np.ndarray:
    """(4, 4) correlation of residuals, the nearest that numbers of several tables allow."""
    matrix = np.eye(4)
    for (a, b), value in zip(PAIRS, kind.correlation, strict=True):
        matrix[a, b] = matrix[b, a] = value
    values, vectors = np.linalg.eigh(matrix)
    matrix = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    size = np.sqrt(np.diag(matrix))
    return np.asarray(matrix / np.outer(size, size))


def _residual(law: Law, z: np.ndarray) -> np.ndarray:
    return np.asarray(np.where(z < 0, -law.low, law.high) * z / Z90)


def _cut(z: np.ndarray) -> np.ndarray:
    """Normals to normals within ±``LIMIT``, by inversion."""
    low, high = ndtr(-LIMIT), ndtr(LIMIT)
    return np.asarray(ndtri(low + (high - low) * ndtr(z)))
