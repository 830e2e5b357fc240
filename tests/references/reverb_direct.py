"""The forest's impulse response as the formulas say it: one trunk, one frequency, one order at a time.

Plain Python and scalar Bessel functions; nothing is shared with the product but the definitions in
PHYSICS 5.1 to 5.3. Slow: some milliseconds for a trunk and a frequency.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

from scipy import special


def absorption_direct(
    frequency: float, temperature_c: float, humidity: float, pressure_kpa: float
) -> float:
    """ISO 9613-1 in nepers per metre, written down from the standard's own layout (dB, 8.686)."""
    t = temperature_c + 273.15
    pressure = pressure_kpa / 101.325
    exponent = -6.8346 * (273.16 / t) ** 1.261 + 4.6151
    h = humidity * 10**exponent / pressure
    oxygen = pressure * (24 + 4.04e4 * h * (0.02 + h) / (0.391 + h))
    nitrogen = (
        pressure
        * (t / 293.15) ** (-1 / 2)
        * (9 + 280 * h * math.exp(-4.170 * ((t / 293.15) ** (-1 / 3) - 1)))
    )
    if frequency == 0:
        return 0.0
    inner = 0.01275 * math.exp(-2239.1 / t) / (oxygen + frequency**2 / oxygen)
    inner += 0.1068 * math.exp(-3352.0 / t) / (nitrogen + frequency**2 / nitrogen)
    decibels = (
        8.686
        * frequency**2
        * (1.84e-11 / pressure * (t / 293.15) ** 0.5 + (t / 293.15) ** (-5 / 2) * inner)
    )
    return decibels / 8.686


def transfer_direct(frequency: float, angle: float, radius: float, speed: float) -> complex:
    """H under e^{+iωt}, with the phase angle γ by arctangent."""
    if frequency == 0:
        return 0.0
    k = 2 * math.pi * frequency / speed
    total = 0j
    for order in range(int(k * radius + 8 * (k * radius) ** (1 / 3) + 12)):
        tangent = special.jvp(order, k * radius) / special.yvp(order, k * radius)
        gamma = math.atan(tangent) if math.isfinite(tangent) else 0.0
        wave = math.sin(gamma) * cmath.exp(1j * gamma)
        total += (1 if order == 0 else 2) * wave * math.cos(order * angle)
    book = cmath.exp(1j * math.pi / 4) * math.sqrt(2 / (math.pi * k)) * total
    return book.conjugate()


def reverb_spectrum_direct(
    frequency: float,
    source: Sequence[float],
    receiver: Sequence[float],
    trunks: Sequence[tuple[float, float, float]],
    *,
    speed: float,
    air: tuple[float, float, float],
    ground: float,
    strength: float,
    spreading: float,
) -> tuple[complex, complex, complex]:
    """Direct, ground and tree spectrum at one frequency; trunks as (x, y, radius)."""
    loss = absorption_direct(frequency, *air)
    k = 2 * math.pi * frequency / speed

    def along(path: float) -> complex:
        return cmath.exp(-(loss + 1j * k) * path)

    straight = math.dist(source, receiver)
    bounced = math.dist((source[0], source[1], -source[2]), receiver)
    trees = 0j
    for x, y, radius in trunks:
        v1 = (x - source[0], y - source[1])
        v2 = (receiver[0] - x, receiver[1] - y)
        first, second = math.hypot(*v1), math.hypot(*v2)
        cosine = (v1[0] * v2[0] + v1[1] * v2[1]) / (first * second)
        angle = math.acos(max(-1.0, min(1.0, cosine)))
        weight = strength / (first * second**spreading)
        trees += weight * along(first + second) * transfer_direct(frequency, angle, radius, speed)
    return along(straight) / straight, ground * along(bounced) / bounced, trees
