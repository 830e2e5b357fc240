"""Shapes around the points of a cloud, as a classifier sees them, alike for every instrument and density.

A cloud is reduced to the means of its points in cells of 5 cm, so that how many points there were no longer
matters; heights are above the ground, which is the lowest of each square metre. Around each mean follow, at
several radii, the eigenvalue features of Weinmann et al. (2015, ISPRS J. 105:286) by pgeof, and how far what
is there goes on straight up and down and how much of it is near: stems go on, branches do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import griddata
from scipy.ndimage import maximum_filter, median_filter, uniform_filter
from scipy.spatial import cKDTree

EDGE = 0.05  # metres, of a cell
SCALES = ((0.05, 0.125), (0.05, 0.25), (0.1, 0.5), (0.2, 1.0))  # metres: cells and ball around them
MOST = 200  # neighbours that count; a level surface has 79 cells in each of the larger balls
KINDS = ("Linearity", "Planarity", "Scattering", "VerticalityPGEOF", "Verticality", "Curvature")
WORDS = ("linearity", "planarity", "scattering", "verticality", "wall", "curvature")
REACH, LAYER = 1.0, 0.1  # metres up and down an upright column, and of a layer of it
COLUMNS = (1, 3)  # layers' heights that a column is wide
BOXES = ((3, 7), (5, 13))  # layers' heights that two level slabs, three high, are wide
NAMES = (
    *(f"{word} {radius:g} m" for _, radius in SCALES for word in WORDS),
    *(f"{way} {wide * LAYER:.1f} m" for wide in COLUMNS for way in ("above", "below")),
    *(f"inner {inner * LAYER:.1f} m" for inner, _ in BOXES),
)


@dataclass(frozen=True)
class VoxelCells:
    """Cells of a cloud that hold a point.

    centre : (C, 3) metres, the mean of their points. height : (C,) metres above the ground.
    of_point : (P,) the cell of each point.
    """

    centre: np.ndarray
    height: np.ndarray
    of_point: np.ndarray

    def majority(self, flags: np.ndarray) -> np.ndarray:
        """(C,) share of the points (P,) of each cell that have a flag."""
        count = np.bincount(self.of_point, minlength=len(self.centre))
        return np.bincount(self.of_point, flags, len(self.centre)) / count


def cells_of(points: np.ndarray, edge: float = EDGE) -> VoxelCells:
    """Reduce points (P, 3), metres, to the means of cells."""
    centre, of_point = means_of(points, edge)
    return VoxelCells(centre, centre[:, 2] - ground_below(centre), of_point)


def means_of(points: np.ndarray, edge: float = EDGE) -> tuple[np.ndarray, np.ndarray]:
    """(C, 3) means of the points of each cell of a grid, and (P,) the cell of each point."""
    index = np.floor((points - points.min(axis=0)) / edge).astype(np.int64)
    wide = index.max(axis=0) + 1
    key = (index[:, 0] * wide[1] + index[:, 1]) * wide[2] + index[:, 2]
    _, of_point = np.unique(key, return_inverse=True)
    count = np.bincount(of_point)
    return np.stack([np.bincount(of_point, axis) / count for axis in points.T], 1), of_point


def ground_below(points: np.ndarray, edge: float = 1.0) -> np.ndarray:
    """(P,) height of the ground below points (P, 3): the lowest of squares, where it is like its neighbours.

    A square whose lowest point is more than its size above the lowest of its neighbours saw no ground; the
    ground goes on there between the others.
    """
    cell = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / edge).astype(int)
    low = np.full(cell.max(axis=0) + 1, np.inf)
    np.minimum.at(low, tuple(cell.T), points[:, 2])
    seen = np.isfinite(low)
    middle = median_filter(np.where(seen, low, np.median(low[seen])), size=3)
    good = seen & (np.abs(low - middle) < edge)
    if good.sum() < 4:
        return np.full(len(points), np.percentile(points[:, 2], 0.5))
    known, value = (np.argwhere(good) + 0.5) * edge, low[good]
    place = points[:, :2] - points[:, :2].min(axis=0)
    flat = np.ptp(known, axis=0).min() == 0  # a line of squares has no triangles
    found = np.full(len(place), np.nan) if flat else griddata(known, value, place)
    nearest = value[cKDTree(known).query(place)[1]]
    return np.where(np.isnan(found), nearest, found)


def features_of(cells: VoxelCells) -> np.ndarray:
    """(C, len(NAMES)) float32 features of cells."""
    centre = cells.centre - cells.centre.min(axis=0)
    shapes = [_shapes(centre, *scale) for scale in SCALES]
    found = np.column_stack([*shapes, *_columns(centre), *_boxes(centre)])
    return np.nan_to_num(found, nan=0.0).astype(np.float32)


def _shapes(centre: np.ndarray, edge: float, radius: float) -> np.ndarray:
    """(C, len(KINDS)) eigenvalue features of balls around cells; wide balls are taken of coarser cells."""
    import pgeof  # an extra: see [project.optional-dependencies] study

    wanted = [getattr(pgeof.EFeatureID, kind) for kind in KINDS]
    coarse, of_fine = means_of(centre, edge) if edge > EDGE else (centre, slice(None))
    near = np.ascontiguousarray(coarse, dtype=np.float32)
    return np.asarray(pgeof.compute_features_selected(near, radius, MOST, wanted))[of_fine]


def _columns(centre: np.ndarray) -> list[np.ndarray]:
    """Shares of the layers above and below a cell in which a thin upright column holds something."""
    index = np.floor((centre - centre.min(axis=0)) / LAYER).astype(int)
    layers = round(REACH / LAYER)
    filled = np.zeros(np.add(index.max(axis=0), (1, 1, 1 + 2 * layers)), dtype=bool)
    index[:, 2] += layers
    filled[tuple(index.T)] = True
    found = []
    for wide in COLUMNS:
        column = maximum_filter(filled, size=(wide, wide, 1))
        sums = np.cumsum(column, axis=2, dtype=np.uint16)
        x, y, z = index.T
        above = sums[x, y, z + layers] - sums[x, y, z]
        below = sums[x, y, z - 1] - np.where(z > layers, sums[x, y, z - layers - 1], 0)
        found += [above / layers, below / layers]
    return found


def _boxes(centre: np.ndarray) -> list[np.ndarray]:
    """Shares of what a level slab holds that stands near its middle."""
    index = np.floor((centre - centre.min(axis=0)) / LAYER).astype(int)
    filled = np.zeros(index.max(axis=0) + 1, dtype=np.float32)
    filled[tuple(index.T)] = 1.0
    found = []
    for inner, outer in BOXES:
        few, many = (
            wide**2 * uniform_filter(filled, (wide, wide, 3), mode="constant")[tuple(index.T)]
            for wide in (inner, outer)
        )
        found.append(few / np.maximum(many, 1e-6))
    return found
