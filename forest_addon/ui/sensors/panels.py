"""The panel *Sensors*: which there are, how they are set, what runs them; objects as sensors see them.

Whether an object is seen, how much light it sends back and whether it is a mirror, glass or water stays what
it is without the add-on, custom properties of the object (``blender/read``); here it gets names, limits and
help. The menu of instruments has their makers' names; the setting that is stored is the scanner file's name.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar

import bpy

from ... import spec
from ...blender.scene.instances import IGNORED_KEY, REFLECTANCE_KEY, SOLID_TYPES
from ...blender.scene.layout import CLOUD_KEY
from ...blender.sensors import objects as sensors
from ...blender.sensors.objects import kind_of
from ...formats.toml_file import ScannerFile, read_scanner, scanner_names
from ...sensing.kinds import KINDS
from ...spec.choices import meaning_of, title_of
from ..forest.wind import draw_wind
from ..results.panel import draw_found
from ..settings import references
from ..settings.drawing import (
    BIG,
    Listed,
    OfData,
    OfSensors,
    OnceStarted,
    Row,
    buttons,
    draw_list,
    draw_listed,
    draw_named,
    draw_settings,
    folded,
    icon_of,
    is_narrow,
    name_in,
    rows,
    split,
)
from ..settings.presets import draw_presets
from ..shell.running import current, draw_job, menu, panel
from ..shell.views import chosen, chosen_sensor, chosen_settings
from ..shell.words import keep, label, label_kept, say
from .look_through import draw_switch

KIND_KEY, INDEX_KEY, SHARE_KEY, GAIN_KEY = (
    spec.property_of(name) for name in ("optics", "index", "mirror", "gain")
)
OPTICS = ("", *spec.POLISHED)


def seen_thing(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object, if sensors could see it."""
    obj = context.object
    solid = obj is not None and obj.type in SOLID_TYPES
    return obj if solid and not sensors.kind_of(obj) else None


def is_unrendered(obj: bpy.types.Object) -> bool:
    """Return whether sensors meet an object that renders do not show: they see what views show."""
    hidden = obj.hide_render and obj.visible_get() and CLOUD_KEY not in obj
    return hidden and _is_seen(obj) and obj.type in SOLID_TYPES


def _is_seen(obj: Any) -> bool:
    return not obj.get(IGNORED_KEY, False)


def _optics(obj: Any) -> int:
    kind = obj.get(KIND_KEY, "")
    return OPTICS.index(kind) if kind in OPTICS else 0


def _number(key: str, low: float, high: float, usual: Callable[[Any], float]) -> dict[str, Any]:
    """Get, set and limits of a number that an object keeps; ``usual`` is read where it keeps none."""

    def read(obj: Any) -> float:
        value = obj.get(key)
        return value if isinstance(value, int | float) and value >= low else usual(obj)

    return {
        "get": read,
        "set": lambda obj, value: _say(obj, key, min(max(value, low), high)),
        "min": low,
        "max": high,
    }


def _say(obj: Any, key: str, value: Any) -> None:
    if value is not None:
        obj[key] = value
    elif key in obj:
        del obj[key]
    obj.update_tag()  # what was read of the scene is read again


