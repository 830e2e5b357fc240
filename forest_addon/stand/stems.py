"""Trees that are cylinders only: positions and radii straight from the plan, nothing grown.

Each group is a binomial process: exactly as many as asked for, evenly at random over the field, as the
forests of Kaneko & Gamper (2021). Groups have streams of their own, keyed by their number.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.rng import stream
from ..growth.draw import draw_normal
from ..spec import Forest, Stems


def plant_stems(
    seed: int, forest: Forest, groups: Sequence[Stems]
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 2) and radii (N,) in metres of all groups."""
    positions, radii = [np.empty((0, 2))], [np.empty(0)]
    low = np.array(forest.origin)
    for number, group in enumerate(groups):
        place = stream(seed, "stems", number, "place")
        positions.append(place.uniform(low, low + forest.size, (group.count, 2)))
        keys = stream(seed, "stems", number, "radius").integers(2**63, size=group.count)
        radii.append(draw_normal(group.radius, keys.astype(np.uint64), "radius"))
    return np.concatenate(positions), np.concatenate(radii)
