"""A run in tiles: scans piece by piece in any number of processes, then one file of each scan.

All that is finished stands on the disk. A piece (a tile, with one width of buffer) is a file of its own
in ``tiles/`` until its scan is joined; a sensor that is done has a note there, which says by what settings.
So a run that is killed loses the pieces that it was at, and ``--resume`` makes what is missing. Workers are
those of datasets: of this machine, or of a cluster whose machines see the same folder.
"""

from __future__ import annotations

import dataclasses
import json
import math
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.api import TiledScan, Tiling, World
from forest_addon.api.results import is_scanner
from forest_addon.base.kept import digest
from forest_addon.base.rng import stream
from forest_addon.blender.files.export import empty_file
from forest_addon.blender.read.depsgraph import forget
from forest_addon.formats.atomic import remove_abandoned, write_whole
from forest_addon.formats.ownership import remove
from forest_addon.formats.table import write_csv
from forest_addon.results.coordinates import FILE, Offset, on_the_map, write_note
from forest_addon.results.kinds import write_finding
from forest_addon.spec import Scene, SpecError
from forest_addon.stand.forest import angle_table, tree_table
from forest_addon.tiles import LEVELS, TileGrid, seconds_of_pulses

from .catalogue import write_catalogue
from .command import IncompleteError
from .dataset.engine import Cluster, SceneOutcome, WorkerJob, make_all
from .dataset.estimate import Estimate, Trial
from .dataset.settings import Running
from .pipeline import made_with
from .progress import Stages, hushed, peak_memory_mb
from .store import claim_store, fetch, put

FOLDER = "tiles"
PLAN = "plan.npz"  # in it: what workers need not find again
MOST_CUTS = 8  # along the edges of a tile
MOST_AUDITED = 10  # tiles of a scan
BLOCK = 250_000  # trees of trees.csv at a time
NOT_WRITTEN = "report.html, pictures, leaves.npz, forest.blend, forest.glb and preview.png"


@dataclass
class TiledRun:
    """State of a run in tiles."""

    asked: Scene
    base: Path  # that its paths are relative to
    tiling: Tiling
    out: Path
    stages: Stages
    resume: bool = False
    store: Path | None = None
    command: str = ""
    scans: dict[str, TiledScan] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        return self.out / FOLDER

    def scan(self, sensor: Any, only: np.ndarray | None = None) -> TiledScan:
        """The scan of one of its scanners."""
        way = self.tiling.way(sensor)
        return TiledScan(self.tiling, sensor, self.folder, way, only)

    def note(self, name: str) -> Path:
        """Path of the file which says that a sensor is done."""
        return self.folder / f"{name}.done.json"

    def digest(self, sensor: Any) -> str:
        """Digest of what decides a sensor's result."""
        forest, files = self.tiling.forest.digest, self.tiling.scene.tiles.files
        return digest([forest, dataclasses.asdict(sensor), files])

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
    share: tuple[int, int] | None = None,
    cluster: Cluster | None = None,
    store: Path | None = None,
    command: str = "",
    strict: bool = False,
) -> None:
    """Run a scene with ``[tiles]`` into a folder.

    folder : that paths in the scene file are relative to. resume : take what is finished.
    share : (k, n), make every nth piece from the kth on, and join nothing; None: all, and join them.
    cluster : where tiles are made; None: in this process. store : that pieces, and all files in the end, are
    copied to, and pieces are taken from. command : that a catalogue tells. strict : a warning is an error, at
    the end.

    Raises
    ------
    SpecError : a scene that cannot be cut into tiles. OSError : a file could not be written; what is
    finished is kept. IncompleteError : a tile could not be made. DoubtfulError : an audit found an error
    beyond what was allowed, or ``strict`` and a warning; everything is written.
    """
    stages = Stages(quiet, strict=strict)
    stages.say(f"{settings.name}, seed {settings.seed}, in tiles")
    out.mkdir(parents=True, exist_ok=True)
    with stages.stage("plan the field, grow variants"), hushed():
        empty_file()
        run = TiledRun(
            settings,
            folder,
            Tiling.of(settings, folder),
            out,
            stages,
            resume or share is not None,
            store,
            command,
        )
    run.folder.mkdir(exist_ok=True)
    if share is None:
        remove_abandoned(run.folder)
    if store is not None:
        claim_store(store, "a field in tiles", run.resume)
        if run.resume:
            fetch(store / FOLDER, run.folder)
    _say_tiles(run)
    every = run.tiling.site.scene.sensors
    todo = [s for s in every if not (run.resume and run.done(s))]
    for sensor in todo:
        remove(run.note(sensor.name))
        if is_scanner(sensor):
            run.scans[sensor.name] = scan = run.scan(sensor)
            if scan.followed:
                stages.say(f"  {scan.followed}")
        else:
            run.tiling.reachable(sensor)  # refused now, before hours are spent
    _make_pieces(run, cluster, share or (1, 1))
    if share is not None:
        stages.say(f"Share {share[0]}/{share[1]} is done; --resume without --share joins all")
        return
    for sensor in todo:
        if is_scanner(sensor):
            _join(run, run.scans[sensor.name])
        else:
            _look(run, sensor)
    _write_stand(run)
    notes = {sensor.name: run.done(sensor) for sensor in every}
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
    if store is not None:
        put(out, run.files, store)
        pieces = tuple(f"{sensor.name}{mark}" for sensor in every for mark in "-.")
        for one in (store / FOLDER).iterdir() if (store / FOLDER).is_dir() else ():
            if one.name.startswith(pieces):
                one.unlink()
    stages.say(f"Done: {len(run.files)} files in {store or out}")
    stages.end(out)


