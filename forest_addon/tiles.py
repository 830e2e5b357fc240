"""A forest in tiles: where each lies, which trees and pulses are its own, and the parts of a scan.

Places, ages, spacing, competition and sizes are those of the whole field, drawn at once: they take some
hundred bytes a tree and depend on no tile. What takes memory by the tree (instances, their boxes in a ray
engine, leaves) is made for some rows of it at a time.

Only the part of a beam between the lowest and the highest leaf of the forest can meet a tree. A pulse belongs
to the tile over which it comes into that layer, and its *excess* is how far the path within, with the width
of the beam, leads beyond the tile's edges. Where that is no more than the buffer, the tile's scene holds
every tree that the pulse can meet. Others are followed: they are traced in the smallest scene about the same
tile, of buffers that double, in which their path ends. So no pulse is ever traced in less than it can meet.

A piece of a scan, a tile with one width of buffer, is a file of records sorted by pulse. It is complete or
not there: rows go to a temporary name, and what they are of (a ``ScanState``) is written last. Joined by the
number of their pulses, the pieces are what the scan of the whole forest writes, byte by byte.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from .base.kept import LastAsked, digest
from .base.places import version
from .base.progress import Progress
from .base.rows import Drawn, blocks, distinct, slots
from .formats.atomic import partial_of, replacing
from .formats.ply import PlyFile
from .growth.tree import Tree
from .results.coordinates import NO_OFFSET, Offset
from .results.points import POINT
from .results.scan_file import ScanState, Written, comments_of, finish, stem_of
from .sensing.lidar.cloud import Lost, together
from .sensing.lidar.footprint import reach
from .sensing.lidar.pattern import LiDAR, Pattern, Pulses
from .sensing.looks import Upright
from .sensing.rays.geometry import SceneGeometry, boxes_of
from .spec import Forest, Output, Rays, Scanner, Scene
from .stand.forest import ForestPlan, GrownForest, counts_of, keys_of
from .stand.intensity.surface import sink
from .stand.plan import Stand, labels

KEPT = 2_000_000_000  # bytes of grown variants that stay in memory
TURNED = 1.5  # times its reach that the box around a turned tree may reach; the root of 2, and some
SAME = 1e-6  # m, for rounding
SLACK = 0.01  # metres that a tree may reach beyond what its mesh says, for rounding
Key = tuple[int, int]  # planting and variant
TABLES = (  # of a planned forest, which take time to find
    *("_foot", "_wide", "_least", "_top", "_first", "_by_tile", "in_tile", "across", "most"),
    *("low", "high", "bounds", "outermost", "by_variant", "extent", "digest"),
)
AT_ONCE = 262_144  # pulses
SPARSE = 16  # of so many pulses one is looked at where few tiles are wanted
PROBED = 1000  # trees, by which two plans are held to be the same
LEVELS = 32  # of buffers; the first is that of the settings
FIRST = 10.0  # metres: the least buffer that is doubled
SPARE = 0.01  # metres about a path, for rounding
WINDOW = 1_000_000  # points, about, that are joined at a time
HEAD = b"FSPART1\n"  # before the records


def keep_arrays(path: Path, said: str, arrays: Mapping[str, Any]) -> None:
    """Write arrays and numbers to an .npz for other processes; said : what decides them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial:
        np.savez(partial, said=said, **arrays)


def kept_arrays(path: Path, said: str) -> dict[str, Any]:
    """Read what ``keep_arrays`` wrote of the same; nothing where there is none."""
    if not path.is_file():
        return {}
    with np.load(path) as data:
        arrays = {name: value if value.ndim else value.item() for name, value in data.items()}
    return arrays if arrays.pop("said", None) == said else {}


