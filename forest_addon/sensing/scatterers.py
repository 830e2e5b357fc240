"""What sounds back: places in the world, each with a strength seen from a sonar.

``Scatterers`` are M places of one kind. Seen from a point, a kind has a ``strength``: the scattering
amplitude f(k) in metres, smooth but for what ``reach`` says, and never larger than its ``bound``. Leaves
are discs (``acoustics/disc``); trunks and branches are in ``wood``, ground and rocks in ``facets``.

A ``Population`` is what one mesh has of one kind, in local space and in blocks; instances make scatterers
of its rows when a sonar comes near.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, Protocol, Self

import numpy as np

from ..acoustics.disc import amplitude_bound, backscatter_amplitude
from .clusters import Blocks, cluster
from .discs import SIMILAR, Foliage


def spiral(count: int) -> np.ndarray:
    """(count, 3) unit directions evenly over the upper hemisphere (Fibonacci's spiral)."""
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    side = np.sqrt(1.0 - z**2)
    return np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1)


LEAF, WOOD, FACET = "leaf", "wood", "facet"
SPREADS = np.array([0.08, 0.16, 0.32])  # radians between views of one block
VIEWS = spiral(96)  # of a block, one of each pair of opposite directions
BETWEEN = 0.23  # radians from any direction to the nearest of these, at most
TABLE_NOISE = 1e-4  # of a leaf at a random angle, where a table is 1e-5 of it face-on
RADII, STEPS = 8, 90  # classes of radii, steps of incidence
CLEAR = 1e-3  # m; what is so close before a scatterer is what it sits on


class Rows:
    """Base of dataclasses whose fields are arrays of the same length."""

    def select(self, rows: np.ndarray | slice) -> Self:
        """Some rows of every field."""
        kept = {}
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            kept[field.name] = value[rows] if isinstance(value, np.ndarray) else value
        return type(self)(**kept)


class Strength(Protocol):
    """How M scatterers send sound back to one point.

    noise : error of typical amplitudes as a share of themselves; no sum need be more exact.
    """

    @property
    def noise(self) -> float: ...

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        """(Q, M) complex f in metres at wavenumbers (Q,), e^{+iωt}."""
        ...

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        """(M,) no |f| between two wavenumbers is larger."""
        ...

    def reach(self) -> np.ndarray:
        """(M,) metres that the echo is spread by about its path, half of it to either side."""
        ...

    def select(self, rows: np.ndarray | slice) -> Self: ...


class Scatterers(Protocol):
    """M places of one kind.

    centre : (M, 3) metres. number : (M,) int64, in its mesh. clear : (M,) metres before it that hide
    nothing.
    """

    kind: ClassVar[str]

    @property
    def centre(self) -> np.ndarray: ...

    @property
    def number(self) -> np.ndarray: ...

    @property
    def clear(self) -> np.ndarray: ...

    def __len__(self) -> int: ...

    def seen(self, point: np.ndarray) -> Strength:
        """The strength towards a point (3,)."""
        ...

    def select(self, rows: np.ndarray | slice) -> Self: ...


@dataclass(frozen=True)
class Sight:
    """What a population must know of a sonar before it makes scatterers.

    point : (3,) where it is. wavenumber : the largest, 1/m. reach : metres, its range.
    """

    point: np.ndarray
    wavenumber: float
    reach: float


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


class Population(Protocol):
    """What one mesh has of one kind, local; rows are in the order of the blocks."""

    kind: ClassVar[str]
    blocks: Blocks

    def __len__(self) -> int: ...

    def ceiling(self, views: Views, lowest: float, highest: float) -> np.ndarray:
        """(P,) no Σ|f| of a block, as it is viewed, between two wavenumbers is larger."""
        ...

    def scatterers(self, transform: np.ndarray, rows: np.ndarray, sight: Sight) -> Scatterers:
        """Some rows through one (3, 4) transform."""
        ...


# ------------------------------------------------------------------------------------------- leaves


@dataclass(frozen=True)
class DiscStrength(Rows):
    """radius, incidence : (M,) metres and radians."""

    radius: np.ndarray
    incidence: np.ndarray
    model: str

    @property
    def noise(self) -> float:
        return TABLE_NOISE if self.model == "exact" else 0.0

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        k = np.asarray(wavenumber)[:, None]
        return backscatter_amplitude(k * self.radius, self.incidence, self.model) / k

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        return amplitude_bound(lowest, highest, self.radius, self.incidence, self.model)

    def reach(self) -> np.ndarray:
        if self.model == "paper":  # has the beam of the mirror direction, and no rim
            return np.zeros(len(self.radius))
        if self.model == "exact":  # sound also runs across the face, from rim to rim
            return 2.0 * self.radius
        return 2.0 * self.radius * np.sin(self.incidence)


