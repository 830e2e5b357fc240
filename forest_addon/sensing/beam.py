"""How loud a sonar is in a direction: a Gaussian beam about its axis.

Directions go in, the amplitude relative to the axis comes out: exp(-az²/2σ_x² - el²/2σ_y²) (T20), with
σ from the full -3 dB width. The offsets az and el are measured from the beam axis in the sonar's own
frame: the angle off the axis is laid out along the side to which the direction lies off. So they are
the plain azimuth and elevation in the two planes of the axis, have neither pole nor wrap, and a beam
that looks straight up is like any other.
"""

from __future__ import annotations

import math

import numpy as np

HALF_POWER = -2.0 * math.log(10.0 ** (-3.0 / 20.0))  # T20 print -2·ln 0.7079


def beam_gain(
    directions: np.ndarray, azimuth: float, elevation: float, width: tuple[float, float]
) -> np.ndarray:
    """(L,) amplitude, 1 on the axis, towards unit directions (L, 3), one way.

    azimuth, elevation : of the axis, radians; from +X towards +Y, and up from the horizon.
    width : full -3 dB width in azimuth and elevation, radians.
    """
    az, el = beam_offsets(directions, azimuth, elevation)
    across, along = (half / 2.0 / math.sqrt(HALF_POWER) for half in width)
    gain: np.ndarray = np.exp(-0.5 * ((az / across) ** 2 + (el / along) ** 2))
    return gain


def beam_offsets(
    directions: np.ndarray, azimuth: float, elevation: float
) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation (L,) off the axis, radians; their hypotenuse is the angle off the axis.

    Positive to the left and up. Straight behind, where the side is open, all of it is azimuth.
    """
    forward, left, up = beam_frame(azimuth, elevation) @ directions.T
    side = np.hypot(left, up)
    angle = np.arctan2(side, forward)
    aside = side > 0
    share = np.where(aside, angle, 0.0) / np.where(aside, side, 1.0)
    return np.where(aside, share * left, angle), share * up


def beam_frame(azimuth: float, elevation: float) -> np.ndarray:
    """(3, 3) rows: the axis, to its left (level), and up; defined for a vertical axis too."""
    ca, sa = math.cos(azimuth), math.sin(azimuth)
    ce, se = math.cos(elevation), math.sin(elevation)
    return np.array([[ce * ca, ce * sa, se], [-sa, ca, 0.0], [-se * ca, -se * sa, ce]])
