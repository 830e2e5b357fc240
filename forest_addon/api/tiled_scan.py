"""A scan that goes from tile to tile: pieces in any order and process, joined at the end."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.progress import Progress
from ..formats.ownership import remove
from ..results.coordinates import Offset
from ..results.points import records
from ..results.scan_parts import TileFiles, join_parts, read_note, write_part
from ..sensing.kinds import choose
from ..sensing.lidar.scan import LEVELS, TiledPulses, buffer_of, tiled_pulses
from ..spec import SpecError
from .results import is_scanner
from .world import World

if TYPE_CHECKING:
    from ..results.scan_file import Written
    from ..sensing.lidar.scan import Scan
    from ..sensing.trajectory import Trajectory


class TiledScan:
    """A scan in tiles: its pieces, made in any order by any process, and joined at the end.

    tiling : the ``Tiling`` of its forest. folder : where parts lie until then.

    Raises
    ------
    SpecError : a sensor that cannot be served in tiles.
    """

    def __init__(
        self, tiling: Any, sensor: Any, folder: Path, way: Trajectory | None = None
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
        forest = tiling.forest
        heights = (forest.low, forest.high) if len(forest.stand) else (0.0, 0.0)
        self.pulses: TiledPulses = tiled_pulses(
            self.sensor, self.pattern, tiling.grid, heights, tiling.scene.tiles.buffer
        )
        said = [tiling.digest, asdict(self.sensor), tiling.scene.offset]
        total = hashlib.blake2b(json.dumps(said, sort_keys=True, default=str).encode())
        probe = self.pattern.pulses(np.linspace(0, self.pattern.count - 1, 64).astype(np.int64))
        for array in (probe.origin, probe.direction):
            total.update(np.ascontiguousarray(array).view(np.uint8).data)
        self._digest = total.hexdigest()[:32]

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
        return read_note(self.path(piece), self._digest) is not None

    def make(self, piece: int, world: World | None = None) -> None:
        """Trace the pulses of a piece into its part; world : its scene, where that stands already."""
        world = self.world(piece) if world is None else world
        with world.still():
            write_part(self.path(piece), self._digest, self._look(piece, world))

    def world(self, piece: int) -> World:
        """Put the scene of a piece into Blender."""
        tile, level = divmod(int(piece), LEVELS)
        return self.tiling.build(tile, buffer_of(level, self.tiling.scene.tiles.buffer))

    def _look(self, piece: int, world: World) -> Iterator[tuple[int, np.ndarray, Sequence[Any]]]:
        from ..sensing.lidar.scan import Scan

        tiling, observer = self.tiling, world.observer
        observer.prepare(self.sensor, self.way)
        scan: Scan = Scan(self.sensor, observer.eyes(self.sensor), tiling.scene.seed, self.way)
        number = tiling.numbered(observer.geometry)
        offset = Offset.of(tiling.scene)
        for some in self.pulses.numbers(piece, scan.at_once):
            cloud = scan.look_around_faults(some)
            returns = replace(cloud.returns, instance=number[cloud.returns.instance])
            yield len(some), records(replace(cloud, returns=returns), offset), cloud.lost

    def join(self, path: Path, progress: Progress | None = None) -> Written:
        """Join the parts, which are all finished, into the files that the settings ask for."""
        tiling, wanted = self.tiling, self.tiling.scene.tiles.files
        parts = [self.path(piece) for piece in self.pulses.pieces]
        of_tiles = None
        if wanted != "merged":
            folder = path.with_name(path.name.partition(".")[0])
            folder.mkdir(parents=True, exist_ok=True)
            of_tiles = TileFiles(tiling.grid, folder, alone=wanted == "tiles")
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
        if not any(self.folder.iterdir()):
            self.folder.rmdir()
        return written
