"""Light of a cloud's returns from their intensities: scale, reflectances and the threshold of detection.

Intensities count decibels of reflectance. Where a file does not tell how many, its pulses of two returns do,
one of a crown and one of the ground: what the crown took the ground lacks, so the light of both, each over
that of single returns of its kind, sums to one (Armston et al. 2013, Remote Sens. Environ. 134, 24), or to
what it sums to in a cloud of the same place whose scale is known: single returns of crowns are not all whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from ..own_cloud import CloudReturns

FULL = 65535.0
FAINTEST = 0.05  # share of the echoes that are taken for the threshold
CROWN, GROUND = 8.0, 0.4  # m: returns above are of crowns, below of the ground
SPANS = (5.0, 80.0)  # dB, between which a scale is looked for
SPHERICAL = (
    2 / 3
)  # light from Lambertian facets that are inclined like a sphere's, over that of a plate


@dataclass(frozen=True)
class IntensityScale:
    """Decibels of reflectance that intensities 0 and 65535 stand for."""

    low: float
    high: float

    def reflectance(self, intensity: np.ndarray) -> np.ndarray:
        """(N,) of intensities (N,): that of a facing plate which sends as much back."""
        level = self.low + (self.high - self.low) * np.asarray(intensity) / FULL
        return np.asarray(10 ** (level / 10))


def span_of(
    crown: np.ndarray, ground: np.ndarray, alone: tuple[float, float], total: float = 1.0
) -> float:
    """Decibels between intensities 0 and 65535 that make the light of two returns of a pulse ``total``.

    crown, ground : (P,) intensities of both returns. alone : median intensities of single returns of crowns
    and of the ground.
    """
    return float(
        brentq(lambda span: _sum_of(crown, ground, alone, span) - total, *SPANS, xtol=0.01)
    )


def _sum_of(
    crown: np.ndarray, ground: np.ndarray, alone: tuple[float, float], span: float
) -> float:
    """Light of two returns, each over that of single ones of its kind: the median of their sums."""
    each = [
        10 ** (span * (i - full) / FULL / 10)
        for i, full in zip((crown, ground), alone, strict=True)
    ]
    return float(np.median(each[0] + each[1]))


def light_of_two(returns: CloudReturns, height: np.ndarray, scale: IntensityScale) -> float:
    """Light of two returns, of a crown and of the ground, over single ones': of a cloud of known scale."""
    crown, ground = _shared(returns, height)
    return _sum_of(crown, ground, singles(returns, height), scale.high - scale.low)


def scale_of(
    returns: CloudReturns, height: np.ndarray, ground: float, total: float = 1.0
) -> IntensityScale:
    """The scale of a cloud, heights (N,) m, whose ground reflects this share.

    total : what the light of two returns sums to, of single ones'.
    """
    alone = singles(returns, height)
    span = span_of(*_shared(returns, height), alone, total)
    high = 10 * np.log10(ground) + span * (1 - alone[1] / FULL)
    return IntensityScale(high - span, high)


def _shared(returns: CloudReturns, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P,) intensities of pulses that a crown and the ground share, and no other."""
    row = np.flatnonzero((returns.number[:-1] == 1) & (returns.count[:-1] == 2))
    both = (returns.number[row + 1] == 2) & (height[row] > CROWN) & (height[row + 1] < GROUND)
    if returns.time is not None:
        both &= returns.time[row] == returns.time[row + 1]
    row = row[both]
    return returns.intensity[row], returns.intensity[row + 1]


def singles(returns: CloudReturns, height: np.ndarray) -> tuple[float, float]:
    """Median intensities of single returns of crowns, and of the ground."""
    alone = returns.count == 1
    crown, ground = alone & (height > CROWN), alone & (height < GROUND)
    return float(np.median(returns.intensity[crown])), float(np.median(returns.intensity[ground]))


def reflectances(
    returns: CloudReturns, height: np.ndarray, scale: IntensityScale, zenith: float
) -> tuple[float, float]:
    """Reflectance of leaves, inclined like a sphere's, and of level ground, of beams at ``zenith`` degrees.

    What leaves that fill a beam send back is two thirds of what a facing plate would.
    """
    crown, ground = scale.reflectance(np.array(singles(returns, height)))
    return float(crown / SPHERICAL), float(ground / np.cos(np.deg2rad(zenith)))


def threshold(
    returns: CloudReturns, line: np.ndarray, far: np.ndarray, scale: IntensityScale
) -> float:
    """Light, 1/m², of the faintest twentieth of the echoes of several of a pulse: the median of the lines.

    line, far : (N,) number of its line and range, m; inf where it is not known. What lies at the lower end
    of the scale is not counted.
    """
    light = scale.reflectance(returns.intensity) / far**2
    several = (returns.count > 1) & (returns.intensity > 0)
    seen = [
        float(np.quantile(light[several & (line == number)], FAINTEST))
        for number in np.unique(line).tolist()
        if np.isfinite(far[line == number]).all()
    ]
    return float(np.median(seen))
