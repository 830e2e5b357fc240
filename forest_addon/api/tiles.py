"""A forest larger than memory, grown and looked at tile by tile, with the results of the whole.

``Tiling.of`` draws where all trees stand. ``build`` puts a tile with its buffer into Blender as a scene.
``scan_to`` and ``look`` go from tile to tile by themselves; what they find is what the whole forest gives, to
the bit: rays enter a scene in float32, counted from its middle, so every tile's scene is told the bounds of
the whole (``extent``), and the instances of a scan's labels are numbered as in the whole.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..base.kept import digest
from ..base.progress import Progress
from ..base.rng import stream
from ..formats.ownership import remove
from ..results.coordinates import Offset
from ..results.points import COPC, records
from ..sensing.kinds import choose, kind_of
from ..sensing.lidar.pattern import pattern_of
from ..sensing.rays.geometry import SceneGeometry
from ..spec import Scene, Sensor, SpecError
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
from .world import Site, World

if TYPE_CHECKING:
    from ..results.scan_file import Written
    from ..sensing.audit import Audit
    from ..sensing.lidar.scan import Scan
    from ..sensing.trajectory import Trajectory

PARTS = "parts"


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

    site : its settings and inputs. forest : all trees. grid : its tiles.

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

    @classmethod
    def of(cls, scene: Scene, folder: str | Path = ".", kept: Path | None = None) -> Self:
        """Plan the forest of a scene with ``[tiles]``, and grow its variants.

        kept : what another process wrote of the same forest (``TiledForest.keep``), which is not found again.

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
            return cls(site, TiledForest(plan, grid, kept), grid)

    @property
    def scene(self) -> Scene:
        """Return its settings."""
        return self.site.scene

    @property
    def tiles(self) -> tuple[Tile, ...]:
        """Tiles, row by row from the field's corner."""
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
        """Path of a moving sensor."""
        from ..blender.sensors.observe import Observer

        return way_of(Observer, choose(sensor)[0], along, self.site.folder)

    def world_of(self, rows: np.ndarray) -> World:
        """Rows of trees in Blender, with the bounds of the whole."""
        place = import_blender().context.scene
        from ..blender.scene.forest import build

        part = self.forest.part(rows)
        kind = "points" if self._as_points else "objects"
        field = self.scene.forest.changed(instancing=kind)
        scene = self.scene.changed(forest=field)
        build(place, scene, part, self.site.inputs.terrain, as_assets=False)
        world = World(self.scene, self.site.folder, part, place)
        observer = world.observer
        seen = observer.geometry
        many = np.bincount(seen.mesh_index, minlength=len(seen.meshes))
        trees = np.flatnonzero(seen.tree >= 0)
        meshes, first = np.unique(seen.mesh_index[trees], return_index=True)
        for mesh, tree in zip(meshes, seen.tree[trees[first]], strict=True):
            (key,) = keys_of(self.forest.stand(np.array([tree])))
            many[mesh] = self.forest.counts[key]
        observer.geometry = replace(seen, crowd=tuple(many.tolist()), extent=self.forest.extent)
        return world

    @property
    def _as_points(self) -> bool:
        from ..blender.scene.forest import MANY

        chosen = self.scene.forest.instancing
        return len(self.forest) > MANY if chosen == "auto" else chosen == "points"

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


def _refuse(scene: Scene) -> None:
    """Say what of a scene cannot be cut into tiles."""
    if not isinstance(scene, Scene) or scene.tiles.size <= 0:
        raise SpecError(
            "tiles.size", "is 0: the field is one scene; give the length of a tile's edges"
        )
    refused = {
        "accuracy.detail": (
            scene.accuracy.detail == "auto",
            '"auto" looks at all trees of a variant together, which no tile has; use "full"',
        ),
        "wind.speed": (
            scene.wind.speed > 0,
            "moves trees by the height and leaves of the whole stand, which no tile has; use 0, or take a "
            "smaller field without tiles",
        ),
        "blend": (
            bool(scene.blend),
            "cannot be used with tiles: its objects would stand in the scene of every tile; take one of them "
            "away",
        ),
        "stems": (
            bool(scene.stems),
            "are for reverb, which hears all trunks at once; take tiles away: a million stems are one scene",
        ),
    }
    _refuse_any(refused)


