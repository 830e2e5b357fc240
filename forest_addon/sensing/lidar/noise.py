"""Noise of a scanner, drawn for each return by its key: seed, scan, pulse, return.

No draw depends on another, so a scan has the same bytes in any chunks and after any interruption.
"""

from __future__ import annotations

import numpy as np

from ...base.rng import keyed_normal, keyed_uniform
from ...spec import Noise

STEEPEST = 1e3  # tan of the angle of incidence; a surface seen edge on has no end of it


def range_error(
    noise: Noise, distance: np.ndarray, cos_incidence: np.ndarray, keys: np.ndarray
) -> np.ndarray:
    """(E,) metres to add to ranges: normal, of variance a² + (b·R)² + (c·tan θ)²."""
    if not (noise.range_sd or noise.range_ppm or noise.incidence_sd):
        return np.zeros(len(distance))
    cos_incidence = np.nan_to_num(cos_incidence, nan=1.0)  # of what met nothing
    tangent = np.sqrt(np.maximum(1 - cos_incidence**2, 0)) / np.maximum(cos_incidence, 1 / STEEPEST)
    variance = (
        noise.range_sd**2
        + (noise.range_ppm * 1e-6 * distance) ** 2
        + (noise.incidence_sd * tangent) ** 2
    )
    error: np.ndarray = np.sqrt(variance) * keyed_normal(keys, "range")
    return error


def kept(noise: Noise, keys: np.ndarray) -> np.ndarray:
    """(E,) bool: returns that are not lost."""
    if noise.drop_out == 0:
        return np.ones(len(keys), dtype=bool)
    return keyed_uniform(keys, "drop-out") >= noise.drop_out
