"""A response held against the exact sum, part by part of what was returned.

Of a channel drawn at random: direct and ground sound by Fourier sums at single samples; the trunks' sound
from the first arrival on, by the direct sum over every trunk that is heard till then, as much of it as time
allows; later pieces by the trunks that sound in them; how many trunks were heard; the noise of a tail. Where
time is left, the fast sum is made again over random trunks, with the direct sum over the same. Errors of sums
are shares of the norm of the whole and of each octave from 20 Hz: the tolerance is given in that. A response
that is the direct sum itself is held against one that lets trunks ring longer: what it cuts off is its error.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from ...acoustics.air import absorption
from ..audit import LEAST, Audit, Check, joined, sample
from .forest.losses import loss_per_metre
from .forest.tail import FADE
from .pair import Gain, ImpulseResponse, Pair, filtered
from .sums.bands import SPREAD, roll_off
from .sums.fast_scattering import Expansions
from .sums.scattering import TrunkPaths, direct_sum, scattered_spectrum, trunk_paths

FEWEST, MOST = 20, 200  # trunks at a time
PACE = 2e-7  # s of a trunk at a frequency
LONGEST = 12_000  # samples of the part of the record that is compared
LOWEST = 20.0  # Hz
RINGING = 1.0  # s of frequencies beside a record's, all bands together
CUT_OFF = 1e-6  # of an octave, that a direct sum to no tolerance cuts off at most
QUIET = 1e-9  # of the whole: octaves below that are noise of float64
BINS, NEAR = 1024, 100  # frequencies of a Fourier sum; samples around an arrival
OF_ARRIVAL = 1e-5  # of the largest sample
LOSSY_MARGIN = 0.1  # s, among leaves and branches
PIECE, MARGIN = 256, 0.04  # samples of a later piece; s before it in which trunks still sound
OF_PIECE = 0.01  # of a piece's norm
PIECES = 8


@dataclass(frozen=True)
class _Channel:
    """A pair and what was found of it, with its paths."""

    pair: Pair
    found: ImpulseResponse
    paths: TrunkPaths

    @property
    def rate(self) -> float:
        return self.found.sample_rate

    @property
    def speed(self) -> float:
        return self.pair.air.speed()

    def summed(self, rows: np.ndarray, count: int) -> np.ndarray:
        """(count,) samples of some trunks by the direct sum."""
        fine = 0.1 * _allowed(self)
        total = np.zeros(count)
        for term, gain in self.pair.terms(self.pair.forest.select(rows)):
            some = self.paths.select(rows)
            some = replace(some, weight=some.weight * gain)
            samples = direct_sum(
                some, self.rate, count + SPREAD, self.pair.air, None, self.pair.losses, fine
            )
            total += filtered(samples, term, self.rate)[:count]
        return total


def audit_response(
    found: ImpulseResponse,
    pairs: Sequence[Pair],
    expansions: Expansions,
    rng: np.random.Generator,
    seconds: float,
    share: float,
) -> Audit:
    """Of a response that took ``seconds``, at a cost of about ``share`` of that.

    pairs : what was asked for (``response.pairs_of``). expansions : what the response was made with.
    """
    begin, budget = time.perf_counter(), share * seconds
    number = int(rng.integers(len(pairs)))
    pair, heard = pairs[number], found.microphones[number]
    reverb, upright = pair.reverb, pair.losses is not None
    ends = pair.source[:2], pair.receiver[:2]
    paths = trunk_paths(pair.forest, *ends, reverb.strength, reverb.spreading, None, upright)
    channel = _Channel(pair, heard, paths)
    tail = pair.tail(expansions)
    last = FADE * tail.joint if tail else math.inf
    kept, noise = np.ones(len(heard.trees)), np.zeros(len(heard.trees))
    if tail is not None:
        kept = tail.kept(np.arange(len(kept)) * (channel.speed / channel.rate))
        noise = pair.noise(tail, len(noise)) if heard.tail is None else heard.tail
    trees = heard.trees - noise
    early = _early(channel, trees, kept, last, budget / 4)
    pieces = _pieces(channel, trees, kept, last, rng, budget / 4)
    checks = [_counted(channel), *_arrivals(channel, rng), early, *pieces]
    if tail is not None:
        apart = np.abs(pair.noise(tail, len(noise)) - noise)
        errors = apart / max(float(np.abs(noise).max(initial=0.0)), 1e-300)
        checks.append(
            Check.on(
                "samples of the tail, drawn again", errors, len(errors), 1e-9, "of the largest"
            )
        )
    again = _sums_again(channel, expansions, rng, budget - (time.perf_counter() - begin))
    frequencies = (len(heard.samples) + RINGING * channel.rate) / 2
    whole = PACE * heard.trunks * frequencies * len(found.channels)
    return Audit(joined([*checks, again]), seconds, whole)


def _counted(channel: _Channel) -> Check:
    """Return whether every trunk was heard, or is said to be left out."""
    found, asked = channel.found, len(channel.paths.length)
    missing = float(abs(found.trunks + found.late + found.weak - asked))
    return Check(
        "trunks heard or said to be left out", asked, asked, missing, missing, 0.0, "trunks"
    )


def _arrivals(channel: _Channel, rng: np.random.Generator) -> Iterator[Check]:
    """Samples of the direct and of the ground's sound, around their arrival and elsewhere."""
    found, pair = channel.found, channel.pair
    parts = (
        ("direct", found.direct, found.direct_clear),
        ("ground", found.ground, found.ground_clear),
    )
    for (path, gain), (name, samples, passes), clear in zip(
        pair.arrivals(), parts, pair.clear, strict=True
    ):
        count = len(samples)
        middle = round(path / channel.speed * channel.rate)
        near = np.arange(max(middle - NEAR // 2, 0), min(middle + NEAR // 2, count))
        exact = _fourier(channel, path, gain, near) if clear else np.zeros(len(near))
        size = max(float(np.abs(exact).max(initial=0.0)), float(np.abs(samples).max(initial=0.0)))
        apart = np.abs(samples[near] - exact)
        elsewhere = rng.integers(0, max(count, 1), NEAR if count else 0)
        elsewhere = elsewhere[np.abs(elsewhere - middle) > 2 * SPREAD]
        rings = pair.losses is not None and pair.losses.among_leaves  # whose loss has no dispersion
        if not rings and (pair.reverb.ground_kind == "constant" or name == "direct"):
            apart = np.append(apart, np.abs(samples[elsewhere]))
        errors = apart / size if size > 0 else apart
        errors = np.append(errors, 0.0 if passes == clear else np.inf)
        what = f"samples of the {name} sound by Fourier sums"
        yield Check.on(what, errors, count, OF_ARRIVAL, "of the largest")


def _fourier(channel: _Channel, path: float, gain: Gain, at: np.ndarray) -> np.ndarray:
    """(R,) samples of an arrival: ∫ gain(f)/path·e^{-b·path}·e^{i2πf(t - path/c)}."""
    air = channel.pair.air
    frequency = (np.arange(BINS) + 0.5) * (0.5 * channel.rate / BINS)
    loss = absorption(frequency, air.temperature_c, air.humidity, air.pressure_kpa)
    spectrum = gain(frequency) / path * np.exp(-loss * path) * roll_off(frequency / channel.rate)
    late = at / channel.rate - path / channel.speed
    turns = np.exp(2j * math.pi * np.outer(late, frequency))
    summed: np.ndarray = (turns @ spectrum).real / BINS
    return summed


def _early(
    channel: _Channel, trees: np.ndarray, kept: np.ndarray, last: float, seconds: float
) -> Check | None:
    """The trunks' sound from the first arrival on, by the direct sum; None where the record has none."""
    paths, rate = channel.paths, channel.rate
    earliest = np.sort(paths.earliest)
    if not len(earliest):
        return None
    step = channel.speed / rate
    first = int(max(earliest[0] / step, 0.0))
    if first >= len(trees):  # only the spread of the band's end, which is nothing beside the rest
        return None
    longest = min(len(trees), first + LONGEST)
    counts = np.unique(np.geomspace(first + LEAST, max(longest, first + LEAST), 24).astype(int))
    trunks = np.searchsorted(earliest, (counts + SPREAD) * step)
    takes = PACE * trunks * (counts + RINGING * rate) / 2
    count = min(
        int(counts[max(int(np.searchsorted(takes, seconds, side="right")) - 1, 0)]), longest
    )
    rows = np.flatnonzero((paths.earliest <= (count + SPREAD) * step) & (paths.earliest <= last))
    apart = trees[:count] - channel.summed(rows, count) * kept[:count]
    lowest = LOWEST
    if count < len(trees):  # a smooth end, of which lower octaves would hear more than of the error
        fade = max(count // 2, 1)
        apart[-fade:] *= 0.5 + 0.5 * np.cos(math.pi * np.arange(fade) / fade)
        lowest = max(LOWEST, 8.0 * rate / fade)
    errors = _by_octave(apart, trees, rate, lowest)
    checked = max(count - first, 0)
    error, allowed = float(errors.max(initial=0.0)), _allowed(channel)
    what = f"samples of the trunks' sound, the first, by the direct sum over {len(rows):,} trunks"
    return Check(what, checked, len(trees), error, float(errors[0]), allowed, "of the octave")


def _pieces(
    channel: _Channel,
    trees: np.ndarray,
    kept: np.ndarray,
    last: float,
    rng: np.random.Generator,
    seconds: float,
) -> list[Check]:
    """Later pieces of the record, by the trunks that sound in them; none where it is short."""
    paths, step = channel.paths, channel.speed / channel.rate
    end = min(len(trees), int(min(last / FADE, float(paths.length.max(initial=0.0))) / step))
    losses = channel.pair.losses
    lossy = losses is not None and losses.among_leaves  # early trunks are louder than late pieces
    margin = math.ceil((LOSSY_MARGIN if lossy else MARGIN) * channel.rate)
    first = int(max(float(paths.earliest.min(initial=math.inf)), 0.0) / step) if end else 0
    if end - PIECE <= first + 2 * margin:
        return []
    whole = float(np.linalg.norm(trees))

    def batches() -> Iterator[np.ndarray]:
        while True:
            start = int(rng.integers(first + margin, end - PIECE))
            exact, trunks = _piece(channel, start, margin)
            piece = slice(start, start + PIECE)
            apart = float(np.linalg.norm(trees[piece] - exact * kept[piece]))
            size = max(
                float(np.linalg.norm(exact * kept[piece])), float(np.linalg.norm(trees[piece]))
            )
            off = max(apart - _allowed(channel) * whole, 0.0)
            yield np.full(PIECE, off / size if size > 0 and trunks > FEWEST else 0.0)

    found = sample(batches(), seconds, PIECE)
    what = "samples of later pieces by the trunks that sound in them"
    return [Check.on(what, found.errors, len(trees), OF_PIECE, "of the piece")]


def _piece(channel: _Channel, start: int, margin: int) -> tuple[np.ndarray, int]:
    """(PIECE,) samples from ``start`` on of the trunks that arrive then or a little before, and how many."""
    pair, paths, rate = channel.pair, channel.paths, channel.rate
    step = channel.speed / rate
    rows = np.flatnonzero(
        (paths.length > (start - margin) * step)
        & (paths.earliest <= (start + PIECE + SPREAD // 2) * step)
    )
    before = margin + SPREAD
    size = int(fft.next_fast_len(before + PIECE + SPREAD + 4 * margin, real=True))
    frequency = np.arange(size // 2 + 1) * (rate / size)
    moved = (start - before) * step
    loss = loss_per_metre(frequency, pair.air, pair.losses)
    losses = None if pair.losses is None or pair.losses.passes else pair.losses
    lost = np.exp(-loss * moved)

    def along(f: np.ndarray, length: np.ndarray) -> np.ndarray:
        rest = lost[np.rint(f * (size / rate)).astype(np.int64)]
        return rest if losses is None else rest * losses.gain(f, length + moved)

    samples = np.zeros(PIECE)
    for term, gain in pair.terms(pair.forest.select(rows)):
        some = paths.select(rows)
        some = replace(some, weight=some.weight * gain, length=some.length - moved)
        bark = losses.bark if losses else 0.0
        spectrum = scattered_spectrum(some, rate / size, loss, channel.speed, None, along, bark)
        spectrum *= roll_off(frequency / rate) * term.spectrum(frequency)
        samples += fft.irfft(spectrum, size)[before : before + PIECE]
    return samples, len(rows)


def _sums_again(
    channel: _Channel, expansions: Expansions, rng: np.random.Generator, seconds: float
) -> Check | None:
    """Random trunks by the sum that was used and by the direct one; None where there is no time for that."""
    found, pair, paths = channel.found, channel.pair, channel.paths
    rate, air, reverb = channel.rate, pair.air, pair.reverb
    count = min(len(found.samples), LONGEST)
    heard = np.flatnonzero(paths.earliest <= count / rate * air.speed())
    frequencies = (count + SPREAD + RINGING * rate) / 2
    drawn = int(np.clip(seconds / (PACE * frequencies), 0, MOST))
    if drawn < FEWEST or not len(heard):
        return None

    def direct(some: TrunkPaths, tolerance: float) -> np.ndarray:
        return direct_sum(some, rate, count + SPREAD, air, None, pair.losses, tolerance)

    def batches() -> Iterator[np.ndarray]:
        while True:
            some = paths.select(np.sort(rng.permutation(heard)[:drawn]))
            exact = direct(some, 0.0)
            if found.exact:
                again = direct(some, reverb.tolerance)
            else:
                given = some, rate, count + SPREAD, air, reverb.tolerance, pair.losses
                again = expansions.sum(*given).samples
            yield octave_errors(again, exact, rate)

    checked = sample(batches(), seconds / 2)
    what = f"octaves of {min(drawn, len(heard))} random trunks, summed again and directly"
    of = max(len(checked.errors), 1) * math.ceil(len(heard) / drawn)
    allowed = reverb.tolerance or CUT_OFF
    return Check.on(what, checked.errors, of, allowed, "of the octave")


def octave_errors(fast: np.ndarray, exact: np.ndarray, rate: float) -> np.ndarray:
    """(1 + B,) relative L2 errors of the whole and of octaves from 20 Hz that hold any sound."""
    return _by_octave(fast - exact, exact, rate)


def _by_octave(
    apart: np.ndarray, whole: np.ndarray, rate: float, lowest: float = LOWEST
) -> np.ndarray:
    """(1 + B,) norms of a difference, of all and of octaves, relative to those of a whole at least as
    long.
    """
    off, true = fft.rfft(apart, len(whole)), fft.rfft(whole)
    frequency = np.arange(len(true)) * rate / len(whole)
    size = float(np.linalg.norm(true))
    if size == 0:
        return np.array([float(np.linalg.norm(off))])
    errors = [float(np.linalg.norm(off)) / size]
    for octave in range(int(math.log2(max(0.45 * rate / lowest, 1)))):
        low = lowest * 2.0**octave
        rows = (frequency >= low) & (frequency < 2 * low)
        part = float(np.linalg.norm(true[rows]))
        if part > QUIET * size:
            errors.append(float(np.linalg.norm(off[rows])) / part)
    return np.array(errors)


def _allowed(channel: _Channel) -> float:
    """Return what was asked for, with what is known to be left out."""
    return (channel.pair.reverb.tolerance or CUT_OFF) + channel.found.weak_bound
