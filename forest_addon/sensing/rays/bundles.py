"""Bundles of rays that are known to meet one face, or nothing, without a look at any ray.

A bundle is all rays that start within a ball of radius r about c and go within an angle α of an axis a.
What is said of it is proved for all of them, by planes through c with a unit normal m: with sin β = m·a, a
point of the bundle at distance t along its ray lies at least t·sin(β - α) - r above the plane.

- A triangle is *beside* the bundle where such a plane has all of the triangle below it and, as far away as
  the triangle, all of the bundle above it. Planes through the triangle's edges are tried, one that
  touches the bundle towards the triangle, one across the axis, and the triangle's sphere against the cone.
- A triangle *holds* the bundle where the bundle is above the planes through its edges and meets its plane.
- Seen past a triangle that holds the bundle, what lies on the far side of its plane is hidden.

A bundle beside all triangles meets nothing; one that a triangle holds, with all others beside it or hidden,
meets that triangle alone. Else its halves of eight are asked, down to single pulses. Edges are kept clear by
more than an engine's float32 may be wrong, so that an engine would say the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .boxes import morton
from .geometry import SceneGeometry, invert_transforms

MOST = 6000  # triangles of a scene, in the world, for which looking through them pays
SIZES = (4096, 512, 64, 8, 1)  # pulses of a bundle, from level to level
CROWDED = 24  # triangles that are neither beside nor hidden: of a small bundle, too many to go on
SLACK = 4e-6  # of the scene's size: how clear of edges a bundle must be
UNKNOWN, NOTHING = -2, -1


@dataclass(frozen=True)
class _Bundles:
    """B bundles: centre (B, 3), radius (B,), axis (B, 3), sine and cosine (B,) of the half angle."""

    centre: np.ndarray
    radius: np.ndarray
    axis: np.ndarray
    sin: np.ndarray
    cos: np.ndarray


class Faces:
    """The triangles of a scene of few, in the world.

    instance, triangle : (T,) which they are.
    """

    def __init__(self, scene: SceneGeometry) -> None:
        regular = np.isfinite(invert_transforms(scene.transform)).all(axis=(1, 2))
        parts, instance, triangle = [np.empty((0, 3, 3))], [], []
        for number, index in enumerate(scene.mesh_index.tolist()):
            mesh, place = scene.meshes[index], scene.transform[number]
            if not regular[number]:
                continue
            world = mesh.vertices @ place[:, :3].T + place[:, 3]
            parts.append(world[mesh.triangles])
            instance.append(np.full(len(mesh.triangles), number))
            triangle.append(np.arange(len(mesh.triangles)))
        corner = np.concatenate(parts)
        none = [np.empty(0, np.int64)]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        size = np.sqrt((normal**2).sum(axis=1))
        usable = np.flatnonzero(np.isfinite(size) & (size > 0))
        self.instance = np.concatenate(none + instance)[usable]
        self.triangle = np.concatenate(none + triangle)[usable]
        self._corner = corner[usable]
        self._normal = normal[usable] / size[usable, None]
        low = self._corner.min(axis=(0, 1), initial=np.inf)
        high = self._corner.max(axis=(0, 1), initial=-np.inf)
        self._size = float((high - low).max()) if len(usable) else 0.0
        self._middle = (self._corner.min(axis=1) + self._corner.max(axis=1)) / 2
        away = self._corner - self._middle[:, None]
        self._round = np.sqrt((away**2).sum(axis=2).max(axis=1, initial=0.0))

    @classmethod
    def of(cls, scene: SceneGeometry) -> Faces | None:
        """The faces of a scene; None where they are too many for looking through them to pay."""
        sizes = np.array([len(mesh.triangles) for mesh in scene.meshes], dtype=np.int64)
        return cls(scene) if sizes[scene.mesh_index].sum() <= MOST else None

    def met(
        self, origins: np.ndarray, directions: np.ndarray, radius: float, spread: float
    ) -> np.ndarray:
        """(P,) the face that all rays near an axis meet first, ``NOTHING`` or ``UNKNOWN``.

        origins, directions : (P, 3) axes, unit vectors. radius : metres that a ray may start beside its axis.
        spread : radians, how far from it a ray may turn.
        """
        found = np.full(len(origins), UNKNOWN)
        finite = np.isfinite(origins.sum(axis=1) + directions.sum(axis=1))
        order = np.flatnonzero(finite)
        order = order[np.argsort(morton(directions[order]), kind="stable")]
        if not len(order):
            return found
        origins, directions = origins[order], directions[order]
        answer = np.full(len(order), UNKNOWN)
        start = np.arange(0, len(order), SIZES[0])
        bundle = np.repeat(np.arange(len(start)), len(self.instance))
        face = np.tile(np.arange(len(self.instance)), len(start))
        for size, finer in zip(SIZES, (*SIZES[1:], 0), strict=True):
            stop = np.minimum(start + size, len(order))
            about = _bundles(origins, directions, start, stop, radius, spread)
            says, bundle, face = self._ask(about, bundle, face, size)
            _fill(answer, start, stop, says)
            if not finer:
                break
            start, bundle, face = _split(start, stop, finer, says, bundle, face)
            if not len(start):
                break
        found[order] = answer
        return found

    def _ask(
        self, about: _Bundles, bundle: np.ndarray, face: np.ndarray, size: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(B,) what is known of bundles, and those pairs (K,), (K,) of them and faces that are open."""
        slack = SLACK * (self._size + np.abs(about.centre).max()) + 1e-6
        near = self._near_sphere(about, bundle, face, slack)
        bundle, face = bundle[near], face[near]
        beside, holds, reach = self._sides(about, bundle, face, slack)
        open_ = np.flatnonzero(~beside)
        bundle, face, holds, reach = bundle[open_], face[open_], holds[open_], reach[open_]
        count = np.bincount(bundle, minlength=len(about.radius))
        says = np.where(count == 0, NOTHING, UNKNOWN)
        holding = np.flatnonzero(holds)
        if len(holding):
            holding = holding[np.lexsort((reach[holding], bundle[holding]))]
            holding = holding[np.diff(bundle[holding], prepend=-1) != 0]
            front = np.full(len(count), -1)
            front[bundle[holding]] = face[holding]
            asked = np.flatnonzero(front[bundle] >= 0)
            first = front[bundle[asked]]
            hidden = (first == face[asked]) | self._behind(
                about.centre[bundle[asked]], first, face[asked], slack
            )
            clear = np.bincount(bundle[asked], ~hidden, len(count)) == 0
            held = (front >= 0) & clear
            says[held] = front[held]
        goes_on = says[bundle] == UNKNOWN
        if size <= 64:
            goes_on &= count[bundle] <= CROWDED
            says[(says == UNKNOWN) & (count > CROWDED)] = UNKNOWN - 1  # asked no further
        return says, bundle[goes_on], face[goes_on]

    def _near_sphere(
        self, about: _Bundles, bundle: np.ndarray, face: np.ndarray, slack: float
    ) -> np.ndarray:
        """(K,) rows of pairs whose bundle may meet the sphere about the face."""
        away = self._middle[face] - about.centre[bundle]
        distance = np.sqrt((away**2).sum(axis=1))
        wide = self._round[face] + about.radius[bundle] + slack
        with np.errstate(divide="ignore", invalid="ignore"):
            sine = wide / distance
            cosine = (away * about.axis[bundle]).sum(axis=1) / distance
        outside = sine < 1
        sine = np.where(outside, sine, 0.0)
        # the angle between axis and middle is over α + asin(sine), as long as that is below 180°
        other = np.sqrt(1 - sine**2)
        limit = about.cos[bundle] * other - about.sin[bundle] * sine
        below = about.cos[bundle] > -other
        near: np.ndarray = np.flatnonzero(~(outside & below & (cosine < limit)))
        return near

    def _sides(
        self, about: _Bundles, bundle: np.ndarray, face: np.ndarray, slack: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(K,) whether faces are beside bundles, (K,) whether they hold them, (K,) metres along the axis."""
        axis, radius = about.axis[bundle], about.radius[bundle] + slack
        sin, cos = about.sin[bundle], about.cos[bundle]
        corner = self._corner[face] - about.centre[bundle, None]
        normal = self._normal[face]
        height = _dot(normal, corner[:, 0])
        facing = _dot(normal, axis)
        middle = self._middle[face] - about.centre[bundle]
        length = np.sqrt(_dot(middle, middle))
        far = np.maximum(np.abs(height), length - self._round[face]) - radius
        with np.errstate(divide="ignore", invalid="ignore"):
            edge = np.cross(corner, np.roll(corner, -1, axis=1))
            edge /= np.sqrt((edge**2).sum(axis=2))[:, :, None]
            inwards = np.einsum("kei,kei->ke", edge, np.roll(corner, -2, axis=1))
            lean = np.einsum("kei,ki->ke", edge, axis) * np.sign(inwards)
            rest = np.sqrt(np.maximum(1 - lean**2, 0))
            above = lean * cos[:, None] - rest * sin[:, None]  # sin(β - α)
            below = -lean * cos[:, None] - rest * sin[:, None]
            least = np.where(far > 0, radius / far, np.inf)[:, None]
            beside = (below > least).any(axis=1)
            held = (above > least).all(axis=1) & (np.abs(height) > radius)
            held &= (np.abs(facing) > sin + 1e-3) & (facing * height > 0)
            reach = height / facing
            # a plane that touches the cone on the side of the face's middle, and one across the axis
            aside = middle - _dot(middle, axis)[:, None] * axis
            aside /= np.sqrt(_dot(aside, aside))[:, None]
        touching = axis * sin[:, None] - aside * cos[:, None]
        for plane in (touching, axis):
            lowest = np.einsum("kei,ki->ke", corner, plane).max(axis=1)
            beside |= (lowest < -radius) & (cos > 0)  # not where the bundle goes all around
        return beside, held, reach

    def _behind(
        self, centre: np.ndarray, front: np.ndarray, face: np.ndarray, slack: float
    ) -> np.ndarray:
        """(K,) whether faces lie on the far side of the planes of those in front, and not in them."""
        normal, foot = self._normal[front], self._corner[front, 0]
        side = np.sign(_dot(normal, foot - centre))
        depth = np.einsum("kei,ki->ke", self._corner[face] - foot[:, None], normal) * side[:, None]
        behind: np.ndarray = (depth.min(axis=1) >= -1e-9) & (depth.max(axis=1) > slack)
        return behind


def _bundles(
    origins: np.ndarray,
    directions: np.ndarray,
    start: np.ndarray,
    stop: np.ndarray,
    radius: float,
    spread: float,
) -> _Bundles:
    """The bundles of rows from ``start`` to ``stop`` (B,)."""
    count = stop - start
    rows = np.repeat(start - (np.cumsum(count) - count), count) + np.arange(int(count.sum()))
    owner = np.repeat(np.arange(len(start)), count)
    first = np.cumsum(count) - count
    origin, way = origins[rows], directions[rows]
    low, high = np.minimum.reduceat(origin, first), np.maximum.reduceat(origin, first)
    centre = (low + high) / 2
    axis = np.add.reduceat(way, first)
    with np.errstate(invalid="ignore", divide="ignore"):
        axis /= np.sqrt(_dot(axis, axis))[:, None]
    chord = way - axis[owner]
    chord = np.sqrt(np.maximum.reduceat(_dot(chord, chord), first))
    angle = 2 * np.arcsin(np.clip(chord / 2, 0, 1)) + spread + 1e-9
    angle = np.where(angle < 1.5, angle, np.nan)  # a bundle all around is known of nothing
    reach = np.sqrt(_dot(high - low, high - low)) / 2
    return _Bundles(centre, reach + radius, axis, np.sin(angle), np.cos(angle))


def _fill(answer: np.ndarray, start: np.ndarray, stop: np.ndarray, says: np.ndarray) -> None:
    """Write what is known of bundles to their pulses."""
    known = np.flatnonzero(says >= NOTHING)
    count = stop[known] - start[known]
    rows = np.repeat(start[known] - (np.cumsum(count) - count), count)
    answer[rows + np.arange(len(rows))] = np.repeat(says[known], count)


def _split(
    start: np.ndarray,
    stop: np.ndarray,
    size: int,
    says: np.ndarray,
    bundle: np.ndarray,
    face: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where the parts of the open bundles start, and their pairs with faces."""
    open_ = np.flatnonzero(says == UNKNOWN)
    parts = -(-(stop[open_] - start[open_]) // size)
    first = np.zeros(len(says), dtype=np.int64)
    first[open_] = np.cumsum(parts) - parts
    of_bundle = np.zeros(len(says), dtype=np.int64)
    of_bundle[open_] = parts
    owner = np.repeat(open_, parts)
    place = np.arange(len(owner)) - first[owner]
    times = of_bundle[bundle]
    within = np.arange(int(times.sum())) - np.repeat(np.cumsum(times) - times, times)
    return (
        start[owner] + size * place,
        np.repeat(first[bundle], times) + within,
        np.repeat(face, times),
    )


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(K,) of vectors (K, 3)."""
    product: np.ndarray = np.einsum("ki,ki->k", a, b)
    return product