@dataclass(frozen=True)
class TileJob(WorkerJob):
    """A piece of the scans of a run in tiles, as a ``WorkerJob`` of the engine.

    scene, folder : as of ``run_in_tiles``. out : where the run's pieces are. sensors : names of those that
    scan. cuts : along the edges of the tile. store : that the piece is copied to.
    """

    scene: Scene
    folder: Path
    out: Path
    number: int
    sensors: tuple[str, ...]
    running: Running
    memory: float
    threads: int
    cuts: int = 1
    store: Path | None = None

    @property
    def name(self) -> str:
        """See ``WorkerJob``."""
        grid = TileGrid.of(self.scene.forest, self.scene.tiles.size)
        return f"tile {grid.name(self.number // LEVELS)}"

    def make(self, session: Any) -> dict[str, float]:
        """See ``WorkerJob``."""
        rays = self.scene.rays.changed(threads=self.threads)
        start = time.process_time()
        scene, folder, out = self.scene.changed(rays=rays), self.folder, self.out

        def plan() -> list[TiledScan]:
            if self.store is not None:
                fetch(self.store / FOLDER, out / FOLDER, ".npz")
            with hushed():
                empty_file()
                tiling = Tiling.of(scene, folder, out / FOLDER / PLAN)
                run = TiledRun(scene, folder, tiling, out, Stages(True))
            return [run.scan(s) for s in scene.sensors if s.name in self.sensors]

        scans = session.planned.once(repr((scene, folder, out, self.sensors)), plan)
        planned = time.process_time()
        make_piece(scans, self.number, self.cuts, self.store)
        return {"plan": planned - start, "sensors": time.process_time() - planned}

    def smaller(self) -> TileJob | None:
        """See ``WorkerJob``."""
        return replace(self, cuts=2 * self.cuts) if self.cuts < MOST_CUTS else None


def make_piece(
    scans: Sequence[TiledScan], piece: int, cuts: int = 1, store: Path | None = None
) -> None:
    """Make what is missing of a piece, of several scans in one scene, and copy it to a store."""
    world: World | None = None
    for scan in scans:
        if piece not in scan.pulses.pieces:
            continue
        if not scan.is_made(piece):
            with hushed():
                world = (world or scan.world(piece)) if cuts == 1 else None
                scan.make(piece, world, cuts)
        if store is not None:
            name = scan.path(piece).name  # the note last: it says that the piece is whole
            put(scan.folder, (name, Path(name).with_suffix(".json").name), store / FOLDER)
    forget()


