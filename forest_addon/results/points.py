"""Returns as rows, the same of every point file, and their files in the formats that other programs read.

A row has 97 bytes, 98 with bounces, and one more field where points are labelled. Positions are moved by the
scene's offset in float64, so that a map's coordinates keep their digits. Angles of rows are degrees, widths
nanoseconds, as in LAS files of instruments; lengths metres. Rows may also be of a file (``StoredRows``);
all formats but E57 and the tables of text are then written a part at a time.

Labels of points are a number for each point, and a name for each number. By class they are organs (other,
wood, leaf, ground), which every file has; by object, species or material they are numbered from the most
frequent on, so that a format with few classes keeps the ones that matter.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ..base.labels import UNKNOWN, Labels
from ..formats.atomic import replacing
from ..formats.ply import StoredRows, bounds, write_ply
from ..formats.table import write_csv, write_npz
from ..sensing.lidar.cloud import Cloud, Returns
from ..sensing.lidar.waveform import BASELINE, LIGHT, Waveforms
from ..sensing.rays.geometry import SceneGeometry
from .coordinates import NO_OFFSET, Offset

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
BOUNCE = ("bounce", "u1")  # 0 direct, 1 ghost, 2 glass, 3 refracted
PACKET = (  # of a return's record in a file of waveforms
    (
        "wave_start",
        "<f8",
    ),  # its first sample, of all in the file from 0; whole, as PLY has no such numbers
    ("wave_samples", "<u4"),  # how many; 0: there is none
    ("return_point_wave_location", "<f4"),  # ps after the first
    *(
        (name, "<f4") for name in ("x_t", "y_t", "z_t")
    ),  # m that light goes on in a ps, there and back
)
HEAD_BYTES, SAMPLES_AT_ONCE = 60, 1 << 20  # of a file of waveforms
LONGEST = 255 * 16  # samples of a record: as many lengths as LAS can tell
FILLED_AT_ONCE = 5_000  # what stays in the cache while its fields are copied
UNITS = {
    **dict.fromkeys(("x", "y", "z", "range", "true_range"), "m"),
    "time": "s",
    "amplitude": "1/m2",
    "width": "ns",
    "incidence": "deg",
    "scan_angle": "deg",
}
COPC, DOUBLE = ".copc.laz", (".double.ply", ".double.pcd")
ENDINGS = (".laz", ".las", COPC, ".e57", ".ply", ".pcd", *DOUBLE, ".xyz", ".npz", ".csv")
FAR = 8192.0  # metres, where single precision steps by a millimetre
NEEDS = {COPC: "copclib", ".e57": "pye57", ".sofa": "sofar"}  # of the extras [files] and [sofa]
XYZ = {  # columns of such a file, and their digits
    **dict.fromkeys("xyz", "%.4f"),
    "intensity_db": "%.2f",
    **dict.fromkeys(("tree", "organ", "label"), "%d"),
}
WAVEFORMS = ".wdp"
NO_PACKETS = (".e57", ".xyz")
STILL = 1e-6  # metres that the places of a scanner on a tripod may differ by


def point_type(bounces: bool, waves: bool = False) -> np.dtype:
    """The type of rows of a scanner that follows bounces, or records waveforms."""
    more = (*((BOUNCE,) if bounces else ()), *(PACKET if waves else ()))
    return np.dtype([*POINT.descr, *more]) if more else POINT


def records(
    cloud: Cloud, offset: Sequence[float] = NO_OFFSET, before: int | None = None
) -> np.ndarray:
    """(P,) array of ``point_type``; ``offset`` metres are added to positions.

    before : samples that stand before the cloud's own in a file of waveforms; left out: rows name none.
    """
    rows = np.zeros(len(cloud), point_type(cloud.bounce is not None, before is not None))
    for first in range(0, len(cloud), FILLED_AT_ONCE):
        some = slice(first, first + FILLED_AT_ONCE)
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
    if before is not None and cloud.waves is not None:
        start = cloud.waves.starts
        length = np.diff(np.append(start, len(cloud.waves.pulse)))
        step = np.floor(cloud.true_range / cloud.waves.step).astype(np.int64)
        order = (cloud.waves.pulse[start] << 40) + cloud.waves.index[start]
        row = np.searchsorted(order, (cloud.pulse << 40) + step, side="right") - 1
        first = start[np.maximum(row, 0)] if len(start) else row
        known = np.flatnonzero(row >= 0)
        inside = cloud.waves.pulse[first[known]] == cloud.pulse[known]
        inside &= step[known] < cloud.waves.index[first[known]] + length[row[known]]
        inside &= length[row[known]] <= LONGEST
        known = known[inside]
        rows["wave_start"][known] = before + first[known]
        rows["wave_samples"][known] = length[row[known]]
        after = cloud.returns.distance[known] - cloud.waves.index[first[known]] * cloud.waves.step
        rows["return_point_wave_location"][known] = after * 2e12 / LIGHT
        for name, axis in zip(("x_t", "y_t", "z_t"), _axes(cloud).T, strict=True):
            rows[name] = axis * LIGHT / 2e12
    return rows


def write_points(path: Path, cloud: Cloud, offset: Offset, labels: Labels | None = None) -> None:
    """Write a cloud; the ending of the path, one of ``ENDINGS``, says how.

    offset : metres added to positions, and their coordinate system. labels : beside those that every
    file has, with their names.

    Raises
    ------
    SpecError : a package that the format needs is not installed; the coordinate system is not known.
    OSError : it cannot be written; what had its name before stays as it was.
    """
    if ending_of(path) == ".e57":
        from ..formats.e57 import write_e57

        origin = origin_of(cloud)
        # about the scanner, or about the middle of the points where it moved
        about = np.median(cloud.position, axis=0) if origin is None and len(cloud) else origin
        about = np.zeros(3) if about is None else about
        place, seen = (about + np.array(offset)).tolist(), origin is not None
        write_e57(path, cloud.position - about, cloud.intensity, place, seen)
        return
    if cloud.waves is None or ending_of(path) in NO_PACKETS:
        write_rows(path, records(cloud, offset), offset=offset, labels=labels)
        return
    packets = write_packets(path, cloud.waves.value, cloud.waves)
    write_rows(path, records(cloud, offset, 0), offset=offset, labels=labels, packets=packets)


def write_packets(
    path: Path, counts: np.ndarray, waves: Waveforms
) -> tuple[Path, float, float, float, int]:
    """Write counts (N,) of waveforms beside a file of points, as LAS's ``.wdp``; return it, with ps from
    sample to sample, gain and offset of the counts, and LAS's point format. waves : tells these."""
    beside = path.with_name(path.name[: -len(ending_of(path))] + WAVEFORMS)
    with replacing(beside) as partial, open(partial, "wb") as file:
        file.write(struct.pack("<H16sHQ32s", 0, b"LASF_Spec", 65535, 2 * len(counts), b"Waveforms"))
        for first in range(0, len(counts), SAMPLES_AT_ONCE):
            file.write(counts[first : first + SAMPLES_AT_ONCE].tobytes())
    scale = waves.step * 2e12 / LIGHT, waves.gain, -BASELINE * waves.gain
    return beside, *scale, waves.las_format


