"""Beams: the amplitude of a sonar by direction, in its own frame.

Directions go in, the amplitude relative to the axis comes out, for sending or for hearing. The offsets
az and el are measured from the beam axis in the sonar's own frame: the angle off the axis is laid out
along the side to which the direction lies off. So they are the plain azimuth and elevation in the two
planes of the axis, have neither pole nor wrap, and a beam that looks straight up is like any other.

``GaussianBeam``   exp(-az²/2σ_x² - el²/2σ_y²) with σ from the full -3 dB width (Tanveer et al. 2020a).
``Horseshoe``  the same with Tanveer et al.'s width of a horseshoe bat's call, which falls with the frequency.
``MeasuredBeam``   a table of dB by angle off the axis and frequency, smoothed over the frequency.
``Omni``       everywhere alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ...acoustics import chebyshev
from ...acoustics.smoothness import Change, Loss

HALF_POWER = -2.0 * math.log(10.0 ** (-3.0 / 20.0))  # Tanveer et al. (2020a) print -2·ln 0.7079
DEGREES = 4  # of the polynomials in frequency through a measured pattern
HORSESHOE = (
    0.011333,
    -2.3219,
    156.15,
    -3402.7,
)  # degrees, of the frequency in kHz (Tanveer et al. 2020a)


class BeamPattern(Protocol):
    """A directivity, 1 on its axis or where it is largest."""

    def gain(self, az: np.ndarray, el: np.ndarray, frequency: np.ndarray) -> np.ndarray:
        """(Q, M), or (1, M) where it is alike at every frequency (Q,), at offsets (M,) radians."""
        ...

    def losses(self, az: np.ndarray, el: np.ndarray) -> list[Loss | Change] | None:
        """Return what changes the gain over the frequency, none where nothing does; None: not known."""
        ...

    def kinks(self) -> tuple[float, ...]:
        """Frequencies at which the gain is not smooth, Hz."""
        ...

    def loudest(self, az: np.ndarray, el: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        """(M,) no gain in the band is larger at these offsets."""
        ...

    def ceiling(self, away: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        """(M,) no gain in the band is larger at ``away`` (M,) radians off the axis or more."""
        ...


@dataclass(frozen=True)
class GaussianBeam:
    """A beam of the same full -3 dB ``width`` (radians; azimuth, elevation) at every frequency."""

    width: tuple[float, float]

    def gain(self, az: np.ndarray, el: np.ndarray, frequency: np.ndarray) -> np.ndarray:
        across, along = self.width
        return np.exp(_exponent(az, el) @ (1.0 / np.square([across, along])))[None]

    def losses(self, az: np.ndarray, el: np.ndarray) -> list[Loss | Change] | None:
        return []

    def kinks(self) -> tuple[float, ...]:
        return ()

    def loudest(self, az: np.ndarray, el: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return self.gain(az, el, np.array(band))[0]

    def ceiling(self, away: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return np.exp(-2.0 * HALF_POWER * np.square(away / max(self.width)))


@dataclass(frozen=True)
class Horseshoe:
    """T20's beam: a Gaussian whose width follows from the frequency, 60 to 80 kHz."""

    def width(self, frequency: np.ndarray) -> np.ndarray:
        """Full -3 dB width in radians."""
        return np.deg2rad(np.polyval(HORSESHOE, np.asarray(frequency) / 1e3))

    def gain(self, az: np.ndarray, el: np.ndarray, frequency: np.ndarray) -> np.ndarray:
        away = _exponent(az, el).sum(axis=1)
        return np.exp(away / np.square(self.width(frequency))[:, None])

    def losses(self, az: np.ndarray, el: np.ndarray) -> list[Loss | Change] | None:
        return [Loss(lambda f: self.width(f) ** -2.0, -_exponent(az, el).sum(axis=1))]

    def kinks(self) -> tuple[float, ...]:
        return ()

    def loudest(self, az: np.ndarray, el: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return self.gain(az, el, np.array(band[:1]))[0]  # the width falls with the frequency

    def ceiling(self, away: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return np.exp(-2.0 * HALF_POWER * np.square(away / self.width(np.array(band[0]))))


@dataclass(frozen=True)
class MeasuredBeam:
    """A pattern about the axis.

    angle : (A,) radians off the axis, ascending from 0. frequency : (F,) Hz. level : (A, F) dB.

    Between angles dB are interpolated; beyond the last they stay. Over the frequency they follow a
    polynomial of at most the fourth degree, so that echoes stay smooth in frequency; beyond the first
    and last frequency they stay.
    """

    angle: np.ndarray
    frequency: np.ndarray
    level: np.ndarray

    @cached_property
    def _fit(self) -> np.ndarray:
        """(D, A) Chebyshev coefficients over the pattern's frequencies."""
        low, high = self.frequency[0], self.frequency[-1]
        known = 2.0 * (self.frequency - low) / (high - low) - 1.0
        return np.polynomial.chebyshev.chebfit(known, self.level.T, min(DEGREES, len(known) - 1))

    def levels(self, frequency: np.ndarray) -> np.ndarray:
        """(A, Q) dB at other frequencies."""
        if len(self.frequency) == 1:
            return np.repeat(self.level, len(frequency), axis=1)
        low, high = self.frequency[0], self.frequency[-1]
        wanted = 2.0 * (np.clip(frequency, low, high) - low) / (high - low) - 1.0
        return np.polynomial.chebyshev.chebval(wanted, self._fit)

    def gain(self, az: np.ndarray, el: np.ndarray, frequency: np.ndarray) -> np.ndarray:
        levels = (math.log(10.0) / 20.0) * self.levels(frequency).T  # (Q, A)
        if len(self.angle) == 1:
            return np.repeat(np.exp(levels), len(az), axis=1)
        first = self._segment(az, el)
        off = np.clip(np.hypot(az, el), self.angle[0], self.angle[-1])
        share = (off - self.angle[first]) / (self.angle[first + 1] - self.angle[first])
        at: np.ndarray = levels.take(first, axis=1)
        at += share * (levels.take(first + 1, axis=1) - at)
        return np.exp(at, out=at)

    def losses(self, az: np.ndarray, el: np.ndarray) -> list[Loss | Change] | None:
        """Between two angles, levels are as smooth over the frequency as at these."""
        if len(self.angle) == 1:
            return [Change(self._bounds, np.zeros(len(az), np.int64))]
        return [Change(self._bounds, self._segment(az, el))]

    def kinks(self) -> tuple[float, ...]:
        """The first and the last frequency, beyond which levels stay."""
        if len(self.frequency) == 1:
            return ()
        return float(self.frequency[0]), float(self.frequency[-1])

    def _segment(self, az: np.ndarray, el: np.ndarray) -> np.ndarray:
        """(M,) number of the table's angle before each."""
        before = np.searchsorted(self.angle, np.hypot(az, el), side="right") - 1
        found: np.ndarray = np.clip(before, 0, max(len(self.angle) - 2, 0))
        return found

    def _bounds(self, band: tuple[float, float], orders: int) -> np.ndarray:
        """(A - 1, N) no |c_n| of the gain between two angles is larger, re the gain at the lower end."""
        few = 2 * DEGREES
        at = band[0] + (band[1] - band[0]) * (1.0 + chebyshev.points(few)) / 2
        levels = (math.log(10.0) / 20.0) * self.levels(np.append(at, band[0])).T
        terms = np.abs(chebyshev.series(few) @ levels[:-1])  # (few, A)
        lift = chebyshev.series(few)[0] @ levels[:-1] - levels[-1]
        if len(self.angle) > 1:
            terms = np.maximum(terms[:, 1:], terms[:, :-1])
            lift = np.maximum(lift[1:], lift[:-1])
        largest = np.cos(np.arange(1, few) * np.arccos(chebyshev.points(orders))[:, None])
        values = np.exp(largest @ terms[1:] + lift)  # T_n in all of them, none against another
        bounds: np.ndarray = np.abs(chebyshev.series(orders) @ values).T
        return bounds

    def loudest(self, az: np.ndarray, el: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return self.ceiling(np.hypot(az, el), band)

    def ceiling(self, away: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        loudest = self.levels(np.linspace(*band, 65)).max(axis=1)
        beyond = np.maximum.accumulate(loudest[::-1])[::-1]
        before = np.searchsorted(self.angle, away, side="right") - 1
        return 10.0 ** (beyond[np.clip(before, 0, None)] / 20.0)


@dataclass(frozen=True)
class Omni:
    """The same in every direction."""

    def gain(self, az: np.ndarray, el: np.ndarray, frequency: np.ndarray) -> np.ndarray:
        return np.ones((1, len(az)))

    def losses(self, az: np.ndarray, el: np.ndarray) -> list[Loss | Change] | None:
        return []

    def kinks(self) -> tuple[float, ...]:
        return ()

    def loudest(self, az: np.ndarray, el: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return np.ones(len(az))

    def ceiling(self, away: np.ndarray, band: tuple[float, float]) -> np.ndarray:
        return np.ones(len(away))


def beam_offsets(directions: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation (L,) off the axis, radians; their hypotenuse is the angle off the axis.

    frame : (3, 3) of ``trajectory.frame_of``. Positive to the left and up. Straight behind, where the side is
    open, all of it is azimuth.
    """
    forward, left, up = frame @ directions.T
    side = np.hypot(left, up)
    angle = np.arctan2(side, forward)
    aside = side > 0
    share = np.where(aside, angle, 0.0) / np.where(aside, side, 1.0)
    return np.where(aside, share * left, angle), share * up


def _exponent(az: np.ndarray, el: np.ndarray) -> np.ndarray:
    """(M, 2) what a Gaussian's exponent is times the squared widths: -2·ln½-power·angle²."""
    offsets: np.ndarray = -2.0 * HALF_POWER * np.square(np.stack([az, el], axis=1))
    return offsets
