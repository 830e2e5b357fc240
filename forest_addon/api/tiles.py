"""A forest larger than memory, grown and looked at tile by tile, with the results of the whole.

``Tiling.of`` draws where all trees stand. ``build`` puts a tile with its buffer into Blender as a scene.
``scan_to`` and ``look`` go from tile to tile by themselves; what they find is what the whole forest gives, to
the bit: rays enter a scene in float32, counted from its middle, so every tile's scene is told the bounds of
the whole (``extent``), and the instances of a scan's labels are numbered as in the whole.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..base.places import version
from ..base.progress import Progress
from ..base.rng import stream
from ..base.rows import blocks
from ..formats.ownership import remove
from ..results.coordinates import Offset
from ..results.points import COPC, records
from ..sensing.kinds import choose, kind_of
from ..sensing.rays.geometry import SceneGeometry
from ..spec import Output, Rays, Scene, Sensor, SpecError
from ..stand.forest import ForestPlan, keys_of
from ..tiles import (
    AT_ONCE,
    LEVELS,
    TiledForest,
    TiledPulses,
    TileFiles,
    TileGrid,
    belongs,
    buffer_of,
    is_part,
    join_parts,
    keep_arrays,
    kept_arrays,
    rows_of,
    tiled_pulses,
    write_part,
)
from .given import enough_memory, file_to_write, import_blender, progress_of, way_of
from .results import Result, is_scanner
from .site import Site
from .world import World

if TYPE_CHECKING:
    from ..results.scan_file import Written
    from ..sensing.audit import Audit
    from ..sensing.lidar.scan import Scan
    from ..sensing.trajectory import Trajectory

PARTS = "parts"
PROBED = 1000  # trees, by which two plans are held to be the same


@dataclass(frozen=True)
class Tile:
    """A tile: its number and name (column-row), corners (2,) m, and how many trees are its own."""

    number: int
    name: str
    low: np.ndarray
    high: np.ndarray
    trees: int


@dataclass(frozen=True, eq=False)
class Tiling:
    """A forest that is planned, and built tile by tile.

    site : its settings and inputs. forest : all trees. grid : its tiles. kept : what another process found
    of the same forest (``keep``), so that it need not be found again.

    >>> from forest_addon import api as forest
    >>> bush = forest.Planting(species="hazelnut", variants=1, expected=9, exact=True)
    >>> scene = forest.Scene(seed=1, plantings=(bush,), tiles=forest.Tiles(size=15, buffer=5))
    >>> tiling = forest.Tiling.of(scene)
    >>> len(tiling.tiles), sum(tile.trees for tile in tiling.tiles)
    (4, 9)
    """

    site: Site
    forest: TiledForest
    grid: TileGrid
    kept: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, scene: Scene, folder: str | Path = ".", kept: Path | None = None) -> Self:
        """Plan the forest of a scene with ``[tiles]``, and grow its variants.

        kept : file of ``keep``, taken where it is of the same forest.

        Raises
        ------
        SpecError : a scene that cannot be cut into tiles, says why; as ``build``.
        """
        import_blender()
        _refuse(scene)
        with enough_memory("tiles", "plant fewer trees, or fewer variants"):
            site = Site.of(scene, folder)
            plan = ForestPlan.of(site.scene, site.species, site.inputs)
            grid = TileGrid.of(site.scene.forest, site.scene.tiles.size)
            known = kept_arrays(kept, _said(plan)) if kept else {}
            return cls(site, TiledForest(plan, grid, known), grid, known)

    def keep(self, path: Path) -> None:
        """Write what took time to find, for other processes that plan the same forest.

        Raises
        ------
        OSError : it cannot be written.
        """
        found = {"digest": self.digest, "extent": np.array(self.extent, dtype=float)}
        keep_arrays(path, _said(self.forest.plan), self.forest.tables | found)

    @property
    def scene(self) -> Scene:
        """Return its settings."""
        return self.site.scene

    @property
    def tiles(self) -> tuple[Tile, ...]:
        """Return all tiles, row by row from the field's corner."""
        low, high = self.grid.corners(np.arange(len(self.grid)))
        return tuple(
            Tile(number, self.grid.name(number), low[number], high[number], count)
            for number, count in enumerate(self.forest.in_tile.tolist())
        )

    def build(self, tile: int, buffer: float | None = None) -> World:
        """Put a tile's trees into Blender with those whose crowns reach within its buffer.

        tile : its number. buffer : m; left out: that of the settings.

        Raises
        ------
        SpecError : there is no such tile; something that stands in Blender is in the way.
        """
        if not 0 <= tile < len(self.grid):
            raise SpecError("tile", f"{tile} is not there; use 0 to {len(self.grid) - 1}")
        wide = self.scene.tiles.buffer if buffer is None else buffer
        low, high = self.grid.corners(np.array(tile))
        return self.world_of(self.forest.near(low - wide, high + wide))

    def scan_to(
        self,
        path: str | Path,
        sensor: Any,
        *,
        resume: bool = False,
        progress: Progress | None = None,
        along: Trajectory | None = None,
    ) -> Written:
        """Run a scan through all tiles into a file, the same bytes as ``World.scan_to`` of the whole forest.

        path : .laz, .las, .copc.laz, .ply or .npz; files of tiles, where the settings want them, go to a
        folder of the same name. resume : take the parts that a run that was ended had finished.

        Raises
        ------
        SpecError : settings that cannot be served in tiles. OSError : it cannot be written; parts stay.
        """
        path = file_to_write(path)
        progress_of(progress)
        folder = path.with_name(f"{path.name}.{PARTS}")
        work = TiledScan(self, sensor, folder, self.way(sensor, along))
        todo = work.todo(resume)
        for done, piece in enumerate(todo):
            work.make(piece)
            if progress:
                progress(done + 1, len(todo))
        return work.join(path)

    def look(
        self, sensor: Sensor, progress: Progress | None = None, along: Trajectory | None = None
    ) -> Result:
        """The result of a sonar, or of a tractor's scanner: in one scene of all trees within its range of
        every place that it looks from, whichever tiles they are in.

        Raises
        ------
        SpecError : a sensor whose reach is not bounded, or that goes through tiles with ``scan_to``.
        """
        if is_scanner(sensor):
            raise SpecError(sensor.name, "goes from tile to tile by scan_to, not by look")
        return self.hearing(sensor, along).look(sensor, progress, along)

    def hearing(self, sensor: Sensor, along: Trajectory | None = None) -> World:
        """Put all trees that a sensor can reach from any place of its way into Blender.

        Raises
        ------
        SpecError : a sensor whose reach is not bounded.
        """
        return self.world_of(self.reachable(sensor, along))

    def reachable(self, sensor: Sensor, along: Trajectory | None = None) -> np.ndarray:
        """Rows of the trees that a sensor can reach from any place of its way, and some beyond.

        Raises
        ------
        SpecError : a sensor whose reach is not bounded.
        """
        name = getattr(sensor, "name", "look")
        sensor, _ = choose(sensor)
        look = kind_of(sensor).look(sensor)
        way = self.way(sensor, along)
        places = look.corners if way is None else way.position
        if places is None or not np.isfinite(look.range):
            why = "hears all trees of a forest at once; run it in a scene without tiles"
            raise SpecError(name, why)
        # Leaves are searched by spheres around blocks, which may reach beyond as far as a tree is long.
        reach = look.range + self.forest.across + look.slack
        return self.forest.within(reach, np.asarray(places))

    def way(self, sensor: Sensor, along: Trajectory | None = None) -> Trajectory | None:
        """Return where a moving sensor goes."""
        from ..blender.sensors.observe import Observer

        return way_of(Observer, choose(sensor)[0], along, self.site.folder)

    def world_of(self, rows: np.ndarray) -> World:
        """Rows of trees in Blender, with the bounds of the whole."""
        place = import_blender().context.scene
        from ..blender.site import build_site

        part = self.forest.part(rows)
        kind = "points" if self._as_points else "objects"
        field = self.scene.forest.changed(instancing=kind)
        site = replace(self.site, scene=self.scene.changed(forest=field))
        build_site(place, site, part, as_assets=False)
        world = World(self.scene, self.site.folder, part, place)
        observer = world.observer
        seen = observer.geometry
        observer.geometry = replace(seen, crowd=self._crowd(seen), extent=self.extent)
        return world

    @property
    def _as_points(self) -> bool:
        from ..blender.scene.forest import MANY

        chosen = self.scene.forest.instancing
        return len(self.forest) > MANY if chosen == "auto" else chosen == "points"

    def _crowd(self, geometry: SceneGeometry) -> tuple[int, ...]:
        """Return how many instances each mesh of a tile's scene has in the whole."""
        many = np.bincount(geometry.mesh_index, minlength=len(geometry.meshes))
        trees = np.flatnonzero(geometry.tree >= 0)
        meshes, first = np.unique(geometry.mesh_index[trees], return_index=True)
        for mesh, tree in zip(meshes, geometry.tree[trees[first]], strict=True):
            (key,) = keys_of(self.forest.stand(np.array([tree])))
            many[mesh] = self.forest.counts[key]
        return tuple(many.tolist())

    @cached_property
    def extent(self) -> np.ndarray | None:
        """(2, 3) lowest and highest corner of all trees' boxes; None without any."""
        if not len(self.forest.outermost):
            return None
        if "extent" in self.kept:
            return np.asarray(self.kept["extent"])
        part = self.forest.part(self.forest.outermost)
        keys = keys_of(part.stand)
        number = {key: k for k, key in enumerate(keys)}
        pairs = zip(part.stand.species.tolist(), part.stand.variant.tolist(), strict=True)
        low, high = SceneGeometry(
            meshes=tuple(part.variants[key].mesh for key in keys),
            transform=part.transforms(),
            mesh_index=np.array([number[pair] for pair in pairs]),
            object_name=(),
            tree=part.stand.id,
            species=part.stand.species,
            object_index=part.stand.id,
            crowd=tuple(self.forest.counts[key] for key in keys),
        ).bounds()
        found = np.isfinite(low).all(axis=1)
        return np.array([low[found].min(axis=0), high[found].max(axis=0)]) if found.any() else None

    def numbered(self, geometry: SceneGeometry) -> np.ndarray:
        """(I + 1,) numbers that instances of a tile's scene have in that of the whole; -1 of none, last."""
        trees = np.flatnonzero(geometry.tree >= 0)
        others = np.flatnonzero(geometry.tree < 0)
        number = np.full(len(geometry) + 1, -1, dtype=np.int64)
        number[trees], number[others] = geometry.tree[trees], np.arange(len(others))
        if self._as_points:  # by variant, behind all else
            number[trees] = self.forest.by_variant[number[trees]] + len(others)
        else:
            number[others] += len(self.forest)
        return number

    @cached_property
    def digest(self) -> str:
        """Return what decides what rays meet in the forest, in one number."""
        if self.kept:
            return str(self.kept["digest"])
        total = _decided(self.scene)
        for rows in blocks(len(self.forest)):
            stand = self.forest.stand(rows)
            for array in (stand.position, stand.rotation, stand.scale, stand.sink, stand.variant):
                total.update(np.ascontiguousarray(array).view(np.uint8).data)
        for tree in self.forest.trees.values():
            total.update(np.ascontiguousarray(tree.mesh.vertices).view(np.uint8).data)
        return total.hexdigest()


