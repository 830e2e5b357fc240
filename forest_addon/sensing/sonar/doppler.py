"""The Doppler effect of a moving sonar: every path plays the call faster or slower.

A sonar that flies at v towards a scatterer hears its call sped up by α = (c + v_t)/(c − v_e), v_t and v_e
the velocity towards the scatterer as the call leaves and as the echo comes back to the ear. A path of
the amplitude A and the delay τ then adds A(f)·X(f/α)/α·e^{-i2πfτ}, X the call's spectrum. X(f/α) is
smooth in α: Chebyshev points over the range of α turn the sum into as many plain ones, each times X played
at the speed of its point. The scatterer's own response is taken at the frequency heard, which is off by
at most v/c of itself.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import special

from ...acoustics import chebyshev
from .bands import Band, Grid
from .calls import Call
from .search import Group
from .station import Station
from .summation import sum_echoes

SPREAD = 1e-9  # of α; less is one speed
SAFER = 0.01  # of the tolerance: what is bounded is relative to Σ|x|, which is above the spectrum


def widened(band: Band, speed: float, sound_speed: float) -> Band:
    """The band in which calls of a band are heard by a sonar that moves at ``speed``."""
    most = (sound_speed + speed) / (sound_speed - speed)
    return Band(band.low / most, band.high * most)


def factors(group: Group, station: Station, ear: int) -> np.ndarray:
    """(M,) α of every path to an ear."""
    velocity, speed = station.pose.velocity, station.sound_speed
    away = group.scatterers.centre - station.ear[ear]
    back = (away / group.paths.leg[ear][:, None]) @ velocity
    return (speed + group.paths.direction @ velocity) / (speed - back)


def shifted_sum(
    groups: list[Group],
    station: Station,
    band: Band,
    grid: Grid,
    tolerance: float,
    call: Call,
) -> np.ndarray:
    """(E, K) spectrum of the call's echoes at the ears, each path with its own speed."""
    alpha = [factors(group, station, 0) for group in groups]
    if not groups:
        return np.zeros((len(station.ear), grid.count), dtype=np.complex128)
    low, high = min(a.min() for a in alpha), max(a.max() for a in alpha)
    if high - low < SPREAD:
        plain = sum_echoes(groups, station, grid, tolerance).spectrum
        return plain * call.spectrum_at(grid.frequency, float(low))
    # Within X(f/α) are phases 2πf·t/α up to the end of the call.
    turns = math.pi * band.high * call.duration * float(high - low) / float(low) ** 2
    count = _points(turns, SAFER * (tolerance or 1e-10))
    shares = [chebyshev.lagrange(count, (2.0 * a - low - high) / (high - low)).T for a in alpha]
    plain = sum_echoes(groups, station, grid, tolerance, weights=shares).spectrum
    factor = (low + high) / 2 + (high - low) / 2 * chebyshev.points(count)
    played = np.array([call.spectrum_at(grid.frequency, float(f)) for f in factor])
    shifted: np.ndarray = np.einsum("ewk,wk->ek", plain, played)
    return shifted


def _points(turns: float, error: float) -> int:
    """Chebyshev points for e^{i·turns·x}: its coefficients are 2·i^n·J_n(turns), DLMF 10.12.3."""
    order = np.arange(1, math.ceil(1.2 * turns) + 60)
    tail = 4.0 * np.cumsum(np.abs(special.jv(order, turns))[::-1])[::-1]
    return int(order[max(int(np.argmax(tail <= error)), 1)])
