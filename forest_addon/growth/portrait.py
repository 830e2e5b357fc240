"""A tree in numbers: what a forester measures on it, and how it is spread over its height.

Taken from all of its wood as segments and the truth of its leaves, so that a template and what is grown
from it are measured alike. Profiles are over height as a share of the tree's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .mesh.leaves import Leaves
from .regrow.allometry import BREAST
from .skeleton import Skeleton

BINS = 20  # of a vertical profile
SIDES = 18  # from which the width of the crown is measured
LOWEST = 0.02  # share of the leaf area below the base of the crown
SAMPLES = 8  # of a segment's length


class Measurable(Protocol):
    """A tree, or the outline of one."""

    @property
    def skeleton(self) -> Skeleton:
        """All of its wood as segments."""

    @property
    def leaves(self) -> Leaves:
        """The truth of its leaves."""

    @property
    def height(self) -> float:
        """Metres from the ground to the highest point."""


@dataclass(frozen=True)
class Portrait:
    """One tree.

    numbers : by name and unit. samples : by name, one number a branch. profiles : by name, (BINS,)
    shares that add up to 1, from the ground to the top.
    """

    numbers: dict[str, float]
    samples: dict[str, np.ndarray]
    profiles: dict[str, np.ndarray]


def portray(tree: Measurable) -> Portrait:
    """The portrait of a tree of which all wood is in the skeleton."""
    wood, leaves = tree.skeleton, tree.leaves
    first, axis = axes_of(wood)
    order, length = wood.order[first], np.bincount(axis, _lengths(wood))
    angle = insertion_angles(wood)
    area = np.pi * leaves.radius**2
    height = tree.height
    numbers = {
        "height, m": height,
        "crown width, m": crown_width(tree),
        "crown base, m": crown_base(tree),
        "DBH, cm": 200 * trunk_radius(wood, min(BREAST, height / 2)),
        "taper: diameter at half height / DBH": trunk_radius(wood, height / 2)
        / max(trunk_radius(wood, min(BREAST, height / 2)), 1e-9),
    }
    samples = {}
    for level in range(1, int(wood.order.max(initial=0)) + 1):
        mine = order == level
        numbers[f"branches of order {level}"] = float(mine.sum())
        numbers[f"their length, order {level}, m"] = float(length[mine].sum())
        samples[f"insertion angle, order {level}, deg"] = np.rad2deg(angle[mine])
        samples[f"length of a branch, order {level}, m"] = length[mine]
    numbers["wood volume, l"] = 1000 * _volume(wood)
    if len(leaves):
        numbers["leaves"] = float(len(leaves))
        numbers["leaf area, m²"] = float(area.sum())
        facing = np.clip(np.abs(leaves.normal[:, 2]), 0.0, 1.0)
        samples["inclination of a leaf, deg"] = np.rad2deg(np.arccos(facing))
    place, weight = _along(wood, wood.order > 0)
    profiles = {"branch length": _profile(place, weight, height)}
    if len(leaves):
        profiles["leaf area"] = _profile(leaves.centre[:, 2], area, height)
    return Portrait(numbers, samples, profiles)


def axes_of(wood: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """(B,) first segment of each axis, and (S,) axis of each segment."""
    begins = (wood.parent < 0) | (wood.order[np.maximum(wood.parent, 0)] != wood.order)
    begin = np.where(begins, np.arange(len(begins)), wood.parent)
    while not begins[begin].all():  # twice as far with each round
        begin = begin[begin]
    axis = np.cumsum(begins)[begin] - 1
    return np.flatnonzero(begins), axis


def insertion_angles(wood: Skeleton) -> np.ndarray:
    """(B,) radians between the first segment of each axis and what bears it; a trunk's from upright."""
    first, _ = axes_of(wood)
    heading = wood.end - wood.start
    heading = heading / np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-12)
    borne = wood.parent[first] >= 0
    bearer = np.where(borne[:, None], heading[wood.parent[first]], [0.0, 0.0, 1.0])
    cosine = np.einsum("bi,bi->b", heading[first], bearer)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def crown_width(tree: Measurable) -> float:
    """Mean width of the crown's shadow between parallel lines, from all sides; else of the wood."""
    points = tree.leaves.centre if len(tree.leaves) else tree.skeleton.end
    side = np.pi * np.arange(SIDES) / SIDES
    across = points[:, :2] @ np.stack([np.cos(side), np.sin(side)])
    return float(np.ptp(across, axis=0).mean()) if len(points) else 0.0


def crown_base(tree: Measurable) -> float:
    """Height with a fiftieth of the leaf area below it; without leaves, the lowest branch's foot."""
    if len(tree.leaves):
        up = np.argsort(tree.leaves.centre[:, 2])
        area = np.cumsum(tree.leaves.radius[up] ** 2)
        return float(tree.leaves.centre[up[np.searchsorted(area, LOWEST * area[-1])], 2])
    branches = tree.skeleton.order == 1
    return float(tree.skeleton.start[branches, 2].min()) if branches.any() else tree.height


def trunk_radius(wood: Skeleton, height: float) -> float:
    """Radius of the trunk at a height; 0 above its tip."""
    trunk = np.flatnonzero(wood.order == 0)
    crossed = trunk[(wood.start[trunk, 2] <= height) & (wood.end[trunk, 2] > height)]
    if not len(crossed):
        return 0.0
    s = crossed[0]
    part = (height - wood.start[s, 2]) / (wood.end[s, 2] - wood.start[s, 2])
    return float(wood.radius[s, 0] + part * (wood.radius[s, 1] - wood.radius[s, 0]))


def _lengths(wood: Skeleton) -> np.ndarray:
    return np.asarray(np.linalg.norm(wood.end - wood.start, axis=1))


def _volume(wood: Skeleton) -> float:
    r1, r2 = wood.radius.T
    return float((np.pi * _lengths(wood) * (r1**2 + r1 * r2 + r2**2) / 3).sum())


def _along(wood: Skeleton, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights of places along segments, and the length that each stands for."""
    part = (np.arange(SAMPLES) + 0.5) / SAMPLES
    low, high = wood.start[which, 2], wood.end[which, 2]
    place = low[:, None] + part * (high - low)[:, None]
    return place.ravel(), np.repeat(_lengths(wood)[which] / SAMPLES, SAMPLES)


def _profile(place: np.ndarray, weight: np.ndarray, height: float) -> np.ndarray:
    bins = np.clip((place / max(height, 1e-9) * BINS).astype(np.int64), 0, BINS - 1)
    total = np.bincount(bins, weight, BINS)
    return np.asarray(total / max(total.sum(), 1e-300))
