"""A species to a skeleton with leaves: the one door to every way in which a tree can grow."""

from __future__ import annotations

import numpy as np

from ..spec import Species
from .honda import grow_honda
from .lsystem.tanveer import grow_whole
from .lsystem.turtle import grow_ruled
from .skeleton import LeafSites, Skeleton


def skeleton_of(species: Species, rng: np.random.Generator) -> tuple[Skeleton, LeafSites]:
    """All wood of one tree as segments, and where its leaves sit; foot at the origin, z up.

    Switching leaves off moves no branch.

    Raises
    ------
    ValueError : rules that cannot be read, or a tree that would be too large; says how large.
    """
    key = int(rng.integers(2**63))
    if species.rules is not None:
        return grow_ruled(species.rules, species.leaf, key, rng)
    if species.honda is not None:
        return grow_honda(species.honda, species.leaf, key)
    return grow_whole(species, key, rng)
