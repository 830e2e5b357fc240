"""Leaves as discs that sound back, and how loud a block of them can be.

A leaf is a disc of its own area (``discs``) whose scattering is that of ``acoustics/disc``. Well off its
normal a piston's echo comes from two places of its rim, the nearest and the farthest, whose interference
is what wiggles in frequency: each alone is smooth. A block of leaves has a table of bounds by the direction
it is seen from, because leaves that face away are hundreds of times weaker than leaves that face the sonar.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy import special

from ...acoustics.disc import amplitude_bound, backscatter_amplitude
from ...acoustics.disc_table import table_error
from ...acoustics.smoothness import Profile
from .clusters import cluster
from .discs import SIMILAR, Foliage
from .scatterers import CLEAR, LEAF, Part, Rows, Scatterers, Sight, Views, Whole


def spiral(count: int) -> np.ndarray:
    """(count, 3) unit directions evenly over the upper hemisphere (Fibonacci's spiral)."""
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    side = np.sqrt(1.0 - z**2)
    return np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1)


RIM = 6.0  # 2ka·sinβ above which a piston's echo is that of two places of its rim
HANKEL_TERMS = 11
SPREADS = np.array([0.08, 0.16, 0.32])  # radians between views of one block
VIEWS = spiral(96)  # of a block, one of each pair of opposite directions
BETWEEN = 0.23  # radians from any direction to the nearest of these, at most
INCIDENCES = 16  # classes of them
RADII, STEPS = 8, 90  # classes of radii, steps of incidence


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

    def parts(self, lowest: float, highest: float) -> list[Part]:
        """Of a piston, far enough off its normal, the two places of its rim that sound."""
        across = self.radius * np.sin(self.incidence)
        rims = (2.0 * lowest * across > RIM) & (2.0 * (highest - lowest) * across > np.pi)
        rims &= self.model == "piston"
        near, far = np.flatnonzero(~rims), np.flatnonzero(rims)
        parts = [Part(near, np.zeros(len(near)), self.select(near))] if len(near) else []
        if len(far):
            for side in (-1, 1):
                strength = DiscRim(across[far], self.radius[far], self.incidence[far], side)
                parts.append(Part(far, side * 2.0 * across[far], strength))
        return parts

    def profile(self) -> Profile:
        return Profile(DiscFamily(self.model), self.radius, self.radius, self.incidence)

    def error(self, highest: float) -> np.ndarray | None:
        if self.model != "exact":
            return None
        return self.radius * table_error(highest * self.radius, self.incidence)


@dataclass(frozen=True)
class DiscFamily:
    """f/a of a disc as a function of ka and the incidence."""

    model: str
    scaled: ClassVar[bool] = False

    def evaluate(self, scale: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        size = np.maximum(scale * first, 1e-9)
        return backscatter_amplitude(size, second, self.model) / size

    def place(self, second: np.ndarray) -> np.ndarray:
        return np.asarray(second) * (2 * INCIDENCES / np.pi)

    def at(self, place: np.ndarray) -> np.ndarray:
        return np.minimum(np.asarray(place) * (np.pi / 2 / INCIDENCES), np.pi / 2)

    def turns(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        if self.model == "paper":  # has the beam of the mirror direction, and no rim
            return np.where(
                first > 2e-3, 3.0 + 0.5 * second * np.maximum(first, 1e-3) ** -0.9, np.inf
            )
        if self.model == "exact":  # an edge's sound goes to and fro across the face
            return 5.0 * first
        return 2.0 * first * np.sin(second)


@dataclass(frozen=True)
class DiscRim(Rows, Whole):
    """One place of a piston's rim, without its delay: half of J₁ = Re H₁, H₁ the Hankel function.

    across : (M,) a·sinβ. side : -1 the place nearer to the sonar, 1 the farther.

    f = (i·a²·cosβ/4a·sinβ)·H₁(x)e^{-ix} or its conjugate, x = 2ka·sinβ: k·f = i(ka)²/2·cosβ·2J₁(x)/x.
    """

    across: np.ndarray
    radius: np.ndarray
    incidence: np.ndarray
    side: int

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        wave = hankel(2.0 * np.asarray(wavenumber)[:, None] * self.across)
        size = 0.25j * self.radius**2 * np.cos(self.incidence) / self.across
        return size * (wave if self.side < 0 else np.conj(wave))

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        return np.abs(self.amplitude(np.array([lowest])))[0]

    def profile(self) -> Profile:
        size = 0.25 * self.radius**2 * np.cos(self.incidence) / self.across
        return Profile(RimFamily(), size, 2.0 * self.across, size)


@dataclass(frozen=True)
class RimFamily:
    """Hankel functions without their phase."""

    scaled: ClassVar[bool] = False

    def evaluate(self, scale: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return hankel(np.maximum(scale * first, 0.8 * RIM))

    def place(self, second: np.ndarray) -> np.ndarray:
        return np.zeros(len(second))

    def at(self, place: np.ndarray) -> np.ndarray:
        return np.zeros(np.shape(place))

    def turns(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return np.zeros(len(first))


def hankel(x: np.ndarray) -> np.ndarray:
    """H₁⁽¹⁾(x)·e^{-ix} for x >= ``RIM``, to 2e-13: √x times it is smooth in 1/x."""
    place = 2.0 * RIM / x - 1.0
    root = np.sqrt(x)
    wave = np.empty(x.shape, dtype=np.complex128)
    for series, part in zip(_hankel_series(), (wave.real, wave.imag), strict=True):
        value = np.full(x.shape, series[-1])
        for term in series[-2::-1]:
            value *= place
            value += term
        np.divide(value, root, out=part)
    return wave


@lru_cache(maxsize=1)
def _hankel_series() -> tuple[np.ndarray, np.ndarray]:
    """Power series in 2·RIM/x - 1, from the values at Chebyshev points."""
    place = np.cos(np.pi * (np.arange(HANKEL_TERMS) + 0.5) / HANKEL_TERMS)
    x = 2.0 * RIM / (place + 1.0)
    value = special.hankel1e(1, x) * np.sqrt(x)
    fits = [
        np.polynomial.chebyshev.chebfit(place, part, HANKEL_TERMS - 1)
        for part in (value.real, value.imag)
    ]
    real, imaginary = (np.polynomial.chebyshev.cheb2poly(fit) for fit in fits)
    return real, imaginary


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
