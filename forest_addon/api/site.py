"""Steps from a scene's settings to a forest in Blender.

``build`` takes all steps at once; a program that does something in between takes a ``Site``.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Self

from ..base.places import shipped
from ..base.progress import Progress
from ..formats.toml_file import read_settings, refuse_unknown_scene
from ..site import ForestSite
from ..spec import Scene, SpecError, with_files
from ..stand.forest import GrownForest
from .given import enough_memory, import_blender, path_of, progress_of, scene_of
from .world import World


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
        from ..blender.site import with_objects

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
        from ..blender.sensors.objects import put_sensor
        from ..blender.site import build_site

        started = time.perf_counter()
        build_site(place, self, forest, as_assets=as_assets, looks=looks)
        for sensor in self.scene.sensors:
            put_sensor(place, sensor)
        seconds += time.perf_counter() - started
        return World(self.scene, self.folder, forest, place, seconds)
