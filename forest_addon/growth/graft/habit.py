"""T20's grammar fitted to a template tree, so that what grows from a user's tree has its habit.

The trunk's first internode is the trunk below the lowest branch, the contraction along the trunk makes up
its length, and angle, thickness and length of the branches are means over the templates.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ...base.rng import stream
from ...spec import Grammar, Jitter
from ..lsystem.grammar import T20, derive
from ..lsystem.turtle import interpret
from .cut import TreeTemplate

COPIES = 2  # sets of branches at a node; each set has two
STILL = Jitter(length=0, angle_deg=0, twist_deg=0, raise_ratio=0, lean_deg=0, leaf_size=0)


def fit_grammar(template: TreeTemplate) -> Grammar:
    """The grammar whose trees look most like the one that the template was taken from."""
    branches = template.branches
    generations = int(np.clip(round(len(branches) / (2 * COPIES)), 2, 10))
    total = template.trunk_length
    length = float(np.clip(branches[0].height, 0.02, 0.9)) * total
    grammar = Grammar(
        generations=generations,
        copies=COPIES,
        length=length,
        side_ratio=1.0,
        centre_ratio=_contraction(total / length, generations),
        angle_deg=float(np.rad2deg(np.median([b.angle for b in branches]))),
        radius=template.trunk_radius,
        radius_ratio=float(
            np.clip(np.median([b.base_radius for b in branches]) / template.trunk_radius, 0.05, 1)
        ),
    )
    wanted = float(np.mean([b.length for b in branches]))
    ratio = float(np.clip(wanted / _mean_reach(grammar), 0.01, 2.0))
    fitted = replace(grammar, side_ratio=ratio)
    return _rounded(fitted)


def _contraction(internodes: float, generations: int) -> float:
    """The ratio c for which 1 + c + ... over all internodes of the trunk is this many first ones."""

    def miss(c: float) -> float:
        return float((c ** np.arange(generations + 1)).sum()) - internodes

    if miss(0.05) >= 0 or miss(1.5) <= 0:
        return 0.05 if miss(0.05) >= 0 else 1.5
    return float(brentq(miss, 0.05, 1.5))


def _mean_reach(grammar: Grammar) -> float:
    """Mean length of the first-level axes of a tree without jitter."""
    skeleton = interpret(derive(T20, grammar.generations), grammar, STILL, stream(0, "habit"))
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    parent_order = skeleton.order[np.maximum(skeleton.parent, 0)]
    firsts = np.flatnonzero((skeleton.order == 1) & (parent_order == 0))
    return float(np.mean([length[skeleton.axis(int(first))].sum() for first in firsts]))


def _rounded(grammar: Grammar) -> Grammar:
    """Four digits: what is fitted is no more exact, and a person will read it."""
    digits: dict[str, Any] = {
        name: float(f"{getattr(grammar, name):.4g}")
        for name in ("length", "side_ratio", "centre_ratio", "angle_deg", "radius", "radius_ratio")
    }
    return replace(grammar, **digits)
