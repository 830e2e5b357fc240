"""Volume of a skeleton's wood: that of the union of its tubes, joints counted once.

An axis is a bent tube: its segments are frustums cut where they meet, so their volumes πh(r₁² + r₁r₂ + r₂²)/3
add up. A child starts within her parent. What her first segments share with the parent's axis, and with
sisters and aunts that leave the same segment before her, or the one below, is found by points spread
evenly in them and taken off. Branches that cross each other elsewhere count twice.
"""

from __future__ import annotations

import numpy as np

from .mesh.axes import TOUCH, find_axes
from .skeleton import Skeleton

HEADS = 3  # segments of an axis that may lie within others
SISTERS = 4  # of a branch, those before her, that she may share wood with
AUNTS = 3  # that leave the segment before her parent
POINTS = 100_000  # of a tree, in all its joints together
FEWEST, MOST = 32, 4096  # in a segment
ROUNDED = 1e-6  # of lengths, by which nearest points may be rounded
EVEN = np.array(
    [0.8191725134, 0.6710436067, 0.5497004779]
)  # steps of an even sequence (Roberts' R3)


def volume_of(skeleton: Skeleton) -> float:
    """m³ of wood."""
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    r1, r2 = skeleton.radius.T
    volume = np.pi * length * (r1**2 + r1 * r2 + r2**2) / 3
    heads, others = _joints(skeleton, length)
    if not len(heads):
        return float(volume.sum())
    count = int(np.clip(POINTS // len(heads), FEWEST, MOST))
    others = np.where(_near(skeleton, heads, others), others, -1)
    some = np.flatnonzero((others >= 0).any(axis=1))  # the rest share nothing
    heads, others = heads[some], others[some]
    step = max(1, 2_000_000 // (count * others.shape[1]))
    for first in range(0, len(heads), step):
        part = slice(first, first + step)
        shared = _shared(skeleton, length, heads[part], others[part], count)
        volume[heads[part]] *= 1 - shared
    return float(volume.sum())


def _joints(skeleton: Skeleton, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First segments of children (H,), and those that each may lie in (H, C), -1 for none."""
    axes = find_axes(skeleton)
    onward = np.full(len(skeleton) + 1, -1)  # the last one: of none, none
    chain = axes.segment
    inner = np.ones(len(chain), dtype=bool)
    inner[axes.first[1:] - 1] = False
    rows = np.flatnonzero(inner)
    onward[chain[rows]] = chain[rows + 1]
    foot = chain[axes.first[:-1]]
    foot = foot[(skeleton.parent[foot] >= 0)]
    mother = skeleton.parent[foot]
    order = np.lexsort((foot, mother))
    foot, mother = foot[order], mother[order]

    parent = np.append(skeleton.parent, -1)
    before, after = parent[mother], onward[mother]
    own = [mother, before, parent[before], after, onward[after]]
    for back in range(1, SISTERS + 1):
        sister = np.full(len(foot), -1)
        same = mother[back:] == mother[:-back]
        sister[back:][same] = foot[:-back][same]
        own += [sister, onward[sister]]
    low, high = np.searchsorted(mother, before), np.searchsorted(mother, before, "right")
    for place in range(AUNTS):
        aunt = np.append(foot, -1)[np.minimum(low + place, len(foot))]
        own.append(np.where((before >= 0) & (low + place < high), aunt, -1))
    others = np.stack(own, axis=1)
    feet, within = [foot], [others]
    for _ in range(HEADS - 1):
        feet.append(onward[feet[-1]])
        within.append(others)
    head, around = np.concatenate(feet), np.concatenate(within)
    known = np.flatnonzero((head >= 0) & (length[head] > TOUCH))
    return head[known], around[known]


def _near(skeleton: Skeleton, heads: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(H, C) whether a segment and another, -1 for none, may have a point in common: their boxes overlap, and
    their axes come as near as their radii, thicker ends everywhere."""
    thick = skeleton.radius.max(axis=1)
    low = np.minimum(skeleton.start, skeleton.end) - thick[:, None]
    high = np.maximum(skeleton.start, skeleton.end) + thick[:, None]
    near = others >= 0
    for k in range(3):
        near &= low[heads, k, None] <= high[others, k]
        near &= high[heads, k, None] >= low[others, k]
    row, column = np.nonzero(near)
    one, two = heads[row], others[row, column]
    way, beside = (skeleton.end[which] - skeleton.start[which] for which in (one, two))
    apart = skeleton.start[one] - skeleton.start[two]
    # The nearest points of two segments: Ericson 2005, Real-Time Collision Detection, 5.1.9.
    a, e, b = (_dot(*pair) for pair in ((way, way), (beside, beside), (way, beside)))
    c, f = _dot(way, apart), _dot(beside, apart)
    slant = a * e - b * b
    first = np.divide(b * f - c * e, slant, out=np.zeros(len(a)), where=slant > 1e-12 * a * e)
    first = np.clip(first, 0.0, 1.0)
    second = np.divide(b * first + f, e, out=np.zeros(len(a)), where=e > 0)
    second = np.clip(second, 0.0, 1.0)
    first = np.clip(np.divide(b * second - c, a, out=np.zeros(len(a)), where=a > 0), 0.0, 1.0)
    between = apart + first[:, None] * way - second[:, None] * beside
    reach = thick[one] + thick[two] + ROUNDED * (np.sqrt(a) + np.sqrt(e))
    near[row, column] = _dot(between, between) <= reach**2
    return near


def _fraction(value: np.ndarray) -> np.ndarray:
    """The part of numbers above 0 beyond a whole one: exact, in a third of the time of a remainder."""
    value -= np.floor(value)
    return value


def _dot(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    found: np.ndarray = np.einsum("ni,ni->n", one, two)
    return found


def _shared(
    skeleton: Skeleton, length: np.ndarray, heads: np.ndarray, others: np.ndarray, count: int
) -> np.ndarray:
    """(H,) share of each segment's volume that lies in any of some others (H, C)."""
    place = np.arange(count)[:, None] + np.sqrt(2) * heads[:, None, None]  # each segment its own
    along, turn, out = (_fraction(place[:, :, 0] * step) for step in EVEN)  # (H, P) each
    r1, r2 = skeleton.radius[heads].T[:, :, None]
    slope = r2 - r1
    weight = (r1 + slope * along) ** 2  # (H, P): a thick end has more
    axis = (skeleton.end[heads] - skeleton.start[heads]) / length[heads, None]
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=1)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    across = np.cross(axis, side)
    far = (r1 + slope * along) * np.sqrt(out)
    cos, sin = far * np.cos(2 * np.pi * turn), far * np.sin(2 * np.pi * turn)
    along = along * length[heads, None]
    places = [  # (H, P) of each coordinate: twice as fast as rows of three
        skeleton.start[heads, k, None]
        + along * axis[:, k, None]
        + cos * side[:, k, None]
        + sin * across[:, k, None]
        for k in range(3)
    ]
    inside = np.zeros(weight.shape, dtype=bool)
    for other in others.T:
        rows = np.flatnonzero((other >= 0) & (length[other] > TOUCH))
        which = other[rows]
        way = (skeleton.end[which] - skeleton.start[which]) / length[which, None]
        above, square = np.zeros((2, len(rows), count))
        for k in range(3):
            from_start = places[k][rows]
            from_start -= skeleton.start[which, k, None]
            above += from_start * way[:, k, None]
            from_start *= from_start
            square += from_start
        square -= above**2
        share = np.divide(above, length[which, None], out=above)
        a, b = skeleton.radius[which].T[:, :, None]
        reach = a + (b - a) * share
        reach *= reach
        here = square < reach
        here &= share >= 0
        here &= share <= 1
        inside[rows] |= here
    found: np.ndarray = (weight * inside).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-300)
    return found
