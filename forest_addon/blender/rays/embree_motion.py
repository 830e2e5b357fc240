"""Embree on a scene that moves: instances that turn or sway, meshes that bend, and rays with a time each.

Rays go through the tree of what stands still, then through those of what moves meanwhile; what they find in
float32 is met again in float64, where the part is at the ray's time. What moves by keys has windows of up
to 128 samples, cut wherever something comes or goes, with the parts that are there then, each with as many
steps as its path needs to be right to ``WITHIN``. Trees that sway have windows of ``moving.SPAN`` knots,
with the pieces about the rays; Embree takes their places linearly between knots, as ``moving.PieceWindow``
does.
"""

from __future__ import annotations

from collections import OrderedDict
from threading import Lock
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial.transform import Rotation

from ...base.rows import distinct
from ...base.trimesh import TriMesh
from ...sensing.moving import MovingScene, PieceWindow
from ...sensing.rays.boxes import clip
from ...sensing.rays.caster import Hits
from ...sensing.rays.exact import meet, put_nearest
from ...sensing.rays.paths import RigidPath, corners_at_rest
from ...sensing.rays.search import RefinedSurfaces, in_tasks, search_on, whole_triangles
from .embree import (
    HIT_OF_ARRAY,
    TIME,
    EmbreeBuild,
    EmbreeCaster,
    collapsed,
    met_by,
    rays_of,
    send,
)

LONGEST = 128  # samples of a window; Embree takes one step more
ROUND = 16  # a window's samples are a multiple of this, so that wide steps fit
WITHIN = 1e-5  # m by which wider steps may miss a sample
KEPT = 4  # windows that are kept
MANY = 64  # moments at which something comes or goes, from which windows are short
SLACK = 1e-6  # of the scene's size, by which rays go on


def embree_motion(
    moving: MovingScene, threads: int = 1, like: EmbreeMotion | None = None
) -> EmbreeMotion | None:
    """A search in a scene that moves; None where its samples are not even, or not the same for all parts.

    like : of a scene of the same meshes, whose trees are shared where they are the same.

    Raises
    ------
    EmbreeError : Embree is not there, or has no memory left.
    """
    motion = moving.motion
    paths = [path for path in motion.paths.values() if isinstance(path, RigidPath)]
    if len(paths) < len(motion.paths):
        return None
    times = [one.time for one in (*paths, *motion.shapes.values())]
    whole = max(times, key=len, default=np.zeros(1))
    several = [time for time in times if len(time) > 1]
    if several:
        whole = np.unique(np.concatenate(several))
        steps = round((whole[-1] - whole[0]) / np.diff(whole).min())
        even = whole[0] + np.arange(steps + 1) * (whole[-1] - whole[0]) / steps
        near = np.minimum(np.searchsorted(even, whole - (even[1] - even[0]) / 2), steps)
        if np.abs(whole - even[near]).max() > 1e-9 * (1 + np.abs(whole).max()):
            return None
        even[near] = whole
        whole = even
    return EmbreeMotion(moving, whole, threads, like)


