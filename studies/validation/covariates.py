"""An intensity from rasters of covariates: log λ(x) = b₀ + Σ b_k z_k(x), by maximum likelihood.

Trees are counted in the pixels of the covariates, and λ is even within one: Poisson regression, solved by
Newton's steps (Berman & Turner 1992 with pixels as quadrature). Rows of rasters go from south to north.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..inside import Window

STEPS = 50
DONE = 1e-10


@dataclass(frozen=True)
class LogLinear:
    """coefficient, error : (K + 1,) b and standard errors, by a Poisson process's information.

    pixels : (rows, columns) λ, trees/m², row 0 in the south.
    """

    coefficient: np.ndarray
    error: np.ndarray
    pixels: np.ndarray
    window: Window

    def at(self, points: np.ndarray) -> np.ndarray:
        """λ (N,) at points (N, 2): that of their pixel."""
        return np.asarray(self.pixels[_pixel(points, self.window, self.pixels.shape)])


def fit_covariates(points: np.ndarray, covariates: np.ndarray, window: Window) -> LogLinear:
    """λ of points (N, 2) from covariates (K, rows, columns) over the whole rectangle of the window.

    Raises
    ------
    ValueError : covariates that say the same, or one that is the same everywhere.
    """
    number, *shape = covariates.shape
    z = covariates.reshape(number, -1)
    middle, spread = z.mean(axis=1), z.std(axis=1)
    design = np.vstack([np.ones(z.shape[1]), (z - middle[:, None]) / spread[:, None]])
    if not np.isfinite(design).all() or np.linalg.matrix_rank(design @ design.T) <= number:
        raise ValueError(
            "the covariates do not differ from each other or from a constant; drop one"
        )
    row, column = _pixel(points, window, tuple(shape))
    count = np.bincount(row * shape[1] + column, minlength=z.shape[1])
    area = window.area / z.shape[1]
    b = np.zeros(number + 1)
    b[0] = np.log(max(len(points), 1) / window.area)
    for _ in range(STEPS):
        mean = area * np.exp(design.T @ b)
        information = (design * mean) @ design.T
        step = np.linalg.solve(information, design @ (count - mean))
        b += np.clip(step, -1, 1)
        if np.abs(step).max() < DONE:
            break
    error = np.sqrt(np.diag(np.linalg.inv(information)))
    pixels = np.exp(design.T @ b).reshape(shape)
    slope = b[1:] / spread
    return LogLinear(
        coefficient=np.concatenate([[b[0] - slope @ middle], slope]),
        error=np.concatenate([[error[0]], error[1:] / spread]),
        pixels=pixels,
        window=window,
    )


def _pixel(
    points: np.ndarray, window: Window, shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = shape
    place = ((points - window.low) / window.extent * [columns, rows]).astype(int)
    column, row = np.clip(place, 0, [columns - 1, rows - 1]).T
    return row, column
