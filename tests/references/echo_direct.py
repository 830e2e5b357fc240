"""The foliage echo as the formulas say it: one leaf, one frequency at a time, in plain Python.

Nothing is shared with the product but the definitions of PHYSICS 4.1; the air is that of
``reverb_direct``. Vectors are tuples, angles come from arccos and arctan of plain components.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Sequence

from scipy import special

from .reverb_direct import absorption_direct

Leaf = tuple[Sequence[float], Sequence[float], float]  # centre, unit normal, radius


def echo_spectrum_direct(
    frequency: float,
    leaves: Iterable[Leaf],
    *,
    position: Sequence[float],
    azimuth: float,
    elevation: float,
    width: tuple[float, float],
    model: str,
    speed: float,
    air: tuple[float, float, float] | None,
) -> complex:
    """Echo pressure at one frequency re the call at 1 m; angles in radians, air None: no loss."""
    total = 0j
    for centre, normal, radius in leaves:
        total += leaf_direct(
            frequency,
            centre,
            normal,
            radius,
            position,
            azimuth,
            elevation,
            width,
            model,
            speed,
            air,
        )
    return total


def leaf_direct(
    frequency: float,
    centre: Sequence[float],
    normal: Sequence[float],
    radius: float,
    position: Sequence[float],
    azimuth: float,
    elevation: float,
    width: tuple[float, float],
    model: str,
    speed: float,
    air: tuple[float, float, float] | None,
) -> complex:
    """One leaf's share of the echo."""
    k = 2 * math.pi * frequency / speed
    ray = [c - p for c, p in zip(centre, position, strict=True)]
    r = math.sqrt(sum(x * x for x in ray))
    unit = [x / r for x in ray]

    # Turn the axis to +X: first back by the azimuth about Z, then down by the elevation about Y.
    x = unit[0] * math.cos(azimuth) + unit[1] * math.sin(azimuth)
    y = unit[1] * math.cos(azimuth) - unit[0] * math.sin(azimuth)
    forward = x * math.cos(elevation) + unit[2] * math.sin(elevation)
    up = unit[2] * math.cos(elevation) - x * math.sin(elevation)
    off_axis = math.acos(max(-1.0, min(1.0, forward)))
    about = math.atan2(up, y)
    az, el = off_axis * math.cos(about), off_axis * math.sin(about)
    sigma = [w / 2 / math.sqrt(-2 * math.log(10 ** (-3 / 20))) for w in width]
    beam = math.exp(-(az**2) / (2 * sigma[0] ** 2) - el**2 / (2 * sigma[1] ** 2))

    cosine = min(1.0, abs(sum(u * n for u, n in zip(unit, normal, strict=True))))
    amplitude = scattering_direct(k * radius, math.acos(cosine), model) / k
    loss = absorption_direct(frequency, *air) if air else 0.0
    return beam * beam * amplitude / r**2 * cmath.exp(-2 * (loss + 1j * k) * r)


def scattering_direct(ka: float, incidence: float, model: str) -> complex:
    """k·f of a disc."""
    if ka == 0:
        return 0j
    if model == "paper":
        strength = (0.5003 * ka**2 + 0.6867) * math.cos((0.3999 * ka**-0.9065 + 0.9979) * incidence)
        phase = math.erf((0.9824 * ka**0.3523 - 0.9459) * (math.pi / 2 - incidence)) - 2.6343
        return strength * cmath.exp(-1j * phase)
    x = 2 * ka * math.sin(incidence)
    lobe = 1.0 if x == 0 else 2 * float(special.jv(1, x)) / x
    return 1j * ka**2 / 2 * math.cos(incidence) * lobe
