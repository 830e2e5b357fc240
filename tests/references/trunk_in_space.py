"""A point source beside an endless upright trunk in space: the field by a sum over vertical wavenumbers.

e^{ikR}/R = (i/2)·∫H₀(κρ)·e^{ihz} dh, κ² = k² - h², and the trunk scatters each h as a line source's field
in the plane (books' convention, e^{-iωt}). The contour passes k below and -k above.
"""

from __future__ import annotations

import numpy as np
from scipy import special

TILT = 0.03
REACH = 1.15  # of k; beyond it nothing is left
POINTS = 24_001


def scattered_in_space(
    k: float, radius: float, legs: tuple[float, float], turned: float, rise: float
) -> complex:
    """Scattered pressure: legs to and from the axis, the angle by which sound is turned, height between."""
    t, step = np.linspace(-REACH * k, REACH * k, POINTS, retstep=True)
    h = t * (1.0 - 1j * TILT)
    kappa = np.sqrt(k**2 - h**2 + 0j)
    kappa = np.where(kappa.imag < 0, -kappa, kappa)
    z = kappa * radius
    total = np.zeros(len(h), complex)
    for n in range(int(k * radius + 8)):
        slope = special.jvp(n, z) / special.h1vp(n, z)
        wave = special.hankel1(n, kappa * legs[0]) * special.hankel1(n, kappa * legs[1])
        total += (1 if n == 0 else 2) * -slope * wave * np.cos(n * (np.pi - turned))
    return complex(0.5j * (total * np.exp(1j * h * rise)).sum() * step * (1.0 - 1j * TILT))
