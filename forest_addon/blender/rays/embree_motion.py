"""Embree on a scene that moves: instances that turn or sway, meshes that bend, and rays with a time each.

Rays go through the tree of what stands still, then through those of what moves meanwhile; what they find in
float32 is met again in float64, where the part is at the ray's time. What moves by keys has windows of up
to 128 samples, cut wherever something comes or goes, with the parts that are there then, each with as many
steps as its path needs to be right to ``WITHIN``. Trees that sway have windows of ``moving.SPAN`` knots,
with the pieces about the rays; Embree takes their places linearly between knots, as ``moving.PieceWindow``
does.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from threading import Lock
from weakref import WeakKeyDictionary, proxy

import numpy as np
import scipy

from ...base.kept import LastAsked
from ...base.trimesh import TriMesh
from ...sensing.moving import MovingScene, PieceWindow
from ...sensing.moving_rays import MovingCaster
from ...sensing.rays.boxes import clip
from ...sensing.rays.caster import Hits, unit_columns
from ...sensing.rays.exact import meet, put_nearest
from ...sensing.rays.paths import RigidPath
from ...sensing.rays.search import whole_triangles
from .embree import EmbreeBuild, EmbreeCaster, EmbreeSearch, collapsed

LONGEST = 128  # samples of a window; Embree takes one step more
ROUND = 16  # a window's samples are a multiple of this, so that wide steps fit
WITHIN = 1e-5  # m by which wider steps may miss a sample
KEPT = 4  # windows that are kept
MANY = 64  # moments at which something comes or goes, from which windows are short
SLACK = 1e-6  # m by which a box of what moves is larger


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


class EmbreeMotion(MovingCaster):
    """See ``MovingCaster``. time : (K,) s, even samples that all parts have, or some of them in a row."""

    engine = "embree"

    def __init__(
        self,
        moving: MovingScene,
        time: np.ndarray,
        threads: int = 1,
        like: EmbreeMotion | None = None,
    ) -> None:
        scene, motion = moving.scene, moving.motion
        if like and [*map(id, scene.meshes)] != [*map(id, like.moving.scene.meshes)]:
            like = None
        self.moving, self.scene = moving, scene
        self.still = still = EmbreeCaster(moving.still, threads, like and like.still)
        # Trees of meshes that move, by their number, and what holds them for all that share them.
        self._trees: dict[int, int] = {} if like is None else like._trees
        self._holder: EmbreeBuild = still._build if like is None else like._holder
        self._first, self._count = float(time[0]), len(time)
        self._step = float(time[-1] - time[0]) / max(len(time) - 1, 1) or 1.0
        ends = np.unique([end for span in motion.spans.values() for end in span])
        self._breaks = ends[np.isfinite(ends)]
        most = ROUND if len(self._breaks) > MANY else LONGEST
        windows = max(1, -(-(len(time) - 1) // most))
        self._span = ROUND * max(1, -(-(len(time) - 1) // (ROUND * windows)))
        self._windows: LastAsked[tuple[int, int], KeyedParts] = LastAsked(KEPT)
        self._pieces: WeakKeyDictionary[PieceWindow, SwayingPieces] = WeakKeyDictionary()
        self._lock = Lock()
        self._whole = {n: self._usable(n) for n in motion.rows.tolist()}
        self._rows = [r for r, n in enumerate(motion.rows.tolist()) if self._whole[n].any()]
        low, high = moving.keyed[self._rows].swapaxes(0, 1)  # of what moves by keys, at any time
        self.swept = low.min(0, initial=np.inf) - SLACK, high.max(0, initial=-np.inf) + SLACK
        self._steps = [self._step_of(n) for n in motion.rows.tolist()]

    def _met(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        time: np.ndarray,
        sound: np.ndarray,
        leaving: Hits | None,
    ) -> Iterator[tuple[np.ndarray, Hits]]:
        for rows, search in self._searches(origins, ways, near, far, time, sound):
            yield (
                rows,
                search.cast(
                    origins[rows],
                    ways[rows],
                    far[rows],
                    min_distance=near[rows],
                    leaving=None if leaving is None else leaving.select(rows),
                    time=time[rows],
                ),
            )

    def _searches(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        begin: np.ndarray,
        limit: np.ndarray,
        time: np.ndarray,
        sound: np.ndarray,
    ) -> Iterator[tuple[np.ndarray, EmbreeSearch]]:
        """Rows of rays that may meet what moves, and the searches that find it."""
        for rows, window in self.moving.bundles(origins, ways, begin, limit, time, sound):
            if window not in self._pieces:
                self._pieces[window] = SwayingPieces(self, window)
            yield rows, self._pieces[window]
        if not self._rows:
            return
        enters, leaves = clip(
            *self.swept, origins[sound].T, ways[sound].T, begin[sound], limit[sound]
        )
        near = sound[enters <= leaves]
        last = max(-(-(self._count - 1) // self._span), 1) - 1
        block = np.clip(self.share(time[near], 0).astype(np.int64), 0, last)
        stretch = np.searchsorted(self._breaks, time[near], "right")
        for number in np.unique(np.stack([block, stretch]), axis=1).T.tolist():
            yield near[(block == number[0]) & (stretch == number[1])], self._window(*number)

    def share(self, time: np.ndarray, block: int) -> np.ndarray:
        """Times (R,), s, from 0 to 1 in a block of samples."""
        sample = np.clip((time - self._first) / self._step, 0, self._count - 1)
        return np.asarray(sample / self._span - block)

    def _usable(self, number: int) -> np.ndarray:
        """(T,) bool: which triangles of a part are met; where it bends, those finite at all times."""
        shape = self.moving.motion.shapes.get(number)
        mesh = self._mesh(number)
        if shape is None:
            return whole_triangles(mesh)
        finite = np.isfinite(shape.vertices).all(axis=(0, 2))
        return np.asarray(finite[mesh.triangles].all(axis=1))

    def _step_of(self, number: int) -> int:
        """Samples of a step of a part's way in Embree: as many as do not take it off its samples."""
        path = self.moving.motion.paths[number]
        assert isinstance(path, RigidPath)
        if len(path.time) == 1:
            return self._span
        if len(path.time) < self._count:
            return 1
        mesh, shape = self._mesh(number), self.moving.motion.shapes.get(number)
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
        return self.moving.scene.meshes[self.moving.scene.mesh_index[number]]

    def tree(self, number: int) -> int:
        """Embree's scene of the mesh of a part that keeps its shape."""
        index = int(self.moving.scene.mesh_index[number])
        if index in self.still._of_mesh:
            return self.still._of_mesh[index][0]
        if index not in self._trees:
            self._trees[index] = self._holder.mesh(self._mesh(number))
        return self._trees[index]

    def _window(self, block: int, stretch: int) -> KeyedParts:
        """Search among what moves by keys in a block of samples, in a stretch between breaks."""
        with self._lock:
            make = partial(KeyedParts, self, block, stretch)
            return self._windows.once((block, stretch), make)

    def bent(self, number: int, build: EmbreeBuild, block: int) -> int:
        """Embree's scene of a part's triangles as they bend in a block of samples."""
        shape, steps = self.moving.motion.shapes[number], None
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


