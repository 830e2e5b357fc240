"""Arguments that a script hands over, checked at the door; sensors, ways and patterns that are made of them.

One sentence in place of what breaks further in.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.places import NO_BLENDER
from ..formats.table import write_csv
from ..formats.toml_file import PLATFORMS, read_scanner, scanner_names, structure
from ..sensing.kind import Cost
from ..sensing.kinds import kind_of
from ..sensing.trajectory import Trajectory
from ..spec import Scanner, Scene, Sensor, Settings, SpecError, unknown
from ..spec.base import typed
from ..stand.forest import GrownForest

SURELY = 2.0  # times the memory that is free: a run that asks for more is refused, known to a factor of 2
SENSED, EXPORTED = (
    3.5,
    7.5,
)  # times what trees hold as they grew: in Blender and for rays; as glTF too
KNOWN = 1.25  # to which factor that is known
LONGEST = 200  # bytes of a file's name, so that a temporary one beside it fits


def scene_of(key: str, scene: Any) -> Scene:
    """A scene's settings.

    Raises
    ------
    SpecError : it is something else; says what reads a file.
    """
    if isinstance(scene, Scene):
        return scene
    hint = "; read a scene file by read()" if isinstance(scene, (str, os.PathLike)) else ""
    raise SpecError(key, f"takes a Scene, not {called(scene)}{hint}")


def path_of(key: str, path: Any) -> Path:
    """A path.

    Raises
    ------
    SpecError : it is none.
    """
    if not isinstance(path, (str, os.PathLike)) or "\0" in os.fspath(path):
        raise SpecError(key, f"takes the path of a file or folder, not {called(path)}")
    return Path(path)


def file_to_write(path: Any) -> Path:
    """A path that a file can be written to.

    Raises
    ------
    SpecError : its folder is not there, it is a folder itself, or its name is too long.
    """
    path = path_of("save", path)
    if len(os.fsencode(path.name)) > LONGEST:
        raise SpecError(f"{path.name[:40]}…", f"is a name of more than {LONGEST} bytes; shorten it")
    if not path.parent.is_dir():
        what = "is no folder" if path.parent.exists() else "is not there; make it first"
        raise SpecError(str(path), f"cannot be written: the folder {path.parent} {what}")
    if path.is_dir():
        raise SpecError(str(path), "is a folder; name a file in it")
    return path


def points_of(key: str, points: Any, one: bool = False) -> np.ndarray:
    """Points (N, 3), or one point (3,), metres.

    Raises
    ------
    SpecError : they have another shape, or a coordinate is no finite number.
    """
    shape = "(3,)" if one else "(N, 3)"
    try:
        array = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise SpecError(key, f"takes an array {shape} of metres, not {called(points)}") from None
    fits = array.shape == (3,) if one else array.size > 0 and array.shape[-1:] == (3,)
    if not fits or array.ndim > 2:
        raise SpecError(key, f"takes an array {shape} of metres, not one of shape {array.shape}")
    if not np.isfinite(array).all():
        raise SpecError(key, "has a coordinate that is not finite; correct or remove it")
    return array


def progress_of(progress: Any) -> Any:
    """A function that is told of progress, or None.

    Raises
    ------
    SpecError : it cannot be called.
    """
    if progress is not None and not callable(progress):
        raise SpecError("progress", f"takes a function (done, total), not {called(progress)}")
    return progress


def called(obj: Any) -> str:
    """Words for what was handed over instead."""
    shape = getattr(obj, "shape", None)
    name = type(obj).__name__
    article = "an" if name[:1].lower() in "aeiou" else "a"
    if obj is None:
        return "None"
    if isinstance(obj, Settings):
        return f"{article} {name}"
    return f"{article} {name}" + (f" of shape {shape}" if shape is not None else "")


@contextmanager
def enough_memory(key: str, what: str) -> Iterator[None]:
    """Say in one sentence that memory did not suffice.

    Raises
    ------
    SpecError : it did not; ``what`` says what to take less of.
    """
    try:
        yield
    except MemoryError as problem:
        said = f" ({problem})" if str(problem) else ""
        raise SpecError(key, f"needs more memory than there is{said}; {what}") from None


def refuse_costly(sensor: Sensor, cost: Cost) -> None:
    """Refuse a run that memory will not hold.

    Raises
    ------
    SpecError : it needs more memory than there is, by far.
    """
    free = free_memory()
    if cost.memory > SURELY * free:
        raise SpecError(
            sensor.name,
            f"needs about {cost.memory / 1e9:,.3g} GB of memory, and {free / 1e9:,.3g} GB are free; send "
            "fewer pulses, pings or samples, or scan in [tiles]",
        )


def refuse_large(forest: GrownForest, exported: bool = False) -> None:
    """Refuse a forest that has grown and that memory will not hold as Blender's scene, for rays and as it is
    written into files.

    Raises
    ------
    SpecError : it needs more memory than there is, by far.
    """
    grown = sum(tree.nbytes for tree in forest.variants.values())
    needs, free = grown * (EXPORTED if exported else SENSED), free_memory()
    if needs > KNOWN * free:
        few = max(1, int(len(forest.variants) * free / needs))
        less = "" if not exported else "; output.glb = false halves it"
        raise SpecError(
            "plantings",
            f"their {len(forest.variants)} different trees need about {needs / 1e9:.3g} GB of memory in "
            f"Blender, and {free / 1e9:.3g} GB are free; give about {few} variants in all{less}",
        )


def free_memory() -> float:
    """Bytes of memory that this process may still take; infinity where the system does not tell."""
    free = math.inf
    with suppress(OSError):
        told = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        names = ("MemAvailable", "SwapFree")
        free = sum(1024.0 * int(told[name].split()[0]) for name in names if name in told)
    with suppress(ImportError, OSError):
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            free = min(free, limit - pages * os.sysconf("SC_PAGE_SIZE"))
    return free


def import_blender() -> Any:
    """``bpy``.

    Raises
    ------
    SpecError : it is not installed; says what to do.
    """
    try:
        import bpy
    except ImportError:
        raise SpecError("bpy", NO_BLENDER) from None
    return bpy


def save_pattern(
    path: str | Path,
    frequency: np.ndarray,
    level_db: np.ndarray,
    *,
    angle_deg: np.ndarray | None = None,
    azimuth_deg: np.ndarray | None = None,
    elevation_deg: np.ndarray | None = None,
) -> str:
    """Write a measured pattern as the file that a ``Sonar`` takes, and return the file's name for it.

    frequency : (F,) Hz, rising. level_db : (D, F) at directions, or (E, D, F) with one pattern an ear, the
    left one first. angle_deg : (D,) off the axis, from 0 on; or azimuth_deg : (D,), to the left, and
    elevation_deg : (D,), up, in any order and anywhere on the sphere.

    Raises
    ------
    SpecError : arrays that do not fit together; a number that is not finite.

    >>> import tempfile, numpy as np
    >>> from forest_addon import api as forest
    >>> file = tempfile.mkdtemp() + "/ears.csv"
    >>> level = [[0, 0], [-6, -9], [-30, -40]]
    >>> ears = forest.save_pattern(file, [30e3, 90e3], level, angle_deg=[0, 40, 180])
    >>> sonar = forest.Sonar(hearing="file", hearing_file=ears)
    """
    target = path_of("save_pattern", path)
    by = {"angle_deg": angle_deg, "azimuth_deg": azimuth_deg, "elevation_deg": elevation_deg}
    given = [name for name, values in by.items() if values is not None]
    if given not in (["angle_deg"], ["azimuth_deg", "elevation_deg"]):
        raise SpecError("save_pattern", "takes angle_deg, or azimuth_deg and elevation_deg")
    try:
        hertz = np.atleast_1d(np.asarray(frequency, np.float64))
        level = np.asarray(level_db, np.float64)
        angles = np.stack([np.asarray(by[name], np.float64) for name in given], axis=1)
    except (TypeError, ValueError):
        raise SpecError("save_pattern", "takes arrays of numbers, angles of one length") from None
    if level.shape[-2:] != (len(angles), len(hertz)) or level.ndim not in (2, 3):
        raise SpecError(
            "level_db",
            f"has the shape {level.shape}; give ({len(angles)}, {len(hertz)}), a row a direction and a "
            "column a frequency, or that for each ear",
        )
    if not all(np.isfinite(numbers).all() for numbers in (hertz, level, angles)):
        raise SpecError("save_pattern", "takes finite numbers")
    if level.ndim == 3 and given == ["angle_deg"]:
        raise SpecError("level_db", "of several ears needs azimuth_deg and elevation_deg")
    several = level.ndim == 3
    tables = (
        dict(zip(given, angles.T.tolist(), strict=True))
        | ({"ear": [ear] * len(angles)} if several else {})
        | dict(zip(map(repr, hertz.tolist()), table.T.tolist(), strict=True))
        for ear, table in enumerate(level if several else level[None])
    )
    write_csv(target, tables)
    return str(target.resolve())


def instruments() -> tuple[str, ...]:
    """Names that ``instrument`` knows.

    >>> from forest_addon import api as forest
    >>> "riegl-vz-400i" in forest.instruments()
    True
    """
    return tuple(scanner_names())


def instrument(name: str, kind: str = "", /, **settings: Any) -> Scanner:
    """A LiDAR sensor with the figures of an instrument of ``assets/scanners``, or of a .toml file like those.

    kind : "terrestrial", "mobile" or "airborne": what carries it; left out, the first of these that it is
    used on. settings : what is to be otherwise, as of ``Terrestrial``, ``Mobile`` or ``Airborne``.

    Raises
    ------
    SpecError : there is no such instrument, it is not used on that platform, or a setting cannot be used.

    >>> from forest_addon import api as forest
    >>> drone = forest.instrument("riegl-vux-1uav", "airborne", speed=5.0)
    >>> drone.pulse_rate, drone.speed
    (550000.0, 5.0)
    """
    name, kind = typed("instrument", name, str), typed("kind", kind, str)
    if kind and kind not in PLATFORMS:
        raise unknown("kind", kind, PLATFORMS)
    chosen = kind or next(iter(read_scanner(name).tables))
    sensor: Scanner = structure({"kind": chosen, "scanner": name}, Sensor)  # type: ignore[assignment]
    return sensor.changed(**settings)


if TYPE_CHECKING:
    from ..blender.sensors.observe import Observer


def trajectory(
    time: np.ndarray,
    position: np.ndarray,
    heading_deg: np.ndarray | float = 0.0,
    pitch_deg: np.ndarray | float = 0.0,
    roll_deg: np.ndarray | float = 0.0,
) -> Trajectory:
    """The way of a platform through poses; straight lines and shortest turns between them.

    time : (K,) seconds, rising. position : (K, 3) metres. heading_deg : (K,) or one, from +X to +Y.
    pitch_deg : nose up. roll_deg : left side up.

    Raises
    ------
    SpecError : arrays that do not fit together, times that do not rise, a number that is not finite.

    >>> from forest_addon import api as forest
    >>> way = forest.trajectory([0.0, 2.0], [(0, 0, 20), (10, 0, 20)])
    >>> len(way), way.duration
    (2, 2.0)
    """
    from scipy.spatial.transform import Rotation

    place = points_of("position", position)
    place = place[None] if place.ndim == 1 else place
    try:
        seconds = np.atleast_1d(np.asarray(time, dtype=np.float64))
        angles = [np.asarray(angle, np.float64) for angle in (heading_deg, pitch_deg, roll_deg)]
        turns = np.column_stack([np.broadcast_to(angle, len(place)) for angle in angles])
    except (TypeError, ValueError):
        raise SpecError(
            "trajectory", f"takes arrays of one length; there are {len(place)} positions"
        ) from None
    if seconds.shape != (len(place),):
        raise SpecError("time", f"has {seconds.size} values; give {len(place)}, one a position")
    if not (np.isfinite(seconds).all() and np.isfinite(turns).all()):
        raise SpecError("trajectory", "has a time or angle that is not finite; correct it")
    if (np.diff(seconds) <= 0).any():
        raise SpecError("time", "does not rise from pose to pose; sort the poses")
    attitude = Rotation.from_euler("ZYX", np.deg2rad(turns * [1.0, -1.0, 1.0]))
    return Trajectory(seconds, place, attitude)


def way_of(observer: Observer, sensor: Sensor, along: Any, folder: Path) -> Any:
    """Path of a sensor: what was handed over, or as its settings say.

    Raises
    ------
    SpecError : a way for a sensor that stays, or one that is no trajectory.
    """
    if along is None:
        return observer.way(sensor, folder)

    if not (
        isinstance(along, Trajectory)
        and isinstance(along.time, np.ndarray)
        and isinstance(along.position, np.ndarray)
        and hasattr(along.attitude, "as_matrix")
    ):
        raise SpecError(
            "along",
            f"takes what forest.trajectory makes (arrays, and a Rotation), not {called(along)}",
        )
    if not kind_of(sensor).moves:
        raise SpecError("along", f"is for a Mobile scanner or a Sonar, not {called(sensor)}")
    return along
