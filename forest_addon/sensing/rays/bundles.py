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
CROWDED = 48  # triangles that are neither beside nor hidden: of a small bundle, too many to go on
SLACK = 4e-6  # of the scene's size: how clear of edges a bundle must be
UNKNOWN, NOTHING = -2, -1


@dataclass(frozen=True)
class _Bundles:
    """B bundles: centre (3, B), radius (B,), axis (3, B), sine and cosine (B,) of the half angle."""

    centre: np.ndarray
    radius: np.ndarray
    axis: np.ndarray
    sin: np.ndarray
    cos: np.ndarray


@dataclass(frozen=True)
class _Sights:
    """F faces as each is seen from a point.

    corner : (3, 3, F) from the point: of each coordinate and each corner. edge : (3, 3, F) unit normals of
    the planes through the point and an edge, towards the face: of each coordinate and each edge.
    middle : (3, F) from the point. height : (F,) of the face's plane above the point. least : (F,) metres,
    at least as near as any of the face.
    """

    corner: np.ndarray
    edge: np.ndarray
    middle: np.ndarray
    height: np.ndarray
    least: np.ndarray

    def take(self, face: np.ndarray) -> _Sights:
        """Some of them."""
        return _Sights(*(values.take(face, -1) for values in vars(self).values()))


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
        # of each coordinate (and each corner) an array
        self._corner = np.ascontiguousarray(corner[usable].T)
        self._normal = np.ascontiguousarray((normal[usable] / size[usable, None]).T)
        low = self._corner.min(axis=(1, 2), initial=np.inf)
        high = self._corner.max(axis=(1, 2), initial=-np.inf)
        self._size = float((high - low).max()) if len(usable) else 0.0
        self._middle = (self._corner.min(axis=1) + self._corner.max(axis=1)) / 2
        away = self._corner - self._middle[:, None]
        self._round = np.sqrt((away**2).sum(axis=0).max(axis=0, initial=0.0))

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
        origins = origins[order].T.copy()
        ways = directions[order].T.copy()
        sights = None
        if (origins == origins[:, :1]).all():  # then faces are seen from one point
            origins = origins[:, :1]
            sights = self._seen_from(origins, np.arange(len(self.instance)))
        answer = np.full(len(order), UNKNOWN)
        start = np.arange(0, len(order), SIZES[0])
        bundle = np.repeat(np.arange(len(start)), len(self.instance))
        face = np.tile(np.arange(len(self.instance)), len(start))
        for size, finer in zip(SIZES, (*SIZES[1:], 0), strict=True):
            stop = np.minimum(start + size, len(order))
            about = _bundles(origins, ways, start, stop, radius, spread)
            says, bundle, face = self._ask(about, sights, bundle, face, size)
            _fill(answer, start, stop, says)
            if not finer:
                break
            start, bundle, face = _split(start, stop, finer, says, bundle, face)
            if not len(start):
                break
        found[order] = answer
        return found

    def _seen_from(self, centre: np.ndarray, face: np.ndarray) -> _Sights:
        """Faces (F,) as they are seen from points (3, F) or (3, 1)."""
        corner = self._corner.take(face, 2) - centre[:, None]
        height = _dot(self._normal.take(face, 1), corner[:, 0])
        middle = self._middle.take(face, 1) - centre
        least = np.maximum(np.abs(height), np.sqrt(_dot(middle, middle)) - self._round[face])
        with np.errstate(divide="ignore", invalid="ignore"):
            edge = _cross(corner, np.roll(corner, -1, axis=1))
            edge *= np.sign(_dot(edge, np.roll(corner, -2, axis=1))) / np.sqrt(_dot(edge, edge))
        return _Sights(corner, edge, middle, height, least)

    def _ask(
        self,
        about: _Bundles,
        sights: _Sights | None,
        bundle: np.ndarray,
        face: np.ndarray,
        size: int,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(B,) what is known of bundles, and those pairs (K,), (K,) of them and faces that are open.

        sights : of all faces, where all bundles have one centre.
        """
        slack = SLACK * (self._size + np.abs(about.centre).max()) + 1e-6
        if sights is None:
            middle = self._middle.take(face, 1) - about.centre.take(bundle, 1)
        else:
            middle = sights.middle.take(face, 1)
        near = self._near_sphere(about, middle, bundle, face, slack)
        bundle, face = bundle[near], face[near]
        centre = about.centre.take(bundle, 1)
        seen = self._seen_from(centre, face) if sights is None else sights.take(face)
        facing = _dot(self._normal.take(face, 1), about.axis.take(bundle, 1))
        beside, holds = _sides(about, seen, bundle, facing, slack)
        open_ = np.flatnonzero(~beside)
        bundle, face, holds = bundle[open_], face[open_], holds[open_]
        count = np.bincount(bundle, minlength=len(about.radius))
        says = np.where(count == 0, NOTHING, UNKNOWN)
        holding = np.flatnonzero(holds)
        if len(holding):
            centre = centre.take(open_, 1)
            reach = seen.height[open_[holding]] / facing[open_[holding]]
            holding = holding[np.lexsort((reach, bundle[holding]))]
            holding = holding[np.diff(bundle[holding], prepend=-1) != 0]
            front = np.full(len(count), -1)
            front[bundle[holding]] = face[holding]
            first = front[bundle]
            asked = np.flatnonzero((first >= 0) & (first != face))
            hidden = self._behind(centre.take(asked, 1), first[asked], face[asked], slack)
            clear = np.bincount(bundle[asked], ~hidden, len(count)) == 0
            held = (front >= 0) & clear
            says[held] = front[held]
        goes_on = says[bundle] == UNKNOWN
        if size <= 64:
            goes_on &= count[bundle] <= CROWDED
            says[(says == UNKNOWN) & (count > CROWDED)] = UNKNOWN - 1  # asked no further
        return says, bundle[goes_on], face[goes_on]

    def _near_sphere(
        self,
        about: _Bundles,
        middle: np.ndarray,
        bundle: np.ndarray,
        face: np.ndarray,
        slack: float,
    ) -> np.ndarray:
        """(K,) rows of pairs whose bundle may meet the sphere about the face's middle (3, K)."""
        distance = np.sqrt(_dot(middle, middle))
        wide = self._round[face] + about.radius[bundle]
        wide += slack
        with np.errstate(divide="ignore", invalid="ignore"):
            sine = wide / distance
            cosine = _dot(middle, about.axis.take(bundle, 1))
            cosine /= distance
        outside = sine < 1
        sine[~outside] = 0.0
        # the angle between axis and middle is over α + asin(sine), as long as that is below 180°
        other = np.sqrt(1 - sine**2)
        cos, sin = about.cos[bundle], about.sin[bundle]
        limit = cos * other
        limit -= sin * sine
        outside &= cos > -other
        outside &= cosine < limit
        near: np.ndarray = np.flatnonzero(~outside)
        return near

    def _behind(
        self,
        centre: np.ndarray,
        front: np.ndarray,
        face: np.ndarray,
        slack: float,
    ) -> np.ndarray:
        """(K,) whether faces lie on the far side of the planes of those in front, and not in them."""
        normal, foot = self._normal.take(front, 1), self._corner[:, 0].take(front, 1)
        side = np.sign(_dot(normal, foot - centre))
        depth = _dot(self._corner.take(face, 2) - foot[:, None], normal[:, None]) * side
        behind: np.ndarray = (depth.min(axis=0) >= -1e-9) & (depth.max(axis=0) > slack)
        return behind


def _sides(
    about: _Bundles, seen: _Sights, bundle: np.ndarray, facing: np.ndarray, slack: float
) -> tuple[np.ndarray, np.ndarray]:
    """(K,) whether faces are beside bundles, (K,) whether they hold them.

    facing : (K,) cosine between the axis and the face's normal.
    """
    axis, radius = about.axis.take(bundle, 1), about.radius[bundle] + slack
    sin, cos = about.sin[bundle], about.cos[bundle]
    far = seen.least - radius
    with np.errstate(divide="ignore", invalid="ignore"):
        lean = _dot(seen.edge, axis[:, None])
        rest = 1 - lean**2
        np.sqrt(np.maximum(rest, 0, out=rest), out=rest)
        rest *= sin
        lean *= cos
        least = np.where(far > 0, radius / far, np.inf)
        beside = np.fmin.reduce(lean + rest, axis=0) < -least
        lean -= rest  # sin(β - α)
        held = (lean.min(axis=0) > least) & (np.abs(seen.height) > radius)
        held &= (np.abs(facing) > sin + 1e-3) & (facing * seen.height > 0)
        left = np.flatnonzero(~(beside | held) & (cos > 0))  # not where a bundle goes all around
        # a plane that touches the cone on the side of the face's middle, and one across the axis
        axis, middle = axis.take(left, 1), seen.middle.take(left, 1)
        aside = middle - _dot(middle, axis) * axis
        aside /= np.sqrt(_dot(aside, aside))
    touching = axis * sin[left] - aside * cos[left]
    corner = seen.corner.take(left, 2)
    out = np.zeros(len(left), dtype=bool)
    for plane in (touching, axis):
        out |= _dot(corner, plane[:, None]).max(axis=0) < -radius[left]
    beside[left[out]] = True
    return beside, held


def _bundles(
    origins: np.ndarray,
    ways: np.ndarray,
    start: np.ndarray,
    stop: np.ndarray,
    radius: float,
    spread: float,
) -> _Bundles:
    """The bundles of columns from ``start`` to ``stop`` (B,) of origins (3, P), or (3, 1) for all, and unit
    directions (3, P)."""
    count = stop - start
    first = np.cumsum(count) - count
    total = int(count.sum())
    owner = np.repeat(np.arange(len(start)), count)
    shared = origins.shape[1] == 1 < ways.shape[1]
    if total < ways.shape[1]:
        rows = (start - first)[owner] + np.arange(total)
        ways = ways.take(rows, 1)
        origins = origins if shared else origins.take(rows, 1)
    if shared:
        centre, reach = np.repeat(origins, len(start), axis=1), np.zeros(len(start))
    else:
        low = np.minimum.reduceat(origins, first, axis=1)
        high = np.maximum.reduceat(origins, first, axis=1)
        centre, reach = (low + high) / 2, np.sqrt(_dot(high - low, high - low)) / 2
    axis = np.add.reduceat(ways, first, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        axis /= np.sqrt(_dot(axis, axis))
    chord = ways - axis.take(owner, 1)
    chord = np.sqrt(np.maximum.reduceat(_dot(chord, chord), first))
    angle = 2 * np.arcsin(np.clip(chord / 2, 0, 1)) + spread + 1e-9
    angle = np.where(angle < 1.5, angle, np.nan)  # a bundle all around is known of nothing
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


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3, …) of vectors (3, …)."""
    product = np.empty_like(a)
    for k, (one, other) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.multiply(a[one], b[other], out=product[k])
        product[k] -= a[other] * b[one]
    return product


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Dot products of vectors (3, …)."""
    product: np.ndarray = a[0] * b[0]
    product += a[1] * b[1]
    product += a[2] * b[2]
    return product
