"""Sensors as objects: where they are and look is the object's own transform, so they can be moved, parented,
keyed, and follow a curve.

A sonar and a tractor look along their object's local X axis; a scanner on a tripod stays upright, and its
azimuth counts from where that axis points (``heading``). A reverb
is a Speaker at the source, which sends along its local -Z as Speakers do, with an Empty, its receiver.
``place`` puts settings into transforms, ``pose`` reads them back as a scene file would have them; what the
pose is made of is not shown in the panel again (``posed`` of its kind).
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import bpy
import numpy as np

from ...sensing.kinds import KINDS
from ...spec import Sensor, SpecError
from ..scene.layout import SENSORS, below, find_part, is_local, part, root, shortest

KIND_KEY = "forest_sensor_kind"  # custom property of a sensor's object: its kind
RECEIVER_KEY = "forest_receiver"  # custom property of a reverb's source: its receiver
PATH_KEY = "forest_path"  # custom property of a moving scanner: the curve that was made for it

AZIMUTHS, ELEVATIONS = ("azimuth_deg", "heading_deg"), ("elevation_deg",)
BODIES = {"EMPTY", "SPEAKER"}  # types of the objects that sensors are
DEGREE_DIGITS = 4  # what single precision keeps of an angle: rounding gives 110 back


def new_sensor(scene: bpy.types.Scene, settings: Sensor) -> bpy.types.Object:
    """A new object for a sensor among the scene's sensors, placed where its settings say."""
    home, kind = part(scene, SENSORS), KINDS[settings.kind]
    if kind.body == "speaker":
        obj = _speaker(settings.name)
        receiver = _empty(f"{settings.name} receiver", "SPHERE")
        home.objects.link(receiver)
        obj[RECEIVER_KEY] = receiver
    else:
        obj = _empty(settings.name, "ARROWS")
    obj[KIND_KEY] = settings.kind
    # No moves by hand that would have no effect.
    obj.lock_location = (not kind.posed,) * 3
    obj.lock_rotation = tuple(axis not in kind.turns for axis in range(3))
    obj.lock_scale = (True,) * 3
    home.objects.link(obj)
    place(obj, settings)
    return obj


def put_sensor(scene: bpy.types.Scene, settings: Sensor) -> bpy.types.Object:
    """The object of a sensor: the one of its name and kind that the scene has, moved, or a new one."""
    for obj in sensors_of(scene):
        if file_name(obj.name) == settings.name and kind_of(obj) == settings.kind:
            place(obj, settings)
            return obj
    return new_sensor(scene, settings)


def new_path(
    scene: bpy.types.Scene, sensor: bpy.types.Object, points: list[tuple[float, float, float]]
) -> bpy.types.Object:
    """A sensor's own curve of straight pieces through ``points`` (m), its origin at the first."""
    name = f"{sensor.name} Path"
    data = bpy.data.curves.new(name, "CURVE")
    data.dimensions = "3D"
    line = data.splines.new("POLY")
    line.points.add(len(points) - 1)
    places = np.ones((len(points), 4))
    places[:, :3] = np.subtract(points, points[0])
    line.points.foreach_set("co", places.astype(np.float32).ravel())
    obj = bpy.data.objects.new(name, data)
    obj.location = points[0]
    part(scene, SENSORS).objects.link(obj)
    sensor[PATH_KEY] = obj
    sensor.location = obj.location
    return obj


def _speaker(name: str) -> bpy.types.Object:
    """A Speaker in no collection; one that plays on the timeline where Blender's operator can make it."""
    from ..show.sound import add_speaker

    if bpy.context.mode != "OBJECT":
        return bpy.data.objects.new(name, bpy.data.speakers.new(name))
    objects = bpy.context.view_layer.objects
    chosen, selected = objects.active, list(objects.selected)
    obj = add_speaker(name, (0.0, 0.0, 0.0))  # which selects it alone
    for one in objects:
        one.select_set(one in selected)
    objects.active = chosen
    for home in list(obj.users_collection):
        home.objects.unlink(obj)
    return obj


def remove_sensor(obj: bpy.types.Object) -> None:
    """Remove a sensor's object with its data; its receiver or path too, unless a copy of it has that."""
    data, gone = [obj.data], []
    for key in (RECEIVER_KEY, PATH_KEY):
        own = _held(obj, key)
        others = (other for other in bpy.data.objects if other != obj)
        if own is not None and not any(_held(other, key) == own for other in others):
            gone.append(own)
            data.append(own.data)
    for one in (obj, *gone):
        bpy.data.objects.remove(one)
    bpy.data.batch_remove([one for one in data if one is not None and not one.users])


def kind_of(obj: bpy.types.Object) -> str:
    """The kind of sensor that an object is, empty if it is none."""
    return str(obj.get(KIND_KEY, ""))


def file_name(name: str) -> str:
    """The name of an object as one of files: "echo.001" is echo-001."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in name)


def sensors_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The sensors of a scene, in the order of their names, in whatever collection they are.

    Those that are linked from another file, and those of another scene's forest, are not among them.
    """
    top = scene.collection
    sensors = {
        obj
        for home in (top, *below(top, root(scene) or top))
        for obj in home.objects
        if (KIND_KEY in obj and kind_of(obj) in KINDS and obj.type in BODIES and is_local(obj))
    }
    return sorted(sensors, key=lambda obj: obj.name)


