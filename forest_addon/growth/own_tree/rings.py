"""The lowest ring of a limb's mesh, held against the mesh of the wood that bears it.

The lowest ring is the border at the foot of an open tube, or the lowest corners of a closed one. A place is
inside its bearer where it lies on the axis' side of the nearest place on the bearer's bark and behind the
triangle there; where the two do not agree, or beyond the axis' ends, the winding number tells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...base.rows import lengths
from ...base.vectors import cross_rows, nearest_on_triangles

OFF = 5e-3  # metres off its bearer's mesh from which a ring is moved or bridged
BORDER = 2.0  # radii from the foot within which a border is that of the foot
CLOSED = 0.1  # radii from the foot within which corners of a closed tube are its lowest ring
APART = 1e3  # metres from one bearer to the next, where samples are looked up
NEAREST = 8  # samples of triangles looked at, for each place


@dataclass(frozen=True, eq=False)
class OnBark:
    """N places held against the wood that bears them.

    place : (N, 3) nearest on its bark. off : (N,) metres, 0 inside.
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
    beyond: np.ndarray,
    vertices: np.ndarray,
    triangles: np.ndarray,
    owner: np.ndarray,
) -> OnBark:
    """Hold places (N, 3) against the meshes of their bearers (N,).

    axis : (N, 3) beside the place on the bearer's axis. beyond : (N,) whether it is beyond the end of that.
    vertices, triangles, owner : (V, 3), (T, 3), and (T,) whose triangles they are.
    """
    borne = np.zeros(int(max(owner.max(initial=-1), bearer.max(initial=-1))) + 1, dtype=bool)
    borne[bearer] = True
    mine = np.flatnonzero(borne[owner])
    if not len(mine):
        return OnBark(point, np.zeros(len(point)))
    corners, owner = vertices[triangles[mine]], owner[mine]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    samples = np.concatenate([corners, middles, corners.mean(axis=1)[:, None]], axis=1)
    many = samples.shape[1]
    samples = np.column_stack([samples.reshape(-1, 3), APART * np.repeat(owner, many)])
    tree = cKDTree(samples, balanced_tree=False, compact_nodes=False)
    _, found = tree.query(np.column_stack([point, APART * bearer]), NEAREST)
    found = np.minimum(found, many * len(owner) - 1) // many
    row = np.repeat(np.arange(len(point)), NEAREST)
    every = nearest_on_triangles(point[row], corners[found.ravel()])
    gap = lengths(every - point[row]).reshape(-1, NEAREST)
    gap[owner[found] != bearer[:, None]] = np.inf
    best = np.argmin(gap, axis=1)
    row = np.arange(len(point))
    bark, gap = every.reshape(-1, NEAREST, 3)[row, best], gap[row, best]
    mine = corners[found[row, best]]
    normal = cross_rows(mine[:, 1] - mine[:, 0], mine[:, 2] - mine[:, 0])
    towards = np.einsum("ni,ni->n", point - bark, axis - bark) > 0
    behind = np.einsum("ni,ni->n", point - bark, normal) < 0
    inside = towards.copy()
    for k in np.flatnonzero((behind != towards) | beyond):
        inside[k] = winding_number(point[k], corners[owner == bearer[k]]) > 0.5
    return OnBark(bark, np.where(inside | np.isinf(gap), 0.0, gap))  # no mesh: nothing to be off


def winding_number(point: np.ndarray, corners: np.ndarray) -> float:
    """Times that triangles (T, 3, 3) go round a point (3,): 1 inside a closed mesh, 0 outside.

    Solid angles by Van Oosterom & Strackee 1983.
    """
    a, b, c = (corners[:, k] - point for k in range(3))
    la, lb, lc = lengths(a), lengths(b), lengths(c)
    above = np.einsum("ti,ti->t", a, cross_rows(b, c))
    ab, bc, ca = (np.einsum("ti,ti->t", *pair) for pair in ((a, b), (b, c), (c, a)))
    below = la * lb * lc + ab * lc + bc * la + ca * lb
    return abs(float(np.arctan2(above, below).sum())) / (2 * np.pi)
