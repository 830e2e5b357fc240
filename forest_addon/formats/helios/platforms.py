"""Ways of platforms of HELIOS++ that do not just go straight on: tables that it interpolates, and copters and
vehicles that it drives by forces.

A table has time, attitude and place in a text file. Between rows all goes linearly. Rows of the same time are
a jump: what comes before it leads to the first of them, what comes after it starts from the last.

A step of a driven platform is a pulse. In each of them the velocity v, metres a pulse, becomes
(1 - drag)·v + force/f at f pulses a second, cut to the speed that a leg states; lift takes gravity away. A
copter's force grows and shrinks by a factor a step, along its heading where it turns smoothly, else
towards its waypoint. A vehicle steers by 0.1 rad a metre; where that is too little it backs by 0.25.
Steps of 0.2 ms are taken here, in which a force is even and the drag's geometric series is summed.
"""

from __future__ import annotations

from abc import abstractmethod
from cmath import exp, phase
from dataclasses import dataclass, replace
from math import copysign, hypot, inf, pi, radians
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from ..foreign import guarded, numbers
from .document import find_file, number, yes

NAMES = ("t", "roll", "pitch", "yaw", "x", "y", "z")
KEYS = {f"{name}Index": place for place, name in enumerate(NAMES)}
TRACK_SETTINGS = {
    *("trajectory", "trajectory_separator", "trajectory_seperator", "slopeFilterThreshold"),
    *(
        "toRadians",
        "syncGPSTime",
        "tStart",
        "tEnd",
        "teleportToStart",
        "interpolationDomain",
        *KEYS,
    ),
}
STEPS_A_SECOND = 5_000
STEPS_A_ROW = 5  # of a track
PATIENCE = 60.0, 10.0  # seconds of a leg, and how often longer it may take than straight on
MISSED = 0.01  # metres beside a waypoint that are told
STOPPED = 1e-7  # share of its force at which a copter stands
ALIGNED = 1e-3  # radians from its waypoint at which it looks there
NARROW = pi / 5  # radians that a vehicle does not steer by forwards
NEAR = 0.1  # metres within which a waypoint that it passes was reached


@dataclass(frozen=True)
class SurveyTrack:
    """Way of a platform.

    time : (K,) seconds, ascending. place : (K, 3) metres. angles : (K, 3) roll, pitch and yaw in radians,
    which turn a vector about Z, then Y, then X; None: it looks along its way.
    """

    time: np.ndarray
    place: np.ndarray
    angles: np.ndarray | None = None

    def shifted(self, by: np.ndarray) -> SurveyTrack:
        """The track moved by (3,) metres."""
        return replace(self, place=self.place + by)

    def at(self, time: np.ndarray) -> tuple[np.ndarray, Rotation | None]:
        """(P, 3) places at times (P,), and attitudes; it stands before the first row and after the last."""
        time = np.clip(time, self.time[0], self.time[-1])
        row = np.clip(np.searchsorted(self.time, time, "right") - 1, 0, len(self.time) - 2)
        span = self.time[row + 1] - self.time[row]
        share = np.where(span > 0, (time - self.time[row]) / np.where(span > 0, span, 1.0), 1.0)

        def between(rows: np.ndarray) -> np.ndarray:
            return np.asarray(rows[row] + share[:, None] * (rows[row + 1] - rows[row]))

        if self.angles is None:
            return between(self.place), None
        return between(self.place), Rotation.from_euler("XYZ", between(self.angles))

    def part(self, start: float, stop: float) -> SurveyTrack:
        """The rows from a time to another, seconds; of a jump at an end only its inner side."""
        inner = np.flatnonzero((self.time > start) & (self.time < stop))
        first = np.searchsorted(self.time, start, "right") - 1
        last = np.searchsorted(self.time, stop, "left")
        rows = np.unique(np.clip([first, *inner, last], 0, len(self.time) - 1))
        angles = None if self.angles is None else self.angles[rows]
        return SurveyTrack(self.time[rows], self.place[rows], angles)


