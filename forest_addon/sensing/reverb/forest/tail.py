"""Sound scattered more than once, as noise: random as the stand is, with the energy of transport.

Energies by octave (``transport``), and what paths lose (``losses``), go in; samples come out. The noise is
made in short blocks, each of random phases, with the energy a metre of path

    N(f, x) = [once + again - w²(x)·heard](f, x) · |g(f, x)|² · e^{-2b(f)x}

in between octaves by logarithms: ``heard`` is what the sum over trunks has of sound scattered once, w its
fade-out. So the energy is that of transport at every time, and nothing jumps at the joint: from ``joint`` on,
where in every octave more than a stated share of the energy is scattered more than once, or what is not is
faint, w falls to 0 and all is noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import fft

from ....acoustics.ground import surface_impedance
from ....base.kept import LastAsked
from ....base.rng import stream
from ....spec import Air, Reverb
from ..bands import roll_off
from ..metrics import octave_bands
from .clutter import scatter_of
from .layer import Layer, diffused
from .losses import Losses
from .transport import SHARES, Density, Energy, PhaseFunction, Sent, transported_bands

BLOCK = 0.0107  # s, of noise with one spectrum
PACKETS = 2000  # of energy, of each octave
BINS = 40  # of path length, evenly by its logarithm
FADE = 1.25  # ratio of path lengths over which the sum over trunks fades out
FOLLOWED = 20.0  # mean free paths over which packets are followed
LEAST = 1e-30
FAINT = (
    1e-4  # of an octave's energy, below which what noise replaces does not count: T30 ends above
)
APART = 0.01  # of a length, by which blocks lie apart whose spectra are computed; between, by logarithms
TREND = 4  # bins over which the end of what branches turned is followed
NO_TRUNK = PhaseFunction(0.0, 1.0, np.zeros(1440), np.full(1440, 0.5 / math.pi))


@dataclass(frozen=True)
class NoiseBlocks:
    """Blocks of noise by their energies a bin, (X, F): level, and from all sides (None: none).

    starts : (X,) first samples. size : samples of a block. count : of the whole. silent : samples before it.
    """

    level: np.ndarray
    space: np.ndarray | None
    starts: np.ndarray
    size: int
    count: int
    silent: int

    def samples(
        self, rng: np.random.Generator, level: float = 1.0, space: float = 1.0
    ) -> np.ndarray:
        """(count,) drawn, with shares of the energy that arrives level and from all sides."""
        size, starts, hop = self.size, self.starts, self.size // 2
        energy = level * self.level
        if self.space is not None:
            energy = energy + space * self.space
        noise = fft.rfft(rng.standard_normal((len(starts), size)), axis=1) * np.sqrt(energy)
        blocks = fft.irfft(noise, size, axis=1) * np.sin(math.pi * (np.arange(size) + 0.5) / size)
        total = np.zeros((len(starts) + 1) * hop)
        total[:-hop].reshape(-1, hop)[:] += blocks[:, :hop]
        total[hop:].reshape(-1, hop)[:] += blocks[:, hop:]
        whole = np.zeros(self.count)
        skipped = max(0, -int(starts[0]))
        place = max(0, int(starts[0]))
        part = total[skipped : skipped + self.count - place]
        whole[place : place + len(part)] = part
        whole[: self.silent] = 0.0
        return whole


@dataclass(frozen=True)
class Tail:
    """Noise of a pair.

    band : (B,) Hz. energy : of each. lift : (B,) per metre, by which the sum over trunks keeps more of the
    sound scattered once than transport does. joint : metres of path from which all is noise.
    diffuse : (B, X) energy a metre between the edges of ``energy`` that branches or leaves turned, without
    the air; None: nothing does.
    spread : (B,) dB, standard error of the level of noise from the joint on, by shares of the packets;
    NaN where nothing is heard.
    """

    band: np.ndarray
    energy: tuple[Energy, ...]
    lift: np.ndarray
    joint: float
    losses: Losses
    diffuse: np.ndarray | None = None
    spread: np.ndarray = field(default_factory=lambda: np.empty(0))
    _blocks: LastAsked[tuple, NoiseBlocks] = field(
        default_factory=lambda: LastAsked(1), init=False, compare=False, repr=False
    )

    def kept(self, length: np.ndarray) -> np.ndarray:
        """w, of the sum over trunks at path lengths."""
        if math.isinf(self.joint):
            return np.ones(np.shape(length))
        place = np.log(np.maximum(length, LEAST) / self.joint) / math.log(FADE)
        return np.cos(0.5 * math.pi * np.clip(place, 0.0, 1.0))

    def energies(self, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(B, X) scattered once, and more than once, a metre, without losses along the path."""
        parts = [each.at(length) for each in self.energy]
        return np.array([once for once, _ in parts]), np.array([again for _, again in parts])

    def heard(self, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(B, X) a metre that arrives, scattered once by trunks, and more than once or by branches."""
        once, again = self.energies(length)
        kept, left = self.left(length)
        return once * kept, again * kept + self.turned(length) * left

    def left(self, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(B, X) shares of the energy that are left of level sound, and of what branches or leaves turned."""
        kept = np.exp(-2.0 * np.outer(self.losses.along(self.band), length))
        kept = kept * self.losses.unthinned.mean_square(self.band[:, None], length)
        return kept, np.exp(-2.0 * np.outer(self.losses.of_air(self.band), length))

    def samples(self, rate: float, count: int, air: Air, rng: np.random.Generator) -> np.ndarray:
        """(count,) noise at ``rate`` Hz, sample 0 when the source sounds."""
        return self.blocks(rate, count, air).samples(rng)

    def blocks(self, rate: float, count: int, air: Air) -> NoiseBlocks:
        """The same, not yet drawn; the last are kept."""
        key = rate, count, air
        return self._blocks.once(key, lambda: self._made(rate, count, air))

    def _made(self, rate: float, count: int, air: Air) -> NoiseBlocks:
        size = 2 * max(16, 2 ** round(math.log2(BLOCK * rate / 2)))
        hop, step = size // 2, air.speed() / rate
        first = max(0, int(self.energy[0].edges[0] / step) // hop - 1)
        starts = np.arange(first, -(-count // hop) + 1) * hop - hop
        length = np.maximum((starts + 0.5 * size) * step, self.energy[0].edges[0] * 1.001)
        frequency = np.arange(size // 2 + 1) * (rate / size)
        level, space = self._spread(frequency, length)
        silent = math.ceil(self.energy[0].edges[0] / step)
        shape = step * np.square(roll_off(frequency / rate))
        return NoiseBlocks(
            level * shape, None if space is None else space * shape, starts, size, count, silent
        )

    def _spread(
        self, frequency: np.ndarray, length: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """(X, F) spectra at rising lengths, from those that lie APART from each other."""
        place = np.floor(np.log(length / length[0]) / APART)
        rows = np.flatnonzero(np.diff(place, prepend=-1.0) > 0)
        few = np.union1d(rows, [0, len(length) - 1])  # at least two
        level, space = self._spectra(frequency, length[few])
        low = (
            np.minimum(np.searchsorted(few, np.arange(len(length)), side="right"), len(few) - 1) - 1
        )
        start, end = np.log(length[few[low]]), np.log(length[few[low + 1]])
        share = ((np.log(length) - start) / (end - start))[:, None]

        def between(values: np.ndarray) -> np.ndarray:
            by_log = np.log(np.maximum(values, LEAST**2))
            return np.asarray(np.exp((1.0 - share) * by_log[low] + share * by_log[low + 1]))

        return between(level), None if space is None else between(space)

    def _spectra(
        self, frequency: np.ndarray, length: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """(X, F) N, of what arrives level, and of what branches or leaves turned; None where nothing does."""
        once, again = self.energies(length)
        heard = np.square(self.kept(length)) * once * np.exp(self.lift[:, None] * length)
        wanted = np.log(np.maximum(once + again - heard, LEAST))
        place = np.interp(
            np.log(np.maximum(frequency, 1.0)), np.log(self.band), np.arange(len(self.band))
        )
        low = np.minimum(place.astype(np.int64), len(self.band) - 2)
        share = (place - low)[:, None]
        energy = np.exp((1.0 - share) * wanted[low] + share * wanted[low + 1]).T  # (X, F)
        slope = np.minimum(frequency / self.band[0], 1.0) ** 3  # as Rayleigh's law, below the bands
        lost = np.exp(-2.0 * np.outer(length, self.losses.along(frequency)))
        mean_square = (
            energy * slope * lost * self.losses.unthinned.mean_square(frequency, length[:, None])
        )
        if self.diffuse is None:
            return np.asarray(mean_square), None
        turned = np.log(np.maximum(self.turned(length), LEAST))
        energy = np.exp((1.0 - share) * turned[low] + share * turned[low + 1]).T
        lost = np.exp(-2.0 * np.outer(length, self.losses.of_air(frequency)))
        return np.asarray(mean_square), energy * slope * lost

    def turned(self, length: np.ndarray) -> np.ndarray:
        """(B, X) a metre that branches or leaves turned; beyond the last bin as it fell."""
        turned = np.zeros((len(self.band), len(length)))
        middle, first = self.energy[0].middle, self.energy[0].edges[0]
        diffuse = np.zeros((0, 0)) if self.diffuse is None else self.diffuse
        for row, energy in enumerate(diffuse):
            heard = np.flatnonzero(energy > 0)
            if len(heard) < 2:
                continue
            last, before = heard[-1], heard[max(0, len(heard) - 1 - TREND)]
            fall = math.log(energy[last] / energy[before]) / (middle[last] - middle[before])
            logarithm = np.interp(length, middle[heard], np.log(energy[heard]))
            logarithm += min(0.0, fall) * np.maximum(length - middle[last], 0.0)
            turned[row] = np.where(length >= first, np.exp(logarithm), 0.0)
        return turned


def tail_of(
    reverb: Reverb,
    losses: Losses,
    density: Density,
    source: np.ndarray,
    receiver: np.ndarray,
    duration: float,
    key: tuple[int | str, ...],
    packets: int = PACKETS,
    sent: Callable[[float], Sent] | None = None,
) -> Tail | None:
    """The noise between a source and a receiver, (3,) metres; None where no trunks are.

    key : of the random stream. sent : by frequency, energy that the source sends by ways; None: alike.
    """
    radii = np.array(losses.stand.radii)
    speed = losses.air.speed()
    apart = max(float(np.hypot(*(receiver - source)[:2])), 0.1)
    last = duration * speed * 1.05
    clutter = losses.stand.clutter
    bare = len(radii) == 0 or density.largest == 0
    if (bare and clutter.empty) or last <= apart * 1.01:
        return None
    bands = np.array(octave_bands(reverb.sample_rate))
    edges = np.geomspace(apart * 1.0001, last, BINS + 1)
    way = "coherent" if reverb.extinction == "coherent" else "energy"
    ways = [sent(band) for band in bands.tolist()] if sent else ()
    if bare:
        phases = [NO_TRUNK] * len(bands)
        energies = [Energy(edges, np.zeros(BINS), np.zeros(BINS)) for _ in bands]
    else:
        phases = [PhaseFunction.of(band, radii, speed, losses.bark, way) for band in bands.tolist()]
        near = [_followed(phase, density, edges) for phase in phases]
        rng = stream(int(key[0]), *key[1:], "transport")
        given = density, (source[:2], receiver[:2]), edges, near, packets, rng, ways
        energies = [
            _diffused(start, phase, density, edges)
            for start, phase in zip(transported_bands(phases, *given), phases, strict=True)
        ]
    lift = replace(losses, extinction=way).removed(bands) - losses.removed(bands)
    turned, in_space = None, np.zeros(1)
    if not clutter.empty:
        layer = _layer(reverb, losses, 0.0 if bare else density.mean, tuple(phases), bands)
        rng = stream(int(key[0]), *key[1:], "branches")
        in_space = diffused(layer, source, receiver, edges, packets, rng, ways)
        turned = in_space.mean(axis=0)
    tail = Tail(bands, tuple(energies), lift, math.inf, losses, turned)
    tail = replace(tail, joint=_joint(tail, reverb.multiple_share, apart))
    return replace(tail, spread=_spread(tail, in_space))


def _layer(
    reverb: Reverb,
    losses: Losses,
    trunks: float,
    phases: tuple[PhaseFunction, ...],
    bands: np.ndarray,
) -> Layer:
    """The stand as sound in space meets it, in each octave."""
    clutter, speed = losses.stand.clutter, losses.air.speed()
    impedance = np.full(len(bands), np.inf, np.complex128)
    if losses.resistivity:
        impedance = surface_impedance(bands, losses.resistivity, losses.impedance_model)
    elif abs(losses.constant) < 1:
        impedance[:] = (1.0 + abs(losses.constant)) / (1.0 - abs(losses.constant))
    top = max(clutter.top, losses.stand.trunk_height, losses.source_height, losses.receiver_height)
    return Layer(
        trunks,
        phases,
        tuple(scatter_of(clutter, float(band), speed, losses.takes) for band in bands),
        top,
        reverb.canopy_return,
        impedance,
        reverb.litter,
    )


def _followed(phase: PhaseFunction, density: Density, edges: np.ndarray) -> int:
    """Bins in which packets are followed; in an even stand they diffuse from then on."""
    if density.cells.size:
        return len(edges) - 1
    reach = edges[0] + FOLLOWED / max(density.around * phase.width, LEAST)
    return int(np.clip(np.searchsorted(edges, reach), 6, len(edges) - 1))


def _diffused(start: Energy, phase: PhaseFunction, density: Density, edges: np.ndarray) -> Energy:
    """Energy beyond the bins of packets: 1/x² (diffusion in the plane), less what bark keeps."""
    count = len(start.again)
    if count == len(edges) - 1:
        return start
    middle = np.sqrt(edges[1:] * edges[:-1])
    lost = (1.0 - phase.kept) * density.around * phase.width
    law = middle**-2.0 * np.exp(-lost * (middle - middle[count - 1]))
    last = slice(count - 4, count)
    level = float(np.mean(start.again[last] / law[last]))
    again = np.concatenate([start.again, level * law[count:]])
    once = np.concatenate([start.once, np.full(len(middle) - count, LEAST)])
    return Energy(edges, once, again, start.drawn)


def _spread(tail: Tail, in_space: np.ndarray) -> np.ndarray:
    """(B,) dB, of all noise from the joint on. in_space : (SHARES, B, X) that branches or leaves turned.

    Where packets diffuse their energy is that of the last bins, and as sure.
    """
    length, width = tail.energy[0].middle, np.diff(tail.energy[0].edges)
    level = np.zeros((SHARES, len(tail.band), len(length)))
    for row, energy in enumerate(tail.energy):
        if energy.drawn is not None:
            level[:, row, : energy.drawn.shape[1]] = energy.drawn
    kept, left = tail.left(length)
    late = (length >= tail.joint) | math.isinf(tail.joint)
    noise = (level * kept + in_space * left) @ (width * late)
    mean, error = noise.mean(axis=0), noise.std(axis=0, ddof=1) / math.sqrt(SHARES)
    share = np.divide(error, mean, out=np.full(len(mean), np.nan), where=mean > 0)
    return np.asarray(10.0 / math.log(10.0) * share)


def _joint(tail: Tail, share: float, apart: float) -> float:
    """Metres of path from which on noise replaces the sum over trunks, that is sound scattered once.

    From there on, in every octave, what it replaces is at most 1 - share of the energy still to come, at
    this length and all later ones, or FAINT of all energy of the octave, direct sound included. Noise has
    the energy of what it replaces; so much of it has not its waveform.
    """
    if share >= 1:
        return math.inf
    length, width = tail.energy[0].middle, np.diff(tail.energy[0].edges)
    once, several = tail.heard(length)
    once, several = (
        np.cumsum((part * width)[:, ::-1], axis=1)[:, ::-1] for part in (once, several)
    )
    direct = tail.losses.unthinned.mean_square(tail.band, np.array(apart)) / apart**2
    taken = 2.0 * tail.losses.along(tail.band) + tail.losses.removed(tail.band)
    whole = direct * np.exp(-taken * apart) + once[:, 0] + several[:, 0]
    held = once <= (1.0 - share) * (once + several)
    held |= once <= FAINT * whole[:, None]
    late = np.flatnonzero(~held.all(axis=0))
    row = int(late[-1]) + 1 if len(late) else 0
    return float(length[row]) if row < len(length) else math.inf
