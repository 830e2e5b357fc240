"""Samples of a scene over time, and how it moves: which instance is which, where it goes, how it bends.

An instance is known by its object, by whose mesh it has, and by its number among those alike. From one
sample to the next it moves where it is in both, with the same triangles, and its object has as many
instances; else it stands until the next sample, and is then gone, or another. What goes far between two
samples and hardly before and after has jumped: it stands, too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.trimesh import TriMesh
from .geometry import SceneGeometry
from .paths import RigidPath, SceneMotion, ShapePath

STANDS = 1e-7  # metres, and parts of a turn, that single precision may shake
BENT = 1e-4  # m that points of what changes its shape may be off between two samples
WIDEST = 16  # samples of a step of a shape
JUMP, APART = 1e-3, 4.0  # m of a jump at least, and how often what is gone in the steps beside it


@dataclass(frozen=True)
class Shape:
    """A mesh that may change: its vertices (V, 3) float32 in its own frame, and which triangles it has."""

    vertices: np.ndarray
    mesh: TriMesh  # the first that was read with these triangles


@dataclass(frozen=True)
class SceneSample:
    """A scene of I instances at one time.

    transform : (I, 3, 4). name : names of objects. object_index, mesh_index : (I,) as in ``SceneGeometry``.
    source : (I,) names of the objects whose meshes these are; "" where nodes made them.
    shapes : of the meshes that may change, by number.
    """

    transform: np.ndarray
    name: tuple[str, ...]
    object_index: np.ndarray
    mesh_index: np.ndarray
    shapes: dict[int, Shape]
    source: tuple[str, ...]

    @property
    def nbytes(self) -> int:
        """Bytes that it takes."""
        return self.transform.nbytes + sum(s.vertices.nbytes for s in self.shapes.values())


class AppearingObjects(ValueError):
    """Objects are there meanwhile that the scene as it was read does not have; ``names`` says which."""

    def __init__(self, names: list[str]) -> None:
        super().__init__(", ".join(names))
        self.names = names


class Tracks:
    """Instances of a scene followed through samples at ascending times (K,), s.

    scene : as it was read. now : a sample of that. jumps : whether samples are close enough to tell jumps.

    joined : (K - 1, N) bool, which instances move from a sample to the next, or stand until then; the first
    of them are those of the scene.

    Raises
    ------
    AppearingObjects : objects that the scene does not have are there meanwhile.
    """

    def __init__(
        self,
        scene: SceneGeometry,
        now: SceneSample,
        time: np.ndarray,
        samples: Sequence[SceneSample],
        jumps: bool = False,
    ) -> None:
        self._scene, self._now, self._time, self._samples = scene, now, time, samples
        self._keys: dict[tuple[tuple[str, str], int], int] = {}
        usual = self._found(now)
        columns_of = [
            usual
            if (
                sample.name == now.name
                and sample.source == now.source
                and np.array_equal(sample.object_index, now.object_index)
            )
            else self._found(sample)
            for sample in samples
        ]
        self._many = {
            obj: np.array([count[obj] for _, count in columns_of])
            for obj in dict.fromkeys(obj for obj, _ in self._keys)
        }
        appearing = {name for name, _ in self._many.keys() - usual[1].keys()}
        if appearing:
            raise AppearingObjects(sorted(appearing))
        size = len(samples), len(self._keys)
        self._row, self._place = np.full(size, -1, dtype=np.int64), np.full((*size, 3, 4), np.nan)
        mark = np.zeros(size, dtype=np.int64)  # of the triangles of what may bend
        for k, (sample, (columns, _)) in enumerate(zip(samples, columns_of, strict=True)):
            self._row[k, columns] = np.arange(len(columns))
            self._place[k, columns] = sample.transform
            if sample.shapes:
                marks = {number: id(shape.mesh) for number, shape in sample.shapes.items()}
                mark[k, columns] = [marks.get(mesh, 0) for mesh in sample.mesh_index.tolist()]
        self._there = self._row >= 0
        order = {obj: n for n, obj in enumerate(self._many)}
        many = np.array([*self._many.values()]).reshape(len(order), -1).T
        even = (many[:-1] == many[1:])[:, [order[obj] for obj, _ in self._keys]]
        self.joined = self._there[:-1] & self._there[1:] & even & (mark[:-1] == mark[1:])
        self._moving = self._which_move(mark.any(axis=0))
        if jumps and len(time) > 3:
            for number in np.flatnonzero(self._moving).tolist():
                self.joined[:, number] &= ~self._leaps(number)

    def _found(self, sample: SceneSample) -> tuple[np.ndarray, Counter[tuple[str, str]]]:
        """Columns of the instances of a sample, and how many each object has."""
        count: Counter[tuple[str, str]] = Counter()
        columns = []
        for index, source in zip(sample.object_index.tolist(), sample.source, strict=True):
            origin = sample.name[index], source
            columns.append(self._keys.setdefault((origin, count[origin]), len(self._keys)))
            count[origin] += 1
        return np.array(columns, dtype=np.int64), count

    @property
    def moves(self) -> bool:
        """Return whether anything does."""
        return bool(self._moving.any())

    def breaks(self, every: int) -> tuple[str, ...]:
        """Names of objects that are others, or begin or end, at another sample than each ``every``-th."""
        between = np.arange(1, len(self._time)) % every > 0
        ends = (self._there[:-1] | self._there[1:]) & ~self.joined & between[:, None]
        ends = ends.any(axis=0) & self._moving
        return tuple(sorted({name for ((name, _), _), n in self._keys.items() if ends[n]}))

    def motion(
        self, within: float = 0.0, bent: float = 0.0, every: int = 1
    ) -> tuple[SceneGeometry, SceneMotion]:
        """The scene, with the instances that it has besides at other times behind its own, and how it moves.

        A run in which an instance goes without a break has its number where it is the first with the
        triangles of the scene.

        every : samples from one moment at which things are expected to change at once to the next.
        """
        read, objects = self._scene, [obj for obj, _ in self._keys]
        paths: dict[int, RigidPath] = {}
        shapes: dict[int, ShapePath] = {}
        spans: dict[int, tuple[float, float]] = {}
        more: list[tuple[int, int]] = []  # what each further instance stands for, and its mesh
        meshes: dict[int, tuple[int, TriMesh, int]] = {}  # further ones, and whose they stand for
        bends: dict[tuple[int, ...], ShapePath] = {}
        for number in np.flatnonzero(self._moving).tolist():
            of = number if number < len(read) else self._keys[objects[number], 0]
            index = int(read.mesh_index[of])
            there = np.concatenate([[False], self._there[:, number], [False]])
            joined = np.concatenate([[False], self.joined[:, number], [False]])
            first = np.flatnonzero(there[1:-1] & ~joined[:-1])
            last = np.flatnonzero(there[1:-1] & ~joined[1:])
            for a, b in zip(first.tolist(), last.tolist(), strict=True):
                known = [self._shape(k, number) for k in range(a, b + 1)]
                given = next((shape.mesh for shape in known if shape), read.meshes[index])
                row, mesh = number, index
                alike = same_triangles(given, read.meshes[index])
                if not alike:
                    new = len(read.meshes) + len(meshes), given, index
                    mesh = meshes.setdefault(id(given), new)[0]
                if not alike or number >= len(read) or number in paths:
                    row = len(read) + len(more)
                    more.append((of, mesh))
                paths[row] = self._path(a, b, number)
                since = float(self._time[a]) if a else -np.inf
                until = float(self._time[b + 1]) if b + 1 < len(self._time) else np.inf
                if (since, until) != (-np.inf, np.inf):
                    spans[row] = since, until
                if (shape := self._bend(a, b, known)) is not None:
                    key = tuple(id(one.vertices) for one in known if one)
                    shapes[row] = bends.setdefault(key, shape)
            if number < len(read) and number not in paths:  # as the scene has it, it is never there
                paths[number] = RigidPath(np.zeros(1), read.transform[number][None])
                spans[number] = np.inf, np.inf
        scene, of_all = read, None
        if more:
            of_more, mesh_of_more = np.array(more, dtype=np.int64).T
            of_all = np.concatenate([np.arange(len(read)), of_more])
            _, added, like = zip(*meshes.values(), strict=True) if meshes else ((), (), ())
            index_of_all = np.concatenate([read.mesh_index, mesh_of_more])
            scene = read.with_meshes(added, like).take(of_all, mesh_index=index_of_all)
        held = {n for (n, _), m in self._many.items() if len(np.unique(m[m > 0])) > 1}
        remade = self.breaks(every)
        pause = float(self._time[1] - self._time[0]) if remade else 0.0
        return scene, SceneMotion(
            paths, shapes, spans, of_all, within, bent, tuple(sorted(held)), remade, pause
        )

    def off(
        self,
        middle: np.ndarray,
        between: Sequence[SceneSample],
        steady: np.ndarray | None = None,
    ) -> tuple[float, float]:
        """Metres by which samples at times (K - 1,) between these ones are not where they are expected: of
        places, and of points of what changes its shape.

        steady : (K - 1, N) bool, of which instances that counts; left out: of all.
        """
        other, count = Tracks(self._scene, self._now, middle, between), len(self._scene)
        moves = self._moving[:count] | other._moving[:count]
        joined = self.joined[:, :count] & other._there[:, :count]
        joined &= True if steady is None else steady[:, :count]
        worst, bent = 0.0, 0.0
        known: dict[tuple[int, ...], float] = {}
        for number in np.flatnonzero(moves & joined.any(axis=0)).tolist():
            rows, whole = np.flatnonzero(joined[:, number]), self._there[:, number]
            bent = max(bent, self._bend_off(number, rows, other, known))
            path = RigidPath(self._time[whole], self._place[whole, number])
            apart = path.at(middle[rows]) - other._place[rows, number]
            far = np.linalg.norm(apart[:, :, 3], axis=1)
            turned = np.linalg.norm(apart[:, :, :3], ord=2, axis=(1, 2)) * self._reach(number)
            worst = max(worst, float((far + turned).max(initial=0.0)))
        return worst, bent

    def _which_move(self, may_bend: np.ndarray) -> np.ndarray:
        """(N,) bool, instances that are not always where and as the scene says."""
        scene, count = self._scene, len(self._scene)
        moves = np.ones(self._row.shape[1], dtype=bool)
        with np.errstate(invalid="ignore"):
            apart = np.abs(self._place[:, :count] - scene.transform[None]).max(
                axis=(0, 2, 3), initial=0.0
            )
        stands = apart <= STANDS * (1 + np.abs(scene.transform).max(axis=(1, 2), initial=0.0))
        moves[:count] = ~stands | ~self._there[:, :count].all(axis=0)
        changing: dict[int, bool] = {}
        for number in np.flatnonzero(may_bend & ~moves).tolist():
            index = int(scene.mesh_index[number])
            if index not in changing:
                mesh = scene.meshes[index]
                stood = mesh.vertices.astype(np.float32)
                shapes = (self._shape(k, number) for k in range(len(self._samples)))
                changing[index] = any(
                    not same_triangles(shape.mesh, mesh)
                    or not np.array_equal(shape.vertices, stood)
                    for shape in shapes
                    if shape
                )
            moves[number] = changing[index]
        return moves

    def _shape(self, k: int, number: int) -> Shape | None:
        """The shape of an instance at a sample; None: as the scene has it, or not there."""
        row, sample = self._row[k, number], self._samples[k]
        return None if row < 0 else sample.shapes.get(int(sample.mesh_index[row]))

    def _leaps(self, number: int) -> np.ndarray:
        """(K - 1,) bool, whether an instance jumps between two samples where it would be ``joined``."""
        place, joined = self._place[:, number], self.joined[:, number]
        apart = np.diff(place, axis=0)
        gone = np.linalg.norm(apart[:, :, 3], axis=1)
        gone += self._reach(number) * np.linalg.norm(apart[:, :, :3], axis=(1, 2))
        shapes = [self._shape(k, number) for k in range(len(place))]
        for k in np.flatnonzero(joined).tolist():
            first, second = shapes[k], shapes[k + 1]
            if first and second:
                bend = np.abs(second.vertices - first.vertices).max(initial=0.0)
                gone[k] += float(bend) * np.linalg.norm(place[k, :, :3], ord=2)
        gone = np.where(joined, gone, 0.0)
        beside = np.concatenate([[0.0], gone, [0.0]])
        return np.asarray((gone > JUMP) & (gone > APART * np.maximum(beside[:-2], beside[2:])))

    def _reach(self, number: int) -> float:
        """Metres from the origin of an instance of the scene to its farthest corner."""
        if number >= len(self._scene):
            return 0.0
        mesh = self._scene.meshes[self._scene.mesh_index[number]]
        return float(np.linalg.norm(np.abs(mesh.vertices).max(axis=0, initial=0.0)))

    def _bend_off(
        self,
        number: int,
        joined: np.ndarray,
        other: Tracks,
        known: dict[tuple[int, ...], float],
    ) -> float:
        """Metres by which points of an instance are off in the middle of steps; ``known`` is filled on."""
        worst = 0.0
        size = float(np.linalg.norm(self._place[self._there[:, number], number][0, :, :3], ord=2))
        for k in joined.tolist():
            ends = self._shape(k, number), self._shape(k + 1, number), other._shape(k, number)
            if any(shape is None for shape in ends):
                continue
            low, high, middle = (shape.vertices for shape in ends)  # type: ignore[union-attr]
            key = id(low), id(high), id(middle)
            if key not in known and low.shape == middle.shape:
                share = (other._time[k] - self._time[k]) / np.diff(self._time[k : k + 2])
                apart = low + share * (high.astype(np.float64) - low) - middle
                known[key] = float(np.linalg.norm(apart, axis=1).max(initial=0.0))
            worst = max(worst, size * known.get(key, 0.0))
        return worst

    def _path(self, first: int, last: int, number: int) -> RigidPath:
        """A path of an instance from one sample to another; of one sample where nothing moves."""
        time, transform = self._time[first : last + 1], self._place[first : last + 1, number]
        still = np.abs(transform - transform[:1]).max(axis=(0, 1, 2))
        many = 1 if still <= STANDS * (1 + np.abs(transform[0]).max()) else len(time)
        return RigidPath(time[:many], transform[:many])

    def _bend(self, first: int, last: int, shapes: Sequence[Shape | None]) -> ShapePath | None:
        """The change of an instance's shape from one sample to another; None: there is none."""
        known = [shape.vertices for shape in shapes if shape]
        if not known or len(known) < len(shapes):
            return None
        time = self._time[first : last + 1]
        if all(np.array_equal(one, known[0]) for one in known[1:]):
            return ShapePath(time[:1], known[0][None])
        step = _widest(known) if len(time) == len(self._time) else 1
        return ShapePath(time[::step], np.stack(known[::step]))


def same_triangles(one: TriMesh, other: TriMesh) -> bool:
    """Return whether two meshes have the same triangles of as many vertices."""
    return one is other or (
        len(one.vertices) == len(other.vertices) and np.array_equal(one.triangles, other.triangles)
    )


def _widest(vertices: Sequence[np.ndarray]) -> int:
    """The widest step of samples that takes no vertex (V, 3) off its samples by more than ``BENT``."""
    step = 1
    while step < WIDEST and not (len(vertices) - 1) % (2 * step):
        wide = 2 * step
        for k in range(len(vertices) - 1):
            first, share = k - k % wide, np.float32(k % wide / wide)
            low, high = vertices[first], vertices[first + wide]
            apart = low + share * (high - low) - vertices[k]
            if np.abs(apart).max(initial=0.0) > BENT / 4:
                return step
        step = wide
    return step
