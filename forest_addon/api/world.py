"""A forest in Blender that sensors look at: read a scene, build it, or take what stands there.

A ``World`` holds what was grown and asks Blender's evaluated scene anew whenever something changed there,
so an object that is moved between two scans is scanned where it is. ``bpy`` is asked for when a world is
made, not when this is imported.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..formats.toml_file import read_settings
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
    with_files,
)
from . import truth
from .results import Echoes, PointCloud, Response, Result, RowScan, result_of

if TYPE_CHECKING:
    from ..blender.observe import Observer
    from ..sensing.audit import Audit
    from ..sensing.canopy import Canopy
    from ..stand.forest import Forest
    from ..stand.placed import PlacedTrees

Progress = Callable[[int, int], None]


def read(path: str | Path) -> Scene:
    """The scene of a scene file; files that it names are found from wherever it is used.

    Raises
    ------
    SpecError : there is no such file, or it says what cannot be used; names the key.

    >>> from forest_addon import api as forest
    >>> scene = forest.read("assets/scenes/demo.toml")
    >>> scene.changed(seed=8).seed
    8
    """
    path = Path(path)
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
    bpy = import_blender()
    from ..blender.forest import build as build_in_blender
    from ..blender.inputs import inputs_from_scene
    from ..blender.opening import open_for
    from ..blender.sensors import put_sensor
    from ..formats.species_file import find_species, load_species
    from ..formats.stand_files import read_inputs
    from ..stand.forest import grow_forest

    folder = Path(folder)
    species = [load_species(find_species(p.species, folder)) for p in scene.plantings]
    open_for(scene, folder)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    inputs = inputs_from_scene(scene, depsgraph, read_inputs(scene, folder))
    forest = grow_forest(scene, species, progress, inputs)
    place = bpy.context.scene
    try:
        build_in_blender(place, scene, forest, inputs.terrain)
    except ValueError as problem:
        raise SpecError("build", str(problem)) from None
    for sensor in scene.sensors:
        put_sensor(place, sensor)
    return World(scene, folder, forest, place)


def current(scene: Scene | None = None) -> World:
    """What stands in Blender now, forest or not, as a world.

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
    return World(scene or Scene(), Path(), None, bpy.context.scene)


