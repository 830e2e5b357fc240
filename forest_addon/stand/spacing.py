"""Hard cores: no two trees nearer than the distance of their pair.

Every tree has an age, a uniform mark. By **Matérn II** (Matérn 1960) a tree goes if an older one stands
too near, whether that one stays or not: every tree is judged alike. **Greedy** (Wahed et al.) keeps the
oldest first, so a tree goes only if an older one that stays is too near: more trees stay, and those that
do depend on each other over longer distances. Neither depends on the order of the trees.

The distance of a pair is that of its two kinds (rows of a matrix), or the sum of their crown radii where
that is larger. Time grows with the number of trees, whatever the distance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

PORTION = 2_000_000  # pairs at once, about
FIRST_BATCH = 2048  # oldest trees that greedy spacing looks at together; every batch doubles


@dataclass(frozen=True)
class Spacing:
    """Spacing of trees.

    distance : (K, K) metres between kinds, symmetric.
    kind : (N,) int64, row of each tree. crown : (N,) radius of each tree's crown, metres; 0: no matter.
    """

    distance: np.ndarray
    kind: np.ndarray
    crown: np.ndarray

    @classmethod
    def uniform(cls, distance: float, count: int) -> Spacing:
        """The same distance between all of ``count`` trees."""
        return cls(np.array([[distance]]), np.zeros(count, dtype=np.int64), np.zeros(count))

    def between(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(M,) distance that trees ``a`` and ``b`` (M,) keep."""
        crowns = np.where(
            (self.crown[a] > 0) & (self.crown[b] > 0), self.crown[a] + self.crown[b], 0
        )
        return np.maximum(self.distance[self.kind[a], self.kind[b]], crowns)

    def reach(self) -> float:
        """The largest distance that any two trees keep."""
        used = np.unique(self.kind)
        largest = self.distance[np.ix_(used, used)].max(initial=0.0)
        return float(max(largest, 2 * self.crown.max(initial=0.0)))


def space(
    points: np.ndarray,
    mark: np.ndarray,
    spacing: Spacing,
    rule: str,
) -> np.ndarray:
    """(N,) bool, which trees stay, by the rule ``matern`` or ``greedy``.

    points : (N, 2) metres. mark : (N,) ages, smaller is older; of two alike the first is older.
    """
    return {"matern": matern_ii, "greedy": greedy}[rule](points, mark, spacing)


def apart_from(points: np.ndarray, fixed: np.ndarray, spacing: Spacing) -> np.ndarray:
    """(N,) bool, which trees are fixed (N,), or have no fixed one too near."""
    apart, number = np.ones(len(points), dtype=bool), np.flatnonzero(fixed)
    if spacing.reach() > 0 and len(number):
        for query, other in _pairs(points, points[fixed], spacing.reach()):
            near = _too_near(points, points, query, number[other], spacing)
            apart[query[near]] = False
    return apart | fixed


def matern_ii(points: np.ndarray, mark: np.ndarray, spacing: Spacing | float) -> np.ndarray:
    """(N,) bool, which trees stay: those with no older tree too near."""
    spacing, age, reach = _prepare(mark, spacing)
    keep = np.ones(len(points), dtype=bool)
    if reach <= 0 or len(points) < 2:
        return keep
    keep = _oldest_of_bins(points, age, spacing)
    judged = np.flatnonzero(keep)
    for query, other in _pairs(points[judged], points, reach):
        tree = judged[query]
        older = age[other] < age[tree]
        tree, other = tree[older], other[older]
        keep[tree[_too_near(points, points, tree, other, spacing)]] = False
    return keep


