"""Waves among points that scatter all ways alike, exactly (Foldy 1945, Lax 1951): every echo between all."""

from __future__ import annotations

import numpy as np


def received(
    k: float, points: np.ndarray, source: np.ndarray, receivers: np.ndarray, section: float
) -> np.ndarray:
    """(R,) scattered pressure of a source 1/r; section : m², of each point, at most 4π/k²."""
    sine = k * np.sqrt(section / (4 * np.pi))
    amplitude = sine / k * np.exp(1j * np.arcsin(sine))  # Im f = k|f|²: energy is kept

    def green(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        r = np.linalg.norm(a[:, None] - b[None], axis=2)
        return np.exp(1j * k * r) / np.where(r > 0, r, np.inf)

    coupled = np.eye(len(points)) - amplitude * green(points, points)
    exciting = np.linalg.solve(coupled, green(points, source[None])[:, 0])
    return green(receivers, points) @ (amplitude * exciting)
