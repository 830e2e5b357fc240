"""A scanner like the one that made a cloud: its way, field, lines and pulses a second, read from the
cloud itself.

Of each flight line the beams' angles in the platform's frame are taken (level, forward along the way).
Pulses come
in sweeps: the sweep's period is the line rate, the slope of angle over time within it the mirror's speed, the
pulses a second within it the pulse rate. Only the field that the cloud shows is swept again.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ....base.rows import distinct
from ....spec import Mobile, Pose, SpecError

BREAK = 30.0  # times the usual step between pulses, that parts sweeps
LONG_SWEEP = 12  # pulses of a sweep whose speed is measured
SLOWEST, FASTEST = 0.01, 150.0  # m/s of what carries a scanner
CONTRADICT = 5.0  # degrees between a beam and its file's angle
MARGIN = 1.0  # degrees that the field is wider than what was seen
WIDE = 5.0  # degrees across that a turn of the fan about the vertical is told from


@dataclass(frozen=True)
class FlownPattern:
    """Pattern of a line: pulses and lines a second, field (2,) and pitch, yaw of the fan, degrees,
    whether
    the mirror swings to and fro, and the pulses a second of the instrument itself."""

    pulse_rate: float
    line_rate: float
    field_deg: tuple[float, float]
    pitch_deg: float
    yaw_deg: float
    zigzag: bool
    own_rate: float


def pattern_like(
    line: FlightLine, place: np.ndarray, time: np.ndarray, scan_angle: np.ndarray
) -> FlownPattern:
    """The pattern of a line, from one return of each pulse: place (P, 3) m, time (P,) s, and what its file
    says of its angle (P,), degrees; all 0: nothing.

    Raises
    ------
    SpecError : sweeps cannot be told apart; the way is faster than aircraft are, or not what the angles say;
    pulses are more than the sweeps have, as of several lines taken as one.
    """
    speed = float(np.linalg.norm(line.velocity))
    if not SLOWEST < speed < FASTEST:
        raise SpecError(
            f"line {line.number}",
            f"would be flown at {speed:.3g} m/s; are its coordinates in metres, and its times in seconds? "
            "If they are feet, name the system with --crs",
        )
    order = np.argsort(time, kind="stable")
    place, time, scan_angle = place[order], time[order], scan_angle[order]
    # metres to the right and ahead of the platform, a metre down
    way, onward = place - line.at(time), line.velocity[:2] / np.linalg.norm(line.velocity[:2])
    down = np.maximum(-way[:, 2], 1e-6)
    right = (way[:, 0] * onward[1] - way[:, 1] * onward[0]) / down
    ahead = way[:, :2] @ onward / down
    sweeps = _long_sweeps(line, time)
    # the fan is a plane through the scanner: ahead = tan(yaw)·right + tan(pitch)/cos(yaw)
    each = [_slope(right[a:b], ahead[a:b]) for a, b in sweeps]
    wide = np.degrees(np.median([np.ptp(np.arctan(right[a:b])) for a, b in sweeps])) > WIDE
    yaw = float(np.arctan(np.median(each))) if wide else 0.0
    pitch = float(np.arctan(np.median(ahead - np.tan(yaw) * right) * np.cos(yaw)))
    tangent = (right + np.tan(pitch) * np.sin(yaw)) * np.cos(pitch) / np.cos(yaw)
    angle = np.degrees(np.arctan(tangent))
    away = min(float(np.median(np.abs(angle - side * scan_angle))) for side in (1, -1))
    if scan_angle.any() and away > CONTRADICT:
        raise SpecError(
            f"line {line.number}",
            f"has beams {away:.0f}° from the scan angles of its file in the median; are heights and "
            "places in one unit, and are returns of a pulse whole?",
        )
    turns = np.array([_slope(time[a:b] - time[a], angle[a:b]) for a, b in sweeps])
    rate = float(np.median([(b - a - 1) / np.ptp(time[a:b]) for a, b in sweeps]))
    zigzag = bool(0.2 < (turns > 0).mean() < 0.8)
    same = turns > 0 if zigzag else np.ones(len(turns), dtype=bool)  # sweeps of one direction
    middle = np.array([time[a:b].mean() for a, b in sweeps])
    if same.sum() < 2:
        raise SpecError(f"line {line.number}", "has one sweep to a side; nothing tells its pattern")
    # From one sweep to the next, some sweeps missing: the usual step, then a straight line.
    middle = middle[same]
    gaps = np.diff(middle)
    usual = float(np.median(gaps[gaps > 0.5 * np.median(gaps)]))
    turn = np.append(0, np.cumsum(np.maximum(np.round(gaps / usual), 0)))
    slope = np.polynomial.polynomial.polyfit(turn, middle - middle[0], 1)[1]
    period = float(slope) / (2 if zigzag else 1)
    low, high = np.quantile(angle, [0.001, 0.999]) + np.array([-MARGIN, MARGIN])
    # Degrees between pulses, by how many there are in a sweep: clocks of some instruments step unevenly.
    swept = sum(abs(float(angle[b - 1] - angle[a])) for a, b in sweeps)
    step = swept / sum(b - 1 - a for a, b in sweeps)
    a_line = max(2, round((high - low) / step))
    if a_line / period > 2 * rate:  # pulses follow each other no faster than within a sweep
        raise SpecError(
            f"line {line.number}",
            f"would send {a_line / period:.3g} pulses/s, and within its sweeps it sends {rate:.3g}: several "
            "lines were taken as one; number them as point_source_id, or part their times by more than "
            f"{PAUSE:g} s",
        )
    return FlownPattern(
        pulse_rate=float(np.clip(a_line / period, 1, 1e9)),
        line_rate=1 / period,
        field_deg=(float(max(low, -180)), float(min(high, 180))),
        pitch_deg=float(np.degrees(pitch)),
        yaw_deg=float(np.degrees(yaw)),
        zigzag=zigzag,
        own_rate=rate,
    )


def scanner_like(
    scanner: Mobile,
    line: FlightLine,
    pattern: FlownPattern,
    offset: np.ndarray,
    rows: np.ndarray | None = None,
) -> Mobile:
    """A scanner that flies a line again; places less the offset (3,) m, times less those of its first knot.

    rows : (K, 7) poses as of ``trajectories``; left out: those of the line's knots, level, forward along the
    way.
    """
    if rows is None:
        heading = round(float(np.degrees(np.arctan2(line.velocity[1], line.velocity[0]))), 3)
        level = np.tile([heading, 0.0, 0.0], (len(line.time), 1))
        rows = np.column_stack([line.time, line.place, level])
    return scanner.changed(
        name=f"line-{line.number}",
        pattern="zigzag" if pattern.zigzag else "lines",
        field_deg=tuple(round(a, 3) for a in pattern.field_deg),
        line_rate=pattern.line_rate,
        pulse_rate=pattern.pulse_rate,
        mount_deg=(0.0, round(pattern.pitch_deg, 3), round(pattern.yaw_deg, 3)),
        poses=tuple(
            Pose(
                time=round(time, 6),
                position=tuple(round(v, 3) for v in place),
                heading_deg=heading,
                pitch_deg=pitch,
                roll_deg=roll,
            )
            for time, *place, heading, pitch, roll in (
                rows - [line.time[0], *offset, 0, 0, 0]
            ).tolist()
        ),
        speed=Mobile.__dataclass_fields__["speed"].default,  # poses say it
    )


def _long_sweeps(line: FlightLine, time: np.ndarray) -> list[tuple[int, int]]:
    """First and past-the-last pulse of the sweeps of a dozen pulses and more, of sorted times: long pauses
    part them.

    Raises
    ------
    SpecError : there are fewer than three.
    """
    step = np.diff(time)
    usual = max(float(np.median(step[step > 0])), 1e-9) if (step > 0).any() else 1e-9
    cuts = [0, *(np.flatnonzero(step > BREAK * usual) + 1).tolist(), len(time)]
    sweeps = [(a, b) for a, b in pairwise(cuts) if b - a >= LONG_SWEEP and time[b - 1] > time[a]]
    if len(sweeps) < 3:
        raise SpecError(
            f"line {line.number}",
            "has fewer than three sweeps of a dozen pulses; nothing tells its pattern",
        )
    return sweeps


def _slope(x: np.ndarray, y: np.ndarray) -> float:
    """Slope of the straight line through points."""
    away = x - x.mean()
    return float((away * y).sum() / max((away * away).sum(), 1e-300))


# Flight lines read from a cloud: where the scanner was at what time, from the beams of pulses themselves.
#
# First and last return of a pulse lie on its beam, so many pulses of a line say where it was flown: the
# polyline in time that is nearest to all their beams (least squares; Gatziolis & McGaughey 2019, Remote
# Sens. 11, 1810). Beams count by the distance between their returns, and those that miss it by far count
# little.


APART = 2.0  # m between first and last return of a pulse that is looked at
FEWEST = 30  # pulses of a line
STEP = 10.0  # s between the knots of a line's polyline
PAUSE = 10.0  # s without a pulse that end a line, where no point source tells lines apart
ROUNDS = 15


@dataclass(frozen=True)
class FlightLine:
    """Line of a cloud: number (the point source), time (K,) s and place (K, 3) m of its knots, how many
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
    return np.cumsum(np.append(False, new))


def split_lines(time: np.ndarray, source: np.ndarray) -> np.ndarray:
    """(N,) number of the line of each return: its point source, or a count of pauses where all have one."""
    if len(distinct(source)) > 1:
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
    lines = {}
    for name in distinct(line).tolist():
        rows = np.flatnonzero(whole & long & (line[first] == name))
        if len(rows) >= FEWEST:
            ends = place[first[rows]], place[last[rows]]
            lines[name] = _fitted(name, time[first[rows]], *ends)
    return lines


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