class EmbreeMotion:
    """See ``MotionSearch``. time : (K,) s, even samples that all parts have, or some of them in a row."""

    engine = "embree"

    def __init__(
        self,
        moving: MovingScene,
        time: np.ndarray,
        threads: int = 1,
        like: EmbreeMotion | None = None,
    ) -> None:
        scene, motion = moving.scene, moving.motion
        if like and [*map(id, scene.meshes)] != [*map(id, like._moving.scene.meshes)]:
            like = None
        self._moving, self._threads = moving, threads
        self._still = still = EmbreeCaster(moving.still, threads, like and like._still)
        # Trees of meshes that move, by their number, and what holds them for all that share them.
        self._trees: dict[int, int] = {} if like is None else like._trees
        self._holder: EmbreeBuild = still._build if like is None else like._holder
        self._surfaces = RefinedSurfaces(scene)
        self._first, self._count = float(time[0]), len(time)
        self._step = float(time[-1] - time[0]) / max(len(time) - 1, 1) or 1.0
        ends = np.unique([end for span in motion.spans.values() for end in span])
        self._breaks = ends[np.isfinite(ends)]
        most = ROUND if len(self._breaks) > MANY else LONGEST
        windows = max(1, -(-(len(time) - 1) // most))
        self._span = ROUND * max(1, -(-(len(time) - 1) // (ROUND * windows)))
        self._windows: OrderedDict[tuple[int, int], tuple[int, EmbreeBuild]] = OrderedDict()
        self._pieces: WeakKeyDictionary[PieceWindow, tuple[int, np.ndarray, EmbreeBuild]] = (
            WeakKeyDictionary()
        )
        self._lock = Lock()
        self._whole = {n: self._usable(n) for n in motion.rows.tolist()}
        self._rows = [r for r, n in enumerate(motion.rows.tolist()) if self._whole[n].any()]
        self._bound()
        self._steps = [self._step_of(n) for n in motion.rows.tolist()]

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: np.ndarray,
        *,
        time: np.ndarray,
        min_distance: np.ndarray,
        leaving: Hits | None = None,
    ) -> Hits:
        """The closest hits; see ``MotionSearch``."""
        hits = Hits.misses(len(origins))
        rest = np.isfinite(origins.sum(axis=1) + directions.sum(axis=1))
        rest &= min_distance <= max_distance
        sound = np.flatnonzero(rest)
        begin = np.maximum(min_distance, 0.0)
        sample = np.clip((time - self._first) / self._step, 0, self._count - 1)
        last = max(-(-(self._count - 1) // self._span), 1) - 1
        block = np.minimum((sample / self._span).astype(np.int64), last)
        stretch = np.searchsorted(self._breaks, time, "right")
        keyed = block * (len(self._breaks) + 1) + stretch

        def groups(rows: np.ndarray, pieces: PieceWindow | None) -> None:
            for chosen in distinct(keyed[rows]).tolist():
                some = rows if (keyed[rows] == chosen).all() else rows[keyed[rows] == chosen]
                number = divmod(chosen, len(self._breaks) + 1)
                left = Hits.misses(len(some)) if leaving is None else leaving.select(some)
                rays = origins[some], directions[some], min_distance[some], max_distance[some]
                when = sample[some] / self._span - number[0]
                group_hits = self._cast(*rays, time[some], left, number, when, pieces)
                if leaving is None and pieces is not None:
                    self._settle(group_hits, *rays[:3], time[some], pieces)
                hits.put(some, group_hits)

        given = origins, directions, begin, max_distance, time, sound
        for rows, window in self._moving.bundles(*given):
            rest[rows] = False
            groups(rows, window)
        groups(np.flatnonzero(rest), None)
        return hits

    def _cast(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        time: np.ndarray,
        left: Hits,
        number: tuple[int, int],
        when: np.ndarray,
        pieces: PieceWindow | None,
    ) -> Hits:
        """The closest hits of rays (R, 3), (R, 3) in one window of each kind; when : (R,) from 0 to 1 in that
        of what moves by keys."""
        tops = []  # of each window: Embree's scene, the box of it, and times of rays from 0 to 1
        if self._rows:
            tops.append((self._window(*number), self._swept, when))
        if pieces is not None:
            share = pieces.knot(time, self._moving.start) / (len(pieces.places) - 1)
            low, high = pieces.box
            box = low - self._slack, high + self._slack
            tops.append((self._pieces_at(pieces)[0], box, share))
        hits = Hits.misses(len(near))
        origin, way = np.ascontiguousarray(origins.T), np.ascontiguousarray(ways.T)

        def task(part: slice) -> None:
            def nearest(rows: np.ndarray, start: np.ndarray) -> Hits:
                rows = rows + part.start
                some = [(top, box, at[rows]) for top, box, at in tops]
                rays = origin[:, rows], way[:, rows], start, far[rows], time[rows]
                return self._nearest(*rays, some, pieces)

            hits.put(part, search_on(nearest, near[part], far[part], left.select(part)))

        in_tasks(task, len(near), self._threads)
        return hits

    def _nearest(
        self,
        origin: np.ndarray,
        way: np.ndarray,
        start: np.ndarray,
        limit: np.ndarray,
        time: np.ndarray,
        tops: list[tuple[int, tuple[np.ndarray, np.ndarray], np.ndarray]],
        pieces: PieceWindow | None,
    ) -> Hits:
        """Hits that rays (3, R) meet first in float32, with their exact distances."""
        hits = Hits.misses(len(limit))
        begin, leaves = clip(self._low, self._high, origin, way, start, limit)
        rays = np.flatnonzero(begin <= leaves)
        if not len(rays):
            return hits
        if len(rays) < len(limit):
            origin, way, begin = origin[:, rays], way[:, rays], begin[rays]
            limit, time = limit[rays], time[rays]
            tops = [(top, box, at[rays]) for top, box, at in tops]
        moved = origin + begin * way - self._centre[:, None]
        sent = rays_of(moved, way, (limit - begin) * (1 + 1e-6) + self._slack)
        library = self._still._library
        send(library, self._still._top, sent)
        for top, box, at in tops:
            near, leave = clip(*box, origin, way, begin, limit)
            sent[:, TIME] = at
            send(library, top, sent, near <= leave)
        met, instance, triangle = met_by(sent)
        if not len(met):
            return hits
        piece = np.flatnonzero(instance >= self._moving.count)
        if len(piece) and pieces is not None:
            known = self._pieces_at(pieces)[1]
            row = sent.view(np.uint32)[met[piece], HIT_OF_ARRAY]
            instance[piece] = self._moving.count + pieces.piece[known[row]]
        origin, way, time = origin.take(met, 1), way.take(met, 1), time[met]
        at = self._moving.scene.transform[instance]
        rows, row = self._moving.motion.row_of(instance)
        if len(rows):
            at[rows] = self._moving.motion.table.at(row, time[rows])
        if len(piece) and pieces is not None:
            at[piece] = self._placed(pieces, instance[piece], time[piece])
        distance, _ = self._surfaces.meet(origin, way, instance, triangle, at)
        bends = rows[self._moving.motion.bends(instance[rows])]
        if len(bends):
            ask = instance[bends], triangle[bends]
            corners = self._moving.motion.corners(self._moving.scene, *ask, time[bends])
            bent = origin.take(bends, 1), way.take(bends, 1)
            distance[bends], _ = self._surfaces.meet(*bent, *ask, at[bends], corners)
        hits.put(rays[met], Hits(distance, instance, triangle))
        return hits

    def _placed(self, pieces: PieceWindow, instance: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) of pieces of a window, by their instances, at times (R,)."""
        row = np.searchsorted(pieces.piece, instance - self._moving.count)
        return pieces.at(row, pieces.knot(time, self._moving.start))

    def _settle(
        self,
        hits: Hits,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        time: np.ndarray,
        window: PieceWindow,
    ) -> None:
        """Give hits (R,) at seams of pieces the copy of their triangle that is first in float64."""
        cut, count = self._moving.pieces, self._moving.count
        rows = np.flatnonzero(hits.instance >= count)
        row, piece, triangle = cut.copies(hits.instance[rows] - count, hits.triangle[rows])
        there = np.isin(piece, window.piece)
        of, instance, triangle = rows[row[there]], count + piece[there], triangle[there]
        own = corners_at_rest(self._moving.scene, instance, triangle)
        at = self._placed(window, instance, time[of])
        corners = np.einsum("rij,rkj->rki", at[:, :, :3], own)
        corners += at[:, None, :, 3] - origins[of, None]
        distance = meet(tuple(corners.swapaxes(0, 1)), np.zeros((len(of), 3)), ways[of])
        # Where none counts, it is met at its rim, in float32 alone.
        counts = np.flatnonzero((distance >= near[of]) & np.isfinite(distance))
        put_nearest(hits, of[counts], Hits(distance, instance, triangle).select(counts))

    def _usable(self, number: int) -> np.ndarray:
        """(T,) bool: which triangles of a part are met; where it bends, those finite at all times."""
        shape = self._moving.motion.shapes.get(number)
        mesh = self._mesh(number)
        if shape is None:
            return whole_triangles(mesh)
        finite = np.isfinite(shape.vertices).all(axis=(0, 2))
        return np.asarray(finite[mesh.triangles].all(axis=1))

    def _bound(self) -> None:
        """Set the box of all that rays may meet, at any time, and its centre."""
        boxes = [(self._still._low, self._still._high)]
        for row in self._rows:
            number = int(self._moving.motion.rows[row])
            mesh, shape = self._mesh(number), self._moving.motion.shapes.get(number)
            used = mesh.vertices[mesh.triangles[self._whole[number]]].reshape(-1, 3)
            box = (used.min(axis=0), used.max(axis=0)) if shape is None else shape.bounds()
            boxes.append(self._moving.motion.paths[number].swept(*box))
        lows, highs = (np.array(ends) for ends in zip(*boxes, strict=True))
        low, high = lows.min(axis=0), highs.max(axis=0)
        hull = self._moving.pieces.hull
        low, high = np.minimum(low, hull[0]), np.maximum(high, hull[1])
        finite = np.isfinite(self._still._low).all()
        self._centre = self._still._centre if finite else np.nan_to_num((low + high) / 2)
        size = float((high - low).max())
        self._slack = SLACK * (size if np.isfinite(size) else 0.0) + SLACK
        self._swept = (
            lows[1:].min(axis=0, initial=np.inf) - self._slack,
            highs[1:].max(axis=0, initial=-np.inf) + self._slack,
        )
        self._low, self._high = low - self._slack, high + self._slack

    def _step_of(self, number: int) -> int:
        """Samples of a step of a part's way in Embree: as many as do not take it off its samples."""
        path = self._moving.motion.paths[number]
        assert isinstance(path, RigidPath)
        if len(path.time) == 1:
            return self._span
        if len(path.time) < self._count:
            return 1
        mesh, shape = self._mesh(number), self._moving.motion.shapes.get(number)
        far = np.abs(mesh.vertices if shape is None else np.array(shape.bounds())).max(axis=0)
        reach = float(np.linalg.norm(np.nan_to_num(far)))
        for step in (self._span, 16, 8, 4, 2):
            if self._span % step or (self._count - 1) % step:
                continue
            wide = RigidPath(path.time[::step], path.transform[::step])
            apart = wide.at(path.time) - path.transform
            off = np.linalg.norm(apart[:, :, 3], axis=1)
            off += reach * np.linalg.norm(apart[:, :, :3], axis=(1, 2))
            if off.max() <= WITHIN:
                return step
        return 1

    def _mesh(self, number: int) -> TriMesh:
        return self._moving.scene.meshes[self._moving.scene.mesh_index[number]]

    def _tree(self, number: int) -> int:
        """Embree's scene of the mesh of a part that keeps its shape."""
        index = int(self._moving.scene.mesh_index[number])
        if index in self._still._of_mesh:
            return self._still._of_mesh[index]
        if index not in self._trees:
            self._trees[index] = self._holder.mesh(self._moving.scene.meshes[index])
        return self._trees[index]

    def _pieces_at(self, window: PieceWindow) -> tuple[int, np.ndarray, EmbreeBuild]:
        """Embree's scene of the pieces of a window, rows of those that have a surface, and what keeps it."""
        if window not in self._pieces:
            still, number = self._still, self._moving.count + window.piece
            mesh_of = self._moving.scene.mesh_index
            known = np.flatnonzero([len(self._mesh(one).triangles) > 0 for one in number.tolist()])
            number, places = number[known], window.places[:, known]
            places[:, :, :, 3] -= self._centre
            build = EmbreeBuild(still._library, still._device, still._build)
            used, which = np.unique(mesh_of[number], return_index=True, return_inverse=True)[1:]
            scenes = [self._tree(one) for one in number[used].tolist()]
            top = build.array(scenes, which, places, len(self._moving.scene))
            self._pieces[window] = top, known, build
        return self._pieces[window]

    def _window(self, block: int, stretch: int) -> int:
        """Embree's scene of what moves by keys in a block of samples and is there in a stretch between
        breaks."""
        with self._lock:
            key = block, stretch
            if key not in self._windows:
                while len(self._windows) >= KEPT:
                    self._windows.popitem(last=False)
                still = self._still
                build = EmbreeBuild(still._library, still._device, still._build)
                self._windows[key] = self._made(block, stretch, build), build
            self._windows.move_to_end(key)
            return self._windows[key][0]

    def _made(self, block: int, stretch: int, build: EmbreeBuild) -> int:
        start = self._first + block * self._span * self._step
        breaks = np.concatenate([[-np.inf], self._breaks, [np.inf]])
        since, until = breaks[stretch], breaks[stretch + 1]
        numbers, scenes, places = [], [], []
        motion = self._moving.motion
        for row in self._rows:
            number = int(motion.rows[row])
            first, last = motion.span(number)
            if first > since or last < until:
                continue
            path = motion.paths[number]
            assert isinstance(path, RigidPath)
            time = start + self._step * np.arange(0, self._span + 1, self._steps[row])
            if len(path.time) == 1:
                time = time[:1]
            at = path.at(time, beyond=len(path.time) == self._count)
            at[:, :, 3] -= self._centre
            numbers.append(number)
            places.append(quaternions(at))
            bends = number in motion.shapes
            scenes.append(self._bent(number, build, block) if bends else self._tree(number))
        return build.instances(numbers, scenes, places, turn=True)

    def _bent(self, number: int, build: EmbreeBuild, block: int) -> int:
        """Embree's scene of a part's triangles as they bend in a block of samples."""
        shape, steps = self._moving.motion.shapes[number], None
        if len(shape.time) == 1:
            steps = shape.vertices[:1]
        else:
            first = round((shape.time[0] - self._first) / self._step)
            wide = round((shape.time[1] - shape.time[0]) / self._step)
            step = int(np.gcd.reduce([first, wide, self._span]))
            sample = block * self._span + np.arange(0, self._span + 1, step)
            if step == wide:
                steps = shape.vertices[np.clip((sample - first) // wide, 0, len(shape.time) - 1)]
            else:
                every = np.arange(shape.vertices.shape[1])
                time = self._first + self._step * sample
                steps = np.stack([shape.at(every[None], t[None])[0] for t in time])
        return build.shape(steps, collapsed(self._mesh(number).triangles, self._whole[number]))


def quaternions(transform: np.ndarray) -> np.ndarray:
    """(S, 16) float32 of transforms (S, 3, 4) as Embree's ``RTCQuaternionDecomposition``: scale, skew, shift,
    turn (r, i, j, k), place."""
    turn, shape = np.linalg.qr(transform[:, :, :3])
    sign = np.where(np.diagonal(shape, axis1=1, axis2=2) < 0, -1.0, 1.0)
    sign[:, 2] *= np.linalg.det(turn * sign[:, None, :])
    turn, shape = turn * sign[:, None, :], shape * sign[:, :, None]
    parts = np.zeros((len(transform), 16))
    parts[:, :3] = np.diagonal(shape, axis1=1, axis2=2)
    parts[:, 3], parts[:, 4], parts[:, 5] = shape[:, 0, 1], shape[:, 0, 2], shape[:, 1, 2]
    parts[:, 9:13] = Rotation.from_matrix(turn).as_quat()[:, [3, 0, 1, 2]]
    parts[:, 13:] = transform[:, :, 3]
    return np.ascontiguousarray(parts, dtype=np.float32)
