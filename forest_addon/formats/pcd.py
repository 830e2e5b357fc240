"""Point clouds as PCD 0.7, the format of PCL and ROS: binary, every field of a record by its name."""

from __future__ import annotations

import os

import numpy as np

from .atomic import replacing
from .ply import ROWS_AT_ONCE, StoredRows

KINDS = {"f": "F", "i": "I", "u": "U"}


def write_pcd(
    path: str | os.PathLike[str],
    rows: np.ndarray | StoredRows,
    viewpoint: tuple[float, float, float],
) -> None:
    """Write rows (P,) of a structured array; x, y and z in double precision, as map coordinates need.

    viewpoint : (x, y, z) m, where the scanner stood.

    Raises
    ------
    OSError : it cannot be written.
    """
    fields = [(name, rows.dtype[name]) for name in rows.dtype.names or ()]
    head = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS " + " ".join(name for name, _ in fields),
        "SIZE " + " ".join(str(kind.itemsize) for _, kind in fields),
        "TYPE " + " ".join(KINDS[kind.kind] for _, kind in fields),
        "COUNT " + " ".join("1" for _ in fields),
        f"WIDTH {len(rows)}",
        "HEIGHT 1",
        f"VIEWPOINT {' '.join(f'{value:.10g}' for value in viewpoint)} 1 0 0 0",
        f"POINTS {len(rows)}",
        "DATA binary",
    ]
    with replacing(path) as partial, open(partial, "wb") as file:
        file.write(("\n".join(head) + "\n").encode("ascii"))
        for first in range(0, len(rows), ROWS_AT_ONCE):
            file.write(rows[first : first + ROWS_AT_ONCE].tobytes())
