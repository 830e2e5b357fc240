"""The panel *Sensors*: which there are, what they are set to, and the buttons that run them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import bpy

from ... import spec
from ...blender.sensors import objects as sensors
from ...sensing.kinds import KINDS
from ..forest.wind_view import draw_wind
from ..results.panel import draw_found
from ..settings import references
from ..settings.drawing import BIG, OnceStarted, draw_settings, folded, name_in, split
from ..settings.lists import draw_list
from ..settings.presets import draw_presets
from ..shell.chosen import chosen, chosen_sensor, while_drawn
from ..shell.progress import draw_job
from ..shell.running import current
from ..shell.words import keep, label, label_kept
from .instruments import draw_instrument
from .look_through import draw_switch
from .things import is_unrendered, seen_thing

AXES = (keep("Rotation X"), keep("Rotation Y"), keep("Rotation Z"))


class FOREST_PT_sensors(OnceStarted, bpy.types.Panel):
    bl_label = "Sensors"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        layout, props = self.layout, context.scene.forest_sensing
        known = sensors.sensors_of(context.scene)
        home = sensors.home_of(context.scene, known)
        row = layout.row()
        if home is not None and known:
            with while_drawn(props):
                row.template_list(
                    "FOREST_UL_sensors", "", home, "objects", props, "active_sensor", rows=3
                )
        else:
            row.label(text="No sensor yet: add one", icon="INFO")
        buttons = row.column(align=True)
        buttons.menu("FOREST_MT_sensors", text="", icon="ADD")
        buttons.operator("forest.remove_sensor", text="", icon="REMOVE")
        draw_adopt(layout, context, context.view_layer.objects.active)
        thing = chosen_sensor(context, known)
        _draw_run(layout, thing)
        found = None if thing is None else context.scene.forest_sensing.results.get(thing.name)
        if found is not None:
            draw_found(layout, found)
        draw_switch(layout, context, thing)
        split(layout).prop(props, "output", placeholder="In this file alone")


class FOREST_PT_sensor(OnceStarted, bpy.types.Panel):
    """Settings of the chosen sensor."""

    bl_label = "Sensor Settings"
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}  # results stay in sight

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and chosen_sensor(context) is not None

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        draw_presets(self.layout, sensors.kind_of(chosen_sensor(context)))

    def draw(self, context: bpy.types.Context) -> None:
        thing = chosen_sensor(context)
        column = split(self.layout)
        column.prop(thing, "name")
        column.prop(context.scene.forest_sensing, "advanced")
        _draw_sensor(self.layout, thing)


class FOREST_PT_sensor_data(bpy.types.Panel):
    """The same in the Properties editor, where Blender's own cameras and lamps have theirs."""

    bl_label = "Forest Sensor"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "data"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        thing = context.object
        return thing is not None and sensors.kind_of(thing) in KINDS

    def draw(self, context: bpy.types.Context) -> None:
        thing = context.object
        draw_adopt(self.layout, context, thing)
        if thing not in sensors.sensors_of(context.scene):
            return
        row, job = self.layout.row(align=True), current()
        if job is not None:
            draw_job(row, job)
        else:
            run = row.operator("forest.run", icon="PLAY")
            run.sensor, run.frames = thing.name, "THIS"
        split(self.layout).prop(context.scene.forest_sensing, "advanced")
        _draw_sensor(self.layout, thing)


def _draw_run(layout: bpy.types.UILayout, thing: bpy.types.Object | None) -> None:
    """The buttons that run a sensor, all, or a frame range; while something runs, how far that is."""
    run, job = layout.row(align=True), current()
    run.scale_y = BIG
    if job is not None:
        draw_job(run, job)
        return
    one = run.row(align=True)
    one.enabled = thing is not None
    this = one.operator(
        "forest.run",
        text=label("Run") if thing is None else label("Run {sensor}", sensor=thing.name),
        icon="PLAY",
    )
    this.sensor, this.frames = "" if thing is None else thing.name, "THIS"
    every = run.row(align=True)
    every.ui_units_x = 3  # the rest is for the sensor's name
    every.operator("forest.run", text="All").frames = "THIS"
    frames = run.operator("forest.run_frames", text="", icon="RENDER_ANIMATION")
    frames.sensor = "" if thing is None else thing.name


def draw_adopt(
    layout: bpy.types.UILayout, context: bpy.types.Context, thing: bpy.types.Object | None
) -> None:
    """Offer to make a sensor this scene's own, where it is not, or lacks what it needs."""
    if thing is None or not sensors.is_stranger(context.scene, thing):
        return
    layout.label(text=label("{name} is not whole here", name=thing.name), icon="ERROR")
    layout.operator("forest.adopt_sensor", icon="LINKED")


