"""A species' rules to a tree: derive the string, read it with the dialect, walk it, prune it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..rng import daughter_keys
from ..spec import Leaf, Rules
from .dialect import DIALECTS, Commands, read_commands
from .draw import draw_normal
from .production import System, read_constants, read_system
from .prune import prune_descending
from .rewrite import rewrite
from .skeleton import LeafSites, Skeleton
from .walk import Bend, walk
from .word import Word


def system_of(rules: Rules) -> System:
    """The L-system that rules describe.

    Raises
    ------
    GrammarError : they cannot be read; says where.
    """
    constants = {"N": float(rules.generations), **read_constants(rules.constants)}
    return read_system(rules.axiom, rules.productions, constants, DIALECTS[rules.dialect].notation)


def derive_rules(rules: Rules, rng: np.random.Generator | None = None) -> Word:
    """The string of rules after their generations.

    Raises
    ------
    ValueError : rules that cannot be read, or a string that would be too long.
    """
    return rewrite(system_of(rules), rules.generations, rng)


def grow_ruled(
    rules: Rules, leaf: Leaf, key: int, rng: np.random.Generator
) -> tuple[Skeleton, LeafSites]:
    """The skeleton and leaves of one tree in metres.

    key : lineage of the tree, from which sizes of leaves are drawn. rng : draws of the productions.
    """
    commands = _commands(rules, derive_rules(rules, rng))
    walked = walk(commands, rules.diameter, Bend(rules.tropism, rules.elasticity))
    if rules.prune_descending:
        walked = prune_descending(walked)
    skeleton, leaves = walked.skeleton, walked.leaves
    scaled = replace(
        skeleton,
        start=skeleton.start * rules.scale,
        end=skeleton.end * rules.scale,
        radius=skeleton.radius * rules.scale,
    )
    return scaled, _sized(leaves, leaf, key, rules.scale) if leaf.on else LeafSites.none()


def check_rules(rules: Rules) -> None:
    """Read all of the rules without growing anything.

    Raises
    ------
    GrammarError, ExpressionError : they cannot be read; says where.
    """
    _commands(rules, system_of(rules).axiom)


def _commands(rules: Rules, word: Word) -> Commands:
    known = {
        "length": rules.length,
        "angle": rules.angle_deg,
        "rotation": rules.rotation_deg,
        "thinning": rules.thinning,
        "N": float(rules.generations),
        **read_constants(rules.constants),
    }
    return read_commands(word, (*DIALECTS[rules.dialect].symbols, *rules.symbols), known)


def _sized(leaves: LeafSites, leaf: Leaf, key: int, scale: float) -> LeafSites:
    """Leaves with their length and width: what the string says, else drawn."""
    keys = daughter_keys(np.full(len(leaves), key, np.uint64), np.arange(len(leaves)))
    drawn = draw_normal(leaf.length, keys, "leaf length")
    length = np.where(np.isnan(leaves.length), drawn, leaves.length * scale)
    ratio = draw_normal(leaf.width_ratio, keys, "leaf width")
    width = np.where(np.isnan(leaves.width), length * ratio, leaves.width * scale)
    return replace(leaves, foot=leaves.foot * scale, length=length, width=width)
