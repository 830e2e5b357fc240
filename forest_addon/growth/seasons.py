"""Age and season of the trees of a planting: a species when younger or older, and leaves that fall.

Stems and branches keep elastic similarity (McMahon, T. 1973. Size and shape in biology. Science 179,
1201): their lengths go with the power 2/3 of their diameters, which grow in proportion to age. With each
halving of its age a tree that is branched by rules has one generation fewer. Trees of templates keep what
their allometry says (``own_tree.size``); of trees that are grown to measure the stand has the diameters
(``stand.measured``).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..base.trimesh import LEAF
from ..spec import Discrete, Normal, Species
from .tree import Tree, without_leaves

ELASTIC = 2 / 3  # power of a diameter that a length goes with
TURNED = 0.5  # season at which all leaves have turned and begin to fall
OLDEST = (0.2, 3.0)  # of what a template's tree can be made


def aged(species: Species, age: float) -> Species:
    """The species at so many times its age; one that is grown to measure is left as it is."""
    if age == 1 or species.targets is not None:
        return species
    long, fewer = age**ELASTIC, min(0, round(math.log2(age)))
    if species.siblings is not None:
        own = species.siblings
        if own.height or own.dbh:
            return species.changed(
                siblings=own.changed(height=own.height * long, dbh=own.dbh * age)
            )
        older = min(max(own.age * age, OLDEST[0]), OLDEST[1])
        return species.changed(siblings=own.changed(age=older))
    if species.rules is not None:
        rules = species.rules
        generations = max(1, rules.generations + fewer)
        return species.changed(
            rules=rules.changed(scale=rules.scale * long, generations=generations)
        )
    if species.honda is not None:
        honda = species.honda
        levels = tuple(max(1, level + fewer) for level in honda.levels.values)
        return species.changed(
            honda=honda.changed(
                levels=Discrete(values=levels, weights=honda.levels.weights),
                length=_times(honda.length, long),
                radius=_times(honda.radius, age),
            )
        )
    own_rules = species.grammar
    return species.changed(
        grammar=own_rules.changed(
            length=own_rules.length * long,
            radius=own_rules.radius * age,
            generations=max(1, own_rules.generations + fewer),
        )
    )


def in_season(species: Species, season: float) -> Species:
    """The species with its leaves turned as they are in a season, 0 summer to 1 winter."""
    turned = max(species.look.autumn, min(1.0, season / TURNED))
    return species if not season else species.changed(look=species.look.changed(autumn=turned))


def fallen(season: float) -> float:
    """Share of the leaves that lies on the ground in a season."""
    return max(0.0, (season - TURNED) / (1 - TURNED))


def with_fallen(tree: Tree, share: float, rng: np.random.Generator) -> Tree:
    """The tree without this share of its leaves; one that has fallen is also gone at a larger share."""
    if share <= 0 or not len(tree.leaves):
        return tree
    if share >= 1:
        return without_leaves(tree)
    stays = rng.random(len(tree.leaves)) >= share
    mesh = tree.mesh
    stays_there = np.ones(len(mesh.leaf), dtype=bool)
    of_leaf = (mesh.part == LEAF) & (mesh.leaf >= 0)
    stays_there[of_leaf] = stays[mesh.leaf[of_leaf]]
    left = mesh.select(stays_there)
    number = np.cumsum(stays) - 1
    leaf = np.where(left.leaf >= 0, number[left.leaf], -1).astype(left.leaf.dtype)
    kept = tree.leaves.select(stays)
    return replace(tree, mesh=replace(left, leaf=leaf), leaves=kept)


def _times(spread: Normal, factor: float) -> Normal:
    said = {"mean": spread.mean, "sd": spread.sd, "low": spread.low, "high": spread.high}
    return Normal(**{name: v if v is None else v * factor for name, v in said.items()})
