"""Settings that name something of the Blender scene: a pointer beside each name, which outlives a rename.

Scene files say names, and so does the text that a .blend has had since there are such settings. Where a name
is found, the pointer holds what it means, and the name is read from that; a name that nothing has yet stays a
text. Several objects, whose names a text parts by commas, are a list of pointers. Where a species or
a scanner is typed, names are offered. A file is chosen in the file browser; Blender's ``//``
becomes a whole path, which scene files understand.

A scene that is saved says what things are called now, and which layout its settings have. A later layout than
this version knows is told in the panel until the user takes note, and in the console. A file without settings
of ours is left alone.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from typing import Any

import bpy
from bpy.props import CollectionProperty, IntProperty, PointerProperty, StringProperty

from ...base.places import ASSETS
from ...blender.scene.instances import SOLID_TYPES, SPECIES_KEY
from ...blender.sensors import objects as sensors
from ...blender.show.intensity import HANDLE_KEY
from ...formats.toml_file import read_scanner, scanner_names
from ...spec import Param, SpecError
from ..shell.running import Button, button
from ..shell.words import keep, say


@dataclass(frozen=True)
class Reference:
    """Reference to a thing of the scene. many : several of them. layered : NAME:LAYER names a layer of it."""

    fits: Callable[[Any, Any], bool]
    of: type = bpy.types.Object
    many: bool = False
    layered: bool = False


def _is_ground(_group: Any, obj: Any) -> bool:
    return obj.type in SOLID_TYPES and SPECIES_KEY not in obj


HEARD_TYPES = {"source_objects": {"SPEAKER"}, "receiver_objects": {"EMPTY", "CAMERA"}}
REFERENCES = {
    "object": Reference(_is_ground),
    "painted": Reference(_is_ground, layered=True),
    "collection": Reference(lambda _group, _home: True, of=bpy.types.Collection),
    "follow": Reference(
        lambda _group, obj: bool(
            obj.type == "CURVE" or obj.animation_data or obj.parent or obj.constraints
        )
    ),
    **{name: Reference(lambda _group, _thing: True, many=True) for name in HEARD_TYPES},
}

_busy = False  # a name or a pointer is set to follow the other


class FOREST_PG_heard(bpy.types.PropertyGroup):
    """One of several objects; ``name`` is what it was called, for as long as there is none."""

    thing: PointerProperty(
        type=bpy.types.Object,
        name="Object",
        poll=lambda _item, obj: (
            obj.type in {"SPEAKER", "EMPTY", "CAMERA"} and HANDLE_KEY not in obj
        ),
        update=lambda _item, _context: None,  # or Blender reports no change
    )


def pointers(name: str, words: dict[str, Any]) -> dict[str, Any]:
    """The properties that a group holds beside the text of this setting."""
    known = REFERENCES[name]
    if known.many:
        return {
            f"{name}_pointers": CollectionProperty(type=FOREST_PG_heard),
            f"active_{name}_pointers": IntProperty(
                name="Chosen", description="The one that is picked below", options={"HIDDEN"}
            ),
        }
    made = {
        f"{name}_pointer": PointerProperty(
            type=known.of,
            **words,
            poll=known.fits,
            update=lambda group, _context: _say_name(group, name),
        )
    }
    if known.layered:
        made[f"{name}_layer"] = StringProperty(
            name="Layer",
            description="Vertex group or attribute with the weights; none: the active one",
            search=_layers,
            search_options={"SUGGESTION"},
            update=lambda group, _context: _say_name(group, name),
        )
    return made


def resolver(name: str) -> Callable[[Any, Any], None]:
    """Callback for when the text of this setting is set."""
    return lambda group, _context: resolve(group, name)


def resolve(group: Any, name: str) -> None:
    """Find what a text means; it was set."""
    global _busy
    if _busy:
        return
    _busy = True
    try:
        _find(group, name)
    finally:
        _busy = False


def name_of(group: Any, name: str, key: str = "") -> str:
    """Present name of what a setting names.

    Raises
    ------
    SpecError : it was deleted; with the setting's ``key``.
    """
    text = str(getattr(group, name))
    if REFERENCES[name].many:
        items = getattr(group, f"{name}_pointers")
        for item in items:
            _check(key or name, item.thing)
        return _names_in(items) if any(item.thing for item in items) else text
    obj = getattr(group, f"{name}_pointer")
    if obj is None:
        return text
    _check(key or name, obj)
    layer = getattr(group, f"{name}_layer", "")
    return f"{obj.name}:{layer}" if layer else str(obj.name)


def is_lost(group: Any, name: str) -> bool:
    """Return whether a text names what is not in this file."""
    return bool(getattr(group, name)) and getattr(group, f"{name}_pointer") is None


def listed_anew(group: Any, name: str) -> None:
    """An object was added to several ones or taken away."""
    _set_text(group, name, _names_in(getattr(group, f"{name}_pointers")))


def _names_in(items: Any) -> str:
    names = (item.thing.name if item.thing else item.name for item in items)
    return ", ".join(filter(None, names))


def _check(key: str, obj: Any) -> None:
    """One that was deleted lives on for the pointer's sake alone."""
    if isinstance(obj, bpy.types.Object) and not obj.users_collection:
        raise SpecError(key, say('"{name}" was deleted; choose another, or none', name=obj.name))


