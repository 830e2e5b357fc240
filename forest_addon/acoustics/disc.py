"""Scattering of sound by a leaf: a rigid disc of radius a.

The size ka and the angle of incidence (between the disc's normal and the direction of the sound) go
in; the far-field scattering amplitude f comes out, as L = k|f| or as the complex number k·f. In the
far field the echo's pressure is p = p₀·f·exp(-ikr)/r (e^{+iωt}), p₀ the incident pressure at the disc.

``exact``   the sound-hard disc. Straight back it comes from a table (``disc_table``),
            within 1e-5 of its value at normal incidence up to ka = 120; until 128 the table passes over
            to the disc's rims as edges of hard half planes (Keller; Ufimtsev), whose sum is
            k·f = i·(ka)²/2·2J₁(x)/x - ka/2·J₀(x), x = 2ka·sinβ. That is within 1e-3 of normal incidence;
            relative to itself (rms) 10 to 20 % off the normal, 24 % up to 69°, 40 % up to 80° and of no
            use at grazing, since nothing of what crosses the face is in it; it gets better as (ka)^-½.
``piston``  physical optics (Kirchhoff): the lit face reflects as an endless hard mirror would,
            k·f = i·(ka)²/2 · cosβ · 2J₁(x)/x with x = 2ka·sinβ, for sound sent and heard at one place.
            It is right for ka >> 1 away from grazing; against the exact disc it is 1.5 dB low at ka = 5
            (rms over directions), 0.15 dB at 32.
``paper``   the fit of Tanveer et al. 2020 (PLOS ONE 15(11) e0241443): L = P₁(ka)·cos(P₂(ka)·β) with a
            phase. Its beam is that of the mirror direction, so that a large leaf at a random angle is
            11 to 28 dB too loud. L is negative near grazing for ka < 327; the authors clip it at 0, which
            puts a kink into the spectrum, and we do not.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from .. import kernels
from .chebyshev import Cubics
from .disc_table import (
    HANDOVER,
    LAST,
    MARGIN,
    STEPS,
    bound_maxima,
    by_incidence,
    tabulated,
    tabulated_bound,
)

MODELS = ("paper", "piston", "exact")

LOBES = 256  # of J₁ whose heights are known to the bound
STEEPEST = (-1.5, 6.0)  # of the error function of the paper's phase: below never, beyond it is 1
SMALLEST = 6.0  # argument of the Hankel function from where it is smooth but for its phase


def backscatter(ka: ArrayLike, incidence: ArrayLike, model: str = "exact") -> np.ndarray:
    """L = k|f|, dimensionless, of sound scattered back to where it came from; never negative.

    ka : wavenumber times radius, 0 or larger; a disc of size 0 scatters nothing.
    incidence : radians between the disc's normal and the sound, any value: a disc has two faces.
    model : one of ``MODELS``.

    Raises
    ------
    ValueError : the model is not known.
    """
    return np.abs(backscatter_amplitude(ka, incidence, model))


def backscatter_amplitude(ka: ArrayLike, incidence: ArrayLike, model: str = "exact") -> np.ndarray:
    """The complex k·f of ``backscatter`` under e^{+iωt}; same arguments."""
    size, angle = np.asarray(ka, dtype=np.float64), _acute(incidence)
    if model == "exact":
        return _exact(size, angle)
    if model == "piston":
        return 1j * _piston(size, angle)
    if model == "paper":
        return _paper(size, angle)
    raise _unknown(model, MODELS)


def disc_amplitudes(
    wavenumber: np.ndarray,
    radius: np.ndarray,
    incidence: np.ndarray,
    factor: np.ndarray,
    model: str,
    later: np.ndarray | float = 0.0,
    side: np.ndarray | None = None,
) -> np.ndarray:
    """(Q, M) complex f in metres at wavenumbers (Q,) of discs (M,), times a factor (M,); incidence from 0 to
    π/2. later : (M,) or one, radii by which the echo's delay is taken to be later.

    side : (M,) int8, of a piston's rim the one place that sounds, without its delay: half of J₁ = Re H₁, H₁
    the Hankel function; -1 the place nearer to the sonar, 1 the farther, both 2ka·sinβ > ``SMALLEST``; 0:
    all of the disc.

    Raises
    ------
    ValueError : the model is not known.
    """
    library = kernels.library()
    if library is None or model not in MODELS:
        k = wavenumber[:, None]
        turn = np.exp(1j * later * k * radius)
        amplitudes = backscatter_amplitude(k * radius, incidence, model) * turn * (factor / k)
        some = np.flatnonzero(0 if side is None else side)
        if side is not None and len(some):
            amplitudes[:, some] = factor[some] * _rims(k, radius[some], incidence[some], side[some])
        return np.asarray(amplitudes)
    amplitudes = np.empty((len(wavenumber), len(radius)), np.complex128)
    given = (len(wavenumber), wavenumber, len(radius), radius, incidence, factor)
    if model == "paper":
        library.paper_discs(*given, *_paper_phasors().given, amplitudes)
    elif model == "piston":
        side = np.zeros(len(radius), np.int8) if side is None else side
        library.piston_discs(*given, side, *_hankel().given[2:], amplitudes)
    else:
        late, table = np.full(len(radius), later), by_incidence()
        library.exact_discs(
            *(*given, late, np.array(STEPS), MARGIN, table.shape[1], table, amplitudes)
        )
        large = np.flatnonzero(wavenumber.max(initial=0.0) * radius > HANDOVER)
        if len(large):
            size, some = wavenumber[:, None] * radius[large], incidence[large]
            turn = np.exp(1j * late[large] * size) * (factor[large] / wavenumber[:, None])
            amplitudes[:, large] = _exact(size, some) * turn
    return amplitudes


def _rims(k: np.ndarray, radius: np.ndarray, angle: np.ndarray, side: np.ndarray) -> np.ndarray:
    """(Q, M) i·c·H₁(x)e^{-ix} at the near side (-1), i·c times the conjugate at the far one (1), c·2J₁(x) the
    piston's f/i."""
    across = radius * np.sin(angle)
    wave = special.hankel1e(1, 2.0 * k * across)
    level = 0.25 * radius**2 * np.cos(angle) / across
    return 1j * level * np.where(side < 0, wave, np.conj(wave))