def _draw_sensor(layout: bpy.types.UILayout, thing: bpy.types.Object) -> None:
    """Draw where a sensor is and looks, and all its settings."""
    kind = sensors.kind_of(thing)
    group = getattr(thing.forest_sensor, kind)
    record, column = KINDS[kind], split(layout)
    if record.posed:  # else it goes where its poses say, or what it follows
        column.prop(thing, "location")
    if record.body == "speaker":
        column.prop(thing, f'["{sensors.RECEIVER_KEY}"]', text="Receiver")
    for axis in record.turns:
        column.prop(thing, "rotation_euler", index=axis, text=AXES[axis])
    fixed = record.fixed(group)
    if fixed:
        column.label(text=label_kept(fixed), icon="INFO")
    hidden = {"name", *record.posed, *references.HEARD_TYPES}
    if "scanner" in group.shown:
        draw_instrument(split(layout), group)
    draw_settings(split(layout), group, hidden)
    for part in group.nested:
        header, body = folded(layout, f"FOREST_{kind}_{part}")
        header.label(text=name_in(type(group), part))
        if body is not None:
            draw_settings(split(body), getattr(group, part))
    if kind in LISTS:
        LISTS[kind](layout, group)


def _draw_poses(layout: bpy.types.UILayout, group: Any) -> None:
    """The poses of a scanner that follows nothing."""
    if group.follow:
        return
    layout.label(text="Where It Goes")
    draw_list(layout, "FOREST_UL_poses", group, "poses", "pose")
    if group.poses:
        draw_settings(split(layout), chosen(group, "poses"))


def _draw_further(layout: bpy.types.UILayout, group: Any) -> None:
    """Further sources and receivers of a reverb."""
    layout.label(text="Further Sources")
    _draw_ends(layout, group, "sources", "source")
    _draw_objects(layout, group, "source_objects", "source_object")
    layout.label(text="Further Receivers")
    _draw_ends(layout, group, "receivers", "receiver")
    _draw_objects(layout, group, "receiver_objects", "receiver_object")


LISTS: dict[str, Callable[[bpy.types.UILayout, Any], None]] = {  # of the settings of a kind
    "mobile": _draw_poses,
    "reverb": _draw_further,
}


def _draw_ends(layout: bpy.types.UILayout, reverb: Any, name: str, thing: str) -> None:
    """Further sources or receivers: the list, and the place of the chosen one."""
    draw_list(layout, "FOREST_UL_places", reverb, name, thing)
    if getattr(reverb, name):
        draw_settings(split(layout), chosen(reverb, name))


def _draw_objects(layout: bpy.types.UILayout, reverb: Any, name: str, thing: str) -> None:
    """Objects that are further ends: the list, and the picker of the chosen one."""
    layout.label(text=name_in(type(reverb), name))
    items = f"{name}_pointers"
    draw_list(layout, "FOREST_UL_objects", reverb, items, thing)
    if getattr(reverb, items):
        split(layout).prop(chosen(reverb, items), "thing")


class FOREST_PT_thing(OnceStarted, bpy.types.Panel):
    """Panel of the active object as sensors see it."""

    bl_label = "This Object"
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and seen_thing(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        thing = seen_thing(context)
        column = split(self.layout)
        column.prop(thing, "name")
        column.prop(thing, "forest_seen")
        if is_unrendered(thing):
            column.label(text="Not in renders; sensed all the same", icon="INFO")
        column.prop(thing, "forest_reflects")
        if thing.forest_reflects:
            column.prop(thing, "forest_reflected")
        column.prop(thing, "forest_polish")
        if thing.forest_polish == "MIRROR":
            column.prop(thing, "forest_mirrored")
        elif thing.forest_polish == "RETRO":
            column.prop(thing, "forest_gained")
        elif thing.forest_polish != "NONE":
            column.prop(thing, "forest_refraction")


class FOREST_PT_air(OnceStarted, bpy.types.Panel):
    bl_label = "Air"
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        draw_settings(split(self.layout), context.scene.forest_sensing.air)


class FOREST_PT_wind(OnceStarted, bpy.types.Panel):
    bl_label = "Wind"
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw_header_preset(self, _context: bpy.types.Context) -> None:
        draw_presets(self.layout, "wind")

    def draw(self, context: bpy.types.Context) -> None:
        draw_settings(split(self.layout), context.scene.forest_sensing.wind)
        draw_wind(self.layout, context.scene)


class FOREST_PT_rays(OnceStarted, bpy.types.Panel):
    bl_label = spec.Rays.TITLE
    bl_parent_id = "FOREST_PT_sensors"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        draw_settings(split(self.layout), context.scene.forest_sensing.rays)
        draw_settings(split(self.layout), context.scene.forest_sensing.accuracy)


CLASSES = (
    FOREST_PT_sensors,
    FOREST_PT_sensor,
    FOREST_PT_sensor_data,
    FOREST_PT_thing,
    FOREST_PT_air,
    FOREST_PT_wind,
    FOREST_PT_rays,
)
