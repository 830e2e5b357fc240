"""Reflection of sound by the ground, and its coherence with the direct sound.

The surface is a locally reacting half space. Its normalised impedance comes from one parameter, the flow
resistivity σ, by Delany & Bazley (1970) or by Miki (1990), whose real part stays positive at low
frequencies. A point source over it is reflected by the Weyl-van der Pol formula (Chien & Soroka 1975;
Attenborough, Hayek & Lawther 1980),

    Q = R_p + (1 - R_p)·F(w),  R_p = (cos θ - β)/(cos θ + β),  β = 1/Z,
    F = 1 + i√π·w·e^{-w²}·erfc(-iw),  w = (1 + i)/2·√(kd')·(cos θ + β),

θ from the vertical, d' the length of the reflected path. It is asymptotic in kd': within 2 % of a
mirrored source's field from kd' = 13 on, over snow, forest floor and grass (tests). Books write
e^{-iωt}; arguments and results here are e^{+iωt}.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import special

# Flow resistivity in kPa·s/m², within the ranges of Embleton, Piercy & Daigle (1983), table I.
SURFACES = {
    "snow": 20.0,
    "forest floor": 50.0,
    "grass": 200.0,
    "soil": 2000.0,
    "asphalt": 20000.0,
}
FAR = 1e3  # |w|; from here on the series of F has twelve digits, and the sum fewer
# 1 + a·x^p + i·b·x^q for impedance, x = f/σ, Hz over kPa·s/m².
MODELS = {
    "delany-bazley": (9.08, -0.75, 11.9, -0.73),
    "miki": (5.50, -0.632, 8.43, -0.632),
}


def surface_impedance(
    frequency: np.ndarray, flow_resistivity: float, model: str = "miki"
) -> np.ndarray:
    """Impedance over ρc, complex, at frequencies above 0 (Hz).

    flow_resistivity : kPa·s/m². model : a key of ``MODELS``.
    """
    real, falls, imaginary, turns = MODELS[model]
    x = np.asarray(frequency, np.float64) / flow_resistivity
    return 1.0 + real * x**falls - 1j * imaginary * x**turns


def under_leaves(
    frequency: np.ndarray,
    sine: np.ndarray | float,
    impedance: np.ndarray | complex,
    height: float,
    loss: np.ndarray,
    sound_speed: float,
) -> np.ndarray:
    """Impedance at z = 0 that reflects plane waves as a ground under a layer of leaves does.

    sine : of the waves' slope. height : m of the layer. loss : (F,) nepers of amplitude a metre in it. The
    layer is air of the wavenumber k - i·loss (an equivalent fluid): a wave that comes level is turned back
    at its top, whatever is below, as no ray would be. Without loss the ground's own impedance.
    """
    wavenumber = 2.0 * math.pi * np.asarray(frequency, np.float64) / sound_speed
    rises = np.asarray(sine, np.float64)
    steep = np.sqrt((1.0 - 1j * loss / wavenumber) ** 2 - (1.0 - rises**2))  # k_z within, over k
    turn = np.exp(-2j * wavenumber * height * steep)
    below = (steep - 1.0 / impedance) / (steep + 1.0 / impedance) * turn
    top = steep * (1.0 - below) / (1.0 + below)  # admittance at the layer's top
    reflected = (rises - top) / (rises + top) * np.exp(2j * wavenumber * height * rises)
    return np.asarray((1.0 + reflected) / (rises * (1.0 - reflected)))


def spherical_reflection(
    frequency: np.ndarray,
    path: float | np.ndarray,
    rise: float,
    impedance: np.ndarray | complex,
    sound_speed: float,
) -> np.ndarray:
    """Q at frequencies (F,) Hz: the reflected field over that of a mirrored source.

    path : metres, of the reflected sound. rise : metres, heights of source and receiver together.
    impedance : over ρc, (F,) or a number.
    """
    admittance = 1.0 / np.conj(np.asarray(impedance, np.complex128))
    cosine = rise / path
    plane = (cosine - admittance) / (cosine + admittance)
    wave_number = 2.0 * math.pi * np.asarray(frequency, np.float64) / sound_speed
    distance = (0.5 + 0.5j) * np.sqrt(wave_number * path) * (cosine + admittance)
    # wofz(w) = e^{-w²}·erfc(-iw); far from 0 the two terms of F cancel, its series does not.
    near = 1.0 + 1j * math.sqrt(math.pi) * distance * special.wofz(distance)
    inverse = 1.0 / np.where(np.abs(distance) > FAR, distance, FAR) ** 2
    far = -inverse / 2 * (1.0 + 1.5 * inverse * (1.0 + 2.5 * inverse))
    loss = np.where(np.abs(distance) > FAR, far, near)
    return np.conj(plane + (1.0 - plane) * loss)


SCALE = 1.1  # m, L of ``coherence``


def coherence(
    wavenumber: np.ndarray, path: np.ndarray, apart: np.ndarray, fluctuation: float
) -> np.ndarray:
    """Γ of two neighbouring paths in moving air, from 1 (still air) to 0; the arguments broadcast.

    path, apart : x and h, metres: how long the paths are, and their largest distance. fluctuation : <μ²>. For
    fluctuations of the refractive index with a Gaussian correlation over ``SCALE`` (Karavainikov 1957; Daigle
    1979, JASA 65:45),

        Γ = e^{-σ²(1 - ρ)},  σ² = √π/2·<μ²>·k²·L·x·A,  ρ = √π/2·erf(h/L)/(h/L),

    A = 1/2 where L is well below √(x/k), else 1. Daigle measured <μ²> of 2 to 10·10⁻⁶ over open ground and
    L = 1.1 m; under trees the air is calmer.
    """
    near = 0.5 + 0.5 / (1.0 + path / (wavenumber * SCALE**2))  # A, from 1 to 1/2
    variance = 0.5 * math.sqrt(math.pi) * fluctuation * wavenumber**2 * SCALE * path * near
    share = np.maximum(apart / SCALE, 1e-6)
    correlation = 0.5 * math.sqrt(math.pi) * special.erf(share) / share
    return np.exp(-variance * (1.0 - correlation))
