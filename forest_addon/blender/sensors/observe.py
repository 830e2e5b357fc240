"""Sensors in a Blender scene: read the evaluated depsgraph once, then look and listen in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import bpy
import numpy as np

from ...base.kept import LastAsked
from ...base.progress import Progress
from ...base.trimesh import GROUND
from ...sensing.kind import Observation
from ...sensing.kinds import choose, kind_of
from ...sensing.moving import MovingScene
from ...sensing.moving_rays import MovingCaster
from ...sensing.rays.caster import RayCaster
from ...sensing.rays.geometry import SceneGeometry, rounding_warning
from ...sensing.rays.inside import tree_around
from ...sensing.rays.paths import SceneMotion
from ...sensing.rays.search import Search
from ...sensing.rays.tracks import BENT
from ...sensing.trajectory import Trajectory
from ...spec import Rays, Scene, Sensor
from ...stand.forest import PlacedTrees
from ..rays.casters import make_caster, make_moving_caster
from ..read.depsgraph import kept, lasting, read_scene, solids_in
from ..scene.meshes import placed_trees
from ..scene.nodes import in_full
from .moving import WITHIN, SceneFollower, read_motion, seconds_of

if TYPE_CHECKING:
    from ...sensing.reverb.sums.fast_scattering import Expansions
    from ...stand.wind import ForestSway

T = TypeVar("T")
ENDS = {"SPEAKER", "EMPTY", "CAMERA"}  # what can be a source or a receiver


class Observer:
    """An evaluated scene as arrays, with the casters and scatterers that sensors need, made once."""

    def __init__(
        self,
        depsgraph: bpy.types.Depsgraph,
        rays: Rays | None = None,
        expansions: Expansions | None = None,
    ) -> None:
        with in_full(depsgraph):
            self.geometry = read_scene(depsgraph)
        self.warning = rounding_warning(self.geometry)  # what a user should know, in a sentence
        ends = (obj for obj in depsgraph.objects if obj.type in ENDS)
        self.places = {obj.name: tuple(obj.matrix_world.translation) for obj in ends}
        self.rays = rays or Rays()
        if expansions is not None:
            self.expansions = expansions
        self.ran: set[str] = set()  # kinds of sensors for which all is set up
        self._made: dict[Any, Any] = {}
        self._solid: LastAsked[MovingCaster, MovingCaster] = LastAsked(1)
        self._sway: ForestSway | None = None
        self._start = 0.0

    @classmethod
    def of(
        cls, depsgraph: bpy.types.Depsgraph, rays: Rays, expansions: Expansions | None = None
    ) -> Observer:
        """The observer of before, with all it has made, as long as nothing that it senses changes."""
        return kept(depsgraph, _renewed, rays, expansions)

    @cached_property
    def expansions(self) -> Expansions:
        """Sums of sound set up so far; given, or made when a reverb first asks."""
        from ...sensing.reverb.sums.fast_scattering import Expansions

        return Expansions()

    @cached_property
    def names(self) -> list[str]:
        """The object that each instance comes from, by its name."""
        names = self.geometry.object_name
        return [names[number] for number in self.geometry.object_index.tolist()]

    @cached_property
    def caster(self) -> RayCaster:
        """Rays that meet everything."""
        return _sharing(self.geometry, self.rays)

    @cached_property
    def wood(self) -> RayCaster:
        """Rays that pass leaves: lines of sight of sound."""
        return _sharing(self.geometry.solid(), self.rays)

    @cached_property
    def stems(self) -> np.ndarray:
        """Places of the trees on the map, (N, 2) metres, in the order of their numbers."""
        trees, rows = np.unique(self.geometry.tree, return_index=True)
        return self.geometry.transform[rows[trees >= 0], :2, 3]

    @cached_property
    def placed_trees(self) -> PlacedTrees:
        """Trees from asset libraries, with the truth that came along."""
        return placed_trees(self.geometry)

    def once(self, make: Callable[..., T], *of: Any) -> T:
        """``make(self, *of)``, made the first time that a sensor asks for it."""
        if (make, *of) not in self._made:
            self._made[make, *of] = make(self, *of)
        return self._made[make, *of]  # type: ignore[no-any-return]

    def blow(self, sway: ForestSway | None, start: float = 0.0) -> None:
        """Let trees sway, or stand still. start : s, the wind's time when a sensor begins."""
        if (sway, start) == (self._sway, self._start):
            return
        self._made.clear()
        self.ran.clear()
        self._sway, self._start = sway, start

    @property
    def sway(self) -> tuple[ForestSway, float] | None:
        """The sway of trees and the time at which it begins, s; None: they stand still."""
        return None if self._sway is None else (self._sway, self._start)

    @property
    def swaying(self) -> Any:
        """Rays that meet everything, trees where the wind has them at a time; the still ones without wind."""
        return self.caster if self._sway is None else self.once(_in_the_wind, False)

    @property
    def swaying_wood(self) -> Any:
        """The same without leaves."""
        return self.wood if self._sway is None else self.once(_in_the_wind, True)

    def job(
        self,
        sensor: Sensor,
        settings: Scene,
        folder: Path = Path(),
        way: Trajectory | None = None,
    ) -> Observation:
        """A sensor with nothing left to "auto", where it goes, and how the scene moves while it looks, if it
        heeds that; on the main thread, since Blender's scene is read. Running it touches no Blender data.

        folder : that files named in the settings are relative to. way : None: as its settings say.

        Raises
        ------
        ValueError : as ``way``; a motion that cannot be followed; says what to change.
        """
        sensor, _ = choose(sensor)
        kind, begin, moving = kind_of(sensor), 0.0, None
        way = self.way(sensor, folder) if way is None else way
        seconds = kind.lasts(sensor, way)
        sways = self._sway is not None and kind.sways and kind.timed
        if seconds > 0:
            if kind.moves and way is None:  # it stays, and looks at the present frame
                begin = max(seconds_of(bpy.context.scene), 0.0)
            whole, motion = read_motion(self.geometry, seconds, begin)
            sway, like = (self._sway, self.swaying) if sways else (None, None)
            scene = MovingScene(self.geometry, motion, whole, sway, like=like and like.moving)
            moving = make_moving_caster(scene, self.rays, like)
        elif sways and not kind.listens:  # a sonar asks for what it needs
            moving = self.swaying
        return Observation(sensor, self, settings, folder, way, moving, begin)

    def moving_wood(self, moving: MovingCaster) -> MovingCaster:
        """Rays that pass leaves in a scene that moves."""
        return self._solid.once(
            moving, lambda: make_moving_caster(moving.moving.solid(), self.rays)
        )

    def observe(
        self,
        sensor: Sensor,
        settings: Scene,
        progress: Progress | None = None,
        folder: Path = Path(),
        way: Trajectory | None = None,
    ) -> Any:
        """Run one sensor of a scene: a ``job``.

        Raises
        ------
        ValueError : settings that this scene cannot serve; says what to change.
        """
        return kind_of(sensor).run(self.job(sensor, settings, folder, way), progress)

    def warnings(self, job: Observation) -> tuple[str, ...]:
        """Sentences on a sensor that stands where no user would want it: inside of a tree."""
        sensor = job.sensor
        points = kind_of(sensor).positions(job)
        trees = tree_around(self.wood, points)
        motion = SceneMotion() if job.moving is None else job.moving.moving.motion
        said = self._in_the_wind(sensor)
        said += [
            f'{sensor.name}: "{name}" has more or fewer parts from time to time; around these moments it '
            "stands still between samples"
            for name in motion.held
        ]
        said += [
            f'{sensor.name}: "{name}" is made of other triangles, or jumps, appears or vanishes, between '
            f"frames; each of its states is met for {1e3 * motion.pause:.3g} ms"
            for name in motion.remade
        ]
        if motion.within > WITHIN:
            said.append(
                f"{sensor.name}: what moves may be {motion.within:.1g} m off between frames; raise the frame "
                "rate for less"
            )
        if motion.bent > BENT:
            said.append(
                f"{sensor.name}: what changes its shape may be {motion.bent:.1g} m off between frames; raise "
                "the frame rate for less"
            )
        above = self.wood.cast(points, np.broadcast_to((0.0, 0.0, 1.0), points.shape))
        meshes, mesh_of = self.wood.scene.meshes, np.append(self.wood.scene.mesh_index, -1)
        buried = above.found & [
            mesh >= 0 and meshes[mesh].part[triangle] == GROUND
            for mesh, triangle in zip(mesh_of[above.instance], above.triangle, strict=True)
        ]
        if buried.any():
            where = ", ".join(f"{v:g}" for v in points[buried][0])
            deep = f"{above.distance[buried][0]:.3g} m under the ground"
            said.append(f"{sensor.name} is {deep} at ({where}) m; raise it")
        return *said, *(
            f"{sensor.name} stands inside tree {tree}, at "
            f"({', '.join(f'{v:g}' for v in points[trees == tree][0])}) m; move it out of the wood"
            for tree in np.unique(trees[trees >= 0]).tolist()
        )

    def _in_the_wind(self, sensor: Sensor) -> list[str]:
        """Say what stands still although the wind blows, and what leans too far."""
        if self._sway is None:
            return []
        if not kind_of(sensor).sways:
            return [f"{sensor.name}: trees stand still, as if there were no wind"]
        number = self._sway.number
        trees = np.unique(self.geometry.tree[self.geometry.tree >= 0]).tolist()
        still = sum(1 for tree in trees if tree not in number)
        said = [f"{sensor.name}: {still:,} trees of libraries stand still in the wind"] * (
            still > 0
        )
        if leaning := self._sway.leaning():
            said.append(
                f"{sensor.name}: {leaning:,} trees lean by more than a fifth of their height or bend by "
                "more than 86 degrees, at which they are held: farther than small motions, as which their "
                "sway is computed; give less wind, or stouter trees"
            )
        return said

    @staticmethod
    def way(sensor: Sensor, folder: Path = Path()) -> Any:
        """Path of a moving sensor, sampled from Blender's scene or read from a file; None: it
        stays.

        Raises
        ------
        ValueError : what it should follow, or the file of its route, is not there or cannot be used.
        """
        return kind_of(sensor).trajectory(sensor, folder, SceneFollower(bpy.context.scene))


