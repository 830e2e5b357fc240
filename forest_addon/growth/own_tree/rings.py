"""The lowest ring of a limb's mesh, held against the mesh of the wood that bears it.

The lowest ring is the border at the foot of an open tube, or the lowest corners of a closed one. A place is
inside its bearer where it lies on the axis' side of the nearest place on the bearer's bark; beyond the ends
of the axis nothing is inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...base.rows import lengths
from ...base.vectors import nearest_on_triangles

OFF = 5e-3  # metres off its bearer's mesh from which a ring is moved or bridged
BORDER = 2.0  # radii from the foot within which a border is that of the foot
CLOSED = 0.1  # radii from the foot within which corners of a closed tube are its lowest ring
DEEP = 0.4  # radii off its bearer's axis, within which a place is inside without a closer look
BEYOND = 1e-3  # metres beyond the end of its bearer's axis
NEAREST = 12  # samples of triangles looked at, for each place


@dataclass(frozen=True, eq=False)
class OnBark:
    """N places held against the wood that bears them.

    place : (N, 3) nearest on its bark, or the place itself well inside. off : (N,) metres, 0 inside.
    """

    place: np.ndarray
    off: np.ndarray


def lowest_ring(
    along: np.ndarray, owner: np.ndarray, thick: np.ndarray, border: np.ndarray
) -> np.ndarray:
    """(V,) whether a vertex is of the lowest ring of its piece.

    along : (V,) metres from the foot. owner : (V,) piece. thick : (C,) radius of pieces at the foot.
    border : (V,) whether an edge of one triangle only ends there.
    """
    low = np.full(len(thick), np.inf)
    np.minimum.at(low, owner, along)
    deep = along - low[owner]
    rim = border & (deep <= BORDER * thick[owner])
    is_open = np.bincount(owner[rim], minlength=len(thick)) > 0
    return np.where(is_open[owner], rim, deep <= CLOSED * thick[owner])


def hold_against(
    point: np.ndarray,
    bearer: np.ndarray,
    axis: np.ndarray,
    radius: np.ndarray,
    beyond: np.ndarray,
    corners: np.ndarray,
    owner: np.ndarray,
) -> OnBark:
    """Hold places (N, 3) against the meshes of their bearers (N,).

    axis, radius : (N, 3) and (N,) of the bearer beside the place. beyond : (N,) metres beyond its end.
    corners, owner : (T, 3, 3) triangles, and (T,) whose they are.
    """
    within = beyond <= BEYOND
    place, off = point.copy(), np.zeros(len(point))
    look = np.flatnonzero(~within | (lengths(point - axis) > DEEP * radius))
    borne = np.zeros(int(max(owner.max(initial=-1), bearer.max(initial=-1))) + 1, dtype=bool)
    borne[bearer[look]] = True
    mine = np.flatnonzero(borne[owner])
    if not len(look) or not len(mine):
        return OnBark(place, off)
    corners, owner, seen = corners[mine], owner[mine], point[look]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    samples = np.concatenate([corners, middles, corners.mean(axis=1)[:, None]], axis=1)
    many = samples.shape[1]
    apart = 4.0 * float(np.ptp(samples.reshape(-1, 3), axis=0).max() + np.ptp(seen, axis=0).max())
    tree = cKDTree(np.column_stack([samples.reshape(-1, 3), apart * np.repeat(owner, many)]))
    _, found = tree.query(np.column_stack([seen, apart * bearer[look]]), NEAREST)
    found = np.minimum(found, many * len(owner) - 1) // many
    row = np.repeat(np.arange(len(look)), NEAREST)
    every = nearest_on_triangles(seen[row], corners[found.ravel()])
    gap = lengths(every - seen[row]).reshape(-1, NEAREST)
    gap[owner[found] != bearer[look][:, None]] = np.inf
    best = np.argmin(gap, axis=1)
    row = np.arange(len(look))
    bark, gap = every.reshape(-1, NEAREST, 3)[row, best], gap[row, best]
    towards = np.einsum("ni,ni->n", seen - bark, axis[look] - bark)
    place[look] = bark
    off[look] = np.where((towards > 0) & within[look], 0.0, gap)
    return OnBark(place, off)
