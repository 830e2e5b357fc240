"""Placing of a scene's sensors by the rules of its plan, off trunks and above the ground; a random ground.

Trunks are where the stand has its trees, before any is grown. A place that is too near to one is drawn
again; where there is no room, the one of many that is farthest from trunks is taken.

The ground is a sum of smooth waves in all directions, each octave half as long and somewhat lower.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.sensing.kinds import kind_of
from forest_addon.spec import Forest, Pose, Scene, Sensor, SpecError
from forest_addon.stand.intensity.surface import GroundSurface

from .settings import Ground, Placing

WAVES = 12  # of an octave
FILE = "terrain.npy"


def heights_of(
    ground: Ground, seed: int, forest: Forest
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights (rows, columns) in metres, first row the north edge, with low corner (2,) and size (2,).

    They reach over the field and its margin, and lie between 0 and the relief on the field.
    """
    margin = min(forest.margin, 2 * max(forest.size))
    low = np.array(forest.origin) - margin
    size = np.array(forest.size) + 2 * margin
    count = np.maximum(2, np.ceil(size / ground.step).astype(int))
    x = low[0] + (np.arange(count[0]) + 0.5) * size[0] / count[0]
    y = low[1] + (np.arange(count[1])[::-1] + 0.5) * size[1] / count[1]
    total = np.zeros((count[1], count[0]))
    rng = stream(seed, "terrain")
    octaves = max(1, int(np.log2(max(ground.wavelength / (4 * ground.step), 1.0))) + 1)
    for octave in range(octaves):
        length = ground.wavelength / 2**octave
        turn, phase = 2 * np.pi * rng.random((2, WAVES))
        for a, p in zip(turn, phase, strict=True):
            along = (np.cos(a) * x[None, :] + np.sin(a) * y[:, None]) * (2 * np.pi / length)
            total += ground.roughness**octave * np.sin(along + p)
    inside = (x >= forest.origin[0]) & (x <= forest.origin[0] + forest.size[0])
    across = (y >= forest.origin[1]) & (y <= forest.origin[1] + forest.size[1])
    field = total[np.ix_(across, inside)] if inside.any() and across.any() else total
    spread = float(np.ptp(field)) or 1.0
    return ground.relief * (total - field.min()) / spread, low, size


TRIES = 200
ROUTE_HEAD = "x_m,y_m,z_m,azimuth_deg,elevation_deg,time_s"


def place_sensors(
    settings: Scene, rules: Sequence[Placing], trunks: np.ndarray, ground: GroundSurface
) -> tuple[Scene, dict[str, str]]:
    """The scene with its sensors where the rules put them, and the text of files that they need, by name.

    trunks : (N, 2) metres.

    Raises
    ------
    SpecError : a rule that the sensor cannot follow.
    """
    files: dict[str, str] = {}
    sensors: list[Sensor] = []
    rule_of = {rule.sensor: rule for rule in rules}
    for sensor in settings.sensors:
        rule = rule_of.get(sensor.name)
        if rule is None:
            sensors.append(sensor)
        else:
            sensors += _placed(sensor, rule, _Room(settings, rule, trunks, ground), files)
    return settings.changed(sensors=tuple(sensors)), files


def refuse_out_of_range(scene: Scene, place: Placing, index: int) -> None:
    """Refuse a flight over ground that its scanner does not reach. index : of the rule in the plan.

    Raises
    ------
    SpecError : its results would be empty.
    """
    for sensor in scene.sensors:
        reach = getattr(sensor, "max_range", None)
        flown = sensor.name == place.sensor and place.rule == "over" and reach is not None
        if flown and place.height > reach:
            raise SpecError(
                f"place[{index}].height",
                f'{place.height:g} m above the ground is beyond the range of "{sensor.name}", {reach:g} m: '
                "its results would be empty; fly lower, raise its max_range, or say keep.empty = true",
            )


