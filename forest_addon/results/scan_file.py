"""A scan of any size on disk: chunk by chunk into one file that is whole at any time.

While a scan runs, its returns stand in ``NAME.partial.ply``, a binary PLY of full precision that grows
every second, or with every chunk where its length is given, and ``NAME.partial.json`` says how far it is
and of which scan. A scan that is killed leaves both: the PLY opens anywhere, and ``resume`` cuts it back to
the last chunk that the JSON knows and goes on from there. At the end the PLY becomes the format that was
asked for, a part at a time; samples of waveforms wait in ``NAME.partial.wdp``. Each pulse depends on its
number alone, so the bytes are those of a scan that was never interrupted, and memory holds one chunk.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..base.kept import digest
from ..base.progress import Progress
from ..formats.atomic import replacing
from ..formats.ownership import claim
from ..formats.ply import PlyFile
from ..sensing.lidar.cloud import Lost, together
from ..sensing.lidar.scan import Scan
from ..sensing.rays.geometry import SceneGeometry
from ..spec import Scanner, SpecError
from . import POINT_FORMATS
from .coordinates import NO_OFFSET, Offset
from .points import ending_of, point_type, records, write_packets, write_rows

ROWS_AT_ONCE = 200_000
SAVED_EVERY = 1.0  # s; a disk takes some of the time of a chunk for each saving


@dataclass(frozen=True)
class Written:
    """Facts of a written scan: its file, pulses and points; ``resumed_at`` is the pulse that it went on
    from, ``lost`` what could not be measured, ``unfollowed`` as of a ``Cloud``."""

    path: Path
    pulses: int
    points: int
    resumed_at: int
    lost: tuple[Lost, ...] = ()
    unfollowed: int = 0


@dataclass(frozen=True)
class ScanState:
    """State of an unfinished scan: which scan, its pulses, those of a chunk, those done, those of them
    that were lost, its points, turned rays that met a second specular surface."""

    scan: str
    pulses: int
    at_once: int
    done: int = 0
    points: int = 0
    lost: tuple[Lost, ...] = ()
    unfollowed: int = 0
    samples: int = 0

    def write(self, path: Path) -> None:
        """Write it as JSON."""
        with replacing(path) as partial:
            partial.write_text(json.dumps(dataclasses.asdict(self)) + "\n", encoding="utf-8")

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read it; whatever else lies there is an OSError, ValueError, TypeError or KeyError."""
        said = json.loads(path.read_text(encoding="utf-8"))
        return cls(**said | {"lost": tuple(Lost(**one) for one in said.get("lost", ()))})


def write_scan(
    path: Path,
    scan: Scan,
    seed: int,
    *,
    offset: Offset = NO_OFFSET,
    resume: bool = False,
    at_once: int | None = None,
    progress: Progress | None = None,
) -> Written:
    """Run a scan into a file: .laz, .las, .copc.laz, .ply or .npz by the ending of its name.

    offset : metres added to every position, and their coordinate system.
    resume : go on with an unfinished scan, if there is one.
    at_once : pulses a chunk, each of which is saved by itself. progress : may raise to cancel; what is
    finished is kept.

    Raises
    ------
    SpecError : an ending that is not known; an unfinished scan with other settings or of another scene.
    OSError : it cannot be written; what is finished is kept.
    """
    stem = stem_of(path)
    state = ScanState(_digest(scan, seed, offset), scan.pulses, at_once or scan.at_once)
    noted, partial = (path.with_name(f"{stem}.partial.{end}") for end in ("json", "ply"))
    claim(path, noted)
    claim(partial, ours=noted.is_file())  # a note of ours says how far it is
    if resume and noted.is_file():
        state = _resumed(noted, state)
    else:
        state.write(noted)
    begin = state.done
    point = point_type(scan.scanner.bounces, bool(scan.scanner.receiver.sample_ns))
    file = PlyFile(partial, point, comments_of(scan.scanner, seed), keep=state.points)
    samples = None
    if scan.scanner.receiver.sample_ns:
        beside = path.with_name(f"{stem}.partial.wdp")
        samples = beside.open("ab")
        samples.truncate(2 * state.samples)
    saved, rows = time.monotonic(), []
    try:
        for done, cloud in scan.chunks(begin, state.at_once):
            rows.append(records(cloud, offset, state.samples if samples else None))
            if samples and cloud.waves is not None:
                samples.write(cloud.waves.value.tobytes())
                samples.flush()
                state = dataclasses.replace(state, samples=state.samples + len(cloud.waves.value))
            lost = together([*state.lost, *cloud.lost])
            ended = state.unfollowed + cloud.unfollowed
            state = dataclasses.replace(state, done=done, lost=lost, unfollowed=ended)
            waits = time.monotonic() < saved + SAVED_EVERY and sum(map(len, rows)) < ROWS_AT_ONCE
            if at_once or not waits:
                state, rows, saved = _saved(file, noted, state, rows), [], time.monotonic()
            if progress:
                progress(done, scan.pulses)
    finally:
        if rows:
            state = _saved(file, noted, state, rows)
        file.close()
        if samples:
            samples.close()
    packets = None
    if samples:
        none = scan.look(0, 0).waves
        counts = np.memmap(beside, "<u2", "r") if state.samples else none.value
        packets = write_packets(path, counts, none)
        beside.unlink()
    finish(file, path, offset, packets)
    noted.unlink(missing_ok=True)
    return Written(path, scan.pulses, file.count, begin, state.lost, state.unfollowed)


