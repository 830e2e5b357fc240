"""Adding sensors to the scene and removing them."""

from __future__ import annotations

from typing import ClassVar

import bpy
from mathutils import Vector

from ...blender.scene.layout import RESULTS, find_part
from ...blender.scene.standings import SOLID_TYPES
from ...blender.sensors import objects as sensors
from ..settings.exchange import add_sensor
from ..shell.chosen import choose_sensor, chosen_sensor
from ..shell.running import InOwnScene
from ..shell.words import say
from .starts import STARTS, Around

ABOVE = 0.5  # m that the 3D cursor may be below the ground that it is meant to be on
OUTER = 1e4  # m from which one looks down for ground


def put(context: bpy.types.Context, which: str) -> bpy.types.Object:
    """Add a sensor of ``STARTS`` at the 3D cursor, choose it, and return its object."""
    start, around = STARTS[which], around_cursor(context)
    thing = add_sensor(context.scene, start.settings(around))
    thing.name = start.title
    if start.path is not None:
        path = sensors.new_path(context.scene, thing, start.path(around))
        getattr(thing.forest_sensor, start.kind).follow = path.name
    context.view_layer.update()
    choose_sensor(context, thing)
    return thing


def around_cursor(context: bpy.types.Context) -> Around:
    """Return where the 3D cursor stands, and what there is to sense: a box around all surfaces and trees."""
    x, y, z = context.scene.cursor.location
    corners, heights = [], []
    results = find_part(context.scene, RESULTS)
    found = set(results.all_objects) if results is not None else set()
    depsgraph = context.evaluated_depsgraph_get()
    for thing in context.view_layer.objects:
        if thing.type not in SOLID_TYPES or thing in found or not thing.visible_get():
            continue
        seen = thing.evaluated_get(depsgraph)
        box = [seen.matrix_world @ Vector(corner) for corner in seen.bound_box]
        low, high = Vector(map(min, *box)), Vector(map(max, *box))
        corners += [low, high]
        if thing.type == "MESH" and low.x <= x <= high.x and low.y <= y <= high.y:
            heights += _heights(seen, x, y)
    low, high = (Vector(map(side, *corners)) if corners else Vector() for side in (min, max))
    below = [height for height in heights if height <= z + ABOVE]
    ground = max(below) if below else min(heights, default=z)
    return Around((x, y, ground), tuple(low), tuple(high))


def _heights(thing: bpy.types.Object, x: float, y: float) -> list[float]:
    """Return where a vertical line first meets the surface of an evaluated mesh from above."""
    inverse = thing.matrix_world.inverted_safe()
    start, end = inverse @ Vector((x, y, OUTER)), inverse @ Vector((x, y, -OUTER))
    way = end - start
    if not way.length or not len(thing.data.polygons):
        return []
    hit, place, _, _ = thing.ray_cast(start, way.normalized(), distance=way.length)
    return [(thing.matrix_world @ place).z] if hit else []


class FOREST_OT_add_sensor(InOwnScene, bpy.types.Operator):
    """Add a sensor as an object at the 3D cursor: move it, turn it, parent it, key it"""

    bl_idname = "forest.add_sensor"
    bl_label = "Add Sensor"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(
        name="Kind",
        items=[
            (which, str(start.title), str(start.help), start.icon, number)
            for number, (which, start) in enumerate(STARTS.items())
        ],
    )

    @classmethod
    def description(
        cls, _context: bpy.types.Context, settings: bpy.types.OperatorProperties
    ) -> str:
        return say(STARTS[settings.kind].help)

    def execute(self, context: bpy.types.Context) -> set[str]:
        put(context, self.kind)
        return {"FINISHED"}


class FOREST_OT_scan_here(InOwnScene, bpy.types.Operator):
    """Put a LiDAR scanner on a tripod at the 3D cursor, in any scene: no forest is needed"""

    bl_idname = "forest.scan_here"
    bl_label = "Scan This Scene"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = put(context, "terrestrial")
        self.report({"INFO"}, say("{name} stands at the 3D cursor. Press Run", name=thing.name))
        return {"FINISHED"}


class FOREST_OT_remove_sensor(InOwnScene, bpy.types.Operator):
    """Remove the chosen sensor; what it found stays"""

    bl_idname = "forest.remove_sensor"
    bl_label = "Remove Sensor"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        if chosen_sensor(context) is None:
            cls.poll_message_set(say("There is no sensor to remove"))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        sensors.remove_sensor(chosen_sensor(context))
        return {"FINISHED"}


class FOREST_OT_adopt_sensor(InOwnScene, bpy.types.Operator):
    """Make a sensor that came from another file or scene one of this scene, with its receiver or path"""

    bl_idname = "forest.adopt_sensor"
    bl_label = "Adopt Sensor"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context):
            return False
        thing = context.view_layer.objects.active
        if thing is None or not sensors.is_stranger(context.scene, thing):
            cls.poll_message_set(say("The active object is no sensor of another file or scene"))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        made = sensors.adopt(context.scene, context.view_layer.objects.active)
        context.view_layer.update()
        choose_sensor(context, made)
        self.report({"INFO"}, say("{name} is a sensor of this scene now", name=made.name))
        return {"FINISHED"}


class FOREST_MT_sensors(bpy.types.Menu):
    """Sensors to add"""

    bl_idname = "FOREST_MT_sensors"
    bl_label = "Sensor"

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.operator_context = "EXEC_DEFAULT"
        for which, start in STARTS.items():
            added = self.layout.operator("forest.add_sensor", text=start.title, icon=start.icon)
            added.kind = which


def draw_in_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The entry in Add."""
    menu.layout.menu(FOREST_MT_sensors.bl_idname, icon="OUTLINER_OB_LIGHTPROBE")


CLASSES = (
    FOREST_OT_add_sensor,
    FOREST_OT_scan_here,
    FOREST_OT_remove_sensor,
    FOREST_OT_adopt_sensor,
    FOREST_MT_sensors,
)
MENUS = (("VIEW3D_MT_add", draw_in_menu),)
