"""From a scene file to results: grow, build, read the evaluated scene, look, write.

Every result is on disk before the next sensor starts, so an interrupted run keeps what it finished.
"""

from __future__ import annotations

import dataclasses
import json
import os
import platform
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from forest_addon.blender.cloud import show_cloud
from forest_addon.blender.export import export_glb, save_blend
from forest_addon.blender.forest import build
from forest_addon.blender.horizon import lay_horizon
from forest_addon.blender.inputs import inputs_from_scene
from forest_addon.blender.layout import RESULTS, part
from forest_addon.blender.observe import Observer
from forest_addon.blender.opening import empty_file, open_file
from forest_addon.blender.preview import render, set_stage
from forest_addon.blender.sensors import file_name, kind_of, new_sensor, place, sensors_of
from forest_addon.blender.sound import give_sound
from forest_addon.formats.atomic import replacing
from forest_addon.formats.findings import Finding as SensorFinding
from forest_addon.formats.findings import write_finding
from forest_addon.formats.npz import write_npz
from forest_addon.formats.species_file import find_species, load_species
from forest_addon.formats.stand_files import read_inputs
from forest_addon.formats.table import write_csv
from forest_addon.formats.wav import read_wav, write_wav
from forest_addon.rng import stream
from forest_addon.sensing.audit import Audit
from forest_addon.sensing.choice import Choice, choose
from forest_addon.sensing.lidar.cloud import Cloud
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.reverb.auralise import auralise
from forest_addon.sensing.reverb.response import ImpulseResponse, channels_of
from forest_addon.sensing.trees_audit import audit_trees
from forest_addon.spec import Scene, Sensor, SpecError
from forest_addon.stand.forest import (
    Forest,
    angle_table,
    grow_forest,
    leaf_count,
    leaf_table,
    tree_table,
    variant_leaf_table,
)
from forest_addon.stand.inputs import Inputs

from .command import DoubtfulError
from .progress import Stages, hushed
from .report import findings, page

MOST_LEAVES = 5_000_000  # rows of leaves.npz; beyond, leaves are written once a variant


@dataclass
class Run:
    """What a run has made so far: its settings, its folder, its forest and its findings."""

    settings: Scene
    out: Path
    stages: Stages
    forest: Forest
    findings: list[page.Finding] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    audits: dict[str, Audit] = field(default_factory=dict)  # by sensor
    chosen: dict[str, tuple[Choice, ...]] = field(default_factory=dict)  # by sensor
    trees: dict[str, Audit] = field(default_factory=dict)  # of branches and leaves

    def path(self, name: str) -> Path:
        """Where a file of this name goes; it is listed in the report."""
        self.files.append(name)
        return self.out / name

    def write(self, sensor: Sensor, found: SensorFinding) -> None:
        """Write a sensor's result; its files are listed in the report."""
        files = write_finding(self.out, sensor, found, self.settings.offset)
        self.files += [file.name for file in files]


