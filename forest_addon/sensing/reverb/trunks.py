"""Trunks from the evaluated geometry: where a horizontal plane cuts the wood.

A ``SceneGeometry`` goes in, the stems at one height come out as upright cylinders for the reverb. The
wood triangles that cross the plane give one segment each; segments meet in the mesh edges that their
triangles share, and the connected components of that graph are the contours. ``equivalent_circle``
turns each into a circle.

From the outline of a cut stem to a circle: hull, centre, and radius across the stem's own axis.

The segments of one contour, with the normals of the triangles they come from, go in; the centre in the
cutting plane and the radius come out. The radius is that of the circle with the perimeter of the
contour's convex hull: by Cauchy's formula a hull's perimeter over π is the mean width of its silhouette
over all directions, which is what sound meets. It is exact for the n-gons of ``growth/mesh`` (rings of
equal perimeter), asks neither for ordered segments nor for a closed or consistently wound mesh, and
does not follow every groove of the bark.

Trunks where the sound passes them: between ends of different heights, each at a height of its own.

A path from a source by a trunk to a receiver rises evenly over its horizontal way r_s + r_r, so it meets the
trunk at z_s + (z_r - z_s)·r_s/(r_s + r_r). The wood is cut at a ladder of heights; from each cut those
trunks are taken whose path is nearest to that height. So a leaning or tapering stem is where, and as
thick as, the sound meets it, and a tree that the path passes over is not heard.

The forest goes on: trunks beyond the modelled field, as dense and as thick as those in it.

The trunks of a field go in, Poisson trunks around it come out (Kaneko & Gamper 2021 fill 1 km² so). The
count in any area outside the field is Poisson with the field's density as its mean, positions are
uniform, and each radius is drawn from the field's trunks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from ...base.rows import RowTable
from ...base.trimesh import TriMesh, is_wood
from ...spec import Reverb
from ..rays.geometry import SceneGeometry


@dataclass(frozen=True)
class Trunks(RowTable):
    """N upright cylinders.

    position : (N, 2) centre in the plane, metres.
    radius : (N,) metres.
    tree : (N,) int64, the tree it belongs to, -1 where it belongs to none.
    instance : (N,) int64, the instance that was cut, None where trunks come from no scene.
    thin : how many stems were left out because they are thinner than asked for.
    inside : how many were left out because they lie inside a thicker one of their instance.
    """

    position: np.ndarray
    radius: np.ndarray
    tree: np.ndarray
    instance: np.ndarray | None = None
    thin: int = 0
    inside: int = 0

    def clear_of(self, places: np.ndarray) -> Trunks:
        """Trunks that cover none of the places (P, 2)."""
        free = np.ones(len(self), dtype=bool)
        for place in places:
            free &= np.hypot(*(self.position - place).T) > self.radius
        return self.select(free)

    def with_others(self, *others: Trunks) -> Trunks:
        """Join these trunks and, after them, the others; which instance was cut is forgotten."""
        every = (self, *others)
        return Trunks(
            position=np.concatenate([trunks.position for trunks in every]),
            radius=np.concatenate([trunks.radius for trunks in every]),
            tree=np.concatenate([trunks.tree for trunks in every]),
            thin=max(trunks.thin for trunks in every),
            inside=max(trunks.inside for trunks in every),
        )


def trunks_at_height(
    scene: SceneGeometry,
    height: float,
    min_radius: float = 0.0,
    wood: dict[int, WeldedWood] | None = None,
) -> Trunks:
    """The stems that the plane z = ``height`` cuts, at least ``min_radius`` thick (both metres).

    A vertex in the plane counts as above it, so that a stem reaches from its foot, excluded, to its
    top, included. Triangles with a coordinate that is not finite are passed over.

    wood : of the scene's meshes, by their number, as earlier cuts needed it; what is lacking is added.
    """
    low, high = scene.bounds()
    slack = 1e-9 * (1.0 + abs(height))  # the boxes are rounded; the vertices decide
    crossed = np.flatnonzero((low[:, 2] <= height + slack) & (high[:, 2] >= height - slack))
    wood = {} if wood is None else wood
    for index in np.unique(scene.mesh_index[crossed]).tolist():
        if index not in wood:
            wood[index] = WeldedWood(scene.meshes[index])
    found: list[tuple[int, np.ndarray, float]] = []
    thin = inside = 0
    for instance in crossed:
        transform = scene.transform[instance]
        segments = wood[scene.mesh_index[instance]].cut(transform, height)
        stems, thinner = _stems(*segments, min_radius)
        # those whose centre lies within a thicker one are not counted
        separate: list[tuple[np.ndarray, float]] = []
        for centre, radius in sorted(stems, key=lambda stem: -stem[1]):
            if all(math.dist(centre, other) >= reach for other, reach in separate):
                separate.append((centre, radius))
        thin += thinner
        inside += len(stems) - len(separate)
        found += [(int(instance), centre + transform[:2, 3], radius) for centre, radius in separate]
    of = np.array([instance for instance, _, _ in found], dtype=np.int64)
    return Trunks(
        position=np.array([centre for _, centre, _ in found]).reshape(-1, 2),
        radius=np.array([radius for _, _, radius in found], dtype=np.float64),
        tree=scene.tree[of],
        instance=of,
        thin=thin,
        inside=inside,
    )


class WeldedWood:
    """The wood of one mesh in local space; vertices at the same place are one vertex."""

    def __init__(self, mesh: TriMesh) -> None:
        triangles = mesh.triangles[is_wood(mesh.part)]
        finite = np.isfinite(mesh.vertices).all(axis=1)
        triangles = triangles[finite[triangles].all(axis=1)]
        used, packed = np.unique(triangles, return_inverse=True)
        self.vertices, welded = _places(mesh.vertices[used])
        self.triangles = welded[packed.reshape(-1, 3)].astype(np.int64)
        self._z = np.ascontiguousarray(self.vertices[:, 2])
        of_triangles = self._z[self.triangles.T]
        self._low, self._high = of_triangles.min(axis=0), of_triangles.max(axis=0)

    def cut(
        self, transform: np.ndarray, height: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cut one instance: M segments where triangles cross the plane, which alone are moved to the world.

        Returns
        -------
        (M, 2, 2) x and y of both ends, from the instance's origin; (M, 3) unit normals of the triangles; (M,)
        number of the contour, 0 to the count less 1.
        """
        x, y, up, lift = transform[2]
        lift -= height
        if x == y == 0 and up > 0:  # upright: heights rise as they do in the mesh
            level = self._z * up + lift
            above = level >= 0
            low, high = self._low * up + lift, self._high * up + lift
            crossing = self.triangles[(low < 0) & (high >= 0)]
        else:
            level = self.vertices @ transform[2, :3] + lift
            above = level >= 0
            sides = above[self.triangles]
            crossing = self.triangles[sides.any(axis=1) & ~sides.all(axis=1)]

        # The corner that is alone on its side makes the two crossed edges with the other two.
        side = above[crossing]
        lone = np.where((side.sum(axis=1) == 1)[:, None], side, ~side).argmax(axis=1)
        turned = np.take_along_axis(crossing, (lone[:, None] + np.arange(3)) % 3, axis=1)
        edges = np.sort(
            np.stack([turned[:, [0, 1]], turned[:, [0, 2]]], axis=1), axis=2
        )  # (M, 2, 2) vertex numbers
        a, b = edges[..., 0], edges[..., 1]
        share = (level[a] / (level[a] - level[b]))[..., None]
        local = self.vertices[a] + share * (self.vertices[b] - self.vertices[a])

        corners = self.vertices[crossing] @ transform[:, :3].T
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return (
            local @ transform[:2, :3].T,
            np.divide(normal, length, out=np.zeros_like(normal), where=length > 0),
            _components(a * len(self.vertices) + b),
        )


