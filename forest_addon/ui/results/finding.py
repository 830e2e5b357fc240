"""Findings of sensors as results: points in the scene, figures in the panel, bytes in the file.

Echoes and impulse responses are kept as the bytes of an NPZ: arrays, and how settings and records are made of
them as JSON. Clouds need none: the mesh that shows one holds all of it (``show.cloud``).
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import bpy
import numpy as np

from ...blender.scene.layout import RESULTS, part
from ...blender.show.cloud import (
    end_with_ground,
    legend_of,
    legend_of_heard,
    note_scan,
    show_cloud,
    show_heard,
)
from ...blender.show.sound import give_sound
from ...results.coordinates import NO_OFFSET, Offset
from ...results.kind import Figure, Finding, of_forest
from ...results.kinds import figures_of, results_of, sentence_of
from ...results.packed import read_values, write_values
from ...results.points import labels_of
from ...sensing.audit import Audit
from ...sensing.rays.geometry import SceneGeometry
from ...spec import Scene, Sensor
from ...spec.base import Settings
from ...stand.forest import GrownForest
from ..settings.exchange import forestless
from ..shell.views import redraw_panels
from ..shell.words import Kept, keep, label_kept, say, say_kept
from . import images
from .keep import (
    SENSOR_KEY,
    blocks_of,
    hold_frame,
    let_go,
    said_of,
    set_figures,
    set_legend,
    show_result,
)

MOST = 2**30  # bytes of a result; Blender's files hold no text of twice as many
# What no file that is exported needs: working tables of a ping, and what follows from its responses.
LEFT_OUT = {"groups", "list_heard", "envelopes", "called"}

Unpacked = tuple[Sensor, Finding, Offset]


def pack(sensor: Sensor, found: Finding, offset: Offset) -> bytes:
    """Return a sensor's settings, what it found and the scene's offset; no bytes of more than ``MOST``."""
    file = io.BytesIO()
    write_values(file, (sensor, found, offset), left_out=LEFT_OUT, most=MOST)
    return file.getvalue()


def unpack(data: bytes) -> Unpacked:
    """Settings, finding and offset that were packed; of an echo without what is ``LEFT_OUT``."""
    sensor, found, offset = read_values(io.BytesIO(data), _records().__getitem__)
    return sensor, found, offset


def _records() -> dict[str, Callable[..., Any]]:
    """Makers of the records of a result, by name: no other is ever made of a file's bytes."""
    from ...sensing.reverb.channels import ImpulseResponse
    from ...sensing.reverb.forest.clutter import Clutter
    from ...sensing.reverb.forest.losses import TrunkStand
    from ...sensing.reverb.model_error import ModelError
    from ...sensing.sonar.echo import Echo, PingSeries
    from ...sensing.sonar.receiver import Reception
    from ...sensing.sonar.station import SonarPose

    found = [
        Echo,
        Reception,
        PingSeries,
        SonarPose,
        ImpulseResponse,
        ModelError,
        TrunkStand,
        Clutter,
    ]
    groups: list[type] = [Settings]
    for group in groups:  # it grows
        groups.extend(group.__subclasses__())
    return {
        kind.__name__: partial(
            kind, **dict.fromkeys(LEFT_OUT & {f.name for f in dataclasses.fields(kind)})
        )
        for kind in [*groups[1:], *found]
    }


