"""Méndez et al.'s pruning: a branch whose turtle descends is removed with all that it bears."""

from __future__ import annotations

import numpy as np

from ..skeleton import LeafSites, Skeleton
from .walk import Walk

LEVEL = 1e-9  # of a segment's length: less than this is not a descent but rounding


def prune_descending(walked: Walk) -> Walk:
    """The walk without the brackets in which a segment ends lower than it starts."""
    skeleton = walked.skeleton
    rise = skeleton.end[:, 2] - skeleton.start[:, 2]
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    removed = np.zeros(len(walked.mother), bool)
    removed[walked.branch[rise < -LEVEL * length]] = True
    removed = _with_all_above(removed, walked.mother)

    kept, kept_leaf = ~removed[walked.branch], ~removed[walked.leaf_branch]
    # What a kept segment hangs on is kept too: it stands in the same branch or in one below.
    number = np.append(np.cumsum(kept) - 1, -1)
    return Walk(
        skeleton=Skeleton(
            start=skeleton.start[kept],
            end=skeleton.end[kept],
            radius=skeleton.radius[kept],
            parent=number[skeleton.parent[kept]],
            order=skeleton.order[kept],
            generation=skeleton.generation[kept],
        ),
        leaves=keep_sites(walked.leaves, kept_leaf, number),
        branch=walked.branch[kept],
        leaf_branch=walked.leaf_branch[kept_leaf],
        mother=walked.mother,
    )


def keep_sites(leaves: LeafSites, kept: np.ndarray, number: np.ndarray) -> LeafSites:
    """The leaves that stay; ``number`` gives segments their new numbers, its last entry is -1."""
    return LeafSites(
        foot=leaves.foot[kept],
        direction=leaves.direction[kept],
        up=leaves.up[kept],
        length=leaves.length[kept],
        width=leaves.width[kept],
        segment=number[leaves.segment[kept]],
    )


def _with_all_above(removed: np.ndarray, mother: np.ndarray) -> np.ndarray:
    """Marks handed on from parents to children, by pointer doubling (deep brackets cost a log)."""
    up = np.maximum(mother, 0)  # branch 0 is its own parent
    while True:
        marked = removed | removed[up]
        further = up[up]
        if (further == up).all() and (marked == removed).all():
            return marked
        removed, up = marked, further
