"""Steps from a scene file to results: the API's, with what a folder of results needs beside them.

Every result is on disk before the next sensor starts, so an interrupted run keeps what it finished. run.json
holds everything needed to run a scene again, what it took, what came out and how it was checked.
"""

from __future__ import annotations

import dataclasses
import importlib
import json
import os
import platform
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from forest_addon import kernels
from forest_addon.api import Result, Site, World
from forest_addon.api.given import refuse_costly, refuse_large
from forest_addon.base.kept import digest
from forest_addon.base.places import version
from forest_addon.base.progress import Progress
from forest_addon.blender.files.export import (
    empty_file,
    export_glb,
    export_usd,
    open_file,
    save_blend,
)
from forest_addon.blender.jobs import Job
from forest_addon.blender.read.depsgraph import forget
from forest_addon.blender.scene.instances import planted_names
from forest_addon.blender.scene.layout import RESULTS, part
from forest_addon.blender.sensors.moving import seconds_of
from forest_addon.blender.sensors.objects import put_sensor
from forest_addon.blender.show.cloud import show_cloud
from forest_addon.blender.show.preview import (
    grow_around,
    lay_horizon,
    render,
    set_stage,
    stand_walker,
)
from forest_addon.blender.show.shaded import draw_scene
from forest_addon.blender.show.sound import give_sound
from forest_addon.formats.atomic import replacing, write_whole
from forest_addon.formats.crs import can_tell_crs
from forest_addon.formats.ownership import claim
from forest_addon.formats.table import write_csv, write_npz
from forest_addon.formats.wav import read_wav, write_wav
from forest_addon.results.coordinates import FILE, PROPERTY, Offset, on_the_map, write_note
from forest_addon.results.kind import facts
from forest_addon.results.kinds import files_of, results_of, sentence_of, write_finding
from forest_addon.results.packed import read_values, write_values
from forest_addon.results.scan_file import scene_digest
from forest_addon.results.tables import write_cylinders, write_models
from forest_addon.sensing.audit import Audit
from forest_addon.sensing.kind import Observation
from forest_addon.sensing.kinds import choose, cost_of, kind_of
from forest_addon.sensing.rays.caster import RayCaster
from forest_addon.spec import Output, Scene, Sensor, SpecError, with_files
from forest_addon.stand.compose import Inputs
from forest_addon.stand.forest import (
    GrownForest,
    angle_table,
    cylinder_table,
    leaf_count,
    leaf_table,
    met_targets,
    missed_measures,
    tree_table,
    variant_leaf_table,
)
from forest_addon.stand.intensity.surface import GroundSurface
from forest_addon.stand.measured import record
from forest_addon.stand.plan import labels

from .progress import Stages, hushed, peak_memory_mb
from .report import can_draw, page, without
from .report.page import BUDGET, turning_cloud

DRY = 1.0  # per cent of relative humidity, which no air has
LONG = 30.0  # s of a sensor, from which on its cost is said before
MOST_LEAVES = 5_000_000  # rows of leaves.npz; beyond, leaves are written once a variant
Dry = tuple[str, np.ndarray, float]  # a sound's name, samples and sampling rate


@dataclass
class Run:
    """State of a run: its settings, its folder, its forest and its findings.

    forest, ground : None in a .blend file, whose scene is sensed as it is and gets nothing put into it.
    species : names by the numbers that labels have.
    """

    settings: Scene
    out: Path
    stages: Stages
    forest: GrownForest | None
    ground: GroundSurface | None
    species: Sequence[str]
    findings: list[page.Finding] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    results: dict[str, Result] = field(default_factory=dict)  # by sensor
    trees: dict[str, Audit] = field(default_factory=dict)  # of branches and leaves
    targets: dict[str, Any] = field(default_factory=dict)  # by planting

    def path(self, name: str) -> Path:
        """Path of a file of this name; it is listed in the report."""
        self.files.append(name)
        return self.out / name


