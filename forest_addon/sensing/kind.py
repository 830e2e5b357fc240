"""Record of a sensor, of all that it IS to the rest of the program; each sensor's ``kind.py`` fills it in.

The record names the sensor's settings and says how it runs on a scene, how a sample of its result is
computed again, where it goes, what it costs, what it shows in the viewport. Whoever runs, draws or times
sensors looks the record up by the ``kind`` of the settings (``kinds``) and knows no sensor by name. What a
sensor *gives* (figures, files, pictures, sound) is the record of the same kind in ``results``.

Only settings, the scene and the run are of interest to a sensor that sends rays and stays where it is put;
all else has a default.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from ..base.progress import Progress
from ..spec import Choice, Scene, Sensor
from .audit import AuditPart
from .looks import SensorLook, look_at_leaves
from .rays.caster import RayCaster
from .rays.geometry import SceneGeometry

if TYPE_CHECKING:
    from .trajectory import Follower, Trajectory


T = TypeVar("T")
Colour = tuple[float, float, float, float]

LIGHT, SOUND, ECHO = (0.35, 0.75, 1.0, 0.8), (0.75, 0.55, 1.0, 0.9), (1.0, 0.75, 0.25, 0.8)
GUESS = 0.1  # s that a run takes, where a kind does not say


class Seen(Protocol):
    """An evaluated scene, as sensors see it.

    places : metres, of the objects that can be a source or a receiver, by name. wood : rays that pass leaves.
    expansions : what sums of sound have set up, kept from one scene to the next.
    """

    geometry: SceneGeometry
    places: Mapping[str, tuple[float, float, float]]
    expansions: Any

    @property
    def caster(self) -> RayCaster:
        """Rays that meet everything."""
        ...

    @property
    def wood(self) -> RayCaster:
        """Rays that pass leaves: lines of sight of sound."""
        ...

    @property
    def sway(self) -> Any:
        """The sway of trees in the wind (``stand.wind``) and the time at which it begins, s; None: they
        stand still."""
        ...

    @property
    def swaying(self) -> Any:
        """Rays that meet everything, trees where the wind has them at a time; the still ones without wind."""
        ...

    @property
    def swaying_wood(self) -> Any:
        """The same without leaves."""
        ...

    def moving_wood(self, moving: Any) -> Any:
        """Rays that pass leaves in a scene that moves."""
        ...

    def once(self, make: Callable[..., T], *of: Any) -> T:
        """``make(self, *of)``, made the first time that it is asked for."""
        ...


@dataclass(frozen=True)
class Observation:
    """One sensor in one scene.

    sensor : its settings, with nothing left to "auto". seen : the scene. settings : the scene's.
    folder : that files named in the settings are relative to. trajectory : where it goes; None: it stays.
    moving : a ``MovingCaster`` of a scene that moves meanwhile; None: it stands still. start : s, when a
    sensor that stays looks at that.
    """

    sensor: Any
    seen: Seen
    settings: Scene
    folder: Path = Path()
    trajectory: Trajectory | None = None
    moving: Any = None
    start: float = 0.0

    @property
    def caster(self) -> Any:
        """Rays that meet everything, where the scene moves at times of their own."""
        return self.seen.caster if self.moving is None else self.moving


def _stays(_sensor: Any, _folder: Path, _follower: Follower) -> None:
    return None


def _a_moment(_sensor: Any, _trajectory: Any) -> float:
    return 0.0


@dataclass(frozen=True)
class SensorKind:
    """Record of a kind of sensor; every function takes the settings, or the ``Observation`` that holds them.

    settings : their class. run : what it finds in a scene, told of progress.
    audit : parts of what it found, which a sample is computed again of by the exact way.
    trajectory : where it goes, by its settings, a folder and Blender's scene; None: it stays.
    check : reads whatever else it names, and raises where that cannot be used.
    positions : (P, 3) m where it should not stand inside of a tree.
    empty : that a finding holds nothing, and why, in a sentence; "" of one that holds something.
    lasts : seconds of a scene that moves, which a run along a trajectory looks at; 0: it stands still.
    sways : whether it meets trees where the wind has them at the time of each of its rays.
    cost : of a run along a trajectory with a ray engine. seconds_among : what so many trees, and all that a
        scene's settings add to them, add to its first guess, to set up and to work, of so many pings or
        channels.
    outline : (N, 2, 3) m, ends of the lines that show where it looks.
    choose : what is left to "auto", chosen. left_out : what a finding left out, and the bound on that.
    thinned : settings, as a table, by which one of so many of its pulses is sent; None: it has none.
    look : what it needs of trees, where their detail is left to "auto".
    glance : a coarse image of what it sees or hears, fast enough to be live; None: there is none.
    listens : whether that is what it hears, wherever one wants to listen.
    family : "lidar", "sonar", "reverb", or a word of its own.

    As an object in the view: help : what it is, in a sentence. icon, colour : Blender's name, linear RGBA.
    body : "arrows", or "speaker" for what sends from one object to another. posed : settings that the
        object's transform says. turns : axes of its rotation that it heeds. fixed : why other moves by hand
        have no effect, by its settings; empty: they have.
    """

    settings: type[Sensor]
    run: Callable[[Observation, Progress | None], Any]
    audit: Callable[[Observation, Any], Sequence[AuditPart]] | None = None
    trajectory: Callable[[Any, Path, Follower], Trajectory | None] = _stays
    check: Callable[[Observation], Any] = lambda _: None
    positions: Callable[[Observation], np.ndarray] = lambda job: np.array([job.sensor.position])
    empty: Callable[[Observation, Any], str] = lambda *_: ""
    lasts: Callable[[Any, Any], float] = _a_moment
    sways: bool = False
    cost: Callable[[Any, Any, str], Cost] = lambda sensor, *_: cost_of_work(
        sensor, "runs", 1, GUESS
    )
    seconds_among: Callable[[Any, Scene, int, int], tuple[float, float]] = lambda *_: (0.0, 0.0)
    outline: Callable[[Any], np.ndarray] = lambda _: np.empty((0, 2, 3))
    choose: Callable[[Any], tuple[Choice, ...]] = lambda _: ()
    left_out: Callable[[Any], tuple[Choice, ...]] = lambda _: ()
    thinned: Callable[[Any, float], dict[str, Any]] | None = None
    look: Callable[[Any], SensorLook] = look_at_leaves
    glance: Callable[[Observation], Any] | None = None
    listens: bool = False
    family: str = ""
    help: str = ""
    icon: str = "DOT"
    colour: Colour = LIGHT
    body: str = "arrows"
    posed: tuple[str, ...] = ("position", "azimuth_deg", "elevation_deg")
    turns: tuple[int, ...] = (1, 2)
    fixed: Callable[[Any], str] = lambda _: ""

    @property
    def timed(self) -> bool:
        """Return whether each of its rays has a time of its own."""
        return self.lasts is not _a_moment

    @property
    def moves(self) -> bool:
        """Return whether it can go along a trajectory."""
        return self.trajectory is not _stays

    @property
    def name(self) -> str:
        """Name of this kind in a scene file."""
        return str(self.settings.__dataclass_fields__["kind"].default)


# Cost of a run, before it begins: how much it sends, how long that takes, how much it keeps.
#
# The time is a guess until sensors of a kind have run once in this process: seconds to set the scene up,
# which only the first run in it takes, and seconds for each unit of work, as measured in small woods. Then
# the larger of both is multiplied by what the last run took over what was guessed, on this machine.


RAY = 2.5e-6  # s, a first guess: a ray of Embree
BEGIN = 0.1  # s to make Embree ready
TRIANGLE = 8e-7  # s to set one of a scene up, in the order of its mesh
SLOWER = 15.0  # times that BVHTree takes a ray
RETURN = 300  # bytes of a point: what is computed of it, and what Blender keeps

BRIEF = 0.3  # s of a run, from which on it says how fast a kind is
LEAST = 0.1  # of a guess, which no run falls below

_pace: dict[str, tuple[float, float]] = {}  # by kind: s taken over s guessed, to set up and to work


@dataclass(frozen=True)
class Cost:
    """Cost of one run: ``count`` of what it sends (pulses, pings, channels), seconds, bytes.

    work : what the time grows with: rays, pings, channels. guess : seconds as guessed before any has run;
    setup : those of them that only the first run of a kind in a scene takes.
    """

    what: str
    count: int
    work: int
    seconds: float
    memory: int
    guess: float = 0.0
    setup: float = 0.0

    def __str__(self) -> str:
        rays = f" of {self.work:,} rays" if self.work > self.count else ""
        memory = f", {_few_digits(self.memory / 1e9)} GB" if self.memory > 5e7 else ""
        what = self.what.removesuffix("s") if self.count == 1 else self.what
        return f"{self.count:,} {what}{rays}: about {_lasting(self.seconds)}{memory}"


def cost_with(kind: str, cost: Cost, setup: float, work: float) -> Cost:
    """The cost of a run of a kind whose first guess is so many seconds more, to set up and to work."""
    first, then = _pace.get(kind, (1.0, 1.0))
    setup, work = max(cost.setup + setup, 0.0), cost.guess - cost.setup + work
    return replace(cost, seconds=setup * first + work * then, guess=setup + work, setup=setup)


def _lasting(seconds: float) -> str:
    """A time as one says it, of a guess."""
    if seconds < 1.5:
        return "a second"
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{_few_digits(seconds / 3600)} h"


def _few_digits(value: float) -> str:
    return f"{value:,.1f}" if value < 100 else f"{value:,.0f}"


def cost_of_rays(sensor: Sensor, count: int, subrays: int, returns: float, engine: str) -> Cost:
    """The cost of ``count`` pulses of ``subrays`` rays, each with so many returns, by a ray engine."""
    ray = RAY if engine == "embree" else SLOWER * RAY
    memory = int(count * returns) * RETURN
    work = count * subrays
    return cost_of_work(sensor, "pulses", count, ray, work=work, memory=memory, begin=BEGIN)


def cost_of_work(
    sensor: Sensor,
    what: str,
    count: int,
    unit: float,
    *,
    work: int = 0,
    memory: int = 0,
    begin: float = 0.0,
) -> Cost:
    """The cost of ``count`` of something.

    unit : seconds of a unit of work, begin : seconds before the first, until a sensor of this kind has run.
    work : units; 0: ``count``.
    """
    work = work or count
    guess = begin + work * unit
    cost = Cost(what, count, work, guess, memory, guess, begin)
    return cost_with(sensor.kind, cost, 0.0, 0.0)


def note_pace(sensor: Sensor, cost: Cost, seconds: float) -> None:
    """Remember how long a run took: the larger part of its guess is what was wrong."""
    if max(seconds, cost.seconds) < BRIEF:
        return
    first, then = _pace.get(sensor.kind, (1.0, 1.0))
    setup, work = cost.setup, cost.guess - cost.setup
    if setup > work:
        first = max((seconds - work * then) / setup, LEAST)
    elif work > 0:
        then = max((seconds - setup * first) / work, LEAST)
    _pace[sensor.kind] = first, then


# Reasons why a sensor found nothing, in a sentence: nothing there, nothing in reach, nothing met.


def why_nothing(found: str, points: np.ndarray, reach: float, scene: SceneGeometry) -> str:
    """Say that a sensor found nothing, and why.

    found : the nothing in words, as "0 points". points : (P, 3) m, where it was. reach : m, beyond which it
    finds nothing.
    """
    gap = nearest(points, scene)
    if not np.isfinite(gap):
        return f"{found}: there is nothing in the scene"
    if gap > reach:
        return (
            f"{found}: the nearest thing is {gap:,.4g} m away and it reaches {reach:,.4g} m; go nearer, "
            "or raise max_range"
        )
    return (
        f"{found}: nothing that sends enough back is where it looks; turn it, or widen what it sees"
    )


def nearest(points: np.ndarray, scene: SceneGeometry) -> float:
    """Metres from the nearest of points (P, 3) to the box around the nearest thing; inf without any."""
    low, high = scene.bounds()
    there = np.isfinite(low).all(axis=1)
    if not there.any() or not len(points):
        return float("inf")
    gaps = [
        np.linalg.norm(np.maximum(np.maximum(low[there] - at, at - high[there]), 0.0), axis=1).min()
        for at in np.asarray(points, dtype=np.float64)
    ]
    return float(min(gaps))


# Lines that show where a sensor looks: chains of segments, and rays from a place.
#
# Points in world coordinates, metres, go in, line segments come out; they can be drawn while a slider
# moves.


AROUND = 64  # segments of a full circle


def chain(points: np.ndarray) -> np.ndarray:
    """(N - 1, 2, 3) segments along points (N, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1)


def rays_to(point: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(N, 2, 3) segments from a point to ends (N, 3)."""
    return np.stack([np.broadcast_to(point, ends.shape), ends], axis=1)