class SwayingPieces(EmbreeSearch):
    """Search among the pieces of a window, which go straight from knot to knot."""

    def __init__(self, of: EmbreeMotion, window: PieceWindow) -> None:
        super().__init__(of.moving.scene, of.still.threads)
        self._moving, self._last = of.moving, len(window.places) - 1
        self._window = proxy(window)  # whose end is ours
        self._library, device = of.still._library, of.still._device
        self._build = EmbreeBuild(self._library, device, of.still._build)
        self._number = of.moving.count + window.piece
        self._bound(*window.box)
        mesh_of = of.moving.scene.mesh_index[self._number]
        used, which = np.unique(mesh_of, return_index=True, return_inverse=True)[1:]
        places = window.places.astype(np.float32)
        places[..., 3] = window.places[..., 3] - self._centre
        trees = [of.tree(one) for one in self._number[used].tolist()]
        self._top = self._build.array(trees, which, places)
        self._describe(window.places, self._number)

    def _knot(self, time: np.ndarray) -> np.ndarray:
        return self._window.knot(time, self._moving.start)

    def _found(
        self, instance: np.ndarray, row: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
        return self._number[row], self._window.at(row, self._knot(time))[0], None

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
        time: float | np.ndarray = 0.0,
    ) -> Hits:
        """The closest hit of each ray; of copies of a triangle at a seam the one that is first in float64."""
        limits = {"min_distance": min_distance, "leaving": leaving, "time": time}
        hits = super().cast(origins, directions, max_distance, **limits)
        if leaving is not None:
            return hits
        cut, count = self._moving.pieces, self._moving.count
        when = np.broadcast_to(time, len(hits.distance))
        rows = np.flatnonzero(hits.found)
        row, piece, triangle = cut.copies(hits.instance[rows] - count, hits.triangle[rows])
        there = np.isin(piece, self._window.piece)
        of, instance, triangle = rows[row[there]], count + piece[there], triangle[there]
        own = self._moving.scene.corners(instance, triangle)
        place = np.searchsorted(self._number, instance)
        at = self._window.at(place, self._knot(when[of]))[0]
        corners = np.einsum("rij,rkj->rki", at[:, :, :3], own)
        corners += at[:, None, :, 3] - origins[of, None]
        ways = unit_columns(directions[of].T).T
        distance = meet(tuple(corners.swapaxes(0, 1)), np.zeros((len(of), 3)), ways)
        # Where none counts, it is met at its rim, in float32 alone.
        near = np.broadcast_to(min_distance, len(hits.distance))[of]
        counts = np.flatnonzero((distance >= near) & np.isfinite(distance))
        nowhere = np.full((len(of), 3), np.nan)
        put_nearest(hits, of[counts], Hits(distance, instance, triangle, nowhere).select(counts))
        return hits


