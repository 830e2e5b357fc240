"""Point clouds as LAS 1.4 or LAZ, by laspy: point format 6 with labels as extra bytes.

Coordinates are stored as whole numbers of 0.1 mm from an offset, so that a point is exact to 0.05 mm
anywhere. Extra bytes: ``tree``, ``species``, ``organ`` (0 other, 1 wood, 2 leaf, 3 ground), ``leaf`` and
``object``; -1 where there is none.
"""

from __future__ import annotations

import os
from datetime import date

import laspy
import numpy as np

from ..growth.trimesh import GROUND, LEAF, WOOD
from ..sensing.cloud import Cloud
from .atomic import replacing

RESOLUTION = 1e-4  # metres
CLASS_OF_ORGAN = {WOOD: 5, LEAF: 5, GROUND: 2}  # ASPRS: high vegetation, ground; else 1
EXTRA = {
    "tree": np.int32,
    "species": np.int16,
    "organ": np.int8,
    "leaf": np.int32,
    "object": np.int32,
}


def write_las(path: str | os.PathLike[str], cloud: Cloud, written: date | None = None) -> None:
    """Write a cloud; a name ending in .laz is compressed.

    written : creation date in the header, 1 January 1980 unless given, so that equal clouds are equal
        files.
    """
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, RESOLUTION)
    header.offsets = np.floor(cloud.position.min(axis=0)) if len(cloud.position) else np.zeros(3)
    header.creation_date = written or date(1980, 1, 1)
    header.generating_software = "Forest Sensing"
    header.add_extra_dims([laspy.ExtraBytesParams(n, np.dtype(t)) for n, t in EXTRA.items()])
    las = laspy.LasData(header)
    las.xyz = cloud.position
    las.return_number = np.ones(len(cloud.pulse), dtype=np.uint8)
    las.number_of_returns = np.ones(len(cloud.pulse), dtype=np.uint8)
    las.scan_angle = np.rint(np.rad2deg(cloud.elevation) / 0.006).astype(np.int16)
    las.intensity = scaled_intensity(cloud.intensity)
    las.classification = np.array([CLASS_OF_ORGAN.get(p, 1) for p in range(128)], dtype=np.uint8)[
        cloud.returns.organ
    ]
    las.tree = cloud.returns.tree.astype(np.int32)
    las.species = cloud.returns.species.astype(np.int16)
    las.organ = cloud.returns.organ
    las.leaf = cloud.returns.leaf
    las.object = cloud.returns.instance.astype(np.int32)
    with replacing(path) as partial:
        las.write(str(partial))


def scaled_intensity(intensity: np.ndarray) -> np.ndarray:
    """(P,) uint16: the intensity relative to the strongest return of the cloud."""
    strongest = float(intensity.max(initial=0.0)) or 1.0
    return np.rint(intensity / strongest * 65535).astype(np.uint16)
