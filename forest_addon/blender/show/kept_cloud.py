"""Points of a scan that a file keeps, read back as the cloud that they were.

The mesh that shows a cloud (``cloud``) has its values as attributes of single precision. What is needed to
write files of it is noted beside: directions of the beams, labels with their names, the offset, and what
rounding took of those values that files have in double precision. There is no other copy of a cloud: what is
shown is what is exported.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ...base.labels import Labels
from ...sensing.lidar.cloud import Cloud
from ...sensing.lidar.returns import Returns
from .cloud import fill

SCAN_KEY = "forest_scan"  # of a mesh: pulses, engine, offset, names of labels, as JSON
EXACT = ("position", "distance", "true_range", "time", "azimuth", "elevation")  # doubles in files
NEEDED = ("position", "surface_normal", "distance", "intensity", "organ", "pulse")


def note_scan(
    data: bpy.types.Mesh,
    cloud: Cloud,
    offset: Sequence[float],
    crs: str,
    labels: Mapping[str, Labels],
) -> None:
    """Note on a mesh of points what ``kept_scan`` needs.

    offset, crs : of the scene. labels : of the points, by what labels them.
    """
    fill(data, "azimuth", "FLOAT", cloud.azimuth)
    fill(data, "elevation", "FLOAT", cloud.elevation)
    for name in EXACT:
        values = cloud.returns.distance if name == "distance" else getattr(cloud, name)
        kind, key = ("FLOAT_VECTOR", "vector") if values.ndim == 2 else ("FLOAT", "value")
        fill(data, _rounding(name), kind, values - values.astype(np.float32), key)
    for name, label in labels.items():
        fill(data, _attribute(name), "INT", label.number)
    said = {
        "pulses": cloud.pulses,
        "engine": cloud.engine,
        "offset": list(offset),
        "crs": crs,
        "labels": {name: list(label.names) for name, label in labels.items()},
    }
    data[SCAN_KEY] = json.dumps(said, ensure_ascii=False)


@dataclass(frozen=True)
class KeptScan:
    """A scan that a file keeps: its cloud, the scene's offset (m) and coordinate system, labels by what they
    are of."""

    cloud: Cloud
    offset: tuple[float, ...]
    crs: str
    labels: dict[str, Labels]


def is_scan(data: bpy.types.Mesh) -> bool:
    """Return whether a mesh of points is a scan that can be read back."""
    return all(name in data.attributes for name in NEEDED)


def kept_scan(data: bpy.types.Mesh) -> KeptScan:
    """The scan of a mesh of points.

    Points that were deleted by hand are gone here, too; those of files before 1.0.1 are of single precision.
    """
    said = json.loads(data.get(SCAN_KEY, "{}"))
    number = {name: _read(data, name, "INT") for name in ("tree", "species", "organ", "leaf")}
    returns = Returns(
        distance=_read(data, "distance", "FLOAT"),
        normal=_read(data, "surface_normal", "FLOAT_VECTOR"),
        cos_incidence=np.cos(_read(data, "incidence", "FLOAT")),
        organ=number["organ"].astype(np.int8),
        leaf=number["leaf"],
        tree=number["tree"],
        species=number["species"],
        instance=_read(data, "object", "INT"),
        triangle=np.full(len(data.vertices), -1, np.int32),
    )
    pulse = _read(data, "pulse", "INT")
    cloud = Cloud(
        position=_read(data, "position", "FLOAT_VECTOR"),
        pulse=pulse,
        number=_read(data, "return_number", "INT").astype(np.uint8),
        count=_read(data, "number_of_returns", "INT").astype(np.uint8),
        returns=returns,
        pulses=int(said.get("pulses", pulse.max(initial=-1) + 1)),
        engine=str(said.get("engine", "")),
        bounce=_read(data, "bounce", "INT").astype(np.int8)
        if "bounce" in data.attributes
        else None,
        **{
            name: _read(data, name, "FLOAT")
            for name in (
                *("time", "azimuth", "elevation", "scan_angle"),
                *("intensity", "width", "true_range"),
            )
        },
    )
    names = {
        n: words for n, words in said.get("labels", {}).items() if _attribute(n) in data.attributes
    }
    labels = {n: Labels(_read(data, _attribute(n), "INT"), tuple(w)) for n, w in names.items()}
    return KeptScan(cloud, tuple(said.get("offset", (0.0, 0.0, 0.0))), said.get("crs", ""), labels)


def _rounding(name: str) -> str:
    return f"{name}_rounding"


def _attribute(label: str) -> str:
    return f"label_{label.lower()}"


def _read(data: bpy.types.Mesh, name: str, kind: str) -> np.ndarray:
    """(P,) or (P, 3) float64 or int32 of an attribute; zeros where it was removed."""
    count, wide = len(data.vertices), kind == "FLOAT_VECTOR"
    values = np.zeros(count * 3 if wide else count, np.int32 if kind == "INT" else np.float32)
    attribute = data.attributes.get(name)
    if attribute is not None and attribute.domain == "POINT" and attribute.data_type == kind:
        attribute.data.foreach_get("vector" if wide else "value", values)
    values = values if kind == "INT" else values.astype(np.float64)
    if name in EXACT:
        values += _read(data, _rounding(name), kind).ravel()
    return values.reshape(-1, 3) if wide else values
