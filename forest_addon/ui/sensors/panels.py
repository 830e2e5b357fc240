"""The panel *Sensors*: which there are, how they are set, what runs them; objects as sensors see them.

Whether an object is seen, how much light it sends back and whether it is a mirror, glass or water stays what
it is without the add-on, custom properties of the object (``blender/read``); here it gets names, limits and
help. The menu of instruments has their makers' names; the setting that is stored is the scanner file's name.

The flyer is an empty whose X axis looks ahead; a LiDAR and a sonar follow it, so that what they find along an
animated flight can be run like that of any other sensor. *Fly* goes from where the flyer stands, and keys its
place and heading; the trail is coloured by how near anything was.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial
from math import degrees
from pathlib import Path
from typing import Any

import bpy

from ... import spec
from ...blender.jobs import Task, Work
from ...blender.scene.instances import IGNORED_KEY, REFLECTANCE_KEY, SOLID_TYPES
from ...blender.scene.layout import CLOUD_KEY, RESULTS, part
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
    OfData,
    OfSensors,
    OnceStarted,
    buttons,
    draw_list,
    draw_listed,
    draw_named,
    draw_settings,
    icon_of,
    is_narrow,
    name_in,
    open_parts,
    rows,
    split,
)
from ..settings.exchange import add_sensor, to_spec
from ..settings.presets import draw_presets
from ..shell.running import (
    Button,
    Working,
    button,
    current,
    draw_job,
    getting_ready,
    long_button,
    menu,
    panel,
)
from ..shell.views import choose_sensor, chosen, chosen_sensor, chosen_settings
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
        lambda item: (_place(item.position), "EMPTY_ARROWS", f"{item.time:g} s"),
    ),
    rows(
        "places",
        "Further sources or receivers of a reverb",
        lambda item: (_place(item.position), "EMPTY_AXIS", ""),
    ),
    rows(
        "objects",
        "Objects that are further sources or receivers of a reverb",
        lambda item: (
            (item.thing.name, "OBJECT_DATA", "") if item.thing else (item.name or "?", "ERROR", "")
        ),
    ),
    *buttons(
        "pose",
        "Pose",
        "poses",
        _poses_of,
        NO_SCANNER,
        "Add a place that the scanner passes, ten seconds and ten metres after the last",
        _next_pose,
    ),
    *buttons(
        "source",
        "Source",
        "sources",
        _reverb_of,
        NO_REVERB,
        "Add one more source, in the middle of the field",
        _middle,
    ),
    *buttons(
        "receiver",
        "Receiver",
        "receivers",
        _reverb_of,
        NO_REVERB,
        "Add one more receiver, in the middle of the field",
        _middle,
    ),
    *buttons(
        "source_object",
        "Source Object",
        "source_objects_pointers",
        _reverb_of,
        NO_REVERB,
        "Add a Speaker of the scene as one more source; pick it below",
        changed=lambda reverb: references.listed_anew(reverb, "source_objects"),
    ),
    *buttons(
        "receiver_object",
        "Receiver Object",
        "receiver_objects_pointers",
        _reverb_of,
        NO_REVERB,
        "Add an Empty or a Camera of the scene as one more receiver; pick it below",
        changed=lambda reverb: references.listed_anew(reverb, "receiver_objects"),
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


def _instrument_in_words(_cls: type, context: bpy.types.Context, given: Any) -> str:
    file, obj = instruments().get(given.scanner), chosen_sensor(context)
    if file is None or obj is None or sensors.kind_of(obj) not in file.tables:
        return say("All settings as they are, of no instrument")
    figures = figures_of(file, sensors.kind_of(obj))
    return say("{instrument}: {figures}", instrument=file.title, figures=figures)


SCANS = (
    lambda context: (
        (obj := chosen_sensor(context)) is not None
        and hasattr(spec.SENSORS[sensors.kind_of(obj)], "scanner")
    ),
    keep("Choose a scanner in the list of sensors first"),
)


@button(
    "Instrument",
    Button,
    needs=(SCANS,),
    bl_options={"REGISTER", "UNDO", "INTERNAL"},
    scanner=bpy.props.StringProperty(name="Instrument"),
    description=classmethod(_instrument_in_words),
)
def choose_instrument(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Start from an instrument's published figures"""
    obj = chosen_sensor(context)
    group = getattr(obj.forest_sensor, sensors.kind_of(obj))
    group.scanner = pressed.scanner  # what follows when it is set takes the figures
    return ""


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
    for name, body in open_parts(layout, group, kind):
        draw_settings(split(body), getattr(group, name))
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


