"""Objects of the scene as sensors see them: whether they are seen, how much light they send back, and whether
they are mirrors, glass or water.

All of it stays what it is without the add-on, custom properties of the object (``blender/read``); here it
gets names, limits and help.
"""

from __future__ import annotations

from typing import Any

import bpy

from ... import spec
from ...blender.scene.instances import IGNORED_KEY, REFLECTANCE_KEY, SOLID_TYPES
from ...blender.scene.layout import CLOUD_KEY
from ...blender.sensors import objects as sensors
from ...spec.choices import meaning_of, title_of

KIND_KEY, INDEX_KEY, SHARE_KEY, GAIN_KEY = (
    spec.property_of(name) for name in ("optics", "index", "mirror", "gain")
)
KINDS = ("", *spec.POLISHED)
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


def _kind(thing: Any) -> int:
    kind = thing.get(KIND_KEY, "")
    return KINDS.index(kind) if kind in KINDS else 0


def _set_kind(thing: Any, number: int) -> None:
    _say(thing, KIND_KEY, KINDS[number] or None)


def _index(thing: Any) -> float:
    value = thing.get(INDEX_KEY)
    usual = spec.USUAL_INDEX.get(KINDS[_kind(thing)], 1.0)
    return value if isinstance(value, int | float) and value >= 1 else usual


def _set_index(thing: Any, value: float) -> None:
    _say(thing, INDEX_KEY, min(max(value, 1.0), 5.0))


def _share(thing: Any) -> float:
    value = thing.get(SHARE_KEY)
    return value if isinstance(value, int | float) else spec.Polished().mirror


def _set_share(thing: Any, value: float) -> None:
    _say(thing, SHARE_KEY, min(max(value, 0.0), 1.0))


def _gain(thing: Any) -> float:
    value = thing.get(GAIN_KEY)
    return value if isinstance(value, int | float) else spec.Polished().gain


def _set_gain(thing: Any, value: float) -> None:
    _say(thing, GAIN_KEY, max(value, 1.0))


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
        get=_kind,
        set=_set_kind,
    ),
    "forest_refraction": bpy.props.FloatProperty(
        name="Index",
        description="Refractive index of the glass or the water",
        min=1.0,
        max=5.0,
        get=_index,
        set=_set_index,
    ),
    "forest_mirrored": bpy.props.FloatProperty(
        name="Sends On",
        description="Share of the light that the mirror sends on",
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        get=_share,
        set=_set_share,
    ),
    "forest_gained": bpy.props.FloatProperty(
        name="Gain",
        description="Light that the retro-reflector sends back, of that of a white surface",
        min=1.0,
        max=1e6,
        soft_max=5000.0,
        get=_gain,
        set=_set_gain,
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