def run_scene(
    settings: Scene,
    folder: Path,
    out: Path,
    *,
    quiet: bool = False,
    verbose: bool = False,
    dry: Path | None = None,
    resume: bool = False,
    strict: bool = False,
) -> None:
    """Run a scene and write everything into a folder.

    folder : that paths in the scene file are relative to.
    dry : a WAV file that every reverb is also heard with.
    resume : take what a run that was ended had finished. strict : a warning is an error, at the end.

    Raises
    ------
    SpecError : the folder cannot be written to; a species cannot be used.
    OSError : a file could not be written; what was finished before is kept.
    DoubtfulError : an audit found an error beyond what was allowed, or ``strict`` and a warning; everything
        is written.
    """
    sound = None if dry is None else (dry.stem, *read_wav(dry))
    out.mkdir(parents=True, exist_ok=True)
    stages, wanted = Stages(quiet, verbose, strict), settings.output
    stages.say(f"{settings.name}, seed {settings.seed}")
    with stages.stage("read species and templates"), hushed():
        empty_file()
        site = Site.of(settings, folder)
    stages.tell(site.inputs.told)
    with stages.stage("grow trees") as progress:
        forest = site.grow(progress)
    refuse_large(forest, wanted.glb or bool(wanted.usd))
    trees = len(forest.stand.first(len(settings.plantings)))
    if trees < len(forest.stand) and settings.forest.undergrowth == "auto":
        stages.say(
            f"  {len(forest.stand) - trees:,} plants of undergrowth stand beside {trees:,} trees, as a "
            'scanner or a sonar looks at them; forest.undergrowth = "none" leaves them out'
        )
    run = Run(settings, out, stages, forest, site.ground, forest.labels)
    if settings.crs and not can_tell_crs():
        run.stages.warn("LAS files lack their coordinate system; pip install pyproj tells it")
    if not (settings.plantings or settings.stems or settings.sensors or settings.blend):
        stages.warn("the scene has neither trees nor sensors; add [[plantings]] and [[sensors]]")
    if settings.air.humidity < DRY:
        stages.warn(
            f"air.humidity is {settings.air.humidity:g} %, drier than air is; it is in per cent"
        )
    with stages.stage("build Blender scene"):
        grown_in = stages.seconds["grow trees"]
        looks = bool(wanted.blend or wanted.glb or wanted.usd or wanted.preview)
        world = site.build(forest, as_assets=wanted.blend, looks=looks, seconds=grown_in)
    _make_ready(run, world)
    _describe_stand(run, forest, site.inputs)
    with stages.stage("write truth"):
        _write_truth(run, forest)
    _sense(run, world, sound, resume)


def run_blend(
    blend: Path,
    out: Path,
    *,
    quiet: bool = False,
    verbose: bool = False,
    dry: Path | None = None,
    resume: bool = False,
    strict: bool = False,
) -> None:
    """Run the sensors that live in a .blend file, in its scene as it was saved, into a folder.

    Arguments are those of ``run_scene``. Nothing is grown anew, and the file is only read.

    Raises
    ------
    SpecError : the file cannot be opened, or its scene has no sensor, or nothing to sense.
    OSError, DoubtfulError : as ``run_scene``.
    """
    from forest_addon.ui import registered
    from forest_addon.ui.forest.wind import swaying
    from forest_addon.ui.sensors.run import names_unrendered
    from forest_addon.ui.settings.exchange import to_spec

    sound = None if dry is None else (dry.stem, *read_wav(dry))
    out.mkdir(parents=True, exist_ok=True)
    stages = Stages(quiet, verbose, strict)
    with registered():
        try:
            with stages.stage(f"open {blend.name}"), hushed(errors=True):
                metres = open_file(blend)
            scene = bpy.context.scene
            settings = dataclasses.replace(
                to_spec(scene),
                blend=blend.name,
                output=Output(goodness=False, leaves=False, blend=False, glb=False, preview=False),
            )
            if not settings.sensors:
                raise SpecError(
                    str(blend),
                    "has no sensor in its scene; add one in the panel, and save the file",
                )
            claim_files(settings, out, sound[0] if sound else "")
            stages.say(f"{settings.name}, seed {settings.seed}, frame {scene.frame_current}")
            if not can_draw():
                stages.say(f"  {without('Pictures are plain')}")
            if metres != 1:
                stages.warn(
                    f"{blend.name}: a unit is made {metres:g} m, as its Unit Scale says; the panel counts "
                    "it as a metre"
                )
            still: list[str] = []
            with stages.stage("read wind") as progress:
                wind = Job("wind", swaying(bpy.context, still))
                wind.finish(progress)
            for sentence in filter(None, (*still, names_unrendered(bpy.context.view_layer))):
                stages.warn(sentence)
            home = Path(bpy.path.abspath(scene.forest_sensing.folder))
            species = planted_names(scene, labels(settings.plantings))
            run = Run(settings, out, stages, None, None, species)
            world = World(settings, home, None, scene)
            _make_ready(run, world)
            _sense(run, world, sound, resume, wind.result)
        finally:
            with hushed():  # with an evaluated scene at hand, bpy 4.5 never ends
                empty_file()