class _Room:
    """The field of a scene, its trunks and its ground, and the chances of one rule."""

    def __init__(
        self, settings: Scene, rule: Placing, trunks: np.ndarray, ground: GroundSurface
    ) -> None:
        self.rng = stream(settings.seed, "place", rule.sensor)
        self.rule, self.trunks, self.ground = rule, trunks, ground
        self.low = np.array(settings.forest.origin) + rule.inset
        self.high = np.array(settings.forest.origin) + settings.forest.size - rule.inset
        if not (self.low < self.high).all():
            middle = np.array(settings.forest.origin) + np.array(settings.forest.size) / 2
            self.low = self.high = middle

    def to_trunk(self, points: np.ndarray) -> np.ndarray:
        """(N,) metres from places (N, 2) to the nearest trunk."""
        if not len(self.trunks):
            return np.full(len(points), np.inf)
        return np.asarray(np.linalg.norm(points[:, None] - self.trunks, axis=2).min(axis=1))

    def near(self, point: np.ndarray) -> np.ndarray:
        """The place nearest to a point that keeps clear of trunks."""
        reach = np.linspace(0, 1, TRIES) * 4 * max(self.rule.clear, 0.5)
        turn = np.arange(TRIES) * np.pi * (3 - np.sqrt(5))
        tried = point + reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return tried[_first(self.to_trunk(tried) - self.rule.clear)]

    def anywhere(self, taken: Sequence[np.ndarray] = ()) -> np.ndarray:
        """A place by chance, clear of trunks and apart from others."""
        tried = self.low + self.rng.random((TRIES, 2)) * (self.high - self.low)
        slack = self.to_trunk(tried) - self.rule.clear
        if len(taken):
            gaps = np.linalg.norm(tried[:, None] - np.array(taken), axis=2).min(axis=1)
            slack = np.minimum(slack, gaps - self.rule.apart)
        return tried[_first(slack)]

    def above(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) places at the rule's height above the ground; where there is none, above its mean."""
        height = self.ground.height(points)
        known = height[np.isfinite(height)]
        height = np.where(np.isfinite(height), height, known.mean() if len(known) else 0.0)
        return np.column_stack([points, height + self.rule.height])


def _first(slack: np.ndarray) -> int:
    """The first place that has room enough (N,) metres, else the one that lacks least."""
    return int(np.argmax(slack >= 0) if (slack >= 0).any() else np.argmax(slack))


def _placed(sensor: Sensor, rule: Placing, room: _Room, files: dict[str, str]) -> list[Sensor]:
    if rule.rule in FOLLOWERS:
        if sensor.kind not in FOLLOWERS[rule.rule]:
            said = f'a {sensor.kind} sensor cannot follow the rule "{rule.rule}"'
            raise SpecError("place", said)
        return FOLLOWERS[rule.rule][sensor.kind](sensor, rule, room, files)
    posed = kind_of(sensor).posed
    if "position" not in posed or "heading_deg" in posed:
        raise SpecError("place", f'a {sensor.kind} sensor cannot stand by the rule "{rule.rule}"')
    if rule.rule == "centre":
        points = [room.near((room.low + room.high) / 2)]
    elif rule.rule == "corners":
        ends = (room.low, room.high)
        points = [
            room.near(np.array([ends[i][0], ends[j][1]]))
            for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
        ]
    else:
        points = []
        for _ in range(rule.count):
            points.append(room.anywhere(points))
    where = room.above(np.array(points))
    turn = room.rng.random(len(where)) * 360.0
    placed = []
    for number, place in enumerate(where):
        name = sensor.name if len(where) == 1 else f"{sensor.name}-{number + 1}"
        more = {"azimuth_deg": float(turn[number])} if "azimuth_deg" in posed else {}
        placed.append(sensor.changed(name=name, position=tuple(place.tolist()), **more))
    return placed


def _way(room: _Room) -> np.ndarray:
    """(K, 2) a smooth way through the field that bends around trunks, points half a metre apart."""
    knots = np.array([room.anywhere() for _ in range(5)])
    share = np.linspace(0, 1, 400)
    # A Bézier-like blend of the corners: each takes over from the one before, smoothly.
    at = share * (len(knots) - 1)
    first = np.minimum(at.astype(int), len(knots) - 2)
    part = at - first
    blend = part**2 * (3 - 2 * part)
    line = knots[first] + blend[:, None] * (knots[first + 1] - knots[first])
    for _ in range(8):
        if not len(room.trunks):
            break
        offset = line[:, None] - room.trunks
        away = np.linalg.norm(offset, axis=2)
        nearest = np.argmin(away, axis=1)
        rows = np.arange(len(line))
        lack = np.maximum(room.rule.clear - away[rows, nearest], 0)
        push = offset[rows, nearest] / np.maximum(away[rows, nearest], 1e-9)[:, None]
        line = line + 1.05 * lack[:, None] * push
    gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    if gone[-1] == 0:
        return line[:1]
    wanted = np.linspace(0, gone[-1], max(2, int(gone[-1] / 0.5)))
    return np.column_stack([np.interp(wanted, gone, line[:, k]) for k in range(2)])


