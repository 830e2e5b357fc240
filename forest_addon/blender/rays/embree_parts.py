"""Embree on a scene that moves: instances that turn, meshes that bend, and rays with a time each.

Time is cut into windows of up to 128 samples, and wherever something comes or goes. A window has the parts
that are there then, each with as many steps as its way needs to be right to ``WITHIN``. Rays go through the
tree of what stands still, then through that of the window, in the same packets; what they find in float32 is
met again in float64, where the part is at the ray's time.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from threading import Lock

import numpy as np
from scipy.spatial.transform import Rotation

from ...base.trimesh import OTHER, TriMesh
from ...sensing.rays.boxes import clip
from ...sensing.rays.caster import Hits
from ...sensing.rays.geometry import SceneGeometry
from ...sensing.rays.paths import PathTable, RigidPath, SceneMotion
from ...sensing.rays.search import RefinedSurfaces, in_tasks, search_on, whole_triangles
from .embree import EmbreeBuild, EmbreeCaster, RayPackets, lanes_for

LONGEST = 128  # samples of a window; Embree takes one step more
ROUND = 16  # a window's samples are a multiple of this, so that wide steps fit
WITHIN = 1e-5  # m by which wider steps may miss a sample
KEPT = 4  # windows that are kept
MANY = 64  # moments at which something comes or goes, from which windows are short
SLACK = 1e-6  # of the scene's size, by which rays go on


def embree_parts(scene: SceneGeometry, motion: SceneMotion, threads: int = 1) -> EmbreeParts | None:
    """An engine for a scene that moves; None where its samples are not even, or not the same for all parts.

    Raises
    ------
    EmbreeError : Embree is not there, or has no memory left.
    """
    times = [path.time for path in motion.paths.values()]
    times += [shape.time for shape in motion.shapes.values()]
    whole = max(times, key=len)
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
    return EmbreeParts(scene, motion, whole, threads)


class EmbreeParts:
    """See ``MotionEngine``. time : (K,) s, even samples that all parts have, or some of them in a row."""

    engine = "embree"

    def __init__(
        self, scene: SceneGeometry, motion: SceneMotion, time: np.ndarray, threads: int = 1
    ) -> None:
        self._scene, self._motion, self._threads = scene, motion, threads
        self._still = EmbreeCaster(_without(scene, motion.rows), threads)
        self._surfaces = RefinedSurfaces(scene, self._still._surfaces)
        self._first, self._count = float(time[0]), len(time)
        self._step = float(time[-1] - time[0]) / max(len(time) - 1, 1) or 1.0
        ends = np.unique([end for span in motion.spans.values() for end in span])
        self._breaks = ends[np.isfinite(ends)]
        most = ROUND if len(self._breaks) > MANY else LONGEST
        windows = max(1, -(-(len(time) - 1) // most))
        self._span = ROUND * max(1, -(-(len(time) - 1) // (ROUND * windows)))
        self._windows: OrderedDict[tuple[int, int], tuple[int, EmbreeBuild]] = OrderedDict()
        self._lock = Lock()
        self._usable = {n: self._whole(n) for n in motion.rows.tolist()}
        self._rows = [r for r, n in enumerate(motion.rows.tolist()) if len(self._usable[n])]
        self._all = all(
            len(rows) == len(self._mesh(n).triangles) for n, rows in self._usable.items()
        )
        self._bound()
        self._steps = [self._step_of(n) for n in motion.rows.tolist()]

    def cast(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        time: np.ndarray,
        leaving: Hits | None,
    ) -> Hits:
        """The closest hits; see ``MotionEngine``."""
        hits = Hits.misses(len(origins))
        sound = np.isfinite(origins.sum(axis=1) + ways.sum(axis=1)) & (near <= far)
        sample = np.clip((time - self._first) / self._step, 0, self._count - 1)
        last = max(-(-(self._count - 1) // self._span), 1) - 1
        number = np.minimum((sample / self._span).astype(np.int64), last)
        passed = np.searchsorted(self._breaks, time, "right")
        window = number * (len(self._breaks) + 1) + passed
        first = window.min(initial=window.max(initial=0))
        alone = bool(sound.all() and first == window.max(initial=first))
        for chosen in [int(first)] if alone else np.unique(window[sound]).tolist():
            rows = np.flatnonzero(sound & (window == chosen))
            block, stretch = divmod(chosen, len(self._breaks) + 1)
            top = self._window(block, stretch)
            when = sample[rows] / self._span - block
            given = (origins, ways, near, far, time)
            if not alone:
                given = tuple(array[rows] for array in given)
            given = (*given, when)
            left = Hits.misses(len(rows)) if leaving is None else leaving.select(rows)
            found = Hits.misses(len(rows))

            def task(
                part: slice,
                top: int = top,
                given: tuple[np.ndarray, ...] = given,
                left: Hits = left,
                found: Hits = found,
            ) -> None:
                some = tuple(array[part] for array in given)
                found.put(part, self._cast(top, some, left.select(part)))

            in_tasks(task, len(rows), self._threads)
            hits.put(rows, found)
        return hits

    def _cast(self, top: int, given: tuple[np.ndarray, ...], left: Hits) -> Hits:
        origins, ways, near, far, time, when = given
        origin, way = np.ascontiguousarray(origins.T), np.ascontiguousarray(ways.T)

        def nearest(rows: np.ndarray, start: np.ndarray) -> Hits:
            if len(rows) == len(near):
                return self._nearest(top, origin, way, start, far, time, when)
            rays = origin[:, rows], way[:, rows]
            return self._nearest(top, *rays, start, far[rows], time[rows], when[rows])

        return search_on(nearest, near, far, left)

    def _nearest(
        self,
        top: int,
        origin: np.ndarray,
        way: np.ndarray,
        start: np.ndarray,
        limit: np.ndarray,
        time: np.ndarray,
        when: np.ndarray,
    ) -> Hits:
        """Return what rays (3, R) meet first in float32, by its exact distance.

        when : (R,) from 0 to 1 in the window.
        """
        found = Hits.misses(len(limit))
        begin, leaves = clip(self._low, self._high, origin, way, start, limit)
        rays = np.flatnonzero(begin <= leaves)
        if not len(rays):
            return found
        if len(rays) < len(limit):
            origin, way, begin = origin[:, rays], way[:, rays], begin[rays]
            limit, time, when = limit[rays], time[rays], when[rays]
        moved = origin + begin * way - self._centre[:, None]
        packets = RayPackets(len(rays), lanes_for(moved, way))
        packets.fill(moved, way, (limit - begin) * (1 + 1e-6) + self._slack, when)
        library = self._still._library
        packets.trace(library, self._still._top)
        near, leave = clip(*self._swept, origin, way, begin, limit)
        packets.trace(library, top, np.flatnonzero(near <= leave))
        instance, primitive, met = packets.read(len(rays))
        if not len(met):
            return found
        triangle = self._numbered(instance, primitive)
        origin, way = np.ascontiguousarray(origin[:, met]), np.ascontiguousarray(way[:, met])
        distance = self._surfaces.distance(origin, way, instance, triangle)
        mine, row = self._motion.row_of(instance)
        if len(mine):
            ask = instance[mine], triangle[mine], time[met[mine]]
            corners = self._motion.corners(self._scene, *ask) if self._motion.shapes else None
            place = self._motion.table.at(row, ask[2])
            rays_of = np.ascontiguousarray(origin[:, mine]), np.ascontiguousarray(way[:, mine])
            distance[mine] = self._surfaces.distance(*rays_of, *ask[:2], place, corners)
        found.put(rays[met], Hits(distance, instance, triangle))
        return found

    def _numbered(self, instance: np.ndarray, primitive: np.ndarray) -> np.ndarray:
        """Triangles of the meshes, from those that Embree was given."""
        triangle = primitive.copy()
        mine, row = self._motion.row_of(instance)
        still = np.ones(len(instance), dtype=bool)
        still[mine] = False
        if not self._still._whole:
            triangle[still] = self._still._numbered(instance[still], primitive[still])
        for place in [] if self._all else np.unique(row).tolist():
            some = mine[row == place]
            usable = self._usable[int(self._motion.rows[place])]
            triangle[some] = usable[primitive[some]]
        return triangle

    def _whole(self, number: int) -> np.ndarray:
        """Triangles of a part that Embree is given: all of what bends, where its corners are finite."""
        mesh = self._mesh(number)
        if number not in self._motion.shapes:
            return whole_triangles(mesh)
        finite = np.isfinite(self._motion.shapes[number].vertices).all(axis=(0, 2))
        return np.flatnonzero(finite[mesh.triangles].all(axis=1))

    def _bound(self) -> None:
        """Set the box of all that rays may meet, at any time, and its centre."""
        boxes = [(self._still._box_low, self._still._box_high)]
        for row in self._rows:
            number = int(self._motion.rows[row])
            mesh, shape = self._mesh(number), self._motion.shapes.get(number)
            used = mesh.vertices[mesh.triangles[self._usable[number]]].reshape(-1, 3)
            box = (used.min(axis=0), used.max(axis=0)) if shape is None else shape.bounds()
            boxes.append(self._motion.paths[number].swept(*box))
        lows, highs = (np.array(ends) for ends in zip(*boxes, strict=True))
        self._low, self._high = np.min(lows, axis=0), np.max(highs, axis=0)
        finite = np.isfinite(self._still._low).all()
        middle = (self._low + self._high) / 2
        self._centre = self._still._centre if finite else np.nan_to_num(middle)
        size = float((self._high - self._low).max())
        self._slack = SLACK * (size if np.isfinite(size) else 0.0) + SLACK
        self._swept = (
            lows[1:].min(axis=0, initial=np.inf) - self._slack,
            highs[1:].max(axis=0, initial=-np.inf) + self._slack,
        )
        self._low, self._high = self._low - self._slack, self._high + self._slack

    def _step_of(self, number: int) -> int:
        """Samples of a step of a part's way in Embree: as many as do not take it off its samples."""
        path = self._motion.paths[number]
        if len(path.time) == 1:
            return self._span
        if len(path.time) < self._count:
            return 1
        mesh, shape = self._mesh(number), self._motion.shapes.get(number)
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
        return self._scene.meshes[self._scene.mesh_index[number]]

    def _window(self, block: int, stretch: int) -> int:
        """Embree's scene of what moves in a block of samples and is there in a stretch between breaks."""
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
        table: PathTable = self._motion.table
        for row in self._rows:
            number = int(self._motion.rows[row])
            first, last = self._motion.span(number)
            if first > since or last < until:
                continue
            step = self._steps[row]
            time = start + self._step * np.arange(0, self._span + 1, step)
            if len(self._motion.paths[number].time) == 1:
                time = time[:1]
            whole = len(self._motion.paths[number].time) == self._count
            at = table.at(np.full(len(time), row), time, beyond=whole)
            at[:, :, 3] -= self._centre
            numbers.append(number)
            places.append(quaternions(at))
            scenes.append(self._of_part(number, build, block))
        return build.turning(numbers, scenes, places)

    def _of_part(self, number: int, build: EmbreeBuild, block: int) -> int:
        """Embree's scene of a part's triangles: kept where it is rigid, of a window where it bends."""
        mesh, shape = self._mesh(number), self._motion.shapes.get(number)
        if shape is None:
            made, index = self._still._of_mesh, int(self._scene.mesh_index[number])
            if index not in made:
                made[index] = self._still._build.mesh(mesh, self._usable[number])
            return made[index]
        row = np.zeros(1, np.int64)
        if len(shape.time) > 1:
            first = round((shape.time[0] - self._first) / self._step)
            wide = round((shape.time[1] - shape.time[0]) / self._step)
            step = int(np.gcd.reduce([first, wide, self._span]))
            sample = block * self._span + np.arange(0, self._span + 1, step)
            if step == wide:
                row = np.clip((sample - first) // wide, 0, len(shape.time) - 1)
                steps = shape.vertices[row]
            else:
                every = np.arange(shape.vertices.shape[1])
                time = self._first + self._step * sample
                steps = np.stack([shape.at(every[None], t[None])[0] for t in time])
        else:
            steps = shape.vertices[row]
        return build.shape(steps, mesh.triangles[self._usable[number]])


def quaternions(transform: np.ndarray) -> np.ndarray:
    """(S, 16) float32 of transforms (S, 3, 4) as Embree's ``RTCQuaternionDecomposition``: scale, skew, shift,
    turn (r, i, j, k), place."""
    turn, shape = np.linalg.qr(transform[:, :, :3])
    sign = np.where(np.diagonal(shape, axis1=1, axis2=2) < 0, -1.0, 1.0)
    sign[:, 2] *= np.linalg.det(turn * sign[:, None, :])
    turn, shape = turn * sign[:, None, :], shape * sign[:, :, None]
    found = np.zeros((len(transform), 16))
    found[:, :3] = np.diagonal(shape, axis1=1, axis2=2)
    found[:, 3], found[:, 4], found[:, 5] = shape[:, 0, 1], shape[:, 0, 2], shape[:, 1, 2]
    found[:, 9:13] = Rotation.from_matrix(turn).as_quat()[:, [3, 0, 1, 2]]
    found[:, 13:] = transform[:, :, 3]
    return np.ascontiguousarray(found, dtype=np.float32)


def _without(scene: SceneGeometry, rows: np.ndarray) -> SceneGeometry:
    """The scene with the same numbers, where some instances have no surface."""
    empty = TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3), np.int64), OTHER)
    index = scene.mesh_index.copy()
    index[rows] = len(scene.meshes)
    return replace(
        scene,
        meshes=(*scene.meshes, empty),
        mesh_index=index,
        slot_reflectance=(),
        asset=(),
        slot_names=(),
        slot_optics=(),
    )
