"""Leaves as discs that sound back.

A leaf is a disc of its own area (``discs``) whose scattering is that of ``acoustics/disc``. Well off its
normal a piston's echo comes from two places of its rim, the nearest and the farthest, whose interference
is what wiggles in frequency: each alone is smooth. How leaves sound that are too near for a
disc's far field is in ``near``; the leaves of a mesh are in ``foliage``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ...acoustics.disc import amplitude_bound, backscatter_amplitude
from ...acoustics.disc_table import HANDOVER, table_error
from ...acoustics.hankel import SMALLEST, hankel
from ...acoustics.modes.disc_modes import DiscModes, has_rows, modes_of, phase_for
from ...acoustics.modes.line_modes import BandLoss
from ...acoustics.modes.mode_sum import ModalEchoes
from ...acoustics.modes.waves import COARSEST, MODAL, piston_waves, rims_apart
from ...acoustics.smoothness import SmoothnessProfile
from ...base.rows import RowTable
from .scatterers import CLEAR, LEAF, ScattererPart, Strength, Whole

INCIDENCES = 16  # classes of them
LATER = 1.0  # radii, about which an exact disc's response lies evenly
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
        rims = rims_apart(across, lowest, highest) & (self.model == "piston")
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
        self, lowest: float, highest: float, tolerance: float, loss: BandLoss
    ) -> ModalEchoes | None:
        """Discs that a table has rows of; of pistons the places of their rims, or the whole."""
        if tolerance < COARSEST or len(self.radius) < MODAL or highest <= lowest:
            return None
        if self.model == "piston":
            return piston_waves(self.radius, self.incidence, self.nearness, lowest, highest, loss)
        rows = np.flatnonzero(has_rows(self.radius, highest))
        if len(rows) < MODAL:
            return None
        some = self if len(rows) == len(self.radius) else self.select(rows)
        phase, largest = phase_for(LOOKED_UP * tolerance), float(some.radius.max())
        table = modes_of(self.model, (lowest, highest), phase, largest)
        places = table.places(some.radius, some.incidence)
        every = np.arange(len(rows))
        return ModalEchoes(rows, table, places, every, some.nearness, np.zeros(len(rows)))

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
        return hankel(np.maximum(scale * first, 0.8 * SMALLEST))

    def place(self, second: np.ndarray) -> np.ndarray:
        return np.zeros(len(second))

    def at(self, place: np.ndarray) -> np.ndarray:
        return np.zeros(np.shape(place))

    def turns(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return np.zeros(len(first))


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
