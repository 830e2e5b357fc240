"""Trunks where the sound passes them: between ends of different heights, each at a height of its own.

A path from a source by a trunk to a receiver rises evenly over its horizontal way r_s + r_r, so it meets the
trunk at z_s + (z_r - z_s)·r_s/(r_s + r_r). The wood is cut at a ladder of heights; from each cut those
trunks are taken whose path is nearest to that height. So a leaning or tapering stem is where, and as
thick as, the sound meets it, and a tree that the path passes over is not heard.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ...rays.geometry import SceneGeometry
from .slices import Trunks, WeldedWood, trunks_at_height

STEP = 0.5  # m between heights at most, as far as MOST_CUTS go
MOST_CUTS = 24


def heights_between(rise: float) -> int:
    """Return at how many heights the wood is cut between ends of which one is so much higher, metres."""
    return min(MOST_CUTS, max(1, math.ceil(rise / STEP)))


@dataclass
class TrunkCuts:
    """Cuts of one scene, each made once, at least ``min_radius`` metres thick."""

    scene: SceneGeometry
    min_radius: float
    _at: dict[float, Trunks] = field(default_factory=dict)
    _wood: dict[int, WeldedWood] = field(default_factory=dict)

    def between(self, source: np.ndarray, receiver: np.ndarray) -> Trunks:
        """The trunks between two ends (3,)."""
        low, high = float(source[2]), float(receiver[2])
        count = heights_between(abs(high - low))
        if count == 1:
            return self._cut((low + high) / 2)
        parts = []
        for number in range(count):
            trunks = self._cut(low + (high - low) * (number + 0.5) / count)
            first = np.hypot(*(trunks.position - source[:2]).T)
            whole = first + np.hypot(*(trunks.position - receiver[:2]).T)
            share = np.divide(first, whole, out=np.full_like(first, 0.5), where=whole > 0)
            band = np.minimum((share * count).astype(np.int64), count - 1)
            parts.append(trunks.select(band == number))
        return parts[0].with_others(*parts[1:])

    def _cut(self, height: float) -> Trunks:
        if height not in self._at:
            self._at[height] = trunks_at_height(self.scene, height, self.min_radius, self._wood)
        return self._at[height]
