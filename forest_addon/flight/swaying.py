"""Woods that sway around flyers: rays, echoes and obstacles of trees where the wind has them at a time.

Motion is a function of time, so only trees near a flyer are ever put in place: a tree is asked where it is
once something comes within its own size of it. No wind of a forest bends a tree so far off its rest.
"""

from __future__ import annotations

from copy import copy
from functools import partial
from typing import Any

import numpy as np

from ..base.trimesh import TriMesh
from ..sensing.rays.geometry import SceneGeometry
from ..sensing.rays.moving import MovingCaster
from ..sensing.rays.paths import SceneMotion
from ..sensing.rays.pieces import MakeEngine, SwayingScene, cut
from ..sensing.rays.swaying import SwayingCaster
from ..sensing.sonar.targets import EchoTargets
from ..sensing.sonar.windy import EchoWind
from ..spec import Rays
from ..stand.wind.sway import ForestSway
from .obstacles import REACH, MeshObstacles, Obstacles
from .solids import Solid


class NearbySway:
    """The sway of a forest, whose trees are asked for their motion when something comes near.

    sway : of the forest; what is not named here is its own.
    """

    def __init__(self, sway: ForestSway) -> None:
        self._sway = sway

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sway, name)

    def most(
        self, tree: int, low: np.ndarray, high: np.ndarray, knot: np.ndarray | None = None
    ) -> float:
        """As of ``ForestSway``; at any time no more than the tree is large."""
        if knot is None:
            return float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
        return self._sway.most(tree, low, high, knot)


class SharedPieces:
    """Everything of swaying trees that belongs to their meshes, made once for all forests of a stock.

    rays : settings of what casts them.
    """

    def __init__(self, rays: Rays) -> None:
        self._rays = rays
        self._sway: ForestSway | None = None
        self._wind: EchoWind | None = None
        self._cut: dict[bool, SwayingScene] = {}
        self._engines: dict[bool, tuple[tuple[TriMesh, ...], Any]] = {}

    def sway(self, sway: ForestSway | None) -> ForestSway | None:
        """Keep a forest's sway for those to come."""
        self._sway = self._sway or sway
        return sway

    @property
    def like(self) -> ForestSway | None:
        """Return a sway that has the modes of the stock's variants."""
        return self._sway

    def caster(self, scene: SceneGeometry, sway: ForestSway, solid: bool = False) -> SwayingCaster:
        """Rays in a forest that sways; solid : its meshes have no leaves."""
        from ..blender.rays.casters import make_caster

        near = NearbySway(sway)
        pieces = self._cut[solid] = cut(scene, near, self._cut.get(solid))
        make = partial(make_caster, rays=self._rays)
        still = MovingCaster(pieces.still, SceneMotion(), make)
        return SwayingCaster(pieces, near, still, make, self._engine(solid))

    def targets(self, scene: SceneGeometry, sway: ForestSway, like: EchoTargets) -> EchoTargets:
        """Return what sounds back in a forest that sways."""
        self._wind = EchoWind(scene, sway, like=self._wind)
        return EchoTargets(scene, like, self._wind)

    def _engine(self, solid: bool) -> MakeEngine | None:
        """Give the engine of the pieces of before, where they are the same."""
        from ..blender.rays.casters import piece_engine

        engine = piece_engine(self._rays)
        if engine is None:
            return None
        make: MakeEngine = engine

        def kept(meshes: tuple[TriMesh, ...]) -> Any:
            known = self._engines.get(solid)
            alike = known is not None and len(known[0]) == len(meshes)
            if (
                known is None
                or not alike
                or any(a is not b for a, b in zip(known[0], meshes, strict=True))
            ):
                known = self._engines[solid] = meshes, make(meshes)
            return known[1]

        return kept


