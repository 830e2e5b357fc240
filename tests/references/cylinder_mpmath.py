"""The cylinder's scattering sum in 40 digits, order by order, with mpmath's Bessel functions."""

from __future__ import annotations

import mpmath


def scattering_sum_mpmath(ka: float, angle: float, digits: int = 40) -> complex:
    """S(ka, angle) of PHYSICS 5.2 in the books' convention; terms until they fall below 1e-25."""
    with mpmath.workdps(digits):
        size, turned = mpmath.mpf(ka), mpmath.mpf(angle)
        total, order = mpmath.mpc(0), 0
        while True:
            tangent = mpmath.besselj(order, size, derivative=1) / mpmath.bessely(
                order, size, derivative=1
            )
            gamma = mpmath.atan(tangent)
            term = mpmath.sin(gamma) * mpmath.expj(gamma)
            total += (1 if order == 0 else 2) * term * mpmath.cos(order * turned)
            if order > ka + 5 and abs(term) < mpmath.mpf(10) ** -25:
                return complex(total)
            order += 1
