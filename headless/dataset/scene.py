"""One scene of a dataset, within a Blender: grown, built, observed, and written into a folder with its truth.

What the files hold depends on the recipe alone; how long each stage took is told beside them. What scenes
share (species, library trees, expansions) a ``Session`` keeps from one to the next, with the same bytes as if
each were made anew.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from forest_addon.base.kept import LastAsked, digest
from forest_addon.base.rng import stream
from forest_addon.blender.files.export import empty_file, open_file
from forest_addon.blender.read.inputs import with_objects
from forest_addon.blender.scene.forest import build
from forest_addon.blender.sensors.observe import Observer
from forest_addon.formats.atomic import replacing, write_whole
from forest_addon.formats.raster_file import write_png
from forest_addon.formats.table import write_csv, write_npz
from forest_addon.formats.toml_file import write_settings
from forest_addon.growth.tree import Tree, grow
from forest_addon.results.coordinates import (
    FILE as COORDINATES,
    PROPERTY,
    Offset,
    on_the_map,
    write_note,
)
from forest_addon.results.kinds import results_of, write_finding
from forest_addon.results.points import records, write_rows
from forest_addon.results.tables import write_cylinders
from forest_addon.sensing.kinds import kind_of
from forest_addon.sensing.lidar import scan as lidar
from forest_addon.sensing.lidar.cloud import label
from forest_addon.sensing.lidar.occlusion import occlusion, on_the_line
from forest_addon.sensing.rays.caster import RayCaster
from forest_addon.sensing.rays.cells import Cells
from forest_addon.sensing.reverb.sums.fast_scattering import Expansions
from forest_addon.site import ForestSite
from forest_addon.spec import Planting, Rays, Scene, Species, Terrain
from forest_addon.stand.forest import (
    Grown,
    GrownForest,
    angle_table,
    cylinder_table,
    inventory,
    leaf_table,
    voxel_arrays,
)
from forest_addon.stand.intensity.surface import Heightmap
from forest_addon.stand.plan import LOW, labels
from forest_addon.stand.wind import sway_of

from ..progress import Stages, hushed
from .disk import finish
from .formats import EIGHT, SEGMENTS, classes_of, orders_of, write_for_instance
from .place import FILE, heights_of, place_sensors
from .plan import Recipe
from .settings import Keep

MOST_SEGMENT = 2**24 - 1  # that three bytes hold: two million trees
AT_ONCE = 200_000  # rays
MOST_KEPT = 2_000_000_000  # bytes of library trees that a process keeps
OBSERVING = "sensors"


class Session:
    """State that a process keeps from scene to scene."""

    def __init__(self) -> None:
        self.expansions = Expansions()
        self.planned: LastAsked[str, Any] = LastAsked(1)  # scans of a field in tiles
        self.served = 0  # scenes
        self._trees: LastAsked[tuple, Tree] = LastAsked(MOST_KEPT, lambda tree: tree.nbytes)
        self.clear()

    def clear(self) -> None:
        """Have Blender forget the scene; what it held would else stay until the next one is opened."""
        with hushed():
            empty_file()

    def trees_of(self, site: ForestSite, seed: int) -> Grown:
        """The trees of a library, as a site takes them: grown where they are not kept."""
        names = labels(site.scene.plantings)

        def grown(planting: int, variant: int, species: Species) -> Tree:
            key = (seed, names[planting], variant, species.detail)
            rng = stream(seed, "library", names[planting], variant)
            return self._trees.once(key, lambda: grow(species, site.species[planting][1], rng))

        return grown


def make(
    recipe: Recipe, folder: Path, root: Path, session: Session, threads: int
) -> dict[str, float]:
    """Make a scene of the dataset ``root`` in an empty folder; returns CPU seconds of each stage.

    threads : that cast rays; no result depends on their number.

    Raises
    ------
    SpecError, ValueError : settings that cannot be used together.
    OSError : a file cannot be read or written.
    """
    stages = Stages(quiet=True, clock=time.process_time)
    record: dict[str, Any] = {"points": {}, "empty": {}}
    keep, home = recipe.keep, Path(recipe.folder)
    with stages.stage("read"):
        site = ForestSite.read(recipe.settings(), home)
        if site.scene.blend:
            with hushed():
                open_file(home / site.scene.blend)
    with stages.stage("place"):
        site = _place(recipe, site, folder)
        settings = site.scene
    with stages.stage("grow"):
        grown = session.trees_of(site, recipe.library[1]) if recipe.library else None
        forest = site.grow(grown=grown)
    with stages.stage("build"):
        kept = keep.blend or keep.glb
        looks = kept or keep.preview
        ground = site.inputs.terrain
        build(bpy.context.scene, settings, forest, ground, as_assets=kept, looks=looks)
    with stages.stage("evaluate"):
        rays = Rays(engine=settings.rays.engine, threads=threads)
        observer = Observer(bpy.context.evaluated_depsgraph_get(), rays, session.expansions)
        observer.blow(sway_of(forest, settings.wind, settings.seed))
    with stages.stage("trees"):
        table = inventory(forest)
        write_note(folder / COORDINATES, settings.offset, settings.crs)
        write_csv(folder / "trees.csv", on_the_map(table, settings.offset))
        if settings.plantings:
            write_csv(folder / "leaf_angles.csv", angle_table([forest]))
        if keep.leaves:
            metres = dict.fromkeys(("centre", "length", "width", "radius"), "m")
            write_npz(
                folder / "leaves.npz",
                on_the_map(leaf_table(forest), settings.offset),
                metres | {"normal": "1", "axis": "1"},
            )
    if keep.cylinders:
        with stages.stage("cylinders"):
            write_cylinders(folder / "cylinders.csv", cylinder_table(forest), settings.offset)
    cells = None
    if keep.voxels:
        with stages.stage("voxels"):
            arrays = voxel_arrays(forest, keep.voxels)
            density = dict.fromkeys(("leaf_area_density", "wood_area_density"), "m2/m3")
            arrays["origin"] = np.array(settings.offset)
            write_npz(folder / "voxels.npz", arrays, density | {"edge": "m", "origin": "m"})
            cells = Cells.around(arrays["cell"].astype(np.int64), keep.voxels)
    for sensor in settings.sensors:
        _observe(stages, folder, record, sensor, settings, observer, keep, (cells, forest))
    if settings.plantings and not len(forest.stand):
        record["empty"]["forest"] = "no tree stands: expect more, or a larger field"
    with stages.stage("write"):
        _write_blender(settings, keep, folder, observer, forest)
        write_settings(folder / "scene.toml", settings)
        record |= {
            "scene": recipe.number,
            "split": recipe.split,
            "seed": recipe.seed,
            "base": recipe.base,
            "settings": recipe.digest,
            "varied": recipe.varied,
            "trees": len(forest.stand),
            "leaves": int(sum(table["leaves"])),
            "leaf_area_m2": float(sum(table["leaf_area_m2"])),
            "species": sorted({str(name) for name in table["species"]}),
            "engine": observer.caster.engine,
            "variants": _digests(forest),
        }
    with stages.stage("digest"):
        finish(folder, root, record)
    return stages.seconds


def _place(recipe: Recipe, site: ForestSite, folder: Path) -> ForestSite:
    """The site on its ground with its sensors placed; the files that this takes are written."""
    ground, site = recipe.ground, with_objects(site)
    if ground.relief > 0:
        field = site.scene.forest
        heights, low, size = heights_of(ground, recipe.seed, field)
        with replacing(folder / FILE) as partial:
            np.save(partial, heights)
        floor = Terrain(
            file=FILE,
            origin=tuple(map(float, low)),
            size=tuple(map(float, size)),
            roughness=field.terrain.roughness,
        )
        site = replace(
            site,
            scene=site.scene.changed(forest=field.changed(terrain=floor)),
            inputs=replace(site.inputs, terrain=Heightmap(heights, low, size, FILE)),
        ).roughened()
    stand = site.plan()
    low = [planting.species in LOW for planting in site.scene.plantings]
    stems = stand.position[~np.array([*low, False])[stand.species], :2]
    settings, files = place_sensors(site.scene, recipe.places, stems, site.ground)
    for name, text in files.items():
        write_whole(folder / name, text)
    return replace(site, scene=settings)


def _observe(
    stages: Stages,
    folder: Path,
    record: dict[str, Any],
    sensor: Any,
    settings: Scene,
    observer: Observer,
    keep: Keep,
    truth: tuple[Cells | None, GrownForest],
) -> None:
    """Run one sensor, write what it found, and what it could not see; fill the scene's record on."""
    cells, forest = truth
    with stages.stage(OBSERVING):
        job = observer.job(sensor, settings, folder)
        result = kind_of(sensor).run(job, None)
        empty = kind_of(sensor).empty(job, result)
        if empty:
            record["empty"][sensor.name] = empty
    with stages.stage("write"):
        is_cloud = results_of(sensor).is_cloud
        if not is_cloud or keep.clouds != "npz":
            write_finding(folder, sensor, result, Offset.of(settings))
        if not is_cloud:
            return
        record["points"][sensor.name] = len(result)
        if keep.clouds != "laz":
            path = folder / f"{sensor.name}-points.npz"
            write_rows(path, records(result, settings.offset), packed=False)
        if keep.for_instance:
            order = orders_of(result.returns, observer.geometry, forest)
            path = folder / f"{sensor.name}-forinstance.laz"
            write_for_instance(path, result, order, settings.plantings, settings.offset)
    with stages.stage("occlusion"):
        scan = lidar.Scan.of(job)
        if keep.occlusion and cells is not None:
            arrays = occlusion(scan, result, cells, keep.occlusion)
            arrays |= {"origin": np.array(settings.offset)}
            units = {"edge": "m", "origin": "m"}
            write_npz(folder / f"{sensor.name}-occlusion.npz", arrays, units)
        if keep.hidden:
            arrays = on_the_line(scan, observer.caster, result, keep.hidden)
            write_npz(folder / f"{sensor.name}-hidden.npz", arrays, {"distance": "m"})


