"""A run in tiles: scans piece by piece in any number of processes, then one file of each scan.

All that is finished stands on the disk. A piece (a tile, with one width of buffer) is a file of its own
in ``tiles/`` until its scan is joined; a sensor that is done has a note there, which says by what settings.
So a run that is killed loses the pieces that it was at, and ``--resume`` makes what is missing. Processes
share the work by number alone, ``--share 2/8``, on one machine or on many that see the same folder.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from forest_addon.api import TiledScan, Tiling, World
from forest_addon.api.results import is_scanner
from forest_addon.base.places import environment_of_child
from forest_addon.blender.files.export import empty_file
from forest_addon.blender.read.depsgraph import forget
from forest_addon.formats.atomic import remove_abandoned, write_whole
from forest_addon.formats.ownership import remove
from forest_addon.formats.table import write_csv
from forest_addon.results.coordinates import FILE, Offset, on_the_map, write_note
from forest_addon.results.kinds import write_finding
from forest_addon.spec import Scene, SpecError
from forest_addon.stand.forest import angle_table, tree_table

from .command import DoubtfulError
from .interrupt import WATCHED
from .progress import Stages, hushed, peak_memory_mb
from .record import made_with

FOLDER = "tiles"
BLOCK = 250_000  # trees of trees.csv at a time
NOT_WRITTEN = "report.html, pictures, leaves.npz, forest.blend, forest.glb and preview.png"


@dataclass(frozen=True)
class Share:
    """Share of the work: number ``part`` of ``parts``, from 1."""

    part: int = 1
    parts: int = 1

    @classmethod
    def of(cls, text: str) -> Share:
        """Read "2/8".

        Raises
        ------
        ValueError : it is something else.
        """
        part, _, parts = text.partition("/")
        if not (part.isdigit() and parts.isdigit() and 1 <= int(part) <= int(parts)):
            raise ValueError(f'"{text}" is no share; write such as 2/8')
        return cls(int(part), int(parts))


@dataclass
class TiledRun:
    """State of a run in tiles."""

    tiling: Tiling
    out: Path
    stages: Stages
    resume: bool
    scans: dict[str, TiledScan] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        return self.out / FOLDER

    def note(self, name: str) -> Path:
        """Path of the file which says that a sensor is done."""
        return self.folder / f"{name}.done.json"

    def digest(self, sensor: Any) -> str:
        """Return what decides a sensor's result."""
        said = json.dumps(
            [self.tiling.digest, dataclasses.asdict(sensor), self.tiling.scene.tiles.files],
            sort_keys=True,
            default=str,
        )
        return hashlib.blake2b(said.encode(), digest_size=16).hexdigest()

    def done(self, sensor: Any) -> dict[str, Any] | None:
        """Facts of a sensor that an earlier run had finished, whose files are there."""
        try:
            said = json.loads(self.note(sensor.name).read_text(encoding="utf-8"))
            there = all((self.out / name).is_file() for name in said["files"])
            same = said["settings"] == self.digest(sensor)
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return dict(said) if there and same else None


