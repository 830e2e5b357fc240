"""Obstacles in one mesh: its triangles in cells, and the least distance from all of them to each cell.

Wood as thick as asked for, ground and everything that is no leaf counts. ``room`` of a cell is a bound from
below on the distance from anywhere in it to any of these triangles: the distance between cells (Euclidean
distance transform of those that some triangle's box overlaps) less a cell's diagonal. Far from wood a look-up
tells that nothing is near; near it, the triangles of the cells around are the only ones to be asked.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from ..base.trimesh import LEAF, TriMesh, is_wood
from ..growth.own_tree.centreline import find_centrelines
from ..growth.own_tree.pieces import part

CELLS = 400_000  # of a mesh
FINEST = 0.05  # metres, a cell's edge
MARGIN = 1.5  # metres around the mesh that have cells
MOST = 2_000_000  # cells that triangles are written into


def stopping(mesh: TriMesh, thinnest: float) -> np.ndarray:
    """Numbers of the triangles that stop a flyer: no leaves, no wood thinner than that radius."""
    with np.errstate(invalid="ignore"):
        finite = np.isfinite(mesh.vertices[mesh.triangles].sum(axis=(1, 2)))
    stops = finite & (mesh.part != LEAF)
    wood = np.flatnonzero(stops & is_wood(mesh.part))
    if not thinnest or not len(wood):
        return np.flatnonzero(stops)
    corners = mesh.vertices[mesh.triangles[wood]]
    pieces = part(corners)
    if not pieces.count:
        return np.flatnonzero(stops)
    lines = find_centrelines(pieces)
    places, radius, owner = _along(lines.knot, lines.radius, lines.first)
    middle = corners.mean(axis=1)
    _, same = cKDTree(pieces.vertices[pieces.triangles].mean(axis=1)).query(middle)
    # A triangle is as thick as its own piece is nearest to it: a twig that leaves a trunk thins none of it.
    apart = 10.0 * (1.0 + np.ptp(middle, axis=0).max())
    tree = cKDTree(np.column_stack([places, apart * owner]))
    _, nearest = tree.query(np.column_stack([middle, apart * pieces.piece[same]]))
    stops[wood] = radius[nearest] >= thinnest
    return np.flatnonzero(stops)


def _along(
    knot: np.ndarray, radius: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places along centrelines a radius or so apart, how thick the wood is there, and the line of each."""
    starts = np.setdiff1d(np.arange(len(knot) - 1), first[1:-1] - 1)
    length = np.linalg.norm(knot[starts + 1] - knot[starts], axis=1)
    count = np.clip(np.ceil(length / np.maximum(radius[starts], 1e-3)), 1, 64).astype(np.int64)
    which, place = repeated(count)
    row, share = starts[which], place / count[which]
    places = knot[row] + share[:, None] * (knot[row + 1] - knot[row])
    thick = radius[row] + share * (radius[row + 1] - radius[row])
    line = np.searchsorted(first, np.concatenate([row, np.arange(len(knot))]), side="right") - 1
    return np.concatenate([places, knot]), np.concatenate([thick, radius]), line


class Solid:
    """The stopping triangles of a mesh in local space.

    corners : (T, 3, 3). low : (3,) where the cells start. cell : metres. room : (X, Y, Z) float32, metres.
    items : triangles by cell, cell after cell; count : (X·Y·Z,) how many each has.
    """

    def __init__(self, mesh: TriMesh, thinnest: float) -> None:
        self.corners = mesh.vertices[mesh.triangles[stopping(mesh, thinnest)]]
        self.empty = not len(self.corners)
        points = self.corners.reshape(-1, 3)
        self.box = (
            (points.min(axis=0), points.max(axis=0))
            if not self.empty
            else (np.zeros(3), np.zeros(3))
        )
        self.low = self.box[0] - MARGIN
        extent = self.box[1] - self.box[0] + 2 * MARGIN
        self.cell = max(FINEST, float(np.cbrt(extent.prod() / CELLS)))
        shape = np.maximum(np.ceil(extent / self.cell), 1).astype(np.int64)
        self.shape = shape
        self._file()
        if self.empty:
            self.room = np.full(self.shape, np.inf, dtype=np.float32)
            return
        away = distance_transform_edt((self.count == 0).reshape(self.shape)) * self.cell
        bound = np.maximum(away - np.sqrt(3) * self.cell, 0.0)
        self.room = (bound * (1 - 1e-6)).astype(np.float32)

    def _file(self) -> None:
        """Write every triangle into the cells that its box overlaps."""
        slack = 1e-6 * self.cell
        first = np.floor((self.corners.min(axis=1) - self.low - slack) / self.cell).astype(np.int64)
        last = np.floor((self.corners.max(axis=1) - self.low + slack) / self.cell).astype(np.int64)
        first, last = np.maximum(first, 0), np.minimum(last, self.shape - 1)
        span = last - first + 1
        count = span.prod(axis=1)
        while count.sum() > MOST:  # few triangles over very many cells: a ground
            self.cell *= 2.0
            self.shape = np.maximum(-(-self.shape // 2), 1)
            first, last = first // 2, last // 2
            span = last - first + 1
            count = span.prod(axis=1)
        item, place = repeated(count)
        across = span[item]
        x, rest = np.divmod(place, across[:, 1] * across[:, 2])
        y, z = np.divmod(rest, across[:, 2])
        cells = first[item] + np.stack([x, y, z], axis=1)
        number = self._number(cells)
        self.items = item[np.argsort(number, kind="stable")]
        self.count = np.bincount(number, minlength=int(self.shape.prod()))

    def _number(self, cells: np.ndarray) -> np.ndarray:
        number: np.ndarray = (cells[:, 0] * self.shape[1] + cells[:, 1]) * self.shape[2] + cells[
            :, 2
        ]
        return number


def repeated(count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(Σ count,) row of each of so many copies, and which copy of its row it is."""
    row = np.repeat(np.arange(len(count)), count)
    return row, np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