FLYER_KEY = "forest_flyer"
NAME = "Flyer"
POLICIES = (
    ("gap", "By the Gap", "Follow the gap that costs least to turn to, by LiDAR"),
    (
        "echo",
        "By Two Ears",
        "Turn from the ear that hears the louder echo (Vanderelst et al. 2015)",
    ),
    ("straight", "Straight On", "Towards the aim, whatever is in the way"),
)


@button("Flight", Button)
def add_flight(_button: Button, context: bpy.types.Context) -> str:
    """Add a flyer with a LiDAR and two ears that go along with it"""
    from ...flight.senses import LIDAR, SONAR

    scene = context.scene
    obj = bpy.data.objects.new(NAME, None)
    obj.empty_display_type, obj.empty_display_size = "ARROWS", 0.5
    obj[FLYER_KEY] = True
    obj.location = scene.cursor.location
    obj.location.z = max(obj.location.z, scene.forest_sensing.flight.height)
    scene.collection.objects.link(obj)
    for settings in (LIDAR.changed(poses=()), SONAR):
        made = add_sensor(scene, settings.changed(follow=obj.name))
        made.name = f"{obj.name} {settings.name}"
    context.view_layer.update()
    choose_sensor(context, made)
    return ""


def flyer_of(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The scene's flyer, the active object if it is one."""
    active = bpy.context.view_layer.objects.active
    if active is not None and FLYER_KEY in active:
        return active
    return next((obj for obj in scene.objects if FLYER_KEY in obj), None)


@long_button(
    "Fly",
    Working,
    policy=bpy.props.EnumProperty(
        name="Policy", description="How it finds its way", items=POLICIES
    ),
    seed=bpy.props.IntProperty(name="Seed", min=0, description="Of what is left to chance"),
)
def _fly(pressed: bpy.types.Operator, context: bpy.types.Context) -> Work:
    """Fly from where the flyer stands to its aim, through all that stands in the scene, and animate it"""
    scene = context.scene
    obj = flyer_of(scene)
    if obj is None:
        raise spec.SpecError("", say("There is no flyer yet; add one by Add > Forest > Flight"))
    yield getting_ready("api", "flight.flying", "flight.policies", "flight.woods")
    from ...api import World
    from ...blender.show.trails import show_flights
    from ...flight.flying import fly
    from ...flight.policies import policy_of
    from ...flight.senses import LIDAR, SONAR, EarSense, LidarSense
    from ...flight.simulation import Flyers
    from ...flight.woods import Stock

    settings = to_spec(scene, [])
    place, heading = obj.matrix_world.translation, obj.matrix_world.to_euler().z
    flight = settings.flight.changed(start=tuple(place), heading_deg=degrees(heading))
    settings = settings.changed(flight=flight)
    world = World(settings, Path(bpy.path.abspath(scene.forest_sensing.folder)), None, scene)
    stock = Stock.standing(world)

    def flown(_tell: Any) -> Any:
        lidar, ears = LidarSense(LIDAR), EarSense(SONAR, settings.air)
        pilot = policy_of(pressed.policy, flight, lidar, ears)
        hears = "sonar" in pilot.sensors
        flyers = Flyers(flight, 1, None if hears else lidar, ears if hears else None)
        flyers.enter(stock.surroundings())
        return fly(flyers, pilot, [pressed.seed])[0]

    if settings.wind.speed > 0:
        pressed.report(
            {"WARNING"}, say("Scenes in Blender carry flyers by their steady wind alone")
        )
    track = yield Task(say("flying"), flown)
    show_flights(part(scene, RESULTS), [track], name=obj.name, flyer=obj)
    seconds, way = track.seconds, track.flown
    return {
        "arrived": say(
            "It arrives after {seconds:.1f} s and {way:.0f} m", seconds=seconds, way=way
        ),
        "crashed": say(
            "It touches something after {seconds:.1f} s and {way:.0f} m",
            seconds=seconds,
            way=way,
        ),
        "late": say(
            "It is still on its way after {seconds:.1f} s and {way:.0f} m",
            seconds=seconds,
            way=way,
        ),
    }[track.end]


@panel(spec.Flight.TITLE, OfSensors)
def flight(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    """Panel of a flyer: what its body can do, and where it is to go."""
    row = tab.layout.row(align=True)
    row.scale_y = BIG
    if flyer_of(context.scene) is None:
        row.operator("forest.add_flight", text="Add a Flyer", icon="EMPTY_SINGLE_ARROW")
    else:
        row.operator_menu_enum("forest.fly", "policy", text="Fly", icon="PLAY")
    draw_settings(split(tab.layout), context.scene.forest_sensing.flight)