# What says nothing where no forest was asked for and none of it was met.
OF_TREES = {
    *("Trees Seen", "Wood", "Leaves", "Ground", "Leaves Heard", "Wood Heard", "Behind Wood"),
    *("Trunks Heard", "Trees Heard", "Beyond Field", "Too Late"),
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
    figures = in_words(of_forest(forest, len(settings.plantings)))
    for number, planting in enumerate(props.plantings):
        planting.standing = int(np.count_nonzero(forest.stand.species == number))
    _note(props, "forest", "forest", settings.name, figures | {keep("Time"): f"{seconds:.1f} s"})
    trees, leaves = figures["Trees"], figures["Leaves"]
    if removed := int(forest.stand.removed):
        return say(
            "{trees} trees with {leaves} leaves in {seconds:.1f} s; spacing removed {removed:,} of "
            "{before:,}",
            trees=trees,
            leaves=leaves,
            seconds=seconds,
            removed=removed,
            before=removed + len(forest.stand),
        )
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
    obj: bpy.types.Object,
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
        some = [each for each in figured if any(digit in "123456789" for digit in each.text)]
        figured = [each for each in figured if each.short not in OF_TREES or each in some]
    figures = in_words(figured)
    plot = record.plot(sensor, found)
    title = f"Forest {sensor.name}" + ("" if frame is None else f" {frame:04d}")
    picture = images.show(title, plot) if plot else None
    sound = None
    if record.is_response and record.sound is not None and obj.type == "SPEAKER":
        sound = give_sound(obj, sensor.name, *record.sound(sensor, found))
    earlier = props.results.get(obj.name)
    left = blocks_of(earlier) if earlier is not None else []
    result = _note(  # what needs disk space is done
        props, obj.name, sensor.kind, obj.name, figures | {keep("Time"): f"{seconds:.1f} s"}
    )
    obj[SENSOR_KEY] = obj.name
    result.summary.value = sentence
    result.summary.made_of = sentence.made_of if isinstance(sentence, Kept) else ""
    result.picture, result.caption = picture, label_kept(plot.caption) if plot else ""
    cloud, marks = record.points(sensor, found), record.marks(found)
    if cloud is None:
        result.found = pack(sensor, found, offset)
    else:
        labels = labels_of(cloud.returns, geometry, names[1]) if geometry is not None else {}
        points = show_cloud(part(context.scene, RESULTS), sensor.name, cloud)
        note_scan(points.data, cloud, offset, offset.crs, labels)
        result.shown = points.name
        set_legend(result, legend_of(cloud, *names))
    if marks is not None:
        points = show_heard(part(context.scene, RESULTS), sensor.name, marks)
        result.shown = points.name
        set_legend(result, legend_of_heard(marks))
    if result.shown:
        show_result(context, result)
        if beyond := end_with_ground(points, context.scene):
            _set_figures(result, {keep("Far Points"): keep("{count:,} not shown", count=beyond)})
    if frame is not None:
        hold_frame(result, frame, sound)
    else:
        result.frames.clear()
    let_go(left)
    return say("{found} in {seconds:.1f} s", found=say_kept(sentence), seconds=seconds)


def in_words(figures: list[Figure]) -> Words:
    """Lines of figures for the panel; kept in English, said in the language when they are read."""
    return {
        keep(each.short): keep(each.pattern, **each.values) if each.pattern else each.text
        for each in figures
        if each.short
    }


def note_audit(context: bpy.types.Context, name: str, audit: Audit) -> None:
    """Add to a result how many of its values were checked, and how far off they are."""
    off, allowed = (plain(value, audit.unit) for value in (audit.error, audit.allowed))
    words = keep("off by {off}", off=off)
    if not audit.kept:
        words = keep("{off} off: MORE than {allowed}", off=off, allowed=allowed)
    note_figures(context, name, {keep("Checked"): f"{audit.checked:,}", keep("Audit"): words})


def note_figures(context: bpy.types.Context, name: str, figures: Words) -> None:
    """Add figures to a result, or change them, where it is kept for this frame as well."""
    result = context.scene.forest_sensing.results[name]
    _set_figures(result, figures)
    for each in result.frames:
        if each.frame == context.scene.frame_current:
            each.said = said_of(result)


def _set_figures(result: Any, figures: Words) -> None:
    set_figures(
        result,
        (
            (name, value, value.made_of if isinstance(value, Kept) else "")
            for name, value in figures.items()
        ),
    )


def plain(value: float, unit: str) -> str:
    """An error as one says it: metres in parts of a millimetre, a share in percent."""
    if not np.isfinite(value):
        return f"{value} {unit}".strip()
    if unit == "m":
        return "< 0.001 mm" if value < 1e-6 else keep("{size:,.3f} mm", size=1e3 * value)
    return "< 0.0001 %" if value < 1e-6 else f"{100.0 * value:,.4f} %"


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
    redraw_panels()
    _set_figures(result, figures)
    return result