def read_tracks(
    legs: list[Element], survey: Element, path: Path, assets: Path | None
) -> list[tuple[SurveyTrack, float, float]]:
    """The track of each leg of platform settings, and from when to when it goes, seconds.

    Raises
    ------
    SpecError : a file is missing or is no table, or settings contradict each other.
    """
    files: dict[str, Element] = {}
    for leg in legs:
        name = leg.get("trajectory", "")
        if not name:
            raise SpecError(str(path), "a leg of an interpolated platform names no trajectory")
        if name not in files or set(leg.attrib) & set(KEYS):
            files[name] = leg
    tables = [_read(find_file(name, path, assets), leg, path) for name, leg in files.items()]
    rows = np.concatenate(tables)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    spec = survey.get("rotationSpec", "ARINC 705")
    if spec not in ("ARINC 705", "CANONICAL"):
        raise SpecError(str(path), f'rotationSpec = "{spec}" is neither ARINC 705 nor CANONICAL')
    if all(yes(leg.get("toRadians"), True) for leg in legs):
        rows[:, 1:4] = np.deg2rad(rows[:, 1:4])
    angles = rows[:, 1:4] if spec == "CANONICAL" else -rows[:, 1:4]
    looks = all(leg.get("interpolationDomain") != "position" for leg in legs)
    track = SurveyTrack(rows[:, 0], rows[:, 4:], angles if looks else None)
    tracks = []
    for leg in legs:
        start = number(leg, "tStart", path, float(track.time[0]))
        stop = number(leg, "tEnd", path, float(track.time[-1]))
        if not start < stop:
            raise SpecError(str(path), f"a leg from tStart = {start:g} to {stop:g} s has no time")
        tracks.append((track.part(start, stop), start, stop))
    return tracks


@guarded("a table of a trajectory")
def _read(file: Path, leg: Element, path: Path) -> np.ndarray:
    """(K, 7) time, roll, pitch, yaw, x, y, z of a text file, by the indices of a leg or its header."""
    lines = file.read_text("utf-8", errors="replace").splitlines()
    separator = leg.get("trajectory_separator", leg.get("trajectory_seperator", ",")).strip()
    rows = [line.split(separator or None) for line in lines if line.strip() and line[0] != "#"]
    if len(rows) < 2:
        raise SpecError(str(file), f"has {len(rows)} rows; a trajectory needs two")
    table = numbers(rows, file, "numbers")
    heads = [line.partition(":")[2] for line in lines if line.startswith("#HEADER")]
    head = [name.strip().strip('"') for name in heads[-1].split(",")] if heads else []
    if set(leg.attrib) & set(KEYS):
        order = [int(number(leg, key, path, place)) for key, place in KEYS.items()]
    else:
        order = [head.index(name) if name in head else place for place, name in enumerate(NAMES)]
    needed = order if leg.get("interpolationDomain") != "position" else [order[0], *order[4:]]
    if min(needed) < 0 or max(needed) >= table.shape[1]:
        raise SpecError(str(file), f"has {table.shape[1]} columns, too few for {', '.join(NAMES)}")
    found = table[:, np.clip(order, 0, table.shape[1] - 1)]
    if not np.isfinite(found).all():
        raise SpecError(str(file), "has values that are no numbers")
    return found


@dataclass(frozen=True)
class DrivenLeg:
    """A leg of a driven platform: waypoints (3,) from, to and after that (None: there is none), its settings
    and pulses a second."""

    start: np.ndarray
    stop: np.ndarray
    after: np.ndarray | None
    settings: Element
    rate: float


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
    body = kind(platform, path, legs[0])
    tracks, notes = [], []
    for index, leg in enumerate(legs):
        track, missed = body.way(leg, index, path)
        tracks.append(track)
        if missed > MISSED:
            notes.append(
                f"leg {index} ends where the platform passes its waypoint, {missed:.2g} m beside it"
            )
    return tracks, notes


def heading(way: complex) -> float:
    """Radians from +Y to -X of a direction x + iy."""
    return phase(-1j * way)


def shortest(angle: float) -> float:
    """An angle turned into (-π, π]."""
    return pi - (pi - angle) % (2 * pi)