def run_scene(
    settings: Scene, folder: Path, out: Path, *, quiet: bool = False, dry: Path | None = None
) -> None:
    """Run a scene and write everything into a folder.

    folder : that paths in the scene file are relative to.
    dry : a WAV file that every reverb is also heard with.

    Raises
    ------
    SpecError : the folder cannot be written to; a species cannot be used.
    OSError : a file could not be written; what was finished before is kept.
    DoubtfulError : an audit found an error beyond what was allowed; everything is written.
    """
    sound = None if dry is None else read_wav(dry)
    _make_writable(out)
    stages = Stages(quiet)
    stages.say(f"{settings.name}, seed {settings.seed}")
    with stages.stage("read species and templates"):
        species = [_load(planting.species, folder) for planting in settings.plantings]
        _open_blender(settings, folder)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        inputs = inputs_from_scene(settings, depsgraph, read_inputs(settings, folder))
    with stages.stage("grow trees") as progress:
        forest = grow_forest(settings, species, progress, inputs)
    run = Run(settings, out, stages, forest)
    drawn = None
    if settings.output.pictures:
        with stages.stage("draw the stand"):
            drawn = _draw_stand(run, inputs)
    run.findings.append(findings.forest_finding(settings, forest, drawn))
    if settings.output.goodness:
        with stages.stage("test where trees stand"):
            _test_stand(run, inputs)

    scene = bpy.context.scene
    with stages.stage("build Blender scene"):
        build(scene, settings, forest, inputs.terrain, as_assets=settings.output.blend)
        things = {sensor.name: _stand(scene, sensor) for sensor in settings.sensors}
    with stages.stage("write truth"):
        _write_truth(run)
    with stages.stage("read evaluated scene"):
        observer = Observer(bpy.context.evaluated_depsgraph_get(), settings.rays)
        engine = observer.caster.engine
    if observer.warning:
        stages.say(f"  Warning: {observer.warning}")
        run.findings.append(page.Finding("Warning", f"{observer.warning}.", {}))
    _audit_trees(run, observer.geometry)
    for given in settings.sensors:
        sensor, chosen = choose(given)
        with stages.stage(f"{sensor.kind} {sensor.name}") as progress:
            way = observer.way(sensor, folder)
            started = time.perf_counter()
            found = observer.observe(sensor, settings, progress, folder, way)
            took = time.perf_counter() - started
            run.write(sensor, found)
            if isinstance(found, ImpulseResponse):
                _let_hear(run, sensor.name, things[sensor.name], found, dry, sound)
            if isinstance(found, Cloud):
                show_cloud(part(scene, RESULTS), sensor.name, found)
            finding = _describe(run, sensor, found, observer)
            audit = observer.audit(sensor, settings, found, took, folder, way)
            audits = () if audit is None else (audit,)
            warnings = observer.warnings(sensor, way)
            for warning in warnings:
                stages.say(f"  Warning: {warning}")
            notes = (*finding.notes, *map(str, chosen), *(f"{w}." for w in warnings))
            run.findings.append(dataclasses.replace(finding, audits=audits, notes=notes))
            run.chosen[sensor.name] = chosen
            if audit is not None:
                run.audits[sensor.name] = audit
                stages.say(f"  {audit}")

    set_stage(scene, settings.output.preview_size)
    if settings.output.blend:
        with stages.stage("write forest.blend"), hushed(errors=True):
            save_blend(run.path("forest.blend"))
    if settings.output.glb:
        with stages.stage("write forest.glb"), hushed(errors=True):
            export_glb(scene, run.path("forest.glb"))
    if settings.output.preview:
        with stages.stage("render preview.png") as progress, hushed():
            field = settings.forest
            middle = np.array(field.origin) + np.array(field.size) / 2
            reach = max(field.size) / 2
            lay_horizon(scene, middle, reach, field.terrain.base)
            render(scene, settings.output, run.path("preview.png"), progress)
    _write_record(run, observer.geometry, engine)
    if settings.output.report:
        with stages.stage("write report.html"):
            page.write(run.out / "report.html", settings, run.findings, stages.seconds, run.files)
        stages.say(f"Done: {len(run.files) + 1} files in {out}. Open {out / 'report.html'}")
    else:
        stages.say(f"Done: {len(run.files)} files in {out}")
    audited = (*run.trees.items(), *run.audits.items())
    doubtful = [f"{name}: {audit}" for name, audit in audited if not audit.kept]
    if doubtful:
        raise DoubtfulError("; ".join(doubtful) + f"; the results are kept in {out}")


def _open_blender(settings: Scene, folder: Path) -> None:
    """Start from the scene's .blend file, or from nothing."""
    with hushed():
        empty_file()
        if not settings.blend:
            return
        path = folder / settings.blend
        try:
            open_file(path)
        except SpecError as problem:
            raise SpecError("blend", f"{path} {problem.problem}") from None


def _stand(scene: bpy.types.Scene, sensor: Sensor) -> bpy.types.Object:
    """The object of a sensor: the one of its name in the file that the scene started from, or a new one."""
    for thing in sensors_of(scene):
        if file_name(thing.name) == sensor.name and kind_of(thing) == sensor.kind:
            place(thing, sensor)
            return thing
    return new_sensor(scene, sensor)


def _load(name: str, folder: Path) -> Any:
    return load_species(find_species(name, folder))


