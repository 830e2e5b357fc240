"""Parts of a response that an audit looks at, and how each value is computed again.

Direct and ground sound are summed as Fourier sums at single samples; the trunks' sound, from the first
arrival on, by the direct sum over every trunk that is heard till then: the whole record where that is little
work, else its first part, and later pieces by the trunks that sound in them. Errors of sums are shares of the
norm of the whole, of each octave from 20 Hz and of each tenth of a record: the tolerance is given in that. A
response that is the direct sum itself is held against one that lets trunks ring longer: what it cuts off is
its error. Counts, delays, levels and places are computed again, the noise of a tail is drawn again, and so
are the channels of a receiver that tells directions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from scipy import fft

from ..audit import LEAST, AuditPart, figures
from .bands import SPREAD, OctaveBand, bands_of, roll_off
from .channels import ImpulseResponse
from .forest.losses import loss_per_metre
from .forest.tail import FADE, Tail
from .hearing import OMNI_EAR, Hearing, encoded
from .model_error import model_error
from .pair import Gain, Pair, filtered, trees_of
from .sums.fast_scattering import LOWEST, Expansions, arrivals_of, judged, octave_errors
from .sums.scattering import direct_sum, scattered_spectrum
from .sums.tree_response import NEAREST, left_out_db, part_until, summed_exactly

WORK = 2e6, 5e6  # trunks by frequencies that are summed again, of a pair at least and at most
FEWEST = 20  # trunks whose piece of a record says something
LONGEST = 24_000  # samples of the first part of a record
RINGING = 1.0  # s of frequencies beside a record's, all bands together
CUT_OFF = 1e-6  # of an octave, that a direct sum to no tolerance cuts off at most
QUIET = 1e-9  # of the whole: octaves below that are noise of float64
LOW = 40.0  # Hz, up to which octaves are summed in whole records
SMOOTH = 0.25  # s of a record, of which so low octaves can be told
OF_ARRIVAL = 1e-5  # of the largest sample
SILENT = 1e-9  # of it
LOSSY_MARGIN = 0.1  # s, among leaves and branches
PIECE, MARGIN = 0.1, 0.04  # s of a later piece; before it in which trunks still sound
OF_PIECE = 0.01  # of a piece's norm
DRIFT = 4  # degree of what is slower than LOWEST in a piece
PIECES = 8
OF_OCTAVE = "of the octave"  # and of the whole and its tenths: what a tolerance is given in


def parts_of_response(
    found: ImpulseResponse,
    pairs: Sequence[Pair],
    expansions: Expansions,
    share: float,
    hearing: Hearing = OMNI_EAR,
) -> list[AuditPart]:
    """Parts of a response; of pairs of source and receiver, ``share`` at least one.

    pairs, hearing : what was asked for (``response.pairs_of``). expansions : what the response was made with.
    """
    count, wide = len(pairs), len(hearing.names)
    parts = [figures({"channels": len(found.channels)}, {"channels": count * wide})]
    if len(found.channels) != count * wide:
        return parts
    chosen = np.unique(np.linspace(0, count - 1, max(1, int(share * count))).astype(int))
    for number in chosen.tolist():
        pair, heard = pairs[number], found.microphones[number]
        channel = Channel(pair, heard, pair.tail(expansions))
        right = channel.figures() | ({"channel": pair.channel} if hearing is OMNI_EAR else {})
        parts.append(figures(vars(heard), right))
        parts += [*_arrivals(channel), *_trunks(channel, share)]
        asked = pair.reverb.rescattering if number == 0 else 0
        if asked:
            again = model_error(pair.loud[0], pair.source, pair.receiver, asked, pair.air)
            parts.append(figures(vars(found.model_error), vars(again)))
        if hearing is not OMNI_EAR:
            ours = found.channels[number * wide : (number + 1) * wide]
            plain = replace(heard, channel=pair.channel)
            for one, other in zip(ours, encoded(pair, plain, hearing, expansions), strict=True):
                names = "direct", "ground", "trees", "tail", "component", "channel"
                parts.append(figures(vars(one), {name: getattr(other, name) for name in names}))
    return parts


@dataclass(frozen=True)
class Channel:
    """A pair and what was found of it, with the noise of its tail."""

    pair: Pair
    found: ImpulseResponse
    tail: Tail | None

    @property
    def rate(self) -> float:
        """Samples a second."""
        return self.found.sample_rate

    @property
    def speed(self) -> float:
        """Speed of sound, m/s."""
        return self.pair.air.speed()

    @property
    def allowed(self) -> float:
        """Error that was asked for, with what is known to be left out."""
        return (self.pair.reverb.tolerance or CUT_OFF) + self.weak["weak_bound"]

    @cached_property
    def weak(self) -> dict[str, Any]:
        """Number and bound of the trunks that are left out as too weak."""
        return self.pair.loud[1].told(self.found.samples, self.rate)

    @property
    def last(self) -> float:
        """Metres of path after which all is noise."""
        return FADE * self.tail.joint if self.tail else math.inf

    @cached_property
    def kept(self) -> np.ndarray:
        """(N,) share of the trunks' sound that a tail leaves."""
        metres = np.arange(len(self.found.trees)) * (self.speed / self.rate)
        return np.ones(len(metres)) if self.tail is None else self.tail.kept(metres)

    @cached_property
    def trees(self) -> np.ndarray:
        """(N,) the trunks' sound without noise."""
        noise = self.found.tail
        return self.found.trees if noise is None else self.found.trees - noise

    def summed(
        self, rows: np.ndarray, count: int, bands: tuple[OctaveBand, ...] = ()
    ) -> np.ndarray:
        """(count,) samples of some trunks by the direct sum, of all bands or of some."""
        total = np.zeros(count)
        for term, gain in self.pair.terms(self.pair.forest.select(rows)):
            some = self.pair.paths.select(rows)
            some = replace(some, weight=some.weight * gain)
            given = self.pair.air, None, self.pair.losses, 0.1 * self.allowed, bands
            samples = direct_sum(some, self.rate, count + SPREAD, *given)
            total += filtered(samples, term, self.rate)[:count]
        return total

    def figures(self) -> dict[str, object]:
        """Figures of the response besides its sums, computed again."""
        pair, result = self.pair, self.found
        forest, weak = pair.loud
        paths = pair.paths.select(~weak.rows)
        reverb, rate, count = pair.reverb, self.rate, len(result.trees)
        heard = paths.earliest <= (count + SPREAD) / rate * self.speed
        straight = max(math.dist(pair.source, pair.receiver), NEAREST)
        ours = int((~weak.rows[: len(pair.trunks)]).sum())
        part = part_until(self.last / self.speed, rate, count)
        within = paths.radius[heard & (paths.earliest <= self.last)]
        return self.weak | {
            "sample_rate": reverb.sample_rate,
            "direct_delay": math.dist(pair.source, pair.receiver) / self.speed,
            "direct_clear": pair.clear[0],
            "ground_clear": pair.clear[1],
            "trunks": int(heard.sum()),
            "stands": trees_of(forest.tree[heard]),
            "continued": int(heard[ours:].sum()),
            "late": int((~heard).sum()),
            "clamped": int(paths.clamped.sum()),
            "exact": summed_exactly(within, part, reverb.tolerance, pair.losses),
            "left_db": left_out_db(paths, heard, (straight,), rate, pair.air, pair.losses),
            "tail": None if self.tail is None else pair.noise(self.tail, count),
            "joint": self.tail.joint / self.speed if self.tail else math.inf,
            "tail_error": self.tail.spread if self.tail else None,
            "source": tuple(pair.source.tolist()),
            "receiver": tuple(pair.receiver.tolist()),
            "at": pair.at,
            "stand": pair.around.stand if pair.around else None,
        }


