"""A disc for sound sent and heard at one point near it: Kirchhoff's integral, and the rigid disc exactly.

Nothing is shared with the product but the wave equation; e^{+iωt}, pressures re the sent one at 1 m.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import special


def disc_direct(
    distance: float, incidence: float, radius: float, wavenumbers: np.ndarray, step: float = 2e-4
) -> np.ndarray:
    """(K,) pressure by physical optics, p = (ik/2π)·∫ (h/r³)·e^{-2ikr} dA over rings and spokes (midpoint
    rule), h the height over the disc's plane.

    The point is ``distance`` from the disc's middle, ``incidence`` off its normal.
    """
    rings = int(np.ceil(radius / step))
    rho = (np.arange(rings) + 0.5) * radius / rings
    height, aside = distance * np.cos(incidence), distance * np.sin(incidence)
    total = np.zeros(len(wavenumbers), dtype=complex)
    for ring in rho:
        spokes = int(np.ceil(2 * np.pi * ring / step)) + 8
        turn = 2 * np.pi * (np.arange(spokes) + 0.5) / spokes
        r = np.sqrt(height**2 + (aside - ring * np.cos(turn)) ** 2 + (ring * np.sin(turn)) ** 2)
        weight = height / r**3 * ring * (2 * np.pi / spokes) * (radius / rings)
        total += (np.exp(-2j * wavenumbers[:, None] * r) * weight).sum(axis=1)
    return 1j * wavenumbers / (2 * np.pi) * total


LAST = 1500.0  # of the radius, up to which ξ is integrated: 1/3ξ³ is left of each element
SPARE = 14


class RigidDisc:
    """The rigid disc of radius 1 at one wavenumber, by Galerkin's method, for any point source.

    The jump of the pressure across the disc is Σ_mn c_mn·ρ^m·√(1 - ρ²)·P_n^(m,½)(1 - 2ρ²)·cos mφ, Jacobi's
    polynomials; their Hankel transforms are √2·Γ(n + 3/2)/n!·ξ^{-3/2}·J_{m+2n+3/2}(ξ). No flow passes the
    disc: that of the jump is ½·√(ξ² - k²) of its transform. What the source does to it, and what is heard of
    it where the source is, are the same integrals over the disc, g: p = gᵀA⁻¹g/4π.
    """

    def __init__(self, ka: float) -> None:
        self.ka = ka
        self.orders = math.ceil(1.15 * ka + 4.0 * ka ** (1 / 3) + SPARE)
        self._elements = _elements(ka, self.orders)

    def heard(self, distance: float, incidence: float) -> complex:
        """The pressure at a point, radii from the middle and radians off the normal, re that sent at 1."""
        count = self.orders
        u, weight = np.polynomial.legendre.leggauss(count + 40)
        u, weight = math.pi / 4 * (u + 1.0), math.pi / 4 * weight
        rho = np.sin(u)
        turns = 4 * (count + 30)
        turn = 2 * math.pi * np.arange(turns) / turns
        height, aside = distance * math.cos(incidence), distance * math.sin(incidence)
        x, y = rho[:, None] * np.cos(turn), rho[:, None] * np.sin(turn)
        r = np.sqrt((x - aside) ** 2 + y**2 + height**2)
        flow = height * (1.0 / r**3 + 1j * self.ka / r**2) * np.exp(-1j * self.ka * r)
        by_order = np.fft.fft(flow, axis=1) * (2 * math.pi / turns)
        total = 0j
        for m in range(count):
            few = (count - m + 1) // 2
            if few < 1:
                break
            n = np.arange(few)
            shape = np.array([special.eval_jacobi(i, m, 0.5, 1 - 2 * rho**2) for i in n])
            shape = shape * rho**m * np.cos(u)
            shape /= np.exp(0.5 * math.log(2) + special.gammaln(n + 1.5) - special.gammaln(n + 1))[
                :, None
            ]
            given = shape @ (by_order[:, m] * rho * np.cos(u) * weight)
            p = m + 1 + 2 * n
            matrix = (2.0 if m == 0 else 1.0) * self._elements[np.ix_(p - 1, p - 1)]
            total += given @ np.linalg.solve(matrix, given)
        return complex(total / (4 * math.pi))


def _elements(k: float, orders: int) -> np.ndarray:
    """(P, P) ∫ √(ξ² - k²)·j_p·j_q/ξ dξ for p, q = 1 … P, p - q even; the static part is π/(4p + 2)·δ_pq."""
    p = np.arange(1, orders + 1)
    matrix = np.diag(math.pi / (4.0 * p + 2.0)).astype(complex)
    points, weights = np.polynomial.legendre.leggauss(12)
    for low, high, below in ((0.0, math.pi / 2, True), (0.0, math.acosh(LAST / k), False)):
        steps = math.ceil((high - low) * (k + 20.0)) if below else math.ceil(LAST / 2.0)
        edges = np.linspace(low, high, steps + 1)
        if not below:  # even in ξ rather than in its angle
            edges = np.arccosh(np.maximum(np.linspace(1.0, LAST / k, steps + 1), 1.0))
        half = np.diff(edges)[:, None] / 2
        t = (edges[:-1, None] + half * (points + 1.0)).ravel()
        weight = (half * weights).ravel()
        xi = k * (np.sin(t) if below else np.cosh(t))
        slope = k * (np.cos(t) if below else np.sinh(t))  # dξ/dt, and |√(ξ² - k²)|
        root = 1j * slope if below else slope
        j = np.array([special.spherical_jn(int(order), xi) for order in p])
        matrix += (j * ((root - xi) / xi * slope * weight)) @ j.T
    return matrix