def _make_writable(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
        with replacing(out / ".writable") as partial:
            partial.write_text("x")
        (out / ".writable").unlink()
    except OSError as problem:
        raise SpecError(
            f"--out {out}", f"cannot be written to ({problem.strerror}); choose another folder"
        ) from None


def _draw_stand(run: Run, inputs: Inputs) -> Path:
    """Draw the map of the stand; as all that draws, imported where it is asked for (matplotlib: a second)."""
    from .report.stand import draw_stand

    stand, labels = run.forest.stand, run.forest.labels
    return draw_stand(stand, labels, run.settings, inputs, run.path("stand.png"))


def _test_stand(run: Run, inputs: Inputs) -> None:
    """Compare the stand with others of the same settings, where it has enough trees."""
    from forest_addon.stand.statistics import goodness

    window = goodness.window_of(run.settings.forest)
    trees = goodness.poisson_trees(run.settings, run.forest.stand)
    found = goodness.examine(trees, window, goodness.law_of_scene(run.settings, inputs))
    if found is None:
        return
    picture = None
    if run.settings.output.pictures:
        from .report.site import draw_goodness

        picture = draw_goodness(found, window, run.path("goodness.png"))
    run.findings.append(findings.goodness_finding(found, picture))


def _audit_trees(run: Run, geometry: SceneGeometry) -> None:
    """Hold branches and leaves against their truth; the forest's finding says what came out."""
    share, seed = run.settings.accuracy.audit, run.settings.seed
    if share == 0:
        return
    took = sum(run.stages.seconds[name] for name in ("grow trees", "build Blender scene"))
    rng = stream(seed, "audit", "trees")
    run.trees.update(audit_trees(run.forest, geometry, rng, took, share))
    for audit in run.trees.values():
        run.stages.say(f"  {audit}")
    of_forest = dataclasses.replace(run.findings[0], audits=tuple(run.trees.values()))
    run.findings[0] = of_forest


def _write_truth(run: Run) -> None:
    write_csv(run.path("trees.csv"), tree_table(run.forest))
    write_csv(run.path("leaf_angles.csv"), angle_table(run.forest))
    if not run.settings.output.leaves:
        return
    metres = dict.fromkeys(("centre", "length", "width", "radius"), "m")
    many = leaf_count(run.forest) > MOST_LEAVES
    name, table = ("variant_leaves", variant_leaf_table) if many else ("leaves", leaf_table)
    write_npz(run.path(f"{name}.npz"), table(run.forest), metres | {"normal": "1", "axis": "1"})


def _let_hear(
    run: Run,
    name: str,
    speaker: bpy.types.Object,
    found: ImpulseResponse,
    dry: Path | None,
    sound: tuple[np.ndarray, float] | None,
) -> None:
    """Put what is heard on a Speaker: the dry sound in the forest, which is also written, or a click."""
    heard = channels_of(found)
    if dry is not None and sound is not None:
        heard = auralise(heard, sound[0], found.sample_rate, sound[1])
        write_wav(run.path(f"{name}-{dry.stem}.wav"), heard, found.sample_rate)
    with hushed():
        give_sound(speaker, name, heard, found.sample_rate)


def _describe(run: Run, sensor: Any, found: SensorFinding, observer: Observer) -> page.Finding:
    """Draw a result, where pictures are asked for, and say what it is."""
    picture = None
    if run.settings.output.pictures:
        from .report.result import draw_result

        path = run.path(f"{sensor.name}.png")
        picture = draw_result(sensor, found, observer, run.forest, path)
    if isinstance(found, ImpulseResponse):
        return findings.reverb_finding(sensor, found, observer.trunks(sensor), picture)
    return findings.finding_of(sensor, found, picture)


def _write_record(run: Run, geometry: SceneGeometry, engine: str) -> None:
    """run.json: everything needed to run it again, and what it took."""
    import scipy

    unique = sum(len(mesh.triangles) for mesh in geometry.meshes)
    shown = sum(len(geometry.meshes[m].triangles) for m in geometry.mesh_index)
    record = {
        "versions": {
            "forest_sensing": page.version(),
            "blender": bpy.app.version_string,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "seed": run.settings.seed,
        "ray_engine": engine,
        "settings": dataclasses.asdict(run.settings),
        "triangles": {"unique": unique, "instanced": shown},
        "instances": len(geometry),
        "stage_seconds": run.stages.seconds,
        "peak_memory_mb": _peak_memory_mb(),
        "results": {finding.title: finding.facts for finding in run.findings},
        "trees": {name: {"audit": audit.record()} for name, audit in run.trees.items()},
        "sensors": {name: _record_of(run, name) for name in run.chosen},
        "files": run.files,
    }
    with replacing(run.path("run.json")) as partial:
        partial.write_text(json.dumps(record, indent=2, default=str) + "\n", encoding="utf-8")


def _record_of(run: Run, name: str) -> dict[str, Any]:
    """What was checked of a sensor, and what was chosen for it."""
    record: dict[str, Any] = {}
    if name in run.audits:
        record["audit"] = run.audits[name].record()
    if run.chosen[name]:
        record["chosen"] = [choice.record() for choice in run.chosen[name]]
    return record


def _peak_memory_mb() -> float | None:
    """The largest memory this process had, None where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024**2 if sys.platform == "darwin" else 1024)
