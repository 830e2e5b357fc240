"""Leaves as discs that sound back.

A leaf is a disc of its own area (``discs``) whose scattering is that of ``acoustics/disc``. Well off its
normal a piston's echo comes from two places of its rim, the nearest and the farthest, whose interference
is what wiggles in frequency: each alone is smooth. How leaves sound that are too near for a
disc's far field is in ``near``; the leaves of a mesh are in ``foliage``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy import special

from ...acoustics.disc import amplitude_bound, backscatter_amplitude
from ...acoustics.disc_modes import DiscModes, has_rows, modes_of, phase_for
from ...acoustics.disc_table import HANDOVER, table_error
from ...acoustics.smoothness import SmoothnessProfile
from ...base.rows import RowTable
from .scatterers import CLEAR, LEAF, ScattererPart, Strength, Whole

RIM = 6.0  # 2ka·sinβ above which a piston's echo is that of two places of its rim
HANKEL_TERMS = 11
INCIDENCES = 16  # classes of them
LATER = 1.0  # radii, about which an exact disc's response lies evenly
COARSEST = 3e-5  # tolerance from which on tables of a band are used
MODAL = 512  # discs from which on modes are worth their table
LOOKED_UP = 0.45  # of the tolerance, for their error
GRAZING = (
    np.pi / 3
)  # beyond it, the formula for large discs is up to 79 % off, where they are faint


@dataclass(frozen=True)
class DiscStrength(RowTable):
    """radius, incidence : (M,) metres and radians. nearness : (M,) a factor of the amplitude."""

    radius: np.ndarray
    incidence: np.ndarray
    nearness: np.ndarray
    model: str

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        k = np.asarray(wavenumber)[:, None]
        amplitude = backscatter_amplitude(k * self.radius, self.incidence, self.model)
        amplitude *= self.nearness / k
        return amplitude

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        far = amplitude_bound(lowest, highest, self.radius, self.incidence, self.model)
        return self.nearness * far

    def parts(self, lowest: float, highest: float, tolerance: float = 0.0) -> list[ScattererPart]:
        """Of a piston, far enough off its normal, the two places of its rim that sound; of an exact disc
        itself, some time later, and where the tolerance lets it be, looked up for the whole band."""
        if self.model == "exact":
            return self._shifted(lowest, highest, tolerance)
        across = self.radius * np.sin(self.incidence)
        rims = (2.0 * lowest * across > RIM) & (2.0 * (highest - lowest) * across > np.pi)
        rims &= self.model == "piston"
        near, far = np.flatnonzero(~rims), np.flatnonzero(rims)
        parts = [ScattererPart(near, np.zeros(len(near)), self.select(near))] if len(near) else []
        if len(far):
            for side in (-1, 1):
                strength = DiscRim(across[far], self.radius[far], self.incidence[far], side)
                parts.append(ScattererPart(far, side * 2.0 * across[far], strength))
        return parts

    def _shifted(self, lowest: float, highest: float, tolerance: float) -> list[ScattererPart]:
        known = has_rows(self.radius, highest) & (tolerance >= COARSEST) & (highest > lowest)
        parts = []
        for rows, looked_up in ((np.flatnonzero(~known), False), (np.flatnonzero(known), True)):
            if len(rows):
                some, table, off = self.select(rows), None, None
                if looked_up:
                    phase, largest = phase_for(LOOKED_UP * tolerance), float(some.radius.max())
                    table = modes_of(self.model, (lowest, highest), phase, largest)
                    off = some.nearness * table.errors(some.radius, some.incidence)
                later = ShiftedDisc(some.radius, some.incidence, some.nearness, table)
                without = replace(later, table=None)
                parts.append(ScattererPart(rows, LATER * some.radius, later, off, without))
        return parts

    def modal(
        self, lowest: float, highest: float, tolerance: float
    ) -> tuple[np.ndarray, DiscModes | None]:
        """Rows (m,) of which a table has modes between two wavenumbers, and the table; None: of too few.

        A piston's rims have a formula (``DiscRim``), which takes no table to be made.
        """
        rows = np.flatnonzero(has_rows(self.radius, highest) & (highest > lowest))
        if self.model == "piston" or tolerance < COARSEST or len(rows) < MODAL:
            return rows[:0], None
        phase, largest = phase_for(LOOKED_UP * tolerance), float(self.radius[rows].max())
        return rows, modes_of(self.model, (lowest, highest), phase, largest)

    def profile(self) -> SmoothnessProfile:
        return SmoothnessProfile(
            DiscFamily(self.model), self.nearness * self.radius, self.radius, self.incidence
        )

    def error(self, highest: float) -> np.ndarray | None:
        if self.model != "exact":
            return None
        return self.radius * table_error(highest * self.radius, self.incidence)


def count_doubtful(leaves: LeafEchoes, point: np.ndarray, wavenumber: float) -> int:
    """Return how many exact discs are so large and so far off their normal that the formula for large ones
    is tens of per cent off."""
    if leaves.model != "exact":
        return 0
    size = wavenumber * leaves.radius
    return int(np.count_nonzero((size > HANDOVER) & (leaves.incidence(point) > GRAZING)))


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
            return 8.0 * first
        return 2.0 * first * np.sin(second)


@dataclass(frozen=True)
class ShiftedDisc(RowTable, Whole):
    """Exact discs without a delay of ``LATER`` radii, about which their responses are shortest.

    radius, incidence, nearness : as of ``DiscStrength``. table : of a band, which they are looked up in;
    None: in none.
    """

    radius: np.ndarray
    incidence: np.ndarray
    nearness: np.ndarray
    table: DiscModes | None

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        k = np.asarray(wavenumber)[:, None]
        size = k * self.radius
        if self.table is not None:
            wave = self.table.amplitude(np.asarray(wavenumber), self.radius, self.incidence)
            turn = (LATER * size).astype(np.float32)
            later = np.empty(turn.shape, np.complex64)
            later.real, later.imag = np.cos(turn), np.sin(turn)
            later *= self.nearness.astype(np.float32)
            wave *= later
            return wave
        amplitude = backscatter_amplitude(size, self.incidence, "exact")
        amplitude *= np.exp(1j * LATER * size) * (self.nearness / k)
        return amplitude

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        far = amplitude_bound(lowest, highest, self.radius, self.incidence, "exact")
        return self.nearness * far

    def profile(self) -> SmoothnessProfile:
        scale = self.nearness * self.radius
        return SmoothnessProfile(ShiftedFamily(), scale, self.radius, self.incidence)


@dataclass(frozen=True)
class ShiftedFamily(DiscFamily):
    """The same as a function of ka and the incidence."""

    model: str = "exact"

    def evaluate(self, scale: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        size = np.maximum(scale * first, 1e-9)
        return super().evaluate(scale, first, second) * np.exp(1j * LATER * size)


@dataclass(frozen=True)
class DiscRim(RowTable, Whole):
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

    def profile(self) -> SmoothnessProfile:
        size = 0.25 * self.radius**2 * np.cos(self.incidence) / self.across
        return SmoothnessProfile(RimFamily(), size, 2.0 * self.across, size)


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
class LeafEchoes(RowTable):
    """Leaves as discs: centre, unit normal (M, 3), radius (M,); see ``Scatterers``.

    nearness : (M,) what the amplitudes are multiplied with.
    """

    centre: np.ndarray
    normal: np.ndarray
    radius: np.ndarray
    number: np.ndarray
    nearness: np.ndarray
    model: str
    kind: ClassVar[str] = LEAF

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def clear(self) -> np.ndarray:
        return np.full(len(self), CLEAR)

    def seen(self, point: np.ndarray) -> Strength:
        return DiscStrength(self.radius, self.incidence(point), self.nearness, self.model)

    def incidence(self, point: np.ndarray) -> np.ndarray:
        """(M,) radians between their normals and the way to a point."""
        x, y, z = np.ascontiguousarray((self.centre - point).T)
        u, v, w = np.ascontiguousarray(self.normal.T)
        facing = np.abs(x * u + y * v + z * w)
        # Sine and cosine both keep their digits, face-on and edge-on.
        grazing = np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2)
        angle: np.ndarray = np.arctan2(grazing, facing)
        return angle