def greedy(points: np.ndarray, mark: np.ndarray, spacing: Spacing | float) -> np.ndarray:
    """(N,) bool, which trees stay: from the oldest on, those with no tree too near that stays."""
    spacing, age, reach = _prepare(mark, spacing)
    keep = np.ones(len(points), dtype=bool)
    if reach <= 0 or len(points) < 2:
        return keep
    by_age = np.argsort(age)
    keep[:] = False
    kept = np.empty(0, dtype=np.int64)
    start = 0
    while start < len(points):
        batch = by_age[start : start + max(FIRST_BATCH, start)]
        start += len(batch)
        free = np.ones(len(batch), dtype=bool)
        if len(kept):
            for query, other in _pairs(points[batch], points[kept], reach):
                near = _too_near(points, points, batch[query], kept[other], spacing)
                free[query[near]] = False
        stay = _settle(points, batch[free], spacing, reach)
        keep[stay] = True
        kept = np.concatenate([kept, stay])
    return keep


def _settle(points: np.ndarray, trees: np.ndarray, spacing: Spacing, reach: float) -> np.ndarray:
    """Those of ``trees``, from old to young, that stay by greedy removal among themselves.

    In rounds: who has no older rival left stays, and the rivals of those that stay go.
    """
    if len(trees) < 2:
        return trees
    older, younger = [], []
    for query, other in _pairs(points[trees], points[trees], reach):
        once = other < query  # numbers within ``trees`` are ranks of age
        query, other = query[once], other[once]
        near = _too_near(points, points, trees[query], trees[other], spacing)
        younger.append(query[near])
        older.append(other[near])
    old, young = np.concatenate(older), np.concatenate(younger)
    undecided, stays = np.ones(len(trees), dtype=bool), np.zeros(len(trees), dtype=bool)
    while undecided.any():
        oldest = undecided.copy()
        oldest[young] = False
        stays |= oldest
        undecided &= ~oldest
        undecided[young[oldest[old]]] = False
        open_pairs = undecided[old] & undecided[young]
        old, young = old[open_pairs], young[open_pairs]
    return trees[stays]


def _pairs(
    queries: np.ndarray, points: np.ndarray, reach: float
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Numbers of queries (Q, 2) and of points (N, 2): every pair within reach, in portions."""
    tree, reach = cKDTree(points), reach * (1 + 1e-9)
    some = queries[:: max(1, len(queries) // 1000)]
    most = tree.query_ball_point(some, reach, return_length=True).max(initial=0)
    portion = max(PORTION // int(most + 1), 1)
    for first in range(0, len(queries), portion):
        part = cKDTree(queries[first : first + portion])
        found = part.sparse_distance_matrix(tree, reach, output_type="ndarray")
        yield first + found["i"], found["j"]


def _prepare(mark: np.ndarray, spacing: Spacing | float) -> tuple[Spacing, np.ndarray, float]:
    if not isinstance(spacing, Spacing):
        spacing = Spacing.uniform(float(spacing), len(mark))
    age = np.empty(len(mark), dtype=np.int64)
    age[np.argsort(mark, kind="stable")] = np.arange(len(mark))
    return spacing, age, spacing.reach()


def _oldest_of_bins(points: np.ndarray, age: np.ndarray, spacing: Spacing) -> np.ndarray:
    """(N,) bool, trees that are the oldest of their kind within a bin so small that all of a kind in it
    are too near each other. No other can stay, so however close they are there is little to judge.
    """
    oldest = np.ones(len(points), dtype=bool)
    low, span = points.min(axis=0), np.ptp(points, axis=0).max()
    for kind in np.unique(spacing.kind):
        mine = np.flatnonzero(spacing.kind == kind)
        side = max(spacing.distance[kind, kind], 2 * spacing.crown[mine].min()) / 1.5
        if side <= span * 1e-9:
            continue
        column, row = np.floor((points[mine] - low) / side).astype(np.int64).T
        home = row * (int(span / side) + 2) + column
        order = np.lexsort((age[mine], home))
        first = np.append(True, np.diff(home[order]) != 0)
        oldest[mine[order[~first]]] = False
    return oldest


def _too_near(
    points: np.ndarray, others: np.ndarray, a: np.ndarray, b: np.ndarray, spacing: Spacing
) -> np.ndarray:
    apart = points[a] - others[b]
    return np.asarray(np.hypot(apart[:, 0], apart[:, 1]) < spacing.between(a, b))
