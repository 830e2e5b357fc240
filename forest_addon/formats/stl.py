"""STL: a list of facets, three corners each; binary or ASCII, told apart by content.

Reading gives the corners alone, (T, 3, 3) float64 in file units: an STL has no units, and its normals
are left out because exporters leave them zero or flipped, while the corners always tell them. Writing
makes binary STL, the same bytes for the same facets.
"""

from __future__ import annotations

import os

import numpy as np

from .atomic import replacing

HEADER_BYTES = 84  # 80 of text, then the facet count
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


class StlError(ValueError):
    """A file that cannot be read or written as STL: one sentence with what, which file, what to do."""


def write_stl(
    path: str | os.PathLike[str], facets: np.ndarray, header: str = "Forest Sensing"
) -> None:
    """Write facets (T, 3, 3) as binary STL; normals follow from the corners (right-hand rule).

    header : up to 80 ASCII characters; it may not start with "solid", which marks ASCII files.

    Raises
    ------
    StlError : a coordinate is not finite or does not fit in float32, or the shape or header is wrong.
    """
    name = os.path.basename(os.fspath(path))
    corners = np.asarray(facets, dtype=np.float64)
    if corners.ndim != 3 or corners.shape[1:] != (3, 3):
        raise StlError(f"{name}: facets must have the shape (T, 3, 3), not {corners.shape}.")
    if not np.all(np.abs(corners) <= np.finfo(np.float32).max):
        raise StlError(f"{name}: a corner is not a finite float32 number; remove that facet first.")
    text = header.encode("ascii", "replace")
    if len(text) > 80 or text.lstrip().lower().startswith(b"solid"):
        raise StlError(f'{name}: the header must be at most 80 characters and not start with "solid".')

    record = np.zeros(len(corners), dtype=FACET)
    record["corners"] = corners
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    norm = np.linalg.norm(cross, axis=1, keepdims=True)
    record["normal"] = cross / np.where(norm > 0, norm, 1.0)  # zero area: zero normal
    with replacing(path) as partial, open(partial, "wb") as file:
        file.write(text.ljust(80, b"\0"))
        file.write(np.uint32(len(record)).astype("<u4").tobytes())
        file.write(record.tobytes())
