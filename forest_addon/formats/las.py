"""Point clouds as LAS 1.4 or LAZ, by laspy: point format 6, labels and truth as extra bytes; with waveforms
4, 9 or 10.

Coordinates are stored as whole numbers of 0.1 mm from an offset, so that a point is exact to 0.05 mm
anywhere (1 mm for clouds wider than 200 km). The intensity is a level in steps of 0.002 dB over -100 dB,
the same scale for every scan; the extra bytes ``amplitude`` hold it as it is. Labels are ``tree``,
``species``, ``organ`` (0 other, 1 wood, 2 leaf, 3 ground, 4 dead wood), ``leaf`` and ``object``, or -1.
"""

from __future__ import annotations

import os
import struct
import tempfile
from datetime import date
from pathlib import Path

import laspy
import lazrs
import numpy as np
from laspy.point.dims import WAVEFORM_FIELDS_NAMES
from laspy.vlrs.known import GeoDoubleParamsVlr, GeoKeyDirectoryVlr, WktCoordinateSystemVlr

from ..base.labels import Labels
from ..base.rows import distinct
from ..base.trimesh import DEAD, GROUND, LEAF, WOOD
from ..spec import SpecError
from .atomic import replacing
from .copc import write_copc
from .crs import UNIT_SIZE, can_tell_crs, system_of, wkt_of
from .foreign import PACKED, guarded
from .ply import StoredRows, bounds

RESOLUTION = 1e-4  # metres
REACH = 2**31  # steps to each side of the offset
ROWS_AT_ONCE = 50_000  # a chunk of LAZ
FILLED_AT_ONCE = 5_000  # what stays in the cache while its fields are copied
OWN_CLASSES, CLASSES = 64, 192  # the first class that is the user's, and how many there are
CLASS_OF_ORGAN = np.ones(128, dtype=np.uint8)  # ASPRS: unclassified, high vegetation, ground
CLASS_OF_ORGAN[[WOOD, LEAF, GROUND, DEAD]] = 5, 5, 2, 5
COLOUR_OF_ORGAN = np.full((128, 3), 0x8080, dtype=np.uint16)  # red, green, blue
COLOUR_OF_ORGAN[[WOOD, LEAF, GROUND, DEAD]] = 257 * np.array(
    [[121, 85, 61], [88, 142, 60], [168, 146, 110], [140, 132, 124]]
)
LEGACY, COLOURED = 4, 10  # point formats of rows with waveforms, beside 9
COPC = ".copc.laz"
NOISE = (7, 18)  # classes of ASPRS
LAYERED = 3  # the compressor of LAZ whose chunks are layers
LAYERS, BYTES = {10: 9, 12: 2}, 14  # of its items by their kind, else one; of extra bytes one each
MOST_OF_CHUNK = 1_000_000  # points that a small file may count in a chunk
EXTRA = {
    "tree": "number of the tree",
    "species": "number of the species",
    "organ": "0 other wood leaf ground 4 dead",
    "leaf": "number of the leaf",
    "object": "number of the instance",
    "amplitude": "1: white, facing, 1 m away",
    "width": "of the echo, sd, ns",
    "range": "as measured, m",
    "true_range": "without noise, m",
    "nx": "normal of the surface",
    "ny": "normal of the surface",
    "nz": "normal of the surface",
    "incidence": "beam to normal, degrees",
}
PACKET_LENGTH = 16  # samples, whole multiples of which a waveform is long
PACKETS_HEAD = 60  # bytes of a file of waveforms before them
WAVES_VLR = 99  # the record of descriptor 1 is one more
BOUNCE = {"bounce": "0 direct 1 ghost 2 glass 3 water"}  # of rows that have it


