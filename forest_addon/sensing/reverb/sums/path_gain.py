"""A gain of frequency and path length as a short sum of products, for the fast sums.

``losses.Losses.gain``, g(f, x), goes in. In octaves of the path's length,

    g(f, x) ≈ Σ_q g(f, x_q)·ℓ_q(x),

with the polynomials ℓ_q in log x of as many Chebyshev points x_q as the tolerance needs at any frequency.
Near zones hold few trunks, and there the ground's and the straight way differ by many wavelengths: each has
a sum of its own, for pulses at its own times. Far ones, where nearly all trunks are, need a handful of terms.
Filters over a whole transform are interpolated in panels of frequency, as losses of the direct sum are.

The air as a filter that changes in time: what arrives after t has lost e^{-b(f)ct}.

Samples go in that have lost nothing yet, and those that have come out. They are cut into blocks of the
distance x = ct; within one, from x₀ - h to x₀ + h, the loss is a short series in closed form,

    e^{-b(x₀ + h·u)} = e^{-bx₀}·Σ_q ε_q·(-1)^q·I_q(bh)·T_q(u),   ε₀ = 1, else 2 (DLMF 10.35.3),

so that a block is a few products and transforms, its error relative to what is left there of each
frequency. A scattered sound of several arrivals from one trunk loses by the axis' path and not by each
arrival's own; filters of such sounds are made for it (``layer_sum``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy import fft, special

from ....acoustics import chebyshev
from ....acoustics.air import relaxation
from ....acoustics.spectrum import frequency_panels
from ....spec import Air
from ..bands import roll_off
from ..forest.losses import LOWEST, NEAR, Losses, loss_per_metre

WIDE = 12e3  # Hz; a gain that serves up to less tells the ways over the ground apart for less than NEAR
TRIED = 96  # frequencies at which a zone's nodes are counted
MOST = 1024
SHARE = 0.5  # of the tolerance
TURNED = 4.0  # turns of the ways over the ground against each other, at most, in a panel


@dataclass(frozen=True)
class Zone:
    """Path lengths from ``low`` to twice that, of one of the ways over the ground, or of all together.

    rise : of the way, by which its sound comes later than the path's; None: of all. nodes : (Q,) metres.
    """

    low: float
    rise: float | None
    nodes: np.ndarray

    def polynomials(self, length: np.ndarray) -> np.ndarray:
        """(M, Q) Chebyshev polynomials at lengths (M,)."""
        place = 2.0 * np.log2(length / self.low) - 1.0
        return chebyshev.polynomials(place, len(self.nodes)).T


@dataclass
class PathGain:
    """g up to the frequency ``highest``, to a relative tolerance.

    whole : with what air, leaves and branches take along the whole path.
    """

    losses: Losses
    highest: float
    tolerance: float
    whole: bool = False
    _zones: dict[tuple[float, float | None], Zone] = field(default_factory=dict)

    @property
    def near(self) -> float:
        """Metres up to which both ways over the ground are told apart: their phases differ by as much."""
        return NEAR * 2.0 ** round(min(0.0, math.log2(self.highest / WIDE)))

    def zones(self, length: np.ndarray) -> Iterator[tuple[Zone, np.ndarray]]:
        """Zones of lengths (M,) with their rows; near ones once for each way over the ground."""
        number = _number(length)
        for n in np.unique(number).tolist():
            rows = np.flatnonzero(number == n)
            ways: tuple[float | None, ...] = self.losses.rises if 2.0**n < self.near else (None,)
            for rise in ways:
                yield self._zone(2.0**n, rise), rows

    def filters(self, zone: Zone, frequency: np.ndarray) -> np.ndarray:
        """(Q, F) of a zone's polynomials, at frequencies."""
        values = self._values(frequency, zone.nodes[:, None], zone.rise)
        return np.asarray(chebyshev.coefficients(values, 0))

    def spectra(self, zone: Zone, spacing: float, first: int, last: int) -> np.ndarray:
        """(Q, F) the same at the bins ``first`` to ``last`` of an even grid; below LOWEST as there."""
        lowest = max(first, math.ceil(LOWEST / spacing))
        width = math.inf
        if zone.rise is None:  # both ways over the ground turn against each other
            turns = self.losses.detour(np.array(zone.low), self.losses.rises[-1])
            width = TURNED * self.losses.air.speed() / max(float(turns), 1e-9)
        parts = [
            self.filters(zone, panel.nodes) @ panel.weights.T
            for panel in frequency_panels(last, spacing, width, lowest)
        ]
        spectra = np.concatenate(parts, axis=1)
        return np.concatenate([np.repeat(spectra[:, :1], lowest - first, axis=1), spectra], axis=1)

    def at(self, frequency: np.ndarray, length: np.ndarray) -> np.ndarray:
        """(M, F) g of paths at a few frequencies."""
        gain = np.zeros((len(length), len(frequency)), np.complex128)
        wavenumber = 2.0 * math.pi * frequency / self.losses.air.speed()
        for zone, rows in self.zones(length):
            filters = self.filters(zone, frequency).astype(np.complex128)
            # real times complex, without making the polynomials complex
            part = (zone.polynomials(length[rows]) @ filters.view(np.float64)).view(np.complex128)
            if zone.rise:
                detour = self.losses.detour(length[rows], zone.rise)
                part *= np.exp(-np.outer(detour, self.losses.along(frequency) + 1j * wavenumber))
            if len(rows) == len(length):
                gain += part
            else:
                gain[rows] += part
        return gain

    def _zone(self, low: float, rise: float | None) -> Zone:
        if (low, rise) not in self._zones:
            self._zones[low, rise] = Zone(low, rise, self._nodes(low, rise))
        return self._zones[low, rise]

    def _values(self, frequency: np.ndarray, length: np.ndarray, rise: float | None) -> np.ndarray:
        """Gain by frequency and length; rise : as of a zone."""
        losses, path = self.losses, length
        if rise is None:
            gain = losses.of_ground(frequency, length)
        else:
            gain = losses.share(frequency, length, rise)
            path = length + losses.detour(length, rise)
        gain = gain * losses.of_trunks(frequency, length)
        return gain * np.exp(-losses.along(frequency) * path) if self.whole else gain

    def _nodes(self, low: float, rise: float | None) -> np.ndarray:
        """The fewest Chebyshev points in log x that serve at all frequencies."""
        frequency = np.geomspace(min(LOWEST, self.highest), self.highest, TRIED)
        count = 24
        while True:
            length = low * 2.0 ** chebyshev.points(count, 0.0, 1.0)
            values = self._values(frequency[None], length[:, None], rise)
            size = np.abs(chebyshev.coefficients(values[:, :, None], 0)[:, :, 0])
            allowed = SHARE * self.tolerance * np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
            needed = chebyshev.terms_needed(size, allowed)
            if needed <= 0.75 * count or count >= MOST:
                break
            count *= 2
        return low * 2.0 ** chebyshev.points(max(1, min(needed, count)), 0.0, 1.0)