def _say_tiles(run: TiledRun) -> None:
    tiling, tiles = run.tiling, run.tiling.scene.tiles
    run.stages.tell(tiling.site.inputs.told)
    for note in tiling.forest.notes:
        run.stages.warn(note)
    across = " x ".join(map(str, tiling.grid.count))
    trees = len(tiling.forest)
    run.stages.say(
        f"  {trees:,} trees in {across} tiles of {tiles.size:g} m, each with a buffer of {tiles.buffer:g} m"
    )
    run.stages.say(f"  Not written of a field in tiles: {NOT_WRITTEN}")
    run.facts["tiles"] = {"count": list(tiling.grid.count), "trees": trees}


def _make_pieces(
    run: TiledRun, cluster: Cluster | None, share: tuple[int, int] = (1, 1)
) -> list[SceneOutcome]:
    """Make the pieces of a share that are missing; returns how those went that workers made."""
    todo = sorted({piece for scan in run.scans.values() for piece in scan.todo(run.resume)})
    todo = todo[share[0] - 1 :: share[1]]
    told: list[SceneOutcome] = []
    with run.stages.stage("scan tiles") as progress:
        if cluster is None:
            for done, piece in enumerate(todo):
                make_piece(list(run.scans.values()), piece, store=run.store)
                progress(done + 1, len(todo))
            (run.folder / PLAN).unlink(missing_ok=True)  # of a command that was ended
            return told
        run.tiling.forest.keep(run.folder / PLAN)
        for scan in run.scans.values():
            scan.keep_pulses()
        if run.store is not None:
            names = [scan.path_of_pulses.name for scan in run.scans.values()]
            put(run.folder, [PLAN, *names], run.store / FOLDER)

        def report(outcome: SceneOutcome) -> None:
            told.append(outcome)
            progress(len(told), len(todo))
            if outcome.why:
                run.stages.warn(outcome.why)

        shares = cluster.shares(len(todo), Running())
        given = run.asked, run.base.resolve(), run.out.resolve()
        takes = tuple(run.scans), Running(), *shares, 1, run.store
        make_all([TileJob(*given, piece, *takes) for piece in todo], cluster, report)
        if run.store is not None:
            fetch(run.store / FOLDER, run.folder)  # what workers elsewhere have made
            (run.store / FOLDER / PLAN).unlink(missing_ok=True)
        (run.folder / PLAN).unlink(missing_ok=True)
    lost = [one.why for one in told if one.kind != "done"]
    if lost:
        raise IncompleteError(f"{len(lost)} pieces could not be made: {lost[0]}; --resume goes on")
    return told


# A sample of tiles, by which the whole is told.


def sample_tiles(
    scene: Scene, folder: Path, share: float, cluster: Cluster, stages: Stages
) -> dict[str, Any]:
    """Scan some tiles of a field, by chance, in a folder that is removed; what all cost, with 95 % intervals.

    share : of all tiles, at least two.

    Raises
    ------
    SpecError : a scene that cannot be cut into tiles, or has no scanner. IncompleteError : a tile could not
    be made.
    """
    with tempfile.TemporaryDirectory() as place:
        start = time.process_time()
        with stages.stage("plan the field, grow variants"), hushed():
            empty_file()
            run = TiledRun(scene, folder, Tiling.of(scene, folder), Path(place), stages)
        plan = time.process_time() - start
        _say_tiles(run)
        grid = run.tiling.grid
        count = min(max(round(share * len(grid)), 2), len(grid))
        chosen = np.sort(stream(scene.seed, "tiles", "sample").permutation(len(grid))[:count])
        sensors = [s for s in run.tiling.site.scene.sensors if is_scanner(s)]
        if not sensors:
            raise SpecError(
                "sensors", "have no scanner, and all others look at one scene of their own"
            )
        pulses = 0.0
        for sensor in sensors:
            with stages.stage(f"find the pulses of {count:,} tiles"):
                run.scans[sensor.name] = scan = run.scan(sensor, chosen)
            pulses += seconds_of_pulses(scan.sensor, scan.pattern, grid, run.tiling.forest.bounds)
        told = _make_pieces(run, cluster)
        with stages.stage("weigh their files"):
            trials = tuple(_weigh(run, tile, told) for tile in chosen.tolist())
    found = Estimate(len(grid), trials)
    return {
        "tiles": found.count,
        "scanned": len(found.scenes),
        "cpu_hours": [one + (plan + pulses) / 3600 for one in found.whole(found.seconds / 3600)],
        "bytes": found.whole(np.array([one.size for one in found.scenes])),
        "points": found.whole(np.array([one.points for one in found.scenes])),
        "memory_bytes_a_worker": found.peak,
        "plan_cpu_seconds": plan,
        "pulses_cpu_seconds": pulses,
    }