def _renewed(
    depsgraph: bpy.types.Depsgraph, rays: Rays, expansions: Expansions | None = None
) -> Observer:
    """An observer of the scene as it is now: that of before, where what is sensed is the same."""
    new = Observer(depsgraph, rays, expansions)
    old = lasting.get("observer", new)
    asked = old.rays == rays and (expansions is None or expansions is old.expansions)
    # The same meshes at the same places, of which the same is said.
    same = [*map(id, old.geometry.meshes)] == [*map(id, new.geometry.meshes)] and all(
        _are_equal(getattr(old.geometry, field.name), getattr(new.geometry, field.name))
        for field in fields(SceneGeometry)
        if field.name != "meshes"
    )
    if not (asked and same):
        old = new
    old.places, lasting["observer"], lasting["changed"] = new.places, old, False
    lasting["solids"] = solids_in(depsgraph.scene)
    return old


def _are_equal(one: Any, other: Any) -> bool:
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_are_equal, one, other))
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return bool(one is other or one == other)


def _sharing(scene: SceneGeometry, rays: Rays) -> RayCaster:
    """A caster; where half of a scene's triangles are in one of before, with the trees of that.

    Those that were made of all their meshes are kept, two of them: of everything, and of what is solid.
    """
    before: list[tuple[Rays, Search]] = lasting.setdefault("casters", [])
    half = sum(len(mesh.triangles) for mesh in scene.meshes) / 2
    for asked, like in before:
        known = {*map(id, like.scene.meshes)}
        common = sum(len(mesh.triangles) for mesh in scene.meshes if id(mesh) in known)
        if asked == rays and common > half:
            return make_caster(scene, rays, like)
    made = make_caster(scene, rays)
    before.append((rays, made))
    del before[:-2]
    return made


def _in_the_wind(observer: Observer, solid: bool) -> MovingCaster:
    """Rays at trees that sway, among what stands still."""
    assert observer.sway is not None
    sway, start = observer.sway
    scene = observer.geometry.solid() if solid else observer.geometry
    return make_moving_caster(MovingScene(scene, sway=sway, start=start), observer.rays)
