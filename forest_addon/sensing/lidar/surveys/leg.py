"""Legs of a survey of HELIOS++ as patterns: which pulses leave the device, from where and in which direction.

The frames are those of HELIOS++: platform, mount, head, channel and deflector, each turned on the one before;
the mount and the beam's origin are shifted, but not turned, with what carries them (Winiwarter et al. 2022).
A platform that moves looks along its way, level, with +Y forward, but for one whose track has attitudes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from ....base.attitudes import composed
from ....base.rows import distinct
from ....formats.helios.legs import Leg
from ....formats.helios.survey import Survey
from ....spec import SpecError
from ..pattern import Pulses

MOST_STEPS = 200_000_000


class SurveyLeg:
    """The pulses of a leg, all channels of a step one after the other; see ``pattern.Pattern``.

    Raises
    ------
    SpecError : a leg that never ends, or sends no pulse.
    """

    def __init__(self, survey: Survey, leg: Leg) -> None:
        self._survey, self._leg, self._device = survey, leg, survey.device
        steps = step_count(survey, leg)
        self._carried = _heading(leg) * survey.mount_turn
        self._channels = len(self._device.turn)
        self._sweeps = self._mirror()
        step = np.arange(steps)
        if self._sweeps and self._device.optics == "rotating":
            low, high = np.deg2rad(leg.field_deg)
            angle = mirror_angles(step, *self._sweeps)
            step = step[(angle > low) & (angle <= high)]
        self._sent = step
        self.count = len(step) * self._channels
        if not self.count:
            raise SpecError("leg", "sends no pulse; check its scan angle")

    def _mirror(self) -> tuple[np.ndarray, np.ndarray] | None:
        leg, device = self._leg, self._device
        widest = float(np.deg2rad(leg.scan_angle_deg))
        if device.optics == "line":
            return np.zeros(0), fibres(device.fibres, widest)
        if device.optics not in ("rotating", "oscillating") or not leg.scan_hz:
            return None
        if device.optics == "oscillating":
            return np.zeros(0), oscillating(
                leg.pulse_rate, leg.scan_hz, widest, device.scan_product
            )
        widest = float(np.deg2rad(device.scan_angle_deg))
        return sawtooth(leg.scan_hz * (widest + widest) / leg.pulse_rate, widest)

    def pulses(self, number: np.ndarray) -> Pulses:
        """See ``Pattern``; the scan angle is that of the deflector."""
        leg, device, survey = self._leg, self._device, self._survey
        step, channel = self._sent[number // self._channels], number % self._channels
        time = (step + 1) / leg.pulse_rate
        way, across, angle = self._deflected(step, channel)
        head = np.deg2rad(leg.head_deg[0] + leg.head_speed * time)
        axis = device.head_axis / np.linalg.norm(device.head_axis)
        for index, turn in enumerate(device.turn):
            rows = np.flatnonzero(channel == index) if self._channels > 1 else slice(None)
            way[rows], across[rows] = turn.apply(way[rows]), turn.apply(across[rows])
        cos, sin = np.cos(head), np.sin(head)
        place, carried = self._way(time)
        return Pulses(
            origin=place + survey.mount + device.origin[channel],
            direction=carried.apply(_about(axis, cos, sin, way)),
            across=carried.apply(_about(axis, cos, sin, across)),
            time=time,
            scan_angle=angle,
        )

    def _way(self, time: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """(P, 3) places of the platform at times (P,) of the leg, and how what it carries is turned."""
        leg = self._leg
        if leg.track is not None:
            place, attitude = leg.track.at(leg.seconds[0] + time)
            turned = (
                self._carried if attitude is None else composed(attitude, self._survey.mount_turn)
            )
            return place, turned
        along = leg.stop - leg.start
        length = float(np.linalg.norm(along))
        gone = leg.speed * time[:, None] * along / length if length else np.zeros((len(time), 3))
        return leg.start + gone, self._carried

    def _deflected(self, step: np.ndarray, channel: np.ndarray) -> Ways:
        leg, device = self._leg, self._device
        if device.optics in ("rotating", "oscillating", "line"):
            fixed = np.zeros(len(step))
            return turned(mirror_angles(step, *self._sweeps) if self._sweeps else fixed)
        half = float(np.deg2rad(leg.scan_angle_deg))
        if device.optics == "conic":
            turns = (step + 1) * (device.scan_hz / leg.pulse_rate)
            return cone(2 * np.pi * (turns % 1.0), half)
        wedges = [(float(np.deg2rad(p.angle_deg)), p.turns_hz, p.index) for p in device.prisms]
        way, across, angle = np.empty((len(step), 3)), np.empty((len(step), 3)), np.empty(len(step))
        for index in distinct(channel):
            rows = np.flatnonzero(channel == index)
            time = (step[rows] + 1) / leg.pulse_rate
            found = risley(time, wedges, 1.0, device.incident[index])
            way[rows], across[rows], angle[rows] = found
        return way, across, angle


def step_count(survey: Survey, leg: Leg) -> int:
    """Pulses of one channel from the first to the end of a leg, of which some may stay in the device.

    A leg ends where the platform arrives, or its track; else where the head has turned, else after its
    longest time.

    Raises
    ------
    SpecError : it never ends.
    """
    seconds = leg.most_seconds
    length = float(np.linalg.norm(leg.stop - leg.start))
    turn = (leg.head_deg[1] - leg.head_deg[0]) * np.sign(leg.head_speed)
    if leg.track is not None:
        seconds = min(seconds, leg.seconds[1] - leg.seconds[0])
    elif survey.moves:
        if leg.speed <= 0:
            raise SpecError("leg", "moves with movePerSec_m = 0 and never arrives")
        seconds = min(seconds, length / leg.speed)
    elif leg.head_speed:
        seconds = min(seconds, max(turn, 0.0) / abs(leg.head_speed))
    steps = seconds * leg.pulse_rate
    if not steps < MOST_STEPS:
        raise SpecError(
            "leg", "has no end, or too many pulses; give headRotateStop_deg or maxDuration_s"
        )
    return int(np.ceil(steps - 1e-6))


def _about(axis: np.ndarray, cos: np.ndarray, sin: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(P, 3) vectors about a unit axis (3,) by angles with these cosines and sines (P,): Rodrigues 1840."""
    x, y, z = v.T
    along = (axis[0] * x + axis[1] * y + axis[2] * z) * (1 - cos)
    turned = np.empty_like(v)
    for k, (one, other) in enumerate(((1, 2), (2, 0), (0, 1))):
        beside = axis[one] * v[:, other] - axis[other] * v[:, one]
        turned[:, k] = v[:, k] * cos + beside * sin + axis[k] * along
    return turned


def _heading(leg: Leg) -> Rotation:
    """The attitude of a level platform whose +Y looks along the leg."""
    x, y, _ = leg.stop - leg.start
    return Rotation.from_euler("z", np.arctan2(-x, y) if x or y else 0.0)


# Directions in which mirrors, fibres and turning prisms send a beam, pulse by pulse.
#
# The frame of a deflector is that of HELIOS++ (Winiwarter et al. 2022): the beam leaves forward, +Y; a
# mirror turns it about +X, a cone about +Y.


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
