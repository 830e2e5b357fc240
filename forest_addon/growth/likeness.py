"""Likeness of grown trees to the one that they are to be like: portraits, comparisons, and a verdict.

A portrait is a tree in numbers: what a forester measures on it, and how it is spread over its height. It is
taken from all of its wood as segments and the truth of its leaves, so that a template and what is grown
from it are measured alike. Profiles are over height as a share of the tree's own.

A number is compared by its mean over the siblings, in per cent of the template's and in standard
deviations of the siblings. Samples, such as all insertion angles, are pooled and compared by the distance
of Kolmogorov and Smirnov and by that of the earth mover (the area between both distributions, in their own
unit). Profiles are compared by their overlap, Σ min(p, q).

The verdict on a fitted grammar: siblings are grown and measured without their meshes. They should be as high,
wide, stout and leafy in the mean as the tree, to 10 %, with its numbers of branches and its profiles, lean at
most 10° more than it does, stay out of the ground, and have every branch on its parent. Where they are not,
variety is lowered step by step. What then is still off by more than twice what is allowed speaks against
planting them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.rng import stream
from ..base.vectors import unit
from ..spec import Siblings
from .mesh.leaves import Leaves
from .own_tree.anatomy import OFF
from .own_tree.habit import BREAST, Habit
from .own_tree.relay import (
    hold_rings,
    lowest_corner,
    outline_of,
    standing_of,
)
from .own_tree.sibling import Grown, grow_sibling
from .skeleton import Skeleton, find_axes, stem_radii

BINS = 20  # of a vertical profile
SIDES = 18  # from which the width of the crown is measured
LOWEST = 0.02  # share of the leaf area below the base of the crown
SAMPLES = 8  # of a segment's length
MOST_DIFFERENCE, LEAST_OVERLAP, MOST_SPREADS = 0.10, 0.85, 2.0  # the goals
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
class Portrait:
    """One tree.

    numbers : by name and unit. samples : by name, one number a branch. profiles : by name, (BINS,)
    shares that add up to 1, from the ground to the top.
    """

    numbers: dict[str, float]
    samples: dict[str, np.ndarray]
    profiles: dict[str, np.ndarray]


def portray(wood: Skeleton, leaves: Leaves, height: float) -> Portrait:
    """The portrait of a tree, metres high, of which all wood is in the skeleton."""
    first, axis = axes_of(wood)
    order, length = wood.order[first], np.bincount(axis, wood.length)
    angle = insertion_angles(wood)
    area = np.pi * leaves.radius**2
    thick = trunk_radius(wood, min(BREAST, height / 2))
    numbers = {
        "height, m": height,
        "crown width, m": crown_width(wood, leaves),
        "crown base, m": crown_base(wood, leaves, height),
        "DBH, cm": 200 * thick,
        "taper: diameter at half height / DBH": trunk_radius(wood, height / 2) / max(thick, 1e-9),
    }
    samples = {}
    for level in range(1, int(wood.order.max(initial=0)) + 1):
        of_level = order == level
        numbers[f"branches of order {level}"] = float(of_level.sum())
        numbers[f"their length, order {level}, m"] = float(length[of_level].sum())
        samples[f"insertion angle, order {level}, deg"] = np.rad2deg(angle[of_level])
        samples[f"length of a branch, order {level}, m"] = length[of_level]
    numbers["wood volume, l"] = 1000 * float(wood.volume.sum())
    if len(leaves):
        numbers["leaves"] = float(len(leaves))
        numbers["leaf area, m²"] = float(area.sum())
        facing = np.clip(np.abs(leaves.normal[:, 2]), 0.0, 1.0)
        samples["inclination of a leaf, deg"] = np.rad2deg(np.arccos(facing))
    part, aloft = (np.arange(SAMPLES) + 0.5) / SAMPLES, wood.order > 0
    low, high = wood.start[aloft, 2], wood.end[aloft, 2]
    place = (low[:, None] + part * (high - low)[:, None]).ravel()
    weight = np.repeat(wood.length[aloft] / SAMPLES, SAMPLES)
    profiles = {"branch length": _profile(place, weight, height)}
    if len(leaves):
        profiles["leaf area"] = _profile(leaves.centre[:, 2], area, height)
    return Portrait(numbers, samples, profiles)


def axes_of(wood: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """(B,) first segment of each axis, and (S,) axis of each segment."""
    axes = find_axes(wood)
    return axes.segment[axes.first[:-1]], axes.of_segment


def insertion_angles(wood: Skeleton) -> np.ndarray:
    """(B,) radians between the first segment of each axis and what bears it; a trunk's from upright."""
    first, _ = axes_of(wood)
    heading = unit(wood.end - wood.start)
    borne = wood.parent[first] >= 0
    bearer = np.where(borne[:, None], heading[wood.parent[first]], [0.0, 0.0, 1.0])
    cosine = np.einsum("bi,bi->b", heading[first], bearer)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def crown_width(wood: Skeleton, leaves: Leaves) -> float:
    """Mean width of the crown's shadow between parallel lines, from all sides; else of the wood."""
    points = leaves.centre if len(leaves) else wood.end
    side = np.pi * np.arange(SIDES) / SIDES
    across = points[:, :2] @ np.stack([np.cos(side), np.sin(side)])
    return float(np.ptp(across, axis=0).mean()) if len(points) else 0.0


