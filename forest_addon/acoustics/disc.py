"""How a leaf scatters sound back: a rigid disc of radius a.

The size ka and the angle of incidence (between the disc's normal and the direction of the sound) go
in; the far-field scattering amplitude f comes out, as L = k|f| or as the complex number k·f. In the
far field the echo's pressure is p = p₀·f·exp(-ikr)/r (e^{+iωt}), p₀ the incident pressure at the disc.

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

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

MODELS = ("piston", "paper")

# What physical optics can reach beyond its main lobe: |2J₁(x)/x| <= 1.6501·x^{-3/2} for every x > 0,
# from max √x·|J₁(x)| = 0.82503 at x = 2.1659.
LOBE_DECAY = 1.6501


def backscatter(ka: ArrayLike, incidence: ArrayLike, model: str = "piston") -> np.ndarray:
    """L = k|f|, dimensionless, of sound scattered back to where it came from; never negative.

    ka : wavenumber times radius, 0 or larger; a disc of size 0 scatters nothing.
    incidence : radians between the disc's normal and the sound, any value: a disc has two faces.
    model : one of ``MODELS``.

    Raises
    ------
    ValueError : the model is not known.
    """
    return np.abs(backscatter_amplitude(ka, incidence, model))


def backscatter_amplitude(ka: ArrayLike, incidence: ArrayLike, model: str = "piston") -> np.ndarray:
    """The complex k·f of ``backscatter`` under e^{+iωt}; same arguments."""
    size, angle = np.asarray(ka, dtype=np.float64), _acute(incidence)
    if model == "piston":
        return 1j * _piston(size, angle)
    if model == "paper":
        return _paper(size, angle)
    known = ", ".join(f'"{name}"' for name in MODELS)
    raise ValueError(f'leaf model "{model}" is not known; use one of {known}')


def amplitude_bound(
    lowest: float, highest: float, radius: np.ndarray, incidence: np.ndarray, model: str
) -> np.ndarray:
    """A bound on |f| in metres that holds for every wavenumber from ``lowest`` to ``highest`` (1/m).

    radius, incidence : metres and radians, broadcasting.

    For the piston k a²/2·cosβ, largest at the highest k, times the decay of the side lobes, largest at
    the lowest. For the paper P₁(ka)/k, which is convex in k, so that its larger end is its maximum.
    """
    radius, angle = np.asarray(radius, dtype=np.float64), _acute(incidence)
    if model == "paper":
        ends = [_paper_peak(k * radius) / k for k in (lowest, highest)]
        return np.where(radius > 0, np.maximum(*ends), 0.0)
    face: np.ndarray = 0.5 * highest * radius**2 * np.cos(angle)
    with np.errstate(divide="ignore"):
        lobes = LOBE_DECAY * (2.0 * lowest * radius * np.sin(angle)) ** -1.5
    return face * np.minimum(lobes, 1.0)


def _acute(incidence: ArrayLike) -> np.ndarray:
    """Angles folded to 0 … π/2: either face, either side of the normal."""
    turned = np.mod(np.asarray(incidence, dtype=np.float64), math.pi)
    folded: np.ndarray = np.minimum(turned, math.pi - turned)
    return folded


def _piston(ka: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """k·f/i of physical optics; negative in every other side lobe."""
    return 0.5 * ka**2 * np.cos(angle) * jinc(2.0 * ka * np.sin(angle))


def jinc(x: ArrayLike) -> np.ndarray:
    """2·J₁(x)/x, 1 at x = 0."""
    x = np.asarray(x, dtype=np.float64)
    small = np.abs(x) < 1e-4  # the series is exact to rounding here, and 0/0 is avoided
    safe = np.where(small, 1.0, x)
    value: np.ndarray = np.where(small, 1.0 - x * x / 8.0, 2.0 * special.j1(safe) / safe)
    return value


def _paper(ka: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """L·e^{-i·phase} of the paper's fit, L with its sign."""
    empty = ka == 0  # the fit does not vanish there, and its angle factor has no limit
    c = np.where(empty, 1.0, ka)
    size = _paper_peak(c) * np.cos((0.3999 * c**-0.9065 + 0.9979) * angle)
    phase = special.erf((0.9824 * c**0.3523 - 0.9459) * (math.pi / 2 - angle)) - 2.6343
    value: np.ndarray = np.where(empty, 0.0, size * np.exp(-1j * phase))
    return value


def _paper_peak(c: np.ndarray) -> np.ndarray:
    return 0.5003 * c * c + 0.6867
