"""Results of a run that was ended before its last sensor, kept so that ``--resume`` need not take them again.

They lie in ``.unfinished`` of the run's folder, one file a sensor, until the run is done. A file is named by
all that decides its result: the scene's settings, the evaluated scene, files that the sensor names, versions.

Records in it (``results.packed``) are dataclasses of the add-on, named by module and class; nothing else is
looked up.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import json
import re
from contextlib import suppress
from operator import attrgetter
from pathlib import Path

from forest_addon.api import Result, World
from forest_addon.base.places import version
from forest_addon.formats.atomic import replacing
from forest_addon.results.packed import read_values, write_values
from forest_addon.results.scan_file import scene_digest
from forest_addon.spec import Sensor, SpecError, with_files

ROOM = (__package__ or "").removesuffix("headless") + "forest_addon."


def name_of(kind: type) -> str:
    """The name of a record, with its module."""
    return f"{kind.__module__}:{kind.__qualname__}"


def kind_of(name: str) -> type:
    """Return the record of such a name.

    Raises
    ------
    ValueError : it is no dataclass of the add-on.
    """
    module, _, inside = name.partition(":")
    kind = attrgetter(inside)(importlib.import_module(module)) if module.startswith(ROOM) else None
    if not (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
        raise ValueError(f"{name} is of no result")
    return kind


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
                (found,) = read_values(stream, kind_of)
        except Exception:  # whatever lies there: the sensor looks again
            return None
        return found if isinstance(found, Result) else None

    def keep(self, result: Result, sensor: Sensor) -> None:
        """Keep a result until the run is done."""
        self._folder.mkdir(exist_ok=True)
        with replacing(self._file(sensor), ours=True) as partial, open(partial, "wb") as stream:
            write_values(stream, [result], name_of)

    def drop(self) -> None:
        """Forget all of it: the run is done, or begins anew."""
        for file in self._folder.glob("*.npz"):
            if KEPT.fullmatch(file.name):
                file.unlink()
        with suppress(OSError):  # it is not there, or something of the user's is in it
            self._folder.rmdir()

    def _file(self, sensor: Sensor) -> Path:
        total = hashlib.blake2b(self._scene, digest_size=12)
        scene = self._world.scene.changed(sensors=())
        said = [version(), *map(dataclasses.asdict, (scene, sensor))]
        total.update(json.dumps(said, sort_keys=True).encode())

        def read(name: str) -> str:
            path = self._world.folder / name
            total.update(path.read_bytes() if path.is_file() else name.encode())
            return name

        with_files(sensor, read)
        return self._folder / f"{sensor.name}-{total.hexdigest()}.npz"