def _refuse_any(refused: Mapping[str, tuple[bool, str]]) -> None:
    """Raise a SpecError of the first key that is asked for, with its sentence."""
    for key, (asked, why) in refused.items():
        if asked:
            raise SpecError(key, why)


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
        if not is_scanner(sensor):
            raise SpecError(getattr(sensor, "name", "scan_to"), "is no scanner; use look")
        self.tiling, self.folder, self.way = tiling, folder, way
        self.sensor, _ = choose(sensor)
        name = self.sensor.name
        receiver = self.sensor.receiver
        refused = {
            "motion": (
                self.sensor.motion,
                "cannot be used with tiles, which stand still; take motion or tiles away",
            ),
            "bounces": (
                self.sensor.bounces,
                "cannot be used with tiles, since light that bounces may go anywhere; leave out bounces, "
                "or tiles",
            ),
            "receiver.beyond": (
                receiver.beyond == "folded",
                "cannot be folded with tiles, since an echo may be of a pulse in another one; take tiles "
                "away",
            ),
            "receiver.sample_ns": (
                receiver.sample_ns > 0,
                "cannot be used with tiles, which keep no waveforms; leave one of them out",
            ),
        }
        _refuse_any({f"{name}.{key}": said for key, said in refused.items()})
        self.pattern = pattern_of(self.sensor, way)
        said = [tiling.forest.digest, asdict(self.sensor), tiling.scene.offset]
        probe = self.pattern.pulses(np.linspace(0, self.pattern.count - 1, 64).astype(np.int64))
        self._digest = digest([said, probe.origin, probe.direction])
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
        """Sentence on how many pulses leave the buffer, and how far; "" of none."""
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
        looks = []
        for one in np.unique(cell).tolist():
            in_cell = cell == one
            low, high = cells.corners(np.array(one))
            wide = float(excess[in_cell].max())
            world = tiling.world_of(tiling.forest.near(low - wide, high + wide))
            looks += list(self._look([number[in_cell]], world))
        rows = np.concatenate([rows for _, rows, _ in looks])
        lost = sorted((one for _, _, some in looks for one in some), key=lambda one: one.first)
        yield len(number), rows[np.argsort(rows["pulse"], kind="stable")], lost

    def _look(
        self, pulses: Iterable[np.ndarray], world: World
    ) -> Iterator[tuple[int, np.ndarray, Sequence[Any]]]:
        with world.still() as observer:
            scan, told = self._scan(observer)
            for many in pulses:
                for first in range(0, len(many), scan.at_once):
                    some = many[first : first + scan.at_once]
                    cloud = scan.look_around_faults(some)
                    yield len(some), told(cloud), cloud.lost

    def _scan(self, observer: Any) -> tuple[Scan, Callable[[Any], np.ndarray]]:
        """The scan in the scene of a tile, and what makes the records of its clouds."""
        from ..sensing.lidar.scan import Scan

        settings, offset = self.tiling.scene, Offset.of(self.tiling.scene)
        number = self.tiling.numbered(observer.geometry)

        def told(cloud: Any) -> np.ndarray:
            returns = replace(cloud.returns, instance=number[cloud.returns.instance])
            return records(replace(cloud, returns=returns), offset)

        folder = self.tiling.site.folder
        return Scan.of(observer.job(self.sensor, settings, folder, self.way)), told

    def audit(self, piece: int) -> Audit:
        """Pulses of a piece that is made, looked at again: their records byte by byte ("figures"), and the
        cloud by the exact way, as the audit of any scan.

        Raises
        ------
        OSError : the part of the piece cannot be read.
        """
        from ..sensing.audit import figures, held
        from ..sensing.lidar.audit import parts_of_scan

        begin, settings = time.perf_counter(), self.tiling.scene
        with self.world(piece).still() as observer:
            scan, told = self._scan(observer)
            sent = next(self.pulses.numbers(piece, AT_ONCE))
            cloud, rows = scan.look_around_faults(sent), rows_of(self.path(piece))
            both = rows[np.isin(rows["pulse"], sent)], told(cloud)
            there, again = ({"records": np.frombuffer(one.tobytes(), np.uint8)} for one in both)
            share, seconds = settings.accuracy.audit, time.perf_counter() - begin
            parts = parts_of_scan(scan, cloud, share, observer.geometry, sent)
            rng = stream(settings.seed, "audit", self.sensor.name, piece)
            return held([*parts, figures(there, again)], rng, seconds)

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