def claim_files(settings: Scene, out: Path, dry: str = "") -> None:
    """Refuse, hours before they are written, files of a run that are there and are not ours.

    dry : name of the sound that every reverb is also heard with.

    Raises
    ------
    SpecError : a file would take the place of one that something else wrote; two would have one name.
    """
    names = (out / name for name in files_of(settings, dry))
    claim(*(path for path in names if not path.is_dir()))


def _make_ready(run: Run, world: World) -> None:
    """Read the scene, say what each sensor costs, and refuse those that cannot run before anything is
    written.

    Raises
    ------
    SpecError : there is nothing to sense; a sensor's file cannot be used; it needs more memory than there is.
    """
    with run.stages.stage("read evaluated scene"):
        if run.forest is None and not len(world.observer.geometry):
            raise SpecError(
                run.settings.blend, "has nothing to scan: no visible object of its scene has faces"
            )
        _ = world.observer.caster  # made now: it belongs to no sensor's time
    settings, observer = run.settings, world.observer
    for sensor in settings.sensors:
        try:
            way = observer.way(sensor, world.folder)
            chosen = choose(sensor)[0]
            kind_of(sensor).check(Observation(chosen, observer, settings, world.folder, way))
            cost = cost_of(sensor, way, observer.caster.engine, settings, len(observer.stems))
        except SpecError:
            raise
        except ValueError as problem:
            raise SpecError(sensor.name, str(problem)) from None
        if run.stages.verbose or cost.seconds > LONG:
            run.stages.say(f"  {sensor.name}: {cost}")
        refuse_costly(sensor, cost)


def _sense(run: Run, world: World, sound: Dry | None, resume: bool, sway: Any = None) -> None:
    """Run the sensors of a world, and write what is known by then.

    sway : of trees that the world did not grow itself; None: it knows.

    Raises
    ------
    DoubtfulError : as ``run_scene``.
    """
    settings, stages, out = run.settings, run.stages, run.out
    wanted = settings.output
    with world.still() as observer:
        if sway is not None:
            observer.blow(sway, seconds_of(bpy.context.scene))
        if observer.warning:
            run.stages.warn(observer.warning)
            run.findings.append(page.Finding("Warning", f"{observer.warning}.", {}))
        if run.forest is not None:
            if run.settings.accuracy.audit:
                run.trees = world.audit
            for name, audit in run.trees.items():
                stages.say_audit(name, audit)
            stand = run.findings[0]
            notes = (*stand.notes, *map(str, world.chosen))
            run.findings[0] = dataclasses.replace(
                stand, audits=tuple(run.trees.values()), notes=notes
            )
        unfinished = Unfinished(out, world, resume)
        for sensor in settings.sensors:
            with stages.stage(f"{sensor.kind} {sensor.name}") as progress:
                result = unfinished.result(sensor)
                if result is None:
                    result = world.look(sensor, progress)
                    unfinished.keep(
                        dataclasses.replace(result, way=None), sensor
                    )  # asked for again
                _take(run, world, result, sound)
        facts = facts_of(world)
    caster = observer.caster
    if run.forest is not None:
        _write_scene(run)
    run.path("run.json")
    _write_report(run, facts)
    unfinished.drop()
    if wanted.preview:
        if wanted.preview == "cycles":
            del observer, caster
            forget()  # a render needs the memory
        with stages.stage("draw preview.png") as progress, hushed():
            _write_preview(run, None if wanted.preview == "cycles" else caster, progress)
        _write_report(run, facts)
    where = f". Open {out / 'report.html'}" if wanted.report else ""
    stages.say(f"Done: {len(run.files) + wanted.report} files in {out}{where}")
    stages.end(out)


