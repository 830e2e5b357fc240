"""Paths of parts of a scene: transforms of instances, and vertices of what bends, over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import scipy

from ...base.attitudes import composed
from ...base.rows import distinct
from .boxes import swept
from .geometry import SceneGeometry

ALWAYS = (-np.inf, np.inf)


class PartPath(Protocol):
    """Transforms of a part over time; methods as of ``RigidPath``."""

    def at(self, time: np.ndarray) -> np.ndarray: ...

    def rate(self, time: np.ndarray) -> np.ndarray: ...

    def swept(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...


@dataclass(frozen=True)
class RigidPath:
    """Transforms (K, 3, 4), local to world, at ascending times (K,), s, of a part that moves.

    Between samples places and shears go linearly and turns by the shortest way at an even rate (Shoemake
    1985), so samples must be less than half a turn apart. Before the first and after the last it stands.
    """

    time: np.ndarray
    transform: np.ndarray

    def at(self, time: np.ndarray, beyond: bool = False) -> np.ndarray:
        """(R, 3, 4) transforms at times (R,). beyond : go on as at the ends, not stand there."""
        return self._table.at(np.zeros(len(time), np.int64), time, beyond)

    def rate(self, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) change of the transforms a second at times (R,); at a sample, of what follows."""
        return self._table.rate(np.zeros(len(time), np.int64), time)

    def swept(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Box in the world, corners (3,), that a part within a box of its own, corners (3,), never leaves.

        It holds the boxes at all samples. Between two of them, a turn by an angle apart, a point at an arm m
        is at most m times half that angle from the straight line between its places there.
        """
        least, most = swept(np.stack([low, high])[None], self.transform[:, None])
        arm = float(np.linalg.norm(np.maximum(np.abs(low), np.abs(high))))
        size = float(np.linalg.norm(self.transform[:, :, :3], ord=2, axis=(1, 2)).max())
        bow = self._table.widest / 2 * size * arm
        return least[0] - bow, most[0] + bow

    @cached_property
    def _table(self) -> PathTable:
        return PathTable([self])


class PathTable:
    """Many paths side by side, asked by their rows."""

    def __init__(self, paths: Sequence[RigidPath]) -> None:
        whole = [
            (path.time, path.transform)
            if len(path.time) > 1
            else (np.arange(2.0), np.repeat(path.transform, 2, axis=0))  # at any times: it stands
            for path in paths
        ]
        count = [len(time) for time, _ in whole]
        self._first = np.cumsum([0, *count])[:-1]
        self._times: list[np.ndarray] = []
        self._clock = np.empty(len(paths), np.int64)
        known: dict[bytes, int] = {}
        for row, (time, _) in enumerate(whole):
            self._clock[row] = known.setdefault(time.tobytes(), len(known))
            self._times += [time] if self._clock[row] == len(self._times) else []
        self._knots = np.column_stack([self._first, self._first + count])
        self._even = np.array([_evenly(time) for time, _ in whole], dtype=bool)
        self._knots[~self._even, 1] = self._knots[~self._even, 0]  # none beside them tells
        every = np.concatenate([transform for _, transform in whole])
        # Places, turns and shapes, by polar decomposition.
        u, size, v = np.linalg.svd(every[:, :, :3])
        sign = np.where(np.linalg.det(u @ v) < 0, -1.0, 1.0)[:, None, None]
        self._shape = sign * ((v.transpose(0, 2, 1) * size[:, None, :]) @ v)
        self._place, self._turn = (
            every[:, :, 3],
            scipy.spatial.transform.Rotation.from_matrix(sign * (u @ v)),
        )
        turn = self._turn
        self._round = (turn[:-1].inv() * turn[1:]).as_rotvec()  # in the part's own frame
        self._ends = np.array([[path.time[0], path.time[-1]] for path in paths])
        inner = np.ones(len(every) - 1, dtype=bool)
        inner[self._first[1:] - 1] = False
        self.widest = float(np.linalg.norm(self._round[inner], axis=1).max(initial=0.0))

    def at(self, which: np.ndarray, time: np.ndarray, beyond: bool = False) -> np.ndarray:
        """(R, 3, 4) transforms of paths (R,) at times (R,).

        beyond : go on as at the ends, not stand there.
        """
        row, share, _ = self._between(which, time, beyond)
        transform = np.empty((len(time), 3, 4))
        transform[:, :, 3] = self._place[row] + share * (self._place[row + 1] - self._place[row])
        stretch = self._shape[row] + share[:, None] * (self._shape[row + 1] - self._shape[row])
        transform[:, :, :3] = self._turned(row, share).as_matrix() @ stretch
        return transform

    def rate(self, which: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(R, 3, 4) change of the transforms of paths (R,) a second at times (R,)."""
        row, share, step = self._between(which, time)
        knots, size = self._knots[which], np.abs(self._place[row])
        bend = self._shape[row + 1] - self._shape[row]
        stretch = self._shape[row] + share[:, None] * bend
        turning = _rate(lambda k: self._round[k], row, share, knots, 1.0)
        change = np.empty((len(time), 3, 4))
        change[:, :, :3] = self._turned(row, share).as_matrix() @ (
            np.cross(turning[:, :, None], stretch, axis=1) + bend
        )
        change[:, :, 3] = _rate(
            lambda k: self._place[k + 1] - self._place[k], row, share, knots, size
        )
        change /= step[:, None]
        ends = self._ends[which]
        change[(time < ends[:, 0]) | (time > ends[:, 1])] = 0.0
        return change

    def _turned(self, row: np.ndarray, share: np.ndarray) -> scipy.spatial.transform.Rotation:
        return composed(
            self._turn[row], scipy.spatial.transform.Rotation.from_rotvec(share * self._round[row])
        )

    def _between(
        self, which: np.ndarray, time: np.ndarray, beyond: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sample before each time, the share (R, 1) of the way to the next, and seconds (R, 1) between."""
        row = np.empty(len(time), np.int64)
        share, step = np.empty(len(time)), np.empty(len(time))
        clock = self._clock[which]
        for number in [0] if len(self._times) == 1 else distinct(clock).tolist():
            known = self._times[number]
            at_clock = slice(None) if len(self._times) == 1 else np.flatnonzero(clock == number)
            row[at_clock], share[at_clock], step[at_clock] = _between(known, time[at_clock], beyond)
        return row + self._first[which], share[:, None], step[:, None]


class PathsOneByOne:
    """Paths of any kind side by side, asked by their rows; see ``PathTable``."""

    def __init__(self, paths: Sequence[PartPath]) -> None:
        self._paths = paths

    def at(self, which: np.ndarray, time: np.ndarray) -> np.ndarray:
        """See ``PathTable.at``."""
        return self._asked("at", which, time)

    def rate(self, which: np.ndarray, time: np.ndarray) -> np.ndarray:
        """See ``PathTable.rate``."""
        return self._asked("rate", which, time)

    def _asked(self, what: str, which: np.ndarray, time: np.ndarray) -> np.ndarray:
        answers = np.empty((len(time), 3, 4))
        for row in distinct(which).tolist():
            answers[which == row] = getattr(self._paths[row], what)(time[which == row])
        return answers


@dataclass(frozen=True)
class ShapePath:
    """Vertices (K, V, 3) in their own frame, m, at ascending times (K,), s; they go straight between.

    Before the first and after the last they stand.
    """

    time: np.ndarray
    vertices: np.ndarray

    def at(self, vertex: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(R, C, 3) m of vertices (R, C) at times (R,)."""
        if len(self.time) == 1:
            return self.vertices[0, vertex].astype(np.float64)
        row, share, _ = _between(self.time, time)
        low, high = self._ends(row, vertex)
        return np.asarray(low + share[:, None, None] * (high - low))

    def velocity(self, vertex: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(R, C, 3) m/s of vertices (R, C) at times (R,)."""
        if len(self.time) == 1:
            return np.zeros((*vertex.shape, 3))
        row, share, step = _between(self.time, time)
        knots = np.array([[0, len(self.time) if _evenly(self.time) else 0]])
        size = np.abs(self._ends(row, vertex)[0])

        def gone(k: np.ndarray) -> np.ndarray:
            low, high = self._ends(k, vertex)
            return np.asarray(high - low)

        velocity = _rate(gone, row, share[:, None, None], knots.repeat(len(row), axis=0), size)
        velocity /= step[:, None, None]
        velocity[(time < self.time[0]) | (time > self.time[-1])] = 0.0
        return velocity

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (3,) of the box that no finite vertex leaves."""
        with np.errstate(invalid="ignore"):
            low = np.fmin.reduce(self.vertices.reshape(-1, 3), axis=0)
            high = np.fmax.reduce(self.vertices.reshape(-1, 3), axis=0)
        return low.astype(np.float64), high.astype(np.float64)

    def _ends(self, row: np.ndarray, vertex: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low = self.vertices[row[:, None], vertex].astype(np.float64)
        return low, self.vertices[row[:, None] + 1, vertex].astype(np.float64)


@dataclass(frozen=True)
class SceneMotion:
    """Motion of a scene of I instances.

    paths : by number the whole transforms of instances that move, change their shape or are not always there.
    shapes : the vertices of those that change theirs. spans : seconds [from, until) in which those that are
    not always there are.
    stands_for : (I,) the instance of the scene as it was read that each one is.
    within : metres by which places may be off between two samples; bent : points of what changes its shape.
    held : names of objects that stand still between samples, as their parts come and go. remade : of those
    that are others from one sample to the next, and stand for ``pause`` s.
    """

    paths: Mapping[int, PartPath] = field(default_factory=dict)
    shapes: Mapping[int, ShapePath] = field(default_factory=dict)
    spans: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    stands_for: np.ndarray | None = None
    within: float = 0.0
    bent: float = 0.0
    held: tuple[str, ...] = ()
    remade: tuple[str, ...] = ()
    pause: float = 0.0

    def span(self, number: int) -> tuple[float, float]:
        """Seconds [from, until) in which an instance is there."""
        return self.spans.get(number, ALWAYS)

    @cached_property
    def rows(self) -> np.ndarray:
        """(N,) numbers of the instances that have a path, ascending."""
        return np.array(sorted(self.paths), dtype=np.int64)

    @cached_property
    def table(self) -> PathTable | PathsOneByOne:
        """Paths in the order of ``rows``; there must be one."""
        paths = [self.paths[n] for n in self.rows.tolist()]
        rigid = [path for path in paths if isinstance(path, RigidPath)]
        return PathTable(rigid) if len(rigid) == len(paths) else PathsOneByOne(paths)

    def without(self, instances: np.ndarray) -> SceneMotion:
        """The same of all other instances."""
        away = set(instances.tolist()) & set(self.paths)
        if not away:
            return self
        kept: dict[str, Any] = {
            name: {n: one for n, one in getattr(self, name).items() if n not in away}
            for name in ("paths", "shapes", "spans")
        }
        return replace(self, **kept)

    def row_of(self, instance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (M,) of those instances (R,) that have a path, and its rows (M,)."""
        if not len(self.rows):
            return np.empty(0, np.int64), np.empty(0, np.int64)
        row = np.minimum(np.searchsorted(self.rows, instance), len(self.rows) - 1)
        on_path = np.flatnonzero(self.rows[row] == instance)
        return on_path, row[on_path]

    def corners(
        self,
        scene: SceneGeometry,
        instance: np.ndarray,
        triangle: np.ndarray,
        time: np.ndarray,
        rates: bool = False,
    ) -> np.ndarray:
        """(R, 3, 3) own corners of triangles at times, m. rates : how fast they move, m/s, instead."""
        corners = np.zeros((len(instance), 3, 3))
        if not rates:
            rest = np.flatnonzero(~self.bends(instance))
            corners[rest] = scene.corners(instance[rest], triangle[rest])
        for number, shape in self.shapes.items():
            of_number = np.flatnonzero(instance == number)
            if len(of_number):
                vertex = scene.meshes[scene.mesh_index[number]].triangles[triangle[of_number]]
                corners[of_number] = (shape.velocity if rates else shape.at)(
                    vertex, time[of_number]
                )
        return corners

    def bends(self, instance: np.ndarray) -> np.ndarray:
        """(R,) bool, which of these instances change their shape."""
        return np.isin(instance, list(self.shapes))


def _evenly(time: np.ndarray) -> bool:
    step = np.diff(time)
    return bool(len(step) < 2 or np.ptp(step) <= 1e-6 * step[0])


def _rate(
    gone: Callable[[np.ndarray], np.ndarray],
    row: np.ndarray,
    share: np.ndarray,
    knots: np.ndarray,
    size: np.ndarray | float,
) -> np.ndarray:
    """(R, ...) change a step at shares of the steps from samples (R,), evenly spaced, to the next.

    The mean of a step is that in its middle; from there it changes as towards one of the steps beside it, the
    one that is more alike (ENO, Harten et al. 1987), so that nothing is carried over where a motion breaks.
    What rounding to single precision makes of an even motion is none of it.

    gone : the change over steps (R,). knots : (R, 2) first sample of each path, and the one after its last.
    size : of what changes, which says how it was rounded.
    """
    mean = gone(row)
    changes = []
    for ahead in (-2, -1, 0, 1):  # between steps row + ahead and the next
        there = (row + ahead >= knots[:, 0]) & (row + ahead + 2 < knots[:, 1])
        if ahead in (-2, 1):  # in place of what is missing at an end
            inner = (row - 1 >= knots[:, 0]) if ahead == 1 else (row + 2 < knots[:, 1])
            there &= ~inner
        first = np.where(there, row + ahead, row)
        change = gone(np.where(there, first + 1, first)) - gone(first)
        change[~there] = np.inf
        changes.append(change)
    every = np.stack(changes)
    best = np.take_along_axis(every, np.abs(every).argmin(axis=0)[None], axis=0)[0]
    noise = 8 * np.finfo(np.float32).eps * size
    best[~np.isfinite(best) | (np.abs(best) <= noise)] = 0.0
    return np.asarray(mean + (share - 0.5) * best)


def _between(
    known: np.ndarray, time: np.ndarray, beyond: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sample before each time (R,), the share of the way to the next, and seconds between them."""
    row = np.clip(np.searchsorted(known, time, "right") - 1, 0, len(known) - 2)
    step = known[row + 1] - known[row]
    share = (time - known[row]) / step
    return row, share if beyond else np.clip(share, 0.0, 1.0), step
