"""Impulse response that a reverb finds, with those of its further channels: data alone, from ``response``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .forest.losses import TrunkStand
    from .model_error import ModelError


@dataclass(frozen=True)
class ImpulseResponse:
    """The pressure at the receiver, sample 0 when the source sounds.

    sample_rate : Hz. direct, ground, trees : (N,) the three parts, re the source's impulse at 1 m.
    direct_delay : seconds from source to receiver in a straight line, whether blocked or not.
    direct_clear, ground_clear : whether wood leaves the direct and the ground sound their way.
    trunks : how many trunks were heard, each stem for itself. continued : how many of them stand beyond the
    field. stands : how many trees these stems are of; each of no tree counts as one; -1: unknown.
    late : how many more are so far away that they would be heard after the end.
    left_db : (1 + B,) their energy, dB re all, estimated: of the whole band and of octaves
    (``tree_response``).
    clamped : how many trunks cover the source or the receiver.
    exact : whether every trunk was summed at every frequency, rather than to the tolerance.
    errors : {lower end of an octave in Hz: relative error of the fast sum at most}.
    model_error : what single scattering leaves out, None if it was not asked for.
    tail : (N,) noise of sound scattered more than once, part of ``trees``; None where there is none.
    joint : seconds from when all of the trunks' sound is noise; inf: never.
    tail_error : (B,) dB, standard error of the level of that noise in each octave; None where there is none.
    channel : which source and which receiver. further : the responses of further pairs.
    weak : trunks that are left out because they add next to nothing. weak_bound : what they add to any
    octave at most, as a share of it.
    source, receiver : (3,) metres. at : seconds on the path of what moves; NaN: nothing does.
    component : number of a receiver's channel, of ambisonics or a head. plain : what one microphone alike to
    all sides hears in its place, kept with the first component of a head.
    stand : that losses are of, of a model ``forest``. sprays : species whose needles count as leaves.
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
    tail_error: np.ndarray | None = None
    channel: str = "source to receiver"
    further: tuple[ImpulseResponse, ...] = ()
    weak: int = 0
    weak_bound: float = 0.0
    source: tuple[float, ...] = (0.0, 0.0, 0.0)
    receiver: tuple[float, ...] = (0.0, 0.0, 0.0)
    at: float = math.nan
    component: int = 0
    plain: ImpulseResponse | None = None
    stand: TrunkStand | None = None
    sprays: tuple[str, ...] = ()
    stands: int = -1

    @property
    def moves(self) -> bool:
        """Return whether it is of a moment of a path."""
        return not math.isnan(self.at)

    @property
    def channels(self) -> tuple[ImpulseResponse, ...]:
        """All channels: this response and the further ones."""
        return (self, *self.further)

    @property
    def microphones(self) -> tuple[ImpulseResponse, ...]:
        """Responses of microphones that are alike to all sides, one for every pair of ends."""
        return tuple(one.plain or one for one in self.channels if one.component == 0)

    @property
    def samples(self) -> np.ndarray:
        """(N,) the impulse response, all parts together."""
        return self.direct + self.ground + self.trees


def channels_of(found: ImpulseResponse) -> np.ndarray:
    """(N,) samples of one channel, or (N, C) of several."""
    samples = np.column_stack([channel.samples for channel in found.channels])
    return samples[:, 0] if samples.shape[1] == 1 else samples