REFLECTANCE = _number(REFLECTANCE_KEY, 0.0, 1.0, lambda _: spec.Surfaces().other)
OF_OBJECTS = {
    "forest_seen": bpy.props.BoolProperty(
        name="Seen by Sensors",
        description="LiDAR, sonar and reverb meet this object; off: they pass through it",
        get=_is_seen,
        set=lambda obj, seen: _say(obj, IGNORED_KEY, None if seen else True),
    ),
    "forest_reflects": bpy.props.BoolProperty(
        name="Own Reflectance",
        description="LiDAR takes this object's reflectance, not that of the scanner's surfaces",
        get=lambda obj: REFLECTANCE_KEY in obj,
        set=lambda obj, has: _say(obj, REFLECTANCE_KEY, REFLECTANCE["get"](obj) if has else None),
    ),
    "forest_reflected": bpy.props.FloatProperty(
        name="Reflectance",
        description="Share of the light that this object sends back (Lambert); a material that has the "
        "custom property forest_reflectance comes first",
        subtype="FACTOR",
        **REFLECTANCE,
    ),
    "forest_polish": bpy.props.EnumProperty(
        name="Polish",
        description="LiDAR that follows bounces finds this object a mirror, glass or water; without them it "
        "is as any other surface. A material that has the custom property of the same meaning comes first",
        items=[
            ("NONE", "None", "Light is scattered to all sides"),
            *(
                (kind.upper(), title_of("optics", kind), meaning_of("optics", kind))
                for kind in spec.POLISHED
            ),
        ],
        get=_optics,
        set=lambda obj, number: _say(obj, KIND_KEY, OPTICS[number] or None),
    ),
    "forest_refraction": bpy.props.FloatProperty(
        name="Index",
        description="Refractive index of the glass or the water",
        **_number(INDEX_KEY, 1.0, 5.0, lambda obj: spec.USUAL_INDEX.get(OPTICS[_optics(obj)], 1.0)),
    ),
    "forest_mirrored": bpy.props.FloatProperty(
        name="Sends On",
        description="Share of the light that the mirror sends on",
        subtype="FACTOR",
        **_number(SHARE_KEY, 0.0, 1.0, lambda _: spec.Polished().mirror),
    ),
    "forest_gained": bpy.props.FloatProperty(
        name="Gain",
        description="Light that the retro-reflector sends back, of that of a white surface",
        soft_max=5000.0,
        **_number(GAIN_KEY, 1.0, 1e6, lambda _: spec.Polished().gain),
    ),
}


PROPERTIES = tuple((bpy.types.Object, name, prop) for name, prop in OF_OBJECTS.items())
Context = bpy.types.Context