def _arrivals(channel: Channel) -> list[AuditPart]:
    """Samples of the direct and of the ground's sound."""
    parts = []
    sounds = zip(("direct", "ground"), channel.pair.arrivals(), channel.pair.clear, strict=True)
    for name, (path, gain), clear in sounds:
        samples = getattr(channel.found, name)
        exact = _arrival(channel, path, gain, len(samples)) if clear else 0.0 * samples
        size = float(np.abs(exact).max(initial=0.0)) or 1.0
        errors = np.abs(samples - exact) / size
        kind = f"samples of the {name} sound by its Fourier sum", OF_ARRIVAL, "of the largest"
        parts.append(AuditPart(len(errors), errors.__getitem__, (kind,)))
    return parts


def _arrival(channel: Channel, path: float, gain: Gain, count: int) -> np.ndarray:
    """(count,) samples of an arrival: ∫ gain(f)/path·e^{-b·path}·e^{i2πf(t - path/c)}, by frequencies half
    way between those of its record, so that what comes round is of the other sign."""
    rate = channel.rate
    late = path / channel.speed
    size = int(fft.next_fast_len(2 * (count + math.ceil((late + RINGING) * rate))))
    frequency = (np.arange(size // 2) + 0.5) * (rate / size)
    loss = loss_per_metre(frequency, channel.pair.air)
    spectrum = gain(frequency) / path * np.exp(-loss * path) * roll_off(frequency / rate)
    spectrum = spectrum * np.exp(-2j * math.pi * frequency * late)
    half = np.exp(1j * math.pi / size * np.arange(count))
    return 2.0 * (np.fft.ifft(spectrum, size)[:count] * half).real


def _trunks(channel: Channel, share: float) -> list[AuditPart]:
    """The first part of the trunks' sound by the direct sum; where that is not all, its low octaves and later
    pieces; and that only noise is left where a tail says so."""
    paths, rate, trees = channel.pair.paths, channel.rate, channel.trees
    step, count, silent = channel.speed / rate, len(trees), channel.kept == 0
    loudest = float(np.abs(channel.found.trees).max(initial=0.0)) or 1.0
    noise = np.abs(trees[silent]) / loudest
    kind = "samples where only noise is left", SILENT, "of the largest"
    parts = [AuditPart(len(noise), noise.__getitem__, (kind,))]
    earliest = np.sort(paths.earliest)
    first = int(max(earliest[0] / step, 0.0)) if len(earliest) else count
    if first >= count:  # only the spread of the band's end, which is nothing beside the rest
        return parts
    longest = max(min(count, first + LONGEST), first + 1)
    counts = np.unique(np.geomspace(min(first + LEAST, longest), longest, 24).astype(int))
    frequencies = (counts + RINGING * rate) / 2
    work = np.searchsorted(earliest, (counts + SPREAD) * step) * frequencies
    most = np.clip(share * len(earliest) * (count + RINGING * rate) / 2, *WORK)
    part = int(counts[max(int(np.searchsorted(work, most, side="right")) - 1, 0)])

    def summed(length: int, bands: tuple[OctaveBand, ...] = ()) -> np.ndarray:
        heard = (paths.earliest <= (length + SPREAD) * step) & (paths.earliest <= channel.last)
        return channel.summed(np.flatnonzero(heard), length, bands) * channel.kept[:length]

    def early(_number: np.ndarray) -> np.ndarray:
        exact = summed(part)
        if part == count:
            within = paths.select(paths.earliest <= channel.last)
            begins = arrivals_of(within, channel.pair.losses, channel.speed)
            tolerance = channel.pair.reverb.tolerance
            return np.array([max(judged(trees, exact, rate, tolerance, begins).values())])
        apart, fade = trees[:part] - exact, max(part // 2, 1)
        # a smooth end, of which lower octaves would hear more than of the error
        apart[-fade:] *= 0.5 + 0.5 * np.cos(math.pi * np.arange(fade) / fade)
        whole = float(np.linalg.norm(apart)) / (float(np.linalg.norm(trees)) or 1.0)
        errors = octave_errors(apart, trees, rate, QUIET, max(LOWEST, 8.0 * rate / fade))
        return np.array([max(whole, *errors.values())])

    def low(_number: np.ndarray) -> np.ndarray:
        fade = np.hanning(count) ** 2  # so smooth that nothing of higher sound is heard below
        below = OctaveBand(None, (2 * LOW, 4 * LOW), slow)
        apart = (trees - summed(count, (below,))) * fade
        errors = octave_errors(apart, trees, rate, QUIET, LOWEST, LOW)
        return np.array([max(errors.values(), default=0.0)])

    seconds = f"{part / rate:.2g} s of the trunks' sound by the direct sum"
    kind = seconds, channel.allowed, OF_OCTAVE
    parts.append(AuditPart(1, early, (kind,), exact=part == count))
    if part == count:
        return parts
    slow = bands_of(rate, float(paths.radius.max()), channel.speed, channel.allowed)[0].ringing
    bins = 4 * LOW * (count / rate + slow)
    if len(earliest) * bins <= most and count / rate >= SMOOTH:
        kind = f"octaves up to {LOW:g} Hz by the direct sum", channel.allowed, OF_OCTAVE
        parts.append(AuditPart(1, low, (kind,)))
    losses = channel.pair.losses
    lossy = losses is not None and losses.among_leaves  # early trunks are louder than late pieces
    margin = math.ceil((LOSSY_MARGIN if lossy else MARGIN) * rate)
    begin = first + margin
    end = min(count, int(min(channel.last / FADE, float(paths.length.max())) / step))
    size = min(math.ceil(PIECE * rate), end - begin)
    if size < LEAST:
        return parts
    starts = np.linspace(begin, end - size, math.ceil((end - begin) / size)).astype(int)

    def piece(number: np.ndarray) -> np.ndarray:
        return np.array([_of_piece(channel, start, margin, size) for start in starts[number]])

    trunks = len(earliest) * min((PIECE + 2 * MARGIN) * rate / count, 1.0)
    many = int(np.clip(most / max(trunks * size, 1.0), 2, PIECES))
    kind = f"pieces of {PIECE:g} s by the trunks that sound in them", OF_PIECE, "of the piece"
    last = np.array([len(starts) - 1])
    return [*parts, AuditPart(len(starts), piece, (kind,), many, last)]


def _of_piece(channel: Channel, start: int, margin: int, size: int) -> float:
    """Error of a piece, as a share of it, beyond what the tolerance of the record around it allows.

    Trunks before the margin still ring at a few hertz; where others thin out what comes late, they are far
    louder than the piece. So what drifts more slowly than LOWEST, a polynomial of the piece, is no error.
    """
    piece = slice(start, start + size)
    exact, trunks = _piece(channel, start, margin, size)
    exact = exact * channel.kept[piece]
    ours = channel.trees[piece]
    norm = max(float(np.linalg.norm(exact)), float(np.linalg.norm(ours)))
    if norm == 0 or trunks <= FEWEST:
        return 0.0
    tenth = len(channel.trees) // 10
    around = channel.trees[max(start - tenth, 0) : start + size + tenth]
    place, apart = np.linspace(-1.0, 1.0, size), ours - exact
    apart = apart - legendre.legval(place, legendre.legfit(place, apart, DRIFT))
    off = float(np.linalg.norm(apart)) - channel.allowed * float(np.linalg.norm(around))
    return max(off, 0.0) / norm


def _piece(channel: Channel, start: int, margin: int, length: int) -> tuple[np.ndarray, int]:
    """(length,) samples from ``start`` on of the trunks that arrive then or a little before, and how many."""
    pair, paths, rate = channel.pair, channel.pair.paths, channel.rate
    step = channel.speed / rate
    rows = np.flatnonzero(
        (paths.length > (start - margin) * step)
        & (paths.earliest <= (start + length + SPREAD // 2) * step)
    )
    before = margin + SPREAD
    size = int(fft.next_fast_len(before + length + SPREAD + 4 * margin, real=True))
    frequency = np.arange(size // 2 + 1) * (rate / size)
    moved = (start - before) * step
    loss = loss_per_metre(frequency, pair.air, pair.losses)
    losses = None if pair.losses is None or pair.losses.passes else pair.losses
    lost = np.exp(-loss * moved)

    def along(f: np.ndarray, length: np.ndarray) -> np.ndarray:
        rest = lost[np.rint(f * (size / rate)).astype(np.int64)]
        return rest if losses is None else rest * losses.gain(f, length + moved)

    samples = np.zeros(length)
    for term, gain in pair.terms(pair.forest.select(rows)):
        some = paths.select(rows)
        some = replace(some, weight=some.weight * gain, length=some.length - moved)
        bark = losses.bark if losses else 0.0
        spectrum = scattered_spectrum(some, rate / size, loss, channel.speed, None, along, bark)
        spectrum *= roll_off(frequency / rate) * term.spectrum(frequency)
        samples += fft.irfft(spectrum, size)[before : before + length]
    return samples, len(rows)
