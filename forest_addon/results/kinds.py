"""Table of all results: what each kind of sensor gives (``kind``), by the word that names the sensor.

The files of this room that the table holds are light: what writes or measures is imported when it is asked
for.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .. import kernels
from ..formats.table import write_csv, write_npz
from ..sensing.kind import Seen
from ..spec import Scene, Sensor, SpecError
from .coordinates import FILE, NO_OFFSET, Offset
from .kind import Figure, Finding, ResultKind, Variables, numbers
from .points import ending_of
from .reverb import REVERB
from .scanner import SCANNER
from .sonar import SONAR
from .tractor import TRACTOR

# Files and folders of a run, and of a scene of a dataset, that are no sensor's.
OF_SCENE = (
    *("trees.csv", "leaf_angles.csv", "leaves.npz", "variant_leaves.npz", "cylinders.csv", "qsm"),
    *("stand.png", "goodness.png", "preview.png", "forest.blend", "forest.glb", "forest.usdc"),
    *("report.html", "run.json", "scene.json", "tiles", "tiles.csv", FILE),
)

RESULTS: dict[str, ResultKind] = {
    "tractor": TRACTOR,
    "terrestrial": SCANNER,
    "mobile": SCANNER,
    "airborne": SCANNER,
    "sonar": SONAR,
    "reverb": REVERB,
}


def results_of(sensor: Sensor) -> ResultKind:
    """Return the record of what a sensor gives."""
    return RESULTS[sensor.kind]


def figures_of(sensor: Sensor, found: Finding, seen: Seen | None = None) -> list[Figure]:
    """Return the figures of what a sensor found. seen : the scene that it looked at, where it is known."""
    engine = numbers("", "Kernels", kernels.engine())
    return [*results_of(sensor).figures(sensor, found, seen), engine]


def sentence_of(sensor: Sensor, found: Finding) -> str:
    """Return the most telling figure of a result in a few words, kept for translators."""
    record = results_of(sensor)
    first = [each.text for each in record.figures(sensor, found, None)[:1]]
    return record.sentence(found) or next(iter(first), "")


def labelled_of(sensor: Sensor, found: Finding) -> tuple[Variables, Variables]:
    """Variables and coordinates of a result by name, each its dimensions, values and unit."""
    record = results_of(sensor)
    if record.labelled is not None:
        return record.labelled(found)
    arrays = {name: np.asarray(values) for name, values in _arrays(record, found).items()}
    return {
        name: (tuple(f"{name}_{k}" for k in range(v.ndim)), v, record.units.get(name, ""))
        for name, v in arrays.items()
    }, {}


def files_of(scene: Scene, dry: str = "") -> dict[str, str]:
    """Return names of the files, and folders, that a run of a scene may write, and what writes each.

    dry : name of the sound that every reverb is also heard with.

    Raises
    ------
    SpecError : two would have one name, also where the case of letters does not count.
    """
    made = dict.fromkeys(OF_SCENE, "the scene")
    taken = {name.casefold(): whose for name, whose in made.items()}
    for index, sensor in enumerate(scene.sensors):
        record = results_of(sensor)
        heard = (f"-{dry}.wav",) if dry and record.is_response else ()
        for ending in (*record.files, ".png", *heard):
            name = f"{sensor.name}{ending}"
            if name.casefold() in taken:
                raise SpecError(
                    f"sensors[{index}].name",
                    f'"{sensor.name}" writes {name}, as {taken[name.casefold()]} does; choose another name',
                )
            made[name] = taken[name.casefold()] = f'sensor "{sensor.name}"'
    return made


def write_finding(
    folder: Path, sensor: Sensor, found: Finding, offset: Offset = NO_OFFSET
) -> list[Path]:
    """Write a sensor's result into a folder; return the files, the one of the data first.

    offset : metres added to the positions of points, the scene's ``offset``.

    Raises
    ------
    OSError : it cannot be written; what had its name before stays as it was.
    """
    record, path = results_of(sensor), folder / f"{sensor.name}.npz"
    if record.write is not None:
        return record.write(folder, sensor, found, offset)
    write_npz(path, _arrays(record, found), dict(record.units))
    return [path]


def write_as(
    path: Path,
    sensor: Sensor,
    found: Finding,
    offset: Offset = NO_OFFSET,
) -> None:
    """Write a result; the ending of the path says how.

    offset : metres added to the positions of points, the scene's ``offset``.

    Raises
    ------
    SpecError : an ending that is none of the ``endings`` of its kind.
    OSError : it cannot be written; what had its name before stays as it was.
    """
    record, ending = results_of(sensor), ending_of(path)
    if ending not in record.endings:
        allowed = ", ".join(record.endings)
        raise SpecError(path.name, f'cannot be written as "{ending}"; use {allowed}')
    if record.saves:
        record.saves[ending](path, sensor, found, offset)
    elif ending == ".csv":
        # Write arrays of one length as columns; (N, K) becomes K columns
        columns: dict[str, list[Any]] = {}
        for name, array in _arrays(record, found).items():
            rows = np.atleast_1d(array)
            if rows.ndim == 1:
                columns[name] = rows.tolist()
            else:
                parts = rows.reshape(len(rows), -1).T
                columns |= {f"{name}_{number}": part.tolist() for number, part in enumerate(parts)}
        write_csv(path, columns)
    else:
        write_npz(path, _arrays(record, found), dict(record.units))


def _arrays(record: ResultKind, found: Finding) -> dict[str, np.ndarray]:
    assert record.arrays is not None, "a kind of result without write needs arrays"
    return record.arrays(found)
