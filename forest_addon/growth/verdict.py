"""The verdict on a fitted grammar: do its siblings stand, and are they like the tree that was brought?

Siblings are grown and measured without their meshes. They should be as high, wide, stout and leafy in the
mean as the tree, to 10 %, with its numbers of branches and its profiles, lean at most 10° more than it does,
stay out of the ground, and have every branch on its parent. Where they are not, variety is lowered step by
step. What then is still off by more than twice what is allowed speaks against planting them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.rng import stream
from ..spec import Siblings
from .likeness import LEAST_OVERLAP, MOST_DIFFERENCE, Likeness, compare
from .portrait import portray
from .regrow.fitted import Habit
from .regrow.relay import outline_of
from .regrow.sibling import Grown, grow_sibling
from .regrow.standing import SiblingStanding, lowest_corner, standing_of

VARIETIES = (1.0, 0.7, 0.5, 0.3, 0.15)  # tried one after the other
FEWEST = 24  # siblings that tell
REFUSED = 2.0  # times what is allowed
JUDGED = ("height", "crown width", "crown base", "DBH", "wood volume", "leaf area", "branches of")
ONE_BRANCH = 1.0  # that a mean number of branches may be off in any case
MOST_LEAN, MOST_SUNK, MOST_GAP = np.deg2rad(10.0), 0.05, 1e-3
MOST_THICKER = 0.02  # of the parent's radius, more than in the tree
MESHED = 5  # siblings whose meshes are looked at
TOLD = 4  # goals that a sentence names at most


@dataclass(frozen=True)
class Miss:
    """A goal that siblings miss: in words, and how many times what is allowed they are off."""

    words: str
    times: float


@dataclass(frozen=True)
class Verdict:
    """Comparison of siblings with the tree, and what it speaks against.

    variety : the largest of ``VARIETIES`` that meets all goals, or that which comes nearest.
    siblings : how many were grown. missed : goals that they miss, the worst first.
    """

    variety: float
    siblings: int
    likeness: Likeness
    missed: tuple[Miss, ...]

    @property
    def stands(self) -> bool:
        """True where they may be planted: no goal is missed by more than twice what is allowed."""
        return not self.missed or self.missed[0].times <= REFUSED

    @property
    def sentence(self) -> str:
        """One sentence that says what is missed; empty where nothing is."""
        if not self.missed:
            return ""
        told = "; ".join(miss.words for miss in self.missed[:TOLD])
        more = len(self.missed) - TOLD
        return f"siblings are not like the tree: {told}" + (f"; {more} more" if more > 0 else "")


def judge(habit: Habit, settings: Siblings, count: int) -> Verdict:
    """Grow so many siblings by a grammar, ``FEWEST`` at least, of less and less variety until they are like
    the tree.
    """
    count = max(count, FEWEST)
    itself = grow_sibling(habit, Siblings(variety=0.0), 0)
    one = portray(outline_of(habit.anatomy, itself, 0.0))
    own, low = standing_of(itself), lowest_corner(habit.anatomy, itself, 0.0)
    keys = [
        int(stream(0, "template", "sibling", number).integers(2**63)) for number in range(count)
    ]
    verdicts = []
    for variety in VARIETIES:
        varied = Siblings(variety=variety, allometry=settings.allometry)
        grown = [grow_sibling(habit, varied, key) for key in keys]
        portraits = [portray(outline_of(habit.anatomy, tree, variety)) for tree in grown]
        likeness = compare(one, portraits)
        missed = [*_unlike(likeness), *_unsound(own, [standing_of(tree) for tree in grown])]
        missed += _sunk(habit, low, grown[:MESHED], variety)
        missed.sort(key=lambda miss: -miss.times)
        verdicts.append(Verdict(variety, count, likeness, tuple(missed)))
        if not missed:
            break
    return min(verdicts, key=lambda verdict: verdict.missed[0].times if verdict.missed else 0.0)


def _unlike(likeness: Likeness) -> list[Miss]:
    """Means and profiles that are off."""
    missed = []
    for row in likeness.numbers:
        if not row.name.startswith(JUDGED):
            continue
        allowed = max(MOST_DIFFERENCE * abs(row.template), row.room)
        if row.name.startswith("branches"):
            allowed = max(allowed, ONE_BRANCH)
        times = abs(row.mean - row.template) / max(allowed, 1e-12)
        if times > 1:
            name = row.name.split(",")[0]
            words = f"{name} {100 * row.difference:+.0f} % ({100 * MOST_DIFFERENCE:.0f} % allowed)"
            missed.append(Miss(words, times))
    for profile in likeness.profiles:
        times = (1 - profile.overlap) / (1 - LEAST_OVERLAP)
        if times > 1:
            words = f"{profile.name} over height overlaps by {profile.overlap:.2f} ({LEAST_OVERLAP} wanted)"
            missed.append(Miss(words, times))
    return missed


def _unsound(own: SiblingStanding, found: list[SiblingStanding]) -> list[Miss]:
    """Trunks that lean, and branches that are off their parents or thicker than these."""
    missed = []
    lean, gap = max(one.lean for one in found), max(one.gap for one in found)
    thicker = max(one.thicker for one in found)
    if lean > own.lean + MOST_LEAN:
        words = f"a trunk leans {np.rad2deg(lean):.0f}° ({np.rad2deg(own.lean):.0f}° in the tree)"
        missed.append(Miss(words, float((lean - own.lean) / MOST_LEAN)))
    if gap > MOST_GAP:
        words = f"a branch begins {1000 * gap:.0f} mm off its parent (1 mm allowed)"
        missed.append(Miss(words, gap / MOST_GAP))
    if thicker > max(own.thicker, 1.0) + MOST_THICKER:
        words = f"a branch is {thicker:.1f} times as thick as its parent ({own.thicker:.1f} in the tree)"
        missed.append(Miss(words, (thicker - max(own.thicker, 1.0)) / MOST_THICKER))
    return missed


def _sunk(habit: Habit, low: float, grown: list[Grown], variety: float) -> list[Miss]:
    """Parts below the ground, deeper than the tree's own roots are."""
    deepest = min(lowest_corner(habit.anatomy, tree, variety) for tree in grown)
    below = min(low, 0.0) * (1 + MOST_DIFFERENCE) - deepest
    if below <= MOST_SUNK:
        return []
    words = (
        f"a branch reaches {100 * below:.0f} cm into the ground ({100 * MOST_SUNK:.0f} cm allowed)"
    )
    return [Miss(words, below / MOST_SUNK)]
