"""The exact disc's backscatter, tabulated: k·f by cubic splines in ka and incidence.

``hard_disc.npz`` holds, for each tabulated ka, the cosine series of k·f over the incidence;
``packaging/make_disc_table.py`` makes it by ``tests/references/discs.py``. Unfolded at first use, it
becomes a grid that is even in √(ka + 1) and in √(β + 0.03), which puts the points where k·f oscillates and is
large. What is interpolated is k·f over ``level``, which rises like k·f at normal incidence: as (ka)³, then
as (ka)². What is unfolded is kept on the disk (``kept_tables``).

Up to ka = ``LAST`` the error is below ``ERROR`` of |k·f| at normal incidence; what it is at most for a
size and an incidence says ``table_error``.
"""

from __future__ import annotations

import math
import platform
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..base.kept import digest
from .kept_tables import kept_table

FILE = Path(__file__).with_name("hard_disc.npz")
LAST = 128.0  # ka
HANDOVER = 120.0  # ka from where the table passes over to the formula for large discs
ERROR = 1e-5

SERIES, ROUNDED = 3e-8, 4e-7  # of ``level``, where the file's series are cut; of k·f
MISSED, RIPPLE = 1.5, 0.1

MARGIN = 10  # points beyond the domain: what a spline does at its end has decayed by a factor of 4 a point
KA_STEP, KA_SHIFT = 0.008, 1.0
ANGLE_STEP, ANGLE_SHIFT = 0.00175, 0.03
STEPS = KA_STEP, KA_SHIFT, ANGLE_STEP, ANGLE_SHIFT, LAST


def tabulated_ka() -> np.ndarray:
    """(U,) of the table's rows; the first ``MARGIN`` are negative, where k·f(-ka) = -conj k·f(ka)."""
    last = math.ceil((math.sqrt(LAST + KA_SHIFT) - math.sqrt(KA_SHIFT)) / KA_STEP) + MARGIN
    u = math.sqrt(KA_SHIFT) + KA_STEP * np.arange(-MARGIN, last + 1)
    ka: np.ndarray = u * u - KA_SHIFT
    ka[MARGIN] = 0.0
    return ka


def level(ka: np.ndarray) -> np.ndarray:
    """Divisor of k·f in the table."""
    square = ka * ka
    return square * ka / np.sqrt(4.0 + square)


