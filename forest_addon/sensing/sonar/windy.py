"""Scatterers that move: where they are at the moment of a ping, and how fast they go.

Trees sway in the pieces of their rig (``sensing.moving``), each turned and shifted as a rigid body; broad
leaves turn about their feet besides. Objects of a scene that moves are where and as they are then, and each
point of one that changes its shape has the velocity of the surface that it is on. Delays are those of where
things are as a call, or the piece of a long one (``doppler``), is sent.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...base.rows import distinct, lengths
from ...base.trimesh import TriMesh, is_wood
from ..moving import MovingScene, boxes_of_pieces, joined, moved, trees_that_sway
from ..moving_rays import MovingCaster
from ..rays.caster import Hits, RayCaster
from ..rays.geometry import SceneGeometry, apply_transform, invert_transforms
from ..rays.paths import ShapePath
from .scatterers import LEAF, WOOD, Population, Scatterers, Sight

if TYPE_CHECKING:
    from ...stand.wind import ForestSway

MOST_FLUTTER = 0.7  # radians, that a leaf turns at most
AROUND = 16  # vertices or triangles near a point, by which it goes


@dataclass(frozen=True)
class TreeMoment:
    """A tree at a moment, in its variant's frame.

    place : (G, 3, 4) of its pieces, rigid. rate : (G, 3, 4) how fast a point of the rest goes, 1/s.
    drift : metres that nothing of it is farther off its rest. turn : radians that nothing is turned more.
    """

    place: np.ndarray
    rate: np.ndarray
    drift: float
    turn: float


class EchoWind:
    """Motion of what sounds in a scene.

    scene : at rest. sway : of its trees. start : s, when the trees' time begins for a ping of time 0.
    like : of a scene of the same meshes and variants, whose measures are shared.
    """

    def __init__(
        self,
        scene: SceneGeometry,
        sway: ForestSway,
        start: float = 0.0,
        like: EchoWind | None = None,
    ) -> None:
        self.scene, self.sway, self.start = scene, sway, start
        self.tree = trees_that_sway(scene, sway)
        self._pieces: dict[tuple[int, int, int], np.ndarray] = {} if like is None else like._pieces
        self._sizes: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, float]] = (
            {} if like is None else like._sizes
        )
        self._moments: dict[int, TreeMoment] = {}
        self._time = 0.0  # of these moments

    def moment(self, instance: int, time: float) -> TreeMoment:
        """The tree of an instance at a time, s; kept until another time is asked for."""
        if time != self._time:
            self._time, self._moments = time, {}
        if instance not in self._moments:
            self._moments[instance] = self._moment(instance, time)
        return self._moments[instance]

    def _moment(self, instance: int, time: float) -> TreeMoment:
        place, rate = self.sway.moment(int(self.tree[instance]), time + self.start)
        low, high, arm = self._size(instance)
        middle = (low + high) / 2
        turn = Rotation.from_matrix(_proper(place[:, :, :3]))
        rigid = np.empty_like(place)
        rigid[:, :, :3] = turn.as_matrix()
        gone = moved(place, middle)
        rigid[:, :, 3] = gone - np.einsum("gij,gj->gi", rigid[:, :, :3], middle)
        half, angle = lengths(high - low) / 2, turn.magnitude()
        drift = float((lengths(gone - middle) + angle * half).max(initial=0.0))
        most = float(angle.max(initial=0.0)) + MOST_FLUTTER * (arm > 0)
        return TreeMoment(rigid, rate, drift + MOST_FLUTTER * arm, most)

    def scatterers(
        self,
        population: Population,
        rows: np.ndarray,
        instance: int,
        transform: np.ndarray,
        sight: Sight,
        time: float,
    ) -> Iterator[tuple[Scatterers, np.ndarray]]:
        """Rows of a population as the tree of an instance has them in the world at a time, s, each set
        with its velocity, m/s, and place at rest, m, (M, 6). transform : (3, 4) of the instance."""
        moment, piece = self.moment(instance, time), self._piece_of(population, instance)[rows]
        for number in distinct(piece).tolist():
            place, rate = moment.place[number], moment.rate[number]
            stands = joined(transform[None], place[None])[0]
            turned = replace(sight, turns=partial(self.turned, instance, stands, time))
            back = np.linalg.inv(stands[:, :3]).T
            for made in population.scatterers(stands, rows[piece == number], turned):
                rest = own = (made.centre - stands[:, 3]) @ back
                velocity = (own @ rate[:, :3].T + rate[:, 3]) @ transform[:, :3].T
                if made.kind == LEAF:
                    flutter, unturned = self.fluttered(
                        instance, stands, time, made.number, made.centre
                    )
                    velocity, rest = velocity + flutter, (unturned - stands[:, 3]) @ back
                yield made, np.hstack([velocity, apply_transform(transform, rest)])

    def turned(
        self,
        instance: int,
        transform: np.ndarray,
        time: float,
        leaf: np.ndarray,
        centre: np.ndarray,
        normal: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Centres and normals (M, 3) of leaves (M,) of an instance as they flutter at a time; transform :
        (3, 4) of their piece, to the world."""
        foot, vector, _ = self._flutter(instance, transform, time, leaf)
        return centre + np.cross(vector, centre - foot), Rotation.from_rotvec(vector).apply(normal)

    def fluttered(
        self,
        instance: int,
        transform: np.ndarray,
        time: float,
        leaf: np.ndarray,
        centre: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(M, 3) m/s of points (M, 3) of leaves by their flutter alone, and where these would be without it;
        arguments as of ``turned``."""
        foot, vector, rate = self._flutter(instance, transform, time, leaf)
        # centre - foot = (1 + [v]x) arm, turned back.
        arm = centre - foot
        along = np.einsum("mi,mi->m", vector, arm)[:, None] * vector
        arm = (arm - np.cross(vector, arm) + along) / (1 + (vector**2).sum(axis=1))[:, None]
        return np.cross(rate, arm), foot + arm

    def _flutter(
        self, instance: int, transform: np.ndarray, time: float, leaf: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Feet of leaves, their turns, radians, and rates of these, 1/s, (M, 3) each in the world."""
        tree, linear = int(self.tree[instance]), transform[:, :3]
        foot, vector, rate = self.sway.flutter(tree, leaf, time + self.start)
        size = float(np.cbrt(abs(np.linalg.det(linear)))) or 1.0
        return apply_transform(transform, foot), vector @ linear.T / size, rate @ linear.T / size

    def _piece_of(self, population: Population, instance: int) -> np.ndarray:
        """(R,) the piece that each row of a population is on, of the tree of an instance."""
        key = (id(population), *self._key(instance))
        if key not in self._pieces:
            points, leaf = population.held
            self._pieces[key] = self.sway.pieces_at(int(self.tree[instance]), points, leaf)
        return self._pieces[key]

    def _key(self, instance: int) -> tuple[int, int]:
        return int(self.scene.mesh_index[instance]), int(self.scene.species[instance])

    def _size(self, instance: int) -> tuple[np.ndarray, np.ndarray, float]:
        """(G, 3), (G, 3) boxes of the pieces of an instance's tree, in the variant's frame, and metres from
        the foot of a leaf that flutters to its middle, at most; 0 where none does."""
        key = self._key(instance)
        if key not in self._sizes:
            tree, mesh = int(self.tree[instance]), self.scene.meshes[key[0]]
            corners = mesh.vertices[mesh.triangles]
            count = len(self.sway.moment(tree, 0.0)[0])
            low, high = boxes_of_pieces(corners, self.sway.pieces(tree, mesh), count)
            rows = np.flatnonzero(mesh.leaf >= 0)
            leaves, of = np.unique(mesh.leaf[rows], return_inverse=True)
            middle = corners[rows].mean(axis=1)
            total = np.stack([np.bincount(of, axis, len(leaves)) for axis in middle.T], axis=1)
            centre = total / np.bincount(of, minlength=len(leaves))[:, None]
            foot, vector, rate = self.sway.flutter(tree, leaves, 0.0)
            flutters = (vector != 0).any() or (rate != 0).any()
            arm = float(lengths(centre - foot).max(initial=0.0)) if flutters else 0.0
            self._sizes[key] = low, high, arm
        return self._sizes[key]


class BentMesh:
    """A mesh that changes its shape, at one time, s."""

    def __init__(self, mesh: TriMesh, shape: ShapePath, time: float) -> None:
        every, then = np.arange(len(mesh.vertices))[None], np.array([time])
        self._vertices = shape.at(every, then)[0]
        self._told = np.concatenate([shape.velocity(every, then)[0], mesh.vertices], axis=1)
        known = np.isfinite(self._vertices).all(axis=1)[mesh.triangles].all(axis=1)
        self._triangles = mesh.triangles[known]
        self._wood = distinct(mesh.triangles[known & is_wood(mesh.part)])

    def told(self, points: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
        """(M, 3) m/s of points (M, 3) of a kind, and where they are at rest: of the wood around an axis, else
        of the triangle that each is on."""
        if kind == WOOD:
            corners = self._wood[_nearest(points, self._vertices[self._wood])]
        else:
            corners = self._triangle_of(points)
        at = self._vertices[corners]
        middle = at.mean(axis=1)
        # The affine map that tells what corners do, of the least size across a surface.
        spread = np.linalg.pinv(at - middle[:, None], rcond=1e-6)
        share = np.einsum("mi,mik->mk", points - middle, spread)
        share += (1 - share.sum(axis=1, keepdims=True)) / corners.shape[1]
        told = np.einsum("mk,mki->mi", share, self._told[corners])
        return told[:, :3], told[:, 3:]

    def _triangle_of(self, points: np.ndarray) -> np.ndarray:
        """(M, 3) corners of the triangles nearest to points; their middles are sought among those of a
        size."""
        corners = self._vertices[self._triangles]
        middle = corners.mean(axis=1)
        size = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
        kind = np.ceil(np.log2(np.maximum(size, 1e-9))).astype(np.int64)
        best, away = np.zeros(len(points), np.int64), np.full(len(points), np.inf)
        for number in distinct(kind).tolist():
            rows = np.flatnonzero(kind == number)
            for triangle in rows[_nearest(points, middle[rows])].T:
                far = _away(points, corners[triangle])
                nearer = far < away
                best[nearer], away[nearer] = triangle[nearer], far[nearer]
        return self._triangles[best]


class EchoMotion:
    """Motion of the instances of a scene that moves, as pings meet them; trees that sway do nothing else."""

    def __init__(self, moving: MovingScene) -> None:
        self._moving = moving
        self.measured = len(moving.read.meshes)  # meshes that are the same at all times
        self.scene_at = moving.snapshot
        self._held: tuple[tuple[int, float], BentMesh] | None = None

    def motion(
        self, instance: int, transform: np.ndarray, made: Scatterers, time: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """(M, 3) m/s of scatterers (M,) of an instance as it goes, turns and bends, and (M, 3) where they are
        in the scene as it stands still, NaN where they are not there; transform : (3, 4), then."""
        points, motion = made.centre, self._moving.motion
        (known, row) = motion.row_of(np.array([instance]))
        if not len(known):
            return np.zeros_like(points), points.copy()
        own = apply_transform(invert_transforms(transform[None])[0], points)
        rate = motion.table.rate(row, np.array([time]))[0]
        velocity, stood = apply_transform(rate, own), own
        if instance in motion.shapes:
            if self._held is None or self._held[0] != (instance, time):
                mesh = self._moving.whole.meshes[self._moving.whole.mesh_index[instance]]
                bent = BentMesh(mesh, motion.shapes[instance], time)
                self._held = (instance, time), bent
            bend, stood = self._held[1].told(own, made.kind)
            velocity = velocity + bend @ transform[:, :3].T
        rest = apply_transform(self._moving.whole.transform[instance], stood)
        if self.known(np.array([instance]))[0] != instance:
            rest = np.full_like(rest, np.nan)
        return velocity, rest

    def known(self, instance: np.ndarray) -> np.ndarray:
        """The numbers that instances have in the scene as it was read."""
        stands_for = self._moving.motion.stands_for
        return instance if stands_for is None else stands_for[instance]


class AtMoment(RayCaster):
    """A caster of a still scene: one that moves, as it is at one time, s; hits are numbered as read."""

    def __init__(self, caster: MovingCaster, time: float) -> None:
        self._caster, self._time = caster, time
        self.engine, self.scene = caster.engine, caster.moving.read

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
        """The closest hit of each ray, which leaves from nothing that it met before; time : s later."""
        if leaving is not None:
            raise ValueError("rays at one moment begin anew; give no hits that they leave")
        hits = self._caster.cast(
            origins, directions, max_distance, time=self._time + time, min_distance=min_distance
        )
        instance, triangle = self._caster.moving.known(hits.instance, hits.triangle)
        return replace(hits, instance=instance, triangle=triangle)


def at_moment(caster: Any, time: float) -> Any:
    """A caster as sonars use it: of a scene that moves at a time, s; a still one as it is."""
    return AtMoment(caster, time) if isinstance(caster, MovingCaster) else caster


def _away(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(M,) metres from points (M, 3) to about the nearest point of triangles (M, 3, 3)."""
    sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    two = np.einsum("mij,mj->mi", np.linalg.pinv(sides), points - corners[:, 0])
    share = np.clip(np.column_stack([1 - two.sum(axis=1), two]), 0.0, None)
    share /= share.sum(axis=1, keepdims=True)
    return np.asarray(np.linalg.norm(points - np.einsum("mk,mki->mi", share, corners), axis=1))


def _nearest(points: np.ndarray, among: np.ndarray) -> np.ndarray:
    """(M, K) rows of the K points nearest to each, at most ``AROUND``."""
    from scipy.spatial import cKDTree

    many = min(AROUND, len(among))
    if not many or not len(points):
        return np.zeros((len(points), many), np.int64)
    nearest = cKDTree(among).query(np.nan_to_num(points), k=many)[1]
    return np.asarray(nearest).reshape(len(points), many)


def _proper(linear: np.ndarray) -> np.ndarray:
    """(G, 3, 3) the rotations nearest to matrices (G, 3, 3)."""
    u, _, v = np.linalg.svd(linear)
    v[:, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    return np.asarray(u @ v)
