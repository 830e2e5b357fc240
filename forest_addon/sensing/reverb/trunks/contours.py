"""From the outline of a cut stem to a circle: hull, centre, and radius across the stem's own axis.

The segments of one contour, with the normals of the triangles they come from, go in; the centre in the
cutting plane and the radius come out. The radius is that of the circle with the perimeter of the
contour's convex hull: by Cauchy's formula a hull's perimeter over π is the mean width of its silhouette
over all directions, which is what sound meets. It is exact for the n-gons of ``growth/mesh/tubes`` (rings of
equal perimeter), asks neither for ordered segments nor for a closed or consistently wound mesh, and
does not follow every groove of the bark.
"""

from __future__ import annotations

import math

import numpy as np

# The least squares axis of a surface is trusted if the normals point along it by so much less (ratio of
# mean squares) than across it: cones up to 19° from axis to side; not the top of a sphere.
AXIS_TRUST = 0.25


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
    ordered = np.unique(points, axis=0).tolist()
    if len(ordered) < 3:
        return np.array(ordered).reshape(-1, 2)
    lower = _chain(ordered)
    upper = _chain(ordered[::-1])
    return np.array(lower[:-1] + upper[:-1])


def _chain(points: list[list[float]]) -> list[list[float]]:
    """The points of a left-to-right chain that turn left everywhere."""
    chain: list[list[float]] = []
    for x, y in points:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                break
            chain.pop()
        chain.append([x, y])
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
