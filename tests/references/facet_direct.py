"""Kirchhoff's integral over a flat facet by brute force: small squares, each with its own distance.

p = (ik/2π)·Σ (h/r³)·e^{-2ikr}·dA for a sonar at the height h over the plane of a triangle, sound sent and
heard there, e^{+iωt}. Nothing is shared with the product but this formula.
"""

from __future__ import annotations

import numpy as np


def triangle_direct(
    corners: np.ndarray, point: np.ndarray, wavenumbers: np.ndarray, side: float
) -> np.ndarray:
    """(K,) pressure at ``point`` from a triangle (3, 3) by points ``side`` metres apart (midpoint rule)."""
    a, b, c = (corner - point for corner in corners)
    count = int(np.ceil(max(np.linalg.norm(b - a), np.linalg.norm(c - a)) / side))
    u, v = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    lower = u + v < count
    upper = u + v < count - 1
    places = [((u + 1 / 3) / count, (v + 1 / 3) / count, lower)]
    places += [((u + 2 / 3) / count, (v + 2 / 3) / count, upper)]
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal) / 2 / count**2
    height = abs(a @ normal) / np.linalg.norm(normal)
    total = np.zeros(len(wavenumbers), dtype=complex)
    for s, t, inside in places:
        r = np.linalg.norm(a + s[inside, None] * (b - a) + t[inside, None] * (c - a), axis=1)
        for number, k in enumerate(wavenumbers):
            total[number] += (height / r**3 * np.exp(-2j * k * r)).sum() * area
    return 1j * wavenumbers / (2 * np.pi) * total