def crown_base(wood: Skeleton, leaves: Leaves, height: float) -> float:
    """Height with a fiftieth of the leaf area below it; without leaves, the lowest branch's foot, else the
    tree's height."""
    if len(leaves):
        up = np.argsort(leaves.centre[:, 2])
        area = np.cumsum(leaves.radius[up] ** 2)
        return float(leaves.centre[up[np.searchsorted(area, LOWEST * area[-1])], 2])
    branches = wood.order == 1
    return float(wood.start[branches, 2].min()) if branches.any() else height


def trunk_radius(wood: Skeleton, height: float) -> float:
    """Radius of the trunk at a height, of the first of several stems; 0 above its tip."""
    return float(next(iter(stem_radii(wood, height)), 0.0))


def _profile(place: np.ndarray, weight: np.ndarray, height: float) -> np.ndarray:
    bins = np.clip((place / max(height, 1e-9) * BINS).astype(np.int64), 0, BINS - 1)
    total = np.bincount(bins, weight, BINS)
    return np.asarray(total / max(total.sum(), 1e-300))


@dataclass(frozen=True)
class Number:
    """One number of the template and of its siblings.

    spread : standard deviation over the siblings. room : a difference that is none, whatever the per cent.
    """

    name: str
    template: float
    mean: float
    spread: float
    room: float = 0.0

    @property
    def difference(self) -> float:
        """Difference of the mean from the template, over the template."""
        return (self.mean - self.template) / abs(self.template) if self.template else 0.0

    @property
    def spreads(self) -> float:
        """Distance of the template from the mean, in standard deviations of the siblings."""
        return abs(self.mean - self.template) / self.spread if self.spread else 0.0

    @property
    def good(self) -> bool:
        """True where the goals are met; decibels are compared by what they differ."""
        apart = abs(self.mean - self.template)
        near = apart <= max(MOST_DIFFERENCE * abs(self.template), self.room)
        if self.name.endswith("dB"):
            near = apart <= 1.0
        return near and (self.spreads <= MOST_SPREADS or abs(self.difference) < 0.01)


@dataclass(frozen=True)
class Sample:
    """A distribution: distance of Kolmogorov and Smirnov, and of the earth mover; both means."""

    name: str
    template: float
    mean: float
    kolmogorov: float
    mover: float


@dataclass(frozen=True)
class Profile:
    """The overlap of the siblings' mean profile with the template's, and that of one sibling in the mean."""

    name: str
    overlap: float
    single: float

    @property
    def good(self) -> bool:
        """True where the goal is met."""
        return self.overlap >= LEAST_OVERLAP


@dataclass(frozen=True)
class Likeness:
    """All comparisons of siblings with their template."""

    numbers: tuple[Number, ...]
    samples: tuple[Sample, ...]
    profiles: tuple[Profile, ...]

    @property
    def missed(self) -> list[str]:
        """Names of what is outside the goals."""
        numbers = [row.name for row in self.numbers if not row.good]
        return numbers + [row.name for row in self.profiles if not row.good]


