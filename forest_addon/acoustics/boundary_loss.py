"""Loss of sound to viscous, heat-conducting air at thin cylinders: twigs.

Radii and a frequency go in, the width of air whose sound is lost comes out. A cylinder that is thin to the
wave and does not move keeps the air at its surface from moving and from changing its temperature. With
κ² = -iω/ν, κ_t² = -iω/χ, and u across and along the axis, what is lost over the intensity is, a metre,

    across: 4πka²·|Im K₁(κa)/(κa·K₀(κa))|     along: (2πν/c)·Re κa·K₁(κa)/K₀(κa)
    heat:   2π(γ-1)ka²·|Im K₁(κ_t a)/(κ_t a·K₀(κ_t a))|

(Stokes 1851 for the drag; Morse & Ingard 1968, 6.4 and 9.1, for thick ones, whose boundary layers are thin:
2πkaδ, πkaδ and (γ-1)πkaδ_t with δ = √(2ν/ω)). At 4 kHz δ is 0.03 mm: needles and twigs are thick to it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import kve

VISCOSITY = 1.5e-5  # m²/s, kinematic, of air at 20 °C
DIFFUSIVITY = 2.1e-5  # m²/s, of heat
HEATS = 1.4  # γ, ratio of specific heats


def twig_loss(
    radius: np.ndarray, frequency: float | np.ndarray, speed: float, along: float = 1.0 / 3.0
) -> np.ndarray:
    """(..., K) m of width a metre of cylinder, of radii (K,) m, at a frequency in Hz or at (F, 1).

    along : mean square of the cosine between sound and axis; a third where they look all ways.
    """
    radius = np.asarray(radius, np.float64)
    omega = 2.0 * math.pi * frequency
    wavenumber = omega / speed
    slow = radius * np.sqrt(-1j * omega / VISCOSITY)
    warm = radius * np.sqrt(-1j * omega / DIFFUSIVITY)
    drag, heat = (kve(1, size) / kve(0, size) for size in (slow, warm))
    across = 4.0 * math.pi * wavenumber * radius**2 * np.abs((drag / slow).imag)
    aside = 2.0 * math.pi * VISCOSITY / speed * (slow * drag).real
    warmed = 2.0 * math.pi * (HEATS - 1.0) * wavenumber * radius**2 * np.abs((heat / warm).imag)
    found: np.ndarray = (1.0 - along) * across + along * aside + warmed
    return found