def write_las(
    path: str | os.PathLike[str],
    rows: np.ndarray | StoredRows,
    written: date | None = None,
    labels: Labels | None = None,
    crs: str = "",
    packets: tuple[Path, float, float, float, int] | None = None,
) -> None:
    """Write rows (P,) of ``points.POINT``, also of a file; a name ending in .laz is compressed.

    written : creation date in the header, 1 January 1980 unless given, so that equal clouds are equal
        files.
    labels : what points are classed by instead of by organ, from class 64 on, which LAS leaves to users;
        the header names the classes. What comes after the 192 most frequent is class 1.
    crs : coordinate system that the header tells as WKT, such as "EPSG:32632".
    packets : file of the waveforms that rows name, ps from sample to sample, gain and offset of its counts,
        and the points' format: 4 (of LAS 1.3: whole degrees, 7 returns), 9, or 10 with colours of
        ``COLOUR_OF_ORGAN`` and the intensity as near infrared.

    Raises
    ------
    SpecError : waveforms in a COPC, which holds none; labels in point format 4, which has no classes for
        them; PROJ does not know the coordinate system.
    OSError : it cannot be written.
    """
    if str(path).lower().endswith(COPC):
        if packets is not None:
            raise SpecError(str(path), "holds no waveforms; end its name in .laz or .las")
        with tempfile.TemporaryDirectory() as folder:
            plain = os.path.join(folder, "plain.laz")
            write_las(plain, rows, written, labels, crs)
            write_copc(path, plain)
        return
    point_format = 6 if packets is None else packets[4]
    if point_format == LEGACY and labels is not None:
        raise SpecError(str(path), f"has no classes for labels in point format {LEGACY}; take 9")
    header = _header(rows, written, point_format)
    if packets is not None:
        header.global_encoding.waveform_data_packets_external = True
        lengths = rows["wave_samples"][:]
        for length in distinct(lengths[lengths > 0]).tolist():
            body = struct.pack("<BBIIdd", 16, 0, length, round(packets[1]), *packets[2:4])
            number = WAVES_VLR + length // PACKET_LENGTH
            header.vlrs.append(laspy.VLR("LASF_Spec", number, "Waveform", body))
    wkt = wkt_of(crs)
    if wkt:
        header.vlrs.append(WktCoordinateSystemVlr(wkt))
    own = None if labels is None else _classes(labels)
    if labels is not None:
        # names of classes: 256 times a number and 15 letters (LAS 1.4, table 29)
        letters = [name.encode("ascii", "replace")[:15] for name in labels.names[:CLASSES]]
        body = b"".join(
            struct.pack("<B15s", OWN_CLASSES + k, name) for k, name in enumerate(letters)
        )
        body = body.ljust(256 * 16, b"\0")
        header.vlrs.append(laspy.VLR("LASF_Spec", 0, "Classification Lookup", body))
    try:
        with replacing(path) as partial, laspy.open(str(partial), mode="w", header=header) as file:
            for first in range(0, len(rows), ROWS_AT_ONCE):
                some = slice(first, first + ROWS_AT_ONCE)
                part = rows[some]
                classes = CLASS_OF_ORGAN[part["organ"]] if own is None else own[some]
                file.write_points(_las_points(part, classes, header))
    except lazrs.LazrsError as problem:  # what its compressor makes of a full disk
        name = os.path.basename(path)
        raise OSError(f"{name} could not be written ({problem}); is the disk full?") from None


@guarded("a LAS or LAZ file")
def read_las(path: Path, crs: str = "") -> laspy.LasData:
    """Read a LAS or LAZ file of any origin; coordinates in feet become metres, as its system says, and points
    that are withheld or noise are left out.

    crs : its coordinate system, if it names none.

    Raises
    ------
    SpecError : there is none, it cannot be read as one, has no points, or lies in degrees.
    """
    with laspy.open(path) as file:
        _refuse_chunks(path, file.header)
        cloud = file.read()
    steps = np.array([cloud.header.scales, cloud.header.offsets])
    if not (
        np.isfinite(steps).all() and 0 < np.abs(steps[0]).min() <= np.abs(steps[0]).max() < 1e3
    ):
        raise SpecError(str(path), f"is broken: its scales are {steps[0]}, its offsets {steps[1]}")
    cloud.points = cloud.points[
        (np.asarray(cloud.withheld) == 0) & ~np.isin(cloud.classification, NOISE)
    ]
    if not len(cloud.points):
        raise SpecError(str(path), "has no points, or none but noise; export it again")
    _, flat, up = units_of(path, cloud.header, crs)
    for part in (cloud.header, cloud.points):
        part.scales = part.scales * [flat, flat, up]
        part.offsets = part.offsets * [flat, flat, up]
    cloud.update_header()
    return cloud


