"""Full waveforms of pulses, and the echoes in them, without a sampling grid.

Every sub-ray that meets a surface at range R sends light back after the two-way time 2R/c. A short pulse
of Gaussian shape makes of that a sum of Gaussians of one width, Σ e_j·exp(-(t - t_j)²/2σ²); an echo is a
crest of this sum. Crests are found where its derivative changes sign and refined by Newton's method, so
a range has no step. Ranges R and time t = 2R/c are the same axis here, with σ in metres.

Contacts farther apart than 8σ do not matter to each other (1e-14) and are cut into groups. A group of
at most 2σ has one crest: (ln f)'' = -1/σ² + Var(t_j)/σ⁴ ≤ 0, as a variance within an interval is at most
a quarter of its length squared (Popoviciu). Longer groups are searched in steps of σ/4; two crests
closer than that count as one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LIGHT = 299_792_458.0  # m/s
FWHM = 2 * np.sqrt(2 * np.log(2))  # of a Gaussian, in standard deviations
APART = 8.0  # standard deviations beyond which contacts are treated alone
STEP = 0.25  # standard deviations, of the search for crests
PAIRS_AT_ONCE = 4_000_000


@dataclass(frozen=True)
class Echoes:
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


def sample(time: np.ndarray, distance: np.ndarray, energy: np.ndarray, sigma: float) -> np.ndarray:
    """(T,) waveform at two-way times (T,) seconds of contacts (C,): energy per metre of range."""
    away = (time[:, None] * LIGHT / 2 - distance) / sigma
    shape = np.exp(-0.5 * away**2) / (sigma * np.sqrt(2 * np.pi))
    wave: np.ndarray = shape @ energy
    return wave


def find_echoes(
    pulse: np.ndarray, subray: np.ndarray, distance: np.ndarray, energy: np.ndarray, sigma: float
) -> Echoes:
    """The echoes of C contacts.

    pulse, subray : (C,) which pulse, and which of its rays from the axis outwards.
    distance : (C,) metres. energy : (C,). sigma : metres, see ``pulse_length``.
    """
    if (np.diff(pulse) > 0).all():  # one contact a pulse: that is its echo
        return Echoes(pulse, distance, energy, np.full(len(pulse), sigma), np.arange(len(pulse)))
    order = np.lexsort((subray, distance, pulse))
    pulse, subray, energy = pulse[order], subray[order], energy[order]
    at = distance[order]
    new = (np.diff(pulse) != 0) | (np.diff(at) > APART * sigma)
    first = np.flatnonzero(np.append(True, new))
    size = np.diff(np.append(first, len(at)))
    crest, owner = _crests(at, energy, first, size, sigma)

    starts = np.flatnonzero(np.append(True, np.diff(owner) != 0))
    total = np.add.reduceat(energy, starts)
    share = energy / np.where(total > 0, total, 1.0)[owner]
    middle = np.add.reduceat(share * (at - at[starts][owner]), starts)
    spread = np.add.reduceat(share * (at - at[starts][owner] - middle[owner]) ** 2, starts)
    strong = energy >= 0.5 * np.maximum.reduceat(energy, starts)[owner]
    place = np.where(strong, subray, np.iinfo(np.int64).max // len(at) - 1)
    chosen = np.minimum.reduceat(place * len(at) + np.arange(len(at)), starts) % len(at)
    return Echoes(
        pulse=pulse[starts],
        distance=crest,
        energy=total,
        width=np.sqrt(sigma**2 + spread),
        contact=order[chosen],
    )


def _crests(
    at: np.ndarray, energy: np.ndarray, first: np.ndarray, size: np.ndarray, sigma: float
) -> tuple[np.ndarray, np.ndarray]:
    """(E,) crests of all groups, and (C,) the crest that each contact belongs to.

    at, energy : (C,) sorted contacts. first, size : (G,) contacts of each group.
    """
    length = at[first + size - 1] - at[first]
    wide = np.flatnonzero(length > 2 * sigma)
    low, high = at[first].copy(), at[first + size - 1].copy()
    if not len(wide):
        crest = _refine(at, energy, first, size, low, high, sigma)
        return crest, np.repeat(np.arange(len(first)), size)

    batches = _batches(wide, length, sigma)
    found = [_search(at, energy, first[g], size[g], sigma) for g in batches]
    crests_of = np.ones(len(first), dtype=np.int64)
    crests_of[wide] = np.concatenate([count for _, _, count, _ in found])
    group = np.repeat(np.arange(len(first)), crests_of)
    low, high = low[group], high[group]
    searched = np.isin(group, wide)
    low[searched] = np.concatenate([lows for lows, _, _, _ in found])
    high[searched] = np.concatenate([highs for _, highs, _, _ in found])
    crest = _refine(at, energy, first[group], size[group], low, high, sigma)

    owner = np.repeat(np.cumsum(crests_of) - crests_of, size)
    for batch, (_, _, _, which) in zip(batches, found, strict=True):
        owner[_ranges(first[batch], size[batch])] += which
    return crest, owner


def _search(
    at: np.ndarray, energy: np.ndarray, first: np.ndarray, size: np.ndarray, sigma: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Brackets of all crests of some groups, from the sign of the slope on a grid.

    Returns low, high : (B,) brackets, group by group. count : (G,) crests of each group. which : for the
    contacts of these groups, one after the other, which crest of their group they belong to.
    """
    start, end = at[first], at[first + size - 1]
    nodes = np.ceil((end - start) / (STEP * sigma)).astype(np.int64) + 1
    step = (end - start) / (nodes - 1)
    of_node = np.repeat(np.arange(len(first)), nodes)
    place = np.arange(len(of_node)) - np.repeat(np.cumsum(nodes) - nodes, nodes)
    x = start[of_node] + place * step[of_node]
    slope, _ = _slope(at, energy, first[of_node], size[of_node], x, sigma)
    slope[place == 0] = 1.0  # outside all contacts the way to them is up
    slope[place == nodes[of_node] - 1] = -1.0
    up = slope > 0
    inner = of_node[1:] == of_node[:-1]
    top = np.flatnonzero(inner & up[:-1] & ~up[1:])
    valley = np.flatnonzero(inner & ~up[:-1] & up[1:])
    count = np.bincount(of_node[top], minlength=len(first))

    # A contact belongs to the crest between the valleys around it; places are counted in nodes.
    share = slope[valley] / (slope[valley] - slope[valley + 1])
    first_node = np.cumsum(nodes) - nodes
    of_contact = np.repeat(np.arange(len(first)), size)
    along = (at[_ranges(first, size)] - start[of_contact]) / step[of_contact]
    passed = np.searchsorted(valley + share, first_node[of_contact] + along, side="right")
    before = np.cumsum(count - 1) - (count - 1)  # valleys of the groups before
    return x[top], x[top + 1], count, passed - before[of_contact]


