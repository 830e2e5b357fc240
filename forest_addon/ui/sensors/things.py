"""Objects of the scene as sensors see them: whether they are seen, and how much light they send back.

Both stay what they are without the add-on, custom properties of the object (``blender/depsgraph``); here they
get names, limits and help.
"""

from __future__ import annotations

from typing import Any

import bpy

from ... import spec
from ...blender.scene.layout import CLOUD_KEY
from ...blender.scene.standings import IGNORED_KEY, REFLECTANCE_KEY, SOLID_TYPES
from ...blender.sensors import objects as sensors

OTHERWISE = spec.Surfaces().other  # reflectance that an object's own starts with


def seen_thing(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object, if sensors could see it."""
    thing = context.object
    solid = thing is not None and thing.type in SOLID_TYPES
    return thing if solid and not sensors.kind_of(thing) else None


def is_unrendered(thing: bpy.types.Object) -> bool:
    """Return whether sensors meet an object that renders do not show: they see what views show."""
    hidden = thing.hide_render and thing.visible_get() and CLOUD_KEY not in thing
    return hidden and _is_seen(thing) and thing.type in SOLID_TYPES


def _is_seen(thing: Any) -> bool:
    return not thing.get(IGNORED_KEY, False)


def _set_seen(thing: Any, seen: bool) -> None:
    _say(thing, IGNORED_KEY, None if seen else True)


def _has_reflectance(thing: Any) -> bool:
    return REFLECTANCE_KEY in thing


def _set_has_reflectance(thing: Any, has: bool) -> None:
    _say(thing, REFLECTANCE_KEY, _reflectance(thing) if has else None)


def _reflectance(thing: Any) -> float:
    value = thing.get(REFLECTANCE_KEY)
    return value if isinstance(value, int | float) else OTHERWISE


def _set_reflectance(thing: Any, value: float) -> None:
    _say(thing, REFLECTANCE_KEY, min(max(value, 0.0), 1.0))


def _say(thing: Any, key: str, value: Any) -> None:
    if value is not None:
        thing[key] = value
    elif key in thing:
        del thing[key]
    thing.update_tag()  # what was read of the scene is read again


PROPERTIES = {
    "forest_seen": bpy.props.BoolProperty(
        name="Seen by Sensors",
        description="LiDAR, sonar and reverb meet this object; off: they pass through it",
        get=_is_seen,
        set=_set_seen,
    ),
    "forest_reflects": bpy.props.BoolProperty(
        name="Own Reflectance",
        description="LiDAR takes this object's reflectance, not that of the scanner's surfaces",
        get=_has_reflectance,
        set=_set_has_reflectance,
    ),
    "forest_reflected": bpy.props.FloatProperty(
        name="Reflectance",
        description="Share of the light that this object sends back (Lambert); a material that has the "
        "custom property forest_reflectance comes first",
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        get=_reflectance,
        set=_set_reflectance,
    ),
}


def register() -> None:
    """Give objects these properties."""
    for name, prop in PROPERTIES.items():
        setattr(bpy.types.Object, name, prop)


def unregister() -> None:
    """Take them back; what they have set stays with the objects."""
    for name in PROPERTIES:
        if hasattr(bpy.types.Object, name):
            delattr(bpy.types.Object, name)
