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

``tree_response`` gives the third part for one pair of source and receiver, by the exact or the fast
sum; call it once a pair, with the same ``expansions``, which are what takes time to set up.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft

from ..acoustics.air import absorption
from ..acoustics.spectrum import delay_factors
from ..spec import Air, Reverb
from .continuation import Field, continue_trunks
from .fast_scattering import Expansions
from .model_error import ModelError, model_error
from .rays import RayCaster
from .scattering import SPREAD, roll_off
from .slices import Trunks
from .tree_response import tree_response

Progress = Callable[[int, int], None]
NEAREST = (
    0.1  # m; a source has an extent, so that the direct sound is not louder than at this distance
)
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
    exact : whether every trunk was summed at every frequency, rather than to the tolerance.
    model_error : what single scattering leaves out, None if it was not asked for.
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
    model_error: ModelError | None = None

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
    expansions: Expansions | None = None,
    progress: Progress | None = None,
) -> ImpulseResponse:
    """The impulse response of a forest.

    trunks : of the modelled field; all of them scatter.
    wood : what blocks the direct and the ground sound; None: nothing does.
    rng, field : for ``reverb.continue_to``: the random stream, and corner and extent of the field.
    expansions : what the fast sum set up for other responses; None: it is set up for this one.
    progress : called as progress(done, total).

    Raises
    ------
    ValueError : ``continue_to`` is set and ``rng`` or ``field`` is missing.
    """
    source, receiver = np.asarray(reverb.source), np.asarray(reverb.receiver)
    direct_clear, ground_clear = lines_of_sight(source, receiver, wood)
    forest = continued(trunks, reverb, rng, field)
    trees = tree_response(
        forest, source, receiver, reverb, air, expansions=expansions, progress=progress
    )
    mirrored = source * (1.0, 1.0, -1.0)
    straight, bounced = (max(math.dist(receiver, start), NEAREST) for start in (source, mirrored))
    count = len(trees.samples)
    return ImpulseResponse(
        sample_rate=reverb.sample_rate,
        direct=arrival(straight, float(direct_clear), reverb.sample_rate, count, air),
        ground=arrival(bounced, reverb.ground * ground_clear, reverb.sample_rate, count, air),
        trees=trees.samples,
        direct_delay=math.dist(source, receiver) / air.speed(),
        direct_clear=direct_clear,
        ground_clear=ground_clear,
        trunks=int(trees.heard.sum()),
        continued=int(trees.heard[len(trunks) :].sum()),
        late=int((~trees.heard).sum()),
        clamped=trees.clamped,
        exact=trees.exact,
        model_error=model_error(forest, source, receiver, reverb.rescattering, air)
        if reverb.rescattering
        else None,
    )


def arrival(path: float, gain: float, rate: float, count: int, air: Air) -> np.ndarray:
    """(count,) samples of one arrival, gain/path·e^{-(b+ik)path}, after ``path`` metres."""
    delay = path / air.speed()
    if gain == 0 or (delay - count / rate) * rate > SPREAD:
        return np.zeros(count)
    size = fft.next_fast_len(max(count, math.ceil(delay * rate)) + 2 * SPREAD, real=True)
    frequency = np.arange(size // 2 + 1) * (rate / size)
    loss = absorption(frequency, air.temperature_c, air.humidity, air.pressure_kpa)
    carried = delay_factors(0.0, rate / size, len(frequency), np.array([delay]))[:, 0]
    spectrum = gain / path * np.exp(-loss * path) * carried * roll_off(frequency / rate)
    samples: np.ndarray = fft.irfft(spectrum, size)[:count]
    return samples


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
