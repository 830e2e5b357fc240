"""A ping at foliage: the echo of all leaves, as a bat-like sonar hears it (T20).

Leaf discs go in; the echo's spectrum and impulse response come out. With f_i the leaf's scattering
amplitude (``acoustics/disc``), S the beam, once for sending and once for hearing, b the absorption of
the air and r_i the distance,

    Y(f) = Σ_i S_i²·f_i(k)/r_i²·e^{-2b(f)r_i}·e^{-i2kr_i}

is the echo's pressure relative to the sent one at 1 m on the axis; S·L·λ/(2πr²) of T20 is the same.

The impulse response is the echo of a call whose spectrum is a Hann window over the band and whose
envelope at 1 m on the axis has the peak 1. So a leaf gives a pulse at 2r/c with the height of its |A|,
averaged over the band. The record reaches past the farthest leaf that is heard, and past the pulse's
tails (``TAILS``): nothing wraps around.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft

from ..spec import Air, Sonar
from .discs import LeafDiscs, leaf_discs
from .foliage import Grid, Scatterers, amplitudes, audible, sum_echoes
from .rays import RayCaster

__all__ = ["Echo", "LeafDiscs", "leaf_discs", "ping"]

Progress = Callable[[int, int], None]

# What became of a leaf.
HEARD, WEAK, HIDDEN, NEAR, FAR, BROKEN = range(6)

TAILS = (
    64.0  # pulse tails in periods of the bandwidth: the Hann pulse has fallen to 1/(π·64³) = 1e-6
)
MARGIN = 1e-3  # m; wood so close before a leaf is what it grows on
LEAVES_AT_ONCE = 1024  # in the search for the loudest
COARSE = 33  # frequencies of that search
MOST_SAMPLES = 2**27


@dataclass(frozen=True)
class Echo:
    """The echo of one ping; pressures are relative to what was sent, at 1 m on the axis.

    frequency : (K,) Hz, the band. spectrum : (K,) complex, the transfer function, not windowed.
    time : (N,) s after the call. impulse_response : (N,). envelope : (N,) of its analytic signal.
    fate : (L,) int8 of each leaf: ``HEARD``; ``WEAK``, left out because it adds next to nothing;
    ``HIDDEN`` by wood; ``NEAR`` or ``FAR``, outside the limits of range; ``BROKEN``, not finite.
    amplitude : (L,) mean |A| over the band (Hann) of each leaf that is heard, else 0.
    cull_bound : all weak leaves together add at most this share of Σ|A| of those heard, at every
    frequency of the band.
    """

    frequency: np.ndarray
    spectrum: np.ndarray
    time: np.ndarray
    impulse_response: np.ndarray
    envelope: np.ndarray
    fate: np.ndarray
    amplitude: np.ndarray
    cull_bound: float
    sound_speed: float
    sample_rate: float

    @property
    def leaves(self) -> int:
        """How many leaves the scene has."""
        return len(self.fate)

    @property
    def heard(self) -> np.ndarray:
        """(L,) bool, whether a leaf is in the sum."""
        mask: np.ndarray = self.fate == HEARD
        return mask

    @property
    def weak(self) -> int:
        """How many leaves were left out because they add next to nothing."""
        return int(np.count_nonzero(self.fate == WEAK))

    @property
    def hidden(self) -> int:
        """How many leaves wood hides."""
        return int(np.count_nonzero(self.fate == HIDDEN))

    @property
    def near(self) -> int:
        """How many leaves are nearer than the near limit."""
        return int(np.count_nonzero(self.fate == NEAR))

    @property
    def far(self) -> int:
        """How many leaves are beyond the range."""
        return int(np.count_nonzero(self.fate == FAR))

    @property
    def broken(self) -> int:
        """How many leaves have coordinates that are not finite."""
        return int(np.count_nonzero(self.fate == BROKEN))


def ping(
    discs: LeafDiscs,
    sonar: Sonar,
    air: Air,
    wood: RayCaster | None = None,
    progress: Progress | None = None,
) -> Echo:
    """Send one ping and sum the echo of every leaf.

    wood : what hides leaves if ``sonar.shading`` is "trunks"; None: nothing does.
    progress : called as progress(leaves done, all leaves).

    Raises
    ------
    ValueError : the record would be longer than memory; the sentence says what to change.
    """
    fate = _ranged(discs, sonar)
    low, high = sonar.band
    coarse = Grid.of(low, (high - low) / (COARSE - 1), COARSE, sonar, air)
    leaves = audible(discs, np.flatnonzero(fate == HEARD), sonar, coarse)
    fate[leaves.row] = WEAK
    leaves = leaves.select(slice(np.count_nonzero(leaves.bound)))  # loudest first: 0 is at the end
    search = _Search(leaves, coarse, sonar, wood if sonar.shading == "trunks" else None)
    share = sonar.cull
    while True:
        loudest = search.take(share)
        grid, window, length, samples = _record(loudest, sonar, air)
        spectrum, whole, mean = sum_echoes(loudest, grid, sonar.leaf_model, window, progress)
        if search.rest <= sonar.cull * whole.min():
            break
        # Between the coarse frequencies Σ|A| is smaller than at them: ask for a smaller rest.
        share = 0.9 * sonar.cull * whole.min() / search.whole.min()

    fate[leaves.row[: search.taken]] = np.where(search.visible[: search.taken], HEARD, HIDDEN)
    amplitude = np.zeros(len(discs))
    amplitude[loudest.row] = mean

    analytic = np.zeros(length, dtype=np.complex128)
    first = round(grid.start / grid.spacing)
    analytic[first : first + grid.count] = spectrum * window
    analytic = fft.ifft(analytic, overwrite_x=True)[:samples] * (length / window.sum())
    return Echo(
        frequency=grid.frequency,
        spectrum=spectrum,
        time=np.arange(samples) / sonar.sample_rate,
        impulse_response=np.ascontiguousarray(analytic.real),
        envelope=np.abs(analytic),
        fate=fate,
        amplitude=amplitude,
        cull_bound=search.rest / float(whole.min()) if search.rest > 0 else 0.0,
        sound_speed=grid.sound_speed,
        sample_rate=sonar.sample_rate,
    )


def _ranged(discs: LeafDiscs, sonar: Sonar) -> np.ndarray:
    """(L,) int8: ``NEAR``, ``FAR``, ``BROKEN``, else ``HEARD`` for now."""
    distance = np.linalg.norm(discs.centre - np.asarray(sonar.position), axis=1)
    fate = np.full(len(discs), HEARD, dtype=np.int8)
    fate[distance < sonar.near_limit] = NEAR
    fate[distance > sonar.max_range] = FAR
    sound = (
        np.isfinite(distance) & np.isfinite(discs.radius) & np.isfinite(discs.normal).all(axis=1)
    )
    fate[~sound] = BROKEN
    return fate


class _Search:
    """Takes leaves in order of their bounds until those not taken can add next to nothing.

    taken : how many. visible : (M,) which of them wood does not hide. rest : sum of the bounds of those
    not taken. whole : (COARSE,) Σ|A| of the visible ones.
    """

    def __init__(
        self, leaves: Scatterers, coarse: Grid, sonar: Sonar, wood: RayCaster | None
    ) -> None:
        self._leaves, self._coarse, self._wood = leaves, coarse, wood
        self._position, self._model = np.asarray(sonar.position, np.float64), sonar.leaf_model
        self._rest = np.append(np.cumsum(leaves.bound[::-1])[::-1], 0.0)
        self.taken = 0
        self.visible = np.zeros(len(leaves), dtype=bool)
        self.whole = np.zeros(coarse.count)

    @property
    def rest(self) -> float:
        return float(self._rest[self.taken])

    def take(self, share: float) -> Scatterers:
        """The visible ones so far, when ``rest`` is at most ``share`` of Σ|A| at its least."""
        while self.rest > share * self.whole.min():
            rows = slice(self.taken, min(self.taken + LEAVES_AT_ONCE, len(self._leaves)))
            leaves = self._leaves.select(rows)
            self.visible[rows] = self._seen(leaves)
            sizes = np.abs(amplitudes(leaves.select(self.visible[rows]), self._coarse, self._model))
            self.whole += sizes.sum(axis=1)
            self.taken = rows.stop
        return self._leaves.select(np.flatnonzero(self.visible[: self.taken]))

    def _seen(self, leaves: Scatterers) -> np.ndarray:
        if self._wood is None:
            return np.ones(len(leaves), dtype=bool)
        origins = np.broadcast_to(self._position, (len(leaves), 3))
        reach = np.maximum(leaves.distance - MARGIN, 0.0)
        return ~self._wood.occluded(origins, leaves.direction, reach)


def _record(leaves: Scatterers, sonar: Sonar, air: Air) -> tuple[Grid, np.ndarray, int, int]:
    """The band's frequencies for a record that holds these leaves, their Hann window (K,), the length
    of the transform, and how many of its samples are the record (the rest is time before the call)."""
    low, high = sonar.band
    rate = sonar.sample_rate
    tail = TAILS / (high - low)
    farthest = 2.0 * float(leaves.distance.max(initial=0.0)) / air.speed()
    needed = (farthest + 2.0 * tail) * rate
    if needed > MOST_SAMPLES:
        raise ValueError(
            f"the echo would have {needed:.2g} samples; "
            "widen the band, or lower max_range or sample_rate"
        )
    length = fft.next_fast_len(math.ceil(needed))
    spacing = rate / length
    first, last = math.ceil(low / spacing), math.floor(high / spacing)
    grid = Grid.of(first * spacing, spacing, last - first + 1, sonar, air)
    window = 0.5 - 0.5 * np.cos(2.0 * math.pi * (grid.frequency - low) / (high - low))
    return grid, window, length, math.ceil((farthest + tail) * rate)
