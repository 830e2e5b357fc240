"""Adding sensors to the scene, with settings that run at once where they are put, and removing them.

A kind of ``spec`` may be carried in several ways (a moving scanner by a drone or a vehicle). What moves along
a path gets one through what there is to sense: a curve, which the user can edit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import bpy
from mathutils import Vector

from ... import spec
from ...blender.scene.instances import SOLID_TYPES
from ...blender.scene.layout import RESULTS, find_part
from ...blender.sensors import objects as sensors
from ...sensing.kinds import KINDS
from ..settings.exchange import add_sensor
from ..shell.running import Button, button, menu
from ..shell.views import choose_sensor, chosen_sensor
from ..shell.words import keep, say

Point = tuple[float, float, float]

AROUND = 40.0  # m that a sensor's path reaches from where it is put, at most
SWATHE = 20.0  # m between two legs of a drone


@dataclass(frozen=True)
class Around:
    """Place of a new sensor: on the ground at ``foot``, among things from ``low`` to ``high`` (m)."""

    foot: Point
    low: Point
    high: Point

    def reach(self, axis: int) -> tuple[float, float]:
        """Interval along x or y in which there is something to sense, not too far from the foot."""
        here = self.foot[axis]
        return (
            min(max(self.low[axis], here - AROUND), here - 5.0),
            max(min(self.high[axis], here + AROUND), here + 5.0),
        )

    def raised(self, height: float) -> Point:
        """A place above the foot."""
        x, y, z = self.foot
        return x, y, z + height


@dataclass(frozen=True)
class Start:
    """A sensor to add: ``settings`` where it stands, ``path`` of what moves along one."""

    title: str
    kind: str
    icon: str
    help: str
    settings: Callable[[Around], spec.Sensor]
    path: Callable[[Around], list[Point]] | None = None


def _over(around: Around) -> list[Point]:
    """Back and forth above everything."""
    (x0, x1), (y0, y1) = around.reach(0), around.reach(1)
    height = max(around.high[2], around.foot[2]) + 30.0
    legs = max(math.ceil((x1 - x0) / SWATHE), 1)
    path = []
    for leg in range(legs):
        x = x0 + (leg + 0.5) * (x1 - x0) / legs
        ends = [(x, y0, height), (x, y1, height)]
        path += ends[::-1] if leg % 2 else ends
    return path


def _along(around: Around) -> list[Point]:
    """Straight through, at the height of a roof."""
    (y0, y1), (x, _, z) = around.reach(1), around.raised(2.0)
    return [(x, y0, z), (x, y1, z)]


def _aircraft(around: Around) -> spec.Sensor:
    (x0, x1), (y0, y1) = around.reach(0), around.reach(1)
    height = max(around.high[2], around.foot[2]) + 100.0
    return spec.Airborne(
        position=((x0 + x1) / 2, y0, height), track=y1 - y0, max_range=1000.0, pulse_rate=200e3
    )


def _bat(around: Around) -> spec.Sensor:
    x, y, _ = around.foot
    aim = [(a + b) / 2 for a, b in zip(around.low, around.high, strict=True)]
    away = math.hypot(aim[0] - x, aim[1] - y)
    azimuth = math.degrees(math.atan2(aim[1] - y, aim[0] - x)) if away > 1.0 else 0.0
    return spec.Sonar(position=around.raised(2.0), azimuth_deg=round(azimuth, 1))


def _reverb(around: Around) -> spec.Sensor:
    x, y, z = around.raised(1.5)
    return spec.Reverb(  # the defaults are the paper's, so that scenes of before stay as they were
        source=(x, y, z), receiver=(x + 9.0, y, z), model="forest", surface="forest floor"
    )


STARTS: dict[str, Start] = {
    "terrestrial": Start(
        keep("Tripod LiDAR"),
        "terrestrial",
        KINDS["terrestrial"].icon,
        KINDS["terrestrial"].help,
        lambda around: spec.Terrestrial(position=around.raised(1.6)),
    ),
    "drone": Start(
        keep("Drone LiDAR"),
        "mobile",
        "OUTLINER_OB_FORCE_FIELD",
        keep("A scanner under a drone, which flies to and fro along a curve"),
        lambda around: spec.Mobile(
            speed=5.0,
            max_range=150.0,
            pulse_rate=50e3,
            field_deg=(-35.0, 35.0),
            line_rate=50.0,
        ),
        _over,
    ),
    "mobile": Start(
        keep("Vehicle LiDAR"),
        "mobile",
        "AUTO",
        KINDS["mobile"].help,
        lambda around: spec.Mobile(
            speed=5.0,
            max_range=80.0,
            pulse_rate=100e3,
            pattern="spinning",
            field_deg=(-25.0, 15.0),
            line_rate=10.0,
            channels=32,
        ),
        _along,
    ),
    "airborne": Start(
        keep("Aircraft LiDAR"),
        "airborne",
        KINDS["airborne"].icon,
        KINDS["airborne"].help,
        _aircraft,
    ),
    "tractor": Start(
        keep("Tractor LiDAR"),
        "tractor",
        KINDS["tractor"].icon,
        KINDS["tractor"].help,
        lambda around: spec.Tractor(position=around.raised(1.0), step=0.01),
    ),
    "sonar": Start(
        keep("Bat Sonar"),
        "sonar",
        KINDS["sonar"].icon,
        KINDS["sonar"].help,
        _bat,
    ),
    "reverb": Start(
        keep("Reverb"),
        "reverb",
        KINDS["reverb"].icon,
        KINDS["reverb"].help,
        _reverb,
    ),
}


STARTS |= {  # every other kind stands where it is put
    name: Start(
        kind.settings.TITLE or name.title(),
        name,
        kind.icon,
        kind.help,
        lambda around, settings=kind.settings: settings(position=around.raised(1.5)),
    )
    for name, kind in KINDS.items()
    if name not in {start.kind for start in STARTS.values()}
}


ABOVE = 0.5  # m that the 3D cursor may be below the ground that it is meant to be on
OUTER = 1e4  # m from which one looks down for ground


def put(context: bpy.types.Context, which: str) -> bpy.types.Object:
    """Add a sensor of ``STARTS`` at the 3D cursor, choose it, and return its object."""
    start, around = STARTS[which], around_cursor(context)
    obj = add_sensor(context.scene, start.settings(around))
    obj.name = start.title
    if start.path is not None:
        path = sensors.new_path(context.scene, obj, start.path(around))
        getattr(obj.forest_sensor, start.kind).follow = path.name
    context.view_layer.update()
    choose_sensor(context, obj)
    return obj


def around_cursor(context: bpy.types.Context) -> Around:
    """Place of the 3D cursor, and what there is to sense: a box around all surfaces and trees."""
    x, y, z = context.scene.cursor.location
    corners, heights = [], []
    results = find_part(context.scene, RESULTS)
    found = set(results.all_objects) if results is not None else set()
    depsgraph = context.evaluated_depsgraph_get()
    for obj in context.view_layer.objects:
        if obj.type not in SOLID_TYPES or obj in found or not obj.visible_get():
            continue
        seen = obj.evaluated_get(depsgraph)
        box = [seen.matrix_world @ Vector(corner) for corner in seen.bound_box]
        low, high = Vector(map(min, *box)), Vector(map(max, *box))
        corners += [low, high]
        if obj.type == "MESH" and low.x <= x <= high.x and low.y <= y <= high.y:
            heights += _heights(seen, x, y)
    low, high = (Vector(map(side, *corners)) if corners else Vector() for side in (min, max))
    below = [height for height in heights if height <= z + ABOVE]
    ground = max(below) if below else min(heights, default=z)
    return Around((x, y, ground), tuple(low), tuple(high))


def _heights(obj: bpy.types.Object, x: float, y: float) -> list[float]:
    """Place where a vertical line first meets the surface of an evaluated mesh from above."""
    inverse = obj.matrix_world.inverted_safe()
    start, end = inverse @ Vector((x, y, OUTER)), inverse @ Vector((x, y, -OUTER))
    way = end - start
    if not way.length or not len(obj.data.polygons):
        return []
    hit, place, _, _ = obj.ray_cast(start, way.normalized(), distance=way.length)
    return [(obj.matrix_world @ place).z] if hit else []


@button(
    "Add Sensor",
    Button,
    kind=bpy.props.EnumProperty(
        name="Kind",
        items=[
            (which, str(start.title), str(start.help), start.icon, number)
            for number, (which, start) in enumerate(STARTS.items())
        ],
    ),
    description=classmethod(lambda _cls, _context, given: say(STARTS[given.kind].help)),
)
def _add_sensor(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Add a sensor as an object at the 3D cursor: move it, turn it, parent it, key it"""
    put(context, pressed.kind)
    return ""


