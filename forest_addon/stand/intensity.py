"""Intensity functions: expected trees per square metre over a rectangular field.

λ(x, y) = Σ C·exp(-(x-a)²/h² - (y-b)²/l²), T20's formula in its squared form, or a constant. Its integral
over the field is closed (error functions), so an expected number of trees can be asked for directly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from ..spec import Forest, Planting


@dataclass(frozen=True)
class Intensity:
    """A mixture of Gaussian hills plus a constant, over a field.

    peak : (G,) trees/m². centre, width : (G, 2) metres. constant : trees/m².
    low, high : (2,) corners of the field, metres.
    """

    peak: np.ndarray
    centre: np.ndarray
    width: np.ndarray
    constant: float
    low: np.ndarray
    high: np.ndarray

    def at(self, points: np.ndarray) -> np.ndarray:
        """λ (N,) at points (N, 2); zero outside the field."""
        offset = (points[:, None] - self.centre) / self.width
        value = self.constant + np.exp(-(offset**2).sum(axis=2)) @ self.peak
        inside = ((points >= self.low) & (points <= self.high)).all(axis=1)
        return np.where(inside, value, 0.0)

    def expected(self, low: np.ndarray | None = None, high: np.ndarray | None = None) -> float:
        """∫λ over a rectangle within the field, by default the whole of it."""
        low = self.low if low is None else np.maximum(low, self.low)
        high = self.high if high is None else np.minimum(high, self.high)
        if (high <= low).any():
            return 0.0
        spans = erf((high - self.centre) / self.width) - erf((low - self.centre) / self.width)
        hills = self.peak * np.prod(self.width * np.sqrt(np.pi) / 2 * spans, axis=1)
        return float(hills.sum() + self.constant * np.prod(high - low))

    def scaled(self, factor: float) -> Intensity:
        """λ times a factor."""
        return Intensity(
            self.peak * factor,
            self.centre,
            self.width,
            self.constant * factor,
            self.low,
            self.high,
        )


def intensity_of(planting: Planting, forest: Forest) -> Intensity:
    """The intensity function of a species; ``expected`` scales it to that number of trees.

    Raises
    ------
    ValueError : the hills lie so far outside the field that nothing could be scaled.
    """
    low = np.array(forest.origin)
    intensity = Intensity(
        peak=np.array([g.peak for g in planting.gaussians]),
        centre=np.array([g.centre for g in planting.gaussians]).reshape(-1, 2),
        width=np.array([g.width for g in planting.gaussians]).reshape(-1, 2),
        constant=0.0 if planting.gaussians else 1.0,
        low=low,
        high=low + np.array(forest.size),
    )
    if planting.expected is None:
        return intensity
    total = intensity.expected()
    if total == 0 and planting.expected > 0:
        raise ValueError(
            f"{planting.species}: the gaussians put nothing on the field, so {planting.expected:g} "
            "trees cannot be expected there; move a centre or widen it"
        )
    return intensity.scaled(planting.expected / total if total else 0.0)
