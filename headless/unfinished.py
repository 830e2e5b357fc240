"""Results of a run that was ended before its last sensor, kept so that ``--resume`` need not take them again.

They lie in ``.unfinished`` of the run's folder, one file a sensor, until the run is done. A file is named by
all that decides its result: the scene's settings, the evaluated scene, files that the sensor names, versions.

A file is an NPZ without pickles: arrays as they are, all else as JSON beside them. Dataclasses of the add-on
are named by module and class, and made again from their fields; nothing that a file names is called, and
nothing but such a dataclass is looked up.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import importlib
import json
import re
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from forest_addon.api import Result, World
from forest_addon.base.places import version
from forest_addon.formats.atomic import replacing
from forest_addon.results.coordinates import Offset
from forest_addon.results.scan_file import scene_digest
from forest_addon.spec import Scene, Sensor, SpecError, with_files

TEXT = "text"  # the entry that holds the JSON; arrays are called by their number
ROOM = (__package__ or "").removesuffix("headless") + "forest_addon."


def write_value(stream: IO[bytes], value: Any) -> None:
    """Write a value of dataclasses, arrays, containers and plain things.

    Raises
    ------
    TypeError : it holds something else.
    """
    arrays: list[np.ndarray] = []
    text = json.dumps(_packed(value, arrays))
    named = {str(number): array for number, array in enumerate(arrays)}
    np.savez(stream, **named, **{TEXT: np.frombuffer(text.encode(), dtype=np.uint8)})


def read_value(stream: IO[bytes]) -> Any:
    """Read what ``write_value`` wrote.

    Raises
    ------
    ValueError, KeyError, TypeError : it is no such file, or of another version.
    """
    with np.load(stream, allow_pickle=False) as file:
        return _unpacked(json.loads(file[TEXT].tobytes()), file)


def _packed(value: Any, arrays: list[np.ndarray]) -> Any:
    """Return a value as JSON: a scalar as itself, all else as [kind, content]."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        arrays.append(np.asarray(value))
        return ["array" if isinstance(value, np.ndarray) else "number", len(arrays) - 1]
    if dataclasses.is_dataclass(value):
        kind = type(value)
        names = [f.name for f in dataclasses.fields(value) if hasattr(value, f.name)]
        fields = {name: _packed(getattr(value, name), arrays) for name in names}
        return ["made", [kind.__module__, kind.__qualname__, fields]]
    if isinstance(value, Offset):
        return ["offset", [list(value), value.crs]]
    if isinstance(value, dict):
        return ["dict", [[_packed(k, arrays), _packed(v, arrays)] for k, v in value.items()]]
    if isinstance(value, tuple | list | set | frozenset):
        return [type(value).__name__, [_packed(item, arrays) for item in value]]
    if isinstance(value, complex):
        return ["complex", [value.real, value.imag]]
    if isinstance(value, range | slice):
        return [type(value).__name__, [value.start, value.stop, value.step]]
    if isinstance(value, Path):
        return ["path", str(value)]
    if isinstance(value, functools.partial):  # work that was left until somebody asks: done now
        return ["later", _packed(value(), arrays)]
    raise TypeError(f"{type(value).__name__} is of no result")


def _unpacked(packed: Any, arrays: Any) -> Any:
    if not isinstance(packed, list):
        return packed
    kind, content = packed
    if kind == "array":
        return arrays[str(content)]
    if kind == "number":
        return arrays[str(content)][()]
    if kind == "made":
        return _made(*content, arrays)
    if kind == "dict":
        return {_unpacked(k, arrays): _unpacked(v, arrays) for k, v in content}
    if kind == "offset":
        return Offset(*content)
    if kind == "path":
        return Path(content)
    if kind == "later":
        return functools.partial(_as_kept, _unpacked(content, arrays))
    known = {"tuple": tuple, "list": list, "set": set, "frozenset": frozenset}
    if kind in known:
        return known[kind](_unpacked(item, arrays) for item in content)
    return {"complex": complex, "range": range, "slice": slice}[kind](*content)


def _as_kept(value: Any) -> Any:
    return value


def _made(module: str, name: str, fields: dict[str, Any], arrays: Any) -> Any:
    """Return a dataclass of ours with these fields, as it was: it was checked when it was first made."""
    if not module.startswith(ROOM):
        raise ValueError(f"{module}.{name} is of no result")
    kind: Any = importlib.import_module(module)
    for part in name.split("."):
        kind = getattr(kind, part)
    if not (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
        raise ValueError(f"{module}.{name} is of no result")
    made = object.__new__(kind)
    for key, value in fields.items():
        object.__setattr__(made, key, _unpacked(value, arrays))
    return made


NAME = ".unfinished"
KEPT = re.compile(r"[\w-]+-[0-9a-f]{24}\.npz")  # a sensor's name, and what decides its result


class Unfinished:
    """Results that an ended run of the same scene left in a folder, and those that this one will."""

    def __init__(self, out: Path, world: World, resume: bool) -> None:
        self._folder = out / NAME
        self._world = world
        self._scene = scene_digest(world.observer.geometry)
        if not resume:
            self.drop()
        left = {file.name for file in self._folder.glob("*.npz")}
        usable = {self._file(sensor).name for sensor in world.scene.sensors}
        if left and not left & usable:
            raise SpecError(
                "--resume", f"what {out} keeps is of other settings or files; run again without it"
            )

    def result(self, sensor: Sensor) -> Result | None:
        """A sensor's result, if it was finished; None too where its file is broken."""
        file = self._file(sensor)
        if not file.is_file():
            return None
        try:
            with open(file, "rb") as stream:
                found = read_value(stream)
        except Exception:  # whatever lies there: the sensor looks again
            return None
        return found if isinstance(found, Result) else None

    def keep(self, result: Result, sensor: Sensor) -> None:
        """Keep a result until the run is done."""
        self._folder.mkdir(exist_ok=True)
        with replacing(self._file(sensor), ours=True) as partial, open(partial, "wb") as stream:
            write_value(stream, result)

    def drop(self) -> None:
        """Forget all of it: the run is done, or begins anew."""
        for file in self._folder.glob("*.npz"):
            if KEPT.fullmatch(file.name):
                file.unlink()
        with suppress(OSError):  # it is not there, or something of the user's is in it
            self._folder.rmdir()

    def _file(self, sensor: Sensor) -> Path:
        total = hashlib.blake2b(self._scene, digest_size=12)
        said = [version(), _shown(self._world.scene.changed(sensors=())), _shown(sensor)]
        total.update(json.dumps(said, sort_keys=True).encode())

        def read(name: str) -> str:
            path = self._world.folder / name
            total.update(path.read_bytes() if path.is_file() else name.encode())
            return name

        with_files(sensor, read)
        return self._folder / f"{sensor.name}-{total.hexdigest()}.npz"


def _shown(settings: Scene | Sensor) -> dict[str, Any]:
    return dataclasses.asdict(settings)
