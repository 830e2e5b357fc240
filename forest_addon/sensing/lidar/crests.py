"""The crests of sums of Gaussians, f = Σ e_j/s_j·exp(-(x - t_j)²/2s_j²), and what each of them is made of.

Where f' = 0, (f'/Σ w_j)' = Var_w(t_j)/s² - 1 ≤ 0 for the weights w_j = e_j/s_j³·exp(…) and the smallest width
s: a group of contacts of at most 2s has one crest, as a variance within an interval is at most a quarter
of its length squared (Popoviciu). Longer groups are searched in steps of s/4, where the slope changes its
sign; two crests closer than that count as one. Newton's method, held by bisection, finds the place.
"""

from __future__ import annotations

import numpy as np

STEP = 0.25  # of the smallest width in a group, of the search for crests
PAIRS_AT_ONCE = 4_000_000
NODES_AT_ONCE = 1_000_000


def crests(
    at: np.ndarray, energy: np.ndarray, width: np.ndarray, first: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(E,) crests of all groups, and (C,) the crest that each contact belongs to, from 0 without a gap.

    at, energy, width : (C,) contacts, sorted by place within their group. first, size : (G,) the groups.
    """
    sums = _Sums(at, energy, width)
    low, high = at[first].copy(), at[first + size - 1].copy()
    least = np.minimum.reduceat(width, first) if len(first) else width
    wide = np.flatnonzero(high - low > 2 * least)
    if not len(wide):
        crest = _refine(sums, first, size, low, high)
        return crest, np.repeat(np.arange(len(first)), size)

    nodes = np.ceil((high - low) / (STEP * least)).astype(np.int64) + 1
    batches = _batches(wide, nodes[wide])
    found = [_search(sums, first[g], size[g], nodes[g]) for g in batches]
    crests_of = np.ones(len(first), dtype=np.int64)
    crests_of[wide] = np.concatenate([count for _, _, count, _ in found])
    group = np.repeat(np.arange(len(first)), crests_of)
    low, high = low[group], high[group]
    searched = np.isin(group, wide)
    low[searched] = np.concatenate([lows for lows, _, _, _ in found])
    high[searched] = np.concatenate([highs for _, highs, _, _ in found])

    owner = np.repeat(np.cumsum(crests_of) - crests_of, size)
    for batch, (_, _, _, which) in zip(batches, found, strict=True):
        owner[_ranges(first[batch], size[batch])] += which
    owner = np.maximum.accumulate(owner)
    # Between two valleys, or two signs of a slope that is nothing but rounding, there may be no contact.
    owned = np.bincount(owner, minlength=len(group)) > 0
    group = group[owned]
    crest = _refine(sums, first[group], size[group], low[owned], high[owned])
    return crest, (np.cumsum(owned) - 1)[owner]


class _Sums:
    """Sums over the contacts of groups."""

    def __init__(self, at: np.ndarray, energy: np.ndarray, width: np.ndarray) -> None:
        self.at = at
        self._narrow = 1 / width**2
        self._height = energy / width**3

    def slope(
        self, first: np.ndarray, size: np.ndarray, x: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(B,) slope of f at places x over Σ w_j, metres, and the derivative of that."""
        slope, bend = np.empty(len(x)), np.empty(len(x))
        bounds = np.cumsum(size)
        begin = 0
        while begin < len(x):
            most = (bounds[begin] - size[begin]) + PAIRS_AT_ONCE
            stop = max(int(np.searchsorted(bounds, most, "right")), begin + 1)
            part = slice(begin, stop)
            slope[part], bend[part] = self._slope(first[part], size[part], x[part])
            begin = stop
        return slope, bend

    def _slope(
        self, first: np.ndarray, size: np.ndarray, x: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        rows = _ranges(first, size)
        starts = np.cumsum(size) - size
        away = self.at[rows] - np.repeat(x, size)
        narrow = self._narrow[rows]
        power = 0.5 * away**2 * narrow
        nearest = np.minimum.reduceat(power, starts)  # keeps the largest exponential at 1
        weight = self._height[rows] * np.exp(np.repeat(nearest, size) - power)
        total = np.add.reduceat(weight, starts)
        total = np.where(total > 0, total, 1.0)
        weight *= away
        mean = np.add.reduceat(weight, starts) / total
        weight *= narrow
        drift = np.add.reduceat(weight, starts) / total
        weight *= away
        square = np.add.reduceat(weight, starts) / total
        return mean, square - 1.0 - mean * drift


def _search(
    sums: _Sums, first: np.ndarray, size: np.ndarray, nodes: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Brackets of all crests of some groups, from the sign of the slope on a grid of so many nodes each.

    Returns low, high : (B,) brackets, group by group. count : (G,) crests of each group. which : for the
    contacts of these groups, one after the other, which crest of their group they belong to.
    """
    start, end = sums.at[first], sums.at[first + size - 1]
    step = (end - start) / (nodes - 1)
    of_node = np.repeat(np.arange(len(first)), nodes)
    first_node = np.cumsum(nodes) - nodes
    place = np.arange(len(of_node)) - np.repeat(first_node, nodes)
    x = start[of_node] + place * step[of_node]
    slope, _ = sums.slope(first[of_node], size[of_node], x)
    slope[place == 0] = 1.0  # outside all contacts the way to them is up
    slope[place == nodes[of_node] - 1] = -1.0
    up = slope > 0
    inner = of_node[1:] == of_node[:-1]
    top = np.flatnonzero(inner & up[:-1] & ~up[1:])
    valley = np.flatnonzero(inner & ~up[:-1] & up[1:])
    count = np.bincount(of_node[top], minlength=len(first))

    # A contact belongs to the crest between the valleys around it. One that lies in the same step as a
    # valley is behind it where the way up leads on.
    contacts = _ranges(first, size)
    group = np.repeat(np.arange(len(first)), size)
    along = ((sums.at[contacts] - start[group]) / step[group]).astype(np.int64)
    cell = first_node[group] + np.minimum(along, nodes[group] - 2)
    passed = np.searchsorted(valley, cell)
    beside = np.flatnonzero(np.append(valley, -1)[passed] == cell)
    there, _ = sums.slope(first[group[beside]], size[group[beside]], sums.at[contacts[beside]])
    passed[beside] += there > 0
    before = np.cumsum(count - 1) - (count - 1)  # valleys of the groups before
    return x[top], x[top + 1], count, passed - before[group]


def _refine(
    sums: _Sums, first: np.ndarray, size: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """(B,) crests within brackets, each of the contacts of its group: Newton, held by bisection."""
    x = (low + high) / 2
    open_ = np.flatnonzero(high > low)
    if len(open_) == 0:
        return x
    low, high = low[open_], high[open_]
    first, size = first[open_], size[open_]
    now = x[open_]
    fine = 1e-13 * (high - low)
    for _ in range(60):
        slope, bend = sums.slope(first, size, now)
        low, high = np.where(slope > 0, now, low), np.where(slope > 0, high, now)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = now - slope / bend
        after = np.where((after >= low) & (after <= high) & (bend < 0), after, (low + high) / 2)
        moved = np.abs(after - now)
        x[open_] = after
        going = moved > fine + 1e-13 * np.abs(now)
        if not going.any():
            break
        open_, now, fine = open_[going], after[going], fine[going]
        low, high, first, size = low[going], high[going], first[going], size[going]
    return x


def _ranges(first: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The numbers first, first + 1, … of each range, one range after the other."""
    return np.repeat(first - (np.cumsum(size) - size), size) + np.arange(int(size.sum()))


def _batches(wide: np.ndarray, nodes: np.ndarray) -> list[np.ndarray]:
    """Wide groups in pieces of a bounded number of grid nodes."""
    limit = np.arange(1, nodes.sum() / NODES_AT_ONCE) * NODES_AT_ONCE
    return [part for part in np.split(wide, np.searchsorted(np.cumsum(nodes), limit)) if len(part)]
