"""One species of a mapped site: what was estimated of it, for its line, its scene and its picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from forest_addon.spec import Planting
from forest_addon.stand.statistics.goodness import Estimate, Goodness


@dataclass(frozen=True)
class SpeciesOfSite:
    """Its trees (N, 2), in metres from the offset, and what was estimated."""

    name: str
    points: np.ndarray
    estimate: Estimate
    planting: Planting
    goodness: Goodness | None