def run_in_tiles(
    settings: Scene,
    folder: Path,
    out: Path,
    *,
    quiet: bool = False,
    resume: bool = False,
    share: Share | None = None,
    strict: bool = False,
) -> None:
    """Run a scene with ``[tiles]`` into a folder.

    folder : that paths in the scene file are relative to. resume : take what is finished.
    share : make only these pieces, and join nothing; None: all, and join them. strict : a warning is an
    error, at the end.

    Raises
    ------
    SpecError : a scene that cannot be cut into tiles. OSError : a file could not be written; what is
    finished is kept. DoubtfulError : ``strict`` and a warning; everything is written.
    """
    stages = Stages(quiet)
    stages.say(f"{settings.name}, seed {settings.seed}, in tiles")
    out.mkdir(parents=True, exist_ok=True)
    with stages.stage("plan the field, grow variants"), hushed():
        empty_file()
        run = TiledRun(Tiling.of(settings, folder), out, stages, resume or share is not None)
    run.folder.mkdir(exist_ok=True)
    if share is None:
        remove_abandoned(run.folder)
    _say_tiles(run)
    every = run.tiling.site.scene.sensors
    todo = [s for s in every if not (run.resume and run.done(s))]
    for sensor in todo:
        remove(run.note(sensor.name))
        if is_scanner(sensor):
            if sensor.receiver.sample_ns:
                raise SpecError(
                    "receiver.sample_ns", "tiles keep no waveforms; leave one of them out"
                )
            way = run.tiling.way(sensor)
            run.scans[sensor.name] = scan = TiledScan(run.tiling, sensor, run.folder, way)
            if scan.followed:
                stages.say(f"  {scan.followed}")
        else:
            run.tiling.reachable(sensor)  # refused now, before hours are spent
    _make_pieces(run, share)
    if share is not None:
        stages.say(f"Share {share.part}/{share.parts} is done; --resume without --share joins all")
        return
    for sensor in todo:
        if is_scanner(sensor):
            _join(run, run.scans[sensor.name])
        else:
            _look(run, sensor)
    _write_stand(run)
    _write_record(run, every)
    stages.say(f"Done: {len(run.files)} files in {out}")
    if strict and stages.warnings:
        raise DoubtfulError(f"{'; '.join(stages.warnings)}; the results are kept in {out}")


def run_by_workers(words: Sequence[str], workers: int) -> None:
    """Run so many processes of this command, a share each; ``words`` are its arguments.

    Raises
    ------
    SpecError : one of them failed; says what it said last.
    """
    started = [
        subprocess.Popen(
            [sys.executable, "-m", str(__package__), *words, "--share", f"{k + 1}/{workers}"],
            stdin=subprocess.PIPE,  # which closes when we end, however that comes
            stderr=subprocess.PIPE,
            text=True,
            env=environment_of_child(**{WATCHED: "1"}),
        )
        for k in range(workers)
    ]
    said = []
    try:
        for process in started:
            assert process.stderr is not None
            said.append(process.stderr.read().strip())
            process.wait()
    finally:
        for process in started:
            if process.poll() is None:
                process.terminate()
    for number, (process, text) in enumerate(zip(started, said, strict=True), 1):
        code = process.returncode
        if code:
            how = f"was ended by signal {-code}" if code < 0 else f"ended with {code}"
            last = f": {text.splitlines()[-1]}" if text else ""
            raise SpecError(
                "--workers", f"process {number} of {workers} {how}{last}; --resume goes on"
            )


def _say_tiles(run: TiledRun) -> None:
    tiling, tiles = run.tiling, run.tiling.scene.tiles
    run.stages.tell(tiling.site.inputs.told)
    for note in tiling.forest.notes:
        run.stages.warn(note)
    across = " x ".join(map(str, tiling.grid.count))
    trees = len(tiling.forest.stand)
    run.stages.say(
        f"  {trees:,} trees in {across} tiles of {tiles.size:g} m, each with a buffer of {tiles.buffer:g} m"
    )
    run.stages.say(f"  Not written of a field in tiles: {NOT_WRITTEN}; no audits")
    run.facts["tiles"] = {"count": list(tiling.grid.count), "trees": trees}


def _make_pieces(run: TiledRun, share: Share | None) -> None:
    """Make the pieces that are missing, those of several scans in one scene together."""
    wanted: dict[int, list[TiledScan]] = {}
    for scan in run.scans.values():
        for piece in scan.todo(run.resume):
            wanted.setdefault(piece, []).append(scan)
    order = sorted(wanted)
    if share is not None:
        order = order[share.part - 1 :: share.parts]
    with run.stages.stage("scan tiles") as progress:
        for done, piece in enumerate(order):
            world: World | None = None
            for scan in wanted[piece]:
                if share is not None and scan.is_made(piece):  # by another share, meanwhile
                    continue
                with hushed():
                    world = world or scan.world(piece)
                scan.make(piece, world)
            progress(done + 1, len(order))
    forget()


