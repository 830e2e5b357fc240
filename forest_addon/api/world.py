"""Steps from a scene's settings to a forest in Blender, and that forest, which sensors look at.

``build`` takes all steps at once; a program that does something in between takes a ``Site``.

A ``World`` holds what was grown and asks Blender's evaluated scene anew whenever something changed there,
so an object that is moved between two scans is scanned where it is. ``bpy`` is asked for when a world is
made, not when this is imported.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.progress import Progress
from ..base.rng import stream
from ..formats.toml_file import idle_in_sensor
from ..results.coordinates import Offset
from ..sensing.kinds import KINDS, audited, choose, kind_of
from ..spec import (
    Airborne,
    Mobile,
    Reverb,
    Scene,
    Sensor,
    Settings,
    Sonar,
    SpecError,
    Terrestrial,
    Tractor,
)
from ..spec.base import typed
from ..stand.forest import (
    NONE,
    GrownForest,
    PlacedTrees,
    cylinder_table,
    leaf_table,
    placed_cylinders,
    placed_leaves,
    placed_skeleton,
    placed_table,
    tree_table,
)
from .given import (
    called,
    enough_memory,
    file_to_write,
    import_blender,
    points_of,
    progress_of,
    refuse_costly,
    refuse_large,
    way_of,
)
from .results import CLASSES, Echoes, PointCloud, Response, Result, RowScan, is_scanner

if TYPE_CHECKING:
    from ..blender.sensors.observe import Observer
    from ..results.scan_file import Written
    from ..sensing.audit import Audit
    from ..sensing.canopy import Canopy
    from ..sensing.trajectory import Trajectory
    from ..spec import Choice


from typing import Self

from ..base.places import shipped
from ..formats.toml_file import read_settings, refuse_unknown_scene
from ..site import ForestSite
from ..spec import with_files
from .given import path_of, scene_of

READING = threading.RLock()  # Blender's scene is evaluated by one thread at a time
MOST_PIXELS = 8192  # along a side of a hemispherical picture


@dataclass(repr=False, eq=False)
class World:
    """A forest in Blender, and the sensors that can look at it.

    scene : its settings. folder : that relative paths in settings start from.
    forest : stand and variants as they were grown; None for a scene that was not grown here.
    seconds : that growing and building took.
    """

    scene: Scene
    folder: Path
    forest: GrownForest | None
    _place: Any
    seconds: float = 1.0
    _taken: Observer | None = None

    def __repr__(self) -> str:
        count = "a scene in Blender" if self.forest is None else f"{len(self.forest.stand)} trees"
        return f"World({self.scene.name!r}, seed {self.scene.seed}: {count})"

    def __reduce__(self) -> Any:
        why = "stands in this Blender and cannot be copied or sent; send its scene, and build that"
        raise SpecError("world", why)

    def scan(
        self,
        sensor: Tractor | Terrestrial | Mobile | Airborne,
        progress: Progress | None = None,
        along: Trajectory | None = None,
    ) -> PointCloud | RowScan:
        """A LiDAR scan: a ``PointCloud``, or the matrix of a tractor as a ``RowScan``.

        along : where a ``Mobile`` scanner goes, in place of its settings; see ``trajectory``.

        Raises
        ------
        SpecError : settings that this scene cannot serve.
        """
        return self._expect(sensor, "lidar", "scan", progress, along)

    def scan_to(
        self,
        path: str | Path,
        sensor: Terrestrial | Mobile | Airborne,
        *,
        resume: bool = False,
        progress: Progress | None = None,
        along: Trajectory | None = None,
    ) -> Written:
        """Run a scan of any size into a file, in the memory of one chunk of pulses.

        path : .laz, .las, .copc.laz, .ply or .npz. resume : go on with a scan into this file that was cut
        off, to the same bytes. progress : may raise to cancel; what was scanned is kept.

        Raises
        ------
        SpecError : settings that this scene cannot serve; an ending that holds no points.
        OSError : it cannot be written; what was scanned is kept.
        """
        from ..results.scan_file import write_scan
        from ..sensing.lidar.scan import Scan

        if not (isinstance(sensor, Settings) and is_scanner(sensor)):
            raise SpecError("scan_to", f"takes a scanner, not {called(sensor)}")
        path, observer = file_to_write(path), self.observer
        progress_of(progress)
        sensor, _ = choose(sensor)
        way = way_of(observer, sensor, along, self.folder)
        scan = Scan.of(observer.job(sensor, self.scene, self.folder, way))
        offset = Offset.of(self.scene)
        return write_scan(
            path, scan, self.scene.seed, offset=offset, resume=resume, progress=progress
        )

    def ping(
        self, sensor: Sonar, progress: Progress | None = None, along: Trajectory | None = None
    ) -> Echoes:
        """The echo of one ping, or of one from every pose of a route.

        along : poses to ping from, in place of those of its settings; see ``trajectory``.

        Raises
        ------
        SpecError : settings that this scene cannot serve.
        """
        return self._expect(sensor, "sonar", "ping", progress, along)

    def impulse_response(self, sensor: Reverb, progress: Progress | None = None) -> Response:
        """Responses of receivers to sources by way of the trunks, a channel for each pair.

        Raises
        ------
        SpecError : settings that this scene cannot serve.
        """
        return self._expect(sensor, "reverb", "impulse_response", progress)

    def look(
        self,
        sensor: Sensor,
        progress: Progress | None = None,
        along: Trajectory | None = None,
    ) -> Result:
        """The result of a sensor of any kind.

        along : where one that moves goes, in place of its settings; see ``trajectory``.

        Raises
        ------
        SpecError : this is no sensor, or one that this scene cannot serve.
        """
        if not isinstance(sensor, Settings) or not hasattr(sensor, "kind"):
            raise SpecError("look", f"takes a sensor, such as Terrestrial(), not {called(sensor)}")
        progress_of(progress)
        observer = self.observer
        sensor, chosen = choose(sensor)
        before = time.perf_counter()
        try:
            with enough_memory(sensor.name, "take fewer rays, pings or samples"):
                way = way_of(observer, sensor, along, self.folder)
                cost = kind_of(sensor).cost(
                    sensor, way, "embree"
                )  # its memory is that of any engine
                refuse_costly(sensor, cost)
                job = observer.job(sensor, self.scene, self.folder, way)
                result = kind_of(sensor).run(job, progress)
            seconds = time.perf_counter() - before
            audit = audited(job, result, seconds)
            idlers = tuple(
                f"{sensor.name}: {sentence}" for sentence in idle_in_sensor(sensor, self.folder)
            )
            warnings = (*idlers, *observer.warnings(job))
            empty = kind_of(sensor).empty(job, result)
            warnings = (*warnings, f"{sensor.name}: {empty}") if empty else warnings
        except SpecError:
            raise
        except ValueError as problem:
            raise SpecError(sensor.name, str(problem)) from None
        offset = Offset.of(self.scene)
        ours = [one for one in self.chosen if one.sensor == sensor.name]
        chosen = (*chosen, *kind_of(sensor).left_out(result), *ours)
        made = CLASSES.get(sensor.kind, Result)
        return made(sensor, result, seconds, audit, offset, chosen, warnings, way)

    @property
    def observer(self) -> Observer:
        """The evaluated scene as arrays, read again where it changed; casters and scatterers.

        Raises
        ------
        SpecError : the file that the world stood in is closed, or another forest was built in its place.
        """
        if self._taken is not None:
            return self._taken
        bpy = import_blender()
        from ..blender.scene.forest import standing_forest
        from ..blender.sensors.moving import seconds_of
        from ..blender.sensors.observe import Observer

        try:
            name = self._place.name
        except ReferenceError:
            closed = "the file that it stood in is closed; build it again"
            raise SpecError("world", closed) from None
        if bpy.context.scene != self._place:
            raise SpecError("world", f'Blender shows another scene; go back to "{name}"')
        if self.forest is not None and standing_forest(self._place) is not self.forest:
            other = "another forest was built in its place; build this one again to look at it"
            raise SpecError("world", other)
        with READING:
            observer = Observer.of(bpy.context.evaluated_depsgraph_get(), self.scene.rays)
            observer.blow(self._swaying, seconds_of(self._place))
        return observer

    @cached_property
    def _swaying(self) -> Any:
        """The sway of the trees in the scene's wind; None where they stand still."""
        from ..stand.wind import sway_of

        return self.forest and sway_of(self.forest, self.scene.wind, self.scene.seed)

    @contextmanager
    def still(self) -> Iterator[Observer]:
        """Look at the scene as it stands now, whatever is added to it within the block."""
        self._taken = self.observer
        try:
            yield self._taken
        finally:
            self._taken = None

    @property
    def chosen(self) -> tuple[Choice, ...]:
        """Choices that the forest left to the scene's sensors."""
        return () if self.forest is None else self.forest.chosen

    @property
    def audit(self) -> dict[str, Audit]:
        """Audit of what grew against its truth: "branches" against the cones of their skeletons, "leaves"
        against the triangles in Blender; each as far as the trees have them.

        Raises
        ------
        SpecError : the world was not grown here.
        """
        from ..sensing.trees_audit import audit_trees

        rng = stream(self.scene.seed, "audit", "trees")
        share = self.scene.accuracy.audit
        return audit_trees(self._grown(), self.observer.geometry, rng, self.seconds, share)

    @property
    def trees(self) -> dict[str, np.ndarray]:
        """The trees, an array (N,) a column: tree, species, x_m, y_m, z_m, height_m, leaf_area_m2, ...

        After those that were grown here come trees that were dragged in from an asset library.

        Raises
        ------
        SpecError : the world was not grown here, and no tree of a library stands in it.
        """
        table = self._both(tree_table, placed_table)
        for name in [name for name in table if name.startswith("target_") or name == "in_band"]:
            # a column with gaps, NaN in the gaps
            table[name] = np.array([np.nan if v == "" else float(v) for v in table[name].tolist()])
        return table

    @property
    def leaves(self) -> dict[str, np.ndarray]:
        """Every leaf of every tree, in the world: centre (L, 3), normal (L, 3), axis (L, 3), and (L,)
        length, width, radius of equal area (metres), branch, leaf, tree, species.

        Raises
        ------
        SpecError : as ``trees``.
        """
        return self._both(leaf_table, placed_leaves)

    @property
    def cylinders(self) -> dict[str, np.ndarray]:
        """Every segment of every branch as a cylinder in the world, in the terms of TreeQSM: tree, cyl_ID,
        parent_ID, extension_ID, axis_ID, branching_order, startX, ..., radius_cyl, length, volume.

        Raises
        ------
        SpecError : as ``trees``.
        """
        return self._both(cylinder_table, placed_cylinders)

    def _both(
        self,
        of_forest: Callable[[GrownForest], Mapping[str, Any]],
        of_placed: Callable[[PlacedTrees], Mapping[str, Any]],
    ) -> dict[str, np.ndarray]:
        """Tables one below the other; what only the grown trees have, as targets, is empty or NaN below."""
        forest, placed = self._standing()
        kept = len(placed) or forest is None
        second = (
            {name: np.array(column) for name, column in of_placed(placed).items()} if kept else {}
        )
        if forest is None:
            return second
        first = {name: np.array(column) for name, column in of_forest(forest).items()}
        if not second:
            return first
        count = len(next(iter(second.values()), ()))
        for name, values in first.items():
            lacking = np.full(count, np.nan if values.dtype.kind == "f" else "")
            first[name] = np.concatenate([values, second.get(name, lacking)])
        return first

    def canopy(self, points: np.ndarray) -> Canopy:
        """Readings of hemispherical pictures at points (N, 3): gap fraction by zenith angle, the share
        of open sky and the effective plant area index; ``leaf_area_index`` is the true one.

        Raises
        ------
        SpecError : these are no points.
        """
        from ..sensing.canopy import look_up

        points = points_of("canopy", points)
        return look_up(self.observer.caster, points, stream(self.scene.seed, "canopy"))

    def hemisphere(self, point: np.ndarray, pixels: int = 512) -> np.ndarray:
        """A hemispherical picture upwards from a point (3,), equidistant: (pixels, pixels) int8, 1 wood,
        2 leaf, 3 ground, 0 other, -1 sky, -2 beyond the horizon; first row north, first column east.

        Raises
        ------
        SpecError : this is no point, or the picture is too large.
        """
        from ..sensing.canopy import hemisphere

        point = points_of("hemisphere", point, one=True)
        pixels = typed("pixels", pixels, int)
        if not 1 <= pixels <= MOST_PIXELS:
            raise SpecError("pixels", f"{pixels} is out of range; use from 1 to {MOST_PIXELS}")
        return hemisphere(self.observer.caster, point, pixels)

    @property
    def wood_area_index(self) -> float:
        """Half of the wood's surface over the area of the field, m²/m²; twigs of templates counted by mesh.

        Raises
        ------
        SpecError : the world was not grown here.
        """
        return float(self.trees["wood_area_m2"].sum() / 2 / self._grown().stand.area)

    @property
    def leaf_area_index(self) -> float:
        """One-sided leaf area of all trees over the area of the field, m²/m².

        Raises
        ------
        SpecError : the world was not grown here.
        """
        return float(self.trees["leaf_area_m2"].sum() / self._grown().stand.area)

    def skeleton(self, tree: int) -> dict[str, np.ndarray]:
        """The segments of a tree in the world: start (S, 3), end (S, 3), radius (S, 2) at both, metres;
        parent (S,), -1 at the foot; order (S,), 0 for the trunk; generation (S,);
        dead (S,), whether it lives no more.

        tree : its number, a value of ``trees["tree"]``.

        Raises
        ------
        SpecError : as ``trees``; there is no such tree.
        """
        forest, placed = self._standing()
        rows = np.flatnonzero(forest.stand.id == tree) if forest is not None else ()
        if forest is None or not len(rows):
            row = placed.row_of(tree)
            if row is None:
                raise SpecError("tree", f"{tree} is no tree of this world; see trees['tree']")
            return placed_skeleton(placed.grown[placed.index[row]], placed.transform[row])
        row = int(rows[0])
        matrix, scale = forest.transforms()[row], float(forest.stand.scale[row])
        wood = forest.variant_of(row).skeleton
        return {
            "start": wood.start @ matrix[:, :3].T + matrix[:, 3],
            "end": wood.end @ matrix[:, :3].T + matrix[:, 3],
            "radius": wood.radius * scale,
            "parent": wood.parent,
            "order": wood.order,
            "generation": wood.generation,
            "dead": wood.is_dead,
        }

    def _repr_html_(self) -> str:
        """List what stands here, as notebooks show it."""
        if self.forest is None:
            return f"<b>{self.scene.name}</b>: the scene in Blender"
        kinds = zip(self.forest.labels, self.forest.stand.counts(), strict=True)
        rows = "".join(f"<tr><td>{label}</td><td>{count:,}</td></tr>" for label, count in kinds)
        return f"<b>{self.scene.name}</b>, seed {self.scene.seed}<table>{rows}</table>"

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the objects that labels of points number: ``objects[cloud.labels["object"]]``."""
        return tuple(self.observer.names)

    @property
    def species(self) -> tuple[str, ...]:
        """Names of the species that labels number; without what comes from asset libraries."""
        return () if self.forest is None else tuple(self.forest.labels)

    def _expect(
        self,
        sensor: Any,
        family: str,
        call: str,
        progress: Progress | None,
        along: Trajectory | None = None,
    ) -> Any:
        kinds = [kind for kind in KINDS.values() if kind.family == family]
        if type(sensor) not in [kind.settings for kind in kinds]:
            wanted = " or ".join(kind.settings.__name__ for kind in kinds)
            raise SpecError(call, f"takes a {wanted}, not {called(sensor)}")
        return self.look(sensor, progress, along)

    def _standing(self) -> tuple[GrownForest | None, PlacedTrees]:
        """Forest that was grown here, and trees of libraries; an error where there is neither."""
        bpy = import_blender()
        from ..blender.scene.instances import ASSET_KEY

        of_library = any(ASSET_KEY in mesh for mesh in bpy.data.meshes)
        placed = self.observer.placed_trees if of_library else NONE
        return (None if len(placed) and self.forest is None else self._grown()), placed

    def _grown(self) -> GrownForest:
        if self.forest is None:
            raise SpecError("world", "was not grown here; its trees are known to build() alone")
        return self.forest


def read(path: str | Path) -> Scene:
    """The scene of a scene file, or of one of assets/scenes by its name; files that it names are found from
    wherever it is used.

    Raises
    ------
    SpecError : there is no such file, or it says what cannot be used; names the key.

    >>> from forest_addon import api as forest
    >>> scene = forest.read("demo")
    >>> scene.changed(seed=8).seed
    8
    """
    path = shipped(path_of("read", path), "scenes", ".toml")
    refuse_unknown_scene(path)
    folder = path.resolve().parent

    def found(file: str) -> str:  # a name without an ending is a preset's
        return str(folder / file) if Path(file).suffix else file

    scene = with_files(read_settings(path, Scene), found)
    return scene.changed(blend=found(scene.blend)) if scene.blend else scene


def build(scene: Scene, *, folder: str | Path = ".", progress: Progress | None = None) -> World:
    """Grow a scene's forest and build it in Blender's current scene.

    Blender's start-up cube, camera and lamp are removed where ``bpy`` is a module and no file is open; in
    Blender itself the forest is added to what is there, and replaces the forest of before.

    folder : that relative paths in the scene start from. progress : called as progress(done, total) while
    trees grow.

    Raises
    ------
    SpecError : ``bpy`` is missing; a species, a file or an object cannot be used.

    >>> from forest_addon import api as forest
    >>> bush = forest.Planting(species="hazelnut", variants=1, expected=3, exact=True)
    >>> world = forest.build(forest.Scene(seed=1, plantings=(bush,)))
    >>> len(world.trees["x_m"])
    3
    """
    started = time.perf_counter()
    progress_of(progress)
    with enough_memory("build", "plant fewer trees, or coarser ones"):
        site = Site.of(scene, folder)
        forest = site.grow(progress)
        refuse_large(forest)
        return site.build(forest, seconds=time.perf_counter() - started)


def current(scene: Scene | None = None) -> World:
    """World of what stands in Blender now, forest or not.

    scene : air, seed and rays to use; left out: those of an empty scene file.

    Raises
    ------
    SpecError : ``bpy`` is missing.

    >>> from forest_addon import api as forest
    >>> world = forest.current()
    >>> cloud = world.scan(forest.Terrestrial(angle_step_deg=10))
    >>> cloud.points.shape[1]
    3
    """
    bpy = import_blender()
    settings = Scene() if scene is None else scene_of("current", scene)
    return World(settings, Path(), None, bpy.context.scene)


class Site(ForestSite):
    """A scene whose files are read, in Blender with the file open that it starts from; nothing has grown."""

    def __reduce__(self) -> Any:
        raise SpecError(
            "site",
            "belongs to the file open in this Blender and cannot be copied or sent; send its scene",
        )

    @classmethod
    def of(cls, scene: Scene, folder: str | Path = ".") -> Self:
        """Read what a scene names, and open the Blender file that it starts from.

        folder : that relative paths in the scene start from.

        Raises
        ------
        SpecError : ``bpy`` is missing; a species, a file or an object cannot be used.

        >>> from forest_addon import api as forest
        >>> bush = forest.Planting(species="hazelnut", variants=1, expected=3, exact=True)
        >>> site = forest.Site.of(forest.Scene(seed=1, plantings=(bush,)))
        >>> len(site.plan()), len(site.grow().stand)
        (3, 3)
        """
        import_blender()
        from ..blender.files.export import open_for
        from ..blender.read.inputs import with_objects

        scene, folder = scene_of("build", scene), path_of("folder", folder)
        site = cls.read(scene, folder)
        open_for(scene, folder)
        return with_objects(site)

    def build(
        self,
        forest: GrownForest,
        *,
        as_assets: bool = True,
        looks: bool = True,
        seconds: float = 0.0,
    ) -> World:
        """Put a forest that grew here, and the scene's sensors, into Blender's current scene.

        as_assets : whether variants become assets, each with a picture. looks : whether materials are as
        somebody would see them. seconds : that growing took.

        Raises
        ------
        SpecError : ``bpy`` is missing; something that stands there is in the way.
        """
        place = import_blender().context.scene
        from ..blender.scene.forest import build
        from ..blender.sensors.objects import put_sensor

        started = time.perf_counter()
        how = {"as_assets": as_assets, "looks": looks}
        build(place, self.scene, forest, self.inputs.terrain, **how)
        for sensor in self.scene.sensors:
            put_sensor(place, sensor)
        seconds += time.perf_counter() - started
        return World(self.scene, self.folder, forest, place, seconds)