class FOREST_UL_sensors(bpy.types.UIList):
    """Sensors of the scene, which are objects."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        layout.prop(item, "name", text="", emboss=False, icon=icon_of(kind_of(item)))
        if not is_narrow():
            run = layout.operator("forest.run", text="", icon="PLAY", emboss=False)
            run.sensor, run.frames = item.name, "THIS"

    def filter_items(self, context, data, name) -> tuple[list[int], list[int]]:
        things = getattr(data, name)
        return [self.bitflag_filter_item if kind_of(obj) else 0 for obj in things], []


NO_SCANNER = keep("Choose a moving scanner in the list of sensors first")
NO_REVERB = keep("Choose a reverb in the list of sensors first")


_poses_of = partial(chosen_settings, kind="mobile")
_reverb_of = partial(chosen_settings, kind="reverb")


def _place(position: Any) -> str:
    x, y, z = position
    return f"{x:g}, {y:g}, {z:g} m"


def _next_pose(context: Context) -> dict[str, Any]:
    """A pose ten seconds and ten metres after the last."""
    poses = _poses_of(context).poses
    if len(poses) < 2:
        return {}
    last = poses[len(poses) - 2]
    (x, y, z), heading = last.position, math.radians(last.heading_deg)
    place = (x + 10 * math.cos(heading), y + 10 * math.sin(heading), z)
    return {"time": last.time + 10, "heading_deg": last.heading_deg, "position": place}


def _middle(context: Context) -> dict[str, Any]:
    """A place in the middle of the field, as high as a new one is."""
    field = context.scene.forest_sensing.forest
    x, y = (o + s / 2 for o, s in zip(field.origin, field.size, strict=True))
    return {"position": (x, y, spec.Place().position[2])}


CLASSES = (
    rows(
        "poses",
        "Poses of a moving scanner",
        lambda item: Row(_place(item.position), "EMPTY_ARROWS", f"{item.time:g} s"),
    ),
    rows(
        "places",
        "Further sources or receivers of a reverb",
        lambda item: Row(_place(item.position), "EMPTY_AXIS"),
    ),
    rows(
        "objects",
        "Objects that are further sources or receivers of a reverb",
        lambda item: (
            Row(item.thing.name, "OBJECT_DATA") if item.thing else Row(item.name or "?", "ERROR")
        ),
    ),
    *buttons(
        "pose",
        "Pose",
        Listed("poses", _poses_of, NO_SCANNER),
        "Add a place that the scanner passes, ten seconds and ten metres after the last",
        _next_pose,
    ),
    *buttons(
        "source",
        "Source",
        Listed("sources", _reverb_of, NO_REVERB),
        "Add one more source, in the middle of the field",
        _middle,
    ),
    *buttons(
        "receiver",
        "Receiver",
        Listed("receivers", _reverb_of, NO_REVERB),
        "Add one more receiver, in the middle of the field",
        _middle,
    ),
    *buttons(
        "source_object",
        "Source Object",
        Listed(
            "source_objects_pointers",
            _reverb_of,
            NO_REVERB,
            lambda reverb: references.listed_anew(reverb, "source_objects"),
        ),
        "Add a Speaker of the scene as one more source; pick it below",
    ),
    *buttons(
        "receiver_object",
        "Receiver Object",
        Listed(
            "receiver_objects_pointers",
            _reverb_of,
            NO_REVERB,
            lambda reverb: references.listed_anew(reverb, "receiver_objects"),
        ),
        "Add an Empty or a Camera of the scene as one more receiver; pick it below",
    ),
)


OWN = "My Own"


@cache
def instruments() -> dict[str, ScannerFile]:
    """Every instrument that the add-on brings, by the name of its file; read once."""
    return {name: read_scanner(name) for name in scanner_names()}


def instrument_title(group: Any) -> str:
    """Origin of a scanner's settings: an instrument, a file of the user's, or nothing."""
    file = instruments().get(group.scanner)
    if file is not None:
        return short(file.title)
    return Path(group.scanner).name if group.scanner else label(OWN)


def short(title: str) -> str:
    """A title without what stands in brackets, so that it fits beside its label."""
    return title.partition(" (")[0]


def figures_of(file: ScannerFile, kind: str) -> str:
    """Range, pulse rate and beam width of an instrument on a platform, in words."""
    figures = file.tables[kind]
    parts = []
    if "max_range" in figures:
        parts.append(say("{metres:g} m", metres=figures["max_range"]))
    if "pulse_rate" in figures:
        parts.append(say("{rate:g} kHz", rate=figures["pulse_rate"] / 1e3))
    spread = figures.get("beam", {}).get("divergence_mrad")
    if spread:
        parts.append(say("{spread:g} mrad", spread=max(spread)))
    return ", ".join(parts)


class FOREST_OT_choose_instrument(bpy.types.Operator):
    """Start from an instrument's published figures"""

    bl_label = "Instrument"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO", "INTERNAL"}

    scanner: bpy.props.StringProperty(name="Instrument")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = chosen_sensor(context)
        return obj is not None and hasattr(spec.SENSORS[sensors.kind_of(obj)], "scanner")

    @classmethod
    def description(cls, context: bpy.types.Context, settings: Any) -> str:
        file, obj = instruments().get(settings.scanner), chosen_sensor(context)
        if file is None or obj is None or sensors.kind_of(obj) not in file.tables:
            return say("All settings as they are, of no instrument")
        figures = figures_of(file, sensors.kind_of(obj))
        return say("{instrument}: {figures}", instrument=file.title, figures=figures)

    def execute(self, context: bpy.types.Context) -> set[str]:
        obj = chosen_sensor(context)
        group = getattr(obj.forest_sensor, sensors.kind_of(obj))
        group.scanner = self.scanner  # what follows when it is set takes the figures
        return {"FINISHED"}