def _number(length: np.ndarray) -> np.ndarray:
    """(M,) zone of each length: its octave."""
    return np.floor(np.log2(length)).astype(np.int64)


SHORTEST = 1536  # samples of a block at least
LONGEST_TAIL = 0.25  # s for which a filter of the air answers, at most
DECAYS = 16.0  # of the slowest relaxation, after which it has
ORDERS = 64  # of the series, at most
SEEN = 32  # every so many frequencies tell how many are needed
FADE = 256  # samples over which a block gives way to the next: a cut would sound at all frequencies
BLOCKS_AT_ONCE = 8


class AirFilter:
    """The air at one sampling rate, to a relative tolerance."""

    def __init__(self, rate: float, air: Air, tolerance: float) -> None:
        self.rate, self.air, self.tolerance = rate, air, tolerance
        self.step = air.speed() / rate  # metres a sample
        slowest = float(np.min(relaxation(air.temperature_c, air.humidity, air.pressure_kpa)))
        tail = min(LONGEST_TAIL, DECAYS / (2.0 * math.pi * slowest))
        self._tail = 64 + math.ceil(tail * rate)
        self._hop = max(SHORTEST, 3 * self._tail)
        self._block = self._hop + FADE
        self._size = fft.next_fast_len(self._block + 2 * self._tail, real=True)
        self._block = self._size - 2 * self._tail
        self._hop = self._block - FADE
        frequency = np.arange(self._size // 2 + 1) * (rate / self._size)
        self._loss = self.loss(frequency)
        half = 0.5 * self._block * self.step
        # e^{-bh} is left of the series: at the block's near end it was 1
        some = np.append(self._loss[::SEEN], self._loss[-1])
        size = 2.0 * special.ive(np.arange(ORDERS)[:, None], half * some).max(axis=1)
        terms = int(np.flatnonzero(size > 0.1 * tolerance)[-1]) + 1
        orders = np.arange(terms)[:, None]
        gains = special.ive(orders, half * self._loss) * np.exp(half * self._loss)
        gains *= np.where(orders % 2 == 0, 1.0, -1.0) * np.where(orders == 0, 1.0, 2.0)
        self._gains = gains  # (Q, F)
        place = (2.0 * np.arange(self._block) + 1.0) / self._block - 1.0
        fall = roll_off(0.45 + 0.05 * (np.arange(FADE) + 0.5) / FADE)
        window = np.concatenate([1.0 - fall, np.ones(self._block - 2 * FADE), fall])
        self._shapes = chebyshev.polynomials(place, terms) * window  # (Q, block)

    @property
    def tail(self) -> int:
        """Samples for which it answers, to both sides."""
        return self._tail

    def loss(self, frequency: np.ndarray) -> np.ndarray:
        """(F,) nepers of amplitude per metre, also at complex frequencies."""
        return loss_per_metre(frequency, self.air)

    def apply(self, samples: np.ndarray, first: int) -> np.ndarray:
        """(..., N) samples with the air's loss; samples[0] is heard ``first`` samples after the source.

        What is heard before the source sounds, the roll-off's ringing, is gained e^{-b(f)ct} > 1.
        """
        rows = samples.reshape(-1, samples.shape[-1])
        hop, tail, size = self._hop, self._tail, self._size
        count = -(-(rows.shape[1] + FADE) // hop)
        padded = np.pad(rows, ((0, 0), (FADE, count * hop - rows.shape[1])))
        total = np.zeros((len(rows), padded.shape[1] + 2 * tail))
        several = max(1, BLOCKS_AT_ONCE // len(rows))
        for start in range(0, count, several):
            numbers = range(start, min(start + several, count))
            cut = np.array([padded[:, hop * n : hop * n + self._block] for n in numbers])
            middle = first - FADE + np.array(numbers) * hop + 0.5 * self._block - 0.5
            spectrum = np.zeros((*cut.shape[:2], size // 2 + 1), np.complex128)
            shaped = np.zeros((*cut.shape[:2], size))  # once: new memory costs more than transforms
            for shape, gain in zip(self._shapes, self._gains, strict=True):
                np.multiply(cut, shape, out=shaped[..., : self._block])
                part = fft.rfft(shaped)
                part *= gain
                spectrum += part
            spectrum *= np.exp(-np.outer(middle * self.step, self._loss))[:, None]
            whole = fft.irfft(spectrum, size)
            for number, part in zip(numbers, whole, strict=True):
                here = total[:, number * hop : number * hop + size]
                here[:, :tail] += part[:, -tail:]
                here[:, tail:] += part[:, :-tail]
        return total[:, tail + FADE : tail + FADE + rows.shape[1]].reshape(samples.shape)
