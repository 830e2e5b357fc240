"""Light at polished surfaces: reflection, refraction, and how much of it takes which way.

Light is unpolarised on each way: what it meets in between scatters as Lambert's law says, which keeps no
polarisation. ``ratio`` is m = n₂/n₁, the refractive index behind the surface over that before it.
"""

from __future__ import annotations

import numpy as np

# Of pure water at 25 °C: wavelength, nm, and the imaginary part k of its refractive index (Hale & Querry
# 1973, Appl. Opt. 12, 555, table 1; at 1064, 1450 and 1550 nm, between its rows, Kou, Labrie &
# Chýlek 1993, Appl. Opt. 32, 3531: 14, 3,000 and 1,090 per metre).
WATER_K = np.array(
    [
        [400, 1.86e-9],
        [450, 1.02e-9],
        [500, 1.00e-9],
        [550, 1.96e-9],
        [600, 1.09e-8],
        [650, 1.64e-8],
        [700, 3.35e-8],
        [750, 1.56e-7],
        [800, 1.25e-7],
        [850, 2.93e-7],
        [900, 4.86e-7],
        [925, 1.06e-6],
        [950, 2.93e-6],
        [1000, 2.89e-6],
        [1064, 1.22e-6],
        [1200, 9.89e-6],
        [1400, 1.38e-4],
        [1450, 3.46e-4],
        [1550, 1.34e-4],
        [1600, 8.55e-5],
        [1800, 1.15e-4],
        [2000, 1.10e-3],
    ]
)


def mirrored(way: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(R, 3) unit directions after a mirror with unit normals (R, 3), of either sense."""
    along = np.einsum("rk,rk->r", way, normal)
    return _unit(way - 2 * along[:, None] * normal)


def refracted(
    way: np.ndarray, normal: np.ndarray, ratio: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions behind a surface by Snell's law, and cosines of the angles before and behind it.

    Returns
    -------
    (R, 3) unit directions, (R,) and (R,) cosines, the last NaN (and the direction too) where all is
    reflected.
    """
    along = np.einsum("rk,rk->r", way, normal)
    before = np.minimum(np.abs(along), 1.0)
    across = way - along[:, None] * normal
    sine = np.einsum("rk,rk->r", across, across) / ratio**2
    with np.errstate(invalid="ignore"):
        behind = np.sqrt(1 - sine)
    to = np.where(along < 0, -1.0, 1.0)
    turned = across / ratio[:, None] + (to * behind)[:, None] * normal
    return _unit(turned), before, behind


def reflectances(
    before: np.ndarray, behind: np.ndarray, ratio: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Shares (R,) of light polarised across and in the plane of incidence that are reflected (Fresnel's
    equations: Born & Wolf 1999, 1.5.2); 1 where ``behind`` is NaN.
    """
    across = (before - ratio * behind) / (before + ratio * behind)
    within = (ratio * before - behind) / (ratio * before + behind)
    return (
        np.where(np.isnan(behind), 1.0, across**2),
        np.where(np.isnan(behind), 1.0, within**2),
    )


def surface_reflectance(before: np.ndarray, behind: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """(R,) share of unpolarised light that one surface reflects; the rest passes."""
    across, within = reflectances(before, behind, ratio)
    return (across + within) / 2


def pane_reflectance(before: np.ndarray, behind: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """(R,) share of unpolarised light that a clear pane reflects, all its inner reflections added as
    powers: 2ρ/(1 + ρ) of each polarisation (Born & Wolf 1999, 7.6, without interference)."""
    across, within = (2 * share / (1 + share) for share in reflectances(before, behind, ratio))
    pane: np.ndarray = (across + within) / 2
    return pane


def spread(
    first: np.ndarray,
    second: np.ndarray,
    before: np.ndarray,
    behind: np.ndarray,
    ratio: np.ndarray,
) -> np.ndarray:
    """(R,) m², area over which a unit solid angle of a target's light has spread at the scanner, ``first``
    metres before a flat surface, when the target is ``second`` metres behind it.

    m²·Ls·Lt, with the distances of the images across and in the plane of incidence, Ls = d₁ + d₂/m and
    Lt = (cos t/cos i)·(d₁ + d₂·cos²i/(m·cos²t)): the beam's own widths by Snell's law, turned about by
    reciprocity of the throughput n²·dA·dω. In one medium (m = 1) it is (d₁ + d₂)².
    """
    across = first + second / ratio
    within = behind / before * (first + second * before**2 / (ratio * behind**2))
    area: np.ndarray = ratio**2 * across * within
    return area


def absorption_of_water(wavelength_nm: float) -> float:
    """1/m, absorption 4π·k/λ of pure water, k between the lines of ``WATER_K`` by its logarithm and beyond
    them as at the nearest."""
    wavelengths, known = WATER_K.T.copy()
    k = np.exp(np.interp(wavelength_nm, wavelengths, np.log(known)))
    return float(4 * np.pi * k / (wavelength_nm * 1e-9))


def _unit(vectors: np.ndarray) -> np.ndarray:
    unit: np.ndarray = vectors / np.sqrt(np.einsum("rk,rk->r", vectors, vectors))[:, None]
    return unit
