"""Results of a run that was ended before its last sensor, kept so that ``--resume`` need not take them again.

They lie in ``.unfinished`` of the run's folder, one file a sensor, until the run is done. A file is named by
all that decides its result: the scene's settings, the evaluated scene, files that the sensor names, versions.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import pickle
import shutil
from pathlib import Path
from typing import Any

from forest_addon.api import Result, World
from forest_addon.base.places import version
from forest_addon.formats.atomic import replacing
from forest_addon.results.scan_file import scene_digest
from forest_addon.spec import Scene, Sensor, SpecError, with_files

NAME = ".unfinished"
PLAIN = {  # what results are made of, besides dataclasses of our own
    "numpy": ("ndarray", "dtype", "_reconstruct", "_frombuffer", "scalar"),
    "builtins": ("set", "frozenset", "slice", "complex", "range"),
    "pathlib": ("PosixPath", "WindowsPath", "Path"),
}


class Unfinished:
    """Results that an ended run of the same scene left in a folder, and those that this one will."""

    def __init__(self, out: Path, world: World, resume: bool) -> None:
        self._folder = out / NAME
        self._world = world
        self._scene = scene_digest(world.observer.geometry)
        if not resume:
            self.drop()
        left = {file.name for file in self._folder.glob("*.pickle")}
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
                found = _Reader(stream).load()
        except Exception:  # whatever lies there: the sensor looks again
            return None
        return found if isinstance(found, Result) else None

    def keep(self, result: Result, sensor: Sensor) -> None:
        """Keep a result until the run is done."""
        self._folder.mkdir(exist_ok=True)
        with replacing(self._file(sensor)) as partial, open(partial, "wb") as stream:
            pickle.dump(result, stream, protocol=5)

    def drop(self) -> None:
        """Forget all of it: the run is done, or begins anew."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _file(self, sensor: Sensor) -> Path:
        total = hashlib.blake2b(self._scene, digest_size=12)
        said = [version(), _shown(self._world.scene.changed(sensors=())), _shown(sensor)]
        total.update(json.dumps(said, sort_keys=True).encode())

        def read(name: str) -> str:
            path = self._world.folder / name
            total.update(path.read_bytes() if path.is_file() else name.encode())
            return name

        with_files(sensor, read)
        return self._folder / f"{sensor.name}-{total.hexdigest()}.pickle"


def _shown(settings: Scene | Sensor) -> dict[str, Any]:
    return dataclasses.asdict(settings)


class _Reader(pickle.Unpickler):
    """Reads results, and calls nothing but what makes up arrays and our own classes."""

    def find_class(self, module: str, name: str) -> Any:
        room = module.partition(".")[0]
        if name not in PLAIN.get(room, ()) and room != "forest_addon":
            raise pickle.UnpicklingError(f"{module}.{name} is of no result")
        found = super().find_class(module, name)
        if room == "forest_addon" and not dataclasses.is_dataclass(found):
            raise pickle.UnpicklingError(f"{module}.{name} is of no result")
        return found