@lru_cache(maxsize=1)
def _hankel() -> Cubics:
    """√x·H₁⁽¹⁾(x)e^{-ix} over ``SMALLEST``/x."""

    def rooted(share: np.ndarray) -> np.ndarray:
        x = SMALLEST / share
        return np.asarray(special.hankel1e(1, x) * np.sqrt(x))

    return Cubics.of(rooted, 0.0, 1.0, 1024)


@lru_cache(maxsize=1)
def _paper_phasors() -> Cubics:
    """The paper's phasor over the argument of its error function."""
    return Cubics.of(_paper_phasor, *STEEPEST, 4096)


def amplitude_bound(
    lowest: float, highest: float, radius: ArrayLike, incidence: ArrayLike, model: str
) -> np.ndarray:
    """A bound on |f| in metres that holds for every wavenumber from ``lowest`` to ``highest`` (1/m).

    radius, incidence : metres and radians from 0 to π/2, broadcasting.

    At normal incidence it also holds for every smaller radius and every other incidence.
    """
    size, angle = np.broadcast_arrays(*(np.asarray(v, np.float64) for v in (radius, incidence)))
    if model == "paper":
        return _paper_bound(lowest, highest, size, angle)
    if model not in MODELS:
        raise _unknown(model, MODELS)
    if model == "piston":
        return np.cos(angle) * _piston_bound(lowest, highest, size, angle)
    inside = tabulated_bound(lowest * size, np.minimum(highest * size, LAST), angle)
    bound: np.ndarray = np.where(lowest * size < LAST, size * inside, 0.0)
    large = highest * size > HANDOVER
    size, angle = size[large], angle[large]
    with np.errstate(divide="ignore"):
        rim = np.minimum(1.0, (math.pi * lowest * size * np.sin(angle)) ** -0.5)  # |J₀|
    optics = _piston_bound(lowest, highest, size, angle)
    bound[large] = np.maximum(bound[large], optics + 0.5 * size * rim)
    return bound


def bound_tables(model: str) -> tuple[Any, ...]:
    """Arguments of the kernel that bounds discs: the model, its lobes, and its tables."""
    lobes = np.array(_lobes())
    maxima = bound_maxima() if model == "exact" else np.zeros((1, 1, 1), np.float32)
    tables = MARGIN, *maxima.shape[1:], maxima
    return MODELS.index(model), lobes.shape[1], lobes, *_hankel().given[2:], *tables


def _acute(incidence: ArrayLike) -> np.ndarray:
    """Angles folded to 0 … π/2: either face, either side of the normal."""
    turned = np.mod(np.asarray(incidence, dtype=np.float64), math.pi)
    return np.asarray(np.minimum(turned, math.pi - turned))


def jinc(x: ArrayLike) -> np.ndarray:
    """2·J₁(x)/x, 1 at x = 0."""
    size = np.maximum(np.abs(np.asarray(x, dtype=np.float64)), 1e-9)  # 1 to rounding, and not 0/0
    value: np.ndarray = special.j1(size)
    return 2.0 * value / size