class SwayingObstacles(MeshObstacles):
    """Instances of meshes, of which trees sway: as they stand at one time, s; ``at`` gives another.

    What ``MeshObstacles`` tells of trees at rest is asked with as much slack as trees near by are off it,
    and the triangles it finds are put where they are.
    """

    moves = True

    def __init__(self, scene: SceneGeometry, solids: list[Solid], sway: ForestSway) -> None:
        super().__init__(scene, solids)
        self._sway, self._time = sway, 0.0
        number = sway.number
        row = np.array([number.get(int(tree), -1) for tree in scene.tree[self.rows]], np.int64)
        moves = {tree: sway.moves(tree) for tree in np.unique(row[row >= 0]).tolist()}
        self._tree = np.array([tree if moves.get(tree) else -1 for tree in row.tolist()], np.int64)
        self._piece: dict[tuple[int, int], np.ndarray] = {}
        self._end: dict[tuple[int, int], np.ndarray] = {}
        self._wide = np.linalg.norm(self._high - self._low, axis=1)
        self._moments: dict[int, tuple[np.ndarray, float]] = {}

    def at(self, time: float) -> Obstacles:
        """See ``Obstacles``."""
        if time != self._time:
            other = copy(self)
            other._time, other._moments = time, {}
            return other
        return self

    def room(self, place: np.ndarray) -> np.ndarray:
        """See ``Obstacles``."""
        room = super().room(place)
        return np.maximum(room - self._astray(place), 0.0) if len(self._mesh) else room

    def _astray(self, place: np.ndarray) -> float:
        low, high = place.min(axis=0), place.max(axis=0)
        away = np.maximum(np.maximum(self._low - high, low - self._high), 0.0)
        near = (self._tree >= 0) & (np.linalg.norm(away, axis=1) <= self._wide + REACH)
        return max((self._moment(which)[1] for which in np.flatnonzero(near).tolist()), default=0.0)

    def _placed(self, which: np.ndarray, item: np.ndarray) -> np.ndarray:
        corners = self._corners[item]
        for one in np.unique(which[self._tree[which] >= 0]).tolist():
            rows = np.flatnonzero(which == one)
            piece = self._pieces(one)[item[rows] - self._shift[self._mesh[one]]]
            place = self._moment(one)[0][piece]
            corners[rows] = np.einsum("tij,tkj->tki", place[:, :, :3], corners[rows])
            corners[rows] += place[:, None, :, 3]
        world = self._to_world[which]
        return corners @ world[:, :, :3].transpose(0, 2, 1) + world[:, None, :, 3]

    def _moment(self, which: int) -> tuple[np.ndarray, float]:
        """Return places (G, 3, 4) of the pieces of an instance's tree, and metres that nothing of it that
        stops is farther off its rest."""
        if which not in self._moments:
            place = self._sway.moment(int(self._tree[which]), self._time)[0]
            off, ends = place - np.eye(3, 4), self._ends(which, len(place))
            middle, half = ends.mean(axis=0), np.ptp(ends, axis=0) / 2
            most = np.abs(np.einsum("gij,gj->gi", off[:, :, :3], middle) + off[:, :, 3])
            most += np.einsum("gij,gj->gi", np.abs(off[:, :, :3]), half)
            far = float(np.linalg.norm(most, axis=1).max(initial=0.0)) * float(self._most[which])
            self._moments[which] = place, far
        return self._moments[which]

    def _pieces(self, which: int) -> np.ndarray:
        """(T,) the piece that each triangle of an instance's solid is on."""
        tree, mesh = int(self._tree[which]), int(self._mesh[which])
        key = mesh, self._sway.variant(tree)[0]
        if key not in self._piece:
            middle = self._solids[mesh].corners.mean(axis=1)
            self._piece[key] = self._sway.pieces_at(tree, middle, np.full(len(middle), -1))
        return self._piece[key]

    def _ends(self, which: int, count: int) -> np.ndarray:
        """(2, G, 3) smallest and largest coordinates of what stops on each piece of an instance's tree; 0
        where there is nothing."""
        mesh = int(self._mesh[which])
        key = mesh, self._sway.variant(int(self._tree[which]))[0]
        if key not in self._end:
            corners, piece = self._solids[mesh].corners, self._pieces(which)
            low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
            np.minimum.at(low, piece, corners.min(axis=1))
            np.maximum.at(high, piece, corners.max(axis=1))
            ends = np.stack([low, high])
            ends[:, np.isinf(low[:, 0])] = 0.0
            self._end[key] = ends
        return self._end[key]
