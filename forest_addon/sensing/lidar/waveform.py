"""Full waveforms of pulses, and the echoes in them, without a sampling grid.

Every sub-ray that meets a surface at range R sends light back after the two-way time 2R/c. A short pulse
of Gaussian shape makes of that a sum of Gaussians, Σ e_j/s_j·exp(-(t - t_j)²/2s_j²); an echo is a crest of
this sum (``crests``). Ranges R and time t = 2R/c are the same axis here, with widths in metres: σ of the
pulse, and s_j² = σ² + b_j² where the light of a contact is spread along the surface (``patches``).

Contacts farther apart than 8 widths do not matter to each other (1e-14) and are cut into groups. A contact
belongs to the crest between whose valleys it lies; a crest that no contact lies at is no echo.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rows import RowTable
from .crests import crests

LIGHT = 299_792_458.0  # m/s
FWHM = 2 * np.sqrt(2 * np.log(2))  # of a Gaussian, in standard deviations
FEW = 64  # contacts of a pulse
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
    order = _by_range(pulse, distance)
    pulse, subray, energy = pulse[order], subray[order], energy[order]
    at, width = distance[order], np.hypot(sigma, blur[order])
    first = np.flatnonzero(np.append(True, _apart(pulse, at, width, sigma)))
    size = np.diff(np.append(first, len(at)))
    crest, owner = crests(at, energy, width, first, size)

    starts = np.flatnonzero(np.append(True, np.diff(owner) != 0))
    total = np.add.reduceat(energy, starts)
    share = energy / np.where(total > 0, total, 1.0)[owner]
    middle = np.add.reduceat(share * (at - at[starts][owner]), starts)
    away = at - at[starts][owner] - middle[owner]
    spread = np.add.reduceat(share * (away**2 + (width**2 - sigma**2)), starts)
    strong = energy >= 0.5 * np.maximum.reduceat(energy, starts)[owner]
    place = np.where(strong, subray, np.iinfo(np.int64).max // len(at) - 1)
    chosen = np.minimum.reduceat(place * len(at) + np.arange(len(at)), starts) % len(at)
    return WaveformEchoes(
        pulse=pulse[starts],
        distance=crest,
        energy=total,
        width=np.sqrt(sigma**2 + spread),
        contact=order[chosen],
    )


def _by_range(pulse: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Order of contacts by pulse and then by distance; as they came where these are equal."""
    first = np.flatnonzero(np.diff(pulse, prepend=-1))
    size = np.diff(np.append(first, len(pulse)))
    if (np.diff(pulse) >= 0).all() and size.max() <= FEW:
        # Each pulse a row of a table: short rows are sorted faster than all contacts together.
        place = np.arange(size.max())
        table = np.full((len(first), len(place)), np.inf)
        here = place < size[:, None]
        table[here] = distance
        within = np.argsort(table, axis=1, kind="stable")
        nearest: np.ndarray = (within + first[:, None])[here]
        return nearest
    order = np.argsort(distance, kind="stable")
    by_range: np.ndarray = order[np.argsort(pulse[order], kind="stable")]
    return by_range


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
