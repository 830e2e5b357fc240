"""Channels of a receiver by directions of arrival: first-order ambisonics, or two ears of a measured head.

Ways of arrival go in, impulse responses of the channels go out. Ambisonics are in ACN order and SN3D
(W, Y, Z, X; "AmbiX", Nachbar et al. 2011): 1 and the unit vector towards the sound, x where the receiver
faces, y to its left, z up. A head is the SOFA file's: a sound is heard as from the direction measured that
is next to its own. So that not every trunk needs a filter of its own, level sound is sorted into ``groups``:
the plane's harmonics of first order, or SECTORS directions of a head.

Channels of a receiver that tells directions: the response of a pair, part by part from where it comes.

Direct sound comes from the source, the ground's from its image, a trunk's level from its axis, noise of what
trunks turned from all sides level, noise of what branches or leaves turned from all sides in space: each
direction with noise of its own, so that two ears hear it as alike as a diffuse field lets them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...base.rng import stream
from ...formats.sofa import read_head
from ...spec import Reverb
from .auralise import resample
from .channels import ImpulseResponse
from .forest.tail import FADE
from .pair import Pair
from .sums.fast_scattering import Expansions

SECTORS = 36  # directions of level sound that a head tells apart
AROUND = 60  # directions in space that noise comes from
AMBISONICS = ("W", "Y", "Z", "X")


class Hearing:
    """Hearing of one microphone that is the same to all sides."""

    names: tuple[str, ...] = ("",)

    def taps(self, way: np.ndarray) -> np.ndarray:
        """(C, K) response to sound from where (3,) points, of any length."""
        return np.ones((1, 1))

    def groups(self, azimuth: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Groups that level sound from azimuths (M,) in radians is sorted into: gains (M,), 0 where a trunk
        is not in it, and (C, K) what every channel hears of it."""
        return [(np.ones(len(azimuth)), np.ones((1, 1)))]

    def noise(self) -> list[tuple[float, float, np.ndarray]]:
        """Parts of the noise, each independent of the others, from one direction or of one harmonic: share of
        the energy of level noise, and of noise from all sides, and (C, K) what every channel hears of it."""
        return [(1.0, 1.0, np.ones((1, 1)))]


