"""Receiver of a scanner: which echoes of a pulse its electronics tell apart, and which of them they keep.

A discrete-return receiver starts a return where the light rises over its threshold and is blind for some time
after it: its dead zone, in metres of range. What comes meanwhile is lost and does not make the blindness
longer. A receiver that decomposes the waveform has no dead zone; the length of the pulse alone decides there
(``waveform``).
"""

from __future__ import annotations

import numpy as np

from ...spec import Scanner
from .radiometry import detection_limit, intensity
from .waveform import WaveformEchoes


def ranks(pulse: np.ndarray) -> np.ndarray:
    """(E,) how many echoes of the same pulse come before each, of sorted pulses."""
    if not len(pulse):
        return pulse
    first = np.flatnonzero(np.append(True, np.diff(pulse) != 0))
    size = np.diff(np.append(first, len(pulse)))
    rank: np.ndarray = np.arange(len(pulse)) - np.repeat(first, size)
    return rank


def awake(echoes: WaveformEchoes, dead_zone: float) -> np.ndarray:
    """(K,) rows of the echoes that a receiver is not blind for, ascending.

    dead_zone : metres after each return within which nothing is told apart from it.
    """
    rows = np.arange(len(echoes.pulse))
    if not dead_zone or not (np.diff(echoes.pulse) == 0).any():
        return rows
    rank = ranks(echoes.pulse)
    start = rows - rank  # of the pulse of each echo
    blind_until = np.full(len(rows), -np.inf)  # of a pulse, at the row where it starts
    seen = np.zeros(len(rows), dtype=bool)
    by_rank = np.argsort(rank, kind="stable")
    for here in np.split(by_rank, np.cumsum(np.bincount(rank))[:-1]):
        begin = start[here]
        seen[here] = echoes.distance[here] >= blind_until[begin]
        told = here[seen[here]]
        blind_until[start[told]] = echoes.distance[told] + dead_zone
    return np.flatnonzero(seen)


def chosen_returns(echoes: WaveformEchoes, most: int, keep: str) -> np.ndarray:
    """(K,) rows of the at most ``most`` echoes of each pulse that are kept, ascending.

    keep : ``first`` and ``last`` by range, ``strongest`` by light, ``strongest+last`` the last and the
        strongest of the others; of equally strong ones the nearer.
    """
    order = np.arange(len(echoes.pulse))
    if keep == "last":
        order = order[::-1]
    elif keep != "first":
        beyond = np.append(echoes.pulse[1:], -1)  # pulse of the next echo
        others = (echoes.pulse == beyond) | (keep == "strongest")
        order = np.lexsort((-echoes.energy, others, echoes.pulse))
    kept: np.ndarray = np.sort(order[ranks(echoes.pulse[order]) < most])
    return kept


def reading(scanner: Scanner, light: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """(E,) intensities as the receiver states them, of light (E,) 1/m² from measured ranges (E,) metres.

    Light beyond the dynamic range is read as its end. A reflectance is the light that the same target would
    send back from 1 m in clear air, so the unit stays: that of a facing surface which fills the beam at that
    range and sends as much back (Wagner 2010, ISPRS J. 65, 505, eq. 4 solved for ρ).
    """
    receiver = scanner.receiver
    if receiver.dynamic_range:
        light = np.minimum(light, detection_limit(scanner) * 10 ** (receiver.dynamic_range / 10))
    if receiver.reading == "reflectance":
        white = intensity(np.array(1.0), np.array(1.0), distance, scanner.beam.extinction)
        light = light / white
    return light
