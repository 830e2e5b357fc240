"""The record of a return: one row of every point file, 97 bytes, whatever the format; 98 with bounces.

Positions are moved by the scene's offset in float64 here, so that a map's coordinates keep their digits.
Angles of records are degrees, widths nanoseconds, as in LAS files of instruments; lengths metres.
"""

from __future__ import annotations

import numpy as np

from ..sensing.lidar.cloud import Cloud

POINT = np.dtype(
    [
        *((axis, "<f8") for axis in "xyz"),
        ("time", "<f8"),  # seconds
        ("range", "<f8"),  # as measured
        ("true_range", "<f8"),  # without noise
        ("amplitude", "<f4"),  # energy that came back; 1: a white surface that faces at 1 m
        ("width", "<f4"),  # of the echo, standard deviation, ns
        ("nx", "<f4"),  # normal of the surface
        ("ny", "<f4"),
        ("nz", "<f4"),
        ("incidence", "<f4"),  # degrees between beam and normal
        ("scan_angle", "<f4"),  # degrees
        ("pulse", "<u4"),
        ("tree", "<i4"),  # labels: -1 where there is none
        ("leaf", "<i4"),
        ("object", "<i4"),
        ("species", "<i2"),
        ("organ", "i1"),  # 0 other, 1 wood, 2 leaf, 3 ground, 4 dead wood
        ("return_number", "u1"),
        ("number_of_returns", "u1"),
    ]
)
BOUNCED = np.dtype([*POINT.descr, ("bounce", "u1")])  # 0 direct, 1 ghost, 2 glass, 3 refracted
ROWS_AT_ONCE = 5_000  # what stays in the cache while its fields are copied
UNITS = {
    **dict.fromkeys(("x", "y", "z", "range", "true_range"), "m"),
    "time": "s",
    "amplitude": "1/m2",
    "width": "ns",
    "incidence": "deg",
    "scan_angle": "deg",
}


def records(cloud: Cloud, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(P,) array of ``POINT``, of a scanner that follows bounces of ``BOUNCED``; ``offset`` metres are added
    to positions."""
    rows = np.empty(len(cloud), dtype=POINT if cloud.bounce is None else BOUNCED)
    for first in range(0, len(cloud), ROWS_AT_ONCE):
        _fill(rows, cloud, slice(first, first + ROWS_AT_ONCE), offset)
    return rows


def _fill(rows: np.ndarray, cloud: Cloud, some: slice, offset: tuple[float, float, float]) -> None:
    """Write some of the rows."""
    part, returns = rows[some], cloud.returns
    for axis, name in enumerate("xyz"):
        part[name] = cloud.position[some, axis] + offset[axis]
    for axis, name in enumerate(("nx", "ny", "nz")):
        part[name] = returns.normal[some, axis]
    part["time"], part["pulse"] = cloud.time[some], cloud.pulse[some]
    part["range"], part["true_range"] = returns.distance[some], cloud.true_range[some]
    part["amplitude"], part["width"] = cloud.intensity[some], cloud.width[some] * 1e9
    part["incidence"] = np.rad2deg(np.arccos(np.minimum(returns.cos_incidence[some], 1.0)))
    part["scan_angle"] = np.rad2deg(cloud.scan_angle[some])
    part["return_number"], part["number_of_returns"] = cloud.number[some], cloud.count[some]
    for name in ("tree", "leaf", "species", "organ"):
        part[name] = getattr(returns, name)[some]
    part["object"] = returns.instance[some]
    if cloud.bounce is not None:
        part["bounce"] = cloud.bounce[some]
