"""Sound-hard cylinders by the method of fundamental solutions: no multipoles, no addition theorem.

Line sources on a circle within each cylinder, their strengths by least squares so that the pressure's
normal derivative vanishes on the rims, or is what bark of an admittance lets through
(Fairweather & Karageorghis 1998).
"""

from __future__ import annotations

import numpy as np
from scipy import special

INNER = 0.75  # of the radius


def scattered_mfs(
    wavenumber: float,
    centre: np.ndarray,
    radius: np.ndarray,
    source: np.ndarray,
    receiver: np.ndarray,
    points: int = 60,
    admittance: float = 0.0,
) -> np.ndarray:
    """(R,) scattered pressure of a line source H₀⁽¹⁾(kr), books' convention e^{-iωt}.

    admittance : β of the rims, ∂p/∂r = -ikβp.
    """
    inner = np.linspace(0, 2 * np.pi, points, endpoint=False)
    rim = np.linspace(0, 2 * np.pi, 2 * points, endpoint=False) + 0.01
    sources, places, normals = [], [], []
    for c, a in zip(centre, radius, strict=True):
        sources.append(c + INNER * a * np.column_stack([np.cos(inner), np.sin(inner)]))
        normals.append(np.column_stack([np.cos(rim), np.sin(rim)]))
        places.append(c + a * normals[-1])
    sources, places, normals = map(np.concatenate, (sources, places, normals))

    def slope(start: np.ndarray) -> np.ndarray:
        away = places[:, None] - start
        r = np.hypot(away[..., 0], away[..., 1])
        along = np.einsum("psi,pi->ps", away, normals) / r
        own = 1j * wavenumber * admittance * special.hankel1(0, wavenumber * r)
        return -wavenumber * special.hankel1(1, wavenumber * r) * along + own

    strength = np.linalg.lstsq(slope(sources), -slope(source[None])[:, 0], rcond=1e-14)[0]
    r = np.hypot(*(receiver[:, None] - sources).T).T
    return special.hankel1(0, wavenumber * r) @ strength
