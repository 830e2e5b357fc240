"""Scatterers that move: where they are at the moment of a ping, and how fast they go.

Trees sway in the pieces of their rig (``sensing.moving``), each turned and shifted as a rigid body; broad
leaves turn about their feet besides. Objects of a scene that moves are where and as they are then, and each
point of one that changes its shape has the velocity of the surface that it is on. Delays are those of where
things are as a call, or the piece of a long one (``doppler``), is sent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from ...base.trimesh import TriMesh, is_wood
from ..moving import MovingScene, boxes_of_pieces, trees_that_sway
from ..moving_rays import MovingCaster
from ..rays.caster import Hits, RayCaster
from ..rays.geometry import SceneGeometry, invert_transforms
from ..rays.paths import ShapePath
from .scatterers import WOOD, LeafTurns, Population, Scatterers

MOST_FLUTTER = 0.7  # radians, that a leaf turns at most
AROUND = 16  # vertices or triangles near a point, by which it goes


class SwayingLeaves(Protocol):
    """Trees that sway and whose leaves flutter (``stand.wind.sway``); named by their number in the stand."""

    @property
    def number(self) -> dict[int, int]: ...

    def moves(self, tree: int) -> bool: ...

    def pieces(self, tree: int, mesh: TriMesh) -> np.ndarray: ...

    def pieces_at(self, tree: int, points: np.ndarray, leaf: np.ndarray) -> np.ndarray: ...

    def moment(self, tree: int, time: float) -> tuple[np.ndarray, np.ndarray]: ...

    def flutter(
        self, tree: int, leaf: np.ndarray, time: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...


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
    like : of a scene of the same meshes and variants, whose pieces are shared.
    """

    def __init__(
        self,
        scene: SceneGeometry,
        sway: SwayingLeaves,
        start: float = 0.0,
        like: EchoWind | None = None,
    ) -> None:
        self.scene, self.sway, self.start = scene, sway, start
        self.tree = trees_that_sway(scene, sway)
        self._pieces: dict[tuple[int, int, int], np.ndarray] = {}
        self._boxes: dict[tuple[int, int], np.ndarray] = {}
        self._arms: dict[tuple[int, int], float] = {}
        if like is not None:
            self._pieces, self._boxes, self._arms = like._pieces, like._boxes, like._arms

    def pieces(self, population: Population, instance: int) -> np.ndarray:
        """(R,) the piece that each row of a population is on, of the tree of an instance."""
        key = (
            id(population),
            int(self.scene.mesh_index[instance]),
            int(self.scene.species[instance]),
        )
        if key not in self._pieces:
            points, leaf = population.held
            self._pieces[key] = self.sway.pieces_at(int(self.tree[instance]), points, leaf)
        return self._pieces[key]

    def moment(self, instance: int, time: float) -> TreeMoment:
        """The tree of an instance at a time, s."""
        place, rate = self.sway.moment(int(self.tree[instance]), time + self.start)
        low, high = self._box(instance)
        middle = (low + high) / 2
        turn = Rotation.from_matrix(_proper(place[:, :, :3]))
        rigid = np.empty_like(place)
        rigid[:, :, :3] = turn.as_matrix()
        moved = np.einsum("gij,gj->gi", place[:, :, :3], middle) + place[:, :, 3]
        rigid[:, :, 3] = moved - np.einsum("gij,gj->gi", rigid[:, :, :3], middle)
        half = np.linalg.norm(high - low, axis=1) / 2
        angle = turn.magnitude()
        shifted = np.linalg.norm(moved - middle, axis=1)
        reach = float((shifted + angle * half).max(initial=0.0))
        arm = self._arm(instance)
        flutter = MOST_FLUTTER * (arm > 0)
        most = float(angle.max(initial=0.0)) + flutter
        return TreeMoment(rigid, rate, reach + MOST_FLUTTER * arm, most)

    def turns(self, instance: int, transform: np.ndarray, time: float) -> LeafTurns:
        """Return how leaves of an instance flutter at a time; transform : (3, 4) of their piece, to the
        world."""
        tree, linear = int(self.tree[instance]), transform[:, :3]
        size = float(np.cbrt(abs(np.linalg.det(linear)))) or 1.0

        def turned(
            leaf: np.ndarray, centre: np.ndarray, normal: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            foot, vector, _ = self.sway.flutter(tree, leaf, time + self.start)
            vector = vector @ linear.T / size
            arm = centre - (foot @ linear.T + transform[:, 3])
            return centre + np.cross(vector, arm), Rotation.from_rotvec(vector).apply(normal)

        return turned

    def fluttered(
        self,
        instance: int,
        transform: np.ndarray,
        leaf: np.ndarray,
        centre: np.ndarray,
        time: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(M, 3) m/s of points (M, 3) of leaves (M,) by their flutter alone, and where these would be without
        it; transform : as of ``turns``."""
        linear = transform[:, :3]
        foot, vector, rate = self.sway.flutter(int(self.tree[instance]), leaf, time + self.start)
        size = float(np.cbrt(abs(np.linalg.det(linear)))) or 1.0
        vector, rate = vector @ linear.T / size, rate @ linear.T / size
        foot = foot @ linear.T + transform[:, 3]
        # centre - foot = (1 + [v]x) arm, turned back.
        arm = centre - foot
        along = np.einsum("mi,mi->m", vector, arm)[:, None] * vector
        arm = (arm - np.cross(vector, arm) + along) / (1 + (vector**2).sum(axis=1))[:, None]
        return np.cross(rate, arm), foot + arm

    def _arm(self, instance: int) -> float:
        """Metres from the foot of a leaf that flutters to its middle, at most; 0 where none does."""
        key = (int(self.scene.mesh_index[instance]), int(self.scene.species[instance]))
        if key not in self._arms:
            tree, centres = int(self.tree[instance]), self._leaf_centres(instance)
            foot, vector, rate = self.sway.flutter(tree, np.arange(len(centres)), 0.0)
            moves = (vector != 0).any() or (rate != 0).any()
            away = np.linalg.norm(centres - foot, axis=1).max(initial=0.0)
            self._arms[key] = float(away) if moves else 0.0
        return self._arms[key]

    def _leaf_centres(self, instance: int) -> np.ndarray:
        """(L, 3) middles of the leaves of an instance's mesh, by their number, in its own frame."""
        mesh = self.scene.meshes[int(self.scene.mesh_index[instance])]
        kept: dict[str, np.ndarray] = vars(mesh)
        if "_leaf_centres" not in kept:
            rows = np.flatnonzero(mesh.leaf >= 0)
            count = int(mesh.leaf.max(initial=-1)) + 1
            middle = mesh.vertices[mesh.triangles[rows]].mean(axis=1)
            of = mesh.leaf[rows]
            total = np.stack([np.bincount(of, axis, count) for axis in middle.T], axis=1)
            kept["_leaf_centres"] = total / np.maximum(np.bincount(of, minlength=count), 1)[:, None]
        return kept["_leaf_centres"]

    def _box(self, instance: int) -> tuple[np.ndarray, np.ndarray]:
        """(G, 3), (G, 3) boxes of the pieces of an instance's tree, in the variant's frame."""
        key = (int(self.scene.mesh_index[instance]), int(self.scene.species[instance]))
        if key not in self._boxes:
            tree, mesh = int(self.tree[instance]), self.scene.meshes[key[0]]
            piece = self.sway.pieces(tree, mesh)
            count = len(self.sway.moment(tree, 0.0)[0])
            corners = mesh.vertices[mesh.triangles]
            self._boxes[key] = boxes_of_pieces(corners, piece, count)
        low, high = self._boxes[key]
        return low, high


@dataclass(frozen=True)
class BentMesh:
    """A mesh that changes its shape, at one time.

    vertices, rate, rest : (V, 3) m then, m/s, and m as the scene stands. triangles : (T, 3). wood : (T,)
    bool.
    """

    vertices: np.ndarray
    rate: np.ndarray
    rest: np.ndarray
    triangles: np.ndarray
    wood: np.ndarray

    @classmethod
    def at(cls, mesh: TriMesh, shape: ShapePath, time: float) -> BentMesh:
        """A mesh at a time, s."""
        every, then = np.arange(len(mesh.vertices))[None], np.array([time])
        now, rate = shape.at(every, then)[0], shape.velocity(every, then)[0]
        return cls(now, rate, mesh.vertices, mesh.triangles, is_wood(mesh.part))

    def told(self, points: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
        """(M, 3) m/s of points (M, 3) of a kind, and where they are at rest: of the wood around an axis, else
        of the triangle that each is on."""
        both = np.concatenate([self.rate, self.rest], axis=1)
        if kind == WOOD:
            vertex = np.unique(self.triangles[self.wood & self._finite])
            near = self._nearest(points, self.vertices[vertex], AROUND)
            corners = vertex[near]
        else:
            corners = self._triangle_of(points)
        at = self.vertices[corners]
        middle = at.mean(axis=1)
        # The affine map that tells what corners do, of the least size across a surface.
        spread = np.linalg.pinv(at - middle[:, None], rcond=1e-6)
        share = np.einsum("mi,mik->mk", points - middle, spread)
        share += (1 - share.sum(axis=1, keepdims=True)) / corners.shape[1]
        told = np.einsum("mk,mki->mi", share, both[corners])
        return told[:, :3], told[:, 3:]

    def _triangle_of(self, points: np.ndarray) -> np.ndarray:
        """(M, 3) corners of the triangles nearest to points; their middles are sought among those of a
        size."""
        corners = self.vertices[self.triangles]
        middle = corners.mean(axis=1)
        size = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
        kind = np.ceil(np.log2(np.nan_to_num(np.maximum(size, 1e-9), posinf=1.0))).astype(np.int64)
        best, away = np.zeros(len(points), np.int64), np.full(len(points), np.inf)
        for number in np.unique(kind).tolist():
            rows = np.flatnonzero((kind == number) & self._finite)
            for found in rows[self._nearest(points, middle[rows], AROUND)].T:
                far = _away(points, corners[found])
                nearer = far < away
                best[nearer], away[nearer] = found[nearer], far[nearer]
        return self.triangles[best]

    @property
    def _finite(self) -> np.ndarray:
        """(T,) bool, triangles that are somewhere."""
        return np.isfinite(self.vertices).all(axis=1)[self.triangles].all(axis=1)

    @staticmethod
    def _nearest(points: np.ndarray, among: np.ndarray, many: int) -> np.ndarray:
        """(M, K) rows of the K points nearest to each, at most ``many``."""
        from scipy.spatial import cKDTree

        many = min(many, len(among))
        if not many or not len(points):
            return np.zeros((len(points), many), np.int64)
        found = cKDTree(among).query(np.nan_to_num(points), k=many)[1]
        return np.asarray(found).reshape(len(points), many)


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
        inverse = invert_transforms(transform[None])[0]
        own = points @ inverse[:, :3].T + inverse[:, 3]
        rate = motion.table.rate(row, np.array([time]))[0]
        velocity, stood = own @ rate[:, :3].T + rate[:, 3], own
        if instance in motion.shapes:
            bend, stood = self._bent(instance, own, made.kind, time)
            velocity = velocity + bend @ transform[:, :3].T
        still = self._moving.whole.transform[instance]
        rest = stood @ still[:, :3].T + still[:, 3]
        if self.known(np.array([instance]))[0] != instance:
            rest = np.full_like(rest, np.nan)
        return velocity, rest

    def _bent(
        self, instance: int, own: np.ndarray, kind: str, time: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """(M, 3) m/s of own points (M, 3) by the change of shape, and where they are at rest."""
        if self._held is None or self._held[0] != (instance, time):
            mesh = self._moving.whole.meshes[self._moving.whole.mesh_index[instance]]
            self._held = (
                (instance, time),
                BentMesh.at(mesh, self._moving.motion.shapes[instance], time),
            )
        return self._held[1].told(own, kind)

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
    ) -> Hits:
        """The closest hit of each ray, which leaves from nothing that it met before."""
        if leaving is not None:
            raise ValueError("rays at one moment begin anew; give no hits that they leave")
        time = np.full(len(origins), self._time)
        hits = self._caster.cast(
            origins, directions, max_distance, time=time, min_distance=min_distance
        )
        instance, triangle = self._caster.moving.known(hits.instance, hits.triangle)
        return Hits(hits.distance, instance, triangle)


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


def _proper(linear: np.ndarray) -> np.ndarray:
    """(G, 3, 3) the rotations nearest to matrices (G, 3, 3)."""
    u, _, v = np.linalg.svd(linear)
    v[:, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    return np.asarray(u @ v)
