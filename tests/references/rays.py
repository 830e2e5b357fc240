"""Rays by brute force, and scenes that they are cast into.

A ray caster without any tree: every ray against every triangle of every instance, float64.

The reference for the casters in ``blender/``, and the caster of tests that run without Blender. Rays
and triangles go in, the closest ``Hits`` come out (Möller & Trumbore 1997, both faces, edges
included). Each instance is met from its own origin, so that an offset of 1e6 m costs few digits.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from forest_addon.base.trimesh import GROUND, LEAF, OTHER, WOOD, TriMesh, join
from forest_addon.sensing.rays.caster import Hits, RayCaster, hit_normals
from forest_addon.sensing.rays.geometry import SceneGeometry

EDGE = 1e-12  # barycentric slack: a ray aimed at a shared edge meets at least one of its triangles
PAIRS = 1_000_000  # rays x triangles at a time


class BruteCaster(RayCaster):
    """The ``RayCaster`` protocol over a ``SceneGeometry``; time grows with rays x triangles."""

    engine = "brute force"

    def __init__(self, scene: SceneGeometry) -> None:
        self.scene = scene

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
        time: float | np.ndarray = 0.0,
    ) -> Hits:
        """The closest hit of each ray, by meeting them all."""
        origin = np.asarray(origins, np.float64).reshape(-1, 3)
        direction = _unit(np.asarray(directions, np.float64).reshape(-1, 3))
        far = np.broadcast_to(np.asarray(max_distance, np.float64), len(origin))
        near = np.broadcast_to(np.asarray(min_distance, np.float64), len(origin))
        left = Hits.misses(len(origin)) if leaving is None else leaving
        hits = Hits.misses(len(origin))
        for index in range(len(self.scene)):
            corners = self._corners(index)
            if not len(corners):
                continue
            step = max(1, PAIRS // len(corners))
            for first in range(0, len(origin), step):
                rows = np.arange(first, min(first + step, len(origin)))
                start = origin[rows] - self.scene.transform[index, :, 3]
                t = ray_parameters(start, direction[rows], corners)
                t[~(t <= far[rows, None]) | ~(t >= near[rows, None])] = np.inf
                t[left.found[rows, None] & (t <= near[rows, None])] = np.inf
                own = left.instance[rows] == index
                t[own, left.triangle[rows[own]]] = np.inf
                nearest = t.argmin(axis=1)
                reached = t[np.arange(len(t)), nearest]
                closer = np.flatnonzero(reached < hits.distance[rows])
                nothing = np.full((len(closer), 3), np.nan)
                found = Hits(reached[closer], np.full(len(closer), index), nearest[closer], nothing)
                hits.put(rows[closer], found)
        return replace(hits, normal=hit_normals(self.scene, replace(hits, normal=None)))

    def occluded(self, *rays: Any, **limits: Any) -> np.ndarray:
        """(R,) bool: whether ``cast`` finds anything."""
        return self.cast(*rays, **limits).found

    def _corners(self, index: int) -> np.ndarray:
        """(T, 3, 3) corners of one instance's triangles, turned as the world, from its origin."""
        mesh = self.scene.meshes[self.scene.mesh_index[index]]
        transform = self.scene.transform[index]
        corners: np.ndarray = (mesh.vertices @ transform[:, :3].T)[mesh.triangles]
        return corners


