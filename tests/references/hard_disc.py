"""The rigid disc, exactly: sound scattered by a sound-hard disc of no thickness, to about 1e-12.

The jump of the pressure across the disc, w(ρ)·cos mφ, vanishes at the edge as √(1 - ρ²). With
the Hankel transform ŵ(ξ) = ∫ w J_m(ξρ) ρ dρ, no flow through the disc of radius 1 means

    ½ ∫₀^∞ √(ξ² - k²)·ŵ(ξ)·J_m(ξρ)·ξ dξ = -∂p_incident/∂z at ρ < 1.

The functions with ŵ_p(ξ) = ξ^{-3/2}·J_{p+1/2}(ξ), p = m + 1, m + 3, …, have that edge and are orthogonal
under the static operator (k = 0; Weber-Schafheitlin), so that Galerkin's method gives a nearly diagonal
matrix A_pq = ∫ √(ξ² - k²)·j_p(ξ)·j_q(ξ)/ξ dξ of spherical Bessel functions, one for all m, that converges
faster than any power once p > k. Turning the path ξ > k into the complex plane leaves Hadamard's finite
part of an integral over ξ < k (the imaginary axis adds nothing to the real part),

    A_pq = f.p. ∫₀^k √(k² - ξ²)·j_p·(y_q + i·j_q)/ξ dξ,   p >= q, p - q even,

of elementary functions. With the far field of the double layer,

    k·f = -k³·cosβ·cosβ'·Σ_m ε_m(-1)^m cos mφ · B(k sinβ')ᵀ A_m⁻¹ B(k sinβ),   B_p(x) = j_p(x)/x,

A_m the rows and columns p = m + 1, m + 3, …, ε₀ = 1, else 2, β and β' between the disc's normal
and the directions to source and receiver, φ between their projections on the disc; e^{+iωt}.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import fft

SMALLEST = 1e-90  # below, k³ is 0 in float64
SPARE_ORDERS = 60  # that the downward recurrence of j starts above the last order


class HardDisc:
    """The equations of one ka, factored by use: ``amplitude`` and ``backscatter`` may be asked often."""

    def __init__(self, ka: float) -> None:
        if not (ka >= 0 and math.isfinite(ka)):
            raise ValueError("ka must be finite and not negative")
        self.ka = ka
        self._k = max(ka, SMALLEST)
        self.orders = math.ceil(ka + 6.0 * ka ** (1 / 3) + 12.0)
        self._matrix = _galerkin_matrix(self._k, self.orders)

    def amplitude(
        self, incidence: np.ndarray, scattered: np.ndarray, azimuth: np.ndarray
    ) -> np.ndarray:
        """(N,) complex k·f of a sound-hard disc for N pairs of directions.

        incidence, scattered : radians from the disc's normal to the source and to the receiver, 0 to π.
        azimuth : radians between the projections of these two directions on the disc; 0: straight back.
        The error is below 1e-11·(1 + (ka)²/2).
        """
        sent = _projections(self._k * np.abs(np.sin(incidence)), self.orders)
        heard = _projections(self._k * np.abs(np.sin(scattered)), self.orders)
        total = np.zeros(len(azimuth), dtype=np.complex128)
        for m in range(self.orders):
            rows = slice(m, None, 2)
            solution = np.linalg.solve(self._matrix[rows, rows], sent[rows])
            share = np.einsum("pn,pn->n", heard[rows], solution)
            total += _mode_sign(m) * np.cos(m * azimuth) * share
        return -(self.ka**3) * np.cos(incidence) * np.cos(scattered) * total

    def backscatter(self, incidence: np.ndarray) -> np.ndarray:
        """(N,) complex k·f straight back: one quadratic form for all modes together."""
        form = np.zeros_like(self._matrix)
        for m in range(self.orders):
            rows = slice(m, None, 2)
            form[rows, rows] += _mode_sign(m) * np.linalg.inv(self._matrix[rows, rows])
        sent = _projections(self._k * np.abs(np.sin(incidence)), self.orders)
        total = np.einsum("pn,pn->n", sent, form @ sent)
        return -(self.ka**3) * np.cos(incidence) ** 2 * total

    def backscatter_series(self) -> np.ndarray:
        """(N,) complex c_n of k·f = (ka)³·Σ c_n cos 2nβ straight back."""
        count = self.orders + 8
        incidence = 0.5 * math.pi * (np.arange(count) + 0.5) / count
        series = fft.dct(self.backscatter(incidence) / self._k**3) / count
        series[0] *= 0.5
        return series


def _mode_sign(m: int) -> float:
    return (1.0 if m == 0 else 2.0) * (-1.0) ** m


def _galerkin_matrix(k: float, orders: int) -> np.ndarray:
    """(P, P) complex symmetric A of the orders 1 to P; ξ = k·sinθ makes the integrand smooth."""
    points, weights = np.polynomial.legendre.leggauss(math.ceil(0.9 * k + 30))
    theta = 0.25 * math.pi * (points + 1.0)
    xi = k * np.sin(theta)
    weight = 0.25 * math.pi * weights * (k * np.cos(theta)) ** 2  # of √(k² - ξ²) dξ
    j, y, log_factorial = _scaled_bessel(xi, orders)

    plain = j * np.exp(np.arange(orders + 1)[:, None] * np.log(xi) - log_factorial[:, None])
    matrix = 1j * ((plain[1:] * (weight / xi)) @ plain[1:].T)
    q = np.arange(1, orders + 1)
    diagonal = ((j[q] * y[q] + 1.0) @ (weight / xi**2) + 0.5 * math.pi) / (2 * q + 1)
    matrix[q - 1, q - 1] += diagonal  # f.p. ∫ -√(k² - ξ²)/ξ² dξ = π/2
    for apart in range(2, orders, 2):
        q = np.arange(1, orders + 1 - apart)
        p = q + apart
        scale = log_factorial[q - 1] - log_factorial[p]
        power = np.exp((apart - 2) * np.log(xi) + scale[:, None])
        values = (j[p] * y[q] * power) @ weight
        matrix[p - 1, q - 1] += values
        matrix[q - 1, p - 1] += values
    return matrix


def _projections(x: np.ndarray, orders: int) -> np.ndarray:
    """(P, N) j_p(x)/x for p = 1 to P."""
    x = np.maximum(x, SMALLEST)
    j, _, log_factorial = _scaled_bessel(x, orders)
    power = np.arange(orders)[:, None] * np.log(x) - log_factorial[1:, None]
    values: np.ndarray = j[1:] * np.exp(power)
    return values


def _scaled_bessel(x: np.ndarray, orders: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(P + 1, N) of (2p + 1)!!/x^p·j_p and x^{p+1}/(2p - 1)!!·y_p, and log (2p + 1)!!, p = 0 to P.

    So scaled they tend to 1 and -1 at x = 0 and never overflow. j comes from the downward recurrence,
    anchored in the larger of orders 0 and 1, y from the upward one (DLMF 10.51, 10.74(iv)).
    """
    square = x * x
    j = np.empty((orders + 1, len(x)))
    above = here = np.ones_like(x)
    for p in range(orders + SPARE_ORDERS + math.ceil(0.3 * x.max(initial=0.0)), 0, -1):
        above, here = here, here - square / ((2 * p + 1) * (2 * p + 3)) * above
        if p <= orders + 1:
            j[p - 1] = here
    sine, cosine = np.sin(x), np.cos(x)
    order_0 = sine / x
    small = x < 1e-2  # the closed form of order 1 loses digits, and order 0 is the larger
    order_1 = np.where(small, 1.0, 3.0 * (order_0 - cosine) / np.where(small, 1.0, square))
    by_1 = x * np.abs(order_1) / 3.0 > np.abs(order_0)
    j *= np.where(by_1, order_1, order_0) / np.where(by_1, above, here)

    y = np.empty((orders + 1, len(x)))
    y[0], y[1] = -cosine, -(cosine + x * sine)
    for p in range(1, orders):
        y[p + 1] = y[p] - square / ((2 * p - 1) * (2 * p + 1)) * y[p - 1]
    log_factorial = np.cumsum(np.log(2.0 * np.arange(orders + 1) + 1.0))
    return j, y, log_factorial