def _write_scene(run: Run) -> None:
    """Write Blender's scene as files and as a picture, as far as they are wanted."""
    scene, wanted, stages = bpy.context.scene, run.settings.output, run.stages
    if any(run.settings.offset):
        scene[PROPERTY] = run.settings.offset
    if wanted.blend or wanted.preview:
        set_stage(scene, wanted.preview_size)
    for name, is_wanted, write in (
        ("forest.blend", wanted.blend, save_blend),
        ("forest.glb", wanted.glb, partial(export_glb, scene)),
        ("forest.usdc", wanted.usd, partial(export_usd, scene)),
    ):
        if is_wanted:
            with stages.stage(f"write {name}"), hushed(errors=True):
                write(run.path(name))


def _write_preview(run: Run, caster: RayCaster | None, progress: Progress) -> None:
    """Draw the forest by the rays of a caster, or by Cycles."""
    scene, wanted, field = bpy.context.scene, run.settings.output, run.settings.forest
    middle, reach = np.array(field.origin) + np.array(field.size) / 2, max(field.size) / 2
    place, walked = (middle, reach, field.terrain.base), wanted.preview_from == "walker"
    if caster is None:
        lay_horizon(scene, *place)
    if walked:
        assert run.forest is not None  # only a forest that was grown is drawn
        assert run.ground is not None
        stems, tall = run.forest.stand.position[:, :2], run.forest.heights()
        way = stand_walker(scene, stems, tall, middle, reach, run.ground.height)
        if caster is None:
            grow_around(scene, *way, run.ground.height)
    path = run.path("preview.png")
    if caster is None:
        render(scene, wanted, path, progress, 1.3 if walked else 0.35)
    else:
        draw_scene(scene, caster, path, *place, progress)


def _write_report(run: Run, facts: dict[str, Any]) -> None:
    """Write run.json, and report.html where it is wanted. facts : of the evaluated scene (``facts_of``)."""
    record = {
        **made_with(run.settings),
        **facts,
        "stage_seconds": run.stages.seconds,
        "warnings": run.stages.warnings,
        "peak_memory_mb": peak_memory_mb(),
        "results": {finding.title: finding.facts for finding in run.findings},
        "trees": {name: {"audit": audit.record()} for name, audit in run.trees.items()},
        "targets": run.targets,
        "sensors": {name: result.record() for name, result in run.results.items()},
        "files": run.files,
    }
    write_whole(run.out / "run.json", json.dumps(record, indent=2, default=str) + "\n")
    if run.settings.output.report:
        page.write(
            run.out / "report.html", run.settings, run.findings, run.stages.seconds, run.files
        )


def _take(run: Run, world: World, result: Result, sound: Dry | None) -> None:
    """Write a result, show it in Blender's scene where somebody will see that, and say what it is."""
    sensor, found, scene = result.sensor, result.found, bpy.context.scene
    files = write_finding(run.out, sensor, found, Offset.of(run.settings))
    run.files += [file.name for file in files]
    wanted, record = run.settings.output, results_of(sensor)
    seen = run.forest is not None and (wanted.blend or wanted.preview == "cycles")
    if record.is_response and record.sound is not None:
        heard, rate = record.sound(sensor, found)
        if sound is not None and record.wet is not None:
            name, samples, dry_rate = sound
            heard, rate = record.wet(sensor, found, samples, dry_rate)
            write_wav(run.path(f"{sensor.name}-{name}.wav"), heard, rate)
        if seen:
            with hushed():
                give_sound(put_sensor(scene, sensor), sensor.name, heard, rate)
    if record.is_cloud and seen:
        show_cloud(part(scene, RESULTS), sensor.name, found)
    finding = _describe(run, world, result)
    for warning in finding.warnings:
        run.stages.warn(warning.removesuffix("."))
    if result.audit is not None:
        run.stages.say_audit(sensor.name, result.audit)
    checked = "" if result.audit is None else f", {result.audit.brief}"
    run.stages.found = f"{sentence_of(sensor, found)}{checked}"
    run.findings.append(finding)
    run.results[sensor.name] = dataclasses.replace(result, found=None)  # on disk: not kept


