"""Worlds to fly in: a scene's variants read from Blender once, then a new forest of them for every episode.

The variants of a scene are grown and built in Blender, one of each, and read back as sensors see them. A
forest of an episode is a plan of that scene with another seed: only where trees stand is new, and Blender's
geometry nodes say where to the bit (``blender/turning``), so that what a flyer senses is what ``World.scan``
and ``World.ping`` find in that forest. Rays' trees, the sonar's measures and the cells of what stops a flyer
belong to the meshes and are shared.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..api import Site, World, read
from ..sensing.moving import MovingScene, boxes_of_pieces, trees_that_sway
from ..sensing.moving_rays import MovingCaster
from ..sensing.rays.caster import RayCaster
from ..sensing.rays.geometry import SceneGeometry
from ..sensing.rays.search import Search
from ..sensing.sonar.targets import EchoTargets
from ..sensing.sonar.windy import EchoWind
from ..spec import Scene, SpecError
from ..stand.forest import GrownForest
from ..stand.wind import ForestSway, WindField, sway_of
from .obstacles import REACH, MeshObstacles, Solid

APART = 100.0  # metres between the single trees that are read


@dataclass(frozen=True)
class FlightSurroundings:
    """A world as a flyer meets it.

    settings : of its scene. stock : whose meshes it stands of. forest : its stand and trees, None of a scene
    that was not grown here. seed : of its forest and its gusts.
    """

    settings: Scene
    stock: Stock
    geometry: SceneGeometry
    forest: GrownForest | None = None
    seed: int = 0

    @cached_property
    def caster(self) -> RayCaster:
        """Rays that meet everything, in the wind at times of their own."""
        return self._cast_in(self.geometry, self.stock.caster)

    @cached_property
    def wood(self) -> RayCaster:
        """Rays that pass leaves, in the wind at times of their own."""
        like = self.stock.wood
        return self._cast_in(replace(self.geometry, meshes=like.scene.meshes), like)

    def _cast_in(self, scene: SceneGeometry, like: Search) -> RayCaster:
        from ..blender.rays.casters import make_caster

        if self.sway is not None:
            return self.stock.moving_caster(scene, self.sway, like)
        return make_caster(scene, self.settings.rays, like)

    @cached_property
    def targets(self) -> EchoTargets:
        """Targets that sound back."""
        if self.sway is None:
            return EchoTargets(self.geometry, self.stock.targets)
        self.stock.wind = EchoWind(self.geometry, self.sway, like=self.stock.wind)
        return EchoTargets(self.geometry, self.stock.targets, self.stock.wind)

    @cached_property
    def obstacles(self) -> MeshObstacles:
        """Obstacles that stop a flyer."""
        if self.sway is not None:
            return SwayingObstacles(self.geometry, self.stock.solids, self.sway)
        return MeshObstacles(self.geometry, self.stock.solids)

    @cached_property
    def sway(self) -> ForestSway | None:
        """The sway of the trees; None without wind or trees, or of what was not grown here."""
        if self.forest is None:
            return None
        sway = sway_of(self.forest, self.settings.wind, self.seed, self.stock.sway)
        self.stock.sway = self.stock.sway or sway
        return sway

    @property
    def gusts(self) -> WindField | None:
        """The wind that carries flyers, by heights above the ground; None without wind or trees."""
        return None if self.sway is None else self.sway.field

    @property
    def field(self) -> tuple[np.ndarray, np.ndarray]:
        """(2,) smallest and (2,) largest place of the field."""
        low = np.array(self.settings.forest.origin)
        return low, low + self.settings.forest.size

    def ground(self, place: np.ndarray) -> np.ndarray:
        """(N,) heights of the ground at places (N, 2); the base where there is none."""
        height = self.stock.ground.height(place)
        return np.where(np.isfinite(height), height, self.settings.forest.terrain.base)

    def world(self) -> World:
        """The same forest built in Blender, as ``api.build`` does: to look at, scan and save.

        Raises
        ------
        SpecError : what stands in Blender was not grown here; take ``api.current()``.
        """
        if self.forest is None:
            raise SpecError("world", "stands in Blender already; take it by current()")
        world = self.stock.built(self.forest)
        if self.sway is not None:  # whose gusts are the episode's
            world.scene = world.scene.changed(seed=self.seed)
        return world


class Stock:
    """The meshes of a scene and all that is made of them alone.

    scene : settings or a scene file. folder : that relative paths in settings start from.
    sway, wind : of the first forest that sways, whose modes and pieces all others share.
    Blender's current scene gets the forest of the scene's own seed; nothing later needs it there.

    Raises
    ------
    SpecError : ``bpy`` is missing; a species, a file or an object cannot be used.
    """

    sway: ForestSway | None = None
    wind: EchoWind | None = None
    _site: Site | None

    def __init__(self, scene: Scene | str | Path, folder: str | Path = ".") -> None:
        if not isinstance(scene, Scene):
            scene = read(scene)
        if scene.tiles.size:
            raise SpecError(
                "tiles",
                "are for scans and pings of large fields; take them away to fly in this one",
            )
        # Points, whatever the number of trees: what is told of them is told of any number. Full detail: a
        # flyer is a sensor that may come near any tree.
        self.settings = scene.changed(
            forest=scene.forest.changed(instancing="points"),
            accuracy=scene.accuracy.changed(detail="full"),
        )
        self._moving: dict[Search, MovingCaster] = {}
        site = self._site = Site.of(self.settings, Path(folder))
        forest = site.grow()
        self._grown = replace(forest, variants=site.every_variant(forest))
        shown = self._catalogue() if self._grown.variants else forest
        self._keep(site.build(shown).observer.geometry)

    @classmethod
    def standing(cls, world: World) -> Stock:
        """Surroundings that stand in Blender now; there is one forest of them."""
        made = cls.__new__(cls)
        made.settings, made._site, made._moving = world.scene, None, {}
        made._grown = world.forest
        made._keep(world.observer.geometry)
        return made

    def surroundings(self, seed: int | None = None) -> FlightSurroundings:
        """The forest of a seed; None: of the scene's own, or what stands in Blender."""
        if self._site is None:
            given = self.settings, self, self._geometry, self._grown
            return FlightSurroundings(*given, self.settings.seed)
        seed = self.settings.seed if seed is None else seed
        forest = self._forest(seed)
        return FlightSurroundings(self.settings, self, self._placed(forest), forest, seed)

    def built(self, forest: GrownForest) -> World:
        """A forest of this stock in Blender's current scene."""
        return self._standing_here().build(forest)

    @cached_property
    def caster(self) -> Search:
        """Rays that meet everything of the first forest."""
        return self._cast_in(self._geometry)

    @cached_property
    def wood(self) -> Search:
        """Rays that pass leaves."""
        return self._cast_in(self._geometry.solid())

    def _cast_in(self, scene: SceneGeometry) -> Search:
        from ..blender.rays.casters import make_caster

        return make_caster(scene, self.settings.rays)

    @cached_property
    def targets(self) -> EchoTargets:
        """Targets that sound back, measured once."""
        return EchoTargets(self._geometry)

    def moving_caster(self, scene: SceneGeometry, sway: ForestSway, still: Search) -> MovingCaster:
        """Rays in a forest that sways, whose trees are shared with those of the forests before.

        still : the caster of the same meshes as they stand.
        """
        from ..blender.rays.casters import make_moving_caster

        like = self._moving.get(still)
        moving = MovingScene(scene, sway=NearbySway(sway), like=like and like.moving)
        made = make_moving_caster(moving, self.settings.rays, like)
        if like is None or len(like.scene.meshes) < len(made.scene.meshes):
            self._moving[still] = made
        return made

    @cached_property
    def solids(self) -> list[Solid]:
        """Triangles that stop a flyer in each mesh."""
        thinnest = self.settings.flight.thinnest
        return [Solid(mesh, thinnest) for mesh in self._geometry.meshes]

    @cached_property
    def ground(self) -> Any:
        """The terrain."""
        from ..stand.intensity.surface import Flat

        if self._site is None:
            return Flat(self.settings.forest.terrain.base)
        return self._site.ground

    def _standing_here(self) -> Site:
        """The site with the settings of now, which may have changed since it was read."""
        return replace(self._site, scene=self.settings)

    def _catalogue(self) -> GrownForest:
        """One tree of every variant, far from each other."""
        keys = np.array(list(self._grown.variants), dtype=np.int64).reshape(-1, 2)
        count = len(keys)
        position = np.zeros((count, 3))
        position[:, 0] = APART * np.arange(count)
        stand = replace(
            self._grown.stand,
            position=position,
            rotation=np.zeros(count),
            scale=np.ones(count),
            species=keys[:, 0],
            variant=keys[:, 1],
            id=np.arange(count),
            sink=np.zeros(count),
        )
        return replace(self._grown, stand=stand)

    def _keep(self, geometry: SceneGeometry) -> None:
        self._geometry = geometry
        if self._site is None:
            return
        single = np.flatnonzero(geometry.tree >= 0)
        # Which mesh each variant is, by the number of its tree in the catalogue.
        self._mesh_of = {
            key: int(geometry.mesh_index[single[geometry.tree[single] == number][0]])
            for number, key in enumerate(self._grown.variants)
        }

    def _forest(self, seed: int) -> GrownForest:
        site = self._standing_here()
        plan = replace(site, scene=site.scene.changed(seed=seed)).planned()
        return replace(self._grown, stand=plan.placed(self._grown.variants))

    def _placed(self, forest: GrownForest) -> SceneGeometry:
        """The geometry that Blender's scene of this forest would be read as."""
        from ..blender.scene.instances import evaluated_transforms

        stock, stand = self._geometry, forest.stand
        rest = np.flatnonzero(stock.tree < 0)
        keys = [*zip(stand.species.tolist(), stand.variant.tolist(), strict=True)]
        mesh = np.array([self._mesh_of[key] for key in keys], dtype=np.int64)
        number = {key: n for n, key in enumerate(forest.variants)}
        rank = np.array([number[key] for key in keys], dtype=np.int64)
        order = np.argsort(rank, kind="stable")  # as they are read: one variant after the other
        place = forest.transforms()[:, :, 3]
        transform = evaluated_transforms(place, stand.rotation, stand.scale)
        trees = stock.object_index[stock.tree >= 0][:1].repeat(len(stand))
        none = np.full(len(stand), np.nan)
        given: dict[str, np.ndarray] = {
            "transform": transform[order],
            "mesh_index": mesh[order],
            "tree": stand.id[order],
            "species": stand.species[order],
            "object_index": trees,
            "reflectance": none,
        }
        if stock.optics is not None:
            given["optics"] = np.stack([none] * 4, axis=1)
        joined = {k: np.concatenate([getattr(stock, k)[rest], v]) for k, v in given.items()}
        return replace(stock, **joined)  # type: ignore[arg-type]


