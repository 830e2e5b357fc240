"""The air as a filter that changes in time: what arrives after t has lost e^{-b(f)ct}.

Samples go in that have lost nothing yet, and those that have come out. They are cut into blocks of the
distance x = ct; within one, from x₀ - h to x₀ + h, the loss is a short series in closed form,

    e^{-b(x₀ + h·u)} = e^{-bx₀}·Σ_q ε_q·(-1)^q·I_q(bh)·T_q(u),   ε₀ = 1, else 2 (DLMF 10.35.3),

so that a block is a few products and transforms, its error relative to what is left there of each
frequency. A scattered sound of several arrivals from one trunk loses by the axis' path and not by each
arrival's own; ``undone`` changes the filters of such sounds accordingly.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import fft, special

from ....acoustics.air import absorption, relaxation
from ....spec import Air
from .bands import roll_off
from .field_table import polynomials

SHORTEST = 1536  # samples of a block at least
LONGEST_TAIL = 0.25  # s for which a filter of the air answers, at most
DECAYS = 16.0  # of the slowest relaxation, after which it has
ORDERS = 64  # of the series, at most
SEEN = 32  # every so many frequencies tell how many are needed
FADE = 256  # samples over which a block gives way to the next: a cut would sound at all frequencies
BLOCKS_AT_ONCE = 16
ROUNDS = 1


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
        self._loss = self._loss_at(frequency)
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
        self._shapes = polynomials(place, terms) * window  # (Q, block)
        self._lifts: dict[int, tuple[int, np.ndarray, np.ndarray, np.ndarray]] = {}

    @property
    def tail(self) -> int:
        """Samples for which it answers, to both sides."""
        return self._tail

    def apply(self, samples: np.ndarray, first: int) -> np.ndarray:
        """(..., N) samples with the air's loss; samples[0] is heard ``first`` samples after the source.

        What is heard before the source sounds, the roll-off's ringing, is gained e^{-b(f)ct} > 1.
        """
        rows = samples.reshape(-1, samples.shape[-1])
        hop, tail, size = self._hop, self._tail, self._size
        count = -(-(rows.shape[1] + FADE) // hop)
        padded = np.zeros((len(rows), (count - 1) * hop + self._block))
        padded[:, FADE : FADE + rows.shape[1]] = rows
        total = np.zeros((len(rows), padded.shape[1] + 2 * tail))
        several = max(1, BLOCKS_AT_ONCE // len(rows))
        for start in range(0, count, several):
            numbers = range(start, min(start + several, count))
            cut = np.array([padded[:, hop * n : hop * n + self._block] for n in numbers])
            middle = first - FADE + np.array(numbers) * hop + 0.5 * self._block - 0.5
            spectrum = np.zeros((*cut.shape[:2], size // 2 + 1), np.complex128)
            for shape, gain in zip(self._shapes, self._gains, strict=True):
                part = fft.rfft(cut * shape, size)
                part *= gain
                spectrum += part
            spectrum *= np.exp(-np.outer(middle * self.step, self._loss))[:, None]
            whole = fft.irfft(spectrum, size)
            for number, part in zip(numbers, whole, strict=True):
                here = total[:, number * hop : number * hop + size]
                here[:, :tail] += part[:, -tail:]
                here[:, tail:] += part[:, :-tail]
        kept = total[:, tail + FADE : tail + FADE + rows.shape[1]]
        return kept.reshape(samples.shape)

    def undone(self, filters: np.ndarray, lead: int) -> np.ndarray:
        """Filters (R, T) that become the given ones when the air is applied from -lead on.

        ∫ U(f)·e^{+b(f)ct}·e^{iωt} df is nearly so; it is refined by what is still missing.
        """
        changed = self._lifted(filters, lead)
        for _ in range(ROUNDS):
            changed += self._lifted(filters - self.apply(changed, -lead), lead)
        return changed

    def _lifted(self, filters: np.ndarray, lead: int) -> np.ndarray:
        """(R, T) e^{+b(f)ct} times the filters, by the time of what comes out."""
        count = filters.shape[1]
        size, loss, gains, place = self._lift_of(count)
        spectra = fft.rfft(filters, size)
        hop = place.shape[1]
        lifted = np.empty_like(filters)
        for start in range(0, count, hop):
            here = slice(start, min(start + hop, count))
            middle = (start + 0.5 * hop - 0.5 - lead) * self.step
            turned = spectra * np.exp(middle * loss)
            lifted[:, here] = sum(
                fft.irfft(turned * gain, size)[:, here] * shape[: here.stop - start]
                for gain, shape in zip(gains, place, strict=True)
            )
        return lifted

    def _lift_of(self, count: int) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        """For T samples: transform, loss (F,), and the series' gains (Q, F) and shapes (Q, hop)."""
        if count not in self._lifts:
            size = fft.next_fast_len(count + 2 * self._tail, real=True)
            loss = self._loss_at(np.arange(size // 2 + 1) * (self.rate / size))
            hop = min(self._hop, count)
            half = 0.5 * hop * self.step
            orders = np.arange(len(self._shapes))[:, None]
            scaled = special.ive(orders, half * loss) * np.where(orders == 0, 1.0, 2.0)
            terms = int(np.flatnonzero(scaled.max(axis=1) > 0.1 * self.tolerance)[-1]) + 1
            place = polynomials((2.0 * np.arange(hop) + 1.0) / hop - 1.0, terms)
            self._lifts[count] = size, loss, scaled[:terms] * np.exp(half * loss), place
        return self._lifts[count]

    def _loss_at(self, frequency: np.ndarray) -> np.ndarray:
        """Nepers per metre."""
        air = self.air
        return absorption(frequency, air.temperature_c, air.humidity, air.pressure_kpa)
