"""Loudspeakers of the recordings, as far as they are known.

Koli was recorded with four Genelec 8130A that point to four sides ("in an attempt to better approximate an
omni-directional source", OpenAIR), Jura with one portable JBL that points along the transect and whose
directivity is not published. Both are taken as a Genelec 8030C, of the 8130A's drivers and size, as measured
in the horizontal plane (Audio Science Review, in the collection *spinorama*): its power index from these
levels is 3, 5.1, 7.0, 6.9, 7.4 dB at 500 Hz to 8 kHz, the measured one 3.0, 5.1, 5.5, 7.0, 7.6 dB.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from forest_addon.sensing.reverb.directivity import Directivity

HZ = np.array([500.0, 1000.0, 2000.0, 4000.0, 8000.0])
ANGLES = np.radians(np.arange(0.0, 181.0, 20.0))
LEVELS = np.array(  # dB re the axis, every 20 degrees; 500 Hz by the power index alone
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [-0.1, -0.5, -0.8, -0.2, -0.5],
        [-0.6, -1.9, -2.9, -2.0, -2.2],
        [-1.3, -4.0, -5.7, -5.5, -6.0],
        [-2.4, -5.6, -8.9, -9.5, -11.3],
        [-4.0, -6.6, -11.5, -13.4, -16.5],
        [-6.2, -8.1, -16.0, -16.2, -20.5],
        [-9.6, -13.0, -12.8, -17.8, -23.3],
        [-15.6, -15.2, -19.5, -18.8, -24.5],
        [-30.0, -12.6, -24.0, -19.8, -28.0],
    ]
)
MONITOR = Directivity(ANGLES, HZ, 10.0 ** (LEVELS / 20.0))
SIDES = np.radians([0.0, 90.0, 180.0, 270.0])


@lru_cache(maxsize=1)
def ring() -> Directivity:
    """Four monitors that point to four sides, mean over azimuths, re where one points; the axis is up."""
    azimuth = np.radians(np.arange(0.0, 360.0, 5.0))
    steep = np.radians(np.arange(0.0, 181.0, 10.0))  # from the vertical

    def energy(slope: float, turned: np.ndarray, hz: float) -> float:
        cosine = np.sin(slope) * np.cos(turned[:, None] - SIDES).ravel()
        gain = MONITOR.around(cosine, hz).reshape(len(turned), len(SIDES))
        return float((gain**2).sum(axis=1).mean())

    found = [
        [energy(s, azimuth, hz) / energy(0.5 * np.pi, np.zeros(1), hz) for hz in HZ.tolist()]
        for s in steep.tolist()
    ]
    return Directivity(steep, HZ, np.sqrt(np.array(found)))