def _find(group: Any, name: str) -> None:
    known, text = REFERENCES[name], getattr(group, name)
    if known.many:
        items = getattr(group, f"{name}_pointers")
        items.clear()
        for part in filter(None, (part.strip() for part in text.split(","))):
            item = items.add()
            item.name, item.thing = part, bpy.data.objects.get(part)
        return
    every = bpy.data.collections if known.of is bpy.types.Collection else bpy.data.objects
    holder, layer = text, ""
    if known.layered and text not in every:
        holder, _, layer = text.rpartition(":")
    target = every.get(holder)
    if getattr(group, f"{name}_pointer") != target:
        setattr(group, f"{name}_pointer", target)
    if known.layered:
        setattr(group, f"{name}_layer", layer if target is not None else "")


def _say_name(group: Any, name: str) -> None:
    """A pointer or its layer was set."""
    if not _busy:
        obj = getattr(group, f"{name}_pointer")
        layer = getattr(group, f"{name}_layer", "")
        text = "" if obj is None else f"{obj.name}:{layer}" if layer else obj.name
        _set_text(group, name, text)


def _set_text(group: Any, name: str, text: str) -> None:
    global _busy
    _busy = True
    try:
        setattr(group, name, text)
    finally:
        _busy = False


def _layers(group: Any, _context: Any, typed: str) -> list[str]:
    obj = group.painted_pointer
    known = layers_of(obj) if obj is not None else ()
    return [name for name in known if typed.lower() in name.lower()]


def layers_of(obj: bpy.types.Object) -> list[str]:
    """Vertex groups, and attributes of numbers with a fraction or of colours."""
    names = [known.name for known in obj.vertex_groups]
    if obj.type == "MESH":
        names += [a.name for a in obj.data.color_attributes]
        of_points = [a for a in obj.data.attributes if a.domain != "EDGE" and not a.is_internal]
        names += [a.name for a in of_points if a.data_type == "FLOAT"]
    return list(dict.fromkeys(names))


SPECIES = ASSETS / "species"


def offered(name: str, known: Param) -> dict[str, Any]:
    """Options of a text's property by which something is offered for it; nothing for a free
    text."""
    if name in SEARCHES:
        return {"search": SEARCHES[name], "search_options": {"SUGGESTION"}}
    if known.file:
        return {"subtype": "FILE_PATH", "update": lambda group, _: _whole_path(group, name)}
    return {}


def _whole_path(group: Any, name: str) -> None:
    path = getattr(group, name)
    if path.startswith("//"):
        setattr(group, name, bpy.path.abspath(path))


def _species(group: Any, context: Any, typed: str) -> list[str]:
    """Presets and what is edited here; for distances what is planted, as the report names it."""
    props = context.scene.forest_sensing
    if type(group).__name__ == "FOREST_PG_distance":
        return _planted(group, context, typed)
    presets = sorted(path.stem for path in SPECIES.glob("*.toml"))
    return _matching([*(item.name for item in props.edited), *presets], typed)