def draw_instruments(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Instruments that are used on what carries the chosen sensor"""
    obj = chosen_sensor(context)
    if obj is None:
        return
    kind = sensors.kind_of(obj)
    for name, file in instruments().items():
        if kind in file.tables:
            choose = menu.layout.operator("forest.choose_instrument", text=short(file.title))
            choose.scanner = name
    menu.layout.operator("forest.choose_instrument", text=label(OWN)).scanner = ""


INSTRUMENTS = menu("Instruments")(draw_instruments, "instruments")


AXES = (keep("Rotation X"), keep("Rotation Y"), keep("Rotation Z"))


def _draw_sensors(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    layout, props = tab.layout, context.scene.forest_sensing
    known = sensors.sensors_of(context.scene)
    home = sensors.home_of(context.scene, known)
    row = layout.row()
    if home is not None and known:
        listed = ("FOREST_UL_sensors", "", home, "objects", props, "active_sensor")
        row.template_list(*listed, rows=3)
    else:
        row.label(text="No sensor yet: add one", icon="INFO")
    buttons = row.column(align=True)
    buttons.menu("FOREST_MT_sensors", text="", icon="ADD")
    buttons.operator("forest.remove_sensor", text="", icon="REMOVE")
    draw_adopt(layout, context, context.view_layer.objects.active)
    obj = chosen_sensor(context, known)
    _draw_run(layout, obj)
    result = None if obj is None else props.results.get(obj.name)
    if result is not None:
        draw_found(layout, result)
    draw_switch(layout, context, obj)
    if is_narrow():
        layout.label(text="Save To")
    text = "" if is_narrow() else "Save To"
    split(layout).prop(props, "output", text=text, placeholder="In this file alone")


EVERY = panel("Sensors", OnceStarted, bl_order=1)(_draw_sensors, "sensors")


@panel(
    "Sensor Settings",
    OfSensors,
    needs=chosen_sensor,
    draw_header_preset=lambda tab, context: draw_presets(
        tab.layout, sensors.kind_of(chosen_sensor(context))
    ),
)
def sensor(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    """Settings of the chosen sensor."""
    obj = chosen_sensor(context)
    column = split(tab.layout)
    column.prop(obj, "name")
    column.prop(context.scene.forest_sensing, "advanced")
    _draw_sensor(tab.layout, obj)


@panel(
    "Forest Sensor",
    OfData,
    needs=lambda context: context.object is not None and sensors.kind_of(context.object) in KINDS,
)
def _sensor_data(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    """The same in the Properties editor, where Blender's own cameras and lamps have theirs."""
    obj = context.object
    draw_adopt(tab.layout, context, obj)
    if obj not in sensors.sensors_of(context.scene):
        return
    row, job = tab.layout.row(align=True), current()
    if job is not None:
        draw_job(row, job)
    else:
        run = row.operator("forest.run", icon="PLAY")
        run.sensor, run.frames = obj.name, "THIS"
    split(tab.layout).prop(context.scene.forest_sensing, "advanced")
    _draw_sensor(tab.layout, obj)


def _draw_run(layout: bpy.types.UILayout, obj: bpy.types.Object | None) -> None:
    """The buttons that run a sensor, all, or a frame range; while something runs, how far that is."""
    run, job = layout.row(align=True), current()
    run.scale_y = BIG
    if job is not None:
        draw_job(run, job)
        return
    one = run.row(align=True)
    one.enabled = obj is not None
    this = one.operator(
        "forest.run",
        text=label("Run {sensor}", sensor=obj.name) if obj and not is_narrow() else label("Run"),
        icon="PLAY",
    )
    this.sensor, this.frames = "" if obj is None else obj.name, "THIS"
    every = run.row(align=True)
    every.ui_units_x = 3  # the rest is for the sensor's name
    every.operator("forest.run", text="All").frames = "THIS"
    frames = run.operator("forest.run_frames", text="", icon="RENDER_ANIMATION")
    frames.sensor = "" if obj is None else obj.name


def draw_adopt(
    layout: bpy.types.UILayout, context: bpy.types.Context, obj: bpy.types.Object | None
) -> None:
    """Offer to make a sensor this scene's own, where it is not, or lacks what it needs."""
    if obj is None or not sensors.is_foreign(context.scene, obj):
        return
    layout.label(text=label("{name} is not whole here", name=obj.name), icon="ERROR")
    layout.operator("forest.adopt_sensor", icon="LINKED")


def _draw_sensor(layout: bpy.types.UILayout, obj: bpy.types.Object) -> None:
    """Draw where a sensor is and looks, and all its settings."""
    kind = sensors.kind_of(obj)
    group = getattr(obj.forest_sensor, kind)
    record, column = KINDS[kind], split(layout)
    if record.posed:  # else it goes where its poses say, or what it follows
        column.prop(obj, "location")
    if record.body == "speaker":
        draw_named(column, obj, f'["{sensors.RECEIVER_KEY}"]', "Receiver", is_narrow())
    for axis in record.turns:
        column.prop(obj, "rotation_euler", index=axis, text=AXES[axis])
    fixed = record.fixed(group)
    if fixed:
        column.label(text=label_kept(fixed), icon="INFO")
    hidden = {"name", *record.posed, *references.HEARD_TYPES}
    if "scanner" in group.shown:
        row = split(layout).row(heading="Instrument")
        row.menu(INSTRUMENTS.__name__, text=instrument_title(group))
    draw_settings(split(layout), group, hidden)
    for part in group.nested:
        header, body = folded(layout, f"FOREST_{kind}_{part}")
        if hasattr(group, f"use_{part}"):
            header.prop(group, f"use_{part}", text="")
        header.label(text=name_in(type(group), part))
        if body is not None:
            body.active = getattr(group, f"use_{part}", True)
            draw_settings(split(body), getattr(group, part))
    if kind == "mobile" and not group.follow:
        layout.label(text="Where It Goes")
        draw_listed(layout, group, "poses", "pose")
    elif kind == "reverb":
        for end, title in (
            ("source", keep("Further Sources")),
            ("receiver", keep("Further Receivers")),
        ):
            layout.label(text=label_kept(title))
            draw_listed(layout, group, f"{end}s", end, "places")
            objects = f"{end}_objects"
            layout.label(text=name_in(type(group), objects))
            items = f"{objects}_pointers"
            draw_list(layout, group, items, f"{end}_object", "objects")
            if getattr(group, items):
                split(layout).prop(chosen(group, items), "thing")


@panel("This Object", OfSensors, needs=seen_thing)
def thing(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    """Panel of the active object as sensors see it."""
    obj = seen_thing(context)
    column = split(tab.layout)
    column.prop(obj, "name")
    column.prop(obj, "forest_seen")
    if is_unrendered(obj):
        column.label(text="Not in renders; sensed all the same", icon="INFO")
    column.prop(obj, "forest_reflects")
    if obj.forest_reflects:
        column.prop(obj, "forest_reflected")
    column.prop(obj, "forest_polish")
    more = {"NONE": "", "MIRROR": "forest_mirrored", "RETRO": "forest_gained"}
    if name := more.get(obj.forest_polish, "forest_refraction"):
        column.prop(obj, name)


@panel("Air", OfSensors)
def air(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    draw_settings(split(tab.layout), context.scene.forest_sensing.air)


@panel("Wind", OfSensors, draw_header_preset=lambda tab, _: draw_presets(tab.layout, "wind"))
def wind(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    draw_settings(split(tab.layout), context.scene.forest_sensing.wind)
    draw_wind(tab.layout, context.scene)


@panel(spec.Rays.TITLE, OfSensors)
def rays(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    draw_settings(split(tab.layout), context.scene.forest_sensing.rays)
    draw_settings(split(tab.layout), context.scene.forest_sensing.accuracy)
