"""Cylinders: groups by fundamental solutions, one in 60 digits, one in space.

Sound-hard cylinders by the method of fundamental solutions: no multipoles, no addition theorem.

Line sources on a circle within each cylinder, their strengths by least squares so that the pressure's
normal derivative vanishes on the rims, or is what bark of an admittance lets through
(Fairweather & Karageorghis 1998).
"""

import mpmath
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


# ----------------------------------------------------------------------------------- cylinder mpmath
# The cylinder's scattering sum in 60 digits, with mpmath's Bessel functions and the phase angle γ.

SPARE = 40  # orders above ka; the terms have fallen below 1e-25 by then (checked)


def scattering_sum_mpmath(ka: float, angle: float) -> complex:
    """S(ka, angle) of PHYSICS 5.2 in the books' convention, e^{-iωt}."""
    with mpmath.workdps(60):
        size, turned = mpmath.mpf(ka), mpmath.mpf(angle)
        last = int(ka + 8 * ka ** (1 / 3)) + SPARE
        j = {last + 1: mpmath.besselj(last + 1, size), last + 2: mpmath.besselj(last + 2, size)}
        for n in range(last + 1, -1, -1):
            j[n - 1] = 2 * n / size * j[n] - j[n + 1]
        y = {-1: mpmath.bessely(-1, size), 0: mpmath.bessely(0, size)}
        for n in range(last + 1):
            y[n + 1] = 2 * n / size * y[n] - y[n - 1]
        total = mpmath.mpc(0)
        for n in range(last + 1):
            gamma = mpmath.atan((j[n - 1] - j[n + 1]) / (y[n - 1] - y[n + 1]))
            term = mpmath.sin(gamma) * mpmath.expj(gamma)
            total += (1 if n == 0 else 2) * term * mpmath.cos(n * turned)
        assert abs(term) < mpmath.mpf(10) ** -25
        return complex(total)


# ------------------------------------------------------------------------------------ trunk in space
# A point source beside an endless upright trunk in space: the field by a sum over vertical wavenumbers.
# e^{ikR}/R = (i/2)·∫H₀(κρ)·e^{ihz} dh, κ² = k² - h², and the trunk scatters each h as a line source's field
# in the plane (books' convention, e^{-iωt}). The contour passes k below and -k above.

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
