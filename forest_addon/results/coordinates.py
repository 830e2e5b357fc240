"""Coordinates of what is written: one rule for all files of numbers, and a note that says it.

Positions in point clouds, tables and arrays are those of the map: metres of the scene, its ``offset`` added
in double precision. A .blend, a .glb and a .usdc hold single precision, so they stay in the scene's own
coordinates; the first two carry the offset as a property. Within a session (``World``, ``Result``) all is in
the scene's own.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.atomic import write_whole
from ..spec import Scene


class Offset(tuple[float, float, float]):
    """Metres (3,) that are added to positions as they are written, and the coordinate system then.

    crs : "EPSG:32632"; empty: none is known.
    """

    crs: str

    def __new__(cls, metres: Iterable[float] = (0.0, 0.0, 0.0), crs: str = "") -> Offset:
        made = super().__new__(cls, metres)
        made.crs = crs
        return made

    @classmethod
    def of(cls, scene: Scene) -> Offset:
        """The offset and the coordinate system of a scene's settings."""
        return cls(scene.offset, scene.crs)


NO_OFFSET = Offset()
AXES = {f"{axis}_m": k for k, axis in enumerate("xyz")} | {
    f"{end}{axis}": k for end in ("start", "end") for k, axis in enumerate("XYZ")
}
PLACES = ("centre", "position", "rest")  # (..., 3) each
FILE = "coordinates.txt"
PROPERTY = "offset_m"  # of the scene in a .blend, of a .glb its scene's extras


def on_the_map(table: Mapping[str, Any], offset: Sequence[float]) -> dict[str, Any]:
    """Columns by name, those that are positions moved by the offset (3,) m; without one as they are."""
    if not any(offset):
        return dict(table)
    shift = np.asarray(offset, dtype=np.float64)
    moved = dict(table)
    for name, column in table.items():
        if name in AXES:
            column = np.asarray(column, dtype=np.float64) + shift[AXES[name]]
            moved[name] = column if isinstance(table[name], np.ndarray) else column.tolist()
        elif name in PLACES:
            moved[name] = np.asarray(column, dtype=np.float64) + shift
    return moved


def note_of(offset: Sequence[float], crs: str) -> str:
    """The words for coordinates that are written; empty of a scene without offset and coordinate system."""
    if not crs and not any(offset):
        return ""
    system = f" in {crs}" if crs else ""
    shift = ", ".join(f"{value:.12g}" for value in offset)
    return f"coordinates are metres{system}; the offset {shift} has been added"


def write_note(path: Path, offset: Sequence[float], crs: str) -> bool:
    """Write what the coordinates of a folder's files are, where there is something to say; returns that."""
    note = note_of(offset, crs)
    if note:
        text = (
            f"In point clouds, tables and arrays {note}. Cells of voxels times their edge lack it: add "
            "`origin`. forest.blend, forest.glb and forest.usdc are in the scene's own coordinates; the "
            f"first two have the offset as the scene's property `{PROPERTY}`.\n"
        )
        write_whole(path, text)
    return bool(note)