def _decided(scene: Scene) -> Any:
    """The hash of what settings decide of a forest."""
    rays = Rays(engine=scene.rays.engine)  # their number of threads decides nothing
    tiles = scene.tiles.changed(files="merged")
    scene = scene.changed(sensors=(), output=Output(), rays=rays, tiles=tiles)
    said = [version(), asdict(scene)]
    text = json.dumps(said, sort_keys=True, default=str)
    return hashlib.blake2b(text.encode(), digest_size=16)


def _said(plan: ForestPlan) -> str:
    """The settings of a plan, and some of its trees, in one number."""
    total, stand = _decided(plan.scene), plan.measured.stand
    some = stand.select(np.arange(0, len(stand), len(stand) // PROBED + 1))
    for array in (some.position, some.rotation, some.scale, some.variant, np.array(len(stand))):
        total.update(np.ascontiguousarray(array).view(np.uint8).data)
    return str(total.hexdigest())


def _refuse(scene: Scene) -> None:
    """Say what of a scene cannot be cut into tiles."""
    if not isinstance(scene, Scene) or scene.tiles.size <= 0:
        raise SpecError(
            "tiles.size", "is 0: the field is one scene; give the length of a tile's edges"
        )
    if scene.accuracy.detail == "auto":
        why = "looks at all trees of a variant together, which tiles do not have"
        raise SpecError("accuracy.detail", f'"auto" {why}; use "full"')
    if scene.wind.speed > 0:
        raise SpecError("wind.speed", "cannot be used with tiles; use 0, or take tiles away")
    if scene.blend:
        why = "cannot be used with tiles: its objects would stand in the scene of every tile"
        raise SpecError("blend", f"{why}; take one of them away")
    if scene.stems:
        raise SpecError("stems", "are for reverb, which hears all of a forest; take tiles away")


class TiledScan:
    """A scan in tiles: its pieces, made in any order by any process, and joined at the end.

    tiling : the ``Tiling`` of its forest. folder : where parts lie until then. only : tiles (T,) that are
    wanted; left out: all.

    Raises
    ------
    SpecError : a sensor that cannot be served in tiles.
    """

    def __init__(
        self,
        tiling: Any,
        sensor: Any,
        folder: Path,
        way: Trajectory | None = None,
        only: np.ndarray | None = None,
    ) -> None:
        from ..sensing.lidar.pattern import pattern_of

        if not is_scanner(sensor):
            raise SpecError(getattr(sensor, "name", "scan_to"), "is no scanner; use look")
        self.tiling, self.folder, self.way = tiling, folder, way
        self.sensor, _ = choose(sensor)
        name = self.sensor.name
        if self.sensor.motion:
            raise SpecError(
                f"{name}.motion", "cannot be used with tiles; take motion or tiles away"
            )
        if self.sensor.bounces:
            why = "cannot be used with tiles, since light that bounces may go anywhere"
            raise SpecError(f"{name}.bounces", f"{why}; leave out bounces, or tiles")
        if self.sensor.receiver.beyond == "folded":
            why = "cannot be folded with tiles, since an echo may be of a pulse in another one"
            raise SpecError(f"{name}.receiver.beyond", f"{why}; take tiles away")
        self.pattern = pattern_of(self.sensor, way)
        said = [tiling.digest, asdict(self.sensor), tiling.scene.offset]
        total = hashlib.blake2b(json.dumps(said, sort_keys=True, default=str).encode())
        probe = self.pattern.pulses(np.linspace(0, self.pattern.count - 1, 64).astype(np.int64))
        for array in (probe.origin, probe.direction):
            total.update(np.ascontiguousarray(array).view(np.uint8).data)
        self._digest = total.hexdigest()[:32]
        kept = {} if only is not None else kept_arrays(self.path_of_pulses, self._digest)
        known = tiling.grid, tiling.forest.bounds, tiling.scene.tiles.buffer, only
        self.pulses: TiledPulses = (
            TiledPulses(**kept) if kept else tiled_pulses(self.sensor, self.pattern, *known)
        )

    @property
    def path_of_pulses(self) -> Path:
        """Path of the file that tells other processes which pulses belong to which piece."""
        return self.folder / f"{self.sensor.name}.pulses.npz"

    def keep_pulses(self) -> None:
        """Write for other processes which pulses belong to which piece."""
        keep_arrays(self.path_of_pulses, self._digest, vars(self.pulses))

    @property
    def followed(self) -> str:
        """Return how many pulses leave the buffer, and how far, in a sentence; "" of none."""
        pulses = self.pulses
        if not pulses.followed:
            return ""
        return (
            f"{self.sensor.name}: {pulses.followed:,} of {pulses.count:,} pulses lead beyond the buffer of "
            f"{self.tiling.scene.tiles.buffer:g} m, up to {pulses.furthest:,.0f} m from their tile; they are "
            "followed in larger scenes"
        )

    def path(self, piece: int) -> Path:
        """Path of the part of a piece."""
        tile, level = divmod(int(piece), LEVELS)
        name = self.tiling.grid.name(tile)
        return self.folder / f"{self.sensor.name}-{name}-{level}.rows"

    def todo(self, resume: bool) -> list[int]:
        """Pieces that have no finished part; all of them, and a new folder, where it begins anew."""
        self.folder.mkdir(parents=True, exist_ok=True)
        every: list[int] = self.pulses.pieces.tolist()
        if not resume:
            for piece in every:
                remove(self.path(piece).with_suffix(".json"))
            return every
        return [piece for piece in every if not self.is_made(piece)]

    def is_made(self, piece: int) -> bool:
        """Return whether the part of a piece is finished."""
        return is_part(self.path(piece), self._digest)

    def make(self, piece: int, world: World | None = None, cuts: int = 1) -> None:
        """Trace the pulses of a piece into its part.

        world : its scene, where that stands already. cuts : along each edge of the tile; its scene is built
        in so many times so many smaller ones, one after the other, with the same result.
        """
        if cuts > 1:
            write_part(self.path(piece), self._digest, self._in_cells(piece, cuts))
            return
        world = self.world(piece) if world is None else world
        pulses = self.pulses.numbers(piece, AT_ONCE)
        write_part(self.path(piece), self._digest, self._look(pulses, world))

    def world(self, piece: int) -> World:
        """Put the scene of a piece into Blender."""
        tile, level = divmod(int(piece), LEVELS)
        return self.tiling.build(tile, buffer_of(level, self.tiling.scene.tiles.buffer))

    def _in_cells(self, piece: int, cuts: int) -> Iterator[tuple[int, np.ndarray, Sequence[Any]]]:
        """Pulses of a piece by cells of its tile, each in the trees that they can meet."""
        tiling, number = self.tiling, np.concatenate([*self.pulses.numbers(piece, AT_ONCE)])
        cells = TileGrid.of(tiling.scene.forest, tiling.grid.size / cuts)
        pulses = self.pattern.pulses(number)
        cell, excess = belongs(self.sensor, pulses, cells, tiling.forest.bounds)
        found = []
        for one in np.unique(cell).tolist():
            mine = cell == one
            low, high = cells.corners(np.array(one))
            wide = float(excess[mine].max())
            world = tiling.world_of(tiling.forest.near(low - wide, high + wide))
            found += list(self._look([number[mine]], world))
        rows = np.concatenate([rows for _, rows, _ in found])
        lost = sorted((one for _, _, some in found for one in some), key=lambda one: one.first)
        yield len(number), rows[np.argsort(rows["pulse"], kind="stable")], lost

    def _look(
        self, pulses: Iterable[np.ndarray], world: World
    ) -> Iterator[tuple[int, np.ndarray, Sequence[Any]]]:
        with self._ready(world) as (scan, _, told):
            for many in pulses:
                for first in range(0, len(many), scan.at_once):
                    some = many[first : first + scan.at_once]
                    cloud = scan.look_around_faults(some)
                    yield len(some), told(cloud), cloud.lost

    @contextmanager
    def _ready(self, world: World) -> Iterator[tuple[Scan, Any, Callable[[Any], np.ndarray]]]:
        """The scan in a tile's world, its geometry, and what makes the records of a cloud."""
        from ..sensing.lidar.scan import Scan

        tiling = self.tiling
        with world.still() as observer:
            observer.prepare(self.sensor, self.way)
            number = tiling.numbered(observer.geometry)

            def told(cloud: Any) -> np.ndarray:
                returns = replace(cloud.returns, instance=number[cloud.returns.instance])
                return records(replace(cloud, returns=returns), Offset.of(tiling.scene))

            eyes = observer.eyes(self.sensor)
            yield Scan(self.sensor, eyes, tiling.scene.seed, self.way), observer.geometry, told

    def audit(self, piece: int) -> Audit:
        """Pulses of a piece that is made, looked at again: their records to the byte, and the cloud that they
        are of by the exact way, as the audit of any scan.

        Raises
        ------
        OSError : the part of the piece cannot be read.
        """
        from ..sensing.audit import AuditPart, held
        from ..sensing.lidar.audit import parts_of_scan

        begin, seed = time.perf_counter(), self.tiling.scene.seed
        with self._ready(self.world(piece)) as (scan, geometry, told):
            sent = next(self.pulses.numbers(piece, AT_ONCE))
            cloud = scan.look_around_faults(sent)
            there, again = rows_of(self.path(piece)), told(cloud)
            there = there[(there["pulse"] >= sent[0]) & (there["pulse"] <= sent[-1])]
            wrong = np.inf if there.tobytes() != again.tobytes() else 0.0
            alike = AuditPart(1, lambda _: np.array([wrong]), (("tiles made again", 0.0, ""),))
            share = self.tiling.scene.accuracy.audit
            parts = parts_of_scan(scan, cloud, share, geometry, sent)
            made, rng = time.perf_counter(), stream(seed, "audit", self.sensor.name, piece)
            found = held([*parts, alike], rng, made - begin)
            return replace(found, audit_seconds=time.perf_counter() - made)

    def join(
        self,
        path: Path,
        progress: Progress | None = None,
        parts: Sequence[Path] | None = None,
    ) -> Written:
        """Join the parts, which are all finished, into the files that the settings ask for; parts : some
        of them, into one file."""
        tiling, wanted = self.tiling, self.tiling.scene.tiles.files
        if parts is not None:
            wanted = "merged"
        else:
            parts = [self.path(piece) for piece in self.pulses.pieces]
        of_tiles = None
        if wanted != "merged":
            folder = path.with_name(path.name.partition(".")[0])
            folder.mkdir(parents=True, exist_ok=True)
            of_tiles = TileFiles(
                tiling.grid, folder, wanted != "both", COPC if wanted == "copc" else ""
            )
        written = join_parts(
            path,
            parts,
            self.sensor,
            tiling.scene.seed,
            self.pulses.count,
            offset=Offset.of(tiling.scene),
            tiles=of_tiles,
            progress=progress,
        )
        for part in parts:
            part.with_suffix(".json").unlink()
            part.unlink()
        self.path_of_pulses.unlink(missing_ok=True)
        if not any(self.folder.iterdir()):
            self.folder.rmdir()
        return written
