"""Shares of pulses by their returns, and how far apart they are between halves of a flight line."""

from __future__ import annotations

import numpy as np

from forest_addon.base.rng import stream
from headless.commands.work.like import FlownCloud

BLOCK, HALVES = 5.0, 40  # metres, and halvings of a line's blocks


def shares_of(count: np.ndarray) -> np.ndarray:
    """(4,) shares of pulses (P,) with 1, 2, 3 and 4 returns."""
    shares: np.ndarray = np.bincount(np.minimum(count, 5), minlength=6)[1:5] / max(len(count), 1)
    return shares


def halves_apart(cloud: FlownCloud, seed: int) -> dict[int, float]:
    """Of each line, how far apart the shares of single returns of random halves of its blocks are: the 95th
    percentile, as a share."""
    rng, found = stream(seed, "validate", "halves of lines"), {}
    for number in np.unique(cloud.line).tolist():
        rows = (cloud.line == number) & (cloud.number == 1)
        cell = np.floor(cloud.place[rows][:, :2] / BLOCK).astype(np.int64)
        block = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
        many = np.maximum(np.bincount(block), 1)
        single = np.bincount(block, cloud.count[rows] == 1)
        apart = []
        for _ in range(HALVES):
            half = rng.random(len(many)) < 0.5
            if half.any() and not half.all():
                each = [single[h].sum() / many[h].sum() for h in (half, ~half)]
                apart.append(abs(each[0] - each[1]))
        found[number] = float(np.quantile(apart or [0.0], 0.95))
    return found
