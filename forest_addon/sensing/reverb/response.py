"""The sound of a forest of trunks: the impulse response between a source and a receiver.

Upright trunks, a source and a receiver go in; the pressure at the receiver comes out, for a source that
sends one sample of height 1 as heard at 1 m (Kaneko & Gamper 2021, K). Under e^{+iωt}, with the
absorption b of the air and k = 2πf/c:

    direct   e^{-(b+ik)d}/d
    ground   g·e^{-(b+ik)d'}/d', d' to the receiver mirrored at z = 0
    trees    Σ_m β/(r_s·r_r^α)·e^{-(b+ik)(r_s+r_r)}·H(f, φ_m), H of ``acoustics/cylinder``

r_s and r_r are horizontal distances to the trunk's axis. Where source or receiver stand on or in a
trunk, its distance is taken as the radius. Nothing shades the scattered paths (single scattering);
wood between source and receiver takes the direct and the ground sound away.

The band ends in a smooth roll-off from 0.45 to 0.5 of the sampling rate, and the transform is longer
than the last path and its ringing, so that nothing wraps around into the impulse response.

A directed source weighs each part by its departure angle: towards the receiver, towards the ground's
bounce, towards each trunk's axis in the horizontal plane. The ground's g is a constant, or Q of
``acoustics/ground``. Several sources and receivers make a channel each; they share the forest and what
the fast sum has set up.

``tree_response`` gives the third part for one pair of source and receiver, by the exact or the fast
sum; call it once a pair, with the same ``expansions``, which are what takes time to set up.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import fft

from ...acoustics.ground import SURFACES, spherical_reflection, surface_impedance
from ...base.rng import stream
from ...spec import Air, Reverb
from ..rays.caster import RayCaster
from .arrivals import Gain, arrival, lines_of_sight
from .directivity import OMNI, Directivity, Term
from .ends import Ends, ends_of
from .forest.losses import Losses
from .forest.surroundings import BARE, Canopy, Surroundings, surroundings
from .forest.tail import FADE, tail_of
from .model_error import ModelError, model_error
from .sums.fast_scattering import Expansions
from .sums.record import record_length
from .sums.scattering import trunk_paths
from .sums.tree_response import NEAREST, TreeResponse, tree_response
from .sums.weak import weak_between
from .trunks.continuation import Field, continuation
from .trunks.slices import Trunks

Progress = Callable[[int, int], None]
TrunksBetween = Callable[[np.ndarray, np.ndarray], Trunks]  # by source and receiver
LOWEST = 1.0  # Hz; below it, the ground is as it is there


@dataclass(frozen=True)
class ImpulseResponse:
    """The pressure at the receiver, sample 0 when the source sounds.

    sample_rate : Hz. direct, ground, trees : (N,) the three parts, re the source's impulse at 1 m.
    direct_delay : seconds from source to receiver in a straight line, whether blocked or not.
    direct_clear, ground_clear : whether wood leaves the direct and the ground sound their way.
    trunks : how many trunks were heard. continued : how many of them stand beyond the field.
    late : how many more are so far away that they would be heard after the end.
    left_db : (1 + B,) their energy, dB re all, estimated: of the whole band and of octaves (``record``).
    clamped : how many trunks cover the source or the receiver.
    exact : whether every trunk was summed at every frequency, rather than to the tolerance.
    errors : {lower end of an octave in Hz: relative error of the fast sum, found by its checks}.
    model_error : what single scattering leaves out, None if it was not asked for.
    tail : (N,) noise of sound scattered more than once, part of ``trees``; None where there is none.
    joint : seconds from when all of the trunks' sound is noise; inf: never.
    channel : which source and which receiver. further : the responses of further pairs.
    weak : trunks that are left out because they add next to nothing. weak_bound : what they add to any
    octave at most, as a share of it.
    """

    sample_rate: float
    direct: np.ndarray
    ground: np.ndarray
    trees: np.ndarray
    direct_delay: float
    direct_clear: bool
    ground_clear: bool
    trunks: int
    continued: int
    late: int
    clamped: int
    exact: bool
    left_db: np.ndarray
    errors: dict[float, float]
    model_error: ModelError | None = None
    tail: np.ndarray | None = None
    joint: float = math.inf
    channel: str = "source to receiver"
    further: tuple[ImpulseResponse, ...] = ()
    weak: int = 0
    weak_bound: float = 0.0

    @property
    def channels(self) -> tuple[ImpulseResponse, ...]:
        """This response and the further ones."""
        return (self, *self.further)

    @property
    def samples(self) -> np.ndarray:
        """(N,) the impulse response, all parts together."""
        return self.direct + self.ground + self.trees


def channels_of(found: ImpulseResponse) -> np.ndarray:
    """(N,) samples of one channel, or (N, C) of several."""
    samples = np.column_stack([channel.samples for channel in found.channels])
    return samples[:, 0] if samples.shape[1] == 1 else samples


def impulse_response(
    trunks: Trunks | TrunksBetween,
    reverb: Reverb,
    air: Air,
    *,
    ends: Ends | None = None,
    directivity: Directivity = OMNI,
    wood: RayCaster | None = None,
    rng: np.random.Generator | None = None,
    field: Field | None = None,
    expansions: Expansions | None = None,
    progress: Progress | None = None,
    canopy: Canopy = BARE,
    key: tuple[int | str, ...] = (0, "reverb"),
    all_trunks: bool = True,
) -> ImpulseResponse:
    """The impulse responses of a forest: that of the first channel, with the ``further`` ones in it.

    trunks : of the modelled field, all of them scatter; or a function of source and receiver.
    ends : sources and receivers; None: those that ``reverb`` has without Blender's objects.
    directivity : of every source; where they point is in ``reverb``.
    wood : what blocks the direct and the ground sound; None: nothing does.
    rng, field : for ``reverb.continue_to``: the random stream, and corner and extent of the field.
    expansions : what the fast sum set up for other responses; None: it is set up for this one.
    progress : called as progress(done, total).
    canopy : leaves and tops of the scene, for a model ``forest``. key : of its noise's random streams.
    all_trunks : also those that add nothing above the end of a record (``weak``).

    Raises
    ------
    ValueError : ``continue_to`` is set and ``rng`` or ``field`` is missing.
    """
    ends = ends_of(reverb) if ends is None else ends
    prepared = Expansions() if expansions is None else expansions
    between = trunks if callable(trunks) else lambda source, receiver: trunks
    first = between(*ends.pairs[0])
    beyond = continuation(first, reverb, ends.on_ground, rng, field)
    around = surroundings(first, reverb, field, canopy) if reverb.model == "forest" else None
    if reverb.duration == 0:
        lengths = [
            _needed(between(*pair).joined(beyond), *pair, reverb, air, around)
            for pair in ends.pairs
        ]
        reverb = replace(reverb, duration=max(lengths))
    found = []
    for number, (source, receiver) in enumerate(ends.pairs):
        hears = _Pair(
            source,
            receiver,
            reverb,
            air,
            directivity,
            lines_of_sight(source, receiver, wood),
            around,
            (*key, number),
            all_trunks,
        )
        found.append(
            hears.response(
                ends.channels[number],
                between(source, receiver),
                beyond,
                prepared,
                None if number else reverb.rescattering,
                _share_of(progress, number, len(ends.pairs)),
            )
        )
    return replace(found[0], further=tuple(found[1:]))


def _needed(
    trunks: Trunks,
    source: np.ndarray,
    receiver: np.ndarray,
    reverb: Reverb,
    air: Air,
    around: Surroundings | None,
) -> float:
    """Seconds that the record of a pair must last."""
    paths = trunk_paths(
        trunks,
        source[:2],
        receiver[:2],
        reverb.strength,
        reverb.spreading,
        upright=around is not None,
    )
    losses = Losses.of(reverb, air, around.stand, source, receiver) if around else None
    if losses and reverb.tail == "transport":  # what is scattered away comes back by other ways
        losses = replace(losses, extinction="none", scattered=False)
    ways = (math.dist(source, end) for end in (receiver, receiver * (1.0, 1.0, -1.0)))
    lengths = tuple(max(way, NEAREST) for way in ways)
    return record_length(paths, lengths, reverb.sample_rate, air, losses)


@dataclass(frozen=True)
class _Pair:
    """A source, a receiver and what is between them; ``clear`` : direct and ground sound pass."""

    source: np.ndarray
    receiver: np.ndarray
    reverb: Reverb
    air: Air
    directivity: Directivity
    clear: tuple[bool, bool]
    around: Surroundings | None
    key: tuple[int | str, ...]
    all_trunks: bool

    @cached_property
    def losses(self) -> Losses | None:
        """Of a model ``forest``."""
        if self.around is None:
            return None
        return Losses.of(self.reverb, self.air, self.around.stand, self.source, self.receiver)

    def response(
        self,
        channel: str,
        trunks: Trunks,
        beyond: Trunks,
        expansions: Expansions,
        rescattering: int | None,
        progress: Progress | None,
    ) -> ImpulseResponse:
        """The response with trunks of the field and those beyond it."""
        forest, ours = trunks.joined(beyond), len(trunks)
        rate, air = self.reverb.sample_rate, self.air
        weak = None
        if not self.all_trunks:
            given = self.reverb, air, self.losses, self.directivity, self.clear[0]
            weak = weak_between(forest, self.source, self.receiver, *given)
            forest, ours = forest.select(~weak.rows), ours - int(weak.rows[:ours].sum())
        tail = None
        if self.losses and self.around and self.reverb.tail == "transport":
            ends, length = (self.source, self.receiver), self.reverb.duration
            density = self.around.density
            stand = (density.cells.tobytes(), density.corner, density.cell, density.around)
            same = (self.reverb, self.losses, str(ends), length, self.key, stand)
            if same not in expansions.tails:
                expansions.tails[same] = tail_of(
                    self.reverb, self.losses, density, *ends, length, self.key
                )
            tail = expansions.tails[same]
        last = FADE * tail.joint if tail else math.inf
        trees = self._trees(forest, expansions, progress, last)
        count = len(trees.samples)
        noise = None
        if tail:
            kept = tail.kept(np.arange(count) * (air.speed() / rate))
            noise = tail.samples(rate, count, air, stream(int(self.key[0]), *self.key[1:], "tail"))
            noise *= self._all_round()
            trees = replace(trees, samples=trees.samples * kept + noise)
        mirrored = self.receiver * (1.0, 1.0, -1.0)
        straight, bounced = (
            max(math.dist(self.source, end), NEAREST) for end in (self.receiver, mirrored)
        )
        direct, ground = self.clear
        found = ImpulseResponse(
            sample_rate=rate,
            direct=arrival(straight, self._sent_to(self.receiver), rate, count, air)
            if direct
            else np.zeros(count),
            ground=arrival(bounced, self._reflected(mirrored, bounced), rate, count, air)
            if ground
            else np.zeros(count),
            trees=trees.samples,
            direct_delay=math.dist(self.source, self.receiver) / air.speed(),
            direct_clear=direct,
            ground_clear=ground,
            trunks=int(trees.heard.sum()),
            continued=int(trees.heard[ours:].sum()),
            late=int((~trees.heard).sum()),
            clamped=trees.clamped,
            exact=trees.exact,
            left_db=trees.left_db,
            errors=trees.errors,
            model_error=model_error(forest, self.source, self.receiver, rescattering, air)
            if rescattering
            else None,
            tail=noise,
            joint=tail.joint / air.speed() if tail else math.inf,
            channel=channel,
        )
        return found if weak is None else replace(found, **weak.told(found.samples, rate))

    def _all_round(self) -> float:
        """Root mean square of what a directed source sends level, at 1 kHz."""
        turn = np.linspace(0.0, math.pi, 37)
        level = math.cos(math.radians(self.reverb.facing_elevation_deg))
        gains = [self.directivity.at(level * math.cos(a), np.array([1000.0])) for a in turn]
        return float(np.sqrt(np.mean(np.square(np.abs(gains)))))

    def _trees(
        self,
        forest: Trunks,
        expansions: Expansions,
        progress: Progress | None,
        last: float = math.inf,
    ) -> TreeResponse:
        """The trunks' sound: a sum for each product that the directivity is made of."""
        away = np.zeros((len(forest), 3))
        away[:, :2] = forest.position - self.source[:2]
        cosine = self._from_axis(away)
        allowed = max(0.1 * self.reverb.tolerance, 1e-9)
        parts = []
        for term in self.directivity.terms(allowed):
            part = tree_response(
                forest,
                self.source,
                self.receiver,
                self.reverb,
                self.air,
                gain=term.gains(cosine),
                losses=self.losses,
                last=last,
                expansions=expansions,
                progress=progress,
            )
            parts.append(
                replace(part, samples=_filtered(part.samples, term, self.reverb.sample_rate))
            )
        return replace(parts[0], samples=np.sum([part.samples for part in parts], axis=0))

    def _sent_to(self, end: np.ndarray) -> Gain:
        cosine = float(self._from_axis((end - self.source)[None])[0])
        if self.losses is None or not self.losses.among_leaves:
            return lambda frequency: self.directivity.at(cosine, frequency)
        losses, path = self.losses, math.dist(self.source, end)
        return lambda frequency: (
            self.directivity.at(cosine, frequency) * np.exp(-path * losses.of_clutter(frequency))
        )

    def _reflected(self, mirrored: np.ndarray, path: float) -> Gain:
        """What is sent towards the mirrored receiver, times what the ground sends back."""
        sent, reverb, losses = self._sent_to(mirrored), self.reverb, self.losses
        if losses is not None:
            level = max(float(np.hypot(*(mirrored - self.source)[:2])), NEAREST)
            return lambda frequency: sent(frequency) * losses.bounce(frequency, level)
        if reverb.ground_kind == "constant":
            return lambda frequency: reverb.ground * sent(frequency)
        resistivity = reverb.flow_resistivity or SURFACES[reverb.ground_kind]
        rise = float(self.source[2] + self.receiver[2])

        def reflected(frequency: np.ndarray) -> np.ndarray:
            audible = np.maximum(frequency, LOWEST)
            impedance = surface_impedance(audible, resistivity, reverb.impedance_model)
            return sent(frequency) * spherical_reflection(
                audible, path, rise, impedance, self.air.speed()
            )

        return reflected

    def _from_axis(self, way: np.ndarray) -> np.ndarray:
        """(M,) cosines between ways (M, 3) and the source's axis; 1 where a way has no length."""
        azimuth = math.radians(self.reverb.facing_azimuth_deg)
        elevation = math.radians(self.reverb.facing_elevation_deg)
        level = math.cos(elevation)
        axis = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])
        length = np.linalg.norm(way, axis=1)
        cosine = np.divide(way @ axis, length, out=np.ones(len(way)), where=length > 0)
        return np.clip(cosine, -1.0, 1.0)


def _filtered(samples: np.ndarray, term: Term, rate: float) -> np.ndarray:
    """(N,) samples through a term's factors of frequency, which have no phase."""
    if term.flat:
        return samples * term.of_frequency[0]
    size = fft.next_fast_len(2 * len(samples), real=True)
    spectrum = fft.rfft(samples, size) * term.spectrum(np.arange(size // 2 + 1) * (rate / size))
    filtered: np.ndarray = fft.irfft(spectrum, size)[: len(samples)]
    return filtered


def _share_of(progress: Progress | None, number: int, count: int) -> Progress | None:
    """The progress of one channel of several, as that of all."""
    if progress is None:
        return None
    return lambda done, total: progress(done + number * total, count * total)
