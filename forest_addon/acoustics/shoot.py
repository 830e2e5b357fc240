"""Sound that a shoot of needles scatters in phase: many thin rigid cylinders within a wavelength or so.

Half a shoot's needle surface A, its needles' radius r and the shoot's size go in, widths go out. A small
rigid body that does not move scatters k²V/4π·(-1 + t·cos θ); t is 2 across a thin cylinder and 1 along it
(Lamb 1932, § 71: a cylinder's added mass is that of its volume), 5/3 on average over needles that look all
ways. A shoot holds V = A·r. Of what its needles scatter a share F adds up in phase, by the mean square
distance R² of the needles from the shoot's middle, whose correlation dies away exponentially (Debye,
Anderson & Brumberger 1957),

    dσ/dΩ = (k²V/4π)²·(-1 + 5/3·cos θ)²/(1 + q²R²/6)²,  q = 2k·sin(θ/2).

What every needle scatters by itself comes besides (``extinction.cross_sections`` of its radius).
"""

from __future__ import annotations

import math

import numpy as np

PUSHED = 5.0 / 3.0  # t


def shoot_width(
    area: float, radius: float, spread: float, frequency: float, speed: float, angles: int
) -> tuple[float, np.ndarray]:
    """Share of half the needles' surface by which a shoot scatters in phase, and of that per steradian.

    area : m², half the needles' surface. radius : m, of a needle. spread : R, m. angles : even cells, 0 to π;
    the density's integral over the sphere is 1.
    """
    wavenumber = 2.0 * math.pi * frequency / speed
    angle = math.pi * (np.arange(angles) + 0.5) / angles
    solid = -2.0 * math.pi * np.diff(np.cos(np.linspace(0.0, math.pi, angles + 1)))
    turned = 2.0 * wavenumber * np.sin(0.5 * angle)
    found = (
        np.square(-1.0 + PUSHED * np.cos(angle)) * (1.0 + np.square(turned * spread) / 6.0) ** -2
    )
    whole = float(found @ solid)
    strength = wavenumber**2 * radius / (4.0 * math.pi)  # k²V/4π over the area
    return strength**2 * area * whole, found / whole
