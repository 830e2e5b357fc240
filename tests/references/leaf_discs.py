"""Leaves as discs at given places, for tests of echoes."""

from __future__ import annotations

from typing import Any

import numpy as np

from forest_addon.sensing.sonar.leaves import LeafDiscs


def discs_of(centre: Any, normal: Any, radius: Any) -> LeafDiscs:
    """Discs at (L, 3), facing (L, 3) or (3,), of radius (L,) or one."""
    centre = np.asarray(centre, np.float64).reshape(-1, 3)
    count = len(centre)
    normal = np.broadcast_to(np.asarray(normal, np.float64), (count, 3))
    index = np.arange(count)
    return LeafDiscs(
        centre,
        normal / np.linalg.norm(normal, axis=1, keepdims=True),
        np.broadcast_to(np.asarray(radius, np.float64), (count,)),
        np.zeros(count, np.int64),
        index,
        np.zeros(count, np.int64),
    )
