"""A STAC catalogue of point clouds, and the same as a virtual point cloud (VPC), which opens as one in QGIS.

Each file is an item beside it: footprint in degrees where the coordinate system is known, bounds, points
and columns (by PDAL's names) by the point-cloud extension, and what its maker says. The date is that of the
files' own headers, so that equal clouds have equal catalogues. Readers of a VPC (QGIS, pdal_wrench) take
items of STAC 1.0.0 alone, whose coordinate system is ``proj:epsg`` or ``proj:wkt2``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from forest_addon.formats.atomic import write_whole
from forest_addon.spec import SpecError

DATE = datetime(1980, 1, 1, tzinfo=UTC)  # as in the files' headers
CATALOG = "catalog.json"
TYPES = {"f": "floating", "i": "signed"}
VIRTUAL = [
    "https://stac-extensions.github.io/pointcloud/v1.0.0/schema.json",
    "https://stac-extensions.github.io/projection/v1.1.0/schema.json",
]


def write_catalogue(folder: Path, files: Sequence[Path], crs: str, told: Mapping[str, Any]) -> None:
    """Write ``CATALOG``, an item for each of some COPC files of a folder, and one VPC of the folder's name.

    crs : of the files, such as "EPSG:32632"; empty: unknown. told : properties of every item.

    Raises
    ------
    SpecError : pystac is not installed. OSError : one cannot be written.
    """
    try:
        import pystac
    except ImportError:
        why = '"copc" writes a catalogue, which needs pystac; install forest-sensing[cloud]'
        raise SpecError("tiles.files", why) from None
    catalogue = pystac.Catalog(folder.name, f"Point clouds of {folder.name}").to_dict(False)
    features = []
    for path in files:
        item = _item(path, crs, told)
        said = dict(item["properties"])
        authority, _, number = said.pop("proj:code", "").partition(":")
        said |= {"proj:epsg": int(number)} if authority == "EPSG" and number.isdigit() else {}
        features.append(
            {**item, "stac_version": "1.0.0", "stac_extensions": VIRTUAL, "properties": said}
        )
        links = [{"rel": rel, "href": f"./{CATALOG}"} for rel in ("root", "parent")]
        _write(path.with_suffix(".json"), {**item, "links": links})
        catalogue["links"].append({"rel": "item", "href": f"./{path.stem}.json"})
    _write(folder / CATALOG, catalogue)
    _write(folder / f"{folder.name}.vpc", {"type": "FeatureCollection", "features": features})


def _write(path: Path, content: Mapping[str, Any]) -> None:
    write_whole(path, json.dumps(content, indent=1, sort_keys=True) + "\n")


def _item(path: Path, crs: str, told: Mapping[str, Any]) -> dict[str, Any]:
    """The item of a file."""
    import pystac
    from pystac.extensions.pointcloud import PointcloudExtension, Schema
    from pystac.extensions.projection import ProjectionExtension

    with laspy.open(path) as file:
        header = file.header
    low, high = header.mins.tolist(), header.maxs.tolist()
    schemas = []
    for column in header.point_format.dimensions:
        kind = TYPES.get(column.dtype.kind if column.dtype else "u", "unsigned")
        name = column.name.title().replace("_", "") if column.is_standard else column.name
        schemas.append(Schema.create(name, max(column.num_bits // 8, 1), kind))
    ring = np.array([low[:2], [high[0], low[1]], high[:2], [low[0], high[1]], low[:2]])
    native, wkt = {"type": "Polygon", "coordinates": [ring.tolist()]}, ""
    if crs:
        from pyproj import CRS, Transformer

        turned, wkt = Transformer.from_crs(crs, "EPSG:4326", always_xy=True), CRS(crs).to_wkt()
        ring = np.column_stack(turned.transform(*ring.T))
    box = [*ring.min(axis=0).tolist(), low[2], *ring.max(axis=0).tolist(), high[2]]
    footprint = {"type": "Polygon", "coordinates": [ring.tolist()]}
    item = pystac.Item(path.name.partition(".")[0], footprint, box, DATE, dict(told))
    media = "application/vnd.laszip+copc"
    item.add_asset("data", pystac.Asset(f"./{path.name}", media_type=media, roles=["data"]))
    cloud = PointcloudExtension.ext(item, add_if_missing=True)
    cloud.apply(header.point_count, "lidar", "copc", schemas)
    projection = ProjectionExtension.ext(item, add_if_missing=True)
    projection.apply(code=crs or None, wkt2=wkt, bbox=[*low, *high], geometry=native)
    return dict(item.to_dict(include_self_link=False, transform_hrefs=False))
