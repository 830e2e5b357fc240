"""How much area of a mesh lies in each cell of a grid: triangles cut exactly at the cells' walls.

A triangle that reaches over a wall is cut by that plane into at most three, again and again until each
lies in one cell; of the walls that it crosses the middle one comes first, so that n cells take log₂ n
rounds. What is cut off and what is left make up the whole, so sums over cells are the area of the mesh but
for rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .vectors import cross_rows

AT_ONCE = 1 << 17  # triangles: what is in work stays in the cache


@dataclass(frozen=True)
class CellAreas:
    """Areas in the cells of a grid that have any.

    cell : (K, 3) int64, cell i reaches from i·edge to (i + 1)·edge along each axis; sorted, no cell twice.
    area : (K, P) m² of each of P parts.
    """

    cell: np.ndarray
    area: np.ndarray


def areas_by_cell(
    vertices: np.ndarray, triangles: np.ndarray, part: np.ndarray, parts: int, edge: float
) -> CellAreas:
    """Areas by cell of a mesh.

    vertices : (V, 3) metres. triangles : (T, 3). part : (T,) number of the part that each is of, below
    ``parts``.
    edge : of a cell, metres.
    """
    vertices = vertices / edge  # in edges: walls are whole numbers, which are exact
    at = np.floor(vertices).astype(np.int64)  # most triangles have all corners in one cell
    low = np.array([column.min(initial=0) for column in at.T])
    size = [int(column.max(initial=0)) - least + 1 for column, least in zip(at.T, low, strict=True)]
    key = np.ravel_multi_index(tuple((at - low).T), tuple(size)) if len(at) else at[:, 0]
    found = []
    for first in range(0, len(triangles), AT_ONCE):
        rows = slice(first, first + AT_ONCE)
        found.append(_areas(vertices, triangles[rows], part[rows], parts, (key, at)))
    whole = join_areas(found, parts)
    return CellAreas(whole.cell, whole.area * edge**2)


def join_areas(found: list[CellAreas], parts: int) -> CellAreas:
    """The areas of several meshes in the same grid."""
    if not found:
        return CellAreas(np.empty((0, 3), np.int64), np.empty((0, parts)))
    cell = np.concatenate([one.cell for one in found])
    area = np.concatenate([one.area for one in found])
    return _sum(cell, area)


def _areas(
    vertices: np.ndarray,
    triangles: np.ndarray,
    part: np.ndarray,
    parts: int,
    cells: tuple[np.ndarray, np.ndarray],
) -> CellAreas:
    key, at = cells
    a, b, c = np.ascontiguousarray(triangles.T)
    apart = np.flatnonzero((key[a] != key[b]) | (key[a] != key[c]))
    within = np.flatnonzero((key[a] == key[b]) & (key[a] == key[c]))
    pieces, source = cut(vertices[triangles[apart]])
    cell = np.concatenate(
        [
            at[a[within]],
            np.floor((pieces[:, 0] + pieces[:, 1] + pieces[:, 2]) / 3).astype(np.int64),
        ]
    )
    size = np.concatenate(
        [
            _sizes(*(vertices[corner[within]] for corner in (a, b, c))),
            _sizes(*np.moveaxis(pieces, 1, 0)),
        ]
    )
    area = np.zeros((len(cell), parts))
    area[np.arange(len(cell)), np.concatenate([part[within], part[apart[source]]])] = size
    return _sum(cell, area)


def _sizes(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(T,) areas of triangles with corners (T, 3)."""
    side = cross_rows(b - a, c - a)
    return np.asarray(0.5 * np.sqrt(np.einsum("ti,ti->t", side, side)))


def _sum(cell: np.ndarray, area: np.ndarray) -> CellAreas:
    if not len(cell):
        return CellAreas(cell, area)
    low = np.array([column.min() for column in cell.T])
    size = [int(column.max()) - least + 1 for column, least in zip(cell.T, low, strict=True)]
    key = np.ravel_multi_index(tuple((cell - low).T), tuple(size))
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    return CellAreas(cell[order[first]], np.add.reduceat(area[order], first, axis=0))


def cut(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pieces (N, 3, 3) of triangles (T, 3, 3), each within one cell of edge 1, and (N,) of which triangle."""
    pieces, source = np.asarray(corners, np.float64), np.arange(len(corners))
    for axis in range(3):
        done: list[tuple[np.ndarray, np.ndarray]] = []
        while len(pieces):
            along = pieces[:, :, axis]
            one, two, three = along[:, 0], along[:, 1], along[:, 2]
            first = np.floor(np.minimum(np.minimum(one, two), three))
            last = np.ceil(np.maximum(np.maximum(one, two), three))  # at or beyond the far end
            whole = last - first <= 1
            done.append((pieces[whole], source[whole]))
            pieces, source = pieces[~whole], source[~whole]
            wall = np.floor((first + last) / 2)[~whole]
            pieces, source = _split(pieces, source, axis, wall)
        pieces = np.concatenate([p for p, _ in done]) if done else pieces
        source = np.concatenate([s for _, s in done]) if done else source
    return pieces, source


def _split(
    pieces: np.ndarray, source: np.ndarray, axis: int, wall: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Every triangle (T, 3, 3) cut by a plane of its own that it crosses, at ``wall`` (T,) along an axis."""
    above = pieces[:, :, axis] > wall[:, None]
    below = pieces[:, :, axis] < wall[:, None]
    # The corner that stands alone on its side is turned to be the first.
    lone_above = above[:, 0].astype(np.int8) + above[:, 1] + above[:, 2] == 1
    alone = np.where(lone_above[:, None], above, below)
    lone = np.where(alone[:, 0], 0, np.where(alone[:, 1], 1, 2))
    rows = np.arange(len(pieces))
    a, b, c = pieces[rows, lone], pieces[rows, (lone + 1) % 3], pieces[rows, (lone + 2) % 3]
    ab, ac = _meet(a, b, axis, wall), _meet(a, c, axis, wall)
    cuts = np.stack(
        [np.stack([a, ab, ac], 1), np.stack([ab, b, c], 1), np.stack([ab, c, ac], 1)]
    ).reshape(-1, 3, 3)
    return cuts, np.tile(source, 3)


def _meet(a: np.ndarray, b: np.ndarray, axis: int, wall: np.ndarray) -> np.ndarray:
    """Where edges from a to b (T, 3) pass their planes; the end that lies on it where one does."""
    step = b[:, axis] - a[:, axis]
    share = np.clip((wall - a[:, axis]) / np.where(step == 0, 1.0, step), 0.0, 1.0)
    place = a + share[:, None] * (b - a)
    place[:, axis] = wall
    return np.asarray(place)
