"""Area by cell against polygons that are clipped cell by cell (Sutherland & Hodgman), one after the other."""

import itertools

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.growth.mesh.cells import areas_by_cell, triangle_areas


def clipped(polygon, axis, wall, above):
    """The part of a polygon on one side of a plane."""
    kept = []
    for a, b in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        da, db = (p[axis] - wall if above else wall - p[axis] for p in (a, b))
        if da >= 0:
            kept.append(a)
        if (da < 0) != (db < 0):
            kept.append(a + da / (da - db) * (b - a))
    return kept


def area(polygon):
    total = np.zeros(3)
    for b, c in itertools.pairwise(polygon[1:]):
        total += np.cross(b - polygon[0], c - polygon[0])
    return np.linalg.norm(total) / 2


def brute(triangle, edge):
    """{cell: area} of one triangle."""
    low = np.floor(triangle.min(axis=0) / edge).astype(int)
    high = np.floor(triangle.max(axis=0) / edge).astype(int)
    found = {}
    for cell in itertools.product(*(range(a, b + 1) for a, b in zip(low, high, strict=True))):
        polygon = list(triangle)
        for axis in range(3):
            for wall, above in ((cell[axis] * edge, True), ((cell[axis] + 1) * edge, False)):
                polygon = clipped(polygon, axis, wall, above) if polygon else polygon
        if len(polygon) > 2 and area(polygon) > 1e-13:
            found[cell] = area(polygon)
    return found


@pytest.mark.medium
@pytest.mark.parametrize("edge", [0.11, 0.3, 1.7])
def test_areas_are_those_of_clipped_polygons(edge):
    rng = stream(4, "cells")
    corners = rng.normal(0, 0.3, (20, 3, 3)) - 0.7  # cells of negative number too
    part = rng.integers(0, 2, len(corners))
    found = areas_by_cell(corners.reshape(-1, 3), np.arange(60).reshape(-1, 3), part, 2, edge)
    wanted = {}
    for triangle, kind in zip(corners, part, strict=True):
        for cell, size in brute(triangle, edge).items():
            wanted.setdefault(cell, np.zeros(2))[kind] += size
    got = {tuple(cell): size for cell, size in zip(found.cell.tolist(), found.area, strict=True)}
    for cell in wanted.keys() | got.keys():
        assert np.allclose(wanted.get(cell, 0.0), got.get(cell, 0.0), atol=1e-12)


def test_sums_are_the_area_also_where_corners_lie_on_walls():
    rng = stream(5, "cells")
    corners = np.concatenate(
        [
            np.rint(rng.normal(0, 3, (200, 3, 3))) / 2,  # corners, edges and faces on walls
            rng.normal(0, 1e-9, (50, 3, 3)) + 0.5,  # a wall within rounding
            rng.normal(1e6, 2, (50, 3, 3)),  # a map's coordinates
            np.repeat(rng.normal(0, 1, (10, 1, 3)), 3, axis=1),  # no area
        ]
    )
    triangles = np.arange(3 * len(corners)).reshape(-1, 3)
    found = areas_by_cell(corners.reshape(-1, 3), triangles, np.zeros(len(corners), int), 1, 0.5)
    side = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    whole = 0.5 * np.linalg.norm(side, axis=1).sum()
    assert abs(found.area.sum() - whole) < 1e-9 * whole
    assert len(np.unique(found.cell, axis=0)) == len(found.cell)


def test_areas_that_are_known_keep_their_sum_far_from_the_origin():
    """Leaves of a centimetre in a map's coordinates, where corners have lost half of their digits."""
    rng = stream(6, "cells")
    corners = rng.normal(0, 0.01, (500, 3, 3)) + rng.normal(0, 2, (500, 1, 3))
    triangles = np.arange(1500).reshape(-1, 3)
    size = triangle_areas(corners.reshape(-1, 3), triangles)
    part = rng.integers(0, 2, 500)
    found = areas_by_cell(corners.reshape(-1, 3) + 6e6, triangles, part, 2, 0.1, size)
    assert np.allclose(found.area.sum(axis=0), np.bincount(part, size), rtol=1e-13)
    assert (np.abs(found.cell * 0.1 - 6e6) < 12).all()


def test_nothing_has_no_cells():
    none = np.empty((0, 3))
    found = areas_by_cell(none, np.empty((0, 3), int), np.empty(0, int), 2, 0.5)
    assert found.cell.shape == (0, 3)
    assert found.area.shape == (0, 2)
