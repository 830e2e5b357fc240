"""Spectra on an even grid of frequencies: delays as factors, and interpolation between few frequencies.

``delay_factors`` turns delays into e^{-i2πfτ}. ``frequency_panels`` cuts a band into panels in which a
smooth function of frequency is known to rounding from its values at a few Chebyshev nodes, so that an
expensive one is not computed at every bin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from . import chebyshev

NODES = 40  # of a panel: 1e-12 over 3 of z = ka for a trunk's H
RATIO = 4.0  # highest over lowest frequency of a panel: towards 0 panels shrink in proportion


def delay_factors(start: float, spacing: float, count: int, delay: np.ndarray) -> np.ndarray:
    """(count, D) complex e^{-i2πfτ} at f = start + (0 … count - 1)·spacing Hz of D delays (D,) s.

    A product of two tables of √count rows: exact to rounding, and ten times faster than exponentials.
    """
    stride = max(1, math.isqrt(count))
    coarse = start + stride * spacing * np.arange(-(-count // stride))
    steps = phasors(np.outer(coarse, delay))
    fine = phasors(np.outer(np.arange(stride) * spacing, delay))
    factors: np.ndarray = steps[:, None, :] * fine[None, :, :]
    return factors.reshape(len(coarse) * stride, len(delay))[:count]


def phasors(cycles: np.ndarray) -> np.ndarray:
    """Phasors e^{-i2π·cycles}; whole cycles are taken off first, where the exponential would lose digits."""
    return np.exp(-2j * math.pi * (cycles - np.rint(cycles)))


@dataclass(frozen=True)
class Panel:
    """Bins ``first`` to ``first + count - 1``, and how to reach them from a few frequencies.

    nodes : (Q,) Hz. weights : (count, Q); value at the bins = weights @ value at the nodes.
    """

    first: int
    count: int
    nodes: np.ndarray
    weights: np.ndarray


def frequency_panels(last: int, spacing: float, width: float, first: int = 1) -> list[Panel]:
    """Panels over the bins ``first`` to ``last`` of a grid with ``spacing`` Hz, none wider than ``width`` Hz.

    A panel of few bins takes these as nodes.
    """
    panels = []
    while first <= last:
        high = min(RATIO * first * spacing, first * spacing + width)
        count = max(1, min(int(high / spacing), last) - first + 1)
        nodes = (first + np.arange(count)) * spacing
        if count <= NODES:
            shares = np.eye(count)
        else:
            nodes = chebyshev.points(NODES, nodes[0], nodes[-1])
            shares = chebyshev.lagrange(NODES, np.linspace(-1.0, 1.0, count))
        panels.append(Panel(first, count, nodes, shares.T))
        first += count
    return panels
