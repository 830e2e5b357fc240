"""Scatterers: places in the world, each with a strength seen from a sonar.

``Scatterers`` are M places of one kind. Seen from a point, they have a ``Strength``: the scattering
amplitude f(k) in metres, never larger than its ``bound``. The
kinds are in ``leaves``, ``wood`` and ``facets``.

A ``Population`` is what one mesh has of one kind, in local space and in blocks; instances make scatterers
of its rows when a sonar comes near. Its points are cut in halves along the widest axis until a block holds
few; a block knows its bounding sphere. Instances share the blocks of their mesh, so a forest of millions of
leaves is searched by a few thousand spheres.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...base.rows import RowTable

SIZE = 96  # points of a block, at most
LEAF, WOOD, FACET = "leaf", "wood", "facet"
CLEAR = 1e-3  # m; what is so close before a scatterer is what it sits on


class Strength(RowTable, ABC):
    """Strength with which M scatterers send sound back to one point."""

    @abstractmethod
    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        """(Q, M) complex f in metres at wavenumbers (Q,), e^{+iωt}."""

    @abstractmethod
    def bound(self, lowest: float, highest: float) -> np.ndarray:
        """(M,) no |f| between two wavenumbers is larger."""

    @abstractmethod
    def reach(self, wavenumber: float) -> np.ndarray:
        """(M,) metres of path, about how far responses reach to both sides of their delays, from a wavenumber
        on."""

    def error(self, highest: float) -> np.ndarray | None:
        """(M,) metres that f may be off by because it is tabulated, up to a wavenumber; None: nothing."""
        return None

    def parts(self, lowest: float, highest: float) -> StrengthParts:
        """Smoother strengths that add up to this one between two wavenumbers, itself where it is smooth.

        Of a scatterer in several parts, some frequency between finds all of them in phase.
        """
        return self.whole()

    def whole(self) -> StrengthParts:
        """Each as one part."""
        rows, late, share = np.arange(len(self)), np.zeros((1, len(self))), np.ones(len(self))
        return StrengthParts(rows, late, share, self)


def paired(twice: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows (m,) of things (M,), of those that come ``twice`` two, and which each is: 0 alone, 1 and 2 of a
    pair."""
    alone, pairs = np.flatnonzero(~twice), np.flatnonzero(twice)
    which = np.repeat(np.arange(3, dtype=np.int8), [len(alone), len(pairs), len(pairs)])
    return np.concatenate([alone, pairs, pairs]), which


@dataclass(frozen=True)
class StrengthParts(RowTable):
    """Strengths (m,) that belong to rows (m,) of others, and sound ``offset`` (1, m) metres later on the
    path, or twice (2, m); share : (m,) about how loud each is beside that.

    second : (m,) 1 or -1, by which the amplitude is multiplied the second time; ``conjugate``: its conjugate.
    """

    rows: np.ndarray
    offset: np.ndarray
    share: np.ndarray
    strength: Strength
    second: np.ndarray | None = None
    conjugate: bool = False


@dataclass(frozen=True)
class Scatterers(RowTable, ABC):
    """M places of one kind.

    centre : (M, 3) metres. number : (M,) int64, in its mesh.
    """

    kind: ClassVar[str]
    centre: np.ndarray
    number: np.ndarray

    @property
    def clear(self) -> np.ndarray:
        """(M,) metres before each that hide nothing."""
        return np.full(len(self), CLEAR)

    @abstractmethod
    def seen(self, point: np.ndarray) -> Strength:
        """The strength towards a point (3,)."""

    def count(self, instance: np.ndarray, some: np.ndarray) -> int:
        """Number of objects that ``some`` (M,) bool of them are, each of an instance (M,)."""
        return int(np.count_nonzero(some))

    def count_close(self, instance: np.ndarray) -> int:
        """Number of leaves nearer than ka²/2."""
        return 0

    def count_doubtful(self, point: np.ndarray, wavenumber: float) -> int:
        """Number of exact discs so large and so far off their normal that the formula for large
        ones is tens of per cent off."""
        return 0


