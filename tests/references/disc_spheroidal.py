"""The sound-hard disc by separation of variables: an oblate spheroid of no thickness.

Another way than the product's: angular functions as eigenvectors over associated Legendre functions,
radial ones from their expansion at a large distance, carried to the disc along their differential
equation. On the disc (ξ = 0) the wave that is finite everywhere has R₁ = 0 for n - m odd, and the
Wronskian R₁R₂' - R₁'R₂ = 1/(c(ξ² + 1)) gives its slope from R₂, which grows inwards and so is stable.
Flammer 1957; Bowman, Senior & Uslenghi 1969, ch. 14. e^{+iωt}; about 1e-9.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import integrate, special


def hard_disc_spheroidal(ka: float, directions: list[tuple[float, float, float]]) -> list[complex]:
    """k·f for (β, β', φ): -2i Σ_mn ε_m (-1)^n R₁'/(R₁' - iR₂')·S_mn(cosβ)·S_mn(cosβ')·cos mφ, |S| = 1."""
    totals = [0j] * len(directions)
    last = math.ceil(1.2 * ka + 7)
    for m in range(last):
        for value, vector, n in _angular(ka, m, last):
            slope_1, slope_2 = _slopes(ka, m, n, value, vector)
            weight = (1 if m == 0 else 2) * (-1) ** n * slope_1 / (slope_1 - 1j * slope_2)
            for index, (incidence, scattered, azimuth) in enumerate(directions):
                sent, heard = (_sum(m, vector, math.cos(angle)) for angle in (incidence, scattered))
                totals[index] += -2j * weight * sent * heard * math.cos(m * azimuth)
    return totals


def _angular(c: float, m: int, last: int):
    """(eigenvalue, coefficients, n) for n = m + 1, m + 3, … of l(l + 1) - c²η²."""
    degree = np.arange(m, m + last + 24)
    step = np.sqrt((degree[1:] ** 2 - m**2) / (4.0 * degree[1:] ** 2 - 1))
    eta = np.diag(step, 1) + np.diag(step, -1)
    values, vectors = np.linalg.eigh(np.diag(degree * (degree + 1.0)) - c * c * eta @ eta)
    odd = np.abs(vectors[1::2]).sum(axis=0) > np.abs(vectors[::2]).sum(axis=0)
    for index in range((last - m) // 2 + 1):
        column = np.flatnonzero(odd)[index]
        yield values[column], vectors[:, column], m + 1 + 2 * index


def _sum(m: int, vector: np.ndarray, x: float) -> float:
    """Σ v_l times the associated Legendre functions of norm 1."""
    below, here = 0.0, math.sqrt((2 * m + 1) / 2 / math.factorial(2 * m))
    here *= special.factorial2(2 * m - 1) * (1 - x * x) ** (m / 2) if m else 1.0
    total = vector[0] * here
    for order, share in enumerate(vector[1:], start=m + 1):
        step = math.sqrt((order**2 - m**2) / (4 * order**2 - 1))
        last = (
            math.sqrt(((order - 1) ** 2 - m**2) / (4 * (order - 1) ** 2 - 1))
            if order > m + 1
            else 0
        )
        below, here = here, (x * here - last * below) / step
        total += share * here
    return float(total)


def _slopes(c: float, m: int, n: int, value: float, vector: np.ndarray) -> tuple[float, float]:
    """R₁' and R₂' at ξ = 0."""
    order = np.arange(m, m + len(vector))
    far = (order[-1] + 4) / c
    log_weight = 0.5 * (special.gammaln(order + m + 1) - special.gammaln(order - m + 1))
    weight = vector * np.sqrt(2 * order + 1) * np.exp(log_weight - log_weight.max())
    sign = np.real(1j ** (order - n)) * weight / weight.sum()
    y, slope = special.spherical_yn(order, c * far), c * special.spherical_yn(order, c * far, True)
    rise = (1 + far**-2) ** (m / 2)
    rise_slope = -m * far**-3 * rise / (1 + far**-2)
    start = [rise * (sign @ y), rise_slope * (sign @ y) + rise * (sign @ slope)]

    def equation(xi: float, state: np.ndarray) -> list[float]:
        square = xi * xi + 1
        pull = value - c * c * xi * xi - m * m / square
        return [state[1], (pull * state[0] - 2 * xi * state[1]) / square]

    path = integrate.solve_ivp(equation, (far, 0), start, "DOP853", rtol=1e-11, atol=1e-13)
    r2, slope_2 = path.y[:, -1]
    return -1 / (c * r2), slope_2