def ray_parameters(origins: np.ndarray, directions: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(R, T) distance >= 0 at which rays (R, 3) meet triangles (T, 3, 3); inf for a miss."""
    a = corners[:, 0]
    u, v = corners[:, 1] - a, corners[:, 2] - a
    with np.errstate(all="ignore"):
        p = np.cross(directions[:, None, :], v[None, :, :])
        determinant = np.einsum("tk,rtk->rt", u, p)
        s = origins[:, None, :] - a[None, :, :]
        first = np.einsum("rtk,rtk->rt", s, p) / determinant
        q = np.cross(s, u[None, :, :])
        second = np.einsum("rk,rtk->rt", directions, q) / determinant
        t: np.ndarray = np.einsum("tk,rtk->rt", v, q) / determinant
        met = (first >= -EDGE) & (second >= -EDGE) & (first + second <= 1 + EDGE) & (t >= 0)
    return np.where(met, t, np.inf)


def _unit(directions: np.ndarray) -> np.ndarray:
    """(R, 3) unit vectors in float64; NaN where a direction is zero or not finite."""
    with np.errstate(all="ignore"):
        scaled = directions / np.abs(directions).max(axis=1, keepdims=True)
        return scaled / np.linalg.norm(scaled, axis=1, keepdims=True)


# -------------------------------------------------------------------------------------- lidar scenes
# Scenes of a few flat things, whose every distance is known in closed form.


def scene_with(*meshes):
    count = len(meshes)
    return SceneGeometry(
        meshes=meshes,
        transform=np.tile(np.eye(3, 4), (count, 1, 1)),
        mesh_index=np.arange(count),
        object_name=("x",) * count,
        tree=np.arange(count) - 1,
        species=np.arange(count) - 1,
    )


def quad(corners, part):
    """Two triangles."""
    return TriMesh.of_part(np.asarray(corners, float), np.array([[0, 1, 2], [0, 2, 3]]), part)


def level(low, high, height, part):
    """A rectangle at a height."""
    (x, y), (u, v) = low, high
    return quad([(x, y, height), (u, y, height), (u, v, height), (x, v, height)], part)


def ground(extent=500.0):
    return level((-extent, -extent), (extent, extent), 0.0, GROUND)


def wall(x, half=500.0):
    return quad([[x, -half, 0], [x, half, 0], [x, half, half], [x, -half, half]], WOOD)


def sheet(distance, part=OTHER, tilt=0.0, low=-50.0, high=50.0):
    """A plane across the X axis from y = low to y = high, turned about Z by ``tilt`` radians."""
    y, z = np.array([low, high, high, low]), np.array([-50.0, -50.0, 50.0, 50.0])
    return quad(np.stack([distance + y * np.tan(tilt), y, z], axis=1), part)


# ----------------------------------------------------------------------------------- ordinary scenes
# Ordinary scenes of boxes, walls, ground and leaves, drawn by seed; some of their faces lie on others.

FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def box(low, high, part):
    """A closed box of twelve triangles."""
    ends = np.array([low, high], float)
    corners = np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(-1, 3)
    return join([quad(corners[face], part) for face in FACES])


def ordinary(rng: np.random.Generator) -> SceneGeometry:
    """Ground, and on it what is drawn: a road at its height, boxes that share a face, a wall that stands
    there twice, a card of a leaf with both of its sides, a box sunk into the ground up to its top."""
    half = rng.uniform(6, 20)
    things = [(level((-half, -half), (half, half), 0.0, GROUND), 0.2)]
    for _ in range(int(rng.integers(1, 5))):
        kind = rng.integers(6)
        x, y = rng.uniform(-5, 5, 2)
        w, d, h = rng.uniform(0.3, 3, 3)
        part, bright = rng.choice([WOOD, OTHER]), rng.uniform(0.1, 0.9)
        one = box((x, y, 0), (x + w, y + d, h), part)
        if kind == 0:  # a road
            things.append((level((x, -half), (x + w, half), 0.0, OTHER), bright))
        elif kind == 1:
            things += [(one, bright), (box((x + w, y, 0), (x + 2 * w, y + d, h), WOOD), 0.5)]
        elif kind == 2:  # the same twice, under two names
            things += [(one, bright), (one, rng.choice([bright, 0.5]))]
        elif kind == 3:
            things.append((box((x, y, -h), (x + w, y + d, 0), part), bright))
        elif kind == 4:
            card = quad([(x, y, h), (x + w, y, h), (x + w, y, h + d), (x, y, h + d)], LEAF)
            back = TriMesh.of_part(card.vertices, card.triangles[:, ::-1], LEAF)
            things.append((join([card, back]), bright))
        else:
            shelf = level((x - 1, y - 1), (x + w, y + d), h, OTHER)
            things += [(one, bright), (shelf, 0.5)]
    count = len(things)
    place = np.tile(np.eye(3, 4), (count, 1, 1))
    if rng.random() < 0.5:  # somewhere far off, turned
        turn, shift = rng.uniform(0, 6), rng.uniform(-300, 300, 3)
        cos, sin = np.cos(turn), np.sin(turn)
        place[:, :3, :3] = [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]
        place[:, :, 3] = shift
    none = np.full(count, -1)
    names = tuple(f"thing {n}" for n in range(count))
    meshes, bright = zip(*things, strict=True)
    return SceneGeometry(
        tuple(meshes), place, np.arange(count), names, none, none, reflectance=np.array(bright)
    )