def _saved(file: PlyFile, noted: Path, state: ScanState, rows: Sequence[np.ndarray]) -> ScanState:
    """Put rows of finished chunks on the disk, and note how far the scan is."""
    file.append(np.concatenate(rows))
    state = dataclasses.replace(state, points=file.count)
    state.write(noted)
    return state


def stem_of(path: Path) -> str:
    """The name of a file of points without its ending, one of ``POINT_FORMATS``.

    Raises
    ------
    SpecError : an ending that is not known.
    """
    kind = ending_of(path).lstrip(".")
    if kind not in POINT_FORMATS:
        raise SpecError(
            str(path), f"cannot be written; end its name in .{', .'.join(POINT_FORMATS)}"
        )
    return path.name[: -len(kind) - 1]


def comments_of(scanner: Scanner, seed: int) -> tuple[str, ...]:
    """Comments of a file of records, which say of what it is."""
    return (f"Forest Sensing {scanner.kind} scan {scanner.name}, seed {seed}",)


def finish(file: PlyFile, path: Path, offset: Offset, packets: Any = None) -> None:
    """Turn a partial file of records into the file that was asked for, which its ending says; packets : as
    ``write_rows`` takes them."""
    write_rows(path, file.rows(), file.comments, offset=offset, packed=False, packets=packets)
    file.path.unlink()


def _resumed(noted: Path, fresh: ScanState) -> ScanState:
    """Record of an unfinished scan; its chunks go on as they were."""
    try:
        known = ScanState.read(noted)
    except Exception:  # whatever else lies there
        known = None
    counts = () if known is None else (known.at_once, known.done, known.points)
    sound = all(type(count) is int and count >= 0 for count in counts)
    if known is None or not sound or (known.scan, known.pulses) != (fresh.scan, fresh.pulses):
        raise SpecError(
            "resume",
            f"{noted.name} is of another scan: its settings, seed or scene differ; run again without it",
        )
    return known


def _digest(scan: Scan, seed: int, offset: Offset) -> str:
    """Digest of what decides the bytes of a scan: settings, seed, scene, engine."""
    said = [dataclasses.asdict(scan.scanner), seed, offset, scan.caster.engine]
    # where an object that is followed goes
    probe = scan.pattern.pulses(np.linspace(0, scan.pulses - 1, 64).astype(np.int64))
    return digest([said, scene_digest(scan.caster.scene), probe.origin, probe.direction])


def scene_digest(scene: SceneGeometry) -> str:
    """Digest of what decides what rays meet."""
    arrays = [
        a for mesh in scene.meshes for a in (mesh.points, mesh.triangles, mesh.part, mesh.leaf)
    ]
    arrays += [scene.transform, scene.mesh_index, scene.tree, scene.species, scene.reflectance]
    arrays += [*scene.slot_reflectance, *scene.slot_optics]
    arrays += [] if scene.optics is None else [scene.optics]
    return digest(arrays)
