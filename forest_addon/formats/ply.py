"""Point clouds as binary PLY: every field of a record as a property.

What other programs are to read has x, y and z in single precision about an origin that a comment tells, as
PCL, Open3D and CloudCompare want them; in double precision they are the map's, and PCL reads no point.

``PlyFile`` also grows: rows are added at its end, then the number of vertices in its header is raised.
Whenever it is cut off, a reader finds the rows that were there when the number was last written. The
header keeps its length, because a comment takes the place that the number does not need.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, overload

import numpy as np

from ..spec import SpecError
from .atomic import replacing
from .foreign import guarded, refuse_coarse

PLY_TYPE = {
    "f8": "double",
    "f4": "float",
    "u4": "uint",
    "i4": "int",
    "i2": "short",
    "i1": "char",
    "u1": "uchar",
}
TYPES = {word: kind for kind, word in PLY_TYPE.items()} | {"ushort": "u2"}
DIGITS = 18  # of the number of vertices
ROWS_AT_ONCE = 200_000
PLACE = ("x", "y", "z")
Origin = Sequence[float] | None


def header_of(dtype: np.dtype, count: int, comments: Sequence[str] = ()) -> bytes:
    """A header whose length depends on the type and the comments, not on the count."""
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += [f"comment {text}" for text in comments]
    lines += [f"element vertex {count}", "comment " + "-" * (DIGITS - len(str(count)))]
    lines += [f"property {PLY_TYPE[dtype[n].str[1:]]} {n}" for n in dtype.names or ()]
    return ("\n".join([*lines, "end_header"]) + "\n").encode("ascii", "replace")


def write_ply(
    path: str | os.PathLike[str],
    rows: np.ndarray | StoredRows,
    comments: Sequence[str] = (),
    origin: Origin = None,
) -> None:
    """Write rows (P,) of a structured array, also of a file.

    origin : (3,) metres that x, y and z are about, in single precision; None: as they are.

    Raises
    ------
    OSError : it cannot be written.
    """
    kind = kind_about(rows.dtype, origin, {"amplitude": "intensity"})
    head = header_of(kind, len(rows), (*comments, said_of(origin)))
    write_records(path, head, rows, kind, origin)


@guarded("a PLY of triangles")
def read_surface(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Corners (V, 3) and triangles (T, 3) of a PLY, ASCII or binary; larger faces are cut into fans.

    Raises
    ------
    SpecError : it is no PLY, has no faces, or lost its shape at map coordinates.
    """
    data, order, parts = _head_of(path)
    words, stored = iter(data.split() if not order else ()), io.BytesIO(data)

    def take(kind: str) -> Any:
        if not order:
            return float(next(words))
        number = np.dtype(TYPES.get(kind, kind)).newbyteorder(order)
        return np.frombuffer(stored.read(number.itemsize), number)[0]

    elements: dict[str, list[Any]] = {"vertex": [], "face": []}
    for name, count, properties in parts:
        for _ in range(count):
            row = {
                p[-1]: [take(p[2]) for _ in range(int(take(p[1])))]
                if p[0] == "list"
                else take(p[0])
                for p in properties
            }
            corners = next((value for value in row.values() if isinstance(value, list)), [])
            at = [row.get(axis) for axis in PLACE] if name == "vertex" else corners
            elements.setdefault(name, []).append(at)
    fans = [(face[0], b, c) for face in elements["face"] for b, c in pairwise(face[1:])]
    if not fans:
        raise SpecError(str(path), "has no faces; a ground is a surface of triangles")
    vertices = np.array(elements["vertex"], dtype=np.float64)
    single = order and any(
        kind in properties
        for _, _, properties in parts
        for kind in (["float", "x"], ["float32", "x"])
    )
    refuse_coarse(path, vertices, exact=not single)
    return vertices, np.array(fans).astype(np.int64)


def refuse_broken_ply(path: Path) -> None:
    """Refuse a PLY that begins, as all but rare ones, with corners of which some are no finite numbers, or
    whose shape is lost at map coordinates.

    Raises
    ------
    SpecError : says what, and what to do.
    """
    data, order, ((name, count, properties), *_) = _head_of(path)
    if name != "vertex" or any(kind[0] == "list" for kind in properties):
        return
    if not order:
        columns = [[kind[-1] for kind in properties].index(axis) for axis in PLACE]
        places = np.loadtxt(io.BytesIO(data), usecols=columns, max_rows=count, ndmin=2)
    else:
        kinds = [
            (name, order + np.dtype(TYPES.get(kind, kind)).str[1:]) for kind, name in properties
        ]
        rows = np.frombuffer(data, kinds, count)
        places = np.column_stack([rows[axis] for axis in PLACE])
    refuse_coarse(path, places)


