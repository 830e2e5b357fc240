"""Rays among trees that sway: pieces of each tree move as one, and rays meet them at times of their own.

Trees are cut into the pieces of their rig. At a piece's seams both neighbours have the triangles there, so that no
ray slips between them. Where a piece is follows from knots of time; between two of them each of its points goes
straight, so the linear parts and shifts of its map do. What is met is exact for that motion, in float64.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ...base.trimesh import OTHER, TriMesh
from .boxes import BoxTree
from .caster import Hits, RayCaster, unit_columns
from .geometry import SceneGeometry, invert_transforms
from .moving import MovingCaster, TimedCaster
from .referee import Referee

KNOTS = 64  # a second
SPAN = 16  # knots of a window, for which pieces are placed together
KEPT = 256  # trees by windows, whose pieces are kept in place


class Swaying(Protocol):
    """Trees that sway, as ``stand.wind.sway`` has them; named by their number in the stand."""

    @property
    def number(self) -> dict[int, int]: ...

    def moves(self, tree: int) -> bool: ...

    def pieces(self, tree: int, mesh: TriMesh) -> np.ndarray: ...

    def places(self, tree: int, knot: np.ndarray) -> np.ndarray: ...

    def most(self, tree: int, low: np.ndarray, high: np.ndarray) -> float: ...


class PieceWindow(Protocol):
    """Some pieces for ``SPAN`` knots."""

    def cast(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        knot: np.ndarray,
        leaving: Hits | None,
    ) -> Hits:
        """The closest hits of rays (R, 3), (R, 3) unit, at knots (R,) from the window's first one on; hits
        number the window's pieces."""
        ...


MakeWindow = Callable[[np.ndarray, np.ndarray], PieceWindow]  # mesh (P,), places (K, P, 3, 4)
MakeEngine = Callable[[tuple[TriMesh, ...]], MakeWindow]


@dataclass(frozen=True)
class SwayingScene:
    """A scene whose swaying trees are in pieces.

    scene : I instances as they were read, those that sway without a surface, then P pieces at rest.
    count : I. owner : (P,) the instance that each piece is of. tree : (P,) its number in the stand.
    piece : (P,) which of the tree's. triangle : by mesh of ``scene``, the triangles of the whole tree that its
    own are; of pieces alone. read : the scene as it was read.
    """

    scene: SceneGeometry
    read: SceneGeometry
    count: int
    owner: np.ndarray
    tree: np.ndarray
    piece: np.ndarray
    triangle: tuple[np.ndarray, ...]

    @property
    def still(self) -> SceneGeometry:
        """What does not sway, with the same numbers."""
        return _rows(self.scene, np.arange(self.count), len(self.read.meshes) + 1)


