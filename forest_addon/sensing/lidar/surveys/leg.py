"""Legs of a survey of HELIOS++ as patterns: which pulses leave the device, from where and in which direction.

The frames are those of HELIOS++: platform, mount, head, channel and deflector, each turned on the one before;
the mount and the beam's origin are shifted, but not turned, with what carries them (Winiwarter et al. 2022).
A platform that moves looks along its way, level, with +Y forward, but for one whose track has attitudes.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ....base.attitudes import composed
from ....base.rows import distinct
from ....formats.helios.survey import Leg, Survey
from ....spec import SpecError
from ..pattern import Pulses
from ..specular import refracted

MOST_STEPS = 200_000_000


class SurveyLeg:
    """The pulses of a leg, all channels of a step one after the other; see ``pattern.Pattern``.

    Raises
    ------
    SpecError : a leg that never ends, or sends no pulse.
    """

    def __init__(self, survey: Survey, leg: Leg) -> None:
        self._survey, self._leg, self._device = survey, leg, survey.device
        x, y, _ = leg.stop - leg.start
        heading = Rotation.from_euler("z", np.arctan2(-x, y) if x or y else 0.0)
        self._carried = heading * survey.mount_turn
        self._channels = len(self._device.turn)
        self._first, self._sweep = self._mirror()
        self._sent = np.arange(step_count(survey, leg))
        if self._device.optics == "rotating" and leg.scan_hz:
            low, high = np.deg2rad(leg.field_deg)
            angle = self._angles(self._sent)
            self._sent = self._sent[(angle > low) & (angle <= high)]
        self.count = len(self._sent) * self._channels
        if not self.count:
            raise SpecError("leg", "sends no pulse; check its scan angle")

    def _mirror(self) -> tuple[np.ndarray, np.ndarray]:
        """Angles of a mirror, radians: those of its first sweep, and of each after it."""
        leg, device, none = self._leg, self._device, np.zeros(0)
        widest = float(np.deg2rad(leg.scan_angle_deg))
        if device.optics == "line":  # of fibres, one after the other
            return none, -widest + 2 * widest / device.fibres * np.arange(device.fibres)
        if not leg.scan_hz or device.optics not in ("rotating", "oscillating"):
            return none, np.zeros(1)
        if device.optics == "oscillating":
            return none, oscillating(leg.pulse_rate, leg.scan_hz, widest, device.scan_product)
        widest = float(np.deg2rad(device.scan_angle_deg))
        return sawtooth(leg.scan_hz * (widest + widest) / leg.pulse_rate, widest)

    def _angles(self, step: np.ndarray) -> np.ndarray:
        """(P,) angles of the mirror at steps (P,) from 0 on, radians."""
        every = np.concatenate([self._first, self._sweep])
        late = step - len(self._first)
        return every[np.where(late < 0, step, len(self._first) + late % len(self._sweep))]

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
            return turned(self._angles(step))
        if device.optics == "conic":
            turns = (step + 1) * (device.scan_hz / leg.pulse_rate)
            return cone(2 * np.pi * (turns % 1.0), float(np.deg2rad(leg.scan_angle_deg)))
        way, across, angle = np.empty((len(step), 3)), np.empty((len(step), 3)), np.empty(len(step))
        for index in distinct(channel):
            rows = np.flatnonzero(channel == index)
            time = (step[rows] + 1) / leg.pulse_rate
            deflected = risley(time, device.prisms, device.incident[index])
            way[rows], across[rows], angle[rows] = deflected
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


# Directions in which mirrors, fibres and turning prisms send a beam, pulse by pulse.
#
# The frame of a deflector is that of HELIOS++ (Winiwarter et al. 2022): the beam leaves forward, +Y; a
# mirror turns it about +X, a cone about +Y.


Ways = tuple[
    np.ndarray, np.ndarray, np.ndarray
]  # directions (P, 3), across (P, 3), angles (P,) radians


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
    there, back = np.arange(half), np.arange(swing - half)
    rise = np.minimum((there - 1) / (turning - 1), (half - there) / turning)
    fall = np.minimum((back - 1) / turning, (swing - half - back) / (turning - 1))
    gone = [np.cumsum(fastest * np.clip(share, 0, 1)) for share in (rise, fall)]
    return np.concatenate([gone[0] - widest, widest - gone[1]])


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


def risley(
    time: np.ndarray, wedges: tuple[tuple[float, float, float], ...], incident: np.ndarray
) -> Ways:
    """Ways through turning wedges at times (P,), seconds, by Snell's law at each face (Li et al. 2017).

    wedges : degrees, turns a second and refractive index of each; one of positive angle has its first face
    tilted, one of negative angle its second.

    Raises
    ------
    SpecError : light is reflected totally.
    """
    way = np.broadcast_to(incident / np.linalg.norm(incident), (len(time), 3))
    flat = np.broadcast_to(np.array([0.0, -1.0, 0.0]), way.shape)
    for angle, turns, index in wedges:
        about, lean = 2 * np.pi * turns * time, np.deg2rad(angle)
        down = np.full(len(time), -np.cos(lean))
        tilt = np.stack([np.sin(about) * np.sin(lean), down, np.cos(about) * np.sin(lean)], axis=1)
        faces = (tilt, flat) if angle >= 0 else (flat, tilt)
        for face, ratio in zip(faces, (index, 1 / index), strict=True):
            way, _, behind = refracted(way, face, np.full(len(way), ratio))
            if np.isnan(behind).any():
                raise SpecError("scanner", "its prisms reflect the beam totally")
    across = np.cross(way, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return way, across, np.arccos(np.clip(way[:, 1], -1, 1))