@dataclass(frozen=True)
class TileGrid:
    """Tiles of a field, half-open squares counted from its corner; the last of a row or column end with it.

    low, high : (2,) corners of the field, m. size : m. count : along x and y.
    """

    low: np.ndarray
    high: np.ndarray
    size: float
    count: tuple[int, int]

    @classmethod
    def of(cls, field: Forest, size: float) -> TileGrid:
        """The tiles of a field."""
        low = np.array(field.origin)
        across = np.maximum(np.ceil(np.array(field.size) / size - 1e-9), 1).astype(int)
        return cls(low, low + field.size, size, (int(across[0]), int(across[1])))

    def __len__(self) -> int:
        return self.count[0] * self.count[1]

    def tile_of(self, points: np.ndarray) -> np.ndarray:
        """(N,) number of the tile that points (N, 2) lie in; of what lies beyond the field the nearest."""
        place = np.floor((points - self.low) / self.size)
        column, row = np.clip(place, 0, np.array(self.count) - 1).astype(np.int64).T
        return np.asarray(row * self.count[0] + column)

    def corners(self, tile: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, 2), (N, 2) lowest and highest coordinates of tiles (N,)."""
        row, column = np.divmod(np.asarray(tile), self.count[0])
        low = self.low + self.size * np.stack([column, row], axis=-1)
        return low, np.minimum(low + self.size, np.maximum(self.high, low))

    def name(self, tile: int) -> str:
        """Return a tile's name: its column and row from the field's corner."""
        row, column = divmod(int(tile), self.count[0])
        return f"{column}-{row}"


class KeptTrees(Mapping[Key, Tree]):
    """The variants of a forest's plan, grown when they are asked for; the latest stay in memory."""

    def __init__(self, plan: ForestPlan, keys: Collection[Key]) -> None:
        self._plan, self._keys = plan, keys
        self._trees: LastAsked[Key, Tree] = LastAsked(KEPT, lambda tree: tree.nbytes)

    def __getitem__(self, key: Key) -> Tree:
        return self._trees.once(key, lambda: self._plan.tree(*key))

    def __iter__(self) -> Iterator[Key]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)