def write_rows(
    path: Path,
    rows: np.ndarray | StoredRows,
    comments: Sequence[str] = (),
    *,
    offset: Offset = NO_OFFSET,
    labels: Labels | None = None,
    packed: bool = True,
    packets: tuple[Path, float, float, float, int] | None = None,
) -> None:
    """Write rows of points; the ending of the path, one of ``ENDINGS`` but E57's, says how.

    comments : of a PLY. offset : the metres that rows have it in them, which x, y and z of a PLY or PCD in
    single precision are about, and the coordinate system that a LAS tells. labels : of rows in memory:
    classes of a LAS, else a field more. packed : whether an NPZ is compressed. packets : waveforms that
    the rows name, which an NPZ holds as well.

    Raises
    ------
    SpecError, OSError : as ``write_points``.
    """
    ending = ending_of(path)
    if ending in (".laz", ".las", COPC):
        from ..formats.las import write_las  # here: few runs need what it takes to import

        write_las(path, rows, labels=labels, crs=offset.crs, packets=packets)
        return
    rows = rows if labels is None else _with_label(rows[:], labels)
    columns = {name: rows[name] for name in rows.dtype.names or ()}
    if ending.endswith(".ply"):
        names = () if labels is None else labels.names
        said = (f"label {number} {name}" for number, name in enumerate(names))
        write_ply(path, rows, (*comments, *said), _about(ending, rows, offset))
    elif ending.endswith(".pcd"):
        from ..formats.pcd import write_pcd

        write_pcd(path, rows, _about(ending, rows, offset))
    elif ending == ".npz":
        named = {} if labels is None else {"label_name": np.array(labels.names, dtype=np.str_)}
        if packets is not None:
            counts = np.memmap(packets[0], "<u2", "r", HEAD_BYTES)
            scale = np.array(packets[1:4])
            named |= {"waveform_counts": counts, "waveform_step_gain_offset": scale}
        write_npz(path, columns | named, UNITS, packed)
    elif ending == ".xyz":
        _write_xyz(path, rows[:])
    else:
        units = {name: f"{name}_{unit}".replace("/", "_") for name, unit in UNITS.items()}
        words = {} if labels is None else {"label": labels.words()}
        write_csv(path, {units.get(n, n): c[:].tolist() for n, c in columns.items()} | words)