def cut(read: SceneGeometry, sway: Swaying) -> SwayingScene:
    """Cut the trees of a scene that sway into pieces."""
    number = sway.number
    empty = TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), OTHER)
    meshes: list[TriMesh] = [*read.meshes, empty]
    slots, assets, names = _padded(read)
    triangle: list[np.ndarray] = [np.empty(0, np.int64)] * len(meshes)
    known: dict[tuple[int, int], list[tuple[int, int]]] = {}
    owner, tree, piece, mesh_of = [], [], [], []
    index = read.mesh_index.copy()
    for instance in np.flatnonzero(read.tree >= 0).tolist():
        row = number.get(int(read.tree[instance]), -1)
        mesh = int(read.mesh_index[instance])
        if row < 0 or not sway.moves(row) or not len(read.meshes[mesh].triangles):
            continue
        key = (mesh, int(read.species[instance]))
        if key not in known:
            known[key] = []
            for which, rows in _pieces(read.meshes[mesh], sway.pieces(row, read.meshes[mesh])):
                known[key].append((which, len(meshes)))
                meshes.append(_taken(read.meshes[mesh], rows))
                triangle.append(rows)
                for kept in (slots, assets, names):
                    if kept:
                        kept.append(kept[mesh])
        index[instance] = len(read.meshes)
        for which, made in known[key]:
            owner.append(instance)
            tree.append(row)
            piece.append(which)
            mesh_of.append(made)
    every = np.concatenate([np.arange(len(read)), np.array(owner, np.int64)])
    scene = SceneGeometry(
        meshes=tuple(meshes),
        transform=read.transform[every],
        mesh_index=np.concatenate([index, np.array(mesh_of, np.int64)]),
        object_name=read.object_name,
        tree=read.tree[every],
        species=read.species[every],
        object_index=read.object_index[every],
        reflectance=read.reflectance[every],
        slot_reflectance=tuple(slots),
        asset=tuple(assets),
        slot_names=tuple(names),
    )
    some = (np.array(values, np.int64) for values in (owner, tree, piece))
    return SwayingScene(scene, read, len(read), *some, tuple(triangle))


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
        self.scene, self.engine = cut.scene, still.engine
        self.within, self.frozen = still.within, still.frozen
        self._make, self._make_engine = make, engine
        self._first = len(cut.read.meshes) + 1  # mesh of the first piece
        self._window = _engine_of(cut, make, engine)
        self._placed: dict[tuple[int, int], np.ndarray] = {}
        self._last: tuple[int, np.ndarray, PieceWindow] | None = None
        self._trees, row = np.unique(cut.tree, return_inverse=True)
        order = np.argsort(row, kind="stable")
        self._of_tree = np.split(order, np.searchsorted(row[order], np.arange(1, len(self._trees))))
        boxes = [self._box(rows) for rows in self._of_tree if len(rows)]
        low, high = np.array(boxes).reshape(-1, 2, 3).transpose(1, 0, 2)
        self._boxes = BoxTree(low, high)

    def judged(self, true: SceneGeometry | None = None) -> SwayingCaster:
        other = copy(self)
        other._still = self._still.judged(None)
        other._last = None
        make = self._make
        other._window = _engine_of(self.cut, lambda scene: Referee(make(scene), scene), None)
        other.engine = Referee.engine
        return other

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
        left = None if leaving is None else _among(leaving, leaving.instance < count, 0)
        best = self._still.cast(origins, ways, far, time=time, min_distance=near, leaving=left)
        limit = np.minimum(far, best.distance)
        begin = np.maximum(near, 0.0)
        usable = np.isfinite(origins.sum(axis=1) + ways.sum(axis=1)) & (begin <= limit)
        sound = np.flatnonzero(usable)
        ray, box, _ = self._boxes.pairs(origins[sound].T, ways[sound].T, begin[sound], limit[sound])
        if not len(ray):
            return best
        knot = (np.asarray(time, dtype=np.float64) + self._start) * KNOTS
        block = np.floor(knot / SPAN).astype(np.int64)
        of_pair = block[sound[ray]]
        for number in np.unique(of_pair).tolist():
            mine = of_pair == number
            rows = sound[np.unique(ray[mine])]
            pieces, window = self._at(number, np.unique(box[mine]))
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

    def transforms(self, instance: np.ndarray, time: np.ndarray) -> np.ndarray:
        found = np.empty((len(instance), 3, 4))
        whole = instance < self.cut.count
        rows = np.flatnonzero(whole)
        found[rows] = self._still.transforms(instance[rows], time[rows])
        rows = np.flatnonzero(~whole)
        found[rows] = self._moved(instance[rows] - self.cut.count, time[rows])[0]
        return found

    def velocities(
        self, points: np.ndarray, instance: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        velocity, rest = np.zeros_like(points), points.copy()
        whole = instance < self.cut.count
        rows = np.flatnonzero(whole)
        velocity[rows], rest[rows] = self._still.velocities(
            points[rows], instance[rows], time[rows]
        )
        rows = np.flatnonzero(~whole)
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
        rows = np.flatnonzero(instance >= self.cut.count)
        mesh = self.scene.mesh_index[instance[rows]]
        for number in np.unique(mesh).tolist():
            some = rows[mesh == number]
            triangle[some] = self.cut.triangle[number][triangle[some]]
        instance[rows] = self.cut.owner[instance[rows] - self.cut.count]
        return instance, triangle

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

    def _at(self, block: int, trees: np.ndarray) -> tuple[np.ndarray, PieceWindow]:
        """The pieces (P,) of trees, by their rows, for a window of time, and what casts rays at them."""
        if self._last is not None and self._last[0] == block:
            _, pieces, window = self._last
            if np.isin(trees, self._known_trees).all():
                return pieces, window
            trees = np.union1d(trees, self._known_trees)
        pieces = np.concatenate([self._of_tree[row] for row in trees.tolist()])
        local = np.concatenate(
            [
                self._places(int(self._trees[row]), block)[:, self.cut.piece[self._of_tree[row]]]
                for row in trees.tolist()
            ],
            axis=1,
        )
        stands = self.scene.transform[self.cut.count + pieces]
        places = np.stack([_joined(stands, one) for one in local])
        mesh = self.scene.mesh_index[self.cut.count + pieces] - self._first
        window = self._window(mesh, places)
        self._last, self._known_trees = (block, pieces, window), trees
        return pieces, window

    def _places(self, tree: int, block: int) -> np.ndarray:
        """(SPAN + 1, G, 3, 4) of a tree's pieces in its own frame; kept."""
        key = (tree, block)
        if key not in self._placed:
            while len(self._placed) >= max(KEPT, 2 * len(self._trees)):
                self._placed.pop(next(iter(self._placed)))
            self._placed[key] = self._sway.places(tree, block * SPAN + np.arange(SPAN + 1))
        return self._placed[key]

    def _box(self, pieces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Box in the world that a tree never leaves."""
        mesh = self.scene.mesh_index[self.cut.count + pieces]
        some_low, some_high = boxes_of(tuple(self.scene.meshes[m] for m in mesh)).swapaxes(0, 1)
        every = np.zeros((int(self.cut.piece[pieces].max()) + 1, 2, 3))
        every[self.cut.piece[pieces], 0], every[self.cut.piece[pieces], 1] = some_low, some_high
        most = self._sway.most(int(self.cut.tree[pieces[0]]), every[:, 0], every[:, 1])
        stands = self.scene.transform[self.cut.count + pieces[0]]
        size = float(np.linalg.norm(stands[:, :3], ord=2))
        low, high = some_low.min(axis=0), some_high.max(axis=0)
        middle, half = (low + high) / 2, (high - low) / 2
        centre = stands[:, :3] @ middle + stands[:, 3]
        out = np.abs(stands[:, :3]) @ half + size * most
        return centre - out, centre + out


class PieceByPiece:
    """Rays at pieces of a window, each piece in its own frame: what any caster can do, and slow.

    meshes : of pieces, at rest. make : what makes a caster of a still scene.
    """

    def __init__(
        self, meshes: tuple[TriMesh, ...], make: Callable[[SceneGeometry], RayCaster]
    ) -> None:
        self._meshes, self._make = meshes, make
        self.boxes = boxes_of(meshes)
        self._casters: dict[int, RayCaster] = {}

    def __call__(self, mesh: np.ndarray, places: np.ndarray) -> PieceWindow:
        return _PieceWindow(self, mesh, places)

    def caster(self, mesh: int) -> RayCaster:
        """A caster of one piece in its own frame."""
        if mesh not in self._casters:
            one = np.zeros(1, np.int64)
            alone = SceneGeometry(
                (self._meshes[mesh],), np.eye(3, 4)[None], one, ("",), one - 1, one - 1
            )
            self._casters[mesh] = self._make(alone)
        return self._casters[mesh]


class _PieceWindow:
    def __init__(self, engine: PieceByPiece, mesh: np.ndarray, places: np.ndarray) -> None:
        self._engine, self._mesh, self._places = engine, mesh, places
        self._boxes = BoxTree(*swept(engine.boxes[mesh], places))

    def cast(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        knot: np.ndarray,
        leaving: Hits | None,
    ) -> Hits:
        best = Hits.misses(len(origins))
        ray, piece, _ = self._boxes.pairs(origins.T, ways.T, np.maximum(near, 0.0), far)
        order = np.lexsort((piece, self._mesh[piece]))
        ray, piece = ray[order], piece[order]
        cuts = np.flatnonzero(np.diff(self._mesh[piece], prepend=-1))
        for rows in np.split(np.arange(len(ray)), cuts[1:]):
            if not len(rows):
                continue
            of, which = ray[rows], piece[rows]
            inverse = invert_transforms(placed(self._places, which, knot[of]))
            begin = np.einsum("rij,rj->ri", inverse[:, :, :3], origins[of]) + inverse[:, :, 3]
            along = np.einsum("rij,rj->ri", inverse[:, :, :3], ways[of])
            size = np.linalg.norm(along, axis=1)
            left = None
            if leaving is not None:
                left = leaving.select(of)
                same = left.instance == which
                left = replace(left, instance=np.where(same, 0, -1))
            met = self._engine.caster(int(self._mesh[which[0]])).cast(
                begin, along, far[of] * size, min_distance=near[of] * size, leaving=left
            )
            distance = met.distance / size
            order = np.lexsort((distance, of))
            first = order[np.flatnonzero(np.diff(of[order], prepend=-1))]
            first = first[met.found[first] & (distance[first] < best.distance[of[first]])]
            best.put(of[first], Hits(distance[first], which[first], met.triangle[first]))
        return best


def boxes_of(meshes: tuple[TriMesh, ...]) -> np.ndarray:
    """(M, 2, 3) smallest and largest coordinates of meshes with at least one vertex, in their own frames."""
    ends = [(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) for mesh in meshes]
    return np.array(ends).reshape(-1, 2, 3)


def swept(boxes: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest coordinates (P, 3) that pieces in boxes (P, 2, 3) have at places (K, P, 3, 4).

    Between knots every point goes straight, so it stays in the box of both.
    """
    middle, half = boxes.mean(axis=1), (boxes[:, 1] - boxes[:, 0]) / 2
    centre = np.einsum("kpij,pj->kpi", places[..., :3], middle) + places[..., 3]
    out = np.einsum("kpij,pj->kpi", np.abs(places[..., :3]), half)
    return (centre - out).min(axis=0), (centre + out).max(axis=0)


def placed(places: np.ndarray, piece: np.ndarray, knot: np.ndarray) -> np.ndarray:
    """(R, 3, 4) of pieces (R,) at knots (R,) between those of places (K, P, 3, 4)."""
    step = np.clip(knot.astype(np.int64), 0, len(places) - 2)
    low, high = places[step, piece], places[step + 1, piece]
    return np.asarray(low + (knot - step)[:, None, None] * (high - low))


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


def _pieces(mesh: TriMesh, piece: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Each piece with its triangles, and with those of others that share a vertex with them."""
    corner = mesh.triangles.astype(np.int64)
    count = int(piece.max()) + 1
    pair = np.unique((corner * count + piece[:, None]).ravel())
    vertex, of = np.divmod(pair, count)
    first = np.searchsorted(vertex, np.arange(len(mesh.vertices) + 1))
    many = np.diff(first) > 1
    seam = np.flatnonzero(many[corner].any(axis=1))
    rows, where = [np.arange(len(piece))], [piece]
    for side in range(3):
        at = corner[seam, side]
        held = first[at + 1] - first[at]
        flat = np.arange(held.sum()) + np.repeat(first[at] - np.cumsum(held) + held, held)
        rows.append(np.repeat(seam, held))
        where.append(of[flat])
    both = np.unique(np.concatenate(where) * len(piece) + np.concatenate(rows))
    which, row = np.divmod(both, len(piece))
    cuts = np.flatnonzero(np.diff(which, prepend=-1))
    return [(int(which[c]), part) for c, part in zip(cuts, np.split(row, cuts[1:]), strict=True)]


def _taken(mesh: TriMesh, rows: np.ndarray) -> TriMesh:
    keep = np.zeros(len(mesh.triangles), dtype=bool)
    keep[rows] = True
    return mesh.select(keep)


def _padded(read: SceneGeometry) -> tuple[list, list, list]:
    """What a scene says of its meshes, with something for the empty one."""
    slots = [*read.slot_reflectance, np.array([np.nan])] if read.slot_reflectance else []
    return slots, [*read.asset, ""] if read.asset else [], [*read.slot_names, ()] if read.slot_names else []


def _rows(scene: SceneGeometry, rows: np.ndarray, meshes: int) -> SceneGeometry:
    return replace(
        scene,
        meshes=scene.meshes[:meshes],
        transform=scene.transform[rows],
        mesh_index=scene.mesh_index[rows],
        tree=scene.tree[rows],
        species=scene.species[rows],
        object_index=scene.object_index[rows],
        reflectance=scene.reflectance[rows],
        slot_reflectance=scene.slot_reflectance[:meshes],
        asset=scene.asset[:meshes],
        slot_names=scene.slot_names[:meshes],
    )


def _among(hits: Hits, mine: np.ndarray, first: int) -> Hits:
    """Hits whose numbers count from ``first``; -1 where they are not of those."""
    return replace(hits, instance=np.where(mine & hits.found, hits.instance - first, -1))


def _renumbered(hits: Hits, pieces: np.ndarray) -> Hits:
    """Hits numbered by a window's pieces."""
    order = np.argsort(pieces)
    row = np.minimum(np.searchsorted(pieces[order], hits.instance), len(pieces) - 1)
    same = (hits.instance >= 0) & (pieces[order[row]] == hits.instance)
    return replace(hits, instance=np.where(same, order[row], -1))
