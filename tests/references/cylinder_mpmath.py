"""The cylinder's scattering sum in 60 digits, with mpmath's Bessel functions and the phase angle γ."""

from __future__ import annotations

import mpmath

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
