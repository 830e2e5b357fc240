"""A stand as CSV or GeoJSON, one tree a row or feature.

The scene's offset is added in float64, so coordinates are those of the map; of a CSV a note beside it says
so, because programs take a first line for the header. GeoJSON by RFC 7946 knows longitude and latitude
alone; these are metres, which the file says in words and, where the coordinate system is named, in the older
``crs`` member that GIS programs still read.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from typing import TextIO

import numpy as np

from ..formats.atomic import replacing
from ..formats.table import quoted
from ..stand.plan import Stand
from .coordinates import note_of

COLUMNS = ("id", "species", "x", "y", "z", "scale", "rotation", "variant")
CHUNK = 50_000  # trees that are text at once


def write_stand(
    path: str | os.PathLike[str],
    stand: Stand,
    labels: Sequence[str],
    offset: Sequence[float] = (0.0, 0.0, 0.0),
    crs: str = "",
) -> None:
    """Write GeoJSON where the name ends so, else CSV; numbers keep every digit.

    labels : a name for every planting. offset : (3,) metres, added to positions. crs : "EPSG:32632".
    """
    geojson = str(path).lower().endswith((".geojson", ".json"))
    with replacing(path) as partial, open(partial, "w", newline="", encoding="utf-8") as file:
        (_write_geojson if geojson else _write_csv)(file, stand, labels, offset, crs)


def _write_csv(
    file: TextIO, stand: Stand, labels: Sequence[str], offset: Sequence[float], _crs: str
) -> None:
    file.write(",".join(COLUMNS) + "\n")
    names = [_quoted(label) for label in labels]
    for rows in _rows(stand, offset):
        file.writelines(
            f"{i},{names[s]},{x!r},{y!r},{z!r},{size!r},{turn!r},{variant}\n"
            for i, s, x, y, z, size, turn, variant in rows
        )


def _write_geojson(
    file: TextIO, stand: Stand, labels: Sequence[str], offset: Sequence[float], crs: str
) -> None:
    head: dict[str, object] = {"type": "FeatureCollection"}
    if crs:
        authority, _, code = crs.rpartition(":")
        name = f"urn:ogc:def:crs:{authority}::{code}" if authority and code.isdigit() else crs
        head["crs"] = {"type": "name", "properties": {"name": name}}
    note = note_of(offset, crs) or "coordinates are metres of the scene"
    head["note"] = f"{note}; not longitude and latitude"
    file.write(json.dumps(head, ensure_ascii=False)[:-1] + ', "features": [')
    names = [json.dumps(label, ensure_ascii=False) for label in labels]
    separator = "\n"
    for rows in _rows(stand, offset):
        file.write(separator)
        file.write(
            ",\n".join(
                f'{{"type": "Feature", "id": {i}, "geometry": {{"type": "Point", "coordinates": '
                f'[{x!r}, {y!r}, {z!r}]}}, "properties": {{"species": {names[s]}, "scale": {size!r}, '
                f'"rotation": {turn!r}, "variant": {variant}}}}}'
                for i, s, x, y, z, size, turn, variant in rows
            )
        )
        separator = ",\n"
    file.write("\n]}\n")


def _rows(stand: Stand, offset: Sequence[float]) -> Iterator[Iterator[tuple]]:
    """Rows of numbers as Python's own, a chunk of trees at a time."""
    for start in range(0, len(stand), CHUNK):
        part = slice(start, start + CHUNK)
        place = stand.position[part] + np.asarray(offset, dtype=np.float64)
        columns = (stand.id, stand.species, stand.scale, stand.rotation, stand.variant)
        i, s, size, turn, variant = (column[part].tolist() for column in columns)
        yield zip(i, s, *place.T.tolist(), size, turn, variant, strict=True)


def _quoted(label: str) -> str:
    label = quoted(label)
    if any(c in label for c in ',"\n\r'):
        return '"' + label.replace('"', '""') + '"'
    return label
