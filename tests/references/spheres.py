"""Waves among soft or hard spheres, exactly to an order of each: every echo between all (Waterman 1965).

Outgoing waves h_l(kr)·Y(way) of each sphere, with real harmonics, are regular waves around every other one,

    h_l'·Y'(r + R) = Σ_Y j_l(kr)·Y(r)·4π·Σ_Y'' i^{l+l''-l'}·<Y·Y'·Y''>·h_l''(kR)·Y''(R),

under e^{-iωt}. The integrals <> are by quadrature that is exact for them.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import eval_legendre, sph_harm_y, spherical_jn, spherical_yn


def received(
    k: float,
    centres: np.ndarray,
    radius: float,
    soft: bool,
    orders: int,
    sources: np.ndarray,
    receivers: np.ndarray,
) -> np.ndarray:
    """(R, S) scattered pressure at receivers (R, 3) of sources 1/r at (S, 3)."""
    degree, count = _degrees(orders), len(centres)
    size = len(degree)
    away = centres[:, None] - centres[None]
    away[np.arange(count), np.arange(count)] = 1.0
    waves = _outgoing(2 * orders, k, away)
    waves[np.arange(count), np.arange(count)] = 0.0
    coupling = waves.reshape(count**2, -1) @ _joined(orders)
    coupling = coupling.reshape(count, count, size, size).transpose(0, 2, 1, 3)
    answer = np.tile(answers(k * radius, soft, orders)[degree], count)[:, None]
    system = np.eye(count * size) - answer * coupling.reshape(count * size, count * size)
    given, taken = (
        _outgoing(orders, k, ends[:, None] - centres).reshape(len(ends), -1)
        for ends in (sources, receivers)
    )
    return taken @ np.linalg.solve(system, answer * (4j * math.pi * k * given.T))


def answers(ka: float, soft: bool, orders: int) -> np.ndarray:
    """(orders + 1,) outgoing over regular wave of a sphere."""
    degree = np.arange(orders + 1)
    regular = spherical_jn(degree, ka, derivative=not soft)
    return -regular / (regular + 1j * spherical_yn(degree, ka, derivative=not soft))


def scattered(k: float, radius: float, soft: bool, cosine: np.ndarray) -> np.ndarray:
    """(C,) |f|², m² per steradian, by the cosine of the angle, of one sphere."""
    orders = math.ceil(k * radius) + 4
    each = answers(k * radius, soft, orders)
    waves = [(2 * n + 1) * each[n] * eval_legendre(n, cosine) for n in range(orders + 1)]
    return np.abs(np.sum(waves, axis=0) / k) ** 2


def _degrees(orders: int) -> np.ndarray:
    return np.repeat(np.arange(orders + 1), 2 * np.arange(orders + 1) + 1)


def _harmonics(orders: int, way: np.ndarray) -> np.ndarray:
    """(..., (orders + 1)²) real ones of vectors (..., 3)."""
    tilt = np.arctan2(np.hypot(way[..., 0], way[..., 1]), way[..., 2])
    turn = np.arctan2(way[..., 1], way[..., 0])
    found = np.empty((*way.shape[:-1], (orders + 1) ** 2))
    for degree in range(orders + 1):
        for m in range(degree + 1):
            both = sph_harm_y(degree, m, tilt, turn) * (math.sqrt(2.0) if m else 1.0)
            found[..., degree**2 + degree - m] = both.imag
            found[..., degree**2 + degree + m] = both.real
    return found


def _outgoing(orders: int, k: float, way: np.ndarray) -> np.ndarray:
    distance = k * np.linalg.norm(way, axis=-1)
    radial = [spherical_jn(n, distance) + 1j * spherical_yn(n, distance) for n in range(orders + 1)]
    return np.stack(radial, axis=-1)[..., _degrees(orders)] * _harmonics(orders, way)


def _joined(orders: int) -> np.ndarray:
    """(C, A·A') 4π·i^{l+l''-l'}·<Y·Y'·Y''>, C of twice the orders."""
    nodes, weights = np.polynomial.legendre.leggauss(2 * orders + 2)
    turns = 2.0 * math.pi * np.arange(4 * orders + 2) / (4 * orders + 2)
    cosine, turn = (part.ravel() for part in np.meshgrid(nodes, turns, indexing="ij"))
    weight = np.repeat(weights, len(turns)) * 2.0 * math.pi / len(turns)
    sine = np.sqrt(1.0 - cosine**2)
    way = np.column_stack([sine * np.cos(turn), sine * np.sin(turn), cosine])
    many, few = _harmonics(2 * orders, way), _harmonics(orders, way)
    found = np.einsum("p,pc,pa,pb->cab", weight, many, few, few, optimize=True)
    order, wide = _degrees(orders), _degrees(2 * orders)
    found = found * 1j ** (wide[:, None, None] + order[:, None] - order)
    return 4.0 * math.pi * found.reshape(len(wide), -1)
