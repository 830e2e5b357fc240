"""A result in the format that another program reads: point clouds, sounds, tables.

``FORMATS`` says which there are for which kind of result, the usual one first. Points carry every field of
``points.POINT`` in every format; sounds as tables have the time and a column a channel.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..base.labels import Labels
from ..formats.atomic import replacing
from ..formats.las import write_las
from ..formats.npz import write_npz
from ..formats.ply import header_of
from ..formats.table import write_csv
from ..sensing.lidar.cloud import Cloud
from ..sensing.lidar.tractor import TractorScan, to_cloud
from ..sensing.reverb.response import ImpulseResponse, channels_of
from ..sensing.sonar.flight import Flight
from ..sensing.sonar.ping import Echo
from ..spec import Sensor, SpecError, Tractor
from .figures import Finding
from .findings import write_finding
from .points import UNITS, records

POINTS = (".laz", ".las", ".ply", ".npz", ".csv")
SOUNDS = (".wav", ".npz", ".csv")


def formats_of(found: Finding) -> tuple[str, ...]:
    """The endings of files that a result can be written to, the usual one first."""
    return POINTS if isinstance(found, Cloud | TractorScan) else SOUNDS


def write_as(
    path: Path,
    sensor: Sensor,
    found: Finding,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    labels: Labels | None = None,
) -> None:
    """Write a result; the ending of the path says how.

    offset : metres added to the positions of points, the scene's ``offset``. labels : of points, beside
        those that every file has, with their names.

    Raises
    ------
    SpecError : an ending that is none of ``formats_of``.
    OSError : it cannot be written; what had its name before stays as it was.
    """
    ending = path.suffix.lower()
    if ending not in formats_of(found):
        allowed = ", ".join(formats_of(found))
        raise SpecError(path.name, f'cannot be written as "{ending}"; use {allowed}')
    if isinstance(found, Cloud | TractorScan):
        cloud = to_cloud(found, _tractor(sensor)) if isinstance(found, TractorScan) else found
        _WRITERS[ending](path, records(cloud, offset), labels)
    elif ending == ".csv":
        write_csv(path, _columns(found))
    else:
        _take_file(path, sensor, found, offset)


def _tractor(sensor: Sensor) -> Tractor:
    assert isinstance(sensor, Tractor)
    return sensor


def _write_las(path: Path, rows: np.ndarray, labels: Labels | None) -> None:
    write_las(path, rows, labels=labels)


def _write_ply(path: Path, rows: np.ndarray, labels: Labels | None) -> None:
    """Labels are one property more; comments say what each number is called."""
    says = []
    if labels is not None:
        wider = np.empty(len(rows), dtype=[*rows.dtype.descr, ("label", "<i4")])
        for name in rows.dtype.names or ():
            wider[name] = rows[name]
        wider["label"], rows = labels.number, wider
        says = [f"label {number} {name}" for number, name in enumerate(labels.names)]
    with replacing(path) as partial, open(partial, "wb") as file:
        file.write(header_of(rows.dtype, len(rows), says))
        file.write(rows.tobytes())


def _write_columns(path: Path, rows: np.ndarray, labels: Labels | None) -> None:
    columns = {name: rows[name] for name in rows.dtype.names or ()}
    if labels is not None:
        columns |= {"label": labels.number, "label_name": np.array(labels.names, dtype=np.str_)}
    write_npz(path, columns, UNITS)


def _write_table(path: Path, rows: np.ndarray, labels: Labels | None) -> None:
    units = {name: f"{name}_{unit}".replace("/", "_") for name, unit in UNITS.items()}
    columns = {units.get(n, n): rows[n].tolist() for n in rows.dtype.names or ()}
    write_csv(path, columns | ({} if labels is None else {"label": labels.words()}))


_WRITERS: dict[str, Callable[[Path, np.ndarray, Labels | None], None]] = {
    ".laz": _write_las,
    ".las": _write_las,
    ".ply": _write_ply,
    ".npz": _write_columns,
    ".csv": _write_table,
}


def _columns(found: Finding) -> dict[str, list[float]]:
    """Time and channels of a sound; of a flight one ping after the other."""
    if isinstance(found, ImpulseResponse):
        samples, rate = np.atleast_2d(channels_of(found).T), found.sample_rate
    elif isinstance(found, Flight):
        stacked = found.stacked("waveforms")
        samples, rate = np.moveaxis(stacked, 1, 0).reshape(stacked.shape[1], -1), _rate(found)
    else:
        assert isinstance(found, Echo)
        samples, rate = found.waveforms, found.sample_rate
    time = {"time_s": (np.arange(samples.shape[1]) / rate).tolist()}
    return time | {f"channel_{n}": row.tolist() for n, row in enumerate(samples, 1)}


def _rate(flight: Flight) -> float:
    return float(flight.echoes[0].sample_rate)


def _take_file(
    path: Path, sensor: Sensor, found: Finding, offset: tuple[float, float, float]
) -> None:
    """The file of this ending among those that a run writes."""
    with tempfile.TemporaryDirectory(prefix=".export-", dir=path.parent) as folder:
        written = write_finding(Path(folder), replace(sensor, name="result"), found, offset)
        (one,) = (file for file in written if file.name == f"result{path.suffix.lower()}")
        with replacing(path) as partial:
            partial.write_bytes(one.read_bytes())
