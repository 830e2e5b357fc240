"""Beams: the amplitude of a sonar by direction, in its own frame.

Directions go in, the amplitude relative to the axis comes out, for sending or for hearing. The offsets
az and el are measured from the beam axis in the sonar's own frame: the angle off the axis is laid out
along the side to which the direction lies off. So they are the plain azimuth and elevation in the two
planes of the axis, have neither pole nor wrap, and a beam that looks straight up is like any other.

``GaussianBeam``   exp(-az²/2σ_x² - el²/2σ_y²) with σ from the full -3 dB width (Tanveer et al. 2020a).
``Horseshoe``    the same with Tanveer et al.'s width for a horseshoe bat, which falls with the frequency.
``MeasuredBeam``   a table of dB by angle off the axis and frequency, smoothed over the frequency.
``MeasuredSphere`` the same by direction all round, as of a head's ear.
``Omni``       everywhere alike.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

HALF_POWER = -2.0 * math.log(10.0 ** (-3.0 / 20.0))  # Tanveer et al. (2020a) print -2·ln 0.7079
DEGREES = 4  # of the polynomials in frequency through a measured pattern
EVEN = 1.0  # dB, to which a direction is taken to hear all frequencies alike
FILL, GAP = 400, 2.0 * math.sin(math.radians(10.0))  # directions that fill, a chord of 20°
HORSESHOE = (
    0.011333,
    -2.3219,
    156.15,
    -3402.7,
)  # degrees, of the frequency in kHz (Tanveer et al. 2020a)


Rows = np.ndarray | slice


class BeamPattern(ABC):
    """A directivity, 1 on its axis or where it is largest; offsets az and el (M,) are in radians."""

    @abstractmethod
    def terms(self, az: np.ndarray, el: np.ndarray) -> np.ndarray:
        """(D, M) of the logarithm of the gain at offsets: times ``basis``, they add up to it."""

    @abstractmethod
    def basis(self, frequency: np.ndarray) -> np.ndarray:
        """(D, Q) what the terms are multiplied with at frequencies (Q,)."""

    @property
    def steepness(self) -> np.ndarray:
        """(2,) of the logarithm of the gain over squared offsets, at any frequency; NaN of another form."""
        return np.full(2, np.nan)

    @abstractmethod
    def ceiling(self, away: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        """(M,) no gain in the band is larger at ``away`` (M,) radians off the axis or more."""

    def gain(self, az: np.ndarray, el: np.ndarray, frequency: np.ndarray) -> np.ndarray:
        """(Q, M) at frequencies (Q,)."""
        return np.exp(np.einsum("dq,dm->qm", self.basis(frequency), self.terms(az, el)))

    def loudest(self, az: np.ndarray, el: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        """(M,) no gain in the band is larger at these offsets."""
        return np.asarray(self.gain(az, el, np.array(band)).max(axis=0))

    def kinks(self) -> tuple[float, ...]:
        """Frequencies at which the gain is not smooth, Hz."""
        return ()


@dataclass(frozen=True)
class GaussianBeam(BeamPattern):
    """A beam of the same full -3 dB ``width`` (radians; azimuth, elevation) at every frequency."""

    width: tuple[float, float]

    def terms(self, az: np.ndarray, el: np.ndarray) -> np.ndarray:
        along, up = self.steepness
        return (along * np.square(az) + up * np.square(el))[None]

    def basis(self, frequency: np.ndarray) -> np.ndarray:
        return np.ones((1, len(frequency)))

    @property
    def steepness(self) -> np.ndarray:
        return np.asarray(-2.0 * HALF_POWER / np.square(self.width))

    def loudest(self, az: np.ndarray, el: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return np.exp(self.terms(az, el)[0])

    def ceiling(self, away: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return np.exp(-2.0 * HALF_POWER * np.square(away / max(self.width)))


@dataclass(frozen=True)
class Omni(GaussianBeam):
    """The same in every direction: a Gaussian beam without end."""

    width: tuple[float, float] = (math.inf, math.inf)


@dataclass(frozen=True)
class Horseshoe(BeamPattern):
    """The beam of Tanveer et al. (2020a): a Gaussian whose width falls with the frequency, 60 to 80 kHz."""

    def width(self, frequency: np.ndarray) -> np.ndarray:
        """Full -3 dB width in radians."""
        return np.deg2rad(np.polyval(HORSESHOE, np.asarray(frequency) / 1e3))

    def terms(self, az: np.ndarray, el: np.ndarray) -> np.ndarray:
        return -2.0 * HALF_POWER * (np.square(az) + np.square(el))[None]

    def basis(self, frequency: np.ndarray) -> np.ndarray:
        return 1.0 / np.square(self.width(frequency))[None]

    def ceiling(self, away: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return np.exp(-2.0 * HALF_POWER * np.square(away / self.width(np.array(band[0]))))


class Measured(BeamPattern):
    """Pattern of dB (N, F) at N directions and F frequencies, Hz, between which dB are mixed.

    Over the frequency they follow a polynomial of at most the fourth degree, so that echoes stay smooth
    in frequency, of a lower one where it would swing beyond the measured dB by more than their span;
    beyond the first and last frequency they stay.
    """

    frequency: np.ndarray
    level: np.ndarray

    @cached_property
    def _fit(self) -> np.ndarray:
        """(D, N) Chebyshev coefficients over the pattern's frequencies."""
        if len(self.frequency) == 1:
            return np.asarray(self.level.T)
        low, high = self.frequency[0], self.frequency[-1]
        known = 2.0 * (self.frequency - low) / (high - low) - 1.0
        low, high = self.level.min(axis=1), self.level.max(axis=1)
        span = (high - low + EVEN)[:, None]
        for degree in range(min(DEGREES, len(known) - 1), -1, -1):
            fit = np.polynomial.chebyshev.chebfit(known, self.level.T, degree)
            between = np.polynomial.chebyshev.chebval(np.linspace(-1.0, 1.0, 65), fit)
            if (np.abs(between - 0.5 * (low + high)[:, None]) <= 1.5 * span).all():
                break
        return fit

    def levels(self, frequency: np.ndarray) -> np.ndarray:
        """(N, Q) dB at other frequencies."""
        return self._fit.T @ self.basis(frequency)

    def basis(self, frequency: np.ndarray) -> np.ndarray:
        low, high = self.frequency[0], self.frequency[-1]
        wanted = 2.0 * (np.clip(frequency, low, high) - low) / ((high - low) or 1.0) - 1.0
        return np.polynomial.chebyshev.chebvander(wanted, len(self._fit) - 1).T

    def terms(self, az: np.ndarray, el: np.ndarray) -> np.ndarray:
        corners, kind, shares = self._mixed(az, el)
        terms = np.zeros((len(self._fit), len(az)))
        for corner, share in zip(corners.T, shares, strict=True):
            terms += share * self._fit.take(corner.take(kind), axis=1)
        return terms * (math.log(10.0) / 20.0)

    @abstractmethod
    def _mixed(self, az: np.ndarray, el: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[Any]]:
        """(C, K) directions of the pattern whose dB are mixed, which row of these (M,) are each's, and K
        times (M,) their shares."""

    def kinks(self) -> tuple[float, ...]:
        """The first and the last frequency, beyond which levels stay."""
        if len(self.frequency) == 1:
            return ()
        return float(self.frequency[0]), float(self.frequency[-1])

    def _loudest(self, band: tuple[float, float]) -> np.ndarray:
        """(N,) the largest dB in the band."""
        return np.asarray(self.levels(np.linspace(*band, 65)).max(axis=1))


