"""Directions in which mirrors, fibres and turning prisms send a beam, pulse by pulse.

The frame of a deflector is that of HELIOS++ (Winiwarter et al. 2022): the beam leaves forward, +Y; a mirror
turns it about +X, a cone about +Y.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....spec import SpecError

Ways = tuple[
    np.ndarray, np.ndarray, np.ndarray
]  # directions (P, 3), across (P, 3), angles (P,) radians
Wedge = tuple[float, float, float]  # angle in radians, turns a second, refractive index


def sawtooth(step: float, widest: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles of a polygon mirror, radians: those of its first sweep, which starts at 0, and of each after it,
    which starts at -widest; each ends where the next step would reach ``widest``.

    Steps are added one by one, as HELIOS++ does, so that the last pulse of a sweep is the same.

    Raises
    ------
    SpecError : a mirror that stands still or turns by all of its field at once.
    """
    if not 0 < step < widest:
        raise SpecError("scanFreq_hz", "must be above 0, and below the rate of the pulses")

    def sweep(start: float) -> np.ndarray:
        count = int(np.ceil((widest - start) / step)) + 2
        angle = np.cumsum(np.concatenate([[start], np.full(count, step)]))
        return np.asarray(angle[: int(np.argmax(angle >= widest))])

    return sweep(0.0)[1:], sweep(-widest)


def mirror_angles(number: np.ndarray, first: np.ndarray, sweep: np.ndarray) -> np.ndarray:
    """(P,) angles of steps (P,) from 0 on of a mirror whose sweeps ``sawtooth`` gives."""
    late = np.maximum(number - len(first), 0) % len(sweep)
    early = first[np.minimum(number, len(first) - 1)] if len(first) else sweep[late]
    return np.where(number < len(first), early, sweep[late])


def oscillating(pulse_rate: float, scan_hz: float, widest: float, product: float) -> np.ndarray:
    """Angles of a mirror that swings from -``widest`` to ``widest`` and back, radians, for each pulse of
    a swing.

    product : degrees times hertz that it can do; a faster swing is slowed. It takes 50 pulses from rest to
    its full speed and as many back, as in HELIOS++.

    Raises
    ------
    SpecError : fewer pulses a swing than it takes to turn round.
    """
    turning = 50
    scan_hz = min(scan_hz, product / np.rad2deg(widest)) if widest else scan_hz
    swing = int(pulse_rate / scan_hz)
    half = swing // 2
    if half <= 2 * turning:
        raise SpecError(
            "scanFreq_hz",
            f"{scan_hz:g} leaves {swing} pulses a swing; a mirror that turns needs 202",
        )
    fastest = 2 * widest / (half - 2 * turning + (2 * turning - 1) / 2)
    place = np.arange(swing)
    up, down = place < half, place > half
    speed = np.where(up, fastest, -fastest)
    speed[0] = speed[half] = 0.0
    first = (place >= 1) & (place < turning)
    speed[first] *= (place[first] - 1) / (turning - 1)
    slows = up & (place >= half - turning) & (place > 0)
    speed[slows] *= (half - place[slows]) / turning
    starts = down & (place < half + 1 + turning)
    speed[starts] *= (place[starts] - half - 1) / turning
    ends = down & (place >= swing - turning + 1)
    speed[ends] *= (swing - place[ends]) / (turning - 1)
    rise = -widest + np.cumsum(speed[:half])
    return np.concatenate([rise, widest + np.cumsum(speed[half:])])


def fibres(count: int, widest: float) -> np.ndarray:
    """Angles of a line of so many fibres from -``widest`` on, radians, one after the other."""
    return -widest + 2 * widest / count * np.arange(count)


def turned(angle: np.ndarray) -> Ways:
    """Ways of a beam that a mirror turns about X by angles (P,), radians."""
    cos, sin, none = np.cos(angle), np.sin(angle), np.zeros(len(angle))
    return np.stack([none, cos, sin], 1), np.stack([none, -sin, cos], 1), angle


def cone(turn: np.ndarray, half: float) -> Ways:
    """Ways on a cone about Y of this half angle, by the angle of the turn (P,), radians (Palmer scan)."""
    cos, sin = np.cos(turn), np.sin(turn)
    way = np.stack([np.sin(half) * sin, np.full(len(turn), np.cos(half)), np.sin(half) * cos], 1)
    across = np.stack([cos, np.zeros(len(turn)), -sin], 1)
    return way, across, np.full(len(turn), half)


def risley(time: np.ndarray, wedges: Sequence[Wedge], air: float, incident: np.ndarray) -> Ways:
    """Ways through turning wedges at times (P,), seconds, by Snell's law at each face (Li et al. 2017).

    A wedge of positive angle has its first face tilted, one of negative angle its second.
    """
    way = np.broadcast_to(incident / np.linalg.norm(incident), (len(time), 3))
    flat = np.broadcast_to(np.array([0.0, -1.0, 0.0]), way.shape)
    for angle, turns, index in wedges:
        about = 2 * np.pi * turns * time
        tilt = np.stack(
            [
                np.sin(about) * np.sin(angle),
                np.full(len(time), -np.cos(angle)),
                np.cos(about) * np.sin(angle),
            ],
            axis=1,
        )
        faces = (tilt, flat) if angle >= 0 else (flat, tilt)
        way = refracted(way, faces[0], air / index)
        way = refracted(way, faces[1], index / air)
    across = np.cross(way, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return way, across, np.arccos(np.clip(way[:, 1], -1, 1))


def refracted(way: np.ndarray, normal: np.ndarray, ratio: float) -> np.ndarray:
    """(P, 3) directions behind a face whose unit normals (P, 3) point against ``way``, by Snell's law.

    ratio : refractive index before the face over that behind it.

    Raises
    ------
    SpecError : light is reflected totally.
    """
    cos = -np.einsum("pi,pi->p", way, normal)
    inside = 1 - ratio**2 * (1 - cos**2)
    if (inside < 0).any():
        raise SpecError("scanner", "its prisms reflect the beam totally")
    behind = ratio * way + (ratio * cos - np.sqrt(inside))[:, None] * normal
    return np.asarray(behind / np.linalg.norm(behind, axis=1, keepdims=True))
