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
from dataclasses import replace

import numpy as np

from ...base.progress import Progress
from ...spec import Air, Reverb
from ..rays.caster import RayCaster
from .channels import ImpulseResponse
from .directivity import OMNI, Directivity
from .ends import Ends, ends_of
from .forest.surroundings import BARE, FoliageCanopy, surroundings
from .hearing import OMNI_EAR, Hearing, encoded
from .pair import Pair, lines_of_sight
from .sums.fast_scattering import Expansions
from .trunks import Field, Trunks, continuation

TrunksBetween = Callable[[np.ndarray, np.ndarray], Trunks]  # by source and receiver


def impulse_response(  # noqa: PLR0913 (all that a response depends on)
    trunks: Trunks | TrunksBetween,
    reverb: Reverb,
    air: Air,
    *,
    ends: Ends | None = None,
    directivity: Directivity = OMNI,
    hearing: Hearing = OMNI_EAR,
    wood: RayCaster | None = None,
    rng: np.random.Generator | None = None,
    field: Field | None = None,
    expansions: Expansions | None = None,
    progress: Progress | None = None,
    canopy: FoliageCanopy = BARE,
    key: tuple[int | str, ...] = (0, "reverb"),
    all_trunks: bool = True,
) -> ImpulseResponse:
    """The impulse responses of a forest: that of the first channel, with the ``further`` ones in it.

    trunks : of the modelled field, all of them scatter; or a function of source and receiver.
    ends : sources and receivers; None: those that ``reverb`` has without Blender's objects.
    directivity : of every source; where they point is in ``reverb``. hearing : of every receiver.
    wood : what blocks the direct and the ground sound; None: nothing does.
    rng, field : for ``reverb.continue_to``: the random stream, and corner and extent of the field.
    expansions : what the fast sum set up for other responses; None: it is set up for this one.
    progress : called as progress(done, total).
    canopy : leaves and tops of the scene, for a model ``forest``. key : of its noise's random streams.
    all_trunks : also those that add nothing above the end of a record (``tree_response``).

    Raises
    ------
    ValueError : ``continue_to`` is set and ``rng`` or ``field`` is missing.
    """
    prepared = Expansions() if expansions is None else expansions
    pairs = pairs_of(
        trunks,
        reverb,
        air,
        ends=ends,
        directivity=directivity,
        wood=wood,
        rng=rng,
        field=field,
        canopy=canopy,
        key=key,
        all_trunks=all_trunks,
    )
    responses: list[ImpulseResponse] = []
    for number, pair in enumerate(pairs):
        share = _share_of(progress, number, len(pairs))
        one = pair.response(prepared, None if number else reverb.rescattering, share)
        responses += encoded(pair, one, hearing, prepared)
    return replace(responses[0], further=tuple(responses[1:]))


def pairs_of(
    trunks: Trunks | TrunksBetween,
    reverb: Reverb,
    air: Air,
    *,
    ends: Ends | None = None,
    directivity: Directivity = OMNI,
    wood: RayCaster | None = None,
    rng: np.random.Generator | None = None,
    field: Field | None = None,
    canopy: FoliageCanopy = BARE,
    key: tuple[int | str, ...] = (0, "reverb"),
    all_trunks: bool = True,
) -> list[Pair]:
    """Every source with every receiver and what is between them; arguments as of ``impulse_response``.

    Of what moves every moment has the same random numbers, so that noise changes no faster than it.
    """
    ends = ends_of(reverb) if ends is None else ends
    between = trunks if callable(trunks) else lambda source, receiver: trunks
    ours = [between(*pair) for pair in ends.pairs]
    beyond = continuation(ours[0], reverb, ends.on_ground, rng, field)
    around = surroundings(ours[0], reverb, field, canopy) if reverb.model == "forest" else None
    channels, alike = ends.channels, len(ends.sources) * len(ends.receivers)
    pairs = [
        Pair(
            *pair,
            reverb,
            air,
            directivity,
            lines_of_sight(*pair, wood),
            around,
            (*key, number % alike),
            channels[number],
            ours[number],
            beyond,
            all_trunks,
            ends.times[number // alike] if ends.times else math.nan,
        )
        for number, pair in enumerate(ends.pairs)
    ]
    if reverb.duration > 0:
        return pairs
    reverb = replace(reverb, duration=max(pair.needed() for pair in pairs))
    return [replace(pair, reverb=reverb) for pair in pairs]


def _share_of(progress: Progress | None, number: int, count: int) -> Progress | None:
    """The progress of one channel of several, as that of all."""
    if progress is None:
        return None
    return lambda done, total: progress(done + number * total, count * total)