@dataclass(frozen=True)
class MeasuredBeam(Measured):
    """A pattern about the axis.

    angle : (A,) radians off the axis, ascending from 0. frequency : (F,) Hz. level : (A, F) dB.

    Between angles dB are interpolated; beyond the last they stay.
    """

    angle: np.ndarray
    frequency: np.ndarray
    level: np.ndarray

    def _mixed(self, az: np.ndarray, el: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[Any]]:
        if len(self.angle) == 1:
            return np.zeros((1, 1), int), np.zeros(len(az), int), [1.0]
        before = np.arange(len(self.angle) - 1)
        off = np.clip(np.hypot(az, el), self.angle[0], self.angle[-1])
        first = np.searchsorted(self.angle, off, side="right") - 1
        first = np.minimum(first, len(before) - 1)
        share = (off - self.angle[first]) / (self.angle[first + 1] - self.angle[first])
        return np.stack([before, before + 1], axis=1), first, [1.0 - share, share]

    def loudest(self, az: np.ndarray, el: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return self.ceiling(np.hypot(az, el), band)

    def ceiling(self, away: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        beyond = np.maximum.accumulate(self._loudest(band)[::-1])[::-1]
        before = np.searchsorted(self.angle, away, side="right") - 1
        return 10.0 ** (beyond[np.clip(before, 0, None)] / 20.0)


@dataclass(frozen=True)
class MeasuredSphere(Measured):
    """A pattern by directions all round.

    direction : (D, 3) unit vectors, x ahead, y to the left, z up. frequency : (F,) Hz. level : (D, F) dB.

    dB are mixed within the triangles between neighbouring directions (of their convex hull, which is
    Delaunay's on the sphere). ``all_round`` fills what was not measured.
    """

    direction: np.ndarray
    frequency: np.ndarray
    level: np.ndarray

    @classmethod
    def all_round(
        cls, direction: np.ndarray, frequency: np.ndarray, level: np.ndarray
    ) -> MeasuredSphere:
        """The pattern of directions (D, 3); where none is within 20°, the nearest one's dB hold."""
        from scipy.spatial import cKDTree

        index = np.arange(FILL) + 0.5  # a spiral, evenly over the sphere
        up, turn = 1.0 - 2.0 * index / FILL, math.pi * (1.0 + math.sqrt(5.0)) * index
        level_part = np.sqrt(1.0 - up**2)
        spiral = np.stack([level_part * np.cos(turn), level_part * np.sin(turn), up], axis=1)
        gap, nearest = cKDTree(direction).query(spiral)
        bare = gap > GAP
        return cls(
            np.concatenate([direction, spiral[bare]]),
            frequency,
            np.concatenate([level, level[nearest[bare]]]),
        )

    @cached_property
    def _faces(self) -> tuple[np.ndarray, np.ndarray, cKDTree]:
        """Corners (T, 3), the inverses (T, 3, 3) of their vectors, and where rays leave the hull.

        A ray d leaves through the face whose n/h·d is largest, n its normal and h its distance: the nearest
        of the (n/h, √(R² - |n/h|²)) to (d, 0), R the largest |n/h|.
        """
        from scipy.spatial import ConvexHull, cKDTree

        hull = ConvexHull(self.direction)
        slope = hull.equations[:, :3] / -hull.equations[:, 3:]
        squared = np.einsum("ti,ti->t", slope, slope)
        lifted = np.column_stack([slope, np.sqrt(np.maximum(squared.max() - squared, 0.0))])
        corners = hull.simplices
        return corners, np.linalg.pinv(self.direction[corners].transpose(0, 2, 1)), cKDTree(lifted)

    def _mixed(self, az: np.ndarray, el: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[Any]]:
        off = np.hypot(az, el)
        share = np.sinc(off / math.pi)  # sin(off)/off
        towards = np.stack([np.cos(off), share * az, share * el], axis=1)
        corners, inverse, where = self._faces
        _, face = where.query(np.column_stack([towards, np.zeros(len(off))]))
        weight = np.maximum(np.einsum("mij,mj->mi", inverse[face], towards), 0.0)
        return corners, face, list((weight / weight.sum(axis=1, keepdims=True)).T)

    def loudest(self, az: np.ndarray, el: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        corners, face, _ = self._mixed(az, el)
        return 10.0 ** (self._loudest(band)[corners[face]].max(axis=1) / 20.0)

    def ceiling(self, away: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        corners = self._faces[0]
        place = self.direction[corners]  # (T, 3, 3)
        side = np.linalg.norm(place - np.roll(place, 1, axis=1), axis=2).max(axis=1)
        off = np.arccos(np.clip(place[:, :, 0], -1.0, 1.0)).max(axis=1)
        reach = off + 2.0 * np.arcsin(np.minimum(side / 2.0, 1.0))  # no face goes farther off
        order = np.argsort(reach)
        loudest = self._loudest(band)[corners].max(axis=1)[order]
        beyond = np.maximum.accumulate(loudest[::-1])[::-1]
        first = np.searchsorted(reach[order], away, side="left")
        return 10.0 ** (beyond[np.minimum(first, len(beyond) - 1)] / 20.0)


def beam_offsets(directions: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation (L,) off the axis, radians; their hypotenuse is the angle off the axis.

    frame : (3, 3) of ``trajectory.frame_of``. Positive to the left and up. Straight behind, where the side is
    open, all of it is azimuth.
    """
    forward, left, up = frame @ directions.T
    side = np.sqrt(left * left + up * up)
    angle = np.arctan2(side, forward)
    aside = side > 0
    share = np.where(aside, angle, 0.0) / np.where(aside, side, 1.0)
    return np.where(aside, share * left, angle), share * up
