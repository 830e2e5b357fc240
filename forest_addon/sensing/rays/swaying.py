"""Rays among trees that sway: pieces of each tree move as one, and rays meet them at times of their own.

Where a piece is follows from knots of time; between two of them each of its points goes straight, so the
linear part and the shift of its map do. What is met is exact for that motion, in float64.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace

import numpy as np

from .boxes import BoxTree, clip, inverse, slabs, ways_box
from .caster import Hits, RayCaster, hit_normals, unit_columns
from .exact import ExactCaster
from .geometry import SceneGeometry, invert_transforms
from .moving import TimedCaster
from .paths import corners_at_rest
from .pieces import (
    MakeEngine,
    MakeWindow,
    PieceByPiece,
    PieceWindow,
    Swaying,
    SwayingScene,
    rest_of,
    swept,
    with_runs,
)

KNOTS = 32  # a second
SPAN = 8  # knots of a window, for which pieces are placed together
RUN, WIDER = 16, 2.0  # rays of a run, and metres that they may be apart
KEPT = 256  # trees by windows, whose pieces are kept in place


class SwayingCaster(TimedCaster):
    """Closest hits of rays at times of their own, among trees that sway and things that move or stand.

    cut : the scene. sway : how its trees do. still : what does not sway, as ``cut.still`` numbers it.
    make : what makes a caster of a still scene. engine : what finds hits on pieces; left out: casters of
    each piece, in its own frame. start : s, when the trees' time begins for rays of time 0.
    """

    def __init__(
        self,
        cut: SwayingScene,
        sway: Swaying,
        still: TimedCaster,
        make: Callable[[SceneGeometry], RayCaster],
        engine: MakeEngine | None = None,
        start: float = 0.0,
    ) -> None:
        self.cut, self._sway, self._still, self._start = cut, sway, still, start
        self.scene, self.engine = with_runs(cut, still.scene), still.engine
        self.within, self.bent, self.held = still.within, still.bent, still.held
        self.bends = still.bends
        self._make = make
        self._first = len(cut.read.meshes) + 1  # mesh of the first piece
        self._window = _engine_of(cut, make, engine)
        self._placed: dict[tuple[int, int], np.ndarray] = {}
        self._last: tuple[int, np.ndarray, np.ndarray, np.ndarray, PieceWindow] | None = None
        self._trees, row = np.unique(cut.tree, return_inverse=True)
        order = np.argsort(row, kind="stable")
        self._of_tree = np.split(order, np.searchsorted(row[order], np.arange(1, len(self._trees))))
        self._bounds: dict[tuple[int, int | None], np.ndarray] = {}
        self._rest = rest_of(cut, self._of_tree)
        first = cut.count + np.array([rows[0] for rows in self._of_tree if len(rows)], np.int64)
        self._stands = cut.scene.transform[first]
        self._size = np.linalg.norm(self._stands[:, :, :3], ord=2, axis=(1, 2))
        low, high = self._boxes_of(np.arange(len(self._trees)))
        self._hull = low.min(axis=0, initial=np.inf), high.max(axis=0, initial=-np.inf)
        self._boxes = BoxTree(low - WIDER, high + WIDER)

    @property
    def still(self) -> TimedCaster:
        """Rays at what does not sway."""
        return self._still

    def exactly(self, true: SceneGeometry | None = None) -> SwayingCaster:
        """The same motion in float64; the true scene is its own, in pieces."""
        other = copy(self)
        other._still, other._last = self._still.exactly(), None
        other._make, other.engine = ExactCaster, ExactCaster.engine
        other._window = _engine_of(self.cut, ExactCaster, None)
        return other

    def corners(self, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray) -> np.ndarray:
        found = np.empty((len(instance), 3, 3))
        rows, number = self._standing(instance)
        found[rows] = self._still.corners(number, triangle[rows], time[rows])
        rows = self._swaying(instance)
        at = self._moved(instance[rows] - self.cut.count, time[rows])[0]
        own = corners_at_rest(self.scene, instance[rows], triangle[rows])
        found[rows] = np.einsum("rij,rkj->rki", at[:, :, :3], own) + at[:, None, :, 3]
        return found

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        time: np.ndarray,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
    ) -> Hits:
        origins = np.asarray(origins, dtype=np.float64)
        ways = unit_columns(np.asarray(directions).T).T
        near = np.broadcast_to(np.asarray(min_distance, dtype=np.float64), len(origins))
        far = np.array(np.broadcast_to(max_distance, len(origins)), dtype=np.float64)
        count = self.cut.count
        left = None
        if leaving is not None:
            stand, own = self._standing(leaving.instance)
            left = replace(leaving, instance=np.full(len(leaving.instance), -1))
            left.instance[stand] = own
        best = self._still.cast(origins, ways, far, time=time, min_distance=near, leaving=left)
        best.instance[best.instance >= count] += len(self.cut.owner)
        limit = np.minimum(far, best.distance)
        begin = np.maximum(near, 0.0)
        sound = np.isfinite(origins.sum(axis=1) + ways.sum(axis=1)) & (begin <= limit)
        sound = np.flatnonzero(sound)
        knot = (np.asarray(time, dtype=np.float64) + self._start) * KNOTS
        block = np.floor(knot / SPAN).astype(np.int64)
        for number, rows, trees in self._met(origins, ways, begin, limit, block, sound):
            ends = origins[rows] + limit[rows, None] * ways[rows]
            pieces, window = self._at(number, trees, ways_box(origins[rows], ends, *self._hull))
            left = None
            if leaving is not None:
                chosen = leaving.select(rows)
                left = _renumbered(_among(chosen, chosen.instance >= count, count), pieces)
            met = window.cast(
                origins[rows], ways[rows], near[rows], limit[rows], knot[rows] - number * SPAN, left
            )
            won = np.flatnonzero(met.found & (met.distance < best.distance[rows]))
            found = met.select(won)
            best.put(
                rows[won], Hits(found.distance, count + pieces[found.instance], found.triangle)
            )
        return best

    def _met(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        begin: np.ndarray,
        limit: np.ndarray,
        block: np.ndarray,
        sound: np.ndarray,
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Windows of time, each with rays that may meet a tree in it, and the rows of these trees.

        Rays that follow one another are neighbours most often: one of a run stands for all, where the others
        are within ``WIDER`` of it as long as they are among trees.
        """
        enters, leaves = clip(*self._hull, origins.T, ways.T, begin, limit)
        near = sound[enters[sound] <= leaves[sound]]
        if not len(near):
            return
        first = np.flatnonzero(
            (np.diff(block[near], prepend=np.iinfo(np.int64).min) != 0)
            | (np.arange(len(near)) % RUN == 0)
        )
        size = np.diff(first, append=len(near))
        run = np.repeat(np.arange(len(first)), size)
        chief = near[first + size // 2]
        apart = np.linalg.norm(origins[near] - origins[chief][run], axis=1)
        apart += leaves[near] * np.linalg.norm(ways[near] - ways[chief][run], axis=1)
        alike = np.maximum.reduceat(apart, first) <= WIDER
        alone = near[~alike[run]]
        asked = np.concatenate([chief[alike], alone])
        until = np.concatenate([np.maximum.reduceat(leaves[near], first)[alike], leaves[alone]])
        some = origins[asked].T, ways[asked].T, np.zeros(len(asked)), until + WIDER
        ray, box, _ = self._boxes.pairs(*some)
        ray, box = self._nearer(ray, box, block[asked[ray]], some)
        of_pair, meets = block[asked[ray]], np.zeros(len(asked), dtype=bool)
        meets[ray] = True
        of_run = np.zeros(len(first), dtype=bool)
        of_run[np.flatnonzero(alike)] = meets[: int(alike.sum())]
        kept = of_run[run]
        kept[~alike[run]] = meets[int(alike.sum()) :]
        rows = near[kept]
        for number in _different(of_pair):
            trees = np.bincount(box[of_pair == number], minlength=len(self._trees)) > 0
            yield number, rows[block[rows] == number], np.flatnonzero(trees)

    def normals(self, hits: Hits, time: np.ndarray) -> np.ndarray:
        found = np.full((len(time), 3), np.nan)
        rows, number = self._standing(hits.instance)
        mine = replace(hits.select(rows), instance=number)
        found[rows] = self._still.normals(mine, time[rows])
        rows = self._swaying(hits.instance)
        places = self._moved(hits.instance[rows] - self.cut.count, time[rows])[0]
        found[rows] = hit_normals(self.scene, hits.select(rows), places)
        return found

    def velocities(
        self, points: np.ndarray, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        velocity, rest = np.zeros_like(points), points.copy()
        rows, number = self._standing(instance)
        velocity[rows], rest[rows] = self._still.velocities(
            points[rows], number, triangle[rows], time[rows]
        )
        rows = self._swaying(instance)
        pieces = instance[rows] - self.cut.count
        at, rate = self._moved(pieces, time[rows])
        inverse = invert_transforms(at)
        own = np.einsum("rij,rj->ri", inverse[:, :, :3], points[rows]) + inverse[:, :, 3]
        velocity[rows] = np.einsum("rij,rj->ri", rate[:, :, :3], own) + rate[:, :, 3]
        still = self.scene.transform[instance[rows]]
        rest[rows] = np.einsum("rij,rj->ri", still[:, :, :3], own) + still[:, :, 3]
        return velocity, rest

    def known(self, instance: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        instance, triangle = np.array(instance), np.array(triangle)
        rows, number = self._standing(instance)
        instance[rows], triangle[rows] = self._still.known(number, triangle[rows])
        rows = self._swaying(instance)
        mesh = self.scene.mesh_index[instance[rows]]
        for number in np.unique(mesh).tolist():
            some = rows[mesh == number]
            triangle[some] = self.cut.triangle[number][triangle[some]]
        instance[rows] = self.cut.owner[instance[rows] - self.cut.count]
        return instance, triangle

    def _swaying(self, instance: np.ndarray) -> np.ndarray:
        """The rows of instances (R,) that are pieces."""
        last = self.cut.count + len(self.cut.owner)
        return np.flatnonzero((instance >= self.cut.count) & (instance < last))

    def _standing(self, instance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The rows of instances (R,) that are none, and their numbers among what does not sway."""
        count, pieces = self.cut.count, len(self.cut.owner)
        rows = np.flatnonzero((instance < count) | (instance >= count + pieces))
        number = instance[rows]
        return rows, np.where(number < count, number, number - pieces)

    def _moved(self, piece: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3, 4) local to world of pieces at times, s, and its rate, 1/s."""
        at, rate = np.empty((len(piece), 3, 4)), np.empty((len(piece), 3, 4))
        knot = (time + self._start) * KNOTS
        block = np.floor(knot / SPAN).astype(np.int64)
        tree = self.cut.tree[piece]
        order = np.lexsort((block, tree))
        cuts = np.flatnonzero(
            (np.diff(tree[order], prepend=-1) != 0) | (np.diff(block[order], prepend=-1) != 0)
        )
        for rows in np.split(order, cuts[1:]):
            if not len(rows):
                continue
            number = int(block[rows[0]])
            places = self._places(int(tree[rows[0]]), number)
            step = np.clip((knot[rows] - number * SPAN).astype(np.int64), 0, SPAN - 1)
            share = (knot[rows] - number * SPAN - step)[:, None, None]
            which = self.cut.piece[piece[rows]]
            low, high = places[step, which], places[step + 1, which]
            at[rows], rate[rows] = low + share * (high - low), KNOTS * (high - low)
        stands = self.scene.transform[self.cut.count + piece]
        return _joined(stands, at), np.einsum("rij,rjk->rik", stands[:, :, :3], rate)

    def _at(self, block: int, trees: np.ndarray, box: np.ndarray) -> tuple[np.ndarray, PieceWindow]:
        """The pieces (P,) of trees, by their rows, that come into a box (2, 3) in a window of time, and what
        casts rays at them."""
        if self._last is not None and self._last[0] == block:
            _, known, room, pieces, window = self._last
            within = (room[0] <= box[0]).all() and (box[1] <= room[1]).all()
            if within and np.isin(trees, known).all():
                return pieces, window
            trees = np.union1d(trees, known)
            box = np.stack([np.minimum(box[0], room[0]), np.maximum(box[1], room[1])])
        box = box + np.array([[-WIDER], [WIDER]])  # for rays to come
        pieces = np.concatenate([self._of_tree[row] for row in trees.tolist()])
        local = np.concatenate(
            [
                self._places(int(self._trees[row]), block)[:, self.cut.piece[self._of_tree[row]]]
                for row in trees.tolist()
            ],
            axis=1,
        )
        row = np.repeat(trees, [len(self._of_tree[row]) for row in trees.tolist()])
        rest = np.concatenate(
            [
                self._rest[row][:, self.cut.piece[self._of_tree[row]]].swapaxes(0, 1)
                for row in trees.tolist()
            ]
        )
        low, high = swept(rest, local)
        middle, half = (low + high) / 2, (high - low) / 2
        stands = self._stands[row]
        middle = np.einsum("pij,pj->pi", stands[:, :, :3], middle) + stands[:, :, 3]
        half = np.einsum("pij,pj->pi", np.abs(stands[:, :, :3]), half)
        near = ((middle - half <= box[1]) & (middle + half >= box[0])).all(axis=1)
        near[0] |= not near.any()  # a window has something
        pieces, local, stands = pieces[near], local[:, near], stands[near]
        places = np.stack([_joined(stands, one) for one in local])
        mesh = self.scene.mesh_index[self.cut.count + pieces] - self._first
        window = self._window(mesh, places)
        self._last = block, trees, box, pieces, window
        return pieces, window

    def _places(self, tree: int, block: int) -> np.ndarray:
        """(SPAN + 1, G, 3, 4) of a tree's pieces in its own frame; kept."""
        key = (tree, block)
        if key not in self._placed:
            while len(self._placed) >= max(KEPT, 2 * len(self._trees)):
                self._placed.pop(next(iter(self._placed)))
            self._placed[key] = self._sway.places(tree, block * SPAN + np.arange(SPAN + 1))
        return self._placed[key]

    def _nearer(
        self, ray: np.ndarray, tree: np.ndarray, block: np.ndarray, rays: tuple[np.ndarray, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Those pairs (P,) of rays and rows of trees that may meet in their windows of time (P,).

        rays : origins (3, R), ways (3, R), and where they begin and end (R,), metres.
        """
        origins, ways, begin, end = rays
        keep = np.zeros(len(ray), dtype=bool)
        for number in _different(block):
            some = np.flatnonzero(block == number)
            rows, which = np.unique(tree[some], return_inverse=True)
            low, high = (side.T[:, which] for side in self._boxes_of(rows, number))
            of = ray[some]
            box = low - WIDER, high + WIDER
            entry, leave = slabs(origins[:, of], inverse(ways[:, of]), box, begin[of])
            keep[some] = entry <= np.minimum(leave, end[of])
        return ray[keep], tree[keep]

    def _boxes_of(
        self, rows: np.ndarray, block: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest corners (T, 3) in the world that trees, by their rows, do not leave in a
        window of time; left out: ever."""
        boxes = np.empty((len(rows), 2, 3))
        knots = None if block is None else block * SPAN + np.arange(SPAN + 1)
        for which, row in enumerate(rows.tolist()):
            if (row, block) in self._bounds:
                boxes[which] = self._bounds[row, block]
                continue
            tree, stands = int(self._trees[row]), self._stands[row]
            low, high = self._rest[row]
            out = self._size[row] * self._sway.most(tree, low, high, knots)
            low, high = low.min(axis=0), high.max(axis=0)
            middle, half = (low + high) / 2, (high - low) / 2
            centre = stands[:, :3] @ middle + stands[:, 3]
            out = np.abs(stands[:, :3]) @ half + out
            boxes[which] = self._bounds[row, block] = np.stack([centre - out, centre + out])
        for key in list(self._bounds)[: -8 * max(KEPT, len(self._trees))]:
            self._bounds.pop(key)
        return boxes[:, 0], boxes[:, 1]


def _engine_of(
    cut: SwayingScene, make: Callable[[SceneGeometry], RayCaster], engine: MakeEngine | None
) -> MakeWindow:
    meshes = cut.scene.meshes[len(cut.read.meshes) + 1 :]
    return PieceByPiece(meshes, make) if engine is None else engine(meshes)


def _joined(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """(R, 3, 4) of going through the inner and then the outer transforms (R, 3, 4)."""
    found = np.einsum("rij,rjk->rik", outer[:, :, :3], inner)
    found[:, :, 3] += outer[:, :, 3]
    return found


def _different(values: np.ndarray) -> list[int]:
    """The different ones of whole numbers that lie near each other, ascending."""
    if not len(values):
        return []
    low = int(values.min())
    if int(values.max()) - low > 10 * len(values):
        return sorted(set(values.tolist()))
    return (low + np.flatnonzero(np.bincount(values - low))).tolist()


def _among(hits: Hits, mine: np.ndarray, first: int) -> Hits:
    """Hits whose numbers count from ``first``; -1 where they are not of those."""
    return replace(hits, instance=np.where(mine & hits.found, hits.instance - first, -1))


def _renumbered(hits: Hits, pieces: np.ndarray) -> Hits:
    """Hits numbered by a window's pieces."""
    order = np.argsort(pieces)
    row = np.minimum(np.searchsorted(pieces[order], hits.instance), len(pieces) - 1)
    same = (hits.instance >= 0) & (pieces[order[row]] == hits.instance)
    return replace(hits, instance=np.where(same, order[row], -1))