class TiledForest:
    """A forest that is planned and has not grown but for its variants. Of each tree it keeps its place and
    two whole numbers; all else is drawn again where it is asked for (``Drawn``).

    plan : of it. counts : trees of each (planting, variant). most : m that any tree reaches to the sides of
    its foot. across : m, the largest distance between two points of one tree. low, high : lowest and highest
    coordinate z of any tree. bounds : (2, 3) lowest and highest corner of the box that all trees are in.
    outermost : rows of those that may reach to the bounds of the whole. in_tile : (T,) trees of each tile.
    notes : of the plan. kept : file of ``keep``, taken where it is of the same forest.
    """

    def __init__(self, plan: ForestPlan, grid: TileGrid, kept: Path | None = None) -> None:
        self.plan, self._grid, self.notes = plan, grid, plan.notes()
        self.counts = counts_of(plan.measured.stand)
        self.trees = KeptTrees(plan, self.counts)
        drawn, ground = plan.measured.stand, plan.inputs.ground(plan.scene.forest.terrain.base)

        def sunk(rows: np.ndarray) -> np.ndarray:
            radius = self._foot[drawn.species[rows], drawn.variant[rows]] * drawn.scale[rows]
            return sink(ground, drawn.position[rows][:, :2], radius)

        alone: Any = Drawn(len(drawn), sunk)
        is_drawn = isinstance(drawn.scale, Drawn)
        self._stand = replace(drawn, sink=alone) if is_drawn else plan.placed(self.trees)
        known = kept_arrays(kept, self._said) if kept else {}
        vars(self).update(known)
        if not known:
            self._measure()

    def keep(self, path: Path) -> None:
        """Write what took time to find, for other processes that plan the same forest.

        Raises
        ------
        OSError : it cannot be written.
        """
        tables = {name: getattr(self, name) for name in TABLES}
        keep_arrays(path, self._said, {k: v for k, v in tables.items() if v is not None})

    @property
    def _said(self) -> str:
        """The settings and some of the trees, in one number."""
        settings, stand = _decisive(self.plan.scene), self.plan.measured.stand
        some = stand.select(np.arange(0, len(stand), len(stand) // PROBED + 1))
        arrays = some.position, some.rotation, some.scale, some.variant
        return digest([settings, len(stand), *arrays])

    def _measure(self) -> None:
        """Find how far trees of each variant reach, the bounds of all, and which stand in which tile."""
        grid = self._grid
        shape = np.max([(0, 0), *self.counts], axis=0) + 1
        # Of each variant in its own size: m to the sides, its ends in z, the longest way through it.
        self._wide, self._least, self._top, through, self._foot = np.zeros((5, *shape))
        for key, tree in self.trees.items():
            self._foot[key] = tree.skeleton.radius[:1, 0].sum()
            low, high = boxes_of(tree.mesh, 1)
            if len(low):
                used = tree.mesh.vertices[np.isfinite(tree.mesh.vertices).all(axis=1)]
                self._wide[key] = np.hypot(*used[:, :2].T).max()
                self._least[key], self._top[key] = low[0, 2], high[0, 2]
                through[key] = np.linalg.norm(np.ptp(used, axis=0))
        tile = np.empty(len(self), dtype=np.min_scalar_type(len(grid)))  # 16 bits: a fast sort
        self.in_tile, self.across, self.most = np.zeros(len(grid), dtype=np.int64), 0.0, 0.0
        least, most, outer = np.full(3, np.inf), np.full(3, -np.inf), list[np.ndarray]()
        for rows in blocks(len(self)):
            stand = self.stand(rows)
            place, key = stand.position[:, :2], (stand.species, stand.variant)
            tile[rows] = grid.tile_of(place)
            self.in_tile += np.bincount(tile[rows], minlength=len(grid))
            self.across = max(self.across, float((stand.scale * through[key]).max()))
            reach, bottom, top = self._ends(stand)
            self.most = max(self.most, float(reach.max()))
            least = np.minimum(least, [*place.min(axis=0), bottom.min()])
            most = np.maximum(most, [*place.max(axis=0), top.max()])
            outer.append(stand.id[_outer(place, reach, bottom, top)])
        self.low, self.high = float(least[2]) - SLACK, float(most[2]) + SLACK
        self.bounds = np.zeros((2, 3))
        self.outermost = np.concatenate([*outer, np.empty(0, dtype=np.int64)])
        if outer:
            stand = self.stand(self.outermost)
            some = _outer(stand.position[:, :2], *self._ends(stand))
            self.outermost = self.outermost[some]
            self.bounds[0] = *(least[:2] - self.most), self.low
            self.bounds[1] = *(most[:2] + self.most), self.high
        self._first = np.append(0, np.cumsum(self.in_tile))
        self._by_tile, free = np.empty(len(self), dtype=np.int32), self._first[:-1].copy()
        for rows in blocks(len(self)):
            self._by_tile[slots(tile[rows], free)] = np.arange(rows.start, rows.stop)

    def __len__(self) -> int:
        return len(self._stand)

    def stand(self, rows: np.ndarray | slice = slice(None)) -> Stand:
        """Rows of the trees, in their sizes, with their feet in the ground; all of them if left out."""
        return self._stand.select(rows)

    def _ends(self, stand: Stand) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(N,) metres that trees reach to the sides of their feet, and coordinates z of their ends."""
        key, foot = (stand.species, stand.variant), stand.position[:, 2] - stand.sink
        reach = stand.scale * self._wide[key] + SLACK
        return reach, foot + stand.scale * self._least[key], foot + stand.scale * self._top[key]

    def near(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Rows of the trees of which any part may stand over a rectangle, m; crowns that reach in count."""
        corners = self._grid.tile_of(np.array([low - self.most, high + self.most]))
        (begin, end), wide = corners.tolist(), self._grid.count[0]
        across = end % wide - begin % wide + 1
        lines = range(begin, end - across + 2, wide)
        some = [self._by_tile[self._first[k] : self._first[k + across]] for k in lines]
        rows = np.sort(np.concatenate(some)).astype(np.int64)
        place = self._stand.position[rows][:, :2]
        away = np.hypot(*np.maximum(np.maximum(low - place, place - high), 0.0).T)
        rows, away = rows[away <= self.most], away[away <= self.most]
        return rows[away <= self._ends(self.stand(rows))[0]]

    def within(self, distance: float, places: np.ndarray) -> np.ndarray:
        """Rows of the trees that lie so near, m, to a way through places (P, 3), or may do."""
        found = [np.empty(0, dtype=np.int64)]
        for rows in blocks(len(self)):
            stand = self.stand(rows)
            ends = np.full((2, len(stand)), [[self.low], [self.high]])
            trees = Upright(stand.position[:, :2], self._ends(stand)[0], *ends)
            found.append(stand.id[trees.distance(places) <= distance])
        return np.concatenate(found)

    @cached_property
    def by_variant(self) -> np.ndarray:
        """(N,) place of each tree where those of one variant stand side by side, in order: in the scene of a
        whole forest whose trees are points."""
        number, count = np.empty(len(self), dtype=np.int32), np.zeros(self._wide.shape, dtype=int)
        for key, trees in self.counts.items():
            count[key] = trees
        free, stand = np.cumsum(count) - count.ravel(), self._stand
        for rows in blocks(len(self)):
            code = stand.species[rows] * self._wide.shape[1] + stand.variant[rows]
            number[rows] = slots(code, free)
        return number

    def part(self, rows: np.ndarray | slice) -> GrownForest:
        """Trees ``rows`` as a forest, with the numbers that they have in the whole."""
        plan, stand, measured = self.plan, self.stand(rows), self.plan.measured
        return GrownForest(
            stand=stand,
            labels=tuple(labels(plan.scene.plantings)),
            species=tuple(species for species, _ in plan.species),
            variants={key: self.trees[key] for key in keys_of(stand)},
            wanted=measured.trees[rows] if measured.variants else None,
            laws=measured.laws,
        )

    @cached_property
    def extent(self) -> np.ndarray | None:
        """(2, 3) lowest and highest corner of all trees' boxes; None without any."""
        if not len(self.outermost):
            return None
        part = self.part(self.outermost)
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
            crowd=tuple(self.counts[key] for key in keys),
        ).bounds()
        has_boxes = np.isfinite(low).all(axis=1)
        return (
            np.array([low[has_boxes].min(axis=0), high[has_boxes].max(axis=0)])
            if has_boxes.any()
            else None
        )

    @cached_property
    def digest(self) -> str:
        """Digest of all that decides what rays meet in the forest."""
        stands = map(self.stand, blocks(len(self)))
        placed = (digest([s.position, s.rotation, s.scale, s.sink, s.variant]) for s in stands)
        grown = [tree.mesh.vertices for tree in self.trees.values()]
        return digest([_decisive(self.plan.scene), *placed, *grown])

    def parts(self, at_once: int) -> Iterator[GrownForest]:
        """All trees, so many at a time."""
        for first in range(0, max(len(self), 1), at_once):
            yield self.part(np.arange(first, min(first + at_once, len(self))))


def _decisive(scene: Scene) -> list[Any]:
    """Version and settings that decide a forest."""
    rays = Rays(engine=scene.rays.engine)  # their number of threads decides nothing
    tiles = scene.tiles.changed(files="merged")
    scene = scene.changed(sensors=(), output=Output(), rays=rays, tiles=tiles)
    return [version(), asdict(scene)]


def _outer(place: np.ndarray, reach: np.ndarray, bottom: np.ndarray, top: np.ndarray) -> np.ndarray:
    """(N,) bool, which of some trees may reach to the bounds of all of them."""
    outer = (bottom <= bottom.min() + SAME) | (top >= top.max() - SAME)
    for axis in place.T:
        first, last = axis - TURNED * reach, axis + TURNED * reach
        outer |= (first <= last.min()) | (last >= first.max())
    return np.asarray(outer)


@dataclass(frozen=True)
class TiledPulses:
    """A scan's pulses by piece: a tile and a level of its buffer.

    start : (R,) numbers at which runs of pulses of one piece begin. piece : (R,) tile · ``LEVELS`` + level.
    count : of all pulses. furthest : m, largest excess of a pulse. followed : pulses beyond the buffer.
    """

    start: np.ndarray
    piece: np.ndarray
    count: int
    furthest: float
    followed: int

    @property
    def pieces(self) -> np.ndarray:
        """The pieces that have pulses, ascending."""
        pieces = np.unique(self.piece)
        return pieces[pieces >= 0]

    def numbers(self, piece: int, at_once: int) -> Iterator[np.ndarray]:
        """The pulses of a piece, ascending, about so many at a time."""
        runs = np.flatnonzero(self.piece == piece)
        first = self.start[runs]
        stop = np.append(self.start, self.count)[runs + 1]
        total = np.cumsum(stop - first)
        begin = 0
        while begin < len(runs):
            done = total[begin - 1] if begin else 0
            end = max(int(np.searchsorted(total, done + at_once, "right")), begin + 1)
            some = [np.arange(a, b) for a, b in zip(first[begin:end], stop[begin:end], strict=True)]
            together = np.concatenate(some)
            for k in range(0, len(together), at_once):
                yield together[k : k + at_once]
            begin = end


def buffer_of(level: int, buffer: float) -> float:
    """Metres that the scene of a level reaches beyond the tile."""
    return buffer if level == 0 else max(buffer, FIRST) * 2.0**level


def tiled_pulses(
    scanner: LiDAR,
    pattern: Pattern,
    grid: TileGrid,
    bounds: np.ndarray,
    buffer: float,
    only: np.ndarray | None = None,
) -> TiledPulses:
    """Say of every pulse to which piece it belongs; bounds : (2, 3) corners of the box of all trees, m.

    only : tiles whose pulses are wanted, those of others belong to none. Blocks of pulses of which one in
    ``SPARSE`` enters no such tile and no neighbour of one are passed over.
    """
    starts, pieces, last = [], [], -2
    furthest, followed = 0.0, 0
    wanted, near = np.ones((2, len(grid)), dtype=bool)
    if only is not None:
        wanted = np.isin(np.arange(len(grid)), only)
        padded = np.pad(wanted.reshape(grid.count[::-1]), 1)
        near = sliding_window_view(padded, (3, 3)).any(axis=(2, 3)).ravel()
    at_once = AT_ONCE if only is None else AT_ONCE // SPARSE
    for first in range(0, pattern.count, at_once):
        number = np.arange(first, min(first + at_once, pattern.count))
        if only is not None:
            tile, _ = belongs(scanner, pattern.pulses(number[::SPARSE]), grid, bounds)
            if not near[tile].any():
                if last != -1:
                    starts.append(number[:1])
                    pieces.append(np.array([-1]))
                last = -1
                continue
        tile, excess = belongs(scanner, pattern.pulses(number), grid, bounds)
        with np.errstate(divide="ignore"):
            level = np.ceil(np.log2(excess / max(buffer, FIRST)))
        level = np.where(excess <= buffer, 0, np.clip(level, 1, LEVELS - 1)).astype(np.int64)
        piece = np.where(wanted[tile], tile * LEVELS + level, -1)
        change = np.flatnonzero(np.diff(piece, prepend=last))
        starts.append(number[change])
        pieces.append(piece[change])
        last = int(piece[-1])
        furthest = max(furthest, float(excess.max()))
        followed += int((level > 0).sum())
    return TiledPulses(
        np.concatenate(starts), np.concatenate(pieces), pattern.count, furthest, followed
    )


def belongs(
    scanner: LiDAR, pulses: Pulses, grid: TileGrid, bounds: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(P,) tile of pulses, and (P,) metres that their paths in the box of all trees lead beyond it."""
    radius, spread = reach(scanner.beam)
    wide = radius + np.tan(spread) * scanner.max_range + SPARE
    low, high = bounds[0, 2] - wide, bounds[1, 2] + wide
    up, begin = pulses.direction[:, 2], pulses.origin[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort([(low - begin) / up, (high - begin) / up], axis=0)
    level = up == 0
    inside = (begin >= low) & (begin <= high)
    near = np.where(level, np.where(inside, 0.0, np.inf), np.maximum(ends[0], 0.0))
    far = np.where(level, np.inf, ends[1])
    far = np.minimum(far, scanner.max_range)
    meets = near <= far
    near, far = np.where(meets, near, 0.0), np.where(meets, far, 0.0)
    flat, where = pulses.direction[:, :2], pulses.origin[:, :2]
    enter, leave = where + near[:, None] * flat, where + far[:, None] * flat
    tile = grid.tile_of(enter)
    least, most = grid.corners(tile)
    within = bounds[:, :2] + [[-wide], [wide]]
    enter, leave = np.clip(enter, *within), np.clip(leave, *within)
    beyond = np.maximum(least - np.minimum(enter, leave), np.maximum(enter, leave) - most)
    excess = np.maximum(beyond.max(axis=1), 0.0) + wide
    return tile, np.where(meets, excess, 0.0)


def seconds_of_pulses(
    scanner: LiDAR, pattern: Pattern, grid: TileGrid, bounds: np.ndarray
) -> float:
    """CPU seconds in which all pulses are dealt to tiles, as some blocks of them tell."""
    start, seen = time.process_time(), 0
    for first in np.linspace(0, max(pattern.count - AT_ONCE, 0), 4).astype(np.int64):
        number = np.arange(first, min(first + AT_ONCE, pattern.count))
        belongs(scanner, pattern.pulses(number), grid, bounds)
        seen += len(number)
    return (time.process_time() - start) * pattern.count / seen


@dataclass(frozen=True)
class TileFiles:
    """Files of tiles that are wanted: of which tiles, in which folder, whether they are all, and with what
    ending; left out: that of the whole."""

    grid: TileGrid
    folder: Path
    alone: bool = False
    ending: str = ""


def write_part(
    path: Path, scan: str, pieces: Iterable[tuple[int, np.ndarray, Sequence[Lost]]]
) -> None:
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
    state = ScanState(scan, pulses, 0, pulses, points, together(lost))
    state.write(path.with_suffix(".json"))


def is_part(path: Path, scan: str) -> bool:
    """Tell whether a part is finished and of this scan."""
    try:
        note = ScanState.read(path.with_suffix(".json"))
        whole = path.stat().st_size == len(HEAD) + note.points * POINT.itemsize
    except (OSError, ValueError, TypeError, KeyError):  # none, or whatever else lies there
        return False
    return whole and note.scan == scan


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
    stem, comments = stem_of(path), comments_of(scanner, seed)
    arrays = [rows_of(part) for part in parts]
    lost = [one for part in parts for one in ScanState.read(part.with_suffix(".json")).lost]
    total = sum(map(len, arrays))
    partial = partial_of(path.with_name(f"{stem}.joining.ply"))
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
            name = f"{stem}-{tiles.grid.name(tile)}{tiles.ending or path.name[len(stem) :]}"
            finish(of_tile, tiles.folder / name, offset)
    if file is not None:
        finish(file, path, offset)
    return Written(path, pulses, total, 0, together(sorted(lost, key=lambda one: one.first)))


def rows_of(part: Path) -> np.ndarray:
    """The records of a part, read from the disk as they are used."""
    if part.stat().st_size == len(HEAD):
        return np.empty(0, dtype=POINT)
    return np.memmap(part, POINT, mode="r", offset=len(HEAD))


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
    for number in distinct(tile).tolist():
        file = PlyFile(_of_tile(tiles, number), POINT, comments, keep=made.get(number, 0))
        file.append(rows[tile == number])
        file.close()
        made[number] = file.count


def _of_tile(tiles: TileFiles, tile: int) -> Path:
    return partial_of(tiles.folder / f"{tiles.grid.name(tile)}.joining.ply")
