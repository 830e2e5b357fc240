"""Point clouds as PCD 0.7, the format of PCL and ROS: binary, every field of a record by PCL's names.

The viewpoint is the origin that x, y and z are about: ``pcl_transform_from_viewpoint`` puts them on the map.
"""

from __future__ import annotations

import os

import numpy as np

from .ply import Origin, StoredRows, kind_about, said_of, write_records

KINDS = {"f": "F", "i": "I", "u": "U"}
NAMES = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z", "amplitude": "intensity"}


def write_pcd(
    path: str | os.PathLike[str], rows: np.ndarray | StoredRows, origin: Origin = None
) -> None:
    """Write rows (P,) of a structured array.

    origin : (3,) metres that x, y and z are about, in single precision; None: as they are.

    Raises
    ------
    OSError : it cannot be written.
    """
    kind = kind_about(rows.dtype, origin, NAMES)
    fields = [(name, kind[name]) for name in kind.names or ()]
    viewpoint = " ".join(f"{value:.10g}" for value in origin or (0.0, 0.0, 0.0))
    head = [
        "# .PCD v0.7 - Point Cloud Data file format",
        f"# {said_of(origin)}",
        "VERSION 0.7",
        "FIELDS " + " ".join(name for name, _ in fields),
        "SIZE " + " ".join(str(part.itemsize) for _, part in fields),
        "TYPE " + " ".join(KINDS[part.kind] for _, part in fields),
        "COUNT " + " ".join("1" for _ in fields),
        f"WIDTH {len(rows)}",
        "HEIGHT 1",
        f"VIEWPOINT {viewpoint} 1 0 0 0",
        f"POINTS {len(rows)}",
        "DATA binary",
    ]
    write_records(path, ("\n".join(head) + "\n").encode("ascii"), rows, kind, origin)
