"""Ways of platforms that HELIOS++ drives by forces: copters and vehicles on the ground.

A step of HELIOS++ is a pulse. In each of them the velocity v, metres a pulse, becomes
(1 - drag)·v + force/f at f pulses a second, cut to the speed that a leg states; lift takes gravity away. A
copter's force grows and shrinks by a factor a step, along its heading where it turns smoothly, else
towards its waypoint. A vehicle steers by 0.1 rad a metre; where that is too little it backs by 0.25.
Steps of 0.2 ms are taken here, in which a force is even and the drag's geometric series is summed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, hypot, inf, pi, sin
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ...spec import SpecError
from .document import number, yes
from .track import SurveyTrack

STEPS_A_SECOND = 5_000
STEPS_A_ROW = 5  # of a track
PATIENCE = 60.0, 10.0  # seconds of a leg, and how often longer it may take than straight on
MISSED = 0.01  # metres beside a waypoint that are told
STOPPED = 1e-7  # share of its force at which a copter stands


@dataclass(frozen=True)
class DrivenLeg:
    """A leg of a driven platform: waypoints (3,) from, to and after that (None: there is none), its settings
    and pulses a second."""

    start: np.ndarray
    stop: np.ndarray
    after: np.ndarray | None
    settings: Element
    rate: float

    def yes(self, key: str, otherwise: bool) -> bool:
        """The truth of a setting."""
        return yes(self.settings.get(key), otherwise)


class _Body:
    """Place, m, velocity, m a pulse, and heading, radians from +Y to -X, of a platform with drag."""

    def __init__(self, platform: Element, path: Path, start: np.ndarray) -> None:
        self.drag = number(platform, "drag", path, 1.0)
        if not 0 < self.drag <= 1:
            raise SpecError(str(path), f"platform drag = {self.drag:g} must be above 0, at most 1")
        self.x, self.y, self.z = start.tolist()
        self.vx = self.vy = self.vz = 0.0
        self.yaw = 0.0

    @property
    def step(self) -> float:
        """Metres a pulse."""
        return hypot(self.vx, self.vy, self.vz)

    def towards(self, place: np.ndarray | list[float]) -> tuple[float, float, float]:
        """Metres to a place."""
        return place[0] - self.x, place[1] - self.y, place[2] - self.z

    def push(self, count: int, force: tuple[float, float, float], rate: float, most: float) -> None:
        """Move by so many pulses under an even force, not faster than ``most`` metres a pulse."""
        left = (1 - self.drag) ** count
        first = (1 - left) / self.drag
        rest = (count - first) / self.drag
        ax, ay, az = (f / rate for f in force)
        before = self.vx, self.vy, self.vz
        vx, vy, vz = (
            left * self.vx + first * ax,
            left * self.vy + first * ay,
            left * self.vz + first * az,
        )
        speed = hypot(vx, vy, vz)
        if speed > most:
            vx, vy, vz = vx * most / speed, vy * most / speed, vz * most / speed
            gone = [count * (b + v) / 2 for b, v in zip(before, (vx, vy, vz), strict=True)]
        else:
            gone = [first * b + rest * a for b, a in zip(before, (ax, ay, az), strict=True)]
        self.x, self.y, self.z = self.x + gone[0], self.y + gone[1], self.z + gone[2]
        self.vx, self.vy, self.vz = vx, vy, vz


def heading(x: float, y: float) -> float:
    """Radians from +Y to -X of a direction."""
    return atan2(-x, y)


def shortest(angle: float) -> float:
    """An angle turned into (-π, π]."""
    return pi - (pi - angle) % (2 * pi)


def drive(
    platform: Element, legs: list[DrivenLeg], path: Path
) -> tuple[list[SurveyTrack], list[str]]:
    """The way of each leg, from time 0, and sentences on what was not reached.

    platform : of the type multicopter or groundvehicle.

    Raises
    ------
    SpecError : a number that is out of range, or a leg that never ends.
    """
    kind = _Copter if platform.get("type") == "multicopter" else _Vehicle
    pilot = kind(platform, path, legs[0])
    tracks, notes = [], []
    for index, leg in enumerate(legs):
        track, missed = _leg(pilot, leg, index, path)
        tracks.append(track)
        if missed > MISSED:
            notes.append(
                f"leg {index} ends where the platform passes its waypoint, {missed:.2g} m beside it"
            )
    return tracks, notes


def _leg(
    pilot: _Copter | _Vehicle, leg: DrivenLeg, index: int, path: Path
) -> tuple[SurveyTrack, float]:
    """The way of a leg, and how far from its waypoint it ended, metres, where it passed by."""
    body = pilot.body
    speed = number(leg.settings, "movePerSec_m", path, 70.0)
    most = speed / leg.rate if speed > 0 else inf
    count = max(int(leg.rate / STEPS_A_SECOND), 1)
    pilot.begin(leg, index)
    length = float(np.linalg.norm(leg.stop - leg.start))
    longest = PATIENCE[0] + PATIENCE[1] * length / min(speed or inf, pilot.fastest)
    rows = [(0.0, body.x, body.y, body.z, body.yaw)]
    sent, taken, away = 0, 0, 0.0
    while True:
        to = body.towards(leg.stop)
        if pilot.turned or hypot(*to) < body.step * count:
            break
        if pilot.passed(to, sent):
            away = hypot(*to)
            break
        some = pilot.fine(to, count)
        if pilot.stopped or sent > longest * leg.rate:
            raise SpecError(
                str(path),
                f"leg {index} never arrives, here and in HELIOS++: its {pilot.kind} {pilot.fails} "
                f"{hypot(*to):.2g} m before its waypoint; {pilot.advice}",
            )
        force = pilot.force(to, leg, some)
        body.push(some, force, leg.rate, most)
        sent, taken = sent + some, taken + 1
        if taken % STEPS_A_ROW == 0:
            rows.append((sent / leg.rate, body.x, body.y, body.z, body.yaw))
    if sent * 1.0 / leg.rate > rows[-1][0] or len(rows) < 2:
        rows.append((max(sent, 1) / leg.rate, body.x, body.y, body.z, body.yaw))
    table = np.array(rows)
    angles = np.column_stack([np.zeros((len(table), 2)), table[:, 4]])
    return SurveyTrack(table[:, 0], table[:, 1:4], angles), away


class _Copter:
    """A copter: lift, a force along its way that grows and shrinks, turns by a rate."""

    kind, fails = "multicopter", "comes to rest"
    advice = "set slowdownEnabled to false, or smoothTurn to true"
    ALIGNED = 1e-3  # radians

    def __init__(self, platform: Element, path: Path, leg: DrivenLeg) -> None:
        def value(key: str, otherwise: float) -> float:
            return number(platform, key, path, otherwise)

        self.body = _Body(platform, path, leg.start)
        self._most = value("engine_max_force", 0.1)
        if not self._most > 0:
            raise SpecError(str(path), f"engine_max_force = {self._most:g} must be above 0")
        self._rate = leg.rate
        self._grow = 1 + value("speedup_magnitude", 2.0) / leg.rate
        self._shrink = 1 - value("slowdown_magnitude", 2.0) / leg.rate
        self._slow_within = value("slowdown_distance", 5.0)
        self._turn = np.deg2rad(value("yaw_speed_deg", 85.94)) / leg.rate
        self.fastest = self._most / self.body.drag
        self._force, self._fast, self._turning, self._aligning = 0.0, False, False, False
        self._slowing = False

    def begin(self, leg: DrivenLeg, index: int) -> None:
        """Begin a leg: which way it looks, and when its turn at the end starts."""
        x, y, _ = leg.stop - leg.start
        self._smooth, self._slows = leg.yes("smoothTurn", False), leg.yes("slowdownEnabled", True)
        self._stops = leg.yes("stopAndTurn", True) and not self._smooth
        self._whole = hypot(x, y) or 1.0
        look = self.body.yaw
        if self._stops:
            said = leg.settings.get("yawAtDeparture_deg")
            self.body.yaw = heading(x, y) if said is None else np.deg2rad(float(said))
        elif index == 0:
            look = self.body.yaw = heading(x, y)
        else:
            self._aligning = True
        then = None if leg.after is None else (leg.after - leg.stop)[:2]
        there = then is not None and bool(then.any())
        self._next = heading(*then) if there and then is not None else heading(x, y)
        self._left = int(abs(shortest(self._next - look)) / self._turn) if there else 0
        self._turn_within = self._arc(self._left)
        self._turning, self._fast, self._slowing = False, False, False

    def _arc(self, count: int) -> float:
        """Metres before a waypoint at which a turn of so many pulses begins."""
        factor = (self._shrink if self._slows else 1.0) * np.exp(1j * self._turn)
        total = (1 - factor**count) / (1 - factor)
        return float(self._most**2 * self.body.drag * total.real)

    @property
    def turned(self) -> bool:
        """Return whether a smooth turn is over."""
        return self._smooth and self._turning and self._left <= 0

    @property
    def stopped(self) -> bool:
        """Return whether it came to rest."""
        return self._slowing and self._force < STOPPED * self._most

    def passed(self, to: tuple[float, float, float], sent: int) -> bool:
        """Return whether it flies away from its waypoint, and is not about to turn to it."""
        settled = not self._aligning and not self._turning and sent * self.body.drag > 20
        return settled and to[0] * self.body.vx + to[1] * self.body.vy < 0

    def fine(self, to: tuple[float, float, float], count: int) -> int:
        """Pulses of the next step: one where a stage begins."""
        flat, near = hypot(to[0], to[1]), 4 * count * self.body.step
        edge = min(abs(flat - self._slow_within), abs(flat - self._turn_within))
        return 1 if 0 <= to[2] < 1e-6 or edge < near else count

    def force(
        self, to: tuple[float, float, float], leg: DrivenLeg, count: int
    ) -> tuple[float, float, float]:
        """Forces of the next pulses, gravity taken away, per mass."""
        flat = hypot(to[0], to[1])
        near = not self._smooth and flat < self._slow_within
        self._slowing = self._slows and (self._turning or near)
        if self._slowing:
            self._force *= self._shrink**count
        elif not self._fast:
            self._force = (self._force or 1e-4) * self._grow**count
        else:
            self._force = 1.0
        if self._force > self._most:
            self._force, self._fast = self._most, True
        if self._smooth or not flat:
            along = -sin(self.body.yaw), cos(self.body.yaw)
        else:
            along = to[0] / flat, to[1] / flat
        self._look(to, count)
        if not self._turning and flat <= self._turn_within:
            self._turning = True
        lift = 0.1 if to[2] >= 0 else 0.005 * to[2]
        return self._force * along[0], self._force * along[1], lift

    def _look(self, to: tuple[float, float, float], count: int) -> None:
        """Turn the copter: to the leg after this one, or to its waypoint."""
        most = self._turn * count
        if self._turning:
            self._left -= count
            if not self._stops:
                self._towards(self._next, most)
        elif self._aligning:
            aim = heading(to[0], to[1])
            left = self._towards(aim, most)
            self._aligning = left != 0 and not (aim >= 0 and abs(left) < self.ALIGNED)

    def _towards(self, aim: float, most: float) -> float:
        """Turn by at most so much; what is left, radians."""
        away = shortest(aim - self.body.yaw)
        if abs(away) <= most:
            self.body.yaw += away
            return 0.0
        self.body.yaw += most if away > 0 else -most
        return away - (most if away > 0 else -most)


class _Vehicle:
    """A vehicle on the ground: it steers to its waypoint, backs where that is too narrow, stays level."""

    kind, fails = "groundvehicle", "turns round and round"
    advice = "give waypoints farther apart or in wider curves, or take a linearpath platform"
    NARROW = pi / 5  # radians that it does not steer by forwards
    NEAR = 0.1  # metres within which a waypoint that is passed was reached
    turned = stopped = False

    def __init__(self, platform: Element, path: Path, leg: DrivenLeg) -> None:
        self.body = _Body(platform, path, leg.start)
        x, y, _ = leg.stop - leg.start
        self.body.yaw = heading(x, y)
        self.fastest = 0.02 / self.body.drag
        self._force, self._aim = 0.0, 0.0
        self._backs = 0
        self._from = (0.0, 0.0)

    def begin(self, _leg: DrivenLeg, _index: int) -> None:
        """Begin a leg: forwards."""
        self._backs = 0

    def passed(self, to: tuple[float, float, float], _sent: int) -> bool:
        """Return whether it drives away from a waypoint that is near."""
        flat = hypot(to[0], to[1])
        return flat < self.NEAR and to[0] * self.body.vx + to[1] * self.body.vy < 0

    def fine(self, _to: tuple[float, float, float], count: int) -> int:
        """Pulses of the next step."""
        return count

    def force(
        self, to: tuple[float, float, float], _leg: DrivenLeg, count: int
    ) -> tuple[float, float, float]:
        """Forces of the next pulses, per mass."""
        body = self.body
        away = shortest(heading(to[0], to[1]) - body.yaw)
        turn = 0.0
        if self._backs == 0:
            self._aim = 0.02
            if abs(away) < self.NARROW:
                turn = 0.1 * body.step * count
            else:
                self._backs = 1
                self._from = body.x - sin(body.yaw), body.y + cos(body.yaw)
        elif self._backs == 1:
            self._backs = 1 + (hypot(self._from[0] - body.x, self._from[1] - body.y) < 0.5)
        elif abs(away) < self.NARROW:
            self._backs = 0
        else:
            self._aim = -0.01
            turn = 0.25 * body.step * count
        body.yaw += max(-turn, min(turn, away))
        change = 1e-4 * count
        self._force += max(-change, min(change, self._aim - self._force))
        return -sin(body.yaw) * self._force, cos(body.yaw) * self._force, 0.0
