"""Samples of a scene over time, and the scene that is put together of the runs in which its parts move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.trimesh import TriMesh
from .geometry import SceneGeometry
from .paths import RigidPath, SceneMotion, ShapePath


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
    def things(self) -> list[tuple[str, str]]:
        """(I,) objects of instances, each with the object whose mesh it is."""
        names = (self.name[index] for index in self.object_index.tolist())
        return list(zip(names, self.source, strict=True))

    @property
    def nbytes(self) -> int:
        """Bytes that it takes."""
        return self.transform.nbytes + sum(s.vertices.nbytes for s in self.shapes.values())


class SceneInRuns:
    """A scene that moves, put together part by part."""

    def __init__(self, scene: SceneGeometry) -> None:
        self._read = scene
        self._paths: dict[int, RigidPath] = {}
        self._shapes: dict[int, ShapePath] = {}
        self._spans: dict[int, tuple[float, float]] = {}
        self._more: list[
            tuple[int, int]
        ] = []  # what each further instance stands for, and its mesh
        self._meshes: dict[int, tuple[int, TriMesh]] = {}
        self._bent: dict[tuple, ShapePath] = {}

    def add(
        self,
        of: int,
        number: int,
        path: RigidPath,
        shape: ShapePath | None,
        span: tuple[float, float],
        shapes: Sequence[Shape | None],
    ) -> None:
        """Add a run: under its own number where it is the first with the triangles of the scene."""
        mesh = self._read.meshes[self._read.mesh_index[of]]
        given = next((s.mesh for s in shapes if s is not None), mesh)
        alike = same_triangles(given, mesh)
        if not (alike and number < len(self._read) and number not in self._paths):
            index = int(self._read.mesh_index[of])
            if not alike:
                index, _ = self._meshes.setdefault(
                    id(given), (len(self._read.meshes) + len(self._meshes), given)
                )
            number = len(self._read) + len(self._more)
            self._more.append((of, index))
        self._paths[number] = path
        if span != (-np.inf, np.inf):
            self._spans[number] = span
        if shape is not None:
            key = tuple(id(s.vertices) for s in shapes if s is not None)
            self._shapes[number] = self._bent.setdefault(key, shape)

    def never(self, number: int) -> None:
        """Say that an instance is not there at all."""
        if number < len(self._read):
            self._paths[number] = RigidPath(np.zeros(1), self._read.transform[number][None])
            self._spans[number] = (np.inf, np.inf)

    def close(self, number: int) -> None:
        """Say that an instance is not there as the scene has it, if no run was."""
        if number not in self._paths:
            self.never(number)

    def scene(self) -> SceneGeometry:
        """The scene, with the further instances behind its own."""
        read = self._read
        if not self._more:
            return read
        of = np.concatenate([np.arange(len(read)), [one for one, _ in self._more]]).astype(int)
        mesh = np.array([index for _, index in self._more], np.int64)
        first = {index: of_ for of_, index in reversed(self._more)}
        added = [mesh for _, mesh in self._meshes.values()]
        like = [int(read.mesh_index[first[len(read.meshes) + k]]) for k in range(len(added))]
        index = np.concatenate([read.mesh_index, mesh])
        return read.with_meshes(added, like).take(of, mesh_index=index)

    def motion(self, within: float, bent: float, held: tuple[str, ...]) -> SceneMotion:
        """The motion of all runs."""
        of = None
        if self._more:
            of = np.concatenate([np.arange(len(self._read)), [one for one, _ in self._more]])
            of = of.astype(np.int64)
        return SceneMotion(self._paths, self._shapes, self._spans, of, within, bent, held)


def same_triangles(one: TriMesh, other: TriMesh) -> bool:
    """Return whether two meshes have the same triangles of as many vertices."""
    return one is other or (
        len(one.vertices) == len(other.vertices) and np.array_equal(one.triangles, other.triangles)
    )


# From samples of a scene over time to how it moves: which instance is which, where it goes, how it bends.
#
# An instance is known by its object, by whose mesh it has, and by its number among those alike. From one
# sample to the next it moves where it is in both, with the same triangles, and its object has as many
# instances; else it stands until the next sample, and is then gone, or another. What goes far between two
# samples and hardly before and after has jumped: it stands, too.


STANDS = 1e-7  # metres, and parts of a turn, that single precision may shake
BENT = 1e-4  # m that points of what changes its shape may be off between two samples
WIDEST = 16  # samples of a step of a shape
JUMP, APART = 1e-3, 4.0  # m of a jump at least, and how often what is gone in the steps beside it


class AppearingObjects(ValueError):
    """Objects are there meanwhile that the scene as it was read does not have; ``names`` says which."""

    def __init__(self, names: list[str]) -> None:
        super().__init__(", ".join(names))
        self.names = names


class Tracks:
    """Instances of a scene followed through samples at ascending times (K,), s.

    scene : as it was read. now : a sample of that. jumps : whether samples are close enough to tell jumps.

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
        self._jumps = jumps
        self._leaps: dict[int, np.ndarray] = {}
        self._keys = {key: row for row, key in enumerate(_keys(now))}
        self._row = np.full((len(samples), len(now.transform)), -1, dtype=np.int64)
        self._count: dict[tuple[str, str], np.ndarray] = {}
        self._follow()
        place = np.full((*self._row.shape, 3, 4), np.nan)
        for k, sample in enumerate(samples):
            mine = np.flatnonzero(self._row[k] >= 0)
            place[k, mine] = sample.transform[self._row[k, mine]]
        self._place, self._there = place, self._row >= 0

    @property
    def moves(self) -> bool:
        """Return whether anything does."""
        return bool(self._moving_at_all().any())

    def motion(
        self, within: float = 0.0, bent: float = 0.0, every: int = 1
    ) -> tuple[SceneGeometry, SceneMotion]:
        """The scene, with the instances that it has besides at other times, and how it moves.

        every : samples from one moment at which things are expected to change at once to the next.
        """
        made = SceneInRuns(self._scene)
        for number in self._numbers():
            self._add(made, number)
        motion = made.motion(within, bent, self._held())
        remade = tuple(sorted({self._named[n][0] for n in self._breaks(every)}))
        pause = float(self._time[1] - self._time[0]) if remade else 0.0
        return made.scene(), replace(motion, remade=remade, pause=pause)

    def breaks(self, every: int) -> bool:
        """Return whether anything is another, or begins or ends, at another sample than each ``every``-th."""
        return bool(self._breaks(every))

    def steady(self, step: int) -> dict[tuple[tuple[str, str], int], bool]:
        """Return which instances, by object and number, neither jump nor are others by the end of a step."""
        keys = list(self._keys)
        return {keys[n]: bool(self._joined(n)[step]) for n in self._numbers()}

    def off(
        self,
        middle: np.ndarray,
        between: Sequence[SceneSample],
        finer: Tracks | None = None,
        steady: Mapping[tuple[tuple[str, str], int], bool] | None = None,
    ) -> tuple[float, float]:
        """Metres by which samples at times (K - 1,) between these ones are not where they are expected: of
        places, and of points of what changes its shape.

        finer : tracks of both; what jumps in them does not count. steady : of one step, what counts.
        """
        other, count = Tracks(self._scene, self._now, middle, between), len(self._scene)
        moves = self._moving_at_all()[:count] | other._moving_at_all()[:count]
        worst, bent = 0.0, 0.0
        known: dict[tuple[int, ...], float] = {}
        keys = list(self._keys)
        for number in np.flatnonzero(moves).tolist():
            joined = self._joined(number) & (other._row[:, number] >= 0)
            if finer is not None:
                joined &= finer._joined(number).reshape(-1, 2).all(axis=1)
            if steady is not None:
                joined &= steady.get(keys[number], True)
            if not joined.any():
                continue
            bent = max(bent, self._bend_off(number, joined, other, known))
            whole = self._there[:, number]
            path = RigidPath(self._time[whole], self._place[whole, number])
            apart = path.at(middle[joined]) - other._place[joined, number]
            far = np.linalg.norm(apart[:, :, 3], axis=1)
            turned = np.linalg.norm(apart[:, :, :3], ord=2, axis=(1, 2)) * self._reach(number)
            worst = max(worst, float((far + turned).max(initial=0.0)))
        return worst, bent

    def _follow(self) -> None:
        names = {thing for thing, _ in self._keys}
        usual = _keys(self._now)
        appearing: set[tuple[str, str]] = set()
        present: list[set[tuple[str, str]] | None] = []
        for k, sample in enumerate(self._samples):
            same = (
                len(sample.transform) == len(self._now.transform)
                and sample.name == self._now.name
                and sample.source == self._now.source
                and np.array_equal(sample.object_index, self._now.object_index)
            )
            keys = usual if same else _keys(sample)
            present.append(None if same else {thing for thing, _ in keys})
            if not same:
                appearing |= {name for name, _ in keys} - names
                new = [key for key in keys if key not in self._keys]
                self._keys |= {key: len(self._keys) + n for n, key in enumerate(new)}
                missing = len(self._keys) - self._row.shape[1]
                self._row = np.pad(self._row, ((0, 0), (0, missing)), constant_values=-1)
            rows = (
                np.arange(len(keys)) if same else np.array([self._keys[key] for key in keys], int)
            )
            self._row[k, rows] = np.arange(len(rows))
            if not same:
                for name, _ in keys:
                    count = self._count.setdefault(name, np.full(len(self._samples), -1))
                    count[k] = max(count[k], 0) + 1
        if appearing:
            raise AppearingObjects(sorted({name for name, _ in appearing}))
        for name, count in self._count.items():
            usually = sum(1 for known, _ in usual if known == name)
            count[count < 0] = usually
            for k, there in enumerate(present):
                if there is not None and name not in there:
                    count[k] = 0
        self._named = [name for name, _ in self._keys]

    def _held(self) -> tuple[str, ...]:
        """Names of objects whose instances are not always as many; those that only come or go as one have
        nothing that could be taken for another."""
        return tuple(
            sorted(
                {
                    name
                    for (name, _), count in self._count.items()
                    if len(np.unique(count[count > 0])) > 1
                }
            )
        )

    def _numbers(self) -> list[int]:
        """Instances that move or are not always there."""
        base = np.flatnonzero(self._moving_at_all()[: len(self._scene)])
        return [*base.tolist(), *range(len(self._scene), self._row.shape[1])]

    def _breaks(self, every: int) -> list[int]:
        """Instances that are others, or begin or end, at samples between those that come each ``every``."""
        between = np.arange(1, len(self._time)) % every > 0
        found = []
        for number in self._numbers():
            there = self._there[:, number]
            ends = (there[:-1] | there[1:]) & ~self._joined(number)
            if (ends & between).any():
                found.append(number)
        return found

    def _moving_at_all(self) -> np.ndarray:
        """(N,) bool, instances that are not always where and as the scene says."""
        scene, count = self._scene, len(self._scene)
        found = np.ones(self._row.shape[1], dtype=bool)
        with np.errstate(invalid="ignore"):
            apart = np.abs(self._place[:, :count] - scene.transform[None]).max(
                axis=(0, 2, 3), initial=0.0
            )
        stands = apart <= STANDS * (1 + np.abs(scene.transform).max(axis=(1, 2), initial=0.0))
        stands &= self._there[:, :count].all(axis=0)
        bends = np.zeros(count, dtype=bool)
        changing: dict[int, bool] = {}
        for number in np.flatnonzero(stands & self._may_bend()).tolist():
            mesh = int(scene.mesh_index[number])
            if mesh not in changing:
                shapes = [self._shape(k, number) for k in range(len(self._samples))]
                changing[mesh] = any(not self._at_rest(number, shape) for shape in shapes)
            bends[number] = changing[mesh]
        found[:count] = ~stands | bends
        return found

    def _may_bend(self) -> np.ndarray:
        """(I,) bool, instances of the scene of which some sample has a shape."""
        found = np.zeros(len(self._scene), dtype=bool)
        for k, sample in enumerate(self._samples):
            if sample.shapes:
                row = self._row[k, : len(found)]
                has = np.zeros(len(sample.transform) + 1, dtype=bool)
                has[:-1] = np.isin(sample.mesh_index, list(sample.shapes))
                found |= has[row]
        return found

    def _shape(self, k: int, number: int) -> Shape | None:
        """The shape of an instance at a sample; None: as the scene has it, or not there."""
        row = self._row[k, number]
        sample = self._samples[k]
        return None if row < 0 else sample.shapes.get(int(sample.mesh_index[row]))

    def _at_rest(self, number: int, shape: Shape | None) -> bool:
        """Return whether a shape is that of the scene as it was read."""
        if shape is None:
            return True
        mesh = self._scene.meshes[self._scene.mesh_index[number]]
        return same_triangles(shape.mesh, mesh) and bool(
            np.array_equal(shape.vertices, mesh.vertices.astype(np.float32))
        )

    def _joined(self, number: int) -> np.ndarray:
        """(K - 1,) bool, whether an instance moves from a sample to the next, or stands until then."""
        there = self._there[:, number]
        joined: np.ndarray = there[:-1] & there[1:]
        count = self._count.get(self._named[number])
        if count is not None:
            joined &= count[:-1] == count[1:]
        if any(sample.shapes for sample in self._samples):
            marks = np.array([self._mark(k, number) for k in range(len(self._samples))])
            joined &= marks[:-1] == marks[1:]
        if self._jumps:
            joined &= ~self._leap(number, joined)
        return joined

    def _leap(self, number: int, joined: np.ndarray) -> np.ndarray:
        """(K - 1,) bool, whether an instance jumps between two samples where it would be ``joined``."""
        if number not in self._leaps:
            place = self._place[:, number]
            reach = self._reach(number) if number < len(self._scene) else 0.0
            apart = np.diff(place, axis=0)
            gone = np.linalg.norm(apart[:, :, 3], axis=1)
            gone += reach * np.linalg.norm(apart[:, :, :3], axis=(1, 2))
            if self._bends(number):
                for k in np.flatnonzero(joined).tolist():
                    ends = self._shape(k, number), self._shape(k + 1, number)
                    if ends[0] is not None and ends[1] is not None:
                        bend = np.abs(ends[1].vertices - ends[0].vertices).max(initial=0.0)
                        gone[k] += float(bend) * np.linalg.norm(place[k, :, :3], ord=2)
            gone = np.where(joined, gone, 0.0)
            beside = np.concatenate([[0.0], gone, [0.0]])
            beside = np.maximum(beside[:-2], beside[2:])
            self._leaps[number] = (gone > JUMP) & (gone > APART * beside) & (len(gone) > 2)
        return self._leaps[number]

    def _bends(self, number: int) -> bool:
        """Return whether an instance has shapes."""
        return any(self._shape(k, number) is not None for k in range(len(self._samples)))

    def _mark(self, k: int, number: int) -> int:
        """A number for the triangles of an instance at a sample."""
        shape = self._shape(k, number)
        return 0 if shape is None else id(shape.mesh)

    def _reach(self, number: int) -> float:
        """Metres from an instance's own origin to its farthest corner."""
        mesh = self._scene.meshes[self._scene.mesh_index[number]]
        return float(np.linalg.norm(np.abs(mesh.vertices).max(axis=0, initial=0.0)))

    def _bend_off(
        self,
        number: int,
        joined: np.ndarray,
        other: Tracks,
        known: dict[tuple[int, ...], float],
    ) -> float:
        worst = 0.0
        size = float(np.linalg.norm(self._place[self._there[:, number], number][0, :, :3], ord=2))
        for k in np.flatnonzero(joined).tolist():
            ends = self._shape(k, number), self._shape(k + 1, number), other._shape(k, number)
            if any(shape is None for shape in ends):
                continue
            low, high, middle = (shape.vertices for shape in ends)  # type: ignore[union-attr]
            key = id(low), id(high), id(middle)
            if key not in known:
                known[key] = 0.0
                if low.shape == middle.shape:
                    way = np.diff(self._time[k : k + 2])
                    share = (other._time[k] - self._time[k]) / way
                    apart = low + share * (high.astype(np.float64) - low) - middle
                    known[key] = float(np.linalg.norm(apart, axis=1).max(initial=0.0))
            worst = max(worst, size * known[key])
        return worst

    def _add(self, made: SceneInRuns, number: int) -> None:
        """Add the runs of an instance in which it goes without a break."""
        there = self._there[:, number]
        if not there.any():
            made.never(number)
            return
        breaks = ~self._joined(number)
        first = np.flatnonzero(there & np.concatenate([[True], breaks]))
        last = np.flatnonzero(there & np.concatenate([breaks, [True]]))
        for a, b in zip(first.tolist(), last.tolist(), strict=True):
            rows = slice(a, b + 1)
            shapes = [self._shape(k, number) for k in range(a, b + 1)]
            until = float(self._time[b + 1]) if b + 1 < len(self._time) else np.inf
            span = (float(self._time[a]) if a else -np.inf, until)
            path = _path(self._time[rows], self._place[rows, number])
            whole = len(self._time) == b + 1 - a
            made.add(self._of(number), number, path, self._bend(rows, shapes, whole), span, shapes)
        made.close(number)

    def _of(self, number: int) -> int:
        """The instance of the scene that one stands for: itself, or the first of its object."""
        if number < len(self._scene):
            return number
        return self._keys[self._named[number], 0]

    def _bend(self, rows: slice, shapes: Sequence[Shape | None], whole: bool) -> ShapePath | None:
        """The change of an instance's shape in a run; None: there is none."""
        known = [shape for shape in shapes if shape is not None]
        if not known or len(known) < len(shapes):
            return None
        time = self._time[rows]
        if all(np.array_equal(s.vertices, known[0].vertices) for s in known[1:]):
            return ShapePath(time[:1], known[0].vertices[None])
        step = _widest(known) if whole else 1
        return ShapePath(time[::step], np.stack([s.vertices for s in known[::step]]))


