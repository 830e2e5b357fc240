"""The crests of sums of Gaussians, f = Σ e_j/s_j·exp(-(x - t_j)²/2s_j²), and what each of them is made of.

Where f' = 0, (f'/Σ w_j)' = Var_w(t_j)/s² - 1 ≤ 0 for the weights w_j = e_j/s_j³·exp(…) and the smallest width
s: a group of contacts of at most 2s has one crest, as a variance within an interval is at most a quarter
of its length squared (Popoviciu). Longer groups are searched in steps of s/4, where the slope changes its
sign; two crests closer than that count as one. Newton's method, held by bisection, finds the place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.rows import RowTable

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


# Full waveforms of pulses, and the echoes in them, without a sampling grid.
#
# Every sub-ray that meets a surface at range R sends light back after the two-way time 2R/c. A short pulse
# of Gaussian shape makes of that a sum of Gaussians, Σ e_j/s_j·exp(-(t - t_j)²/2s_j²); an echo is a crest
# of this sum (above). Ranges R and time t = 2R/c are the same axis here, with widths in metres: σ of
# the pulse, and s_j² = σ² + b_j² where the light of a contact is spread along the surface (``footprint``).
#
# Contacts farther apart than 8 widths do not matter to each other (1e-14) and are cut into groups. A
# contact belongs to the crest between whose valleys it lies; a crest that no contact lies at is no echo.


LIGHT = 299_792_458.0  # m/s
FWHM = 2 * np.sqrt(2 * np.log(2))  # of a Gaussian, in standard deviations
APART = 8.0  # standard deviations beyond which contacts are treated alone


@dataclass(frozen=True)
class WaveformEchoes(RowTable):
    """E echoes, sorted by pulse and then by range.

    pulse : (E,) pulse. distance : (E,) metres, of the crest. energy : (E,) all that belongs to it.
    width : (E,) metres, standard deviation of its share of the waveform.
    contact : (E,) number of the contact that stands for it: of those with at least half the energy of the
        strongest, the one nearest to the axis of the beam.
    """

    pulse: np.ndarray
    distance: np.ndarray
    energy: np.ndarray
    width: np.ndarray
    contact: np.ndarray


def pulse_length(pulse_ns: float) -> float:
    """Standard deviation, in metres of range, of a pulse of this full width at half maximum."""
    return pulse_ns * 1e-9 * LIGHT / 2 / FWHM


def sample(
    time: np.ndarray, distance: np.ndarray, energy: np.ndarray, sigma: float | np.ndarray
) -> np.ndarray:
    """(T,) waveform at two-way times (T,) seconds of contacts (C,): energy per metre of range.

    sigma : metres, of all or (C,) of each.
    """
    away = (time[:, None] * LIGHT / 2 - distance) / sigma
    shape = np.exp(-0.5 * away**2) / (sigma * np.sqrt(2 * np.pi))
    wave: np.ndarray = shape @ energy
    return wave


def find_echoes(
    pulse: np.ndarray,
    subray: np.ndarray,
    distance: np.ndarray,
    energy: np.ndarray,
    sigma: float,
    blur: np.ndarray | None = None,
) -> WaveformEchoes:
    """The echoes of C contacts.

    pulse, subray : (C,) which pulse, and which of its rays from the axis outwards.
    distance : (C,) metres. energy : (C,). sigma : metres, see ``pulse_length``.
    blur : (C,) metres, standard deviation in range of a contact's own light; left out: none.
    """
    blur = np.zeros(len(pulse)) if blur is None else blur
    if (np.diff(pulse) > 0).all():  # one contact a pulse: that is its echo
        return WaveformEchoes(pulse, distance, energy, np.hypot(sigma, blur), np.arange(len(pulse)))
    order = np.lexsort((distance, pulse))
    pulse, subray, energy = pulse[order], subray[order], energy[order]
    at, width = distance[order], np.hypot(sigma, blur[order])
    first = np.flatnonzero(np.append(True, _apart(pulse, at, width, sigma)))
    size = np.diff(np.append(first, len(at)))
    crest, owner = crests(at, energy, width, first, size)

    found = gathered(owner, pulse, subray, at, energy, width**2 - sigma**2, sigma)
    return replace(found, distance=crest, contact=order[found.contact])


def gathered(
    owner: np.ndarray,
    pulse: np.ndarray,
    subray: np.ndarray,
    at: np.ndarray,
    energy: np.ndarray,
    variance: np.ndarray,
    sigma: float,
) -> WaveformEchoes:
    """Echoes of C contacts, one at least, that belong to echoes ``owner`` (C,), ascending from 0 without a
    gap: each at the mean of its light.

    variance : (C,) m², of the light of each contact about its place. sigma : m, of the pulse.
    """
    starts = np.flatnonzero(np.append(True, np.diff(owner) != 0))
    total = np.add.reduceat(energy, starts)
    share = energy / np.where(total > 0, total, 1.0)[owner]
    middle = np.add.reduceat(share * (at - at[starts][owner]), starts)
    away = at - at[starts][owner] - middle[owner]
    spread = np.add.reduceat(share * (away**2 + variance), starts)
    strong = energy >= 0.5 * np.maximum.reduceat(energy, starts)[owner]
    place = np.where(strong, subray, np.iinfo(np.int64).max // len(at) - 1)
    chosen = np.minimum.reduceat(place * len(at) + np.arange(len(at)), starts) % len(at)
    width = np.sqrt(sigma**2 + spread)
    return WaveformEchoes(pulse[starts], at[starts] + middle, total, width, chosen)


def _apart(pulse: np.ndarray, at: np.ndarray, width: np.ndarray, sigma: float) -> np.ndarray:
    """(C - 1,) bool: whether a sorted contact and all before it are far from the next and all after it."""
    apart = (np.diff(pulse) != 0) | (np.diff(at) > APART * sigma)
    wide = np.zeros(len(pulse), dtype=bool)
    wide[np.isin(pulse, pulse[width > sigma])] = True
    rows = np.flatnonzero(wide)
    if not len(rows):
        return apart
    # A contact reaches as far as 8 of its widths beyond another's 4; the farthest of a pulse so far, by
    # its place in an order of all, since a running maximum knows no pulses.
    pulse, at, reach = pulse[rows], at[rows], APART * (width[rows] - sigma / 2)
    low, high = at - reach, at + reach
    by_low, by_high = np.lexsort((low, pulse)), np.lexsort((high, pulse))
    place = np.empty((2, len(rows)), dtype=np.int64)
    place[0, by_low], place[1, by_high] = np.arange(len(rows)), np.arange(len(rows))
    behind = low[by_low[np.minimum.accumulate(place[0][::-1])[::-1]]]
    before = high[by_high[np.maximum.accumulate(place[1])]]
    inner = rows[:-1][np.diff(rows) == 1]
    here = np.flatnonzero(np.diff(rows) == 1)
    apart[inner] = (pulse[here] != pulse[here + 1]) | (before[here] < behind[here + 1])
    return apart
