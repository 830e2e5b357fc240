"""Trunks that add nothing above the end of a record, and what they could add at most.

Paths go in, the rows of those that may be left out come out. No trunk is louder in an octave up to f₂ than

    |h_m| <= w_m·e^{-b(f₁)x_m}·√(2/πk)·Σ_n ε_n|sin γ_n|,

whatever the angle; n over all orders, the largest of that for sizes up to k₂a. The weakest are left out as
long as the sum of their norms, as if they all were in phase, stays below ``RANGE_DB`` under the expected
energy of all sound in every octave (``record``). ``Weak.bound`` sets that against the sound that came out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import fft

from ....acoustics.air import absorption
from ....acoustics.cylinder import order_count, partial_waves
from ....spec import Air, Reverb
from ..directivity import Directivity
from ..forest.losses import Losses
from ..metrics import octave_bands
from ..trunks.slices import Trunks
from .record import RANGE_DB, arrival_energies
from .scattering import TrunkPaths, trunk_paths
from .tree_response import NEAREST

SIZES = 400  # ka at which the largest answer is computed
WITH_GROUND = 2.0  # times as loud as a path alone is one with its reflection, at most


@dataclass(frozen=True)
class Weak:
    """rows : (M,) bool, which paths may be left out. norms : (B,) that they add at most in each octave."""

    rows: np.ndarray
    norms: np.ndarray

    def bound(self, samples: np.ndarray, sample_rate: float) -> float:
        """Return what is left out adds at most this share of any octave of a sound (N,)."""
        if not self.rows.any():
            return 0.0
        size = fft.next_fast_len(len(samples), real=True)
        power = np.square(np.abs(fft.rfft(samples, size))) * (sample_rate / size)
        frequency = np.arange(len(power)) * (sample_rate / size)
        shares = [0.0]
        for middle, norm in zip(octave_bands(sample_rate), self.norms.tolist(), strict=True):
            low, high = middle / math.sqrt(2), middle * math.sqrt(2)
            heard = math.sqrt(float(power[(frequency >= low) & (frequency < high)].sum()))
            shares.append(norm / heard if heard > 0 else math.inf)
        return max(shares)

    def told(self, samples: np.ndarray, sample_rate: float) -> dict[str, Any]:
        """Return how many there are and their bound, as a response has them."""
        return {
            "weak": int(self.rows.sum()),
            "weak_bound": self.bound(samples, sample_rate),
        }


def weak_between(
    trunks: Trunks,
    source: np.ndarray,
    receiver: np.ndarray,
    reverb: Reverb,
    air: Air,
    losses: Losses | None,
    directivity: Directivity,
    clear: bool,
) -> Weak:
    """Trunks that together add next to nothing between two ends (3,); clear : the direct sound passes."""
    ends, upright = (source[:2], receiver[:2]), losses is not None
    paths = trunk_paths(trunks, *ends, reverb.strength, reverb.spreading, None, upright)
    direct = (max(math.dist(source, receiver), NEAREST),) if clear else ()
    loudest = float(np.abs(directivity.gain).max())
    return weak_trunks(paths, direct, reverb.sample_rate, air, losses, loudest)


def weak_trunks(
    paths: TrunkPaths,
    direct: tuple[float, ...],
    sample_rate: float,
    air: Air,
    losses: Losses | None = None,
    loudest: float = 1.0,
) -> Weak:
    """Paths that together add next to nothing; arguments as of ``arrival_energies``.

    loudest : of the source in any direction, re its axis.
    """
    bands = np.array(octave_bands(sample_rate))
    norms = _largest(paths, bands, air) * loudest
    norms *= WITH_GROUND if losses is not None else 1.0
    energies, unscattered = arrival_energies(paths, direct, sample_rate, air, losses)
    whole = np.sqrt((energies.sum(axis=1) + unscattered) * math.sqrt(0.5))  # an octave is f/√2 wide
    allowed = 10 ** (-RANGE_DB / 20) * whole
    share = np.divide(
        norms, allowed[:, None], out=np.full(norms.shape, np.inf), where=allowed[:, None] > 0
    ).max(axis=0, initial=0.0)
    order = np.argsort(share, kind="stable")
    rows = np.zeros(len(share), dtype=bool)
    rows[order[np.cumsum(share[order]) <= 1.0]] = True
    return Weak(rows, norms[:, rows].sum(axis=1))


def _largest(paths: TrunkPaths, bands: np.ndarray, air: Air) -> np.ndarray:
    """(B, M) norms over octaves that no angle exceeds."""
    low, high = bands / math.sqrt(2), bands * math.sqrt(2)
    k = 2.0 * math.pi * high / air.speed()
    thickest = max(1e-3, float((k.max(initial=0.0) * paths.radius).max(initial=0.0)))
    size = np.geomspace(1e-5, thickest * 1.001, SIZES)
    waves = np.abs(partial_waves(size, order_count(thickest)))
    answer = (waves[0] + 2.0 * waves[1:].sum(axis=0)) * np.sqrt(2.0 / (math.pi * size))
    answer = np.maximum.accumulate(answer)  # of all sizes up to each
    loss = absorption(low, air.temperature_c, air.humidity, air.pressure_kpa)
    norms = np.empty((len(bands), len(paths.length)))
    for row in range(len(bands)):
        above = np.searchsorted(size, k[row] * paths.radius)  # the next larger: never too small
        norms[row] = answer[np.minimum(above, SIZES - 1)] * np.sqrt(paths.radius)
        norms[row] *= np.abs(paths.weight) * np.exp(-loss[row] * paths.length)
        norms[row] *= math.sqrt(high[row] - low[row])
    return norms
