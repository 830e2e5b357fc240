"""A scanner like the one that made a cloud: its way, field, lines and pulses a second, read from the
cloud itself.

Of each flight line the beams' angles in the platform's frame are taken (level, forward along the way).
Pulses come
in sweeps: the sweep's period is the line rate, the slope of angle over time within it the mirror's speed, the
pulses a second within it the pulse rate. Only the field that the cloud shows is swept again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....spec import Mobile, Pose, SpecError
from .flown import FlightLine

BREAK = 30.0  # times the usual step between pulses, that parts sweeps
LONG_SWEEP = 12  # pulses of a sweep whose speed is measured
MARGIN = 1.0  # degrees that the field is wider than what was seen
WIDE = 5.0  # degrees across that a turn of the fan about the vertical is told from


@dataclass(frozen=True)
class FlownPattern:
    """FlownPattern of a line: pulses and lines a second, field (2,) and pitch, yaw of the fan, degrees,
    whether
    the mirror swings to and fro, and the pulses a second of the instrument itself."""

    pulse_rate: float
    line_rate: float
    field_deg: tuple[float, float]
    pitch_deg: float
    yaw_deg: float
    zigzag: bool
    own_rate: float


def pattern_like(line: FlightLine, place: np.ndarray, time: np.ndarray) -> FlownPattern:
    """The pattern of a line, from one return of each pulse: place (P, 3) m, time (P,) s.

    Raises
    ------
    SpecError : sweeps cannot be told apart.
    """
    order = np.argsort(time, kind="stable")
    place, time = place[order], time[order]
    right, ahead = _in_frame(line, place, time)
    sweeps = _long_sweeps(line, time)
    # the fan is a plane through the scanner: ahead = tan(yaw)·right + tan(pitch)/cos(yaw)
    each = [_slope(right[a:b], ahead[a:b]) for a, b in sweeps]
    wide = np.degrees(np.median([np.ptp(np.arctan(right[a:b])) for a, b in sweeps])) > WIDE
    yaw = float(np.arctan(np.median(each))) if wide else 0.0
    pitch = float(np.arctan(np.median(ahead - np.tan(yaw) * right) * np.cos(yaw)))
    tangent = (right + np.tan(pitch) * np.sin(yaw)) * np.cos(pitch) / np.cos(yaw)
    angle = np.degrees(np.arctan(tangent))
    turns = np.array([_slope(time[a:b] - time[a], angle[a:b]) for a, b in sweeps])
    rate = float(np.median([(b - a - 1) / np.ptp(time[a:b]) for a, b in sweeps]))
    zigzag = bool(0.2 < (turns > 0).mean() < 0.8)
    same = turns > 0 if zigzag else np.ones(len(turns), dtype=bool)  # sweeps of one direction
    middle = np.array([time[a:b].mean() for a, b in sweeps])
    period = _period(middle[same]) / (2 if zigzag else 1)
    low, high = np.quantile(angle, [0.001, 0.999]) + np.array([-MARGIN, MARGIN])
    # Degrees between pulses, by how many there are in a sweep: clocks of some instruments step unevenly.
    swept = sum(abs(float(angle[b - 1] - angle[a])) for a, b in sweeps)
    step = swept / sum(b - 1 - a for a, b in sweeps)
    a_line = max(2, round((high - low) / step))
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
    scanner: Mobile, line: FlightLine, pattern: FlownPattern, offset: np.ndarray, start: float
) -> Mobile:
    """A scanner that flies a line again; places less the offset (3,) m, times less ``start`` s."""
    return scanner.changed(
        name=f"line-{line.number}",
        pattern="zigzag" if pattern.zigzag else "lines",
        field_deg=tuple(round(a, 3) for a in pattern.field_deg),
        line_rate=pattern.line_rate,
        pulse_rate=pattern.pulse_rate,
        mount_deg=(0.0, round(pattern.pitch_deg, 3), round(pattern.yaw_deg, 3)),
        poses=poses_of(line, offset, start),
    )


def poses_of(line: FlightLine, offset: np.ndarray, start: float) -> tuple[Pose, ...]:
    """Poses at a line's knots, level, forward along the way."""
    heading = float(np.degrees(np.arctan2(line.velocity[1], line.velocity[0])))
    return tuple(
        Pose(
            time=round(float(when - start), 6),
            position=tuple(float(v) for v in np.round(where - offset, 3)),
            heading_deg=round(heading, 3),
        )
        for when, where in zip(line.time, line.place, strict=True)
    )


def _in_frame(
    line: FlightLine, place: np.ndarray, time: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(P,) metres to the right and (P,) ahead of the platform, a metre down."""
    way = place - line.at(time)
    ahead = line.velocity[:2] / np.linalg.norm(line.velocity[:2])
    down = np.maximum(-way[:, 2], 1e-6)
    right = way[:, 0] * ahead[1] - way[:, 1] * ahead[0]
    return right / down, way[:, :2] @ ahead / down


def _long_sweeps(line: FlightLine, time: np.ndarray) -> list[tuple[int, int]]:
    """First and past-the-last pulse of the sweeps of a dozen pulses and more, of sorted times.

    Raises
    ------
    SpecError : there are fewer than three.
    """
    pairs = zip(*(edge.tolist() for edge in _cuts(time)), strict=True)
    found = [(a, b) for a, b in pairs if b - a >= LONG_SWEEP and time[b - 1] > time[a]]
    if len(found) < 3:
        raise SpecError(
            f"line {line.number}",
            "has fewer than three sweeps of a dozen pulses; nothing tells its pattern",
        )
    return found


def _slope(x: np.ndarray, y: np.ndarray) -> float:
    """Slope of the straight line through points."""
    away = x - x.mean()
    return float((away * y).sum() / max((away * away).sum(), 1e-300))


def _cuts(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and past-the-last pulse of each sweep, of sorted times: long pauses part them."""
    step = np.diff(time)
    usual = max(float(np.median(step[step > 0])), 1e-9) if (step > 0).any() else 1e-9
    cut = np.flatnonzero(step > BREAK * usual) + 1
    return np.append(0, cut), np.append(cut, len(time))


def _period(middle: np.ndarray) -> float:
    """Seconds from one sweep to the next, some sweeps missing: the usual step, then a straight line."""
    step = np.diff(middle)
    period = float(np.median(step[step > 0.5 * np.median(step)]))
    turn = np.append(0, np.cumsum(np.maximum(np.round(step / period), 0)))
    return float(np.polynomial.polynomial.polyfit(turn, middle - middle[0], 1)[1])
