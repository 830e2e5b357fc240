"""Point clouds in the formats that other programs read; points carry every field of ``points.POINT``."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ..base.labels import Labels
from ..formats.atomic import replacing
from ..formats.npz import write_npz
from ..formats.ply import header_of
from ..formats.table import write_csv
from ..sensing.lidar.cloud import Cloud
from .coordinates import Offset
from .points import UNITS, records

ENDINGS = (".laz", ".las", ".copc.laz", ".e57", ".ply", ".pcd", ".xyz", ".npz", ".csv")
COPC = ".copc.laz"
NEEDS = {COPC: "copclib", ".e57": "pye57", ".sofa": "sofar"}  # of the extras [files] and [sofa]
STILL = 1e-6  # metres that the places of a scanner on a tripod may differ by


def write_points(path: Path, cloud: Cloud, offset: Offset, labels: Labels | None = None) -> None:
    """Write a cloud; the ending of the path, one of ``ENDINGS``, says how.

    offset : metres added to positions, and their coordinate system. labels : beside those that every
    file has, with their names.

    Raises
    ------
    SpecError : a package that the format needs is not installed; the coordinate system is not known.
    OSError : it cannot be written; what had its name before stays as it was.
    """
    _WRITERS[ending_of(path)](path, cloud, offset, labels)


def ending_of(path: Path) -> str:
    """The ending of a file's name that says its format: two parts of "cloud.copc.laz", else the last."""
    return COPC if path.name.lower().endswith(COPC) else path.suffix.lower()


def can_write(ending: str) -> bool:
    """Return whether the package that a format needs is installed."""
    return ending not in NEEDS or find_spec(NEEDS[ending]) is not None


def origin_of(cloud: Cloud) -> np.ndarray | None:
    """(3,) metres, where the scanner stood; None of one that moved, or without returns."""
    if not len(cloud):
        return None
    level = np.cos(cloud.elevation)
    axis = np.column_stack(
        [level * np.cos(cloud.azimuth), level * np.sin(cloud.azimuth), np.sin(cloud.elevation)]
    )
    places = cloud.position - cloud.returns.distance[:, None] * axis
    return np.median(places, axis=0) if np.ptp(places, axis=0).max() < STILL else None


def _write_las(path: Path, cloud: Cloud, offset: Offset, labels: Labels | None) -> None:
    from ..formats.las import write_las

    write_las(path, records(cloud, offset), labels=labels, crs=offset.crs)


def _write_e57(path: Path, cloud: Cloud, offset: Offset, _labels: Labels | None) -> None:
    """Points about the scanner, or about their middle where it moved."""
    from ..formats.e57 import LocalScan, write_e57

    origin = origin_of(cloud)
    about = np.median(cloud.position, axis=0) if origin is None and len(cloud) else origin
    about = np.zeros(3) if about is None else about
    x, y, z = (about + np.array(offset)).tolist()
    local = cloud.position - about
    seen = origin is not None
    write_e57(path, LocalScan(path.stem, local, cloud.intensity, (x, y, z), panorama=seen))


def _write_pcd(path: Path, cloud: Cloud, offset: Offset, labels: Labels | None) -> None:
    from ..formats.pcd import write_pcd

    origin = origin_of(cloud)
    x, y, z = (np.array(offset) + (0 if origin is None else origin)).tolist()
    rows = records(cloud, offset)
    write_pcd(path, rows if labels is None else _with_label(rows, labels), (x, y, z))


def _write_xyz(path: Path, cloud: Cloud, offset: Offset, labels: Labels | None) -> None:
    """Lines of x, y, z to 0.1 mm, intensity (dB), tree, organ and label, after one line of names."""
    rows = records(cloud, offset)
    level = 10 * np.log10(np.maximum(rows["amplitude"], 1e-30))
    columns = [rows["x"], rows["y"], rows["z"], level, rows["tree"], rows["organ"]]
    names, digits = "x y z intensity_db tree organ", ["%.4f"] * 3 + ["%.2f", "%d", "%d"]
    if labels is not None:
        columns, names, digits = [*columns, labels.number], f"{names} label", [*digits, "%d"]
    with replacing(path) as partial:
        np.savetxt(partial, np.column_stack(columns), fmt=digits, header=names, comments="//")


def _with_label(rows: np.ndarray, labels: Labels) -> np.ndarray:
    """The rows with one field more."""
    wider = np.empty(len(rows), dtype=[*rows.dtype.descr, ("label", "<i4")])
    for name in rows.dtype.names or ():
        wider[name] = rows[name]
    wider["label"] = labels.number
    return wider


def _write_ply(path: Path, cloud: Cloud, offset: Offset, labels: Labels | None) -> None:
    """Labels are one property more; comments say what each number is called."""
    says, rows = [], records(cloud, offset)
    if labels is not None:
        rows = _with_label(rows, labels)
        says = [f"label {number} {name}" for number, name in enumerate(labels.names)]
    with replacing(path) as partial, open(partial, "wb") as file:
        file.write(header_of(rows.dtype, len(rows), says))
        file.write(rows.tobytes())


def _write_columns(path: Path, cloud: Cloud, offset: Offset, labels: Labels | None) -> None:
    rows = records(cloud, offset)
    columns = {name: rows[name] for name in rows.dtype.names or ()}
    if labels is not None:
        columns |= {"label": labels.number, "label_name": np.array(labels.names, dtype=np.str_)}
    write_npz(path, columns, UNITS)


def _write_table(path: Path, cloud: Cloud, offset: Offset, labels: Labels | None) -> None:
    rows = records(cloud, offset)
    units = {name: f"{name}_{unit}".replace("/", "_") for name, unit in UNITS.items()}
    columns = {units.get(n, n): rows[n].tolist() for n in rows.dtype.names or ()}
    write_csv(path, columns | ({} if labels is None else {"label": labels.words()}))


_WRITERS: dict[str, Callable[[Path, Cloud, Offset, Labels | None], None]] = {
    ".laz": _write_las,
    ".las": _write_las,
    COPC: _write_las,
    ".e57": _write_e57,
    ".pcd": _write_pcd,
    ".xyz": _write_xyz,
    ".ply": _write_ply,
    ".npz": _write_columns,
    ".csv": _write_table,
}
