"""Point clouds in the formats that other programs read; points carry every field of ``points.POINT``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..base.labels import Labels
from ..formats.atomic import replacing
from ..formats.npz import write_npz
from ..formats.ply import header_of
from ..formats.table import write_csv
from ..sensing.lidar.cloud import Cloud
from .points import UNITS, records

ENDINGS = (".laz", ".las", ".ply", ".npz", ".csv")


def write_points(
    path: Path, cloud: Cloud, offset: tuple[float, float, float], labels: Labels | None = None
) -> None:
    """Write a cloud; the ending of the path, one of ``ENDINGS``, says how.

    offset : metres added to positions. labels : beside those that every file has, with their names.

    Raises
    ------
    OSError : it cannot be written; what had its name before stays as it was.
    """
    _WRITERS[path.suffix.lower()](path, records(cloud, offset), labels)


def _write_las(path: Path, rows: np.ndarray, labels: Labels | None) -> None:
    from ..formats.las import write_las

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