@dataclass(frozen=True)
class Ambisonics(Hearing):
    """First order; azimuth : radians, where x points."""

    azimuth: float
    names = AMBISONICS

    def taps(self, way: np.ndarray) -> np.ndarray:
        ahead, left, up = _faced(way, self.azimuth)
        return np.array([[1.0], [left], [up], [ahead]])

    def groups(self, azimuth: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        turn = azimuth - self.azimuth
        gains = (np.ones(len(turn)), np.sin(turn), np.cos(turn))
        return [(gain, np.eye(4)[:, [row]]) for gain, row in zip(gains, (0, 1, 3), strict=True)]

    def noise(self) -> list[tuple[float, float, np.ndarray]]:
        shares = ((1.0, 1.0), (1 / 2, 1 / 3), (0.0, 1 / 3), (1 / 2, 1 / 3))  # means of squares
        return [(*share, np.eye(4)[:, [row]]) for row, share in enumerate(shares)]


@dataclass(frozen=True)
class MeasuredHead(Hearing):
    """MeasuredHead of a file.

    azimuth : radians, where it faces. directions : (D, 3) unit vectors, x ahead and y to the left.
    responses : (D, 2, K) of the left and the right ear, at the reverb's rate.
    """

    azimuth: float
    directions: np.ndarray
    responses: np.ndarray
    names = ("left", "right")

    def taps(self, way: np.ndarray) -> np.ndarray:
        return self._nearest(_faced(way, self.azimuth))

    def _nearest(self, way: np.ndarray) -> np.ndarray:
        return self.responses[int(np.argmax(self.directions @ way))]

    def groups(self, azimuth: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        sector = np.round((azimuth - self.azimuth) * (SECTORS / (2.0 * math.pi))) % SECTORS
        return [
            ((sector == number).astype(np.float64), self._nearest(way))
            for number, way in enumerate(_level())
        ]

    def noise(self) -> list[tuple[float, float, np.ndarray]]:
        level = [(1 / SECTORS, 0.0, self._nearest(way)) for way in _level()]
        return level + [(0.0, 1 / AROUND, self._nearest(way)) for way in _spread(AROUND)]


OMNI_EAR = Hearing()


def hearing_of(reverb: Reverb, folder: Path) -> Hearing:
    """Hearing of receivers; ``folder`` is where the name of the head's file starts from.

    Raises
    ------
    SpecError : the file cannot be used, or what reads it is missing.
    """
    azimuth = math.radians(reverb.head_azimuth_deg)
    if reverb.heard_as == "ambisonics":
        return Ambisonics(azimuth)
    if reverb.heard_as == "omni":
        return OMNI_EAR
    head = read_head(folder / reverb.head_file)
    count, ears, length = head.responses.shape
    flat = resample(
        np.moveaxis(head.responses, 2, 0).reshape(length, -1), head.sample_rate, reverb.sample_rate
    )
    flat = flat * (head.sample_rate / reverb.sample_rate)  # sums over samples stay, as of a filter
    return MeasuredHead(azimuth, head.directions, np.moveaxis(flat.reshape(-1, count, ears), 0, 2))


def _faced(way: np.ndarray, azimuth: float) -> np.ndarray:
    """(3,) unit vector along ``way``, in parts ahead, to the left and up; ahead where it has no length."""
    size = float(np.linalg.norm(way))
    x, y, z = way / size if size > 0 else np.array([1.0, 0.0, 0.0])
    c, s = math.cos(azimuth), math.sin(azimuth)
    return np.array([x * c + y * s, y * c - x * s, z])


def _level() -> np.ndarray:
    """(SECTORS, 3) level directions, from ahead to the left."""
    turn = 2.0 * math.pi * np.arange(SECTORS) / SECTORS
    return np.column_stack([np.cos(turn), np.sin(turn), np.zeros(SECTORS)])


def _spread(count: int) -> np.ndarray:
    """(N, 3) directions evenly over the sphere (a spiral by the golden angle)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.arange(count) * (math.pi * (3.0 - math.sqrt(5.0)))
    level = np.sqrt(1.0 - z**2)
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), z])


def encoded(
    pair: Pair, plain: ImpulseResponse, hearing: Hearing, expansions: Expansions
) -> list[ImpulseResponse]:
    """Channels of a receiver that hears what ``plain`` is of one microphone."""
    if hearing is OMNI_EAR:
        return [plain]
    count, size = len(plain.direct), len(hearing.names)
    way = pair.source - pair.receiver
    direct = _through(plain.direct, hearing.taps(way))
    ground = _through(plain.ground, hearing.taps(way - np.array([0.0, 0.0, 2.0 * pair.source[2]])))
    tail = pair.tail(expansions)
    noise = np.zeros((size, count))
    kept, last = np.ones(count), math.inf
    if tail is not None:
        kept = tail.kept(np.arange(count) * (pair.air.speed() / plain.sample_rate))
        last = FADE * tail.joint
        blocks = tail.blocks(plain.sample_rate, count, pair.air)
        for number, (level, space, taps) in enumerate(hearing.noise()):
            more = (number,) if number else ()  # the first has the noise of ``plain``
            rng = stream(int(pair.key[0]), *pair.key[1:], "tail", *more)
            noise += _through(blocks.samples(rng, level, space), taps)
    trees = noise.copy()
    forest = pair.loud[0]
    azimuth = np.arctan2(*(forest.position - pair.receiver[:2]).T[::-1])
    single = plain.trees if plain.tail is None else plain.trees - plain.tail
    for gain, taps in hearing.groups(azimuth):
        rows = np.flatnonzero(gain)
        samples = single
        if len(rows) < len(forest) or not (gain == 1.0).all():
            if not len(rows):
                continue
            response = pair.trees(forest.select(rows), expansions, None, last, gain[rows])
            samples = response.samples * kept
        trees += _through(samples, taps)
    keep = plain if (hearing.taps(way)[0] != 1.0).any() else None  # W is a microphone's already
    return [
        replace(
            plain,
            direct=direct[row],
            ground=ground[row],
            trees=trees[row],
            tail=noise[row] if plain.tail is not None else None,
            channel=f"{plain.channel} {name}",
            component=row,
            plain=keep if row == 0 else None,
        )
        for row, name in enumerate(hearing.names)
    ]


def _through(samples: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """(C, N) samples (N,) through filters (C, K)."""
    if taps.shape[1] == 1:
        return taps * samples
    from scipy.signal import fftconvolve  # here: it takes half a second to import

    return fftconvolve(samples[None], taps, axes=1)[:, : len(samples)]
