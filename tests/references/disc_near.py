"""Kirchhoff's integral over a flat disc by brute force, sound sent and heard at one point.

p = (ik/2π)·∫ (h/r³)·e^{-2ikr} dA over rings and spokes (midpoint rule), h the height over the disc's plane,
e^{+iωt}. Nothing is shared with the product but this formula.
"""

from __future__ import annotations

import numpy as np


def disc_direct(
    distance: float, incidence: float, radius: float, wavenumbers: np.ndarray, step: float = 2e-4
) -> np.ndarray:
    """(K,) pressure at a point ``distance`` from the disc's middle, ``incidence`` off its normal."""
    rings = int(np.ceil(radius / step))
    rho = (np.arange(rings) + 0.5) * radius / rings
    height, aside = distance * np.cos(incidence), distance * np.sin(incidence)
    total = np.zeros(len(wavenumbers), dtype=complex)
    for ring in rho:
        spokes = int(np.ceil(2 * np.pi * ring / step)) + 8
        turn = 2 * np.pi * (np.arange(spokes) + 0.5) / spokes
        r = np.sqrt(height**2 + (aside - ring * np.cos(turn)) ** 2 + (ring * np.sin(turn)) ** 2)
        weight = height / r**3 * ring * (2 * np.pi / spokes) * (radius / rings)
        total += (np.exp(-2j * wavenumbers[:, None] * r) * weight).sum(axis=1)
    return 1j * wavenumbers / (2 * np.pi) * total
