"""Display of a result: points in the scene, figures in the panel, a file.

The panel keeps the last result of each kind, the newest first.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...base.labels import Labels
from ...blender.scene.layout import RESULTS, part
from ...blender.show.cloud import (
    Entry,
    end_with_ground,
    legend_of,
    legend_of_heard,
    note_scan,
    show_cloud,
    show_heard,
)
from ...blender.show.sound import give_sound
from ...results.coordinates import NO_OFFSET, Offset
from ...results.figures import Figure, of_forest
from ...results.kind import Finding
from ...results.kinds import figures_of, results_of, sentence_of, write_finding
from ...results.labels import labels_by_material, labels_by_object, labels_by_species
from ...sensing.audit import Audit
from ...sensing.lidar.cloud import Cloud
from ...sensing.rays.geometry import SceneGeometry
from ...spec import Scene, Sensor
from ...stand.forest import GrownForest
from ..settings.exchange import forestless
from ..shell.words import Kept, keep, label_kept, say, say_kept
from . import frames, images, shown
from .kept import pack

# What says nothing where no forest was asked for and none of it was met.
OF_TREES = {
    *("Trees Seen", "Wood", "Leaves", "Ground", "Leaves Heard", "Wood Heard", "Behind Wood"),
    *("Trunks Heard", "Beyond Field", "Too Late"),
}

Words = dict[str, str]
Names = tuple[Sequence[str], Sequence[str]]


def keep_forest(
    context: bpy.types.Context, settings: Scene, forest: GrownForest, seconds: float
) -> str:
    """Note what stands now; results of the forest before stay, marked. Returns the figures in a sentence."""
    props = context.scene.forest_sensing
    for result in props.results:
        result.stale = result.kind != "forest"
    figures = in_words(of_forest(forest))
    for number, planting in enumerate(props.plantings):
        planting.standing = int(np.count_nonzero(forest.stand.species == number))
    _note(props, "forest", "forest", settings.name, figures | {keep("Time"): f"{seconds:.1f} s"})
    trees, leaves = figures["Trees"], figures["Leaves"]
    if len(forest.stand) == 1:
        return say("1 tree with {leaves} leaves in {seconds:.1f} s", leaves=leaves, seconds=seconds)
    return say(
        "{trees} trees with {leaves} leaves in {seconds:.1f} s",
        trees=trees,
        leaves=leaves,
        seconds=seconds,
    )


def keep_finding(
    context: bpy.types.Context,
    thing: bpy.types.Object,
    sensor: Sensor,
    found: Finding,
    seconds: float,
    offset: Offset = NO_OFFSET,
    names: Names = ((), ()),
    frame: int | None = None,
    geometry: SceneGeometry | None = None,
) -> str:
    """Show, note and draw what a sensor found. Returns the key figures in a sentence.

    offset : of the scene; what is exported later is moved by it. names : of objects and of species, by
    their numbers. frame : that it is kept for, beside what was kept for other frames; None: it alone.
    geometry : of the scene, which says what points are of; without it they are exported by class alone.
    """
    props = context.scene.forest_sensing
    record = results_of(sensor)
    figured, sentence = figures_of(sensor, found), sentence_of(sensor, found)
    if forestless(props):
        figured = [each for each in figured if each.short not in OF_TREES or _is_some(each)]
    figures = in_words(figured)
    plot = record.plot(sensor, found)
    title = f"Forest {sensor.name}" + ("" if frame is None else f" {frame:04d}")
    picture = images.show(title, plot) if plot else None
    sound = None
    if record.is_response and record.sound is not None and thing.type == "SPEAKER":
        sound = give_sound(thing, sensor.name, *record.sound(sensor, found))
    earlier = props.results.get(thing.name)
    left = frames.blocks_of(earlier) if earlier is not None else []
    result = _note(  # what needs disk space is done
        props, thing.name, sensor.kind, thing.name, figures | {keep("Time"): f"{seconds:.1f} s"}
    )
    result.summary.value = sentence
    result.summary.made_of = sentence.made_of if isinstance(sentence, Kept) else ""
    result.picture, result.caption = picture, label_kept(plot.caption) if plot else ""
    cloud, marks = record.points(sensor, found), record.marks(found)
    if cloud is None:
        result.found = pack(sensor, found, offset)
    else:
        labels = _labels(cloud, geometry, names[1]) if geometry is not None else {}
        points = show_cloud(part(context.scene, RESULTS), sensor.name, cloud)
        note_scan(points.data, cloud, offset, offset.crs, labels)
        result.shown = points.name
        _explain(result, legend_of(cloud, *names))
    if marks is not None:
        points = show_heard(part(context.scene, RESULTS), sensor.name, marks)
        result.shown = points.name
        _explain(result, legend_of_heard(marks))
    if result.shown:
        shown.show_result(context, result)
        _note_beyond(result, end_with_ground(points, context.scene))
    if frame is not None:
        frames.hold(result, frame, sound)
    else:
        result.frames.clear()
    frames.let_go(left)
    return say("{found} in {seconds:.1f} s", found=say_kept(sentence), seconds=seconds)


def save_finding(
    context: bpy.types.Context,
    folder: Path,
    name: str,
    sensor: Sensor,
    found: Any,
    offset: Offset,
) -> Path:
    """Write a result to a folder and note the file in the panel, at the result of this name.

    Raises
    ------
    OSError : it cannot be written.
    """
    path = write_finding(folder, sensor, found, offset)[0]
    context.scene.forest_sensing.results[name].file = str(path)
    return path


def in_words(figures: list[Figure]) -> Words:
    """Return what the panel shows of figures; kept in English, said in the language when it is read."""
    return {
        keep(each.short): keep(each.pattern, **each.values) if each.pattern else each.text
        for each in figures
        if each.short
    }


def _is_some(figure: Figure) -> bool:
    """Return whether a count or a share is more than none."""
    return any(digit in "123456789" for digit in figure.text)


def note_audit(context: bpy.types.Context, name: str, audit: Audit) -> None:
    """Add to a result how many of its values were checked, and how far off they are."""
    off, allowed = (plain(value, audit.unit) for value in (audit.error, audit.allowed))
    words = keep("off by {off}", off=off)
    if not audit.kept:
        words = keep("{off} off: MORE than {allowed}", off=off, allowed=allowed)
    result = context.scene.forest_sensing.results[name]
    for title, value in ((keep("Checked"), f"{audit.checked:,}"), (keep("Audit"), words)):
        figure = result.figures.add()
        figure.name, figure.value = title, value
        figure.made_of = value.made_of if isinstance(value, Kept) else ""
    frames.tell_again(result, context.scene.frame_current)


def plain(value: float, unit: str) -> str:
    """An error as one says it: metres in parts of a millimetre, a share in percent."""
    if not np.isfinite(value):
        return f"{value} {unit}".strip()
    if unit == "m":
        return "< 0.001 mm" if value < 1e-6 else keep("{size:,.3f} mm", size=1e3 * value)
    return "< 0.0001 %" if value < 1e-6 else f"{100.0 * value:,.4f} %"


def note_estimate(context: bpy.types.Context, name: str, took: float, estimated: float) -> None:
    """Say beside the time that a run took what was estimated before."""
    words = keep("{took:.1f} s, {estimated:.1f} s estimated", took=took, estimated=estimated)
    result = context.scene.forest_sensing.results[name]
    figure = result.figures.get("Time")
    if figure is not None:
        figure.value, figure.made_of = words, words.made_of
        frames.tell_again(result, context.scene.frame_current)


def _labels(cloud: Cloud, geometry: SceneGeometry, species: Sequence[str]) -> dict[str, Labels]:
    """Return what the points of a cloud can be labelled by when they are exported."""
    return {
        "OBJECT": labels_by_object(cloud.returns, geometry),
        "SPECIES": labels_by_species(cloud.returns, species),
        "MATERIAL": labels_by_material(cloud.returns, geometry),
    }


def _note_beyond(result: Any, count: int) -> None:
    """Say of points that views leave out how many they are."""
    if not count:
        return
    figure, words = result.figures.add(), keep("{count:,} not shown", count=count)
    figure.name, figure.value, figure.made_of = keep("Far Points"), words, words.made_of


def _explain(result: Any, legend: Iterable[Entry]) -> None:
    """Note what the colours of a result's points mean."""
    for entry in legend:
        item = result.legend.add()
        item.name, item.choice, item.colour = entry.name, entry.choice, entry.colour


def _note(props: Any, name: str, kind: str, title: str, figures: Words) -> Any:
    """The entry of this name, at the top of the panel; of an earlier one its frames stay."""
    for other in props.results:
        other.opened = False
    if name not in props.results:
        props.results.add().name = name
    props.results.move(props.results.find(name), 0)
    result = props.results[0]
    for field in set(result.bl_rna.properties.keys()) - {"rna_type", "name", "frames"}:
        result.property_unset(field)
    result.name, result.kind, result.title = name, kind, title
    for label, value in figures.items():
        figure = result.figures.add()
        figure.name, figure.value = label, value
        figure.made_of = value.made_of if isinstance(value, Kept) else ""
    return result
