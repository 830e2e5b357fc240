"""What sounds back: places in the world, each with a strength seen from a sonar.

``Scatterers`` are M places of one kind. Seen from a point, a kind has a ``strength``: the scattering
amplitude f(k) in metres, smooth but for what ``reach`` says, and never larger than its ``bound``. Leaves
are discs (``acoustics/disc``); trunks and branches are in ``wood``, ground and rocks in ``facets``.

A ``Population`` is what one mesh has of one kind, in local space and in blocks; instances make scatterers
of its rows when a sonar comes near.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol, TypeVar

import numpy as np

from ..acoustics.disc import amplitude_bound, backscatter_amplitude
from .clusters import Blocks, cluster
from .discs import Foliage

LEAF, WOOD, FACET = "leaf", "wood", "facet"
CLEAR = 1e-3  # m; what is so close before a scatterer is what it sits on

S = TypeVar("S", bound="Rows")


class Rows:
    """Base of dataclasses whose fields are arrays of the same length."""

    def select(self: S, rows: np.ndarray | slice) -> S:
        """Some rows of every field."""
        kept = {}
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            kept[field.name] = value[rows] if isinstance(value, np.ndarray) else value
        return type(self)(**kept)


class Strength(Protocol):
    """How M scatterers send sound back to one point."""

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        """(Q, M) complex f in metres at wavenumbers (Q,), e^{+iωt}."""
        ...

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        """(M,) no |f| between two wavenumbers is larger."""
        ...

    def reach(self) -> np.ndarray:
        """(M,) metres that the echo is spread by about its path, half of it to either side."""
        ...

    def select(self: S, rows: np.ndarray | slice) -> S: ...


class Scatterers(Protocol):
    """M places of one kind.

    centre : (M, 3) metres. number : (M,) int64, in its mesh. clear : (M,) metres before it that hide
    nothing.
    """

    kind: str
    centre: np.ndarray
    number: np.ndarray
    clear: np.ndarray

    def __len__(self) -> int: ...

    def seen(self, point: np.ndarray) -> Strength:
        """The strength towards a point (3,)."""
        ...

    def select(self: S, rows: np.ndarray | slice) -> S: ...


@dataclass(frozen=True)
class Sight:
    """What a population must know of a sonar before it makes scatterers.

    point : (3,) where it is. wavenumber : the largest, 1/m. reach : metres, its range.
    """

    point: np.ndarray
    wavenumber: float
    reach: float


class Population(Protocol):
    """What one mesh has of one kind, local; rows are in the order of the blocks."""

    kind: str
    blocks: Blocks

    def __len__(self) -> int: ...

    def ceiling(
        self, stretch: np.ndarray, nearest: np.ndarray, lowest: float, highest: float
    ) -> np.ndarray:
        """(I, B) no Σ|f| of a block between two wavenumbers is larger.

        stretch : (I, 3) singular values of the instances' transforms, descending.
        nearest : (I, B) metres to the nearest that a block may hold.
        """
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

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        k = np.asarray(wavenumber)[:, None]
        return backscatter_amplitude(k * self.radius, self.incidence, self.model) / k

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        return amplitude_bound(lowest, highest, self.radius, self.incidence, self.model)

    def reach(self) -> np.ndarray:
        if self.model == "paper":  # has the beam of the mirror direction, and no rim
            return np.zeros(len(self.radius))
        return 2.0 * self.radius * np.sin(self.incidence)


@dataclass(frozen=True)
class Leaves(Rows):
    """Leaves as discs: centre, unit normal (M, 3), radius (M,); see ``Scatterers``."""

    centre: np.ndarray
    normal: np.ndarray
    radius: np.ndarray
    number: np.ndarray
    model: str
    kind = LEAF

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

    kind = LEAF

    def __init__(self, foliage: Foliage, model: str) -> None:
        centre, _, radius = foliage.local
        self.blocks = cluster(centre, np.where(np.isfinite(radius), 0.0, np.nan))
        self._foliage, self._model = foliage, model
        self._largest = self.blocks.largest(radius[self.blocks.order])

    def __len__(self) -> int:
        return len(self.blocks.order)

    def ceiling(
        self, stretch: np.ndarray, nearest: np.ndarray, lowest: float, highest: float
    ) -> np.ndarray:
        widened = np.sqrt(stretch[:, 0] * stretch[:, 1])[:, None] * self._largest
        return self.blocks.count * amplitude_bound(
            lowest, highest, widened, np.zeros(1), self._model
        )

    def scatterers(self, transform: np.ndarray, rows: np.ndarray, sight: Sight) -> Leaves:
        leaf = self.blocks.order[rows]
        centre, normal, radius = self._foliage.moved(transform, leaf)
        return Leaves(centre, normal, radius, self._foliage.leaf[leaf].astype(np.int64), self._model)