@button("Scan This Scene", Button)
def scan_here(_button: Button, context: bpy.types.Context) -> str:
    """Put a LiDAR scanner on a tripod at the 3D cursor, in any scene: no forest is needed"""
    obj = put(context, "terrestrial")
    return say("{name} stands at the 3D cursor. Press Run", name=obj.name)


@button("Remove Sensor", Button, needs=((chosen_sensor, keep("There is no sensor to remove")),))
def remove_sensor(_button: Button, context: bpy.types.Context) -> str:
    """Remove the chosen sensor; what it found stays"""
    sensors.remove_sensor(chosen_sensor(context))
    return ""


FOREIGN = (
    lambda context: (
        (obj := context.view_layer.objects.active) is not None
        and sensors.is_foreign(context.scene, obj)
    ),
    keep("The active object is no sensor of another file or scene"),
)


@button("Adopt Sensor", Button, needs=(FOREIGN,))
def adopt_sensor(_button: Button, context: bpy.types.Context) -> str:
    """Make a sensor that came from another file or scene one of this scene, with its receiver or path"""
    made = sensors.adopt(context.scene, context.view_layer.objects.active)
    context.view_layer.update()
    choose_sensor(context, made)
    return say("{name} is a sensor of this scene now", name=made.name)


def _draw_starts(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """Sensors to add"""
    menu.layout.operator_context = "EXEC_DEFAULT"
    for which, start in STARTS.items():
        added = menu.layout.operator("forest.add_sensor", text=start.title, icon=start.icon)
        added.kind = which


CLASSES = (menu("Sensor")(_draw_starts, "sensors"),)


def draw_in_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The entry in Add."""
    menu.layout.menu("FOREST_MT_sensors", icon="OUTLINER_OB_LIGHTPROBE")


MENUS = (("VIEW3D_MT_add", draw_in_menu),)