@dataclass(frozen=True)
class Leaves(Rows):
    """Leaves as discs: centre, unit normal (M, 3), radius (M,); see ``Scatterers``."""

    centre: np.ndarray
    normal: np.ndarray
    radius: np.ndarray
    number: np.ndarray
    model: str
    kind: ClassVar[str] = LEAF

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def clear(self) -> np.ndarray:
        return np.full(len(self), CLEAR)

    def seen(self, point: np.ndarray) -> DiscStrength:
        away = self.centre - point
        facing = np.abs(np.einsum("mi,mi->m", away, self.normal))
        squared = np.einsum("mi,mi->m", away, away)
        across = away - np.einsum("mi,mi->m", away, self.normal)[:, None] * self.normal
        grazing = np.where(
            facing**2 > 0.5 * squared,
            np.sqrt(np.einsum("mi,mi->m", across, across)),  # keeps its digits face-on
            np.sqrt(np.maximum(squared - facing**2, 0.0)),
        )
        return DiscStrength(self.radius, np.arctan2(grazing, facing), self.model)


class LeafPopulation:
    """The leaves of one mesh."""

    kind: ClassVar[str] = LEAF

    def __init__(self, foliage: Foliage, model: str) -> None:
        centre, _, radius = foliage.local
        self.blocks = cluster(centre, np.where(np.isfinite(radius), 0.0, np.nan))
        self._foliage, self._model = foliage, model
        self._largest = self.blocks.largest(radius[self.blocks.order])
        self._tables: dict[tuple[float, float], np.ndarray] = {}

    def __len__(self) -> int:
        return len(self.blocks.order)

    def ceiling(self, views: Views, lowest: float, highest: float) -> np.ndarray:
        widened = np.sqrt(views.stretch[:, 0] * views.stretch[:, 1]) * self._largest[views.block]
        most = self.blocks.count[views.block] * amplitude_bound(
            lowest, highest, widened, np.zeros(1), self._model
        )
        scale = views.stretch[:, 0]
        alike = scale - views.stretch[:, 2] <= 2 * SIMILAR * scale
        spread = np.searchsorted(SPREADS, views.spread)
        known = np.flatnonzero(alike & (spread < len(SPREADS)))
        if len(known):
            # A bound grows with the radius at most as its square, and at least as its root.
            larger = np.maximum(scale[known] ** 2, np.sqrt(scale[known]))
            view = np.abs(views.direction[known] @ VIEWS.T).argmax(axis=1)
            table = self._directed(lowest, highest)
            some = larger * table[views.block[known], view, spread[known]]
            most[known] = np.minimum(most[known], some)
        return most

    def _directed(self, lowest: float, highest: float) -> np.ndarray:
        """(B, V, S) bounds on Σ|f| of blocks that are seen from ``VIEWS``, give or take ``SPREADS``.

        Radii are rounded up to a few classes, incidences down to steps, and a bound is made to fall with
        the incidence, so that two look-ups a leaf and view do.
        """
        key = (lowest, highest)
        if key not in self._tables:
            _, normal, radius = (values[self.blocks.order] for values in self._foliage.local)
            radius = np.nan_to_num(radius, posinf=0.0)
            classes = np.quantile(radius, np.linspace(0.0, 1.0, RADII + 1)[1:])
            step = np.linspace(0.0, np.pi / 2, STEPS + 1)
            bound = amplitude_bound(lowest, highest, classes[:, None], step, self._model)
            bound = np.maximum.accumulate(bound[:, ::-1], axis=1)[:, ::-1].astype(np.float32)
            row = np.searchsorted(classes, radius)[:, None] * np.int64(STEPS + 1)
            cosine = np.abs(normal @ VIEWS.T)
            incidence = np.arccos(np.minimum(np.nan_to_num(cosine), 1.0)).astype(np.float32)
            tables = []
            for spread in SPREADS:
                place = np.maximum(incidence - np.float32(spread + BETWEEN), 0.0) * (
                    2 * STEPS / np.pi
                )
                some = bound.ravel().take(row + place.astype(np.int64))
                tables.append(np.add.reduceat(some, self.blocks.first[:-1], axis=0))
            self._tables[key] = 1.00001 * np.stack(tables, axis=-1)  # sums in single precision
        return self._tables[key]

    def scatterers(self, transform: np.ndarray, rows: np.ndarray, sight: Sight) -> Scatterers:
        leaf = self.blocks.order[rows]
        centre, normal, radius = self._foliage.moved(transform, leaf)
        return Leaves(
            centre, normal, radius, self._foliage.leaf[leaf].astype(np.int64), self._model
        )
