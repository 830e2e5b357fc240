"""Tables of trees: a stand as CSV or GeoJSON, a tree a row or feature; branches as cylinders.

The scene's offset is added in float64, so coordinates are those of the map; of a CSV a note beside it says
so, because programs take a first line for the header. GeoJSON by RFC 7946 knows longitude and latitude
alone; these are metres, which the file says in words and, where the coordinate system is named, in the older
``crs`` member that GIS programs still read.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.atomic import replacing
from ..formats.qsm import write_treeqsm
from ..formats.table import write_csv, write_numbers
from ..stand.plan import Stand
from .coordinates import NO_OFFSET, note_of, on_the_map

COLUMNS = ("id", "species", "x", "y", "z", "scale", "rotation", "variant")
CHUNK = 50_000  # trees that are text at once
DECIMALS = (
    dict.fromkeys(("startX", "startY", "startZ", "endX", "endY", "endZ", "length"), 5)
    | dict.fromkeys(("radius_cyl", "radius_start", "radius_end"), 6)
    | {"volume": 12}
)


def write_stand(
    path: str | os.PathLike[str],
    stand: Stand,
    labels: Sequence[str],
    offset: Sequence[float] = NO_OFFSET,
    crs: str = "",
) -> None:
    """Write GeoJSON where the name ends so, else CSV; numbers keep every digit.

    labels : a name for every planting. offset : (3,) metres, added to positions. crs : "EPSG:32632".
    """
    parts = _parts(stand, labels, offset)
    if str(path).lower().endswith((".geojson", ".json")):
        head: dict[str, object] = {"type": "FeatureCollection"}
        if crs:
            authority, _, code = crs.rpartition(":")
            name = f"urn:ogc:def:crs:{authority}::{code}" if authority and code.isdigit() else crs
            head["crs"] = {"type": "name", "properties": {"name": name}}
        note = note_of(offset, crs) or "coordinates are metres of the scene"
        head["note"] = f"{note}; not longitude and latitude"
        with replacing(path) as partial, open(partial, "w", encoding="utf-8", newline="") as file:
            file.write(json.dumps(head, ensure_ascii=False)[:-1] + ', "features": [')
            separator = "\n"
            for part in parts:
                for number, species, *place, size, turn, variant in zip(
                    *part.values(), strict=True
                ):
                    told = {"species": species, "scale": size, "rotation": turn, "variant": variant}
                    feature = {
                        "type": "Feature",
                        "id": number,
                        "geometry": {"type": "Point", "coordinates": place},
                        "properties": told,
                    }
                    file.write(separator + json.dumps(feature, ensure_ascii=False))
                    separator = ",\n"
            file.write("\n]}\n")
    else:
        write_csv(path, parts)


def _parts(
    stand: Stand, labels: Sequence[str], offset: Sequence[float]
) -> Iterator[dict[str, list[Any]]]:
    """The columns of a chunk of trees at a time, as Python's own numbers; of one at least."""
    for start in range(0, max(len(stand), 1), CHUNK):
        part = slice(start, start + CHUNK)
        place = stand.position[part] + np.asarray(offset, dtype=np.float64)
        yield {
            "id": stand.id[part].tolist(),
            "species": [labels[number] for number in stand.species[part].tolist()],
            **dict(zip("xyz", place.T.tolist(), strict=True)),
            **{name: getattr(stand, name)[part].tolist() for name in COLUMNS[5:]},
        }


def write_cylinders(
    path: Path, table: Mapping[str, np.ndarray], offset: Sequence[float] = NO_OFFSET
) -> None:
    """Write a table of cylinders (``stand.forest.cylinder_table``) as CSV. offset : metres, added to places.

    Raises
    ------
    OSError : it cannot be written.
    """
    write_numbers(path, on_the_map(table, offset), DECIMALS)


def write_models(
    folder: Path, table: Mapping[str, np.ndarray], offset: Sequence[float] = NO_OFFSET
) -> Iterator[Path]:
    """Write the cylinders of each tree as a file of TreeQSM into a folder; give each path.

    Raises
    ------
    OSError : one cannot be written.
    """
    rows = on_the_map(table, offset)
    folder.mkdir(exist_ok=True)
    trees, first = np.unique(rows["tree"], return_index=True)
    ends = [*first[1:], len(rows["tree"])]
    for tree, begin, end in zip(trees.tolist(), first, ends, strict=True):
        path = folder / f"tree-{tree:05d}.mat"
        write_treeqsm(path, {name: column[begin:end] for name, column in rows.items()})
        yield path