class KeyedParts(EmbreeSearch):
    """Search among what moves by keys in a block of samples and is there in a stretch between breaks."""

    def __init__(self, of: EmbreeMotion, block: int, stretch: int) -> None:
        super().__init__(of.moving.scene, of.still.threads)
        self._of, self._block, self._library = of, block, of.still._library
        self._build = build = EmbreeBuild(self._library, of.still._device, of.still._build)
        self._bound(*of.swept)
        start = of._first + block * of._span * of._step
        breaks = np.concatenate([[-np.inf], of._breaks, [np.inf]])
        since, until = breaks[stretch], breaks[stretch + 1]
        numbers, scenes, places = [], [], []
        motion = of.moving.motion
        for row in of._rows:
            number = int(motion.rows[row])
            first, last = motion.span(number)
            if first > since or last < until:
                continue
            path = motion.paths[number]
            assert isinstance(path, RigidPath)
            time = start + of._step * np.arange(0, of._span + 1, of._steps[row])
            if len(path.time) == 1:
                time = time[:1]
            at = path.at(time, beyond=len(path.time) == of._count)
            at[:, :, 3] -= self._centre
            numbers.append(number)
            places.append(quaternions(at))
            bends = number in motion.shapes
            scenes.append(of.bent(number, build, block) if bends else of.tree(number))
        self._top = build.instances(numbers, scenes, places, turn=True)

    def _knot(self, time: np.ndarray) -> np.ndarray:
        return self._of.share(time, self._block)

    def _found(
        self, instance: np.ndarray, row: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
        scene, motion = self.scene, self._of.moving.motion
        place = motion.table.at(motion.row_of(instance)[1], time)
        bent = motion.corners(scene, instance, triangle, time) if motion.shapes else None
        return instance, place, bent


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
    parts[:, 9:13] = scipy.spatial.transform.Rotation.from_matrix(turn).as_quat()[:, [3, 0, 1, 2]]
    parts[:, 13:] = transform[:, :, 3]
    return np.ascontiguousarray(parts, dtype=np.float32)
