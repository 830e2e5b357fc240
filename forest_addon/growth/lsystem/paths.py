"""Brackets to paths: which step comes before each, as the turtle walks, and how far from the root.

A bracket that closes takes the turtle back to where it opened, so commands form a tree. It is found for
the branches of one bracket depth at once: sorted by depth, the commands of a branch stand together, in
order, behind the bracket that opens it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .word import GrammarError


@dataclass(frozen=True)
class Paths:
    """The tree of P steps; closing brackets are left out.

    command : (P,) number of the step in the string, ascending.
    before : (P,) which of the P the turtle does before it, -1 where it starts.
    level : (P,) how many come before it on its path.
    branch : (P,) number of the pair of brackets that it stands in, 0 outside all. A bracket that opens
        counts to the branch that it opens.
    parent : (B,) branch that each branch leaves, -1 for branch 0; a parent has a smaller number.
    """

    command: np.ndarray
    before: np.ndarray
    level: np.ndarray
    branch: np.ndarray
    mother: np.ndarray


def find_paths(opens: np.ndarray, closes: np.ndarray) -> Paths:
    """The paths of commands, given which of them (C,) open and which close a bracket.

    Brackets that stay open are closed by the end of the string.

    Raises
    ------
    GrammarError : a bracket closes that was not opened.
    """
    total = len(opens)
    depth = np.cumsum(opens.astype(np.int64) - closes)
    if total and depth.min() < 0:
        at = int(np.flatnonzero(depth < 0)[0])
        raise GrammarError(f"step {at}: a bracket closes a branch that was not opened")
    command = np.flatnonzero(~closes)
    depth, is_open = depth[command], opens[command]
    count = len(command)

    by_depth = np.argsort(depth, kind="stable")  # then by place in the string
    rank_opens = is_open[by_depth]
    branch_sorted = np.cumsum(rank_opens)
    previous = np.empty(count, np.int64)  # in sorted order: what stands before
    previous[:1] = -1
    previous[1:] = by_depth[:-1]

    # A bracket follows the last command that is one level up and further left.
    key = depth[by_depth] * (count + 1) + by_depth
    heads = np.flatnonzero(rank_opens)
    head = by_depth[heads]
    found = np.searchsorted(key, (depth[head] - 1) * (count + 1) + head) - 1
    outside = (found < 0) | (depth[by_depth[found]] != depth[head] - 1)
    previous[heads] = np.where(outside, -1, by_depth[found])

    before = np.empty(count, np.int64)
    before[by_depth] = previous
    branch = np.empty(count, np.int64)
    branch[by_depth] = branch_sorted
    mother = np.full(len(heads) + 1, -1, np.int64)
    mother[1:] = np.where(outside, 0, branch[previous[heads]])

    return Paths(command, before, _levels(depth, by_depth, heads, previous), branch, mother)


def _levels(
    depth: np.ndarray, by_depth: np.ndarray, heads: np.ndarray, previous: np.ndarray
) -> np.ndarray:
    """(P,) number of commands before each one: rank in its branch plus the level of its bracket."""
    count = len(depth)
    first = np.zeros(count, np.int64)  # sorted place of the bracket of each command's branch
    first[heads] = heads
    first = np.maximum.accumulate(first)
    rank = np.arange(count) - first
    level = np.zeros(count, np.int64)
    bounds = np.searchsorted(depth[by_depth], np.arange(int(depth.max(initial=0)) + 2))
    head_bounds = np.searchsorted(heads, bounds)
    level[by_depth[: bounds[1]]] = rank[: bounds[1]]
    base = np.zeros(count, np.int64)  # by sorted place of the bracket
    for d in range(1, len(bounds) - 1):
        opening = heads[head_bounds[d] : head_bounds[d + 1]]
        outer = previous[opening]
        base[opening] = np.where(outer < 0, 0, level[outer] + 1)
        here = slice(bounds[d], bounds[d + 1])
        level[by_depth[here]] = rank[here] + base[first[here]]
    return level