def _keys(sample: SceneSample) -> list[tuple[tuple[str, str], int]]:
    """Each instance by its object, by whose mesh it has, and by its number among those alike."""
    count: dict[tuple[str, str], int] = {}
    found = []
    for thing in sample.things:
        number = count.get(thing, 0)
        count[thing] = number + 1
        found.append((thing, number))
    return found


def _path(time: np.ndarray, transform: np.ndarray) -> RigidPath:
    """A path of one sample where nothing moves."""
    still = np.abs(transform - transform[:1]).max(axis=(0, 1, 2))
    if still <= STANDS * (1 + np.abs(transform[0]).max()):
        return RigidPath(time[:1], transform[:1])
    return RigidPath(time, transform)


def _widest(shapes: Sequence[Shape]) -> int:
    """The widest step of samples that takes no vertex off its samples by more than ``BENT``."""
    step = 1
    while step < WIDEST and not (len(shapes) - 1) % (2 * step):
        wide = 2 * step
        for first in range(0, len(shapes) - 1, wide):
            low, high = shapes[first].vertices, shapes[first + wide].vertices
            for k in range(1, wide):
                apart = low + np.float32(k / wide) * (high - low) - shapes[first + k].vertices
                if np.abs(apart).max(initial=0.0) > BENT / 4:
                    return step
        step = wide
    return step