class _Body:
    """A platform with drag: place ``at`` = x + iy and height z, m, velocity, m a pulse, and heading."""

    fails, advice = "", ""
    fastest: float  # metres a second
    turned = stopped = False  # at the end of a leg; before it

    def __init__(self, platform: Element, path: Path, leg: DrivenLeg) -> None:
        self.kind = platform.get("type")
        self.drag = number(platform, "drag", path, 1.0)
        if not 0 < self.drag <= 1:
            raise SpecError(str(path), f"platform drag = {self.drag:g} must be above 0, at most 1")
        self.at, self.z = complex(*leg.start[:2]), float(leg.start[2])
        self.speed, self.rise, self.yaw = 0j, 0.0, 0.0

    @abstractmethod
    def begin(self, leg: DrivenLeg, index: int) -> None:
        """Begin a leg."""

    @abstractmethod
    def passed(self, to: complex, sent: int) -> bool:
        """Return whether it moves away from a waypoint that it will not come nearer to."""

    @abstractmethod
    def force(self, to: complex, up: float, count: int) -> tuple[complex, float]:
        """Forces of the next pulses along the ground and up, gravity taken away, per mass."""

    def fine(self, _to: complex, _up: float, count: int) -> int:
        """Pulses of the next step."""
        return count

    def way(self, leg: DrivenLeg, index: int, path: Path) -> tuple[SurveyTrack, float]:
        """The way of a leg, and how far from its waypoint it ended, metres, where it passed by."""
        speed = number(leg.settings, "movePerSec_m", path, 70.0)
        most = speed / leg.rate if speed > 0 else inf
        count = max(int(leg.rate / STEPS_A_SECOND), 1)
        self.begin(leg, index)
        length = float(np.linalg.norm(leg.stop - leg.start))
        longest = PATIENCE[0] + PATIENCE[1] * length / min(speed or inf, self.fastest)
        stop, high = complex(*leg.stop[:2]), float(leg.stop[2])
        rows = [(0.0, self.at, self.z, self.yaw)]
        sent, taken, away = 0, 0, 0.0
        while True:
            to, up = stop - self.at, high - self.z
            far = hypot(abs(to), up)
            if self.turned or far < hypot(abs(self.speed), self.rise) * count:
                break
            if self.passed(to, sent):
                away = far
                break
            some = self.fine(to, up, count)
            if self.stopped or sent > longest * leg.rate:
                raise SpecError(
                    str(path),
                    f"leg {index} never arrives, here and in HELIOS++: its {self.kind} {self.fails} "
                    f"{far:.2g} m before its waypoint; {self.advice}",
                )
            along, lift = self.force(to, up, some)
            self._push(some, along / leg.rate, lift / leg.rate, most)
            sent, taken = sent + some, taken + 1
            if taken % STEPS_A_ROW == 0:
                rows.append((sent / leg.rate, self.at, self.z, self.yaw))
        if sent / leg.rate > rows[-1][0] or len(rows) < 2:
            rows.append((max(sent, 1) / leg.rate, self.at, self.z, self.yaw))
        time, at, z, yaw = (np.array(part) for part in zip(*rows, strict=True))
        angles = np.column_stack([np.zeros((len(z), 2)), yaw])
        return SurveyTrack(time, np.column_stack([at.real, at.imag, z]), angles), away

    def _push(self, count: int, along: complex, up: float, most: float) -> None:
        """Move by so many pulses under an even force, not faster than ``most`` metres a pulse."""
        left = (1 - self.drag) ** count
        first = (1 - left) / self.drag
        rest = (count - first) / self.drag
        speed, rise = left * self.speed + first * along, left * self.rise + first * up
        total = hypot(abs(speed), rise)
        if total > most:
            speed, rise = speed * most / total, rise * most / total
            self.at += count * (self.speed + speed) / 2
            self.z += count * (self.rise + rise) / 2
        else:
            self.at += first * self.speed + rest * along
            self.z += first * self.rise + rest * up
        self.speed, self.rise = speed, rise

    def _leaves(self, to: complex) -> bool:
        return (to * self.speed.conjugate()).real < 0


