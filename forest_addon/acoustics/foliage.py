"""Sound among leaves, needles and twigs: what each takes of it, and what a shoot scatters in phase."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import kve

MOST, EDGE = (
    0.9,
    8.0,
)  # of the sound; G·√f is a fit, and would pass 1: (share^-EDGE + MOST^-EDGE)^(-1/EDGE)
LOWEST = 20.0  # Hz; a root's slope at 0 would ring for seconds, where nothing was measured


def foliage_loss(frequency: np.ndarray, leaf_area_density: float, absorption: float) -> np.ndarray:
    """Nepers (of amplitude) per metre that leaves absorb, at frequencies in Hz. absorption : G.

    A leaf absorbs the share α = G·√f of the sound on its surface, G from 0.001 to 0.002 as measured in a
    reverberation room (Watanabe & Yamada 1996, J. Acoust. Soc. Jpn. (E) 17). Sound among leaves that look all
    ways meets both faces of F square metres of leaf a cubic metre: its energy falls as e^{-αFx/2} (Kuttruff
    2009, 5.1: A/4V of a surface 2F). Below some LOWEST the share falls as f² in place of √f: at 100 Hz it is
    3 % less.
    """
    square = np.square(np.asarray(frequency, np.float64))
    share = absorption * square * (square + LOWEST**2) ** -0.75
    share = share / (1.0 + (share / MOST) ** EDGE) ** (1.0 / EDGE)
    return 0.25 * leaf_area_density * share


VISCOSITY = 1.5e-5  # m²/s, kinematic, of air at 20 °C
DIFFUSIVITY = 2.1e-5  # m²/s, of heat
HEATS = 1.4  # γ, ratio of specific heats


def twig_loss(
    radius: np.ndarray, frequency: float | np.ndarray, speed: float, along: float = 1.0 / 3.0
) -> np.ndarray:
    """(..., K) m of width a metre of cylinder that loses its sound to viscous, heat-conducting air; of radii
    (K,) m, at a frequency in Hz or at (F, 1).

    A cylinder that is thin to the wave and does not move keeps the air at its surface from moving and from
    changing its temperature. With κ² = -iω/ν, κ_t² = -iω/χ, and u across and along the axis, what is lost
    over the intensity is, a metre,

        across: 4πka²·|Im K₁(κa)/(κa·K₀(κa))|     along: (2πν/c)·Re κa·K₁(κa)/K₀(κa)
        heat:   2π(γ-1)ka²·|Im K₁(κ_t a)/(κ_t a·K₀(κ_t a))|

    (Stokes 1851 for the drag; Morse & Ingard 1968, 6.4 and 9.1, for thick ones, whose boundary layers are
    thin: 2πkaδ, πkaδ and (γ-1)πkaδ_t with δ = √(2ν/ω)). At 4 kHz δ is 0.03 mm: needles are thick to it.

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
    return (1.0 - along) * across + along * aside + warmed


PUSHED = 5.0 / 3.0  # t


def shoot_width(
    area: float, radius: float, spread: float, frequency: float, speed: float, angles: int
) -> tuple[float, np.ndarray]:
    """Share of half the needles' surface by which a shoot scatters in phase, and of that per steradian.

    A small rigid body that does not move scatters k²V/4π·(-1 + t·cos θ); t is 2 across a thin cylinder and 1
    along it (Lamb 1932, § 71: a cylinder's added mass is that of its volume), 5/3 on average over needles
    that look all ways. A shoot holds V = A·r. Of what its needles scatter a share adds up in phase, by the
    mean square distance R² of the needles from the shoot's middle, whose correlation dies away exponentially
    (Debye, Anderson & Brumberger 1957),

        dσ/dΩ = (k²V/4π)²·(-1 + 5/3·cos θ)²/(1 + q²R²/6)²,  q = 2k·sin(θ/2).

    What every needle scatters by itself comes besides (``extinction.cross_sections`` of its radius).

    area : m², half the needles' surface. radius : m, of a needle. spread : R, m. angles : even cells, 0 to π;
    the density's integral over the sphere is 1.
    """
    wavenumber = 2.0 * math.pi * frequency / speed
    angle = math.pi * (np.arange(angles) + 0.5) / angles
    solid = -2.0 * math.pi * np.diff(np.cos(np.linspace(0.0, math.pi, angles + 1)))
    turned = 2.0 * wavenumber * np.sin(0.5 * angle)
    phase_function = (
        np.square(-1.0 + PUSHED * np.cos(angle)) * (1.0 + np.square(turned * spread) / 6.0) ** -2
    )
    whole = float(phase_function @ solid)
    strength = wavenumber**2 * radius / (4.0 * math.pi)  # k²V/4π over the area
    return strength**2 * area * whole, phase_function / whole
