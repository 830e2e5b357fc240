"""Coarser leaves of far trees in a sensor's own units: how far a ray's first range moves.

Parallel rays go through a tree with all of its leaves and through its coarse variant, from all sides, in
float64. What they find apart is what a scanner's ranges there are off by, since each single ray meets other
leaves: no bound holds for every ray, so that is told which holds for nine in ten, from one half of the rays
and confirmed by the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..growth.tree import Tree
from .rays.exact import ExactCaster
from .rays.geometry import SceneGeometry

RAYS = 1000  # of a variant
MOST = 4  # variants that are looked at
SHARE = 0.9  # of the rays that meet a tree both times


@dataclass(frozen=True)
class RangeShift:
    """First ranges of rays through a tree with all leaves and through its coarse variant.

    median, most : metres that these are apart, in the middle and in nine of ten rays that meet both.
    confirmed : share of the other half of the rays for which ``most`` holds. passing : share of rays through
    the crown that pass the one and meet the other. rays : how many met both.
    """

    median: float
    most: float
    confirmed: float
    passing: float
    rays: int


def range_shift(pairs: Sequence[tuple[Tree, Tree]], rng: np.random.Generator) -> RangeShift:
    """Of pairs of a full and a coarse tree, at most ``MOST`` of them drawn at random."""
    drawn = rng.permutation(len(pairs))[:MOST]
    apart, parted, count = [], 0, 0
    for number in drawn.tolist():
        full, coarse = pairs[number]
        origins, ways = _rays(full, rng)
        ours, theirs = (_caster(tree).cast(origins, ways) for tree in (full, coarse))
        both = ours.found & theirs.found
        apart.append(np.abs(ours.distance[both] - theirs.distance[both]))
        parted += int((ours.found != theirs.found).sum())
        count += int((ours.found | theirs.found).sum())
    off = rng.permutation(np.concatenate([*apart, np.empty(0)]))
    if len(off) < 2:
        return RangeShift(0.0, 0.0, 1.0, 0.0, len(off))
    first, second = np.array_split(off, 2)
    most = float(np.quantile(first, SHARE))
    confirmed = float((second <= most).mean())
    return RangeShift(float(np.median(off)), most, confirmed, parted / max(count, 1), len(off))


def _rays(tree: Tree, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions (RAYS, 3) of rays to places of random leaves, from all sides."""
    ways = rng.normal(size=(RAYS, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    places = tree.leaves.centre[rng.integers(0, len(tree.leaves), RAYS)]
    size = float(tree.leaves.radius.max(initial=0.0))
    places = places + rng.normal(size=(RAYS, 3)) * 2.0 * size  # beside leaves, not at them
    far = 2.0 * float(np.ptp(tree.mesh.vertices, axis=0).max(initial=1.0))
    return places - far * ways, ways


def _caster(tree: Tree) -> ExactCaster:
    one = np.zeros(1, dtype=np.int64)
    return ExactCaster(SceneGeometry((tree.mesh,), np.eye(3, 4)[None], one, ("tree",), one, one))
