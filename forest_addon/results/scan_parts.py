"""Parts of a scan that was made in tiles, and their way into one file, or one of each tile.

A part has the records of the pulses of one piece, sorted by pulse. It is complete or not there: rows go to a
temporary name, and what they are of (``PartNote``) is written last. Joined by the number of their pulses, the
parts are what the scan of the whole forest writes, byte by byte.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base.progress import Progress
from ..formats.atomic import partial_of, replacing
from ..formats.ply import PlyFile
from ..sensing.lidar.cloud import Lost, together
from ..spec import Scanner
from ..stand.tiles import TileGrid
from .coordinates import NO_OFFSET, Offset
from .points import POINT
from .scan_file import Written, comments_of, finish, format_of

WINDOW = 1_000_000  # points, about, that are joined at a time
HEAD = b"FSPART1\n"  # before the records


@dataclass(frozen=True)
class PartNote:
    """Facts of a finished part: what decides its bytes, its pulses and points, pulses that were lost."""

    scan: str
    pulses: int
    points: int
    lost: tuple[Lost, ...] = ()


@dataclass(frozen=True)
class TileFiles:
    """Files of tiles that are wanted: of which tiles, in which folder, and whether they are all."""

    grid: TileGrid
    folder: Path
    alone: bool = False


def write_part(
    path: Path, scan: str, pieces: Iterable[tuple[int, np.ndarray, Sequence[Lost]]]
) -> PartNote:
    """Write a part to ``path`` and its note beside it.

    scan : what decides its bytes. pieces : pulses, records (P,) and what was lost, in order.

    Raises
    ------
    OSError : it cannot be written; nothing is left of it.
    """
    pulses, points, lost = 0, 0, list[Lost]()
    with replacing(path) as partial, open(partial, "wb") as file:
        file.write(HEAD)
        for sent, rows, missed in pieces:
            file.write(rows.tobytes())
            pulses, points = pulses + sent, points + len(rows)
            lost += missed
    note = PartNote(scan, pulses, points, together(lost))
    with replacing(_note(path)) as partial:
        partial.write_text(json.dumps(dataclasses.asdict(note)) + "\n", encoding="utf-8")
    return note


def read_note(path: Path, scan: str) -> PartNote | None:
    """The note of a part that is finished and of this scan; None where there is none."""
    try:
        said = json.loads(_note(path).read_text(encoding="utf-8"))
        note = PartNote(**said | {"lost": tuple(Lost(**one) for one in said["lost"])})
        whole = path.stat().st_size == len(HEAD) + note.points * POINT.itemsize
    except (OSError, ValueError, TypeError, KeyError):  # none, or whatever else lies there
        return None
    return note if whole and note.scan == scan else None


def join_parts(
    path: Path,
    parts: Sequence[Path],
    scanner: Scanner,
    seed: int,
    pulses: int,
    *,
    offset: Offset = NO_OFFSET,
    tiles: TileFiles | None = None,
    progress: Progress | None = None,
) -> Written:
    """Join finished parts into ``path``, in the order of their pulses, in the memory of a window.

    tiles : also a file of each tile, of the points over it; not of tiles without a point.

    Raises
    ------
    SpecError : an ending that is not known. OSError : it cannot be written; the parts stay.
    """
    kind, comments = format_of(path), comments_of(scanner, seed)
    arrays = [rows_of(part) for part in parts]
    total, lost = sum(map(len, arrays)), _all_lost(parts)
    partial = partial_of(path.with_name(f"{path.name[: -len(kind) - 1]}.joining.ply"))
    file = PlyFile(partial, POINT, comments) if tiles is None or not tiles.alone else None
    made: dict[int, int] = {}
    done = 0
    try:
        for rows in _in_order(arrays, max(int(pulses * min(WINDOW / max(total, 1), 1.0)), 1)):
            done += len(rows)
            if file is not None:
                file.append(rows)
            if tiles is not None:
                _deal(rows, tiles, comments, offset, made)
            if progress:
                progress(done, max(total, 1))
    finally:
        if file is not None:
            file.close()
    if tiles is not None:
        for tile, count in made.items():
            of_tile = PlyFile(_of_tile(tiles, tile), POINT, comments, keep=count)
            of_tile.close()
            name = f"{path.name[: -len(kind) - 1]}-{tiles.grid.name(tile)}.{kind}"
            finish(of_tile, tiles.folder / name, kind, offset.crs)
    if file is not None:
        finish(file, path, kind, offset.crs)
    return Written(path, pulses, total, 0, lost)


def rows_of(part: Path) -> np.ndarray:
    """The records of a part, read from the disk as they are used."""
    if part.stat().st_size == len(HEAD):
        return np.empty(0, dtype=POINT)
    return np.memmap(part, POINT, mode="r", offset=len(HEAD))


def _note(path: Path) -> Path:
    return path.with_suffix(".json")


def _all_lost(parts: Sequence[Path]) -> tuple[Lost, ...]:
    said = [json.loads(_note(part).read_text(encoding="utf-8"))["lost"] for part in parts]
    return together(sorted((Lost(**one) for lost in said for one in lost), key=lambda x: x.first))


def _in_order(parts: Sequence[np.ndarray], window: int) -> Iterator[np.ndarray]:
    """Rows of all parts by pulse, those of so many pulses at a time."""
    parts = [part for part in parts if len(part)]
    begin = [0] * len(parts)
    first = np.array([int(part["pulse"][0]) for part in parts], dtype=np.int64)
    last = np.array([int(part["pulse"][-1]) for part in parts], dtype=np.int64)
    for start in range(0, int(last.max(initial=-1)) + 1, window):
        some = []
        for number in np.flatnonzero((first < start + window) & (last >= start)).tolist():
            rows = parts[number]
            end = len(rows)
            if last[number] >= start + window:
                end = int(np.searchsorted(rows["pulse"], start + window))
            some.append(np.array(rows[begin[number] : end]))
            begin[number] = end
        if some:
            rows = np.concatenate(some)
            yield rows[np.argsort(rows["pulse"], kind="stable")]


def _deal(
    rows: np.ndarray,
    tiles: TileFiles,
    comments: tuple[str, ...],
    offset: Offset,
    made: dict[int, int],
) -> None:
    """Add records to the files of the tiles that they lie over."""
    where = np.column_stack([rows["x"] - offset[0], rows["y"] - offset[1]])
    tile = tiles.grid.tile_of(where)
    for number in np.unique(tile).tolist():
        file = PlyFile(_of_tile(tiles, number), POINT, comments, keep=made.get(number, 0))
        file.append(rows[tile == number])
        file.close()
        made[number] = file.count


def _of_tile(tiles: TileFiles, tile: int) -> Path:
    return partial_of(tiles.folder / f"{tiles.grid.name(tile)}.joining.ply")
