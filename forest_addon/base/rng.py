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


GAP = 64  # draws that cost as much as passing over any number of them


def uniform_at(rows: np.ndarray, seed: int, *key: int | str) -> np.ndarray:
    """(N,) numbers that ``stream(seed, *key).random`` gives as its draws ``rows`` (N,), ascending."""
    rng, numbers, done = stream(seed, *key), np.empty(len(rows)), 0
    ends = [*(np.flatnonzero(np.diff(rows) > GAP) + 1).tolist(), len(rows)] if len(rows) else []
    for begin, end in zip([0, *ends], ends, strict=False):
        first, last = int(rows[begin]), int(rows[end - 1])
        rng.bit_generator.advance(first - done)  # type: ignore[attr-defined]
        numbers[begin:end] = rng.random(last - first + 1)[rows[begin:end] - first]
        done = last + 1
    return numbers


def truncated_normal(rng: np.random.Generator, count: int, limit: float = 2.0) -> np.ndarray:
    """(count,) standard normals within ±limit, by inversion: one uniform draw each, no rejection."""
    from scipy.special import ndtr, ndtri

    low, high = ndtr(-limit), ndtr(limit)
    return ndtri(low + (high - low) * rng.random(count))


def _word(part: int | str) -> int:
    if isinstance(part, str):
        return int.from_bytes(hashlib.blake2b(part.encode(), digest_size=8).digest(), "little")
    if part < 0:
        raise ValueError(f"a stream key must be 0 or larger, got {part}")
    return int(part)


def child_keys(keys: np.ndarray, number: np.ndarray | int | str) -> np.ndarray:
    """(N,) uint64 keys of what descends from N things: the lineage of arrays.

    number : which child each one is, or a name for all of them.
    """
    if isinstance(number, str):
        number = _word(number) & 0x7FFFFFFFFFFFFFFF
    return _mix(_mix(keys) ^ np.asarray(number).astype(np.uint64))


def keyed_uniform(keys: np.ndarray, purpose: str) -> np.ndarray:
    """(N,) numbers between 0 and 1, both left out: a function of key and purpose alone.

    As with ``stream``, but for whole arrays: a hash of 64 bits (splitmix64 by Steele, Lea & Flood 2014)
    in place of a generator, so that no draw depends on how many others are drawn, or in which order.
    """
    bits = child_keys(keys, purpose) >> np.uint64(11)
    return (bits.astype(np.float64) + 0.5) * 2.0**-53


def keyed_normal(keys: np.ndarray, purpose: str) -> np.ndarray:
    """(N,) standard normals, a function of key and purpose alone: ``keyed_uniform`` by inversion."""
    from scipy.special import ndtri

    return ndtri(keyed_uniform(keys, purpose))


def first_key(seed: int, *key: int | str) -> np.ndarray:
    """(1,) uint64 key that ``child_keys`` descend from; the same lineage as ``stream``.

    Raises
    ------
    ValueError : a negative seed or key.
    """
    words = tuple(_word(part) for part in key)
    seeds = np.random.SeedSequence(seed, spawn_key=words)
    return seeds.generate_state(1, np.uint64)


def _mix(keys: np.ndarray) -> np.ndarray:
    """The finaliser of splitmix64: every bit of a key changes half the bits of the result."""
    z = np.asarray(keys, np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
