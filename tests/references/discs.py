"""Discs: the sound-hard one exactly, by two methods, and small elements of one that is near.

The rigid disc, exactly: sound scattered by a sound-hard disc of no thickness, to about 1e-12.

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

import math

import numpy as np
from scipy import fft, special

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


# ----------------------------------------------------------------------------------------- disc near
# A disc for sound sent and heard at one point near it: Kirchhoff's integral, and the rigid disc exactly.
# Nothing is shared with the product but the wave equation; e^{+iωt}, pressures re the sent one at 1 m.


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
