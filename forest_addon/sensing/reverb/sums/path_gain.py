"""A gain of frequency and path length as a short sum of products, for the fast sums.

``losses.Losses.gain``, g(f, x), goes in. In octaves of the path's length,

    g(f, x) ≈ Σ_q g(f, x_q)·ℓ_q(x),

with the polynomials ℓ_q in log x of as many Chebyshev points x_q as the tolerance needs at any frequency.
Near zones hold few trunks, and there the ground's and the straight way differ by many wavelengths: each has
a sum of its own, for pulses at its own times. Far ones, where nearly all trunks are, need a handful of terms.
Filters over a whole transform are read from a spline in frequency, with as many knots as the tolerance needs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ....acoustics import chebyshev
from ....base.rows import distinct
from ..forest.losses import LOWEST, NEAR, Losses
from .field_table import polynomials, series

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

WIDE = 12e3  # Hz; a gain that serves up to less tells the ways over the ground apart for less than NEAR
TRIED = 96  # frequencies at which a zone's nodes are counted
MOST = 1024
SHARE = 0.5  # of the tolerance
BEND = 40.0  # Hz, from where on knots are spaced evenly by the logarithm of frequency
KNOTS, MOST_KNOTS = 128, 1024  # in frequency, at first and at most
BETWEEN = 0.3  # of the tolerance, by which a spline through half of its knots may miss the others

Values = Callable[[np.ndarray, np.ndarray], np.ndarray]  # of frequency and length


@dataclass(frozen=True)
class Zone:
    """Path lengths from ``low`` to ``high``, of one of the ways over the ground.

    nodes : (Q,) metres. rise : of the way, by which its sound comes later than the path's; 0: not at all.
    values : what its gain is by frequency and length.
    """

    low: float
    high: float
    nodes: np.ndarray
    rise: float
    values: Values

    def lagrange(self, length: np.ndarray) -> np.ndarray:
        """(M, Q) polynomials at lengths (M,), each 1 at its node."""
        return chebyshev.lagrange(len(self.nodes), self._place(length)).T

    def polynomials(self, length: np.ndarray) -> np.ndarray:
        """(M, Q) Chebyshev polynomials at lengths (M,)."""
        return polynomials(self._place(length), len(self.nodes)).T

    def _place(self, length: np.ndarray) -> np.ndarray:
        place: np.ndarray = 2.0 * np.log(length / self.low) / math.log(self.high / self.low) - 1.0
        return place


@dataclass
class PathGain:
    """g up to the frequency ``highest``, to a relative tolerance.

    whole : with what air, leaves and branches take along the whole path.
    """

    losses: Losses
    highest: float
    tolerance: float
    whole: bool = False
    _zones: dict[tuple[int, float], Zone] = field(default_factory=dict)
    _splines: dict[tuple[float, float], CubicSpline | None] = field(default_factory=dict)

    @property
    def near(self) -> float:
        """Metres up to which both ways over the ground are told apart: their phases differ by as much."""
        return NEAR * 2.0 ** round(min(0.0, math.log2(self.highest / WIDE)))

    def zones(self, length: np.ndarray) -> Iterator[tuple[Zone, np.ndarray]]:
        """Zones of lengths (M,) with their rows; near ones once for each way over the ground."""
        number = _number(length)
        for n in distinct(number).tolist():
            rows = np.flatnonzero(number == n)
            for rise in self.losses.rises if 2.0**n < self.near else (0.0,):
                yield self._zone(n, rise), rows

    def filters(self, zone: Zone, frequency: np.ndarray) -> np.ndarray:
        """(Q, F) of a zone's polynomials, at rising frequencies."""
        key = zone.low, zone.rise
        if key not in self._splines and len(frequency) > 4 * KNOTS:
            self._splines[key] = self._spline(zone)
        spline = self._splines.get(key)
        if spline is not None:
            inside = np.clip(frequency, LOWEST, self.highest)
            return np.asarray(spline(np.log1p(inside / BEND)))
        values = zone.values(frequency, zone.nodes[:, None])
        return np.asarray(chebyshev.series(len(zone.nodes)) @ values)

    def _spline(self, zone: Zone) -> CubicSpline | None:
        """The filters by log(1 + f/BEND); None: no number of knots serves."""
        from scipy.interpolate import CubicSpline  # other sensors need not wait for its import

        low, high = (math.log1p(f / BEND) for f in (min(LOWEST, self.highest), self.highest))

        def values_at(place: np.ndarray) -> np.ndarray:
            return np.asarray(zone.values(BEND * np.expm1(place), zone.nodes[:, None]))

        place = np.linspace(low, high, KNOTS + 1)
        values = values_at(place)
        while len(place) <= 2 * MOST_KNOTS + 1:
            between = 0.5 * (place[1:] + place[:-1])
            new = values_at(between)
            gap = np.abs(CubicSpline(place, values, axis=1)(between) - new).max(axis=0)
            size = np.sqrt(np.mean(np.abs(new) ** 2, axis=0))
            place = np.linspace(low, high, 2 * len(place) - 1)
            values = np.insert(new, range(new.shape[1] + 1), values, axis=1)
            if (gap <= BETWEEN * self.tolerance * size).all():
                into = chebyshev.series(len(zone.nodes))
                return CubicSpline(place, into @ values, axis=1)
        return None

    def at(self, frequency: np.ndarray, length: np.ndarray) -> np.ndarray:
        """(M, F) g of paths at a few frequencies."""
        found = np.zeros((len(length), len(frequency)), np.complex128)
        wavenumber = 2.0 * math.pi * frequency / self.losses.air.speed()
        for zone, rows in self.zones(length):
            values = zone.values(frequency[None], zone.nodes[:, None]).astype(np.complex128)
            # real times complex, without making the polynomials complex
            part = (zone.lagrange(length[rows]) @ values.view(np.float64)).view(np.complex128)
            if zone.high <= self.near and zone.rise > 0:
                detour = self.losses.detour(length[rows], zone.rise)
                part *= np.exp(-np.outer(detour, self.losses.along(frequency) + 1j * wavenumber))
            if len(rows) == len(length):
                found += part
            else:
                found[rows] += part
        return found

    def _zone(self, number: int, rise: float) -> Zone:
        if (number, rise) not in self._zones:
            near = 2.0**number < self.near
            low, ratio = 2.0**number, 2.0
            values: Values = partial(self._near, rise=rise) if near else self._far
            nodes = self._nodes(low, ratio, values)
            self._zones[number, rise] = Zone(low, low * ratio, nodes, rise, values)
        return self._zones[number, rise]

    def _near(self, frequency: np.ndarray, length: np.ndarray, rise: float) -> np.ndarray:
        found = self.losses.near_share(frequency, length, rise)
        if not self.whole:
            return found
        path = length + self.losses.detour(length, rise)
        return np.asarray(found * np.exp(-self.losses.along(frequency) * path))

    def _far(self, frequency: np.ndarray, length: np.ndarray) -> np.ndarray:
        found = self.losses.gain(frequency, length)
        if not self.whole:
            return found
        return np.asarray(found * np.exp(-self.losses.along(frequency) * length))

    def _nodes(self, low: float, ratio: float, of: Values) -> np.ndarray:
        """As few Chebyshev points in log x as serve at all frequencies."""
        frequency = np.geomspace(min(LOWEST, self.highest), self.highest, TRIED)
        count = 24
        while True:
            length = low * ratio ** (0.5 * (chebyshev.points(count) + 1.0))
            values = of(frequency[None], length[:, None])
            size = np.abs(series(values[:, :, None], 0)[:, :, 0])
            tail = np.cumsum(size[::-1], axis=0)[::-1]
            allowed = SHARE * self.tolerance * np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
            large = np.flatnonzero((tail > allowed).any(axis=1))
            needed = int(large[-1]) + 2 if len(large) else 1
            if needed <= 0.75 * count or count >= MOST:
                break
            count *= 2
        count = max(1, min(needed, count))
        found: np.ndarray = low * ratio ** (0.5 * (chebyshev.points(count) + 1.0))
        return found


def _number(length: np.ndarray) -> np.ndarray:
    """(M,) zone of each length: its octave."""
    number: np.ndarray = np.floor(np.log2(length)).astype(np.int64)
    return number