def _join(run: TiledRun, scan: TiledScan) -> None:
    """One file of a scan, and its note."""
    sensor = scan.sensor
    path = run.out / f"{sensor.name}.laz"
    with run.stages.stage(f"write {path.name}") as progress:
        written = scan.join(path, progress)
    files = [path.name] if path.is_file() else []
    files += [str(p.relative_to(run.out)) for p in sorted(path.with_suffix("").glob("*.*"))]
    facts = {"pulses": written.pulses, "points": written.points, "followed": scan.pulses.followed}
    facts["furthest_m"] = round(scan.pulses.furthest, 3)
    for lost in written.lost:
        run.stages.warn(f"{sensor.name}: lost {lost}")
    if not written.points:
        run.stages.warn(f"{sensor.name}: 0 points; no pulse met anything within its range")
    _finish(run, sensor, files, facts)


def _look(run: TiledRun, sensor: Any) -> None:
    """The result of a sensor that is asked in one scene of all that it can reach."""
    with run.stages.stage(f"{sensor.kind} {sensor.name}") as progress:
        with hushed():
            world = run.tiling.hearing(sensor)
        result = world.look(sensor, progress)
    for warning in result.warnings:
        run.stages.warn(warning)
    made = write_finding(run.out, result.sensor, result.found, Offset.of(run.tiling.scene))
    facts = {"trees": len(world.forest.stand), **result.record()}
    _finish(run, sensor, [file.name for file in made], facts)


def _finish(run: TiledRun, sensor: Any, files: Sequence[str], facts: dict[str, Any]) -> None:
    said = {"settings": run.digest(sensor), "files": list(files), "facts": facts}
    run.folder.mkdir(exist_ok=True)  # a scan that is joined takes its empty folder away
    write_whole(run.note(sensor.name), json.dumps(said, default=str) + "\n")


def _write_stand(run: TiledRun) -> None:
    """trees.csv of all trees, tiles.csv, and the angles of leaves."""
    tiling, offset = run.tiling, run.tiling.scene.offset
    with run.stages.stage("write truth"):
        if write_note(run.out / FILE, offset, tiling.scene.crs):
            run.files.append(FILE)
        parts = (on_the_map(tree_table(part), offset) for part in tiling.forest.parts(BLOCK))
        write_csv(run.out / "trees.csv", parts)
        write_csv(run.out / "leaf_angles.csv", angle_table(tiling.forest.whole))
        tiles = tiling.tiles
        table: dict[str, list[Any]] = {"tile": [t.name for t in tiles]}
        for end in ("low", "high"):
            for axis, name in enumerate("xy"):
                corner = [float(getattr(t, end)[axis]) + offset[axis] for t in tiles]
                table[f"{end}_{name}_m"] = corner
        table["trees"] = [t.trees for t in tiles]
        write_csv(run.out / "tiles.csv", table)
    run.files += ["trees.csv", "leaf_angles.csv", "tiles.csv"]


def _write_record(run: TiledRun, sensors: Sequence[Any]) -> None:
    """run.json, as of any run; notes of sensors go."""
    notes = {sensor.name: run.done(sensor) for sensor in sensors}
    for said in notes.values():
        run.files += said["files"] if said else []
    run.files.append("run.json")
    record = {
        **made_with(run.tiling.scene),
        **run.facts,
        "sensors": {name: said["facts"] for name, said in notes.items() if said},
        "stage_seconds": run.stages.seconds,
        "warnings": run.stages.warnings,
        "peak_memory_mb": peak_memory_mb(),
        "files": run.files,
    }
    write_whole(run.out / "run.json", json.dumps(record, indent=2, default=str) + "\n")
