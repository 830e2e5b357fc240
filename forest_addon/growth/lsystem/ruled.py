"""A species' rules to a tree: derive the string, read it with the dialect, walk it, prune it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...base.rng import daughter_keys
from ...spec import MAX_REACH, Leaf, Rules
from ..draw import draw_normal
from ..skeleton import LeafSites, Skeleton
from .system import Prediction, System, Word, predict, read_constants, read_system, rewrite, written
from .turtle import DIALECTS, Bend, Commands, prune_descending, read_commands, walk

MAX_WALKED = 10_000_000  # symbols; a tree needs about 150 bytes a symbol


def system_of(rules: Rules) -> System:
    """The L-system that rules describe.

    Raises
    ------
    GrammarError : they cannot be read; says where.
    """
    constants = {"N": float(rules.generations), **read_constants(rules.constants)}
    return read_system(rules.axiom, rules.productions, constants, DIALECTS[rules.dialect].notation)


def grow_ruled(
    rules: Rules, leaf: Leaf, key: int, rng: np.random.Generator
) -> tuple[Skeleton, LeafSites]:
    """The skeleton and leaves of one tree in metres.

    key : lineage of the tree, from which sizes of leaves are drawn. rng : draws of the productions.
    """
    word = _derive_to_walk(rules, rng)
    walked = walk(_commands(rules, word), rules.diameter, Bend(rules.tropism, rules.elasticity))
    if rules.prune_descending:
        walked = prune_descending(walked)
    skeleton, leaves = walked.skeleton, walked.leaves
    scaled = replace(
        skeleton,
        start=skeleton.start * rules.scale,
        end=skeleton.end * rules.scale,
        radius=skeleton.radius * rules.scale,
    )
    reach = float(np.abs(scaled.end).max(initial=0.0))
    if reach > MAX_REACH:
        raise ValueError(
            f"branches reach {written(reach)} m from the foot, more than {MAX_REACH:g} m; "
            "use a smaller scale, smaller ratios or fewer generations"
        )
    return scaled, _sized(leaves, leaf, key, rules.scale) if leaf.on else LeafSites.none()


def _derive_to_walk(rules: Rules, rng: np.random.Generator) -> Word:
    """The string, refused before it is derived where it would be too long to walk."""
    system = system_of(rules)
    size = predict(system, rules.generations)
    if system.conditional or size.symbols <= MAX_WALKED:
        word = rewrite(system, rules.generations, rng)
        if len(word) <= MAX_WALKED:
            return word
        size = Prediction(len(word), 0, True)
    about = "" if size.exact else "about "
    raise ValueError(
        f"{rules.generations} generations make {about}{written(size.symbols)} symbols, more than the "
        f"{MAX_WALKED:,} that fit in memory as a tree; use fewer generations"
    )


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