def _describe(run: Run, world: World, result: Result) -> page.Finding:
    """Draw a result, where pictures are asked for, and say what it is."""
    sensor, found, picture = result.sensor, result.found, None
    if run.settings.output.pictures:  # what draws is imported where it is asked for: a second
        path = run.out / f"{sensor.name}.png"
        picture = page.draw_result(sensor, found, world.observer, path)
        if picture is not None:
            run.files.append(path.name)
    record = results_of(sensor)
    figures = record.figures(sensor, found, world.observer)
    audits = () if result.audit is None else (result.audit,)
    heard = {name for each in run.findings for name in each.sounds}
    cloud = record.points(sensor, found)
    turned = ""
    if run.settings.output.report and cloud is not None:
        turned = turning_cloud(cloud, run.species, BUDGET // len(run.settings.sensors))
    warnings = (f"{warning}." for warning in result.warnings)
    return page.Finding(
        record.title(sensor),
        record.story(sensor, found),
        facts(figures),
        (*record.notes(sensor, found), *map(str, result.chosen)),
        picture,
        audits,
        figure=turned,
        warnings=(*record.doubts(sensor, found), *warnings),
        octaves={each.name: each.by_octave for each in figures if each.name and each.by_octave},
        sounds=tuple(name for name in run.files if name.endswith(".wav") and name not in heard),
    )


def _describe_stand(run: Run, forest: GrownForest, inputs: Inputs) -> None:
    """Draw the map of the stand, and compare it with others of the same settings."""
    settings, wanted = run.settings, run.settings.output
    own = len(settings.plantings)
    stand = forest.stand.first(own)
    drawn = None
    if wanted.pictures:
        with run.stages.stage("draw the stand"):
            path = run.path("stand.png")
            drawn = page.draw_stand(stand, forest.labels[:own], settings, inputs, path)
    run.findings.append(page.forest_finding(settings, forest, drawn))
    if wanted.pictures and not can_draw():
        sentence = without("Pictures are plain and the curve of L(r) - r is left out")
        run.stages.say(f"  {sentence}")
        notes = (*run.findings[0].notes, page.colours_in_words(run.species))
        run.findings[0] = dataclasses.replace(run.findings[0], notes=notes)
        run.findings.append(page.Finding("Pictures", sentence, {}))
    for note in forest.notes:
        run.stages.warn(note)
    for note in missed_measures(forest, settings, inputs):
        run.stages.warn(note)
    met = met_targets(forest)
    told = page.targets_finding(met)
    run.findings += [told] if told else []
    run.targets = {one.label: record(one) for one in met}
    if not wanted.goodness:
        return
    from forest_addon.stand.statistics.law import examine, law_of_scene, poisson_trees, window_of

    with run.stages.stage("test where trees stand"):
        window, law = window_of(settings.forest), law_of_scene(settings, inputs)
        goodness = examine(poisson_trees(settings, stand), window, law)
        if goodness is None:  # too few trees
            return
        picture = None
        if wanted.pictures and can_draw():
            from forest_addon.drawing.figures import save_figure
            from forest_addon.drawing.stands import draw_goodness

            picture = save_figure(draw_goodness(goodness, window), run.path("goodness.png"))
        run.findings.append(page.goodness_finding(goodness, picture))


def _write_truth(run: Run, forest: GrownForest) -> None:
    offset, crs = run.settings.offset, run.settings.crs
    if write_note(run.out / FILE, offset, crs):
        run.files.append(FILE)
    write_csv(run.path("trees.csv"), on_the_map(tree_table(forest), offset))
    write_csv(run.path("leaf_angles.csv"), angle_table([forest]))
    rows = cylinder_table(forest) if run.settings.output.qsm else {}
    if run.settings.output.qsm and not rows:
        run.stages.warn("output.qsm has no effect: no tree grows in the scene")
    if rows:
        write_cylinders(run.path("cylinders.csv"), rows, offset)
        for path in write_models(run.out / "qsm", rows, offset):
            run.files.append(str(path.relative_to(run.out)))
    if not run.settings.output.leaves:
        return
    metres = dict.fromkeys(("centre", "length", "width", "radius"), "m")
    many = leaf_count(forest) > MOST_LEAVES
    name, table = ("variant_leaves", variant_leaf_table) if many else ("leaves", leaf_table)
    rows = table(forest) if many else on_the_map(table(forest), offset)
    write_npz(run.path(f"{name}.npz"), rows, metres | {"normal": "1", "axis": "1"})


def facts_of(world: World) -> dict[str, Any]:
    """Entry of the evaluated scene in run.json: its size, the engine of its rays, what was chosen
    for it."""
    observer = world.observer
    geometry = observer.geometry
    unique = sum(len(mesh.triangles) for mesh in geometry.meshes)
    shown = sum(len(geometry.meshes[m].triangles) for m in geometry.mesh_index)
    facts: dict[str, Any] = {
        "ray_engine": observer.caster.engine,
        "triangles": {"unique": unique, "instanced": shown},
        "instances": len(geometry),
    }
    return facts | ({"chosen": [c.record() for c in world.chosen]} if world.chosen else {})


def made_with(settings: Scene) -> dict[str, Any]:
    """Versions, machine, seed and settings that a run's results come from."""
    import scipy

    return {
        "versions": {
            "forest_sensing": version(),
            "blender": bpy.app.version_string,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "kernels": kernels.engine(),
        },
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "seed": settings.seed,
        "settings": dataclasses.asdict(settings),
    }


ROOM = (__package__ or "").removesuffix("headless") + "forest_addon."


def record_named(name: str) -> type:
    """Return the record of a name with its module, MODULE:NAME.

    Raises
    ------
    ValueError : it is no dataclass of the add-on.
    """
    module, _, inside = name.partition(":")
    kind = attrgetter(inside)(importlib.import_module(module)) if module.startswith(ROOM) else None
    if not (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
        raise ValueError(f"{name} is of no result")
    return kind


UNFINISHED = ".unfinished"  # the folder of a run that holds them
KEPT = re.compile(r"[\w-]+-[0-9a-f]{24,32}\.npz")  # a sensor's name, and what decides its result


class Unfinished:
    """Results that an ended run of the same scene left in a folder, and those that this one will.

    They lie there until the run is done, one file a sensor, so that ``--resume`` need not take them again. A
    file is named by all that decides its result: the scene's settings, the evaluated scene, files that the
    sensor names, versions. Records in it (``results.packed``) are dataclasses of the add-on, named by module
    and class; nothing else is looked up.
    """

    def __init__(self, out: Path, world: World, resume: bool) -> None:
        self._folder = out / UNFINISHED
        self._world = world
        self._scene = scene_digest(world.observer.geometry)
        if not resume:
            self.drop()
        left = {file.name for file in self._folder.glob("*.npz")}
        usable = {self._file(sensor).name for sensor in world.scene.sensors}
        if left and not left & usable:
            raise SpecError(
                "--resume", f"what {out} keeps is of other settings or files; run again without it"
            )

    def result(self, sensor: Sensor) -> Result | None:
        """A sensor's result, if it was finished; None too where its file is broken."""
        file = self._file(sensor)
        if not file.is_file():
            return None
        try:
            with open(file, "rb") as stream:
                (found,) = read_values(stream, record_named)
        except Exception:  # whatever lies there: the sensor looks again
            return None
        return found if isinstance(found, Result) else None

    def keep(self, result: Result, sensor: Sensor) -> None:
        """Keep a result until the run is done."""
        self._folder.mkdir(exist_ok=True)
        with replacing(self._file(sensor), ours=True) as partial, open(partial, "wb") as stream:
            write_values(stream, [result], lambda kind: f"{kind.__module__}:{kind.__qualname__}")

    def drop(self) -> None:
        """Forget all of it: the run is done, or begins anew."""
        for file in self._folder.glob("*.npz"):
            if KEPT.fullmatch(file.name):
                file.unlink()
        with suppress(OSError):  # it is not there, or something of the user's is in it
            self._folder.rmdir()

    def _file(self, sensor: Sensor) -> Path:
        scene = self._world.scene.changed(sensors=())
        said = [self._scene, version(), *map(dataclasses.asdict, (scene, sensor))]

        def read(name: str) -> str:
            path = self._world.folder / name
            said.append(path.read_bytes() if path.is_file() else name)
            return name

        with_files(sensor, read)
        return self._folder / f"{sensor.name}-{digest(said)}.npz"