# Leaves (M,) with centres and normals (M, 3) in the world, to the centres and normals that they turn to.
LeafTurns = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Sight:
    """Sight of a sonar, which a population must know before it makes scatterers.

    point : (3,) where it is. wavenumber : the largest, 1/m. nearest, reach : metres, its range.
    turns : how leaves flutter; None: they are still.
    """

    point: np.ndarray
    wavenumber: float
    reach: float
    nearest: float = 0.0
    turns: LeafTurns | None = None


@dataclass(frozen=True)
class Views:
    """P blocks of one population as a sonar views them.

    block : (P,) which. stretch : (P, 3) singular values of the instances' transforms, descending.
    nearest : (P,) metres to the nearest that a block may hold. direction : (P, 3) unit, local, in which
    its middle is seen; spread : (P,) radians that directions within it depart from that.
    """

    block: np.ndarray
    stretch: np.ndarray
    nearest: np.ndarray
    direction: np.ndarray
    spread: np.ndarray


class Population(ABC):
    """Population of one kind in one mesh, local; rows are in the order of the blocks."""

    kind: ClassVar[str]
    blocks: Blocks

    def __len__(self) -> int:
        return len(self.blocks.order)

    @property
    @abstractmethod
    def held(self) -> tuple[np.ndarray, np.ndarray]:
        """Middles (R, 3) of the rows and the leaf that each is of (R,), -1 where of none."""

    @abstractmethod
    def ceiling(self, views: Views, lowest: float, highest: float) -> np.ndarray:
        """(P,) no Σ|f| of a block, as it is viewed, between two wavenumbers is larger."""

    @abstractmethod
    def scatterers(
        self, transform: np.ndarray, rows: np.ndarray, sight: Sight
    ) -> Sequence[Scatterers]:
        """Rows through one (3, 4) transform, in one or more sets."""


@dataclass(frozen=True)
class Blocks:
    """B blocks of N points, block by block.

    order : (N,) the points' numbers before, in the order of the blocks. first : (B + 1,).
    centre : (B, 3). radius : (B,) metres; every point, with its own extent, lies within.
    """

    order: np.ndarray
    first: np.ndarray
    centre: np.ndarray
    radius: np.ndarray

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def count(self) -> np.ndarray:
        """(B,) points of each block."""
        return np.diff(self.first)

    def each(self, of: np.ufunc, values: np.ndarray) -> np.ndarray:
        """(B,) the largest (np.maximum) or the sum (np.add) of values (N,), in the order of the blocks."""
        return of.reduceat(values, self.first[:-1]) if len(self) else np.empty(0)


def cluster(points: np.ndarray, extent: np.ndarray) -> Blocks:
    """Blocks of points (N, 3) that reach ``extent`` (N,) metres around themselves.

    Points that are not finite come last, in a block that is infinitely large and so always looked at.
    """
    finite = np.isfinite(points).all(axis=1) & np.isfinite(extent)
    runs: list[np.ndarray] = []
    pending = [np.flatnonzero(finite)]
    while pending:
        rows = pending.pop()
        if len(rows) <= SIZE:
            if len(rows):
                runs.append(rows)
            continue
        widest = int(np.argmax(np.ptp(points[rows], axis=0)))
        middle = len(rows) // 2
        rows = rows[np.argpartition(points[rows, widest], middle)]
        pending += [rows[middle:], rows[:middle]]
    spheres = [_sphere(points[rows], extent[rows]) for rows in runs]
    if not finite.all():
        runs.append(np.flatnonzero(~finite))
        spheres.append((np.zeros(3), np.inf))
    return Blocks(
        order=np.concatenate(runs) if runs else np.empty(0, np.int64),
        first=np.concatenate([[0], np.cumsum([len(rows) for rows in runs])]).astype(np.int64),
        centre=np.array([centre for centre, _ in spheres]).reshape(-1, 3),
        radius=np.array([radius for _, radius in spheres], dtype=np.float64),
    )


def _sphere(points: np.ndarray, extent: np.ndarray) -> tuple[np.ndarray, float]:
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    return centre, float((np.linalg.norm(points - centre, axis=1) + extent).max())
