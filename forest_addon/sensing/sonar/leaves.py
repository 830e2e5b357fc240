"""Leaves as discs that sound back.

A leaf is a disc of its own area (``discs``) whose scattering is that of ``acoustics/disc``. Well off its
normal a piston's echo comes from two places of its rim, the nearest and the farthest, whose interference
is what wiggles in frequency: each alone is smooth. How leaves sound that are too near for a
disc's far field is in ``near``; the leaves of a mesh are in ``foliage``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...acoustics.disc import amplitude_bound, backscatter_amplitude
from ...acoustics.disc_table import HANDOVER, table_error
from ...acoustics.hankel import SMALLEST, hankel
from .scatterers import LEAF, ScattererPart, Scatterers, Strength

LATER = 1.0  # radii, about which an exact disc's response lies evenly
EXACT_REACH, PAPER_REACH = 3.0, 0.3  # radii to both sides
PAPER_TURN = 0.36  # radians at ka = 1 by which the fit's angle turns while the frequency doubles
GRAZING = (
    np.pi / 3
)  # beyond it, the formula for large discs is up to 79 % off, where they are faint
FAR = 2.0  # ka² from where on f/r² holds within 0.1 dB, for the sound that is mirrored


@dataclass(frozen=True)
class DiscStrength(Strength):
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

    def parts(self, lowest: float, highest: float) -> list[ScattererPart]:
        """Of a piston, far enough off its normal, the two places of its rim that sound; of an exact disc
        itself, some time later: its rims' sound crosses its face."""
        if self.model == "exact":
            later = ShiftedDisc(self.radius, self.incidence, self.nearness, self.model)
            return [ScattererPart(np.arange(len(self.radius)), LATER * self.radius, later)]
        across = self.radius * np.sin(self.incidence)
        apart = max(SMALLEST / (2.0 * lowest), np.pi / (2.0 * (highest - lowest)))
        rims = (across > apart) & (self.model == "piston")
        near, far = np.flatnonzero(~rims), np.flatnonzero(rims)
        parts = [ScattererPart(near, np.zeros(len(near)), self.select(near))] if len(near) else []
        if len(far):
            for side in (-1, 1):
                strength = DiscRim(across[far], self.radius[far], self.incidence[far], side)
                parts.append(ScattererPart(far, side * 2.0 * across[far], strength))
        return parts

    def reach(self, wavenumber: float) -> np.ndarray:
        if self.model == "paper":  # has the beam of the mirror direction, and no rim
            turn = (
                PAPER_TURN * self.incidence * np.maximum(wavenumber * self.radius, 1e-3) ** -0.9065
            )
            return PAPER_REACH * self.radius + turn / wavenumber
        if self.model == "exact":
            return EXACT_REACH * self.radius
        return 2.0 * self.radius * np.sin(self.incidence)

    def error(self, highest: float) -> np.ndarray | None:
        if self.model != "exact":
            return None
        return self.radius * table_error(highest * self.radius, self.incidence)


@dataclass(frozen=True)
class ShiftedDisc(DiscStrength):
    """Exact discs, ``LATER`` radii later; see ``DiscStrength``."""

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        k = np.asarray(wavenumber)[:, None]
        size = k * self.radius
        amplitude = backscatter_amplitude(size, self.incidence, "exact").astype(np.complex64)
        size *= LATER / (2.0 * np.pi)
        size -= np.rint(size)  # in single precision, as the table is
        turn = (2.0 * np.pi * size).astype(np.float32)
        later = np.empty(size.shape, np.complex64)
        later.real, later.imag = np.cos(turn), np.sin(turn)
        later *= (self.nearness / k).astype(np.float32)
        amplitude *= later
        return amplitude


@dataclass(frozen=True)
class DiscRim(Strength):
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

    def reach(self, wavenumber: float) -> np.ndarray:
        return np.zeros(len(self.across))


@dataclass(frozen=True)
class LeafEchoes(Scatterers):
    """Leaves as discs: unit normal (M, 3), radius (M,).

    nearness : (M,) what the amplitudes are multiplied with.
    """

    normal: np.ndarray
    radius: np.ndarray
    nearness: np.ndarray
    model: str
    kind: ClassVar[str] = LEAF

    def count_close(self, instance: np.ndarray) -> int:
        return int(np.count_nonzero(self.nearness < (2.0 - (2.0 * FAR) ** -2) ** -0.5))

    def count_doubtful(self, point: np.ndarray, wavenumber: float) -> int:
        large = wavenumber * self.radius > HANDOVER
        grazing = self.incidence(point) > GRAZING
        return int(np.count_nonzero(large & grazing)) if self.model == "exact" else 0

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