def _write_blender(
    settings: Scene, keep: Keep, folder: Path, observer: Observer, forest: GrownForest
) -> None:
    """Write what Blender itself writes; only what is asked for is imported."""
    if not (keep.blend or keep.glb or keep.preview):
        return
    from forest_addon.blender.files.export import export_glb, save_blend
    from forest_addon.blender.sensors.objects import new_sensor
    from forest_addon.blender.show.preview import render, set_stage

    scene = bpy.context.scene
    if any(settings.offset):
        scene[PROPERTY] = settings.offset
    for sensor in settings.sensors:
        new_sensor(scene, sensor)
    set_stage(scene, settings.output.preview_size)
    with hushed(errors=True):
        if keep.blend:
            save_blend(folder / "forest.blend")
        if keep.glb:
            export_glb(scene, folder / "forest.glb")
        if keep.preview:
            render(scene, settings.output, folder / "preview.png", lambda done, total: None)
    if keep.preview:
        seen = observer.caster, forest, settings.plantings
        write_segments(folder / SEGMENTS, scene, *seen)


def _digests(forest: GrownForest) -> dict[str, str]:
    """A digest of every grown tree: by it a tree is known again in another scene."""
    return {
        f"{forest.labels[planting]}.{variant:03d}": digest(
            [tree.mesh.vertices, tree.mesh.triangles]
        )
        for (planting, variant), tree in sorted(forest.variants.items())
    }


