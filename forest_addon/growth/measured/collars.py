"""Collars: where a limb leaves its parent it swells, and narrows to its own radius like a trumpet's bell.

At the parent's surface a limb is (1 + c) times as thick as it would be. Over a reach of a few of its radii
that falls off by a power, steeply at first, so that the two surfaces meet in a hollow and not in a crease.
The collar is in the radii of the skeleton: wood, its mesh and its truth have it alike. Within the parent the
limb keeps the width that it has at the surface, and stays inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mesh.axes import Axes
from ..skeleton import Skeleton

THIN = 0.008  # metres of radius; what is thinner has no collar
FATTEST = 0.92  # of the parent's radius
REACH = 3.0  # radii of the limb over which it narrows, and
ROOM = 0.35  # of its parent's
HALF = 0.5  # of an axis that its collar takes at most
POWER = 2.4
STEPS = np.array([0.0, 0.1, 0.22, 0.38, 0.6, 1.0])  # of the reach, where the bell is cut
STEEPEST = 0.5  # sine of the angle to the parent below which a limb no longer comes out later


@dataclass(frozen=True)
class Collars:
    """The collars of S segments.

    metres : (S, 2) along its axis from the foot to both ends of a segment.
    surface, reach : (S,) metres from the foot to the parent's surface and over which the limb narrows from
        there; 0 where an axis has no collar.
    swelling : (S,) how much thicker it is at the surface, relative. most : (S,) metres of radius.
    cuts : segments (N,) and shares (N,) where a collar bends.
    """

    metres: np.ndarray
    surface: np.ndarray
    reach: np.ndarray
    swelling: np.ndarray
    most: np.ndarray
    cuts: tuple[np.ndarray, np.ndarray]

    def radius(self, row: np.ndarray, share: np.ndarray, plain: np.ndarray) -> np.ndarray:
        """(N,) radii at shares (N,) of segments (N,) that would be ``plain`` (N,) thick."""
        low, high = self.metres[row].T
        beyond = low + share * (high - low) - self.surface[row]
        left = 1 - np.clip(beyond / np.maximum(self.reach[row], 1e-12), 0.0, 1.0)
        wide = plain * (1 + self.swelling[row] * left**POWER)
        limit = np.maximum(np.where(beyond < 0, self.most[row], np.inf), 1e-6)
        return np.asarray(np.where(self.reach[row] > 0, np.minimum(wide, limit), plain))


def collars_of(
    skeleton: Skeleton,
    axes: Axes,
    start: np.ndarray,
    end: np.ndarray,
    share: np.ndarray,
    collar: float,
) -> Collars:
    """The collars of a tree whose segments go from ``start`` to ``end`` (S, 3).

    share : (S,) of its parent's length at which a segment starts. collar : the swelling; 0: none.
    """
    chain, count = axes.segment, len(skeleton)
    length = np.linalg.norm(end - start, axis=1)
    total = np.cumsum(length[chain])
    before = np.repeat(total[axes.first[:-1]] - length[chain[axes.first[:-1]]], np.diff(axes.first))
    metres = np.empty((count, 2))
    metres[chain, 1] = total - before
    metres[chain, 0] = total - before - length[chain]

    foot, tip = chain[axes.first[:-1]], chain[axes.first[1:] - 1]
    parent = np.maximum(skeleton.parent[foot], 0)
    r1, r2 = skeleton.radius[parent].T
    thick, own = r1 + share[foot] * (r2 - r1), skeleton.radius[foot, 0]
    way, up = end[foot] - start[foot], end[parent] - start[parent]
    cosine = np.einsum("ai,ai->a", way, up) / np.maximum(length[foot] * length[parent], 1e-12)
    sine = np.sqrt(np.clip(1 - cosine**2, STEEPEST**2, 1.0))
    surface = thick / sine
    reach = np.minimum(REACH * own + ROOM * thick, HALF * metres[tip, 1] - surface)
    room = np.minimum(collar, np.maximum(FATTEST * thick / np.maximum(own, 1e-12) - 1, 0.0))
    has = (collar > 0) & (skeleton.parent[foot] >= 0) & (own >= THIN) & (reach > own) & (room > 0)
    columns = [np.where(has, v, 0.0) for v in (surface, reach, room)]
    columns.append(np.where(has, np.maximum(FATTEST * thick, 1e-6), np.inf))
    spread = np.empty((4, count))
    spread[:, chain] = np.repeat(np.stack(columns), np.diff(axes.first), axis=1)

    rows = np.flatnonzero(has)
    wanted = (surface[rows, None] + STEPS * reach[rows, None]).ravel()
    axis = np.repeat(rows, len(STEPS))
    base = total[axes.first[axis]] - length[chain[axes.first[axis]]]
    place = np.minimum(np.searchsorted(total, base + wanted), axes.first[axis + 1] - 1)
    on = chain[place]
    part = (wanted - metres[on, 0]) / np.maximum(length[on], 1e-12)
    inside = (part > 0) & (part < 1)
    return Collars(metres, spread[0], spread[1], spread[2], spread[3], (on[inside], part[inside]))
