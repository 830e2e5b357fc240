"""The record of a return: one row of every point file, 97 bytes, whatever the format.

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
        ("organ", "i1"),  # 0 other, 1 wood, 2 leaf, 3 ground
        ("return_number", "u1"),
        ("number_of_returns", "u1"),
    ]
)
UNITS = {
    **dict.fromkeys(("x", "y", "z", "range", "true_range"), "m"),
    "time": "s",
    "amplitude": "1/m2",
    "width": "ns",
    "incidence": "deg",
    "scan_angle": "deg",
}


def records(cloud: Cloud, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(P,) array of ``POINT``; ``offset`` metres are added to positions."""
    rows = np.empty(len(cloud), dtype=POINT)
    for axis, name in enumerate("xyz"):
        rows[name] = cloud.position[:, axis] + offset[axis]
    for axis, name in enumerate(("nx", "ny", "nz")):
        rows[name] = cloud.returns.normal[:, axis]
    rows["time"], rows["pulse"] = cloud.time, cloud.pulse
    rows["range"], rows["true_range"] = cloud.returns.distance, cloud.true_range
    rows["amplitude"], rows["width"] = cloud.intensity, cloud.width * 1e9
    rows["incidence"] = np.rad2deg(np.arccos(np.minimum(cloud.returns.cos_incidence, 1.0)))
    rows["scan_angle"] = np.rad2deg(cloud.scan_angle)
    rows["return_number"], rows["number_of_returns"] = cloud.number, cloud.count
    for name in ("tree", "leaf", "species", "organ"):
        rows[name] = getattr(cloud.returns, name)
    rows["object"] = cloud.returns.instance
    return rows
