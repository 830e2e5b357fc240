"""Sound that meets no trunk: an arrival after a path, and whether wood leaves it its way.

A path's length and its gain by frequency go in, samples come out; source, receiver and the scene's wood go
in, two answers come out: whether the direct and the ground's sound pass.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import fft

from ...acoustics.air import absorption
from ...acoustics.spectrum import delay_factors
from ...spec import Air
from ..rays.caster import RayCaster
from .sums.bands import SPREAD, roll_off

Gain = Callable[[np.ndarray], np.ndarray]  # by frequency
GROUND_CLEARANCE = (
    0.05  # m; lower than this, a line of sight is not tested against the ground itself
)
MARGIN = 1e-3  # m; so near its end, a line of sight is not tested
RINGING = 0.25  # s; what a porous ground sends back after that is below 1e-5 of its largest sample


def arrival(
    path: float, gain: Gain, rate: float, count: int, air: Air, rings: float = 0.0
) -> np.ndarray:
    """(count,) samples of one arrival, gain(f)/path·e^{-(b+ik)path}, after ``path`` metres.

    rings : s that it lasts; what comes after the record must not be heard at its begin.
    """
    delay = path / air.speed()
    if (delay - count / rate) * rate > SPREAD:
        return np.zeros(count)
    last = math.ceil((delay + rings) * rate)
    size = fft.next_fast_len(max(count, last) + 2 * SPREAD, real=True)
    frequency = np.arange(size // 2 + 1) * (rate / size)
    loss = absorption(frequency, air.temperature_c, air.humidity, air.pressure_kpa)
    carried = delay_factors(0.0, rate / size, len(frequency), np.array([delay]))[:, 0]
    spectrum = gain(frequency) / path * np.exp(-loss * path) * carried * roll_off(frequency / rate)
    samples: np.ndarray = fft.irfft(spectrum, size)[:count]
    return samples


def lines_of_sight(
    source: np.ndarray, receiver: np.ndarray, wood: RayCaster | None
) -> tuple[bool, bool]:
    """Return whether the direct and the ground sound, from (3,) to (3,), pass the wood.

    The ground sound goes down towards z = 0 and up again; below ``GROUND_CLEARANCE`` its way is cut
    short, so that the ground does not hide itself.
    """
    if wood is None:
        return True, True
    low, high = source[2], receiver[2]
    bounce = source + (receiver - source) * (low / (low + high))
    bounce[2] = 0.0
    down, up = (
        end + (bounce - end) * max(0.0, 1.0 - GROUND_CLEARANCE / end[2])
        for end in (source, receiver)
    )
    start = np.stack([source, source, down, up])
    way = np.stack([receiver, down, up, receiver]) - start
    blocked = wood.occluded(start, way, np.maximum(np.linalg.norm(way, axis=1) - MARGIN, 0.0))
    return not blocked[0], not blocked[1:].any()
