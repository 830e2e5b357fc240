"""Trees set by hand, and discs kept free: what somebody decided, beside what a planting draws.

What is drawn is drawn as without them, so setting, moving or removing one tree moves no other. A tree set by
hand has a number below 0 (-1 for the first), and its own streams for what its planting does not say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..base.rng import stream
from ..spec import Clearing, HandTree, Planting
from .intensity.terrain import GroundSurface


@dataclass(frozen=True)
class SetTrees:
    """The M trees of a planting that were set by hand and have ground below them.

    position : (M, 3) metres. rotation : (M,) radians. scale, variant : (M,). number : (M,) int64, -1 for the
    first that the planting names. off_ground : how many have no ground.
    """

    position: np.ndarray
    rotation: np.ndarray
    scale: np.ndarray
    variant: np.ndarray
    number: np.ndarray
    off_ground: int


def set_trees(seed: int, label: str, planting: Planting, ground: GroundSurface) -> SetTrees:
    """Return the trees of a planting that were set by hand; ``label`` is the planting's name."""
    trees = planting.by_hand
    count = len(trees)

    def draw(purpose: str) -> np.ndarray:
        return stream(seed, "stand", label, "hand", purpose).random(count)

    low, high = planting.scale
    variant = np.floor(draw("variant") * planting.variants)
    place = np.array([tree.position for tree in trees], dtype=float).reshape(-1, 2)
    height = ground.height(place)
    stands = np.isfinite(height)
    return SetTrees(
        position=np.column_stack([place, height])[stands],
        rotation=_given(np.deg2rad(_said(trees, "rotation_deg")), 2 * np.pi * draw("turn"))[stands],
        scale=_given(_said(trees, "scale"), low * (high / low) ** draw("size"))[stands],
        variant=_given(_said(trees, "variant") % planting.variants, variant)[stands].astype(int),
        number=-1 - np.flatnonzero(stands),
        off_ground=int((~stands).sum()),
    )


def told_of(planting: Planting, numbers: np.ndarray, name: str) -> np.ndarray:
    """(M,) what trees set by hand, by their numbers (M,), say of themselves; NaN where nothing."""
    return _said(planting.by_hand, name)[-1 - numbers]


def is_cleared(place: np.ndarray, clearings: Sequence[Clearing]) -> np.ndarray:
    """(N,) bool, which places (N, 2) lie within a clearing, its edge included."""
    found = np.zeros(len(place), dtype=bool)
    for disc in clearings:
        apart = place - np.array(disc.position)
        found |= (apart**2).sum(axis=1) <= disc.radius**2
    return found


def _said(trees: Sequence[HandTree], name: str) -> np.ndarray:
    values = [getattr(tree, name) for tree in trees]
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def _given(said: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(said), said, drawn)
