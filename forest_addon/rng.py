"""Keyed random streams: one scene seed, one independent stream for every thing that draws.

A stream is named by the scene seed and a key, the lineage of what draws: ``("stand", "maple")``,
``("tree", "maple", 3, "leaf")``. The same key always gives the same numbers, so a result depends
neither on the order of the work, nor on the number of processes, nor on what else is switched on.
Keys become ``numpy.random.SeedSequence`` spawn keys; names are hashed to 64 bits, so two different
names share a stream with a chance of 5e-20.
"""

from __future__ import annotations

import hashlib

import numpy as np
from scipy.special import ndtr, ndtri


def stream(seed: int, *key: int | str) -> np.random.Generator:
    """The random stream of one thing.

    Parameters
    ----------
    seed : scene seed, 0 or larger.
    key : lineage of what draws; whole numbers >= 0 and names, in any mixture.

    Raises
    ------
    ValueError : a negative seed or key.
    """
    words = tuple(_word(part) for part in key)
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=words)))


def truncated_normal(rng: np.random.Generator, count: int, limit: float = 2.0) -> np.ndarray:
    """(count,) standard normals within ±limit, by inversion: one uniform draw each, no rejection."""
    low, high = ndtr(-limit), ndtr(limit)
    z: np.ndarray = ndtri(low + (high - low) * rng.random(count))
    return z


def _word(part: int | str) -> int:
    if isinstance(part, str):
        return int.from_bytes(hashlib.blake2b(part.encode(), digest_size=8).digest(), "little")
    if part < 0:
        raise ValueError(f"a stream key must be 0 or larger, got {part}")
    return int(part)
