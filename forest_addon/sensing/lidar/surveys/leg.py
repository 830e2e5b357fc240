"""Legs of a survey of HELIOS++ as patterns: which pulses leave the device, from where and in which direction.

The frames are those of HELIOS++: platform, mount, head, channel and deflector, each turned on the one before;
the mount and the beam's origin are shifted, but not turned, with what carries them (Winiwarter et al. 2022).
A platform that moves looks along its way, level, with +Y forward, but for one whose track has attitudes.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ....base.attitudes import composed
from ....formats.helios.legs import Leg
from ....formats.helios.survey import Survey
from ....spec import SpecError
from ..scanner import Pulses
from .mirrors import Ways, cone, fibres, mirror_angles, oscillating, risley, sawtooth, turned

MOST_STEPS = 200_000_000


class SurveyLeg:
    """The pulses of a leg, all channels of a step one after the other; see ``scanner.Pattern``.

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
        for index in np.unique(channel):
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