def _refine(
    at: np.ndarray,
    energy: np.ndarray,
    first: np.ndarray,
    size: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    sigma: float,
) -> np.ndarray:
    """(B,) crests within brackets, each of the contacts of its group: Newton, held by bisection."""
    x = (low + high) / 2
    open_ = np.flatnonzero(high > low)
    if len(open_) == 0:
        return x
    low, high = low[open_], high[open_]
    first, size = first[open_], size[open_]
    now = x[open_]
    for _ in range(60):
        slope, bend = _slope(at, energy, first, size, now, sigma)
        low, high = np.where(slope > 0, now, low), np.where(slope > 0, high, now)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = now - slope / bend
        after = np.where((after >= low) & (after <= high) & (bend < 0), after, (low + high) / 2)
        moved = np.abs(after - now)
        x[open_] = after
        going = moved > 1e-13 * (sigma + np.abs(now))
        if not going.any():
            break
        open_, now = open_[going], after[going]
        low, high, first, size = low[going], high[going], first[going], size[going]
    return x


def _slope(
    at: np.ndarray,
    energy: np.ndarray,
    first: np.ndarray,
    size: np.ndarray,
    x: np.ndarray,
    sigma: float,
) -> tuple[np.ndarray, np.ndarray]:
    """(B,) slope of ln f at places x, times σ², and the slope's own slope: mean shift and its variance."""
    slope, bend = np.empty(len(x)), np.empty(len(x))
    bounds = np.cumsum(size)
    begin = 0
    while begin < len(x):
        stop = int(np.searchsorted(bounds, (bounds[begin] - size[begin]) + PAIRS_AT_ONCE, "right"))
        stop = max(stop, begin + 1)
        part = slice(begin, stop)
        rows = _ranges(first[part], size[part])
        starts = np.cumsum(size[part]) - size[part]
        away = at[rows] - np.repeat(x[part], size[part])
        nearest = np.minimum.reduceat(np.abs(away), starts)  # keeps the largest weight at 1
        weight = energy[rows] * np.exp(
            -0.5 * (away**2 - np.repeat(nearest, size[part]) ** 2) / sigma**2
        )
        total = np.add.reduceat(weight, starts)
        total = np.where(total > 0, total, 1.0)
        mean = np.add.reduceat(weight * away, starts) / total
        square = np.add.reduceat(weight * away**2, starts) / total
        slope[part], bend[part] = mean, (square - mean**2) / sigma**2 - 1.0
        begin = stop
    return slope, bend


def _ranges(first: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The numbers first, first + 1, … of each range, one range after the other."""
    return np.repeat(first - (np.cumsum(size) - size), size) + np.arange(int(size.sum()))


def _batches(wide: np.ndarray, length: np.ndarray, sigma: float) -> list[np.ndarray]:
    """Wide groups in pieces of a bounded number of grid nodes."""
    nodes = np.ceil(length[wide] / (STEP * sigma)) + 1
    cut = np.searchsorted(np.cumsum(nodes), np.arange(1, nodes.sum() / 1e6) * 1e6)
    return [part for part in np.split(wide, cut) if len(part)]