def _weigh(run: TiledRun, tile: int, told: Sequence[SceneOutcome]) -> Trial:
    """Cost of a tile, of which the pieces have been made: seconds of the sensors and of writing, bytes."""
    start, size, points = time.process_time(), 0, 0
    told = [one for one in told if one.scene // LEVELS == tile]
    for scan in run.scans.values():
        parts = [scan.path(piece) for piece in scan.pulses.pieces if piece // LEVELS == tile]
        if parts:
            path = run.out / f"{scan.sensor.name}.laz"
            points += scan.join(path, parts=parts).points
            size += path.stat().st_size
    seconds = {"sensors": sum(one.seconds.get("sensors", 0.0) for one in told)}
    seconds["write"] = time.process_time() - start
    return Trial(seconds, points, size, max((one.peak for one in told), default=0.0))


def _join(run: TiledRun, scan: TiledScan) -> None:
    """One file of a scan, and its note."""
    sensor, pieces = scan.sensor, scan.pulses.pieces
    # some tiles, drawn by chance, are audited
    count = min(math.ceil(run.asked.accuracy.audit * len(pieces)), MOST_AUDITED)
    drawn = np.sort(stream(run.asked.seed, "audit", sensor.name).permutation(pieces)[:count])
    with run.stages.stage(f"audit {count} of {len(pieces)} pieces of {sensor.name}"), hushed():
        audits = {scan.path(piece).stem: scan.audit(piece) for piece in drawn}
    audited = {}
    for name, audit in audits.items():
        run.stages.say_audit(name, audit)
        checks = [check.record() for check in audit.checks]  # no seconds: notes are the same
        audited[name] = {"kept": audit.kept, "checks": checks}
    path = run.out / f"{sensor.name}.laz"
    with run.stages.stage(f"write {path.name}") as progress:
        written = scan.join(path, progress)
    if run.tiling.scene.tiles.files == "copc":
        told = {"forest:seed": run.asked.seed, "forest:sensor": sensor.kind}
        told["forest:command"] = run.command
        made = sorted(path.with_suffix("").glob("*.copc.laz"))
        write_catalogue(path.with_suffix(""), made, run.asked.crs, told)
    files = [path.name] if path.is_file() else []
    files += [str(p.relative_to(run.out)) for p in sorted(path.with_suffix("").glob("*.*"))]
    facts = {"pulses": written.pulses, "points": written.points, "followed": scan.pulses.followed}
    facts["furthest_m"], facts["audits"] = round(scan.pulses.furthest, 3), audited
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
    if result.audit is not None:
        run.stages.say_audit(sensor.name, result.audit)
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
        write_csv(run.out / "leaf_angles.csv", angle_table(tiling.forest.parts(BLOCK)))
        grid = tiling.grid
        every = np.arange(len(grid))
        table: dict[str, Any] = {"tile": [grid.name(tile) for tile in every]}
        for end, corner in zip(("low", "high"), grid.corners(every), strict=True):
            table |= {f"{end}_{axis}_m": corner[:, k] + offset[k] for k, axis in enumerate("xy")}
        table["trees"] = tiling.forest.in_tile
        write_csv(run.out / "tiles.csv", table)
    run.files += ["trees.csv", "leaf_angles.csv", "tiles.csv"]
