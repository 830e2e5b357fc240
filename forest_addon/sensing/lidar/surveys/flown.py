"""Flight lines read from a cloud: where the scanner was at what time, from the beams of pulses themselves.

First and last return of a pulse lie on its beam, so many pulses of a line say where it was flown: the
polyline
in time that is nearest to all their beams (least squares; Gatziolis & McGaughey 2019, Remote Sens. 11, 1810).
Beams count by the distance between their returns, and those that miss it by far count little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

APART = 2.0  # m between first and last return of a pulse that is looked at
FEWEST = 30  # pulses of a line
STEP = 10.0  # s between the knots of a line's polyline
PAUSE = 10.0  # s without a pulse that end a line, where no point source tells lines apart
ROUNDS = 15


@dataclass(frozen=True)
class FlightLine:
    """FlightLine of a cloud: number (the point source), time (K,) s and place (K, 3) m of its knots, how many
    pulses said so, and by how much their beams' ends miss it in the median, m."""

    number: int
    time: np.ndarray
    place: np.ndarray
    pulses: int
    miss: float

    def at(self, time: np.ndarray) -> np.ndarray:
        """(P, 3) places at times (P,); the first and last stretch go on straight."""
        return np.einsum("pk,kd->pd", _hats(time, self.time), self.place)

    @property
    def velocity(self) -> np.ndarray:
        """(3,) m/s from the first knot to the last."""
        return np.asarray((self.place[-1] - self.place[0]) / (self.time[-1] - self.time[0]))


def pulses_of(time: np.ndarray, number: np.ndarray, count: np.ndarray) -> np.ndarray:
    """(N,) pulse of each return, from 0: returns of one time and number of returns that follow each other.

    A clock coarser than the pulses joins none: their returns' numbers begin anew.
    """
    new = (np.diff(time) != 0) | (np.diff(count) != 0) | (np.diff(number.astype(int)) <= 0)
    pulse: np.ndarray = np.cumsum(np.append(False, new))
    return pulse


def gaps_of(place: np.ndarray, pulse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(G,) metres between neighbouring returns of a pulse, and (G,) the row of the farther one."""
    row = np.flatnonzero(np.diff(pulse) == 0) + 1
    return np.linalg.norm(place[row] - place[row - 1], axis=1), row


def split_lines(time: np.ndarray, source: np.ndarray) -> np.ndarray:
    """(N,) number of the line of each return: its point source, or a count of pauses where all have one."""
    if len(np.unique(source)) > 1:
        return source.astype(np.int64)
    order = np.argsort(time, kind="stable")
    line = np.empty(len(time), dtype=np.int64)
    line[order] = np.cumsum(np.append(False, np.diff(time[order]) > PAUSE))
    return line


def lines_of(
    place: np.ndarray, time: np.ndarray, number: np.ndarray, count: np.ndarray, line: np.ndarray
) -> dict[int, FlightLine]:
    """Flight lines of a cloud by their number; a line of fewer than 30 pulses that say so is left out.

    place : (N, 3) m. time : (N,) s. number, count : (N,) number of a return and of its pulse's. line : (N,).
    """
    pulse = pulses_of(time, number, count)
    first = np.flatnonzero(np.append(True, np.diff(pulse) != 0))
    last = np.append(first[1:], len(pulse)) - 1
    whole = (last - first + 1 == count[first]) & (number[first] == 1)
    long = np.linalg.norm(place[last] - place[first], axis=1) > APART
    found = {}
    for name in np.unique(line).tolist():
        rows = np.flatnonzero(whole & long & (line[first] == name))
        if len(rows) >= FEWEST:
            ends = place[first[rows]], place[last[rows]]
            found[name] = _fitted(name, time[first[rows]], *ends)
    return found


def _fitted(name: int, time: np.ndarray, near: np.ndarray, far: np.ndarray) -> FlightLine:
    middle = near.mean(axis=0)
    length = np.linalg.norm(near - far, axis=1)
    way = (near - far) / length[:, None]
    beside = np.eye(3) - way[:, :, None] * way[:, None, :]
    pieces = max(1, round(float(np.ptp(time)) / STEP))
    knots = np.linspace(time.min(), max(time.max(), time.min() + 1e-3), pieces + 1)
    hats = _hats(time, knots)
    target = np.einsum("pij,pj->pi", beside, far - middle)
    weight, miss = length**2, length
    for _ in range(ROUNDS):
        # normal equations of sum w |beside (Σ hat·place - far)|²: 3K unknowns
        matrix = np.einsum("p,pk,pl,pij->kilj", weight, hats, hats, beside, optimize=True)
        right = np.einsum("p,pk,pi->ki", weight, hats, target, optimize=True)
        size = 3 * len(knots)
        solved = np.linalg.lstsq(matrix.reshape(size, size), right.ravel(), rcond=None)[0]
        knot = solved.reshape(-1, 3)
        where = np.einsum("pk,kd->pd", hats, knot)
        aside = np.linalg.norm(np.einsum("pij,pj->pi", beside, where) - target, axis=1)
        # metres at the far return, if the beam is turned about the near one to meet the line
        miss = aside * length / np.maximum(np.linalg.norm(where - far + middle, axis=1), 1e-9)
        scale = max(2 * float(np.median(miss)), 1e-6)
        weight = length**2 / (1 + (miss / scale) ** 2) ** 2
    return FlightLine(name, knots, knot + middle, len(time), float(np.median(miss)))


def _hats(time: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(P, K) weights of knots at times, linear between neighbours and beyond the ends."""
    after = np.clip(np.searchsorted(knots, time), 1, len(knots) - 1)
    share = (time - knots[after - 1]) / (knots[after] - knots[after - 1])
    hats = np.zeros((len(time), len(knots)))
    rows = np.arange(len(time))
    hats[rows, after - 1], hats[rows, after] = 1 - share, share
    return hats