def home_of(
    scene: bpy.types.Scene, known: Collection[bpy.types.Object] | None = None
) -> bpy.types.Collection | bpy.types.Scene | None:
    """A block whose ``objects`` are all sensors and perhaps others: the collection of the scene's sensors, or
    the scene where some are elsewhere; None where it has no sensor.

    known : ``sensors_of`` the scene, where the caller has them.
    """
    home = find_part(scene, SENSORS)
    there = set() if home is None else set(home.objects)
    return home if there.issuperset(sensors_of(scene) if known is None else known) else scene


def is_foreign(scene: bpy.types.Scene, obj: bpy.types.Object) -> bool:
    """Return whether a scene shows a sensor that it cannot run as it is: one that is linked from another
    file, is of another scene's forest, or whose receiver or path is in no collection here."""
    if obj.type not in BODIES or kind_of(obj) not in KINDS:
        return False
    return obj not in sensors_of(scene) or bool(_left_behind(scene, obj))


def adopt(scene: bpy.types.Scene, obj: bpy.types.Object) -> bpy.types.Object:
    """Make a sensor that a scene shows its own, or a copy of one of another scene's forest; return it.

    What it needs comes along. The receiver of a pasted reverb, for one, is in the file, and in no collection.
    """
    made = obj
    if not is_local(obj):
        made = obj.make_local() or obj
    elif obj not in sensors_of(scene):
        made = obj.copy()
    home = part(scene, SENSORS)
    if made not in sensors_of(scene):
        home.objects.link(made)
    for one in _left_behind(scene, made):
        home.objects.link(one if is_local(one) else one.make_local() or one)
    return made


def _left_behind(scene: bpy.types.Scene, obj: bpy.types.Object) -> list[bpy.types.Object]:
    """Needs of a sensor that the scene does not hold: its receiver, its path."""
    needed = (_held(obj, RECEIVER_KEY), _held(obj, PATH_KEY))
    return [one for one in needed if one is not None and scene.objects.get(one.name) != one]


def place(obj: bpy.types.Object, settings: Sensor) -> None:
    """Move and turn an object to where its settings say."""
    kind = KINDS[settings.kind]
    obj.rotation_mode = "XYZ"
    if kind.body == "speaker":  # it points where it faces, and its receiver is where one listens
        reverb: Any = settings
        up, turn = reverb.facing_elevation_deg, reverb.facing_azimuth_deg
        obj.location = reverb.source
        obj.rotation_euler = (math.radians(90 + up), 0.0, math.radians(turn - 90))
        if receiver := receiver_of(obj):
            receiver.location = reverb.receiver
        return
    azimuth, elevation = (
        next((getattr(settings, name) for name in names if name in kind.posed), 0.0)
        for names in (AZIMUTHS, ELEVATIONS)
    )
    obj.rotation_euler = (0.0, -math.radians(elevation), math.radians(azimuth))
    if "position" in kind.posed:
        obj.location = settings.position  # type: ignore[attr-defined]
    elif poses := getattr(settings, "poses", ()):
        obj.location = poses[0].position


def pose(obj: bpy.types.Object) -> dict[str, Any]:
    """The settings that an object's evaluated transform says.

    Raises
    ------
    SpecError : a reverb whose receiver is gone.
    """
    kind = KINDS[kind_of(obj)]
    if kind.body == "speaker":
        receiver = receiver_of(obj)
        if receiver is None:
            raise SpecError(obj.name, "its receiver is gone; choose an object as receiver")
        azimuth, elevation = _direction_of(obj, axis=2, sign=-1)
        return {
            "source": _place_of(obj),
            "receiver": _place_of(receiver),
            "facing_azimuth_deg": azimuth,
            "facing_elevation_deg": elevation,
        }
    settings: dict[str, Any] = {}
    if "position" in kind.posed:  # else it goes where its poses, or what it follows, say
        settings["position"] = _place_of(obj)
    azimuth, elevation = _direction_of(obj)
    settings |= {name: azimuth for name in AZIMUTHS if name in kind.posed}
    return settings | {name: elevation for name in ELEVATIONS if name in kind.posed}


def heading(obj: bpy.types.Object) -> float:
    """Azimuth of an object's X axis, degrees from +X towards +Y."""
    return _direction_of(obj)[0]


def receiver_of(obj: bpy.types.Object) -> bpy.types.Object | None:
    """The object that hears what a reverb's source sends, None where it is gone."""
    return _held(obj, RECEIVER_KEY)


def _held(obj: bpy.types.Object, key: str) -> bpy.types.Object | None:
    """The object that a custom property points to, None where there is none."""
    held = obj.get(key)
    return held if isinstance(held, bpy.types.Object) else None


def _empty(name: str, shape: str) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, None)
    obj.empty_display_type = shape
    obj.empty_display_size = 0.6
    obj.show_in_front = obj.show_name = True
    return obj


def _place_of(obj: bpy.types.Object) -> tuple[float, float, float]:
    x, y, z = (shortest(value) for value in obj.matrix_world.translation)
    return x, y, z


def _direction_of(obj: bpy.types.Object, axis: int = 0, sign: int = 1) -> tuple[float, float]:
    """Azimuth and elevation of an object's local X axis, or of another, degrees."""
    x, y, z = sign * np.array(obj.matrix_world, dtype=np.float64)[:3, axis]
    azimuth = math.degrees(math.atan2(y, x))
    elevation = math.degrees(math.atan2(z, math.hypot(x, y)))
    return round(azimuth, DEGREE_DIGITS) + 0.0, round(elevation, DEGREE_DIGITS) + 0.0  # no -0.0
