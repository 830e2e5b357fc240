"""One source and one receiver in a forest: what is heard of it, and its parts.

Direct sound, the ground's, that of trunks and the noise of what is scattered more than once; the formulas
are in ``response``.

Sound that meets no trunk: an arrival after a path, and whether wood leaves it its way.

A path's length and its gain by frequency go in, samples come out; source, receiver and the scene's wood go
in, two answers come out: whether the direct and the ground's sound pass.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import fft

from ...acoustics.ground import SURFACES, spherical_reflection, surface_impedance
from ...acoustics.spectrum import delay_factors
from ...base.progress import Progress
from ...base.rng import stream
from ...spec import Air, Reverb
from ..rays.caster import RayCaster
from .bands import SPREAD, roll_off
from .channels import ImpulseResponse
from .directivity import OMNI, Directivity, Term
from .forest.losses import Losses, loss_per_metre
from .forest.surroundings import Surroundings
from .forest.tail import FADE, Tail, tail_of
from .forest.transport import Sent
from .model_error import model_error
from .sums.fast_scattering import Expansions
from .sums.scattering import TrunkPaths, trunk_paths
from .sums.tree_response import (
    NEAREST,
    TreeResponse,
    Weak,
    record_length,
    tree_response,
    weak_trunks,
)
from .trunks import Trunks

LOWEST = 1.0  # Hz; below it, the ground is as it is there


def trees_of(tree: np.ndarray) -> int:
    """Number of trees that stems (N,) are of; those of no tree (-1) count each."""
    return len(np.unique(tree[tree >= 0])) + int((tree < 0).sum())


@dataclass(frozen=True)
class Pair:
    """A source, a receiver and what is between them.

    clear : direct and ground sound pass. around, key : of a model ``forest``. trunks : of the field; beyond :
    those around it. all_trunks : also those that add next to nothing. at : as of the response.
    """

    source: np.ndarray
    receiver: np.ndarray
    reverb: Reverb
    air: Air
    directivity: Directivity
    clear: tuple[bool, bool]
    around: Surroundings | None
    key: tuple[int | str, ...]
    channel: str
    trunks: Trunks
    beyond: Trunks
    all_trunks: bool = True
    at: float = math.nan

    @cached_property
    def losses(self) -> Losses | None:
        """Losses of a model ``forest``; None of any other."""
        if self.around is None:
            return None
        return Losses.of(self.reverb, self.air, self.around.stand, self.source, self.receiver)

    def response(
        self, expansions: Expansions, rescattering: int | None, progress: Progress | None
    ) -> ImpulseResponse:
        """The response with trunks of the field and those beyond it."""
        rate, air = self.reverb.sample_rate, self.air
        forest, weak = self.loud
        ours = int((~weak.rows[: len(self.trunks)]).sum())
        tail = self.tail(expansions)
        last = FADE * tail.joint if tail else math.inf
        trees = self.trees(forest, expansions, progress, last)
        count = len(trees.samples)
        noise = None
        if tail:
            kept = tail.kept(np.arange(count) * (air.speed() / rate))
            noise = self.noise(tail, count)
            trees = replace(trees, samples=trees.samples * kept + noise)
        (straight, sent), (bounced, reflected) = self.arrivals()
        direct, ground = self.clear
        rings = 0.0 if self.reverb.ground_kind == "constant" else RINGING
        response = ImpulseResponse(
            sample_rate=rate,
            direct=arrival(straight, sent, rate, count, air) if direct else np.zeros(count),
            ground=arrival(bounced, reflected, rate, count, air, rings)
            if ground
            else np.zeros(count),
            trees=trees.samples,
            direct_delay=math.dist(self.source, self.receiver) / air.speed(),
            direct_clear=direct,
            ground_clear=ground,
            trunks=int(trees.heard.sum()),
            stands=trees_of(forest.tree[trees.heard]),
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
            tail_error=tail.spread if tail else None,
            channel=self.channel,
            source=tuple(self.source.tolist()),
            receiver=tuple(self.receiver.tolist()),
            at=self.at,
            stand=self.around.stand if self.around else None,
        )
        return replace(response, **weak.told(response.samples, rate))

    @cached_property
    def loud(self) -> tuple[Trunks, Weak]:
        """Trunks that are summed, and those that add next to nothing, where they are left out."""
        forest = self.forest
        if self.all_trunks:
            return forest, Weak(np.zeros(len(forest), bool), np.zeros(0))
        direct = (max(math.dist(self.source, self.receiver), NEAREST),) if self.clear[0] else ()
        loudest = float(np.abs(self.directivity.gain).max())
        given = self.paths, direct, self.reverb.sample_rate, self.air, self.losses
        weak = weak_trunks(*given, loudest)
        return forest.select(~weak.rows), weak

    @cached_property
    def paths(self) -> TrunkPaths:
        """Paths by way of all trunks, also those that are left out, of a source that sends alike."""
        reverb, upright = self.reverb, self.losses is not None
        ends = self.source[:2], self.receiver[:2]
        return trunk_paths(self.forest, *ends, reverb.strength, reverb.spreading, None, upright)

    @property
    def forest(self) -> Trunks:
        """All trunks."""
        return self.trunks.with_others(self.beyond)

    def needed(self) -> float:
        """Seconds that the record must last."""
        losses = self.losses
        if (
            losses and self.reverb.tail == "transport"
        ):  # what is scattered away comes back by other ways
            losses = replace(losses, extinction="none", scattered=False)
        lengths = tuple(path for path, _ in self.arrivals())
        return record_length(self.paths, lengths, self.reverb.sample_rate, self.air, losses)

    def arrivals(self) -> tuple[tuple[float, Gain], tuple[float, Gain]]:
        """Metres and gain of the direct sound and of the ground's."""
        mirrored = self.receiver * (1.0, 1.0, -1.0)
        straight, bounced = (
            max(math.dist(self.source, end), NEAREST) for end in (self.receiver, mirrored)
        )
        direct = self._sent_to(self.receiver)
        return (straight, direct), (bounced, self._reflected(mirrored, bounced))

    def tail(self, expansions: Expansions) -> Tail | None:
        """Sound scattered more than once; None where the model has none. Kept in ``expansions``."""
        if not (self.losses and self.around and self.reverb.tail == "transport"):
            return None
        ends, length = (self.source, self.receiver), self.reverb.duration
        density = self.around.density
        stand = (density.cells.tobytes(), density.corner, density.cell, density.around)
        sent = None if self.directivity is OMNI else self._energy
        sends = self.directivity.gain.tobytes() if sent else b""
        same = (self.reverb, self.losses, str(ends), length, self.key, stand, sends)
        given = self.reverb, self.losses, density, *ends, length, self.key
        return expansions.tails.once(same, lambda: tail_of(*given, sent=sent))

    def _energy(self, frequency: float) -> Sent:
        """Return the energy that the source sends by ways at a frequency."""

        def sent(way: np.ndarray) -> np.ndarray:
            gain = self.directivity.around(self._from_axis(way), frequency)
            return np.asarray(np.abs(gain) ** 2)

        return sent

    def noise(self, tail: Tail, count: int) -> np.ndarray:
        """(count,) samples of a tail."""
        rng = stream(int(self.key[0]), *self.key[1:], "tail")
        return tail.samples(self.reverb.sample_rate, count, self.air, rng)

    def terms(self, trunks: Trunks) -> list[tuple[Term, np.ndarray]]:
        """The products that the directivity is made of, with their gains (M,) towards trunks."""
        away = np.zeros((len(trunks), 3))
        away[:, :2] = trunks.position - self.source[:2]
        cosine = self._from_axis(away)
        allowed = max(0.1 * self.reverb.tolerance, 1e-9)
        return [(term, term.gains(cosine)) for term in self.directivity.terms(allowed)]

    def trees(
        self,
        forest: Trunks,
        expansions: Expansions,
        progress: Progress | None,
        last: float = math.inf,
        heard: np.ndarray | float = 1.0,
    ) -> TreeResponse:
        """The trunks' sound: a sum for each product that the directivity is made of.

        last : metres of path after which trunks are not summed. heard : (M,) gain of each trunk.
        """
        parts = []
        for term, gain in self.terms(forest):
            part = tree_response(
                forest,
                self.source,
                self.receiver,
                self.reverb,
                self.air,
                gain=gain * heard,
                losses=self.losses,
                last=last,
                expansions=expansions,
                progress=progress,
            )
            parts.append(
                replace(part, samples=filtered(part.samples, term, self.reverb.sample_rate))
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
        """Amplitude that is sent towards the mirrored receiver, times what the ground sends back."""
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


def filtered(samples: np.ndarray, term: Term, rate: float) -> np.ndarray:
    """(N,) samples through a term's factors of frequency, which have no phase."""
    if term.flat:
        return samples * term.of_frequency[0]
    size = fft.next_fast_len(2 * len(samples), real=True)
    spectrum = fft.rfft(samples, size) * term.spectrum(np.arange(size // 2 + 1) * (rate / size))
    return fft.irfft(spectrum, size)[: len(samples)]


Gain = Callable[[np.ndarray], np.ndarray]  # by frequency
GROUND_CLEARANCE = (
    0.05  # m; lower than this, a line of sight is not tested against the ground itself
)
MARGIN = 1e-3  # m; so near its end, a line of sight is not tested
RINGING = 0.25  # s; what a porous ground sends back after that is below 1e-5 of its largest sample


def arrival(
    path: float, gain: Gain, rate: float, count: int, air: Air, rings: float = 0.0
) -> np.ndarray:
    """(count,) samples of one arrival, gain(f)/path·e^{-(b+ik)path}, after ``path`` metres.

    rings : s that it lasts; what comes after the record must not be heard at its begin.
    """
    delay = path / air.speed()
    if (delay - count / rate) * rate > SPREAD:
        return np.zeros(count)
    last = math.ceil((delay + rings) * rate)
    size = fft.next_fast_len(max(count, last) + 2 * SPREAD, real=True)
    frequency = np.arange(size // 2 + 1) * (rate / size)
    loss = loss_per_metre(frequency, air)
    carried = delay_factors(0.0, rate / size, len(frequency), np.array([delay]))[:, 0]
    spectrum = gain(frequency) / path * np.exp(-loss * path) * carried * roll_off(frequency / rate)
    return fft.irfft(spectrum, size)[:count]


def lines_of_sight(
    source: np.ndarray, receiver: np.ndarray, wood: RayCaster | None
) -> tuple[bool, bool]:
    """Return whether the direct and the ground sound, from (3,) to (3,), pass the wood.

    The ground sound goes down towards z = 0 and up again; below ``GROUND_CLEARANCE`` its way is cut
    short, so that the ground does not hide itself.
    """
    if wood is None:
        return True, True
    low, high = source[2], receiver[2]
    bounce = source + (receiver - source) * (low / (low + high))
    bounce[2] = 0.0
    down, up = (
        end + (bounce - end) * max(0.0, 1.0 - GROUND_CLEARANCE / end[2])
        for end in (source, receiver)
    )
    start = np.stack([source, source, down, up])
    way = np.stack([receiver, down, up, receiver]) - start
    blocked = wood.occluded(start, way, np.maximum(np.linalg.norm(way, axis=1) - MARGIN, 0.0))
    return not blocked[0], not blocked[1:].any()