def write_segments(
    path: Path,
    scene: bpy.types.Scene,
    caster: RayCaster,
    forest: GrownForest,
    plantings: Sequence[Planting],
) -> None:
    """Write segments of what the camera of a scene sees, as the colours of a PNG.

    Raises
    ------
    OSError : it cannot be written.
    """
    from forest_addon.blender.show.shaded import camera_rays

    wide, tall = scene.render.resolution_x, scene.render.resolution_y
    row, column = np.divmod(np.arange(tall * wide), wide)
    place = np.array(scene.camera.matrix_world)[:3, 3]
    ways = camera_rays(scene, column + 0.5, row + 0.5)
    segment_rows = []
    for first in range(0, len(ways), AT_ONCE):
        some = ways[first : first + AT_ONCE]
        hits = caster.cast(np.broadcast_to(place, some.shape), some)
        returns = label(caster.scene, hits, some)
        order = orders_of(returns, caster.scene, forest)
        classes, tree = classes_of(returns, order, plantings)
        segment = tree.astype(np.int64) * EIGHT + classes
        segment_rows.append(np.where(hits.found & (segment <= MOST_SEGMENT), segment, 0))
    numbers = np.concatenate(segment_rows).reshape(tall, wide)
    colours = np.stack([numbers & 255, numbers >> 8 & 255, numbers >> 16], axis=2)
    write_whole(path, write_png(colours / 255.0))