def _planted(_group: Any, context: Any, typed: str) -> list[str]:
    from ...stand.plan import labels

    return _matching(labels(context.scene.forest_sensing.plantings), typed)


def _scanners(group: Any, _context: Any, typed: str) -> list[str]:
    """Presets that are used on this platform."""
    kind = type(group).__name__.removeprefix("FOREST_PG_")
    return [n for n in _matching(scanner_names(), typed) if kind in read_scanner(n).tables]


def _matching(names: Iterable[str], typed: str) -> list[str]:
    return [name for name in names if typed.lower() in name.lower()]


SEARCHES = {
    "species": _species,
    "other": _planted,
    "scanner": _scanners,
}


LAYOUT = 3  # how a scene keeps its settings
KEY = "forest_sensing"  # of the scene's settings, as Blender stores them

log = logging.getLogger(__name__)


NOTICED = (
    lambda context: context.scene.forest_sensing.notice,
    keep("There is nothing to take note of"),
)


def _help_of_note(_cls: type, context: bpy.types.Context, _properties: Any) -> str:
    notice = context.scene.forest_sensing.notice
    return say("{notice}. Press to take this line away", notice=notice)


@button("Dismiss", Button, needs=(NOTICED,), description=classmethod(_help_of_note))
def take_note(_button: Button, context: bpy.types.Context) -> str:
    """Remove this message"""
    context.scene.forest_sensing.property_unset("notice")
    return ""


def register() -> None:
    """Look at the file that is open by now."""
    bpy.app.timers.register(_look_at_all, first_interval=0.0)


def unregister() -> None:
    """Look at it no longer."""
    if bpy.app.timers.is_registered(_look_at_all):
        bpy.app.timers.unregister(_look_at_all)


@bpy.app.handlers.persistent
def _look_at_all(*_: object) -> None:
    """Tell of scenes that a newer version has saved."""
    for scene in bpy.data.scenes:
        if not scene.is_editable or not _has_settings(scene):
            continue
        if scene.forest_sensing.layout > LAYOUT:
            notice = say(
                "Saved by a newer version: it keeps settings in layout {found}, this version knows {known}: "
                "what is new in it has no effect here. Update Forest Sensing",
                found=scene.forest_sensing.layout,
                known=LAYOUT,
            )
            scene.forest_sensing.notice = notice
            log.warning("Forest Sensing, scene %s. %s", scene.name, notice)


@bpy.app.handlers.persistent
def _sign(*_: object) -> None:
    """Note today's layout in every scene that is about to be saved with settings of ours."""
    for scene in bpy.data.scenes:
        if scene.is_editable and _has_settings(scene):
            props = scene.forest_sensing
            props.layout = max(LAYOUT, props.layout)
            things = sensors.sensors_of(scene)
            of_sensors = (getattr(t.forest_sensor, sensors.kind_of(t)) for t in things)
            for group, name in product(
                ([props.forest.terrain, *props.plantings, *of_sensors]), REFERENCES
            ):
                if {f"{name}_pointer", f"{name}_pointers"} & set(group.bl_rna.properties.keys()):
                    with suppress(SpecError):
                        text = name_of(group, name)
                        if getattr(group, name) != text:
                            _set_text(group, name, text)


def _has_settings(scene: bpy.types.Scene) -> bool:
    """Return whether settings of ours are stored in a scene and any was set."""
    # Blender 5 keeps them apart from custom properties
    apart = hasattr(scene, "bl_system_properties_get")
    home = scene.bl_system_properties_get() if apart else scene
    stored = None if home is None else home.get(KEY)
    return stored is not None and _holds_values(stored)


def _holds_values(stored: Any) -> bool:
    """Return whether anything was set: to draw a panel makes empty groups."""
    return any(
        _holds_values(value) if hasattr(value, "keys") else True for value in stored.values()
    )


HANDLERS = (
    ("load_post", _look_at_all),
    ("blend_import_post", _look_at_all),
    ("save_pre", _sign),
)