def compare(template: Portrait, siblings: Sequence[Portrait]) -> Likeness:
    """Compare siblings with the tree they are to be like."""
    from scipy.stats import (  # half a second, for who accepts a template
        ks_2samp,
        wasserstein_distance,
    )

    numbers = []
    for name, value in template.numbers.items():
        values_of_siblings = np.array([one.numbers.get(name, 0.0) for one in siblings])
        room = 0.02 * template.numbers["height, m"] if name == "crown base, m" else 0.0
        numbers.append(
            Number(
                name,
                value,
                float(values_of_siblings.mean()),
                float(values_of_siblings.std(ddof=1)),
                room,
            )
        )
    samples = []
    for name, values in template.samples.items():
        pooled = np.concatenate([one.samples.get(name, np.empty(0)) for one in siblings])
        if len(values) and len(pooled):
            samples.append(
                Sample(
                    name,
                    float(values.mean()),
                    float(pooled.mean()),
                    float(ks_2samp(values, pooled, method="asymp").statistic),
                    float(wasserstein_distance(values, pooled)),
                )
            )
    profiles = []
    for name, values in template.profiles.items():
        each = np.array([one.profiles[name] for one in siblings])
        profiles.append(
            Profile(
                name,
                float(np.minimum(values, each.mean(axis=0)).sum()),
                float(np.minimum(values, each).sum(axis=1).mean()),
            )
        )
    return Likeness(tuple(numbers), tuple(samples), tuple(profiles))


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
    one = portray(*outline_of(habit.anatomy, itself, 0.0))
    own = *standing_of(itself), lowest_corner(habit.anatomy, itself, 0.0)
    keys = [
        int(stream(0, "template", "sibling", number).integers(2**63)) for number in range(count)
    ]
    verdicts = []
    for variety in VARIETIES:
        varied = Siblings(variety=variety, allometry=settings.allometry)
        grown = [grow_sibling(habit, varied, key) for key in keys]
        portraits = [portray(*outline_of(habit.anatomy, tree, variety)) for tree in grown]
        likeness = compare(one, portraits)
        goals = [*_likenesses(likeness), *_soundness(habit, own, grown, variety)]
        missed = sorted((goal for goal in goals if goal.times > 1), key=lambda goal: -goal.times)
        verdicts.append(Verdict(variety, count, likeness, tuple(missed)))
        if not missed:
            break
    return min(verdicts, key=lambda verdict: verdict.missed[0].times if verdict.missed else 0.0)


def _likenesses(likeness: Likeness) -> Iterator[Miss]:
    """Distances of means and profiles from the goals."""
    for row in likeness.numbers:
        if row.name.startswith(JUDGED):
            allowed = max(MOST_DIFFERENCE * abs(row.template), row.room)
            if row.name.startswith("branches"):
                allowed = max(allowed, ONE_BRANCH)
            name = row.name.split(",")[0]
            words = f"{name} {100 * row.difference:+.0f} % ({100 * MOST_DIFFERENCE:.0f} % allowed)"
            yield Miss(words, abs(row.mean - row.template) / max(allowed, 1e-12))
    for profile in likeness.profiles:
        yield Miss(
            f"{profile.name} over height overlaps by {profile.overlap:.2f} ({LEAST_OVERLAP} wanted)",
            (1 - profile.overlap) / (1 - LEAST_OVERLAP),
        )


def _soundness(
    habit: Habit, own: tuple[float, ...], grown: list[Grown], variety: float
) -> Iterator[Miss]:
    """Measures of how far trunks lean, branches are off their parents or thicker, reach deeper into the
    ground than the tree's own roots, and begin off the mesh of what bears them.

    own : lean, gap, thickness and lowest corner of the tree itself.
    """
    own_lean, _, own_thicker, low = own
    lean, gap, thicker = np.max([standing_of(tree) for tree in grown], axis=0).tolist()
    yield Miss(
        f"a trunk leans {np.rad2deg(lean):.0f}° ({np.rad2deg(own_lean):.0f}° in the tree)",
        float((lean - own_lean) / MOST_LEAN),
    )
    yield Miss(f"a branch begins {1000 * gap:.0f} mm off its parent (1 mm allowed)", gap / MOST_GAP)
    yield Miss(
        f"a branch is {thicker:.1f} times as thick as its parent ({own_thicker:.1f} in the tree)",
        (thicker - max(own_thicker, 1.0)) / MOST_THICKER,
    )
    deepest = min(lowest_corner(habit.anatomy, tree, variety) for tree in grown[:MESHED])
    below = min(low, 0.0) * (1 + MOST_DIFFERENCE) - deepest
    yield Miss(
        f"a branch reaches {100 * below:.0f} cm into the ground ({100 * MOST_SUNK:.0f} cm allowed)",
        below / MOST_SUNK,
    )
    off = max(float(hold_rings(habit.anatomy, tree)[1].max()) for tree in grown[:MESHED])
    yield Miss(
        f"a limb's mesh begins {1000 * off:.0f} mm off its bearer's ({1000 * OFF:.0f} mm allowed)",
        off / OFF,
    )
