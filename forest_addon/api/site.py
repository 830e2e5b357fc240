"""From a scene's settings to a forest in Blender, step by step: its files, its trees, what stands there.

``build`` takes the steps in a row. Whoever draws, tests or writes something in between takes a ``Site``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..formats.toml_file import read_settings
from ..spec import Scene, SpecError, with_files
from .given import enough_memory, path_of, progress_of, scene_of
from .world import World, import_blender

if TYPE_CHECKING:
    from ..sensing.choice import Choice
    from ..stand.forest import Forest
    from ..stand.inputs import Inputs

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
    path = path_of("read", path)
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
    progress_of(progress)
    with enough_memory("build", "plant fewer trees, or coarser ones"):
        site = Site.of(scene, folder)
        return site.build(site.grow(progress))


def current(scene: Scene | None = None) -> World:
    """Return what stands in Blender now, forest or not, as a world.

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


@dataclass
class Site:
    """A scene whose files are read, in Blender with the file open that it starts from; nothing has grown.

    species : what each planting plants, with its templates. inputs : rasters, lists and terrain.
    seconds : that growing and building took so far. chosen : what was left to the scene's sensors.
    """

    scene: Scene
    folder: Path
    species: list[Any]
    inputs: Inputs
    seconds: float = 0.0
    chosen: tuple[Choice, ...] = ()

    @classmethod
    def of(cls, scene: Scene, folder: str | Path = ".") -> Site:
        """Read what a scene names, and open the file that it starts from.

        Raises
        ------
        SpecError : ``bpy`` is missing; a species, a file or an object cannot be used.
        """
        bpy = import_blender()
        from ..blender.files.opening import open_for
        from ..blender.read.inputs import inputs_from_scene
        from ..growth.library.species_file import find_species, load_species
        from ..stand.files import read_inputs

        scene, folder = scene_of("build", scene), path_of("folder", folder)
        species = [load_species(find_species(p.species, folder)) for p in scene.plantings]
        open_for(scene, folder)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        return cls(
            scene, folder, species, inputs_from_scene(scene, depsgraph, read_inputs(scene, folder))
        )

    def grow(self, progress: Progress | None = None) -> Forest:
        """Plan the stand and grow its trees; Blender stays as it is.

        progress : called as progress(done, total).
        """
        from ..sensing.needs import grow_needed

        started = time.perf_counter()
        forest, self.chosen = grow_needed(self.scene, self.species, progress, self.inputs)
        self.seconds += time.perf_counter() - started
        return forest

    def build(self, forest: Forest, *, as_assets: bool = True) -> World:
        """Put a forest that grew here, and the scene's sensors, into Blender's current scene.

        as_assets : whether variants become assets, each with a picture.

        Raises
        ------
        SpecError : something that stands there is in the way.
        """
        place = import_blender().context.scene
        from ..blender.scene.forest import build as build_in_blender
        from ..blender.sensors.objects import put_sensor

        started = time.perf_counter()
        try:
            build_in_blender(place, self.scene, forest, self.inputs.terrain, as_assets=as_assets)
        except ValueError as problem:
            raise SpecError("build", str(problem)) from None
        for sensor in self.scene.sensors:
            put_sensor(place, sensor)
        self.seconds += time.perf_counter() - started
        return World(self.scene, self.folder, forest, place, self.seconds, self.chosen)