def _above_ground(room: _Room) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a path through the field: metres gone (K,), places (K, 3) and headings (K,) in degrees."""
    line = room.above(_way(room))
    gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    if len(line) == 1:
        return gone, line, np.zeros(1)
    return gone, line, np.rad2deg(np.arctan2(*np.gradient(line[:, :2], axis=0).T[::-1]))


def _poses_along(sensor: Any, rule: Placing, room: _Room, _files: dict[str, str]) -> list[Sensor]:
    gone, line, heading = _above_ground(room)
    poses = tuple(
        Pose(time=float(s / rule.speed), position=tuple(place.tolist()), heading_deg=float(turn))
        for s, place, turn in zip(gone, line, heading, strict=True)
    )
    return [sensor.changed(poses=poses, follow="", speed=rule.speed)]


def _route_along(sensor: Any, rule: Placing, room: _Room, files: dict[str, str]) -> list[Sensor]:
    gone, line, heading = _above_ground(room)
    rows = np.unique(np.rint(np.linspace(0, len(line) - 1, rule.count)).astype(int))
    text = [ROUTE_HEAD]
    for row in rows:
        x, y, z = line[row].tolist()
        angles = f"{float(heading[row]):.3f},{sensor.elevation_deg:g}"
        text.append(f"{x:.4f},{y:.4f},{z:.4f},{angles},{float(gone[row]) / rule.speed:.4f}")
    files[f"{sensor.name}-route.csv"] = "\n".join(text) + "\n"
    return [sensor.changed(route=f"{sensor.name}-route.csv", follow="", speed=rule.speed)]


def _strips_over(sensor: Any, _rule: Placing, room: _Room, _files: dict[str, str]) -> list[Sensor]:
    """Place strips towards +y that cover the field between their outermost ones."""
    wide, long = (room.high - room.low).tolist()
    strips = max(1, int(np.ceil(wide / sensor.spacing))) if sensor.spacing > 0 else 1
    x = float((room.low + room.high)[0] / 2 - (strips - 1) * sensor.spacing / 2)
    base = room.above((room.low + room.high)[None] / 2)[0, 2]
    over = sensor.changed(
        position=(x, float(room.low[1]), float(base)),
        heading_deg=90.0,
        track=max(long, 1.0),
        strips=strips,
    )
    return [over]


def _pairs(sensor: Any, rule: Placing, room: _Room, _files: dict[str, str]) -> list[Sensor]:
    placed = []
    for number in range(rule.count):
        source = room.anywhere()
        turn = 2 * np.pi * room.rng.random(TRIES)
        ring = source + rule.distance * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        inside = ((ring >= room.low) & (ring <= room.high)).all(axis=1)
        slack = room.to_trunk(ring) - rule.clear
        both = inside & (slack >= 0)
        receiver = ring[np.argmax(both if both.any() else slack)]
        # the reverb's ground is z = 0: both ends stand at the rule's height above it
        ends = [(*map(float, end), rule.height) for end in (source, receiver)]
        name = sensor.name if rule.count == 1 else f"{sensor.name}-{number + 1}"
        placed.append(replace(sensor, name=name, source=ends[0], receiver=ends[1]))
    return placed


Follower = Callable[[Any, Placing, _Room, dict[str, str]], list[Sensor]]
FOLLOWERS: dict[str, dict[str, Follower]] = {  # by rule and by kind of sensor
    "path": {"mobile": _poses_along, "sonar": _route_along},
    "over": {"airborne": _strips_over},
    "pairs": {"reverb": _pairs},
}
