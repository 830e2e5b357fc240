"""Draws from the distributions of a species, by inversion: one uniform number each, never rejection."""

from __future__ import annotations

import numpy as np
import scipy

from ..base.rng import keyed_uniform
from ..spec import Discrete, Inclination, Normal

GOLDEN = np.pi * (3 - np.sqrt(5))  # radians; turned on by it, no two directions are ever the same


def draw_normal(spread: Normal, keys: np.ndarray, purpose: str) -> np.ndarray:
    """(N,) truncated normals, one a key."""
    if spread.sd == 0:
        return np.full(len(keys), spread.mean)
    low, high = ((bound - spread.mean) / spread.sd for bound in spread.bounds())
    share = scipy.special.ndtr(low) + (
        scipy.special.ndtr(high) - scipy.special.ndtr(low)
    ) * keyed_uniform(keys, purpose)
    value = spread.mean + spread.sd * scipy.special.ndtri(share)
    return np.asarray(np.clip(value, *spread.bounds()))  # rounding at the ends


def draw_discrete(choice: Discrete, keys: np.ndarray, purpose: str) -> np.ndarray:
    """(N,) int64 whole numbers, one a key."""
    weights = np.array(choice.weights or (1.0,) * len(choice.values))
    bounds = np.cumsum(weights / weights.sum())[:-1]
    rank = np.searchsorted(bounds, keyed_uniform(keys, purpose), side="right")
    return np.array(choice.values, np.int64)[rank]


def draw_inclination(spread: Inclination, keys: np.ndarray) -> np.ndarray:
    """(N,) angles between a leaf and the horizontal, radians, one a key."""
    share = keyed_uniform(keys, "inclination")
    if spread.shares:
        below = np.concatenate([[0.0], np.cumsum(spread.shares)])
        classes = np.linspace(0.0, np.pi / 2, len(below))
        return np.asarray(np.interp(share, below / below[-1], classes))
    mean, spare = spread.mean_deg / 90, (spread.sd_deg / 90) ** 2
    both = mean * (1 - mean) / spare - 1  # the sum of the beta distribution's two parameters
    return np.asarray(np.pi / 2 * scipy.special.betaincinv(mean * both, (1 - mean) * both, share))