def _places(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) different places of vertices (V, 3) by x, y and z, and (V,) which of them is a vertex': in a
    third of the time of ``np.unique`` over rows."""
    order = np.lexsort(vertices.T[::-1])
    ordered = vertices[order]
    new = np.ones(len(ordered), dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    which = np.empty(len(order), dtype=np.int64)
    which[order] = np.cumsum(new) - 1
    return ordered[new], which


def _components(edge: np.ndarray) -> np.ndarray:
    """(M,) contour of each segment; ``edge`` (M, 2) names the mesh edges that hold its ends."""
    names, node = np.unique(edge, return_inverse=True)
    node = node.reshape(-1, 2)
    graph = sparse.coo_matrix(
        (np.ones(len(node), np.int8), (node[:, 0], node[:, 1])), shape=(len(names), len(names))
    )
    return csgraph.connected_components(graph, directed=False)[1][node[:, 0]]


def _stems(
    ends: np.ndarray, normal: np.ndarray, contour: np.ndarray, min_radius: float
) -> tuple[list[tuple[np.ndarray, float]], int]:
    """Centre and radius of each contour of segments (``cut``) that is thick enough, and how many are not."""
    step = ends[:, 1] - ends[:, 0]
    length = np.bincount(contour, np.hypot(step[:, 0], step[:, 1]))
    order = np.argsort(contour, kind="stable")
    first = np.searchsorted(contour[order], np.arange(len(length) + 1))
    stems = []
    # The hull of a line has at most twice its length for a perimeter.
    for one in np.flatnonzero(length > (1.0 - ROUNDED) * math.pi * min_radius):
        rows = order[first[one] : first[one + 1]]
        centre, radius = equivalent_circle(ends[rows], normal[rows])
        if radius >= min_radius:
            stems.append((centre, radius))
    return stems, len(length) - len(stems)


# The least squares axis of a surface is trusted if the normals point along it by so much less (ratio of
# mean squares) than across it: cones up to 19° from axis to side; not the top of a sphere.
AXIS_TRUST = 0.25
ROUNDED = 1e-6  # of a length, beyond what rounding makes


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
        return direction[:, 0]
    return np.array([0.0, 0.0, 1.0])


def convex_hull(points: np.ndarray) -> np.ndarray:
    """(H, 2) corners of the convex hull of (P, 2) points, anticlockwise (Andrew's monotone chain).

    Points on a line give its two ends, a single point itself.
    """
    ordered = sorted(set(map(tuple, points.tolist())))
    if len(ordered) < 3:
        return np.array(ordered).reshape(-1, 2)
    return np.array(_chain(ordered)[:-1] + _chain(ordered[::-1])[:-1])


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


STEP = 0.5  # m between heights at most, as far as MOST_CUTS go
MOST_CUTS = 24


def heights_between(rise: float) -> int:
    """Return at how many heights the wood is cut between ends of which one is so much higher, metres."""
    return min(MOST_CUTS, max(1, math.ceil(rise / STEP)))


@dataclass
class TrunkCuts:
    """Cuts of one scene, each made once, at least ``min_radius`` metres thick."""

    scene: SceneGeometry
    min_radius: float
    _at: dict[float, Trunks] = field(default_factory=dict)
    _wood: dict[int, WeldedWood] = field(default_factory=dict)

    def between(self, source: np.ndarray, receiver: np.ndarray) -> Trunks:
        """The trunks between two ends (3,)."""
        low, high = float(source[2]), float(receiver[2])
        count = heights_between(abs(high - low))
        if count == 1:
            return self._cut((low + high) / 2)
        parts = []
        for number in range(count):
            trunks = self._cut(low + (high - low) * (number + 0.5) / count)
            first = np.hypot(*(trunks.position - source[:2]).T)
            whole = first + np.hypot(*(trunks.position - receiver[:2]).T)
            share = np.divide(first, whole, out=np.full_like(first, 0.5), where=whole > 0)
            band = np.minimum((share * count).astype(np.int64), count - 1)
            parts.append(trunks.select(band == number))
        return parts[0].with_others(*parts[1:])

    def _cut(self, height: float) -> Trunks:
        if height not in self._at:
            self._at[height] = trunks_at_height(self.scene, height, self.min_radius, self._wood)
        return self._at[height]


MOST = 20_000_000  # expected trunks; more than memory would like

Field = tuple[tuple[float, float], tuple[float, float]]  # corner with the smallest x and y; extent


def continue_trunks(
    trunks: Trunks,
    field: Field,
    centre: np.ndarray,
    distance: float,
    rng: np.random.Generator,
    clear: np.ndarray | None = None,
) -> Trunks:
    """Trunks outside the field and within ``distance`` metres of ``centre`` (2,).

    field : its corner with the smallest x and y, and its extent along x and y, metres.
    clear : (P, 2) places that no trunk may cover, metres: where the source and the receiver are.

    Raises
    ------
    ValueError : more than ``MOST`` trunks would have to be drawn.
    """
    corner, size = np.asarray(field[0], np.float64), np.asarray(field[1], np.float64)
    within = np.all((trunks.position >= corner) & (trunks.position <= corner + size), axis=1)
    radii = trunks.radius[within]
    expected = len(radii) / float(np.prod(size)) * (2.0 * distance) ** 2
    if expected > MOST:
        raise ValueError(
            f"continuing the forest to {distance:g} m would take {expected:.2g} trunks; "
            "lower continue_to or raise min_radius"
        )
    count = int(rng.poisson(expected))  # in the square around the circle
    position = centre + rng.uniform(-distance, distance, (count, 2))
    radius = radii[rng.integers(0, len(radii), count)] if len(radii) else np.empty(0)
    outside = np.any((position < corner) | (position > corner + size), axis=1)
    keep = outside & (np.hypot(*(position - centre).T) <= distance)
    beyond = Trunks(position[keep], radius[keep], np.full(int(keep.sum()), -1, dtype=np.int64))
    return beyond if clear is None else beyond.clear_of(clear)


def continuation(
    trunks: Trunks,
    reverb: Reverb,
    ends: np.ndarray,
    rng: np.random.Generator | None,
    field: Field | None,
) -> Trunks:
    """The trunks of the forest beyond the field, none of them over the ends (P, 2)."""
    if reverb.continue_to <= 0:
        return trunks.select(np.empty(0, np.int64))
    if rng is None or field is None:
        raise ValueError("continue_to needs a random stream and the field's corner and extent")
    return continue_trunks(trunks, field, ends.mean(axis=0), reverb.continue_to, rng, clear=ends)
