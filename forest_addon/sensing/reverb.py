"""The sound of a forest of trunks: the impulse response between a source and a receiver.

Upright trunks, a source and a receiver go in; the pressure at the receiver comes out, for a source that
sends one sample of height 1 as heard at 1 m (Kaneko & Gamper 2021, K). Under e^{+iωt}, with the
absorption b of the air and k = 2πf/c:

    direct   e^{-(b+ik)d}/d
    ground   g·e^{-(b+ik)d'}/d', d' from the source mirrored at z = 0
    trees    Σ_m β/(r_s·r_r^α)·e^{-(b+ik)(r_s+r_r)}·H(f, φ_m), H of ``acoustics/cylinder``

r_s and r_r are horizontal distances to the trunk's axis. Where source or receiver stand on or in a
trunk, its distance is taken as the radius. Nothing shades the scattered paths (single scattering);
wood between source and receiver takes the direct and the ground sound away.

The band ends in a smooth roll-off from 0.45 to 0.5 of the sampling rate, and the transform is longer
than the last path and its ringing, so that nothing wraps around into the impulse response.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft, special

from ..acoustics.air import absorption
from ..acoustics.spectrum import delay_factors
from ..spec import Air, Reverb
from .continuation import Field, continue_trunks
from .rays import RayCaster
from .scattering import scattered_spectrum, trunk_paths
from .slices import Trunks

Progress = Callable[[int, int], None]
NEAREST = (
    0.1  # m; a source has an extent, so that the direct sound is not louder than at this distance
)
RINGING = 0.3  # s; by then a trunk's answer has fallen to 1e-7 of its peak (it falls as t^-2.5)
SPREAD = 256  # samples; so far does the roll-off spread an arrival, to 1e-8 of its peak
GROUND_CLEARANCE = (
    0.05  # m; lower than this, a line of sight is not tested against the ground itself
)
MARGIN = 1e-3  # m; so near its end, a line of sight is not tested


@dataclass(frozen=True)
class ImpulseResponse:
    """The pressure at the receiver, sample 0 when the source sounds.

    sample_rate : Hz. direct, ground, trees : (N,) the three parts, re the source's impulse at 1 m.
    direct_delay : seconds from source to receiver in a straight line, whether blocked or not.
    direct_clear, ground_clear : whether wood leaves the direct and the ground sound their way.
    trunks : how many trunks were heard. continued : how many of them stand beyond the field.
    late : how many more are so far away that they would be heard after the end.
    clamped : how many trunks cover the source or the receiver.
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

    @property
    def samples(self) -> np.ndarray:
        """(N,) the impulse response, all parts together."""
        return self.direct + self.ground + self.trees


def impulse_response(
    trunks: Trunks,
    reverb: Reverb,
    air: Air,
    *,
    wood: RayCaster | None = None,
    rng: np.random.Generator | None = None,
    field: Field | None = None,
    progress: Progress | None = None,
) -> ImpulseResponse:
    """The impulse response of a forest.

    trunks : of the modelled field; all of them scatter.
    wood : what blocks the direct and the ground sound; None: nothing does.
    rng, field : for ``reverb.continue_to``: the random stream, and corner and extent of the field.
    progress : called as progress(done, total).

    Raises
    ------
    ValueError : ``continue_to`` is set and ``rng`` or ``field`` is missing.
    """
    source, receiver = np.asarray(reverb.source), np.asarray(reverb.receiver)
    direct_clear, ground_clear = lines_of_sight(source, receiver, wood)
    forest = continued(trunks, reverb, rng, field)
    paths = trunk_paths(forest, source[:2], receiver[:2], reverb.strength, reverb.spreading)
    speed, rate = air.speed(), reverb.sample_rate
    end = (reverb.duration + SPREAD / rate) * speed  # in metres
    heard = paths.earliest <= end
    mirrored = source * (1.0, 1.0, -1.0)
    straight, bounced = (max(math.dist(receiver, start), NEAREST) for start in (source, mirrored))

    within = [x for x in (straight, bounced, *paths.length[heard]) if x <= end]
    length = math.ceil((max(within, default=0.0) / speed + RINGING) * rate) + SPREAD
    length = fft.next_fast_len(length, real=True)
    frequency = np.arange(length // 2 + 1) * (rate / length)
    loss = absorption(frequency, air.temperature_c, air.humidity, air.pressure_kpa)

    def arrival(path: float, gain: float) -> np.ndarray:
        if path > end or gain == 0:
            return np.zeros(len(frequency))
        delay = delay_factors(0.0, rate / length, len(frequency), np.array([path / speed]))[:, 0]
        return gain / path * np.exp(-loss * path) * delay

    spectra = np.stack(
        [
            arrival(straight, float(direct_clear)),
            arrival(bounced, reverb.ground * ground_clear),
            scattered_spectrum(paths.select(heard), rate / length, loss, speed, progress),
        ]
    )
    count = max(1, round(reverb.duration * rate))
    samples = np.zeros((3, count))
    whole = fft.irfft(spectra * roll_off(frequency / rate), length, axis=1)[:, :count]
    samples[:, : whole.shape[1]] = whole
    return ImpulseResponse(
        sample_rate=rate,
        direct=samples[0],
        ground=samples[1],
        trees=samples[2],
        direct_delay=math.dist(source, receiver) / speed,
        direct_clear=direct_clear,
        ground_clear=ground_clear,
        trunks=int(heard.sum()),
        continued=int(heard[len(trunks) :].sum()),
        late=int((~heard).sum()),
        clamped=int(paths.clamped.sum()),
    )


def roll_off(share: np.ndarray) -> np.ndarray:
    """Gain at a share of the sampling rate: 1 up to 0.45, a Gaussian step down to 0 at 0.5.

    A band that ends at once gives every arrival that is not on a sample tails of 1/t.
    """
    step = 0.5 * special.erfc((share - 0.475) / 0.025 * 4.0)  # 8e-9 from 0 and 1 at the ends
    gain: np.ndarray = np.where(share <= 0.45, 1.0, np.where(share >= 0.5, 0.0, step))
    return gain


def lines_of_sight(
    source: np.ndarray, receiver: np.ndarray, wood: RayCaster | None
) -> tuple[bool, bool]:
    """Whether the direct and the ground sound, from (3,) to (3,), pass the wood.

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


def continued(
    trunks: Trunks, reverb: Reverb, rng: np.random.Generator | None, field: Field | None
) -> Trunks:
    """The trunks, and after them those of the forest beyond the field."""
    if reverb.continue_to <= 0:
        return trunks
    if rng is None or field is None:
        raise ValueError("continue_to needs a random stream and the field's corner and extent")
    ends = np.array([reverb.source[:2], reverb.receiver[:2]])
    beyond = continue_trunks(trunks, field, ends.mean(axis=0), reverb.continue_to, rng, clear=ends)
    return Trunks(
        position=np.concatenate([trunks.position, beyond.position]),
        radius=np.concatenate([trunks.radius, beyond.radius]),
        tree=np.concatenate([trunks.tree, beyond.tree]),
    )
