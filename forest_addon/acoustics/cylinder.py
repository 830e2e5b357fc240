"""Scattering of sound by a trunk: an endless, sound-hard, upright cylinder of radius a.

The size ka and the angle by which the sound is turned go in (0 straight on, π straight back), the far
field comes out (Morse & Ingard, Theoretical Acoustics, 8.1; Kaneko & Gamper 2021, their H):

    S(ka, φ) = Σ_{n>=0} ε_n sinγ_n e^{iγ_n} cos nφ,   tanγ_n = J_n'(ka)/Y_n'(ka),   ε₀ = 1, else 2.

``scattering_sum`` is S in the books' convention, e^{-iωt}; ``transfer`` is in ours, e^{+iωt}: the
pressure at the distance r is p₀·H·e^{-ikr}/√r with H = conj(e^{iπ/4}·√(2/πk)·S).

sinγ·e^{iγ} = J'(Y' + iJ')/(J'² + Y'²) needs no arctangent and is finite where Y' is zero. J comes from
the downward and Y from the upward recurrence, the stable direction of each (DLMF 10.74(iv)), both
anchored in scipy's orders 0 and 1; there is no NaN where scipy's own high orders have one.

Bark that absorbs is an impedance boundary, ∂p/∂r = -ikβp under e^{-iωt}: J' and Y' become J' + iβJ and
Y' + iβY. β is real, from the share that a wave head on loses, 4β/(1 + β)², times (ka)²/(1 + (ka)²): a
layer that is thin against the wave does not absorb.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

RAYLEIGH = 1e-8  # below this ka the leading terms are exact to rounding
OVERFLOW = 1e150  # where the downward recurrence is scaled down
SIZES_AT_ONCE = 1024
VALUES_AT_ONCE = 32768


def transfer(
    frequency: ArrayLike,
    angle: ArrayLike,
    radius: ArrayLike,
    sound_speed: float,
    bark: float = 0.0,
) -> np.ndarray:
    """H in √m, complex, for sound turned by ``angle``; the arguments broadcast.

    frequency : Hz, 0 or larger; H vanishes as f^1.5 towards 0.
    angle : radians between the sound's direction before and after the trunk.
    radius : metres, 0 or larger.
    sound_speed : m/s. bark : share of the energy that bark absorbs of a wave head on.
    """
    wavenumber = 2.0 * math.pi * np.asarray(frequency, dtype=np.float64) / sound_speed
    spreading = np.sqrt(2.0 / (math.pi * np.where(wavenumber > 0, wavenumber, np.inf)))
    total = scattering_sum(wavenumber * np.asarray(radius, dtype=np.float64), angle, bark)
    return np.conj(np.exp(0.25j * math.pi) * spreading * total)


def scattering_sum(ka: ArrayLike, angle: ArrayLike, bark: float = 0.0) -> np.ndarray:
    """S(ka, angle), complex, in the books' convention e^{-iωt}; the arguments broadcast.

    ka : wavenumber times radius, 0 to about 5000.
    angle : radians, 0 forward, π back; S is even in it.

    The absolute error is below 5e-14·(1 + ka) up to ka = 2000 and below 1.5e-13·(1 + ka) from there to
    5000: the anchors of the recurrences, scipy's orders 0 and 1, lose digits. A size that occurs often is
    computed once, so that a column of sizes against a row of angles costs one recurrence a size.

    Raises
    ------
    ValueError : a size is negative or not finite.
    """
    sizes, angles = np.asarray(ka, dtype=np.float64), np.asarray(angle, dtype=np.float64)
    if not np.all((sizes >= 0) & np.isfinite(sizes)):
        raise ValueError("ka must be finite and not negative")
    shape = np.broadcast_shapes(sizes.shape, angles.shape)
    distinct, size_of = np.unique(sizes, return_inverse=True)
    size_of = np.broadcast_to(size_of.reshape(sizes.shape), shape).ravel()
    angle_of = np.broadcast_to(angles, shape).ravel()

    # Values are taken in order of size: a block of nearly equal sizes needs the same few orders.
    by_size = np.argsort(size_of, kind="stable")
    total = np.empty(len(size_of), dtype=np.complex128)
    for first in range(0, len(distinct), SIZES_AT_ONCE):
        block = distinct[first : first + SIZES_AT_ONCE]
        waves = partial_waves(block, order_count(block[-1]), bark)
        waves[1:] *= 2.0  # ε_n
        low, high = np.searchsorted(size_of, (first, first + len(block)), sorter=by_size)
        for start in range(low, high, VALUES_AT_ONCE):
            rows = by_size[start : min(start + VALUES_AT_ONCE, high)]
            total[rows] = _cosine_sum(waves, size_of[rows] - first, angle_of[rows])
    return total.reshape(shape)


def order_count(ka: float) -> int:
    """The last order that S needs for a truncation error below 1e-12."""
    if ka >= 5:
        return math.ceil(ka + 6.4 * ka ** (1 / 3))
    return math.ceil(ka + 4.0 * ka ** (1 / 3) + 6.0)


def surface_admittance(ka: np.ndarray, bark: float) -> np.ndarray:
    """β of bark that absorbs a share of a wave head on, at sizes ka; real, over that of air."""
    return (2.0 - bark - 2.0 * math.sqrt(1.0 - bark)) / bark * ka**2 / (1.0 + ka**2)


def partial_waves(ka: np.ndarray, orders: int, bark: float = 0.0) -> np.ndarray:
    """(orders + 1, K) complex sinγ_n·e^{iγ_n} of K sizes; 0 where it is below the smallest float.

    ka : (K,) 0 or larger; complex: the waves' analytic continuation.
    orders : the last order n, 1 or larger. bark : share that bark absorbs head on, below 1.
    """
    z = np.maximum(ka, RAYLEIGH)
    twice = 2j * surface_admittance(z, bark) if bark > 0 else 0.0
    with np.errstate(over="ignore", invalid="ignore"):  # Y overflows where J' has vanished
        j, y = _bessel_j(z, orders + 1), _bessel_y(z, orders + 1)
        on_j = _twice_slope(j) + twice * j[: orders + 1]
        on_y = _twice_slope(y) + twice * y[: orders + 1]
        waves: np.ndarray = on_j / (on_y - 1j * on_j)
    return _finite(waves, ka)


def _finite(waves: np.ndarray, ka: np.ndarray) -> np.ndarray:
    """0 where Y has overflown, and the leading terms where ka is tiny."""
    waves[~np.isfinite(waves)] = 0.0
    tiny = ka < RAYLEIGH
    waves[2:, tiny] = 0.0
    waves[1, tiny] = 0.25 * math.pi * ka[tiny] ** 2
    waves[0, tiny] = -waves[1, tiny]
    return waves


def _twice_slope(values: np.ndarray) -> np.ndarray:
    """(N, K) 2·C_n' = C_{n-1} - C_{n+1}, C_{-1} = -C_1, of a cylinder function's orders 0 to N."""
    slope = np.empty_like(values[1:])
    slope[0] = -2.0 * values[1]
    np.subtract(values[:-2], values[2:], out=slope[1:])
    return slope


def _bessel_j(z: np.ndarray, orders: int) -> np.ndarray:
    """(orders + 1, K) J_n(z), z > 0, by the downward recurrence (Miller's algorithm)."""
    j = np.zeros((orders + 1, len(z)), z.dtype)
    above, here = np.zeros_like(z), np.full_like(z, 1e-300)
    # Begun where J has vanished: its error at each order is as small against the largest J.
    for n in range(max(orders, order_count(float(z.real.max()))) + 1, 0, -1):
        above, here = here, 2.0 * n / z * here - above
        if n <= orders + 1:
            j[n - 1] = here
        if np.abs(here).max() > OVERFLOW:
            scale = np.where(np.abs(here) > OVERFLOW, 1.0 / OVERFLOW, 1.0)
            above, here = above * scale, here * scale
            j[n - 1 :] *= scale
    # J is known up to a factor now. J0 or J1 gives it, whichever is the larger and so not near 0.
    if np.iscomplexobj(z):
        j0, j1 = special.jv([[0], [1]], z)
    else:  # these are more accurate
        j0, j1 = special.j0(z), special.j1(z)
    by_j1 = np.abs(j1) > np.abs(j0)
    j *= np.where(by_j1, j1, j0) / np.where(by_j1, j[1], j[0])
    return j


def _bessel_y(z: np.ndarray, orders: int) -> np.ndarray:
    """(orders + 1, K) Y_n(z), z > 0, by the upward recurrence; not finite where it overflows."""
    y = np.empty((orders + 1, len(z)), z.dtype)
    y[:2] = special.yv([[0], [1]], z) if np.iscomplexobj(z) else (special.y0(z), special.y1(z))
    for n in range(1, orders):
        y[n + 1] = 2.0 * n / z * y[n] - y[n - 1]
    return y


def _cosine_sum(waves: np.ndarray, column: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """(V,) Σ_n waves[n, column]·cos(n·angle)."""
    step = np.exp(1j * angle)
    turn = np.ones(len(angle), dtype=np.complex128)
    total = waves[0][column]
    for wave in waves[1:]:
        turn *= step
        total += wave[column] * turn.real
    return total