def _head_of(path: Path) -> tuple[bytes, Any, list[tuple[str, int, list[list[str]]]]]:
    """Bytes below a PLY's head, their order ("" of text), and its elements: names, counts, properties."""
    data = path.read_bytes()
    start = data.index(b"\n", data.index(b"end_header")) + 1
    head = data[:start].decode("ascii", "replace")
    form, *parts = re.split(r"\n\s*element\s+", head)
    order = ">" if "big_endian" in form else "<" if "binary" in form else ""
    found = [(*part.split()[:2], re.findall(r"\n\s*property\s+(.*)", part)) for part in parts]
    return data[start:], order, [(a, int(b), [*map(str.split, c)]) for a, b, c in found]


def said_of(origin: Origin) -> str:
    """The comment of a file on where its coordinates start, or on who cannot read them."""
    if origin is None:
        return "coordinates in double precision; PCL, and what is built on it, reads no point"
    return "origin {:.10g} {:.10g} {:.10g}, m; add it to x y z".format(*origin)


def kind_about(kind: np.dtype, origin: Origin, names: Mapping[str, str]) -> np.dtype:
    """The type of records under other names, with x, y and z in single precision about an origin."""
    single = () if origin is None else PLACE
    return np.dtype(
        [(names.get(n, n), "<f4" if n in single else kind[n]) for n in kind.names or ()]
    )


def write_records(
    path: str | os.PathLike[str],
    head: bytes,
    rows: np.ndarray | StoredRows,
    kind: np.dtype,
    origin: Origin,
) -> None:
    """Write a head and, after it, rows (P,) as records of a kind (``kind_about``), a part at a time."""
    with replacing(path) as partial, open(partial, "wb") as file:
        file.write(head)
        for first in range(0, len(rows), ROWS_AT_ONCE):
            part = rows[first : first + ROWS_AT_ONCE]
            made = np.empty(len(part), kind)
            for name, called in zip(rows.dtype.names or (), kind.names or (), strict=True):
                start = 0.0 if origin is None or name not in PLACE else origin[PLACE.index(name)]
                made[called] = part[name] - start if start else part[name]
            file.write(made.tobytes())


def bounds(rows: np.ndarray | StoredRows) -> tuple[np.ndarray, np.ndarray]:
    """(3,) smallest and largest coordinates, zeros where there are no rows."""
    if not len(rows):
        return np.zeros(3), np.zeros(3)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for first in range(0, len(rows), ROWS_AT_ONCE):
        part = rows[first : first + ROWS_AT_ONCE]
        low = np.minimum(low, [part[axis].min() for axis in PLACE])
        high = np.maximum(high, [part[axis].max() for axis in PLACE])
    return low, high


class StoredRows:
    """Rows (N,) of a file, of which a slice is read when it is asked for: none of them stay in memory.

    ``rows["x"]`` is a field of them.
    """

    def __init__(self, path: Path, kind: np.dtype, start: int, count: int, field: str = "") -> None:
        self.dtype = kind[field] if field else kind
        self._stored = path, kind, start, count
        self._field = field

    def __len__(self) -> int:
        return self._stored[3]

    @overload
    def __getitem__(self, some: slice) -> np.ndarray: ...

    @overload
    def __getitem__(self, some: str) -> StoredRows: ...

    def __getitem__(self, some: slice | str) -> np.ndarray | StoredRows:
        path, kind, start, count = self._stored
        if isinstance(some, str):
            return StoredRows(path, kind, start, count, some)
        first, last, _ = some.indices(count)
        offset = start + first * kind.itemsize
        rows = np.fromfile(path, kind, max(last - first, 0), offset=offset)
        return rows[self._field] if self._field else rows


class PlyFile:
    """A PLY file that grows, and is whole after each ``append``."""

    def __init__(
        self, path: Path, dtype: np.dtype, comments: Sequence[str] = (), keep: int = 0
    ) -> None:
        """Open a file; its first ``keep`` rows stay, the rest is cut off.

        Raises
        ------
        OSError : it cannot be written, or it has not so many rows.
        """
        self.path, self.dtype, self.count = path, dtype, keep
        self.comments = comments
        self._start = len(header_of(dtype, 0, comments))
        end = self._start + keep * dtype.itemsize
        if keep and (not path.is_file() or path.stat().st_size < end):
            raise OSError(f"{path.name} has lost rows; start again without it")
        self._file = open(path, "r+b" if keep else "w+b")  # noqa: SIM115  closed by close()
        self._file.truncate(end)
        self._say_count()

    def append(self, rows: np.ndarray) -> None:
        """Add rows (P,); they are on the disk when this returns."""
        self._file.seek(self._start + self.count * self.dtype.itemsize)
        self._file.write(rows.tobytes())
        self._flush()
        self.count += len(rows)
        self._say_count()

    def rows(self) -> StoredRows:
        """All rows (N,), read from the disk as they are used."""
        return StoredRows(self.path, self.dtype, self._start, self.count)

    def close(self) -> None:
        """Close the file; it stays whole."""
        self._file.close()

    def _say_count(self) -> None:
        self._file.seek(0)
        self._file.write(header_of(self.dtype, self.count, self.comments))
        self._flush()

    def _flush(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())
