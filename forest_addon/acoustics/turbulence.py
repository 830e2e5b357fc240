"""Coherence of two neighbouring paths in moving air: Γ of the direct sound and that of the ground.

Frequencies, a path and how far apart the two paths are come in, Γ from 1 (still air) to 0 goes out. For
fluctuations of the refractive index with a Gaussian correlation over ``SCALE`` (Karavainikov 1957; Daigle
1979, JASA 65:45),

    Γ = e^{-σ²(1 - ρ)},  σ² = √π/2·<μ²>·k²·L·x·A,  ρ = √π/2·erf(h/L)/(h/L),

h the largest distance between the paths, A = 1/2 where L is well below √(x/k), else 1. Daigle measured
<μ²> of 2 to 10·10⁻⁶ over open ground and L = 1.1 m; under trees the air is calmer.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import special

SCALE = 1.1  # m, L


def coherence(
    wavenumber: np.ndarray, path: np.ndarray, apart: np.ndarray, fluctuation: float
) -> np.ndarray:
    """Γ; the arguments broadcast. path, apart : x and h, metres. fluctuation : <μ²>."""
    near = 0.5 + 0.5 / (1.0 + path / (wavenumber * SCALE**2))  # A, from 1 to 1/2
    variance = 0.5 * math.sqrt(math.pi) * fluctuation * wavenumber**2 * SCALE * path * near
    share = np.maximum(apart / SCALE, 1e-6)
    correlation = 0.5 * math.sqrt(math.pi) * special.erf(share) / share
    found: np.ndarray = np.exp(-variance * (1.0 - correlation))
    return found
