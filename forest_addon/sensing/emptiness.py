"""Reasons why a sensor found nothing, in a sentence: nothing there, nothing in reach, nothing met."""

from __future__ import annotations

import numpy as np

from .rays.geometry import SceneGeometry


def why_nothing(found: str, points: np.ndarray, reach: float, scene: SceneGeometry) -> str:
    """Say that a sensor found nothing, and why.

    found : the nothing in words, as "0 points". points : (P, 3) m, where it was. reach : m, beyond which it
    finds nothing.
    """
    gap = nearest(points, scene)
    if not np.isfinite(gap):
        return f"{found}: there is nothing in the scene"
    if gap > reach:
        return (
            f"{found}: the nearest thing is {gap:,.4g} m away and it reaches {reach:,.4g} m; go nearer, "
            "or raise max_range"
        )
    return (
        f"{found}: nothing that sends enough back is where it looks; turn it, or widen what it sees"
    )


def nearest(points: np.ndarray, scene: SceneGeometry) -> float:
    """Metres from the nearest of points (P, 3) to the box around the nearest thing; inf without any."""
    low, high = scene.bounds()
    there = np.isfinite(low).all(axis=1)
    if not there.any() or not len(points):
        return float("inf")
    gaps = [
        np.linalg.norm(np.maximum(np.maximum(low[there] - at, at - high[there]), 0.0), axis=1).min()
        for at in np.asarray(points, dtype=np.float64)
    ]
    return float(min(gaps))