class _Copter(_Body):
    """A copter: lift, a force along its way that grows and shrinks, turns by a rate."""

    fails, advice = "comes to rest", "set slowdownEnabled to false, or smoothTurn to true"

    def __init__(self, platform: Element, path: Path, leg: DrivenLeg) -> None:
        super().__init__(platform, path, leg)
        self._most, grows, shrinks, self._slow_within, turn = (
            number(platform, key, path, otherwise)
            for key, otherwise in (
                ("engine_max_force", 0.1),
                ("speedup_magnitude", 2.0),
                ("slowdown_magnitude", 2.0),
                ("slowdown_distance", 5.0),
                ("yaw_speed_deg", 85.94),
            )
        )
        if not self._most > 0:
            raise SpecError(str(path), f"engine_max_force = {self._most:g} must be above 0")
        self._grow, self._shrink = 1 + grows / leg.rate, 1 - shrinks / leg.rate
        self._turn = radians(turn) / leg.rate
        self.fastest = self._most / self.drag
        self._force, self._aligning = 0.0, False

    def begin(self, leg: DrivenLeg, index: int) -> None:
        """Begin a leg: which way it looks, and when its turn at the end starts."""
        way, look, said = complex(*(leg.stop - leg.start)[:2]), self.yaw, leg.settings.attrib
        self._smooth = yes(said.get("smoothTurn"), False)
        self._slows = yes(said.get("slowdownEnabled"), True)
        self._stops = yes(said.get("stopAndTurn"), True) and not self._smooth
        if self._stops:
            departs = said.get("yawAtDeparture_deg")
            self.yaw = heading(way) if departs is None else radians(float(departs))
        elif index == 0:
            look = self.yaw = heading(way)
        else:
            self._aligning = True
        then = 0j if leg.after is None else complex(*(leg.after - leg.stop)[:2])
        self._next = heading(then or way)
        self._left = int(abs(shortest(self._next - look)) / self._turn) if then else 0
        # Metres before the waypoint at which the turn begins.
        factor = (self._shrink if self._slows else 1.0) * exp(1j * self._turn)
        total = (1 - factor**self._left) / (1 - factor)
        self._turn_within = self._most**2 * self.drag * total.real
        self._turning = self._fast = self._slowing = False

    @property
    def turned(self) -> bool:  # type: ignore[override]
        """Return whether a smooth turn is over."""
        return self._smooth and self._turning and self._left <= 0

    @property
    def stopped(self) -> bool:  # type: ignore[override]
        """Return whether it came to rest."""
        return self._slowing and self._force < STOPPED * self._most

    def passed(self, to: complex, sent: int) -> bool:
        """Return whether it flies away from its waypoint, and is not about to turn to it."""
        settled = not self._aligning and not self._turning and sent * self.drag > 20
        return settled and self._leaves(to)

    def fine(self, to: complex, up: float, count: int) -> int:
        """Pulses of the next step: one where a stage begins."""
        near = 4 * count * hypot(abs(self.speed), self.rise)
        edge = min(abs(abs(to) - self._slow_within), abs(abs(to) - self._turn_within))
        return 1 if 0 <= up < 1e-6 or edge < near else count

    def force(self, to: complex, up: float, count: int) -> tuple[complex, float]:
        """Forces of the next pulses."""
        flat = abs(to)
        near = not self._smooth and flat < self._slow_within
        self._slowing = self._slows and (self._turning or near)
        if self._slowing:
            self._force *= self._shrink**count
        else:
            self._force = 1.0 if self._fast else (self._force or 1e-4) * self._grow**count
        if self._force > self._most:
            self._force, self._fast = self._most, True
        along = 1j * exp(1j * self.yaw) if self._smooth or not flat else to / flat
        if self._turning:
            self._left -= count
            if not self._stops:
                self._look(self._next, count)
        elif self._aligning:
            aim = heading(to)
            left = self._look(aim, count)
            self._aligning = left != 0 and not (aim >= 0 and abs(left) < ALIGNED)
        self._turning = self._turning or flat <= self._turn_within
        return self._force * along, 0.1 if up >= 0 else 0.005 * up

    def _look(self, aim: float, count: int) -> float:
        """Turn by at most what so many pulses turn; what is left, radians."""
        away = shortest(aim - self.yaw)
        step = away if abs(away) <= self._turn * count else copysign(self._turn * count, away)
        self.yaw += step
        return away - step


class _Vehicle(_Body):
    """A vehicle on the ground: it steers to its waypoint, backs where that is too narrow, stays level."""

    fails = "turns round and round"
    advice = "give waypoints farther apart or in wider curves, or take a linearpath platform"

    def __init__(self, platform: Element, path: Path, leg: DrivenLeg) -> None:
        super().__init__(platform, path, leg)
        self.fastest = 0.02 / self.drag
        self.yaw = heading(complex(*(leg.stop - leg.start)[:2]))
        self._force, self._aim, self._from = 0.0, 0.0, 0j

    def begin(self, leg: DrivenLeg, index: int) -> None:
        """Begin a leg: forwards."""
        self._backs = 0

    def passed(self, to: complex, _sent: int) -> bool:
        """Return whether it drives away from a waypoint that is near."""
        return abs(to) < NEAR and self._leaves(to)

    def force(self, to: complex, _up: float, count: int) -> tuple[complex, float]:
        """Forces of the next pulses."""
        away, turn = shortest(heading(to) - self.yaw), 0.0
        step = hypot(abs(self.speed), self.rise) * count
        if self._backs == 0:
            self._aim = 0.02
            if abs(away) < NARROW:
                turn = 0.1 * step
            else:
                self._backs, self._from = 1, self.at + 1j * exp(1j * self.yaw)
        elif self._backs == 1:
            self._backs = 1 + (abs(self._from - self.at) < 0.5)
        elif abs(away) < NARROW:
            self._backs = 0
        else:
            self._aim, turn = -0.01, 0.25 * step
        self.yaw += max(-turn, min(turn, away))
        change = 1e-4 * count
        self._force += max(-change, min(change, self._aim - self._force))
        return 1j * exp(1j * self.yaw) * self._force, 0.0
