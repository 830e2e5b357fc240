"""Rays among trees that sway: pieces of each tree move as one, and rays meet them at times of their own.

Where a piece is follows from knots of time; between two of them each of its points goes straight, so the
linear part and the shift of its map do. What is met is exact for that motion, in float64.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace

import numpy as np

from .boxes import clip, extents, within
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
from .seams import Seams

KNOTS = 32  # a second
SPAN = 8  # knots of a window, for which pieces are placed together
RUN, WIDER = 8, 2.0  # rays of a run, and metres that they may be apart
AROUND = 0.1  # metres about a bundle of rays, whose pieces are placed with those in it
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
        self.remade, self.pause = still.remade, still.pause
        self.bends = still.bends
        self._make = make
        self._first = len(cut.read.meshes) + 1  # mesh of the first piece
        self._window = _engine_of(cut, make, engine)
        self._placed: dict[tuple[int, int], np.ndarray] = {}
        self._last: tuple[int, np.ndarray, np.ndarray, PieceWindow | None] | None = None
        self._trees, row = np.unique(cut.tree, return_inverse=True)
        order = np.argsort(row, kind="stable")
        self._of_tree = np.split(order, np.searchsorted(row[order], np.arange(1, len(self._trees))))
        self._rest = rest_of(cut, self._of_tree)
        self._seams = Seams(cut)
        self._ever = low, high = self._bounds()
        self._hull = low.min(axis=0, initial=np.inf), high.max(axis=0, initial=-np.inf)

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
        for number, rows, bundle in self._met(origins, ways, begin, limit, block, sound):
            pieces, window = self._at(number, bundle)
            if window is None:
                continue
            left = None
            if leaving is not None:
                chosen = leaving.select(rows)
                left = _renumbered(_among(chosen, chosen.instance >= count, count), pieces)
            met = window.cast(
                origins[rows], ways[rows], near[rows], limit[rows], knot[rows] - number * SPAN, left
            )
            won = np.flatnonzero(met.found & (met.distance < best.distance[rows]))
            found = met.select(won)
            found.instance[:] = count + pieces[found.instance]
            rows = rows[won]
            if leaving is None:
                some = origins[rows], ways[rows], np.asarray(time)[rows]
                self._settle(found, *some, near[rows])
            best.put(rows, found)
        return best

    def _settle(
        self,
        hits: Hits,
        origins: np.ndarray,
        ways: np.ndarray,
        time: np.ndarray,
        near: np.ndarray,
    ) -> None:
        """Give hits (R,) at seams the copy of their triangle that is first in float64."""
        rows = self._seams.shared(hits.instance, hits.triangle)
        begun = hits.instance[rows], hits.triangle[rows]
        first, number, chosen = np.full(len(rows), np.inf), *(part.copy() for part in begun)
        going, (instance, triangle) = np.arange(len(rows)), begun
        while len(going):
            of = rows[going]
            copy = Hits(near[of], instance, triangle)
            distance = self.meets(origins[of], ways[of], copy, time[of])
            less = (distance < first[going]) | (
                (distance == first[going]) & (instance < number[going])
            )
            less &= (distance >= near[of]) & np.isfinite(distance)
            won = going[less]
            first[won], number[won], chosen[won] = distance[less], instance[less], triangle[less]
            instance, triangle = self._seams.other(instance, triangle)
            more = (instance != begun[0][going]) | (triangle != begun[1][going])
            going, instance, triangle = going[more], instance[more], triangle[more]
        known = np.isfinite(first)  # else it is met at its rim, in float32 alone
        hits.put(rows[known], Hits(first[known], number[known], chosen[known]))

    def _met(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        begin: np.ndarray,
        limit: np.ndarray,
        block: np.ndarray,
        sound: np.ndarray,
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Windows of time, each with the rays that may meet a tree in it, and the bundle (2, D) that they are
        in as long as they are among trees.

        Rays that follow one another are neighbours most often: one of a run stands for all, with what is
        around it as far as the others are off.
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
        apart = _length(origins[near] - origins[chief][run])
        apart += leaves[near] * _length(ways[near] - ways[chief][run])
        apart = np.maximum.reduceat(apart, first)
        since, until = (
            np.minimum.reduceat(enters[near], first),
            np.maximum.reduceat(leaves[near], first),
        )
        alone = near[(apart > WIDER)[run]]
        some = np.flatnonzero(apart <= WIDER)
        asked = np.concatenate([chief[some], alone])
        since = np.concatenate([since[some], enters[alone]])[:, None]
        until = np.concatenate([until[some], leaves[alone]])[:, None]
        about = np.concatenate([apart[some], np.zeros(len(alone))])
        for number in _different(block[near]):
            rows = near[block[near] == number]
            mine = np.flatnonzero(block[asked] == number)
            start, way = origins[asked[mine]], ways[asked[mine]]
            ends = start + since[mine] * way, start + until[mine] * way
            yield number, rows, extents(*ends, about[mine])

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

    def _at(self, block: int, bundle: np.ndarray) -> tuple[np.ndarray, PieceWindow | None]:
        """The pieces (P,) that come into a bundle (2, D) in a window of time, and what casts rays at
        them; None where there are none."""
        if self._last is not None and self._last[0] == block:
            _, room, pieces, window = self._last
            if (room[0] <= bundle[0]).all() and (bundle[1] <= room[1]).all():
                return pieces, window
            bundle = np.stack([np.minimum(bundle[0], room[0]), np.maximum(bundle[1], room[1])])
        bundle = bundle + np.array([[-AROUND], [AROUND]])  # for rays to come
        pieces, places = self._coming(block, bundle)
        window = None
        if len(pieces):
            mesh = self.scene.mesh_index[self.cut.count + pieces] - self._first
            window = self._window(mesh, places)
        self._last = block, bundle, pieces, window
        return pieces, window

    def _coming(self, block: int, bundle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The pieces (P,) that come into a bundle in a window of time, and their places (K, P, 3, 4)."""
        pieces, places = [np.empty(0, np.int64)], [np.empty((SPAN + 1, 0, 3, 4))]
        for row in np.flatnonzero(within(*self._ever, bundle)).tolist():
            mine = self._of_tree[row]
            which = self.cut.piece[mine]
            local = self._places(int(self._trees[row]), block)[:, which]
            low, high = swept(self._rest[row][:, which].swapaxes(0, 1), local)
            middle, half = (low + high) / 2, (high - low) / 2
            stands = self.scene.transform[self.cut.count + mine[0]]
            middle = middle @ stands[:, :3].T + stands[:, 3]
            half = half @ np.abs(stands[:, :3]).T
            near = np.flatnonzero(within(middle - half, middle + half, bundle))
            pieces.append(mine[near])
            places.append(_joined(stands[None], local[:, near]))
        return np.concatenate(pieces), np.concatenate(places, axis=1)

    def _places(self, tree: int, block: int) -> np.ndarray:
        """(SPAN + 1, G, 3, 4) of a tree's pieces in its own frame; kept."""
        key = (tree, block)
        if key not in self._placed:
            while len(self._placed) >= max(KEPT, 2 * len(self._trees)):
                self._placed.pop(next(iter(self._placed)))
            self._placed[key] = self._sway.places(tree, block * SPAN + np.arange(SPAN + 1))
        return self._placed[key]

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest corners (T, 3) in the world that trees never leave."""
        boxes = np.empty((2, len(self._trees), 3))
        for row, tree in enumerate(self._trees.tolist()):
            low, high = self._rest[row]
            stands = self.scene.transform[self.cut.count + self._of_tree[row][0]]
            out = np.linalg.norm(stands[:, :3], ord=2) * self._sway.most(tree, low, high)
            low, high = low.min(axis=0), high.max(axis=0)
            centre = stands[:, :3] @ ((low + high) / 2) + stands[:, 3]
            out = np.abs(stands[:, :3]) @ ((high - low) / 2) + out
            boxes[:, row] = centre - out, centre + out
        return boxes[0], boxes[1]


def _engine_of(
    cut: SwayingScene, make: Callable[[SceneGeometry], RayCaster], engine: MakeEngine | None
) -> MakeWindow:
    meshes = cut.scene.meshes[len(cut.read.meshes) + 1 :]
    return PieceByPiece(meshes, make) if engine is None else engine(meshes)


def _joined(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """(..., R, 3, 4) of going through the inner transforms (..., R, 3, 4) and then the outer (R, 3, 4)."""
    found = outer[:, :, :3] @ inner
    found[..., 3] += outer[:, :, 3]
    return found


def _length(way: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("ri,ri->r", way, way))


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
