"""Leaves around branches: at an angle to the branch, at an azimuth about it, upper side to the sky."""

from __future__ import annotations

import numpy as np

from ...base.vectors import cross_rows
from ...spec import Leaf
from ..draw import draw_normal
from ..skeleton import LeafSites
from .shapes import HALVES


def set_leaves(
    leaf: Leaf,
    keys: np.ndarray,
    foot: np.ndarray,
    heading: np.ndarray,
    across: np.ndarray,
    azimuth: np.ndarray,
    segment: np.ndarray,
) -> LeafSites:
    """L leaves, their sizes and angles drawn by key.

    foot, heading, across : (L, 3) where they sit, the branch's direction and one at right angles to it.
    azimuth : (L,) radians about the branch, from ``across``.
    segment : (L,) what bears them.
    """
    angle = np.deg2rad(draw_normal(leaf.angle_deg, keys, "leaf angle"))[:, None]
    around = np.cos(azimuth)[:, None] * across
    around = around + np.sin(azimuth)[:, None] * cross_rows(heading, across)
    direction = np.cos(angle) * heading + np.sin(angle) * around
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    blade = draw_normal(leaf.length, keys, "leaf length")
    width = blade * draw_normal(leaf.width_ratio, keys, "leaf width")
    length = blade * (1 + stalk_of(leaf))
    return LeafSites(foot, direction, skyward(direction), length, width, segment)


def stalk_of(leaf: Leaf) -> float:
    """Length of a leaf's stalk over its blade's; 0 of shapes that have none."""
    return leaf.petiole if leaf.shape in HALVES and not leaf.mesh else 0.0


def skyward(direction: np.ndarray) -> np.ndarray:
    """(L, 3) unit vectors at right angles to unit directions, as far up as these allow."""
    up = -direction[:, 2:] * direction
    up[:, 2] += 1.0
    vertical = np.abs(direction[:, 2]) > 1 - 1e-12
    up[vertical] = (1.0, 0.0, 0.0)
    return np.asarray(up / np.linalg.norm(up, axis=1, keepdims=True))


def across(heading: np.ndarray) -> np.ndarray:
    """(L, 3) a horizontal unit vector at right angles to each heading; +X for a vertical one."""
    side = np.stack([-heading[:, 1], heading[:, 0], np.zeros(len(heading))], axis=1)
    size = np.linalg.norm(side, axis=1, keepdims=True)
    return np.where(size > 1e-9, side / np.maximum(size, 1e-9), np.array([1.0, 0.0, 0.0]))
