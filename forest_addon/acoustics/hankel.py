"""The Hankel function H₁⁽¹⁾ without its phase, for arguments that are not small."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import special

SMALLEST = 6.0  # argument
HANKEL_TERMS = 11


def hankel(x: np.ndarray) -> np.ndarray:
    """H₁⁽¹⁾(x)·e^{-ix} for x >= ``SMALLEST``, to 2e-13: √x times it is smooth in 1/x."""
    place = 2.0 * SMALLEST / x - 1.0
    root = np.sqrt(x)
    wave = np.empty(x.shape, dtype=np.complex128)
    for series, part in zip(_hankel_series(), (wave.real, wave.imag), strict=True):
        value = np.full(x.shape, series[-1])
        for term in series[-2::-1]:
            value *= place
            value += term
        np.divide(value, root, out=part)
    return wave


@lru_cache(maxsize=1)
def _hankel_series() -> tuple[np.ndarray, np.ndarray]:
    """Power series in 2·SMALLEST/x - 1, from the values at Chebyshev points."""
    place = np.cos(np.pi * (np.arange(HANKEL_TERMS) + 0.5) / HANKEL_TERMS)
    x = 2.0 * SMALLEST / (place + 1.0)
    value = special.hankel1e(1, x) * np.sqrt(x)
    fits = [
        np.polynomial.chebyshev.chebfit(place, part, HANKEL_TERMS - 1)
        for part in (value.real, value.imag)
    ]
    real, imaginary = (np.polynomial.chebyshev.cheb2poly(fit) for fit in fits)
    return real, imaginary
