"""The moving scene: where each part of a scene is at time t, what it is at rest, and how fast it goes.

Instances move as the scene's keys, parents and physics have them (``rays.paths.SceneMotion``), and trees sway
in the wind. A tree that sways is cut into the pieces of its rig, each an instance of its own behind those of
the scene; at the seams both neighbours have the triangles there, so that no ray slips between them. A piece
is known at knots of time, between which each of its points goes straight. LiDARs, sonars, surveys and flights
all ask this one object; rays are cast in it by ``moving_rays``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..base.kept import LastAsked
from ..base.rows import distinct
from ..base.runs import numbered
from ..base.trimesh import LEAF, OTHER, TriMesh
from .rays.boxes import clip, extents, swept, within
from .rays.caster import Hits
from .rays.geometry import OF_MESHES, SceneGeometry, alone
from .rays.paths import SceneMotion, ShapePath

if TYPE_CHECKING:
    from ..stand.wind import ForestSway

KNOTS = 32  # a second
SPAN = 4  # knots of a window, for which pieces are placed together
EPOCH = 16  # windows, in which a tree does not leave a box
AROUND = 0.1  # metres about a bundle of rays, whose pieces are placed with those in it
KEPT = 256  # trees by windows, whose pieces are kept in place
WINDOWS = 4  # that are kept: rays that go on ask again for those of their batch
EMPTY = TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3), np.int64), OTHER)  # of what is met apart


class MovingScene:
    """A scene of which some instances move, sway or change their shape.

    read : the scene as it was read. motion : how its instances move. whole : the scene with the instances
    that it has besides at other times; left out: ``read``. sway : how its trees sway, start : s, when their
    time begins for rays of time 0. like : a scene of the same meshes, whose pieces are shared.

    scene : all instances, pieces of trees last, from number ``count`` on. still : those before, of which what
    moves or sways has no surface.
    """

    def __init__(
        self,
        read: SceneGeometry,
        motion: SceneMotion | None = None,
        whole: SceneGeometry | None = None,
        sway: ForestSway | None = None,
        start: float = 0.0,
        like: MovingScene | None = None,
    ) -> None:
        motion, whole = motion or SceneMotion(), read if whole is None else whole
        self.read, self.sway, self.start = read, sway, start
        tree = trees_that_sway(whole, sway)
        sways = np.flatnonzero(tree >= 0)
        self.motion = motion.without(sways)
        shared = None if like is None else like.pieces
        # Where no tree sways, nothing is asked of them.
        self.pieces: CutTrees = CutTrees(whole, tree, sway, shared)  # type: ignore[arg-type]
        self.count, empty = len(whole), len(whole.meshes)
        meshed = whole.with_meshes((EMPTY, *self.pieces.meshes), (0, *self.pieces.of_mesh))
        index = whole.mesh_index.copy()
        index[sways] = empty
        self.scene = meshed.take(
            np.concatenate([np.arange(self.count), self.pieces.owner]),
            mesh_index=np.concatenate([index, empty + 1 + self.pieces.mesh]),
        )
        index = index.copy()
        index[self.motion.rows] = empty
        self.still = _surfaces(whole, (*whole.meshes, EMPTY), index)
        # Instances of other times that stand for trees which sway are never there.
        there = whole.mesh_index.copy()
        there[sways[sways >= len(read)]] = empty
        self.whole = replace(meshed, meshes=meshed.meshes[: empty + 1], mesh_index=there)

    @cached_property
    def keyed(self) -> np.ndarray:
        """(N, 2, 3) corners in the world of boxes that the parts which have a path, in the order of
        ``motion.rows``, never leave; NaN of those without a surface."""
        boxes = np.empty((len(self.motion.rows), 2, 3))
        for row, number in enumerate(self.motion.rows.tolist()):
            shape = self.motion.shapes.get(number)
            mesh = alone(self.scene.meshes[self.scene.mesh_index[number]])
            ends = mesh.bounds() if shape is None else shape.bounds()
            boxes[row] = self.motion.paths[number].swept(*(np.reshape(end, 3) for end in ends))
        return boxes

    def solid(self) -> MovingScene:
        """The same motion without leaves."""
        shapes = {}
        for number, shape in self.motion.shapes.items():
            mesh = self.whole.meshes[self.whole.mesh_index[number]]
            kept = np.unique(mesh.triangles[mesh.part != LEAF])
            shapes[number] = ShapePath(shape.time, shape.vertices[:, kept])
        motion = replace(self.motion, shapes=shapes)
        return MovingScene(self.read.solid(), motion, self.whole.solid(), self.sway, self.start)

    def of(self, true: SceneGeometry) -> MovingScene:
        """The same motion of a scene that was read differently."""
        if true is self.read:
            return self
        more = self.whole.meshes[len(true.meshes) :]
        place = np.concatenate([true.transform, self.whole.transform[len(true) :]])
        whole = replace(self.whole, meshes=(*true.meshes, *more), transform=place)
        return MovingScene(true, self.motion, whole, self.sway, self.start)

    def at(self, instance: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) local to world of instances (R,) at times (R,), s."""
        transform = self.scene.transform[instance]
        rows, row = self.motion.row_of(instance)
        if len(rows):
            transform[rows] = self.motion.table.at(row, time[rows])
        rows = np.flatnonzero(instance >= self.count)
        if len(rows):
            transform[rows] = self.pieces.at(instance[rows] - self.count, time[rows] + self.start)[
                0
            ]
        return transform

    def corners(self, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(R, 3, 3) corners in the world of triangles of instances (R,) at times (R,), s."""
        own = self.motion.corners(self.scene, instance, triangle, time)
        at = self.at(instance, time)
        return np.asarray(np.einsum("rij,rkj->rki", at[:, :, :3], own) + at[:, None, :, 3])

    def normals(self, hits: Hits, time: np.ndarray) -> np.ndarray:
        """(R, 3) unit world normals of the triangles that were hit at times (R,), s; NaN for a miss."""
        normals, met = np.full((len(time), 3), np.nan), np.flatnonzero(hits.found)
        asked = hits.instance[met], hits.triangle[met], time[met]
        own = self.motion.corners(self.scene, *asked)
        turn = self.at(asked[0], asked[2])[:, :, :3]
        u, v = np.einsum("rij,rkj->kri", turn, own[:, 1:] - own[:, :1])
        normal = np.cross(u, v)
        with np.errstate(invalid="ignore", divide="ignore"):
            normals[met] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        return normals

    def velocities(
        self, points: np.ndarray, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3) m/s of surface points (R, 3), met on triangles of instances (R,) at times (R,), and where
        they are in the scene as it stands still, metres; NaN where they are not there."""
        velocity, rest = np.zeros_like(points), points.copy()
        moves, row = self.motion.row_of(instance)
        sways = np.flatnonzero(instance >= self.count)
        for rows in (moves, sways):
            if not len(rows):
                continue
            if rows is sways:
                piece = instance[rows] - self.count
                at, rate = self.pieces.at(piece, time[rows] + self.start)
            else:
                table = self.motion.table
                at, rate = table.at(row, time[rows]), table.rate(row, time[rows])
            own = taken_back(at, points[rows])
            velocity[rows] = moved(rate, own)
            if rows is moves:
                bend, own = self._bent(own, instance[rows], triangle[rows], time[rows])
                velocity[rows] += np.einsum("rij,rj->ri", at[:, :, :3], bend)
            rest[rows] = moved(self.scene.transform[instance[rows]], own)
        return velocity, rest

    def _bent(
        self, own: np.ndarray, instance: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3) m/s of own points (R, 3) as their shape changes, and where they are at rest; NaN where they
        are not there then."""
        rate, stood = np.zeros_like(own), own.copy()
        bends = np.flatnonzero(self.motion.bends(instance))
        if len(bends):
            asked = instance[bends], triangle[bends], time[bends]
            a, b, c = self.motion.corners(self.scene, *asked).swapaxes(0, 1)
            across = np.stack([b - a, c - a], axis=2)  # (R, 3, 2): shares along two sides
            share = np.einsum("rij,rj->ri", np.linalg.pinv(across), own[bends] - a)
            shares = np.column_stack([1 - share.sum(axis=1), share])
            rates = self.motion.corners(self.scene, *asked, rates=True)
            rate[bends] = np.einsum("rk,rki->ri", shares, rates)
            stood[bends] = np.einsum("rk,rki->ri", shares, self.scene.corners(*asked[:2]))
        if self.motion.stands_for is not None:
            stood[self.motion.stands_for[instance] != instance] = np.nan
        return rate, stood

    def known(self, instance: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The numbers that instances and triangles (R,) have in the scene as it was read; of a mesh of other
        triangles, one of the same material."""
        instance, triangle = np.array(instance), np.array(triangle)
        rows = np.flatnonzero(instance >= self.count)
        piece = instance[rows] - self.count
        triangle[rows] = self.pieces.whole_triangle(piece, triangle[rows])
        instance[rows] = self.pieces.owner[piece]
        stands_for = self.motion.stands_for
        if stands_for is None:
            return instance, triangle
        other = np.append(stands_for, -1)[instance] != instance
        for number in distinct(instance[other]).tolist():
            rows = np.flatnonzero(instance == number)
            of = int(stands_for[number])
            here, there = (self.whole.meshes[self.whole.mesh_index[n]] for n in (number, of))
            if here is not there:
                slot, first = np.unique(there.material, return_index=True)
                row = np.minimum(np.searchsorted(slot, here.material), len(slot) - 1)
                like = np.where(slot[row] == here.material, first[row], 0)
                triangle[rows] = like[triangle[rows]]
            instance[rows] = of
        return instance, triangle

    def snapshot(self, time: float) -> SceneGeometry:
        """The scene as it is at a time, s, with trees that sway at rest; what is not there has no surface."""
        motion, transform = self.motion, self.whole.transform.copy()
        meshes, index = list(self.whole.meshes), self.whole.mesh_index.copy()
        empty = len(meshes) - 1
        if len(motion.rows):
            row = np.arange(len(motion.rows))
            transform[motion.rows] = motion.table.at(row, np.full(len(row), time))
        for number, (first, last) in motion.spans.items():
            if not first <= time < last:
                index[number] = empty
        made: dict[tuple[int, int], int] = {}
        for number, shape in motion.shapes.items():
            mesh = int(index[number])
            if mesh == empty:
                continue
            if (id(shape), mesh) not in made:
                every = np.arange(len(meshes[mesh].vertices))[None]
                vertices = shape.at(every, np.array([time]))[0]
                made[id(shape), mesh] = len(meshes)
                meshes.append(replace(meshes[mesh], vertices=vertices))
            index[number] = made[id(shape), mesh]
        return replace(_surfaces(self.whole, tuple(meshes), index), transform=transform)

    def bundles(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        begin: np.ndarray,
        limit: np.ndarray,
        time: np.ndarray,
        sound: np.ndarray,
    ) -> Iterator[tuple[np.ndarray, PieceWindow]]:
        """Rows of rays (R, 3), (R, 3) between limits that may meet trees which sway, and the window of time
        and pieces that holds all that they may meet; sound : the rows that are asked for."""
        if not len(self.pieces.owner):
            return
        block = np.floor((time + self.start) * KNOTS / SPAN).astype(np.int64)
        enters, leaves = clip(*self.pieces.hull, origins.T, ways.T, begin, limit)
        near = sound[enters[sound] <= leaves[sound]]
        for number in distinct(block[near]).tolist():
            rows = near[block[near] == number]
            start, way = origins[rows], ways[rows]
            window = self.pieces.window(
                number,
                extents(start + enters[rows, None] * way, start + leaves[rows, None] * way),
            )
            if len(window.piece):
                yield rows, window


@dataclass(frozen=True, eq=False)
class PieceWindow:
    """Pieces (P,) of trees in a window of time: places (K, P, 3, 4) at its knots, which begin with
    ``first``, and the box (2, 3) that they do not leave."""

    first: int
    piece: np.ndarray
    places: np.ndarray
    box: np.ndarray

    def knot(self, time: np.ndarray, start: float) -> np.ndarray:
        """(R,) knots of the window, and shares between them, at times (R,), s."""
        return (time + start) * KNOTS - self.first

    def at(self, row: np.ndarray, knot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3, 4) local to world of pieces by their rows (R,) at knots (R,), and its rate, 1/s."""
        step = np.clip(knot.astype(np.int64), 0, len(self.places) - 2)
        low = self.places[step, row]
        change = self.places[step + 1, row] - low
        return low + (knot - step)[:, None, None] * change, KNOTS * change


class CutTrees:
    """Trees of a scene that sway, in pieces.

    scene : as they stand. tree : (I,) number in the stand of those that sway, -1 of others. like : of a scene
    of the same meshes, whose pieces are shared.

    owner : (P,) the instance that each piece is of. meshes : of all pieces, mesh : (P,) which of them,
    of_mesh : the mesh of the scene that each is of, triangle : the triangles of that which it has.
    """

    def __init__(
        self, scene: SceneGeometry, tree: np.ndarray, sway: ForestSway, like: CutTrees | None = None
    ) -> None:
        self._sway = sway
        self._known: dict[tuple[int, int], list[tuple[int, int]]] = {}
        meshes: list[TriMesh] = []
        self.of_mesh: list[int] = []
        self.triangle: list[np.ndarray] = []
        if like is not None:
            meshes, self.of_mesh = list(like.meshes), list(like.of_mesh)
            self.triangle, self._known = list(like.triangle), dict(like._known)
        cuts_of_trees: list[tuple[int, int, int]] = []  # instance, piece and mesh
        for instance in np.flatnonzero(tree >= 0).tolist():
            mesh = int(scene.mesh_index[instance])
            key = (mesh, int(scene.species[instance]))
            if key not in self._known:
                self._known[key] = []
                of = self._sway.pieces(int(tree[instance]), scene.meshes[mesh])
                for which, rows in split_pieces(scene.meshes[mesh], of):
                    self._known[key].append((which, len(meshes)))
                    meshes.append(scene.meshes[mesh].select(rows))
                    self.of_mesh.append(mesh)
                    self.triangle.append(rows)
            cuts_of_trees += [(instance, which, made) for which, made in self._known[key]]
        self.meshes: tuple[TriMesh, ...] = tuple(meshes)
        self.owner, self._piece, self.mesh = (
            np.array(cuts_of_trees, np.int64).reshape(-1, 3).T.copy()
        )
        self._tree = tree[self.owner]
        self._stands = scene.transform[self.owner]
        if like is None or len(like.meshes) != len(meshes):
            corners = [(m.vertices.min(axis=0), m.vertices.max(axis=0)) for m in meshes]
            self.boxes: np.ndarray = np.array(corners).reshape(-1, 2, 3)
        else:
            self.meshes, self.boxes = like.meshes, like.boxes
        self._join_seams()
        self._windows: dict[int, tuple[np.ndarray, PieceWindow]] = {}
        self._trees = self._by_tree(np.arange(len(cuts_of_trees)))
        most = max(KEPT, 2 * len(self._trees))
        self._placed: LastAsked[tuple[int, int], np.ndarray] = LastAsked(most)
        self._bounds_in: LastAsked[tuple[int, int], np.ndarray] = LastAsked(most)
        ends = np.array([self._bounds(rows) for rows in self._trees]).reshape(-1, 2, 3)
        self._ever = ends[:, 0], ends[:, 1]
        self.hull = ends[:, 0].min(0, initial=np.inf), ends[:, 1].max(0, initial=-np.inf)

    def whole_triangle(self, piece: np.ndarray, triangle: np.ndarray) -> np.ndarray:
        """(R,) triangles of the meshes of whole trees, of triangles of pieces."""
        return np.asarray(self._whole[self._first[self.mesh[piece]] + triangle])

    def at(self, piece: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3, 4) local to world of pieces (R,) at times (R,), s, and its rate, 1/s."""
        at, rate = np.empty((len(piece), 3, 4)), np.empty((len(piece), 3, 4))
        knot = time * KNOTS
        block = np.floor(knot / SPAN).astype(np.int64)
        for number in distinct(block).tolist():
            rows = np.flatnonzero(block == number)
            own = distinct(piece[rows])
            kept = self._windows.get(number)
            window = (
                kept[1]
                if kept is not None and np.isin(own, kept[1].piece).all()
                else PieceWindow(number * SPAN, own, self._placed_in(own, number), self.boxes[:0])
            )
            at[rows], rate[rows] = window.at(
                np.searchsorted(window.piece, piece[rows]), knot[rows] - window.first
            )
        return at, rate

    def _by_tree(self, piece: np.ndarray) -> list[np.ndarray]:
        """Pieces (P,), ascending, tree by tree."""
        cuts = np.flatnonzero(np.diff(self.owner[piece])) + 1
        return np.split(piece, cuts) if len(piece) else []

    def _placed_in(self, piece: np.ndarray, block: int) -> np.ndarray:
        """(SPAN + 1, P, 3, 4) local to world of pieces (P,), ascending, at the knots of a block."""
        inner = [
            np.empty((SPAN + 1, 0, 3, 4)),
            *(
                self._places(int(self._tree[rows[0]]), block)[:, self._piece[rows]]
                for rows in self._by_tree(piece)
            ),
        ]
        return joined(self._stands[piece], np.concatenate(inner, axis=1))

    def window(self, block: int, bundle: np.ndarray) -> PieceWindow:
        """The pieces that come into a bundle (2, D) in a block of time, and maybe some around it; of the
        same block as before, all of before too."""
        if block in self._windows:
            room, window = self._windows[block]
            if (room[0] <= bundle[0]).all() and (bundle[1] <= room[1]).all():
                return window
            # As far again beyond the room as these rays go, since others of their block come next.
            wider = np.stack([np.minimum(bundle[0], room[0]), np.maximum(bundle[1], room[1])])
            bundle = 2 * wider - room
        bundle = bundle + np.array([[-AROUND], [AROUND]])  # for rays to come
        trees = np.flatnonzero(within(*self._ever, bundle))
        ends = np.array([self._bounds_of(tree, block // EPOCH) for tree in trees.tolist()]).reshape(
            -1, 2, 3
        )
        trees = trees[within(ends[:, 0], ends[:, 1], bundle)]
        piece = np.concatenate([np.empty(0, np.int64), *(self._trees[n] for n in trees)])
        places = self._placed_in(piece, block)
        low, high = swept(self.boxes[self.mesh[piece]], places)
        near = np.flatnonzero(within(low, high, bundle))
        box = np.stack([low[near].min(0, initial=np.inf), high[near].max(0, initial=-np.inf)])
        window = PieceWindow(block * SPAN, piece[near], places[:, near], box)
        self._windows.pop(block, None)
        while len(self._windows) >= WINDOWS:
            self._windows.pop(next(iter(self._windows)))
        self._windows[block] = bundle, window
        return window

    def _places(self, tree: int, block: int) -> np.ndarray:
        """(SPAN + 1, G, 3, 4) of a tree's pieces in its own frame; kept."""
        knot = block * SPAN + np.arange(SPAN + 1)
        return self._placed.once((tree, block), lambda: self._sway.places(tree, knot))

    def _bounds_of(self, tree: int, epoch: int) -> np.ndarray:
        """(2, 3) corners in the world that a tree of those that sway does not leave in an epoch; kept."""
        knot = (epoch * EPOCH * SPAN) + np.arange(EPOCH * SPAN + 1)
        return self._bounds_in.once((tree, epoch), lambda: self._bounds(self._trees[tree], knot))

    def _bounds(self, rows: np.ndarray, knot: np.ndarray | None = None) -> np.ndarray:
        """(2, 3) corners in the world that a tree, of pieces (G,), does not leave between knots (K,); left
        out: ever."""
        stands, boxes = self._stands[rows[0]], self.boxes[self.mesh[rows]]
        # A piece without triangles has the corner of another: it adds nothing.
        rest = np.repeat(boxes[:1, :1], 2, axis=1).repeat(int(self._piece[rows].max()) + 1, axis=0)
        rest[self._piece[rows]] = boxes
        most = self._sway.most(int(self._tree[rows[0]]), rest[:, 0], rest[:, 1], knot)
        low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        centre = stands[:, :3] @ ((low + high) / 2) + stands[:, 3]
        out = np.abs(stands[:, :3]) @ ((high - low) / 2)
        out += np.linalg.norm(stands[:, :3], ord=2) * most
        return np.stack([centre - out, centre + out])

    def _join_seams(self) -> None:
        """List the copies of the triangles that pieces at a seam share.

        Which of them an engine in float32 meets first may depend on the rays it goes with; in float64 one is
        first.
        """
        size = np.array([len(rows) for rows in self.triangle], dtype=np.int64)
        self._first = np.cumsum(size) - size
        self._whole = np.concatenate([np.empty(0, np.int64), *self.triangle])
        self._rank, of = np.zeros(len(size), np.int64), np.repeat(np.arange(len(size)), size)
        self._many, self._begin = (np.zeros(len(self._whole), np.int64) for _ in "mb")
        copies = [np.empty((2, 0), np.int64)]  # rank of its piece in the tree, and triangle there
        total = 0
        for listed in self._known.values():
            self._rank[[m for _, m in listed]] = np.arange(len(listed))
            number = np.concatenate([self._first[m] + np.arange(size[m]) for _, m in listed])
            number = number[np.bincount(self._whole[number])[self._whole[number]] > 1]
            order = number[np.argsort(self._whole[number], kind="stable")]
            copies.append(np.stack([self._rank[of[order]], order - self._first[of[order]]]))
            _, begin, many = np.unique(self._whole[order], return_index=True, return_counts=True)
            self._begin[order], self._many[order] = (
                total + np.repeat(begin, many),
                np.repeat(many, many),
            )
            total += len(order)
        self._copies = np.concatenate(copies, axis=1)

    def copies(
        self, piece: np.ndarray, triangle: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows (M,) of those triangles of pieces (R,) that have copies at seams, once for each copy, itself
        among them, and these: pieces (M,), ascending of each row, and triangles (M,)."""
        number = self._first[self.mesh[piece]] + triangle
        many = self._many[number]
        row, which = numbered(many)
        rank, own = self._copies[:, self._begin[number][row] + which]
        return row, piece[row] + rank - self._rank[self.mesh[piece]][row], own


def _surfaces(
    scene: SceneGeometry, meshes: tuple[TriMesh, ...], index: np.ndarray
) -> SceneGeometry:
    """A scene with other meshes (I,), of which nothing else is told; those of no instance are left empty."""
    bare, used = dict.fromkeys(OF_MESHES, ()), {*index.tolist()}
    meshes = tuple(mesh if n in used else EMPTY for n, mesh in enumerate(meshes))
    return replace(scene, meshes=meshes, mesh_index=index, crowd=(), **bare)  # type: ignore[arg-type]


def trees_that_sway(scene: SceneGeometry, sway: ForestSway | None) -> np.ndarray:
    """(I,) the number in the stand of each instance that is a tree which sways, -1 of all others."""
    tree_of = np.full(len(scene), -1)
    if sway is not None:
        number = sway.number
        for instance in np.flatnonzero(scene.tree >= 0).tolist():
            tree = number.get(int(scene.tree[instance]), -1)
            mesh = scene.meshes[scene.mesh_index[instance]]
            if tree >= 0 and len(mesh.triangles) and sway.moves(tree):
                tree_of[instance] = tree
    return tree_of


def split_pieces(mesh: TriMesh, piece: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Each piece of a tree with its triangles, and with those of others that share a vertex with them.

    piece : (T,) of each triangle.
    """
    corner = mesh.triangles.astype(np.int64)
    count = int(piece.max()) + 1
    pair = distinct((corner * count + piece[:, None]).ravel())
    vertex, of = np.divmod(pair, count)
    first = np.searchsorted(vertex, np.arange(len(mesh.vertices) + 1))
    seam = np.flatnonzero((np.diff(first) > 1)[corner].any(axis=1))
    rows, where = [np.arange(len(piece))], [piece]
    for side in range(3):
        at = corner[seam, side]
        held, which = numbered(first[at + 1] - first[at])
        rows.append(seam[held])
        where.append(of[first[at][held] + which])
    both = distinct(np.concatenate(where) * len(piece) + np.concatenate(rows))
    which, row = np.divmod(both, len(piece))
    cuts = np.flatnonzero(np.diff(which, prepend=-1))
    return [(int(which[c]), part) for c, part in zip(cuts, np.split(row, cuts[1:]), strict=True)]


def boxes_of_pieces(corners: np.ndarray, piece: np.ndarray, count: int) -> np.ndarray:
    """(2, G, 3) smallest and largest coordinates of triangles (T, 3, 3) on each of G pieces, 0 where there
    are none. piece : (T,) that each triangle is on."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, piece, corners.min(axis=1))
    np.maximum.at(high, piece, corners.max(axis=1))
    boxes = np.stack([low, high])
    boxes[:, ~np.isfinite(low).all(axis=1)] = 0.0
    return boxes


def joined(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """(..., R, 3, 4) of going through the inner transforms (..., R, 3, 4) and then the outer (R, 3, 4)."""
    product = outer[:, :, :3] @ inner
    product[..., 3] += outer[:, :, 3]
    return product


def moved(transform: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(R, 3) points (R, 3) through transforms (R, 3, 4)."""
    return np.asarray(np.einsum("rij,rj->ri", transform[:, :, :3], points) + transform[:, :, 3])


def taken_back(transform: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(R, 3) points (R, 3) back through transforms (R, 3, 4)."""
    return turned_back(transform, points - transform[:, :, 3])


def turned_back(transform: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(R, 3) vectors (R, 3) back through the linear parts of transforms (R, 3, 4), by Cramer's rule; not
    finite where one is singular."""
    x, y, z = (transform[:, :, k] for k in range(3))
    across = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        volume = np.einsum("ri,ri->r", x, across[:, 0])
        return np.asarray(np.einsum("rij,rj->ri", across, vectors) / volume[:, None])
