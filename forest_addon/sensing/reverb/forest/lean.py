"""Coherence that leaning trunks leave between a path by way of them and the same path by way of the ground.

Heights of both ends, how far trunks lean and a path's length and wavenumber go in; Γ from 1 (upright) to 0
goes out. In the mirrored space over a level ground a trunk that leans by the slope t has a kink at z = 0: its
axis is displaced by t·|z|, and a way that meets it at z, turned by φ, is longer by τ·|z|, τ = t·(ŝ - ŝ')
of its level directions. Along the axis the way grows by (z - z₀)²/2ρ, ρ = r_s·r_r/x, so that trunk and way
give Fresnel integrals over both halves,

    U(z₀) = h(z₀) + h(-z₀),  h(z₀) = e^{ik(τz₀ - ρτ²/2)}·½·erfc(-e^{-iπ/4}·√(k/2ρ)·(z₀ - ρτ)),

z₀ the height at which the straight way, or the one to the mirrored receiver, meets an upright trunk. Γ is the
correlation of both U over trunks anywhere on the way, lean in any direction, and φ as a hard, thick
cylinder turns sound (sin(φ/2)/4); sound that meets N trunks keeps Γ^N. Upright, U = 1. Energies |U|² are
1 within 1 dB and taken as 1. The slow turn of a packet's slope, from trunk to trunk, is not in it: over 200 m
it takes 1 dB where trunks lean by 2 degrees.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

if TYPE_CHECKING:
    from scipy.interpolate import RectBivariateSpline

LEANS = 81  # of τ, over REACH of its unit
REACH = 6.5
PLACES = 4  # of trunks along the way
SIZES = np.geomspace(0.01, 8.0, 19)  # kδh; below, -log Γ goes on as a power, beyond, Γ falls as 1/k
REACHES = np.geomspace(0.05, 60.0, 6)  # xδ/h
LEAST, MOST = 1e-3, 1.0 - 1e-12  # of Γ, as tabulated


def lean_coherence(
    wavenumber: np.ndarray,
    path: np.ndarray,
    heights: tuple[float, float],
    lean: float,
    met: np.ndarray,
) -> np.ndarray:
    """Γ; the arguments broadcast.

    path : metres. heights : of both ends. lean : standard deviation of a trunk's slope in each of two
    directions. met : trunks that sound meets on the way, on average; at least one of them it met.
    """
    mean = math.sqrt(heights[0] * heights[1])
    size = np.maximum(wavenumber * (lean * mean), 1e-9)
    reach = np.clip(path * (lean / mean), REACHES[0], REACHES[-1])
    table = _table(round(math.log2(heights[0] / heights[1]), 3))
    inside = np.log(np.clip(size, SIZES[0], SIZES[-1]))
    double = np.exp(table.ev(*np.broadcast_arrays(inside, np.log(reach))))
    power = table.ev(math.log(SIZES[0]), np.log(reach), dx=1)
    below, above = np.minimum(size / SIZES[0], 1.0), np.maximum(size / SIZES[-1], 1.0)
    once = np.exp(-double * below**power) / above
    several = np.maximum(met, 1e-6)
    return np.asarray(
        np.exp(-several * (1.0 - once)) * -np.expm1(-several * once) / -np.expm1(-several)
    )


@lru_cache(maxsize=16)
def _table(ratio: float) -> RectBivariateSpline:
    """log(-log Γ) by the logarithms of kδh and xδ/h, of ends whose heights are as 2^ratio."""
    from scipy.interpolate import RectBivariateSpline  # here: other sensors need not wait for it

    low, high = 2.0 ** (0.5 * ratio), 2.0 ** (-0.5 * ratio)
    found = np.array(
        [[_once(size, reach, low, high) for reach in REACHES.tolist()] for size in SIZES.tolist()]
    )
    values = np.log(-np.log(np.clip(found, LEAST, MOST)))
    return RectBivariateSpline(np.log(SIZES), np.log(REACHES), values, kx=3, ky=3)


def _once(wavenumber: float, path: float, low: float, high: float) -> float:
    """Γ of one trunk of unit lean, in units of the ends' mean height."""
    slope, weight = _slopes()
    share = (np.arange(PLACES) + 0.5) / PLACES
    bend = path * share * (1.0 - share)  # ρ
    straight = _kinked(low + (high - low) * share, slope, wavenumber, bend)
    bounced = _kinked(low - (low + high) * share, slope, wavenumber, bend)
    both = (weight * straight * bounced.conj()).sum()
    sizes = [(weight * np.abs(one) ** 2).sum() for one in (straight, bounced)]
    return float(np.clip(both.real / math.sqrt(sizes[0] * sizes[1]), 0.0, 1.0))


@lru_cache(maxsize=1)
def _slopes() -> tuple[np.ndarray, np.ndarray]:
    """(LEANS, 1) τ of trunks of unit lean, and their weights: normal times 2·sin(φ/2)."""
    slope = np.linspace(-REACH, REACH, LEANS)
    turn = np.sqrt(1.0 - ((np.arange(64) + 0.5) / 64) ** 2)  # sin(φ/2)
    wide = 2.0 * turn[:, None]
    density = (np.exp(-0.5 * (slope / wide) ** 2) / wide).mean(axis=0)
    return slope[:, None], (density / density.sum() / PLACES)[:, None]


def _kinked(
    place: np.ndarray, slope: np.ndarray, wavenumber: float, bend: np.ndarray
) -> np.ndarray:
    """(LEANS, PLACES) U."""
    found: np.ndarray = np.zeros(1, np.complex128)
    for half in (place, -place):
        turned = np.exp(1j * wavenumber * slope * (half - 0.5 * bend * slope))
        met = np.sqrt(0.5 * wavenumber / bend) * (half - bend * slope)
        found = found + turned * 0.5 * special.erfc(-np.exp(-0.25j * math.pi) * met)
    return found
