"""A species to a skeleton with leaves: the one door to every way in which a tree can grow."""

from __future__ import annotations

import numpy as np

from ..spec import Species
from .grammar import T20, derive
from .skeleton import LeafSites, Skeleton
from .turtle import interpret


def skeleton_of(species: Species, rng: np.random.Generator) -> tuple[Skeleton, LeafSites]:
    """All wood of one tree as segments, and where its leaves sit; foot at the origin, z up."""
    symbols = derive(T20, species.grammar.generations)
    return interpret(symbols, species.grammar, species.jitter, rng), LeafSites.none()