# Woods that sway around flyers: rays, echoes and obstacles of trees where the wind has them at a time.
#
# Motion is a function of time, so only trees near a flyer are ever put in place: a tree is asked where it
# is once something comes within its own size of it. No wind of a forest bends a tree so far off its rest.


class NearbySway(ForestSway):
    """The sway of a forest, whose trees are asked for their motion when something comes near."""

    def __init__(self, sway: ForestSway) -> None:
        vars(self).update(vars(sway))

    def most(
        self, tree: int, low: np.ndarray, high: np.ndarray, knot: np.ndarray | None = None
    ) -> float:
        """Largest displacement, as of ``ForestSway``; at most the size of the tree."""
        if knot is None:
            return float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
        return super().most(tree, low, high, knot)


class SwayingObstacles(MeshObstacles):
    """Instances of meshes, of which trees sway: as they stand at one time, s; ``at`` gives another.

    What ``MeshObstacles`` tells of trees at rest is asked with as much slack as trees near by are off it,
    and the triangles it finds are put where they are.
    """

    moves = True

    def __init__(self, scene: SceneGeometry, solids: list[Solid], sway: ForestSway) -> None:
        super().__init__(scene, solids)
        self._sway, self._time = sway, 0.0
        self._tree = trees_that_sway(scene, sway)[self.rows]
        self._piece: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = {}
        self._wide = np.linalg.norm(self._high - self._low, axis=1)
        self._moments: dict[int, tuple[np.ndarray, float]] = {}

    def at(self, time: float) -> MeshObstacles:
        """See ``MeshObstacles``."""
        if time != self._time:
            other = copy(self)
            other._time, other._moments = time, {}
            return other
        return self

    def _bound(self, place: np.ndarray) -> np.ndarray:
        room = super()._bound(place)
        return np.maximum(room - self._astray(place), 0.0) if len(self._mesh) else room

    def _astray(self, place: np.ndarray) -> float:
        low, high = place.min(axis=0), place.max(axis=0)
        away = np.maximum(np.maximum(self._low - high, low - self._high), 0.0)
        near = (self._tree >= 0) & (np.linalg.norm(away, axis=1) <= self._wide + REACH)
        return max((self._moment(which)[1] for which in np.flatnonzero(near).tolist()), default=0.0)

    def _own(self, which: np.ndarray, item: np.ndarray) -> np.ndarray:
        corners = self._corners[item]
        for one in np.unique(which[self._tree[which] >= 0]).tolist():
            rows = np.flatnonzero(which == one)
            place = self._moment(one)[0]
            piece = self._pieces(one, len(place))[0][item[rows] - self._shift[self._mesh[one]]]
            corners[rows] = np.einsum("tij,tkj->tki", place[piece, :, :3], corners[rows])
            corners[rows] += place[piece, None, :, 3]
        return corners

    def _moment(self, which: int) -> tuple[np.ndarray, float]:
        """Return places (G, 3, 4) of the pieces of an instance's tree, and metres that nothing of it that
        stops is farther off its rest."""
        if which not in self._moments:
            place = self._sway.moment(int(self._tree[which]), self._time)[0]
            off, ends = place - np.eye(3, 4), self._pieces(which, len(place))[1]
            middle, half = ends.mean(axis=0), np.ptp(ends, axis=0) / 2
            most = np.abs(np.einsum("gij,gj->gi", off[:, :, :3], middle) + off[:, :, 3])
            most += np.einsum("gij,gj->gi", np.abs(off[:, :, :3]), half)
            far = float(np.linalg.norm(most, axis=1).max(initial=0.0)) * float(self._most[which])
            self._moments[which] = place, far
        return self._moments[which]

    def _pieces(self, which: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """(T,) the piece that each triangle of an instance's solid is on, of so many of its tree; and
        (2, G, 3) smallest and largest coordinates of what stops on each, 0 where there is nothing."""
        tree, mesh = int(self._tree[which]), int(self._mesh[which])
        key = mesh, self._sway.variant(tree)[0]
        if key not in self._piece:
            corners = self._solids[mesh].corners
            piece = self._sway.pieces_at(tree, corners.mean(axis=1), np.full(len(corners), -1))
            self._piece[key] = piece, boxes_of_pieces(corners, piece, count)
        return self._piece[key]