def ending_of(path: Path) -> str:
    """The ending of a file's name that says its format: two parts of "cloud.copc.laz", else the last."""
    name = path.name.lower()
    return next((e for e in (COPC, *DOUBLE) if name.endswith(e)), path.suffix.lower())


def _about(ending: str, rows: np.ndarray | StoredRows, offset: Offset) -> Offset | None:
    """Metres that coordinates in single precision are about: the scene's offset, or, of points so far from
    it that they would be a millimetre off, their middle; None of double precision."""
    if ending in DOUBLE:
        return None
    low, high = bounds(rows)
    far = np.abs([low - offset, high - offset]).max() > FAR
    return Offset(np.round((low + high) / 2).tolist()) if far else offset


def can_write(ending: str) -> bool:
    """Return whether the package that a format needs is installed."""
    return ending not in NEEDS or find_spec(NEEDS[ending]) is not None


def origin_of(cloud: Cloud) -> np.ndarray | None:
    """(3,) metres, where the scanner stood; None of one that moved, or without returns."""
    if not len(cloud):
        return None
    places = cloud.position - cloud.returns.distance[:, None] * _axes(cloud)
    return np.median(places, axis=0) if np.ptp(places, axis=0).max() < STILL else None


def _axes(cloud: Cloud) -> np.ndarray:
    """(P, 3) directions of the beams of returns."""
    level = np.cos(cloud.elevation)
    return np.column_stack(
        [level * np.cos(cloud.azimuth), level * np.sin(cloud.azimuth), np.sin(cloud.elevation)]
    )


def _with_label(rows: np.ndarray, labels: Labels) -> np.ndarray:
    """The rows with one field more."""
    wider = np.empty(len(rows), dtype=[*rows.dtype.descr, ("label", "<i4")])
    for name in rows.dtype.names or ():
        wider[name] = rows[name]
    wider["label"] = labels.number
    return wider


def _write_xyz(path: Path, rows: np.ndarray) -> None:
    """Lines of x, y, z to 0.1 mm, intensity (dB), tree, organ and label, after one line of names."""
    level = 10 * np.log10(np.maximum(rows["amplitude"], 1e-30))
    names = [name for name in XYZ if name == "intensity_db" or name in (rows.dtype.names or ())]
    columns = [level if name == "intensity_db" else rows[name] for name in names]
    digits, head = [XYZ[name] for name in names], " ".join(names)
    with replacing(path) as partial:
        np.savetxt(partial, np.column_stack(columns), fmt=digits, header=head, comments="//")


def labels_of(returns: Returns, scene: SceneGeometry, species: Sequence[str]) -> dict[str, Labels]:
    """Labels that points can have besides their classes, by what they are of.

    Those of objects have the objects' names; what is instanced many times is one object.
    """
    objects = np.append(scene.object_index, UNKNOWN)[returns.instance]
    return {
        "OBJECT": _named(objects, scene.object_name),
        "SPECIES": _named(returns.species, species),
        "MATERIAL": _by_material(returns, scene),
    }


def _by_material(returns: Returns, scene: SceneGeometry) -> Labels:
    """Materials by their names, as the slots of meshes hold them."""
    known: dict[str, int] = {}
    number = np.full(len(returns.instance), UNKNOWN, dtype=np.int64)
    mesh_of = np.append(scene.mesh_index, UNKNOWN)[returns.instance]
    for index, slots in enumerate(scene.slot_names):
        rows = np.flatnonzero(mesh_of == index)
        if not len(rows):
            continue
        of_slot = np.array(
            [known.setdefault(name, len(known)) if name else UNKNOWN for name in slots]
        )
        slot = scene.meshes[index].material[returns.triangle[rows]]
        number[rows] = of_slot[np.clip(slot, 0, len(slots) - 1)]
    return _named(number, tuple(known))


def _named(number: np.ndarray, names: Sequence[str]) -> Labels:
    """Labels with those numbers alone that occur, the most frequent first."""
    number = np.where((number >= 0) & (number < len(names)), number, UNKNOWN)
    there, count = np.unique(number[number >= 0], return_counts=True)
    order = there[np.argsort(-count, kind="stable")]
    place = np.full(len(names) + 1, UNKNOWN, dtype=np.int32)  # the last is that of UNKNOWN
    place[order] = np.arange(len(order))
    return Labels(place[number], tuple(names[k] for k in order.tolist()))
