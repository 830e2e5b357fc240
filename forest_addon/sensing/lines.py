"""Lines that show where a sensor looks: chains of segments, and rays from a place.

Points in world coordinates, metres, go in, line segments come out; they can be drawn while a slider moves.
"""

from __future__ import annotations

import numpy as np

AROUND = 64  # segments of a full circle


def chain(points: np.ndarray) -> np.ndarray:
    """(N - 1, 2, 3) segments along points (N, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1)


def rays_to(point: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(N, 2, 3) segments from a point to ends (N, 3)."""
    return np.stack([np.broadcast_to(point, ends.shape), ends], axis=1)
