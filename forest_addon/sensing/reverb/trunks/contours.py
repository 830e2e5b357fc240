"""From the outline of a cut stem to a circle: hull, centre, and radius across the stem's own axis.

The segments of one contour, with the normals of the triangles they come from, go in; the centre in the
cutting plane and the radius come out. The radius is that of the circle with the perimeter of the
contour's convex hull: by Cauchy's formula a hull's perimeter over π is the mean width of its silhouette
over all directions, which is what sound meets. It is exact for the n-gons of ``growth/mesh`` (rings of
equal perimeter), asks neither for ordered segments nor for a closed or consistently wound mesh, and
does not follow every groove of the bark.
"""

from __future__ import annotations

import math

import numpy as np

# The least squares axis of a surface is trusted if the normals point along it by so much less (ratio of
# mean squares) than across it: cones up to 19° from axis to side; not the top of a sphere.
AXIS_TRUST = 0.25
ROUNDED = 1e-6  # of a bound, beyond what rounding makes
FLAT = 1e-9  # of the normals' mean squares, the second over the largest


def equivalent_circle(ends: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (2,) and radius in metres of a stem that a horizontal plane cuts.

    ends : (M, 2, 2) x and y of both ends of M segments, in any order, closed or not.
    normal : (M, 3) unit normals of the surface at the segments, either way round; 0 where unknown.

    A leaning stem is cut in an ellipse. The hull is measured in the projection along the stem's axis,
    so that a leaning cylinder, and a branch that crosses the plane, have their own radius.
    """
    points = ends.reshape(-1, 2)
    centre = hull_centre(convex_hull(points), ends)
    axis = surface_axis(normal, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
    # Along the axis, what lies in its horizontal direction is shortened by its vertical share.
    lean = axis[:2]
    section = (points - centre) @ (np.eye(2) - np.outer(lean, lean) / (1.0 + abs(axis[2])))
    hull = convex_hull(section)
    perimeter = np.linalg.norm(np.roll(hull, -1, axis=0) - hull, axis=1).sum()
    return centre, float(perimeter / (2.0 * math.pi))


def largest_radii(
    ends: np.ndarray, normal: np.ndarray, contour: np.ndarray, count: int
) -> np.ndarray:
    """(C,) metres that the radius of no contour is above, for all of them at once.

    ends, normal : as of ``equivalent_circle``. contour : (M,) which of C each segment is of.

    Of two convex shapes the inner one has the smaller perimeter: the hull of a section lies within the
    octagon about it.
    """
    step = ends[:, 1] - ends[:, 0]
    weight = np.hypot(step[:, 0], step[:, 1])
    scatter = np.empty((count, 3, 3))
    for i in range(3):
        for j in range(3):
            scatter[:, i, j] = np.bincount(contour, weight * normal[:, i] * normal[:, j], count)
    strength, direction = np.linalg.eigh(scatter)
    # Where rounding may decide whether an axis is trusted, the outline is left as it is.
    trusted = strength[:, 0] < (1.0 - ROUNDED) * AXIS_TRUST * strength[:, 1]
    trusted &= strength[:, 1] > FLAT * strength[:, 2]  # of what is flat, any axis may be taken
    lean = np.where(trusted[:, None], direction[:, :2, 0], 0.0)
    shrunk = 1.0 + np.where(trusted, np.abs(direction[:, 2, 0]), 1.0)
    along = np.einsum("mek,mk->me", ends, lean[contour]) / shrunk[contour, None]
    section = ends - along[:, :, None] * lean[contour, None, :]
    x, y = section[:, :, 0], section[:, :, 1]
    wide, deep, up, down = (_extent(line, contour, count) for line in (x, y, x + y, x - y))
    # Its four sides that lean are cut off the corners of the box about it: 2 of each become √2.
    cut = 2.0 * (wide + deep) - up - down
    perimeter = 2.0 * (wide + deep) - (2.0 - math.sqrt(2.0)) * np.maximum(cut, 0.0)
    found: np.ndarray = perimeter * ((1.0 + ROUNDED) / (2.0 * math.pi))
    return found


def _extent(line: np.ndarray, contour: np.ndarray, count: int) -> np.ndarray:
    """(C,) from the least to the largest of values (M, 2) of each contour."""
    least, most = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(least, contour, line.min(axis=1))
    np.maximum.at(most, contour, line.max(axis=1))
    return most - least


def surface_axis(normal: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(3,) unit direction that the normals (M, 3) are most at right angles to; Z where none is."""
    scatter = np.einsum("m,mi,mj->ij", weight, normal, normal)
    strength, direction = np.linalg.eigh(scatter)
    if strength[0] < AXIS_TRUST * strength[1]:
        axis: np.ndarray = direction[:, 0]
        return axis
    return np.array([0.0, 0.0, 1.0])


def convex_hull(points: np.ndarray) -> np.ndarray:
    """(H, 2) corners of the convex hull of (P, 2) points, anticlockwise (Andrew's monotone chain).

    Points on a line give its two ends, a single point itself.
    """
    ordered = sorted(set(map(tuple, points.tolist())))
    if len(ordered) < 3:
        return np.array(ordered).reshape(-1, 2)
    lower = _chain(ordered)
    upper = _chain(ordered[::-1])
    return np.array(lower[:-1] + upper[:-1])


def _chain(points: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """The points of a left-to-right chain that turn left everywhere."""
    chain: list[tuple[float, ...]] = []
    for x, y in points:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                break
            chain.pop()
        chain.append((x, y))
    return chain


def hull_centre(hull: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(2,) centroid of the hull's area; of the segments' middles where it has none."""
    middle: np.ndarray = ends.mean(axis=(0, 1))
    corner = hull - middle
    following = np.roll(corner, -1, axis=0)
    cross = corner[:, 0] * following[:, 1] - corner[:, 1] * following[:, 0]
    span = float(np.ptp(corner, axis=0).max(initial=0.0))
    if cross.sum() <= 1e-12 * span**2:
        return middle
    return middle + ((corner + following) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())