def tabulated(ka: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Complex k·f for 0 <= ka <= ``LAST`` and 0 <= angle <= π/2; the arguments broadcast.

    A size that is out of the table's domain gets its nearest value times ``level``.
    """
    splines = _splines()
    row, across = _cell_of_ka(ka)
    column, along = _cell_of_angle(angle)
    weight_across, weight_along = spline_weights(across), spline_weights(along)
    width = splines.shape[1]
    corner = row * width + column
    flat = splines.ravel()
    total = np.zeros(corner.shape, dtype=np.complex64)
    for i in range(4):
        line = weight_along[0] * flat.take(corner + i * width)
        for j in range(1, 4):
            line += weight_along[j] * flat.take(corner + (i * width + j))
        line *= weight_across[i]
        total += line
    return np.asarray(total * level(ka))


def tabulated_bound(lowest: np.ndarray, highest: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Upper bound (M,) of |k·f|/ka of ``tabulated`` from ``lowest`` to ``highest`` (ka), (M,) each.

    A spline nowhere exceeds the largest of the four by four coefficients that it is made of there.
    """
    maxima = bound_maxima()
    first, last = _cell_of_ka(lowest)[0], _cell_of_ka(highest)[0]
    column = _cell_of_angle(angle)[0] // 2
    doubling = (
        np.frexp(last - first + 1)[1] - 1
    )  # two overlapping runs of 2^doubling cells cover all
    ends = (maxima[doubling, row, column] for row in (first, last + 1 - (1 << doubling)))
    return np.maximum(*ends).astype(np.float64)


def table_error(ka: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """|k·f|/ka by which ``tabulated`` may be off at sizes up to ``ka``, ``LAST`` at most; (M,).

    A spline of step h misses e^{iφ} by φ⁴/384, φ the phase over a step; what it misses it of is what
    physical optics and the edge say on the whole. Beside it stands single precision.
    """
    size = np.clip(ka, 1e-9, LAST)
    sine, cosine = np.sin(angle), np.cos(angle)
    over_angle = np.square(4.0 * size * cosine * ANGLE_STEP) * (angle + ANGLE_SHIFT)
    over_size = np.square(4.0 * (sine + RIPPLE) * KA_STEP) * (size + KA_SHIFT)
    across = 2.0 * size * sine
    rim = 1.0 / np.sqrt(np.maximum(across, 1.0))
    envelope = size * (0.5 * size * cosine * np.minimum(1.0, 2.0 * rim * rim * rim) + rim)
    missed = (np.square(over_angle) + np.square(over_size)) / 384.0
    return (envelope * (MISSED * missed + ROUNDED) + SERIES * level(size)) / size


@lru_cache(maxsize=1)
def _splines() -> np.ndarray:
    """(U, V) complex64, coefficients of cardinal cubic splines over both axes."""
    return kept_table("disc-splines", _version(), _make_splines)


@lru_cache(maxsize=1)
def by_incidence() -> np.ndarray:
    """(V, U) the same, by incidence."""
    return np.ascontiguousarray(_splines().T)


@lru_cache(maxsize=1)
def _version() -> str:
    """Digest of what the tables depend on: this file, its data, and what computes them."""
    import scipy

    made_with = f"{np.__version__} {scipy.__version__} {platform.machine()}"
    return digest([Path(__file__).read_bytes(), FILE.read_bytes(), made_with])


def _make_splines() -> np.ndarray:
    from scipy.ndimage import spline_filter1d  # here: few runs need what it takes to import

    with np.load(FILE) as data:
        terms, series = data["terms"], data["series"]
    padded = np.zeros((len(terms), terms.max()), dtype=np.complex128)
    padded[np.arange(terms.max()) < terms[:, None]] = series
    end = math.ceil((math.sqrt(0.5 * math.pi + ANGLE_SHIFT) - math.sqrt(ANGLE_SHIFT)) / ANGLE_STEP)
    v = math.sqrt(ANGLE_SHIFT) + ANGLE_STEP * np.arange(-MARGIN, end + MARGIN + 1)
    angle = v * v - ANGLE_SHIFT
    values = padded @ np.cos(2.0 * np.arange(terms.max())[:, None] * angle)
    for axis in (0, 1):
        values = spline_filter1d(values, 3, axis, output=np.complex128)
    return values.astype(np.complex64)


@lru_cache(maxsize=1)
def bound_maxima() -> np.ndarray:
    """(D, U - 3, V/2) float32: no |k·f|/ka over 1, 2, 4, … cells of ka, from each on, and two of the
    incidence, is larger."""
    return kept_table("disc-maxima", _version(), _make_maxima)


def _make_maxima() -> np.ndarray:
    size = np.abs(_splines())
    for axis in (0, 1):  # the four that matter in each cell
        size = np.lib.stride_tricks.sliding_window_view(size, 4, axis).max(axis=-1)
    size = np.maximum.reduceat(size, np.arange(0, size.shape[1], 2), axis=1)
    upper = np.maximum(tabulated_ka()[2:-1], 0.0)  # end of a cell; level/ka rises with ka
    rise = upper**2 / np.sqrt(4.0 + upper**2)
    runs = [(size * rise[:, None] * (1.0 + 1e-6)).astype(np.float32)]  # 1e-6: rounding
    while 2 ** len(runs) <= len(size):
        step, longer = 2 ** (len(runs) - 1), runs[-1].copy()
        np.maximum(runs[-1][:-step], runs[-1][step:], out=longer[:-step])
        runs.append(longer)
    return np.array(runs)


def _cell_of_ka(ka: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First of the four splines that matter, and the position 0 … 1 between the middle ones."""
    return _split((np.sqrt(np.minimum(ka, LAST) + KA_SHIFT) - math.sqrt(KA_SHIFT)) / KA_STEP)


def _cell_of_angle(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return _split((np.sqrt(angle + ANGLE_SHIFT) - math.sqrt(ANGLE_SHIFT)) / ANGLE_STEP)


def _split(place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    whole = np.fmax(place, 0.0).astype(np.int32)  # what is not finite stays so in the fraction
    return whole + np.int32(MARGIN - 1), (place - whole).astype(np.float32)


def spline_weights(t: np.ndarray) -> tuple[np.ndarray, ...]:
    """The four cardinal cubic splines at the position t, 0 … 1."""
    s = 1.0 - t
    middle = (2.0 / 3.0 - t * t * (1.0 - 0.5 * t), 2.0 / 3.0 - s * s * (1.0 - 0.5 * s))
    return s * s * s / 6.0, *middle, t * t * t / 6.0