def _refuse_chunks(path: Path, header: laspy.LasHeader) -> None:
    """Refuse chunks of a LAZ, and layers in them, that count more than the file holds: the reader believes
    them, and makes room.

    Raises
    ------
    SpecError : says what they count, and what the file holds.
    """
    told = header.vlrs.get("LasZipVlr")
    if not told or not header.point_count:
        return
    record, size, packed = (
        told[0].record_data,
        path.stat().st_size,
        lazrs.LazVlr(told[0].record_data),
    )
    items = struct.iter_unpack("<3H", record[34 : 34 + 6 * record[32]])
    layers = sum(wide if kind == BYTES else LAYERS.get(kind, 1) for kind, wide, _ in items)
    before = packed.item_size() + 4 + 4 * layers  # the first point, and the counts
    counted = []
    with open(path, "rb") as file:
        file.seek(header.offset_to_point_data)
        for points, length in lazrs.read_chunk_table(file, packed):
            begin = file.tell()
            counted += [(length, size - begin)]
            counted += [(points, max(MOST_OF_CHUNK, PACKED * size // packed.item_size()))]
            if length > size - begin:
                break
            if record[0] == LAYERED:
                file.seek(begin + before - 4 * layers)
                sizes = np.frombuffer(file.read(4 * layers), "<u4")
                counted += [(int(sizes.sum()), length - before)]
            file.seek(begin + length)
    for claimed, room in counted:
        if claimed > room:
            raise SpecError(
                str(path),
                f"is broken: a chunk counts {claimed:,} points or bytes, it has room for {room:,}; copy or "
                "export it again",
            )


def units_of(path: Path, header: laspy.LasHeader, crs: str = "") -> tuple[str, float, float]:
    """Coordinate system of a file, and metres of its units on the map and in height."""
    stored = header.vlrs.get_by_id("LASF_Projection")
    sizes = [
        size.value for one in stored if isinstance(one, GeoDoubleParamsVlr) for size in one.doubles
    ]
    keys = {
        key.id: sizes[key.value_offset] if key.id == UNIT_SIZE else int(key.value_offset)
        for record in stored
        if isinstance(record, GeoKeyDirectoryVlr)
        for key in record.geo_keys
    }
    texts = [record.string for record in stored if isinstance(record, WktCoordinateSystemVlr)]
    if not can_tell_crs() and any("foot" in text.lower() for text in texts):
        raise SpecError(str(path), "counts in feet, which needs pyproj; install it")
    return system_of(path, next((text for text in texts if text.strip("\0 ")), ""), keys, crs)


def _classes(labels: Labels) -> np.ndarray:
    """(P,) uint8 classes of points."""
    known = (labels.number >= 0) & (labels.number < CLASSES)
    return np.where(known, OWN_CLASSES + labels.number, 1).astype(np.uint8)


def intensity_level(amplitude: np.ndarray) -> np.ndarray:
    """(P,) uint16 level of an amplitude: 0.002 dB a step, 0 at -100 dB re a white surface at 1 m."""
    with np.errstate(divide="ignore"):
        level = 10 * np.log10(np.asarray(amplitude, dtype=np.float64))
    return np.rint(np.clip((level + 100) * 500, 0, 65535)).astype(np.uint16)


def _header(
    rows: np.ndarray | StoredRows, written: date | None, point_format: int
) -> laspy.LasHeader:
    header = laspy.LasHeader(version="1.4", point_format=point_format)
    low, high = bounds(rows)
    wide = float((high - low).max(initial=0.0)) > RESOLUTION * REACH * 0.9
    header.scales = np.full(3, 10 * RESOLUTION if wide else RESOLUTION)
    header.offsets = np.floor(low)
    header.global_encoding.wkt = (
        True  # as the standard wants of point formats from 6 on, with or without one
    )
    header.creation_date = written or date(1980, 1, 1)
    header.generating_software = "Forest Sensing"
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams(name, rows.dtype[name], description)
            for name, description in _extra(rows).items()
        ]
    )
    return header


def _extra(rows: np.ndarray | StoredRows) -> dict[str, str]:
    """Extra bytes of rows, with what they say."""
    return EXTRA | BOUNCE if "bounce" in (rows.dtype.names or ()) else EXTRA


def _las_points(
    rows: np.ndarray, classes: np.ndarray, header: laspy.LasHeader
) -> laspy.ScaleAwarePointRecord:
    points = laspy.ScaleAwarePointRecord.zeros(len(rows), header=header)
    for first in range(0, len(rows), FILLED_AT_ONCE):
        some = slice(first, first + FILLED_AT_ONCE)
        _fill(points.array[some], rows[some], classes[some], header)
    return points


def _fill(raw: np.ndarray, rows: np.ndarray, classes: np.ndarray, header: laspy.LasHeader) -> None:
    for axis, name in enumerate("xyz"):
        steps = (rows[name] - header.offsets[axis]) / header.scales[axis]
        raw[name.upper()] = np.rint(steps)
    raw["intensity"] = intensity_level(rows["amplitude"])
    legacy = header.point_format.id == LEGACY
    raw["bit_fields"] = rows["return_number"] | (rows["number_of_returns"] << (3 if legacy else 4))
    raw["raw_classification" if legacy else "classification"] = classes
    if legacy:
        raw["scan_angle_rank"] = np.rint(rows["scan_angle"])
    else:
        raw["scan_angle"] = np.rint(rows["scan_angle"] / 0.006)
    if header.point_format.id == COLOURED:
        for channel, name in enumerate(("red", "green", "blue")):
            raw[name] = COLOUR_OF_ORGAN[rows["organ"], channel]
        raw["nir"] = raw["intensity"]
    raw["gps_time"] = rows["time"]
    for name in _extra(rows):
        raw[name] = rows[name]
    if "wave_samples" in (rows.dtype.names or ()):
        raw["wavepacket_index"] = rows["wave_samples"] // PACKET_LENGTH
        raw["wavepacket_size"] = 2 * rows["wave_samples"]
        raw["wavepacket_offset"] = PACKETS_HEAD + 2 * rows["wave_start"]
        for name in WAVEFORM_FIELDS_NAMES[3:]:
            raw[name] = rows[name]