def _exact(ka: np.ndarray, angle: np.ndarray) -> np.ndarray:
    value = tabulated(ka, angle)
    if np.any(ka > HANDOVER):
        sizes, angles = np.broadcast_arrays(ka, angle)
        large = sizes > HANDOVER
        passed = np.minimum((sizes[large] - HANDOVER) / (LAST - HANDOVER), 1.0)
        share = 0.5 + 0.5 * np.cos(math.pi * passed)
        value[large] = share * value[large] + (1.0 - share) * _large(sizes[large], angles[large])
    return value


def _large(ka: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """k·f for ka >> 1: both rims as edges of hard half planes (Keller), joined at the caustic."""
    across = 2.0 * ka * np.sin(angle)
    value: np.ndarray = 0.5j * ka**2 * jinc(across) - 0.5 * ka * special.j0(across)
    value *= -np.expm1(
        -0.5 * ka * np.cos(angle) ** 2
    )  # at grazing what crosses the face cancels it
    return value


def _piston(ka: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """k·f/i of physical optics; negative in every other side lobe."""
    return 0.5 * ka**2 * np.cos(angle) * jinc(2.0 * ka * np.sin(angle))


def _piston_bound(
    lowest: float, highest: float, radius: np.ndarray, angle: np.ndarray
) -> np.ndarray:
    """Largest |f|/cosβ of physical optics: k·|J₁(x)/x|, x = 2ka·sinβ, at the ends of the band, or at
    the first peak of |J₁| between them; the later ones are lower."""
    across = 2.0 * radius * np.sin(angle)
    largest = np.maximum(*(k * np.abs(jinc(k * across)) for k in (lowest, highest)))
    peaks, heights = _lobes()
    following = np.searchsorted(peaks[:-1], lowest * across)  # the next peak
    within = peaks[following] < highest * across
    inner = 2.0 * heights[following] / np.where(within, across, np.inf)
    return np.asarray(0.5 * radius**2 * np.maximum(largest, inner))


@lru_cache(maxsize=1)
def _lobes() -> tuple[np.ndarray, np.ndarray]:
    """Positions of the peaks of |J₁| and their heights; after the last, always the height of the last."""
    peaks = special.jnp_zeros(1, LOBES)
    heights = np.abs(special.j1(peaks))
    return np.append(peaks, 0.0), np.append(heights, heights[-1])


def _paper(ka: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """L·e^{-i·phase} of the paper's fit, L with its sign; phase = erf(steepness·(π/2 - β)) - 2.6343."""
    empty = ka == 0  # the fit does not vanish there, and its angle factor has no limit
    c = np.where(empty, 1.0, ka)
    log = np.log(c)
    size = np.where(empty, 0.0, _paper_peak(c) * np.cos(_paper_turn(log) * angle))
    steepness = 0.9824 * np.exp(0.3523 * log) - 0.9459
    return np.asarray(size * _paper_phasor(steepness * (math.pi / 2 - angle)))


def _paper_phasor(x: np.ndarray) -> np.ndarray:
    """e^{-i·phase} of the paper by the argument of its error function."""
    return np.asarray(np.exp(-1j * (special.erf(x) - 2.6343)))


def _paper_bound(
    lowest: float, highest: float, radius: np.ndarray, angle: np.ndarray
) -> np.ndarray:
    """P₁(ka)/k, convex in k, at its larger end, times |cos| where it is the largest: P₂ falls with k."""
    empty = radius == 0
    ends = [k * np.where(empty, 1.0, radius) for k in (highest, lowest)]
    peak = np.maximum(_paper_peak(ends[0]) / highest, _paper_peak(ends[1]) / lowest)
    low, high = (_paper_turn(np.log(c)) * angle for c in ends)
    crest = np.ceil(low / math.pi) <= np.floor(high / math.pi)
    wave = np.where(crest, 1.0, np.maximum(np.abs(np.cos(low)), np.abs(np.cos(high))))
    return np.asarray(np.where(empty, 0.0, peak * wave))


def _paper_peak(ka: np.ndarray) -> np.ndarray:
    return np.asarray(0.5003 * ka * ka + 0.6867)


def _paper_turn(log: np.ndarray) -> np.ndarray:
    """P₂ of the logarithm of ka."""
    return np.asarray(0.3999 * np.exp(-0.9065 * log) + 0.9979)


def _unknown(model: str, models: tuple[str, ...]) -> ValueError:
    known = ", ".join(f'"{name}"' for name in models)
    return ValueError(f'leaf model "{model}" is not known; use one of {known}')
