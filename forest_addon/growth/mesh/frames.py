"""Ring frames along axes by parallel transport, laid into the bisecting plane where an axis bends.

From one segment to the next a frame takes the smallest turn that brings the direction over, so nothing
twists. At a bend the ring lies in the bisecting plane and is stretched there by 1/cos of half the bend:
that is where two cylinders really meet, and the tube keeps its thickness and its volume.
"""

from __future__ import annotations

import numpy as np

from ...base.vectors import cross_rows
from .nodes import SHORTEST, Line

MITRE = 2.0  # a ring is stretched no further at a bend: 120°
TURNED_BACK = 0.1  # cosine of half a bend beyond which a line counts as turned back on itself
GOLDEN = np.pi * (3 - 5**0.5)  # radians between the first corners of two axes: no common direction


def ring_frames(line: Line) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) twice: what a ring's cosine and sine are multiplied by at each node, for radius 1."""
    first, count = line.first, len(line.point)
    if not count:
        return np.empty((0, 3)), np.empty((0, 3))
    last = first[1:] - 1
    ahead = np.empty((count, 3))  # direction of the segment that starts at a node
    ahead[:-1] = np.diff(line.point, axis=0)
    ahead[last] = ahead[last - 1]
    size = np.sqrt(np.einsum("ni,ni->n", ahead, ahead))[:, None]
    ahead /= np.maximum(size, SHORTEST)

    across = np.empty((count, 3))
    across[first[:-1]] = _start(ahead[first[:-1]])
    longest_first = np.argsort(-np.diff(first), kind="stable")
    nodes = np.diff(first)[longest_first]
    behind = ahead[np.maximum(np.arange(count) - 1, 0)]
    cosine = np.einsum("ni,ni->n", behind, ahead)
    between = behind + ahead
    with np.errstate(divide="ignore"):
        factor = np.where(cosine > -1 + 1e-9, 1 / (1 + cosine), 0.0)
    for ring in range(1, int(nodes.max())):  # by the smallest turn from one segment to the next
        active = int(np.searchsorted(-nodes, -ring, side="left"))
        at = first[longest_first[:active]] + ring
        kept = across[at - 1]
        share = np.einsum("ni,ni->n", kept, ahead[at]) * factor[at]
        across[at] = kept - share[:, None] * between[at]
    across -= np.einsum("ni,ni->n", across, ahead)[:, None] * ahead
    across /= np.sqrt(np.einsum("ni,ni->n", across, across))[:, None]
    beside = cross_rows(ahead, across)

    # Lay the rings of bends into the bisecting plane, along the segment ahead.
    inside = np.ones(count, dtype=bool)
    inside[first[:-1]] = inside[last] = False
    half = np.sqrt(np.maximum((1 + cosine) / 2, 0.0))
    bend = np.flatnonzero(inside & (cosine < 1 - 1e-12) & (half > TURNED_BACK))
    if len(bend):
        middle = between[bend] / (2 * half[bend])[:, None]
        way = ahead[bend]
        turn = way - behind[bend]
        turn /= np.sqrt(np.einsum("ni,ni->n", turn, turn))[:, None]
        squeeze = np.minimum(1.0, MITRE * half[bend]) - 1
        for ring_axis in (across, beside):
            laid = ring_axis[bend]
            slide = np.einsum("ni,ni->n", laid, middle) / half[bend]
            laid = laid - slide[:, None] * way
            excess = np.einsum("ni,ni->n", laid, turn) * squeeze
            ring_axis[bend] = laid + excess[:, None] * turn
    return across, beside


def _start(direction: np.ndarray) -> np.ndarray:
    """(A, 3) unit vectors across unit directions, each axis turned on by the golden angle."""
    helper = np.eye(3)[np.argmin(np.abs(direction), axis=1)]
    across = cross_rows(direction, helper)
    across /= np.sqrt(np.einsum("ni,ni->n", across, across))[:, None]
    turn = GOLDEN * np.arange(len(direction))
    beside = cross_rows(direction, across)
    return np.asarray(np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * beside)
