"""Point clouds as E57 (ASTM E2807), by pye57: points about the scanner, its pose, and a panorama.

Points are single precision about the scanner (0.03 mm at 500 m), the pose double precision on the map. The
panorama is spherical by the standard (section 8.4.10): azimuth falls from left to right with local
+X in the middle, elevation from top to bottom; grey is the level of the strongest return, 40 dB from black
to white. The writer draws identifiers anew: equal clouds are not equal files.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..base.vectors import azimuth_of, elevation_of
from ..spec import SpecError
from .atomic import replacing
from .foreign import library
from .raster_file import write_png

WIDE, HIGH = 1440, 720
SHOWN_DB = 40.0


def write_e57(
    path: Path, points: np.ndarray, amplitude: np.ndarray, place: list[float], seen: bool
) -> None:
    """Write points (P, 3) about a scanner, metres, that stands at a place (3,) on the map; amplitude (P,).

    seen : whether all were seen from there, so that a picture can be made.

    Raises
    ------
    SpecError : pye57 is not installed; there are no points.
    OSError : it cannot be written.
    """
    pye57 = library(path, "files", "pye57", ", or save as .laz")
    if not len(points):
        raise SpecError(path.name, "has no points, and E57 cannot be empty; use .laz")
    x, y, z = points.astype(np.float32).T
    data = {
        "cartesianX": x,
        "cartesianY": y,
        "cartesianZ": z,
        "cartesianInvalidState": np.zeros(
            len(x), dtype=np.int8
        ),  # all are where they were measured
        "intensity": amplitude.astype(np.float32),
    }
    still = np.array([1.0, 0.0, 0.0, 0.0])
    with replacing(path) as partial:
        file = pye57.E57(os.fspath(partial), mode="w")
        file.write_scan_raw(data, name=path.stem, rotation=still, translation=np.array(place))
        if seen:
            picture = write_png(np.repeat(panorama(points, amplitude)[:, :, None], 3, axis=2))
            _add_panorama(pye57.libe57, file.image_file, path.stem, picture, place)
        file.close()


def panorama(points: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
    """(``HIGH``, ``WIDE``) grey of 0 to 1 of points (P, 3) about the scanner; 0 where there is none."""
    level = 10 * np.log10(np.maximum(amplitude, 1e-30))
    grey = np.clip(1 + (level - level.max()) / SHOWN_DB, 0.01, 1.0)
    azimuth = azimuth_of(points)
    elevation = elevation_of(points)
    column = np.floor(WIDE / 2 - azimuth * WIDE / (2 * np.pi)).astype(int) % WIDE
    row = np.clip(np.floor(HIGH / 2 - elevation * HIGH / np.pi).astype(int), 0, HIGH - 1)
    image = np.zeros((HIGH, WIDE))
    np.maximum.at(image, (row, column), grey)
    return image


def _add_panorama(lib, file, name: str, picture: bytes, place: list[float]) -> None:  # type: ignore[no-untyped-def]
    """Append the picture, a PNG, to the file's images2D."""

    def group(**members) -> object:  # type: ignore[no-untyped-def]
        node = lib.StructureNode(file)
        for name, member in members.items():
            node.set(name, lib.FloatNode(file, member) if isinstance(member, float) else member)
        return node

    blob = lib.BlobNode(file, len(picture))
    x, y, z = place
    image = group(
        guid=lib.StringNode(file, "{panorama}"),
        name=lib.StringNode(file, f"{name} panorama"),
        pose=group(rotation=group(w=1.0, x=0.0, y=0.0, z=0.0), translation=group(x=x, y=y, z=z)),
        sphericalRepresentation=group(
            pngImage=blob,
            imageHeight=lib.IntegerNode(file, HIGH),
            imageWidth=lib.IntegerNode(file, WIDE),
            pixelHeight=np.pi / HIGH,
            pixelWidth=2 * np.pi / WIDE,
        ),
    )
    file.root()["images2D"].append(image)
    blob.write(np.frombuffer(picture, dtype=np.uint8), 0, len(picture))