@dataclass(repr=False, eq=False)
class World:
    """A forest in Blender, and the sensors that can look at it.

    scene : its settings. folder : that relative paths in settings start from.
    forest : stand and variants as they were grown; None for a scene that was not grown here.
    """

    scene: Scene
    folder: Path
    forest: Forest | None
    _place: Any

    def __repr__(self) -> str:
        count = "a scene in Blender" if self.forest is None else f"{len(self.forest.stand)} trees"
        return f"World({self.scene.name!r}, seed {self.scene.seed}: {count})"

    def scan(
        self,
        sensor: Tractor | Terrestrial | Mobile | Airborne,
        progress: Progress | None = None,
    ) -> PointCloud | RowScan:
        """A LiDAR scan: a ``PointCloud``, or the matrix of a tractor as a ``RowScan``.

        Raises
        ------
        SpecError : settings that this scene cannot serve.
        """
        return self._expect(sensor, (Tractor, Terrestrial, Mobile, Airborne), "scan", progress)

    def ping(self, sensor: Sonar, progress: Progress | None = None) -> Echoes:
        """The echo of one ping, or of one from every pose of a route.

        Raises
        ------
        SpecError : settings that this scene cannot serve.
        """
        return self._expect(sensor, (Sonar,), "ping", progress)

    def impulse_response(self, sensor: Reverb, progress: Progress | None = None) -> Response:
        """What receivers hear of sources by way of the trunks, a channel for each pair.

        Raises
        ------
        SpecError : settings that this scene cannot serve.
        """
        return self._expect(sensor, (Reverb,), "impulse_response", progress)

    def look(self, sensor: Sensor, progress: Progress | None = None) -> Result:
        """The result of a sensor of any kind.

        Raises
        ------
        SpecError : this is no sensor, or one that this scene cannot serve.
        """
        from ..sensing.choice import choose

        if not isinstance(sensor, Settings) or not hasattr(sensor, "kind"):
            raise SpecError("look", f"takes a sensor, such as Terrestrial(), not {_called(sensor)}")
        observer = self.observer
        sensor, chosen = choose(sensor)
        before = time.perf_counter()
        try:
            way = observer.way(sensor, self.folder)
            found = observer.observe(sensor, self.scene, progress, self.folder, way)
            seconds = time.perf_counter() - before
            audit = observer.audit(sensor, self.scene, found, seconds, self.folder, way)
            warnings = observer.warnings(sensor, way)
        except SpecError:
            raise
        except ValueError as problem:
            raise SpecError(sensor.name, str(problem)) from None
        offset = self.scene.offset
        return result_of(sensor, found, seconds, audit, offset, chosen, warnings)

    @property
    def observer(self) -> Observer:
        """The evaluated scene as arrays, read again where it changed; casters and scatterers.

        Raises
        ------
        SpecError : the file that the world stood in is closed.
        """
        bpy = import_blender()
        from ..blender.observe import Observer

        try:
            name = self._place.name
        except ReferenceError:
            raise SpecError(
                "world", "the file that it stood in is closed; build it again"
            ) from None
        if bpy.context.scene != self._place:
            raise SpecError("world", f'Blender shows another scene; go back to "{name}"')
        return Observer.of(bpy.context.evaluated_depsgraph_get(), self.scene.rays)

    @property
    def audit(self) -> dict[str, Audit]:
        """What grew, held against its truth: "branches" against the cones of their skeletons, "leaves"
        against the triangles in Blender; each as far as the trees have them.

        Raises
        ------
        SpecError : the world was not grown here.
        """
        from ..rng import stream
        from ..sensing.trees_audit import audit_trees

        rng = stream(self.scene.seed, "audit", "trees")
        return audit_trees(
            self._grown(), self.observer.geometry, rng, 1.0, self.scene.accuracy.audit
        )

    @property
    def trees(self) -> dict[str, np.ndarray]:
        """The trees, an array (N,) a column: tree, species, x_m, y_m, z_m, height_m, leaf_area_m2, ...

        After those that were grown here come trees that were dragged in from an asset library.

        Raises
        ------
        SpecError : the world was not grown here, and no tree of a library stands in it.
        """
        return truth.trees(*self._standing())

    @property
    def leaves(self) -> dict[str, np.ndarray]:
        """Every leaf of every tree, in the world: centre (L, 3), normal (L, 3), axis (L, 3), and (L,)
        length, width, radius of equal area (metres), branch, leaf, tree, species.

        Raises
        ------
        SpecError : as ``trees``.
        """
        return truth.leaves(*self._standing())

    @property
    def cylinders(self) -> dict[str, np.ndarray]:
        """Every segment of every branch as a cylinder in the world, in the terms of TreeQSM: tree, cyl_ID,
        parent_ID, extension_ID, axis_ID, branching_order, startX, ..., radius_cyl, length, volume.

        Raises
        ------
        SpecError : as ``trees``.
        """
        return truth.cylinders(*self._standing())

    def canopy(self, points: np.ndarray) -> Canopy:
        """What hemispherical pictures at points (N, 3) tell: gap fraction by zenith angle, the share of open
        sky and the effective plant area index; ``leaf_area_index`` is the true one.
        """
        from ..rng import stream
        from ..sensing.canopy import look_up

        return look_up(self.observer.caster, points, stream(self.scene.seed, "canopy"))

    def hemisphere(self, point: np.ndarray, pixels: int = 512) -> np.ndarray:
        """A hemispherical picture upwards from a point (3,), equidistant: (pixels, pixels) int8, 1 wood,
        2 leaf, 3 ground, 0 other, -1 sky, -2 beyond the horizon; first row north, first column east.
        """
        from ..sensing.canopy import hemisphere

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
        parent (S,), -1 at the foot; order (S,), 0 for the trunk; generation (S,).

        tree : its number, a value of ``trees["tree"]``.

        Raises
        ------
        SpecError : as ``trees``; there is no such tree.
        """
        return truth.skeleton(*self._standing(), tree)

    def _repr_html_(self) -> str:
        """For notebooks: what stands here."""
        if self.forest is None:
            return f"<b>{self.scene.name}</b>: the scene in Blender"
        kinds: Mapping[str, int] = {
            label: int(np.count_nonzero(self.forest.stand.species == number))
            for number, label in enumerate(self.forest.labels)
        }
        rows = "".join(
            f"<tr><td>{label}</td><td>{count:,}</td></tr>" for label, count in kinds.items()
        )
        return f"<b>{self.scene.name}</b>, seed {self.scene.seed}<table>{rows}</table>"

    def _expect(
        self, sensor: Any, kinds: tuple[type, ...], call: str, progress: Progress | None
    ) -> Any:
        if not isinstance(sensor, kinds):
            wanted = " or ".join(kind.__name__ for kind in kinds)
            raise SpecError(call, f"takes a {wanted}, not a {type(sensor).__name__}")
        return self.look(sensor, progress)

    def _standing(self) -> tuple[Forest | None, PlacedTrees]:
        """What was grown here, and trees of libraries; an error where there is neither."""
        import_blender()
        from ..blender.asset_truth import has_assets
        from ..stand.placed import NONE

        placed = self.observer.placed_trees if has_assets() else NONE
        return (None if len(placed) and self.forest is None else self._grown()), placed

    def _grown(self) -> Forest:
        if self.forest is None:
            raise SpecError("world", "was not grown here; its trees are known to build() alone")
        return self.forest


def _called(thing: Any) -> str:
    """What was handed over instead, in words."""
    shape = getattr(thing, "shape", None)
    return f"a {type(thing).__name__}" + (f" of shape {shape}" if shape is not None else "")


def import_blender() -> Any:
    """``bpy``.

    Raises
    ------
    SpecError : it is not installed; says what to do.
    """
    try:
        import bpy
    except ImportError:
        raise SpecError(
            "bpy",
            "is not installed; pip install bpy (5.2 for Python 3.13, 4.5 for 3.11), or run in Blender",
        ) from None
    return bpy
