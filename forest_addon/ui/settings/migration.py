"""Files that an older version saved: what they hold is brought to how it is kept today, step by step.

A scene that is saved says which layout its settings have: 3, or 2, which knew what it named by names
alone. One that says nothing has 2, or that of the panel before it, 1, which kept one sensor of each kind in
the scene. Settings are read as they were stored, because what registers today no longer knows them. What
could not be carried over stands in the panel until the user takes note, and in the console. A file without
settings of ours is left alone.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import bpy

from ... import spec
from ...blender.read.single import shortest
from ...blender.scene import layout
from ...blender.scene.ours import MADE_KEY
from ...blender.sensors import objects as sensors
from ...spec import Settings, SpecError
from ..shell.running import Button
from ..shell.words import say
from . import exchange, references
from .groups import fields_of

LAYOUT = 3  # how a scene keeps its settings now
KEY = "forest_sensing"  # of the scene's settings, as Blender stores them

# The first panel: its sensors, what then was other than today, and the marks where they stood.
FIRST_KINDS = ("tractor", "terrestrial", "sonar", "reverb")
FIRST_CHOICES = {("sonar", "leaf_model"): ("piston", "paper")}
FIRST_DEFAULTS = {"sonar": {"leaf_model": "piston"}}
FIRST_MARK = "forest_sensor"

log = logging.getLogger(__name__)


def migrate(scene: bpy.types.Scene) -> None:
    """Bring the settings of a scene to today's layout; nothing happens where it has it, or has none."""
    stored = _stored(scene)
    if stored is None or not _holds_values(stored) or not scene.is_editable:
        return
    found = stored.get("layout") or (1 if any(kind in stored for kind in FIRST_KINDS) else 2)
    if found > LAYOUT:
        _tell(
            scene,
            say("Saved by a newer version"),
            [
                say(
                    "it keeps settings in layout {found}, this version knows {known}: what is new in it "
                    "has no effect here. Update Forest Sensing",
                    found=found,
                    known=LAYOUT,
                )
            ],
        )
    for step in range(found, LAYOUT):
        said = STEPS[step](scene, stored)
        if said:
            _tell(scene, say("Saved by an older version"), said)


class FOREST_OT_take_note(Button, bpy.types.Operator):
    """Remove this message"""

    bl_idname = "forest.take_note"
    bl_label = "Dismiss"

    @classmethod
    def description(cls, context: bpy.types.Context, _properties: Any) -> str:
        notice = context.scene.forest_sensing.notice
        return say("{notice}. Press to take this line away", notice=notice)

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        reason = super().obstacle(context)
        if not reason and not context.scene.forest_sensing.notice:
            reason = say("There is nothing to take note of")
        return reason

    def act(self, context: bpy.types.Context) -> str:
        context.scene.forest_sensing.property_unset("notice")
        return ""


def draw_notice(panel: bpy.types.UILayout, props: Any) -> None:
    """One line of what happened to this file, with the button that takes it away."""
    row = panel.row(align=True)
    row.label(text=props.notice.partition(":")[0], icon="INFO")
    row.operator("forest.take_note", text="", icon="X")


def register() -> None:
    """Look at every file that is loaded or appended, and mark those that are saved."""
    for handlers, handler in _handlers():
        handlers.append(handler)
    bpy.app.timers.register(_look_at_all, first_interval=0.0)  # at the file that is open by now


def unregister() -> None:
    """Take the handlers back."""
    for handlers, handler in _handlers():
        if handler in handlers:
            handlers.remove(handler)
    if bpy.app.timers.is_registered(_look_at_all):
        bpy.app.timers.unregister(_look_at_all)


def _handlers() -> tuple[tuple[list, Callable[..., None]], ...]:
    handlers = bpy.app.handlers
    return (
        (handlers.load_post, _look_at_all),
        (handlers.blend_import_post, _look_at_all),
        (handlers.save_pre, _sign),
    )


@bpy.app.handlers.persistent
def _look_at_all(*_: object) -> None:
    for scene in bpy.data.scenes:
        migrate(scene)


@bpy.app.handlers.persistent
def _sign(*_: object) -> None:
    """Note today's layout in every scene that is about to be saved with settings of ours."""
    for scene in bpy.data.scenes:
        stored = _stored(scene)
        if stored is not None and scene.is_editable and _holds_values(stored):
            props = scene.forest_sensing
            props.layout = max(LAYOUT, props.layout)
            references.renew_texts(_groups_that_name(scene))


def _tell(scene: bpy.types.Scene, what: str, sentences: list[str]) -> None:
    notice = f"{what}: {'; '.join(sentences)}"
    scene.forest_sensing.notice = notice
    log.warning("Forest Sensing, scene %s. %s", scene.name, notice)


def _stored(scene: bpy.types.Scene) -> Any:
    """Settings of ours as Blender stores them, None where there are none."""
    if hasattr(
        scene, "bl_system_properties_get"
    ):  # Blender 5 keeps them apart from custom properties
        home = scene.bl_system_properties_get()
        return None if home is None else home.get(KEY)
    return scene.get(KEY)


def _holds_values(stored: Any) -> bool:
    """Return whether anything was set: to draw a panel makes empty groups."""
    return any(
        _holds_values(value) if hasattr(value, "keys") else True for value in stored.values()
    )


# ------------------------------------------------------------------------ the first panel, layout 1


def _sensors_become_objects(scene: bpy.types.Scene, stored: Any) -> list[str]:
    """The first panel kept one sensor of each kind in the scene, and marked in the view where it was."""
    said = []
    _adopt(scene)
    for kind in FIRST_KINDS:
        sensor, problem = _first_sensor(kind, stored.get(kind, {}))
        if problem:
            said.append(problem)
        thing = exchange.add_sensor(scene, sensor)
        result = scene.forest_sensing.results.get(kind)
        if result is not None:
            result.name, result.kind, result.title = thing.name, kind, thing.name
        if kind in stored:
            del stored[kind]
    forest = scene.forest_sensing.results.get("forest")
    if forest is not None:
        forest.kind = "forest"
    if hasattr(scene, "bl_system_properties_get"):
        scene.pop(KEY, None)  # the copy that Blender 5 leaves among the custom properties
    objects = say("sensors are objects now, one of each kind, with the settings that they had")
    return [objects, *said]


def _first_sensor(kind: str, stored: Any) -> tuple[Settings, str]:
    """The settings of a sensor of the first panel, and what of them could not be used, in a sentence."""
    cls = spec.SENSORS[kind]
    given = dict(FIRST_DEFAULTS.get(kind, {}))
    for name, type_, known, _ in fields_of(cls):
        if name in stored:
            choices = FIRST_CHOICES.get((kind, name), known.choices)
            given[name] = choices[stored[name]] if choices else _plain(stored[name], type_)
    try:
        settings = cls(**given)
    except SpecError as problem:
        because = say(
            "{sensor} has default settings, because {problem}", sensor=kind, problem=problem
        )
        return cls(), because
    if "reflectance" in stored:  # of everything alike
        share = shortest(stored["reflectance"])
        alike = dict.fromkeys(("other", "wood", "leaf", "ground"), share)
        settings = replace(settings, surfaces=replace(settings.surfaces, **alike))
    return settings, ""


def _plain(value: Any, type_: Any) -> Any:
    if type_ in (bool, int, str):
        return type_(value)
    return shortest(value) if type_ is float else tuple(shortest(number) for number in value)


def _adopt(scene: bpy.types.Scene) -> None:
    """Sign what the first panel built, so that the next forest takes its place; marks of sensors go."""
    top = layout.root(scene)
    if top is None:
        return
    for home in top.children:
        for part in (layout.TREES, layout.GROUND_NAME, layout.SENSORS, layout.RESULTS):
            if home.name.startswith(part):
                home[layout.PART_KEY] = part
    for home in (top, *top.children_recursive):
        home[MADE_KEY] = home.name
        for thing in list(home.objects):
            if FIRST_MARK in thing:
                bpy.data.objects.remove(thing)
            elif _was_built(thing, home):
                thing[MADE_KEY] = thing.name


def _was_built(thing: bpy.types.Object, home: bpy.types.Collection) -> bool:
    """Return whether a tree, points that were found, or the ground; else the user put it there."""
    from ...blender.read.depsgraph import TREE_KEY  # brings in scipy, which no other file needs

    ground = home.get(layout.PART_KEY) == layout.GROUND_NAME and thing.name.startswith("Ground")
    return TREE_KEY in thing or layout.CLOUD_KEY in thing or ground


# --------------------------------------------------------------------------------------- layout 2


def _names_become_pointers(scene: bpy.types.Scene, _stored: Any) -> list[str]:
    """Give pointers to settings that named things. A tripod that was turned, which had no effect, is
    turned back."""
    references.resolve_all(_groups_that_name(scene))
    said = []
    for thing in sensors.sensors_of(scene):
        sensors.lock(thing)
        if sensors.kind_of(thing) != "terrestrial":
            continue
        if thing.parent is None and not thing.animation_data and not thing.constraints:
            thing.rotation_euler = (0.0, 0.0, 0.0)
        else:
            said.append(
                say("{sensor} scans the way that its object is turned now", sensor=thing.name)
            )
    return said


def _groups_that_name(scene: bpy.types.Scene) -> Iterator[Any]:
    """Every group of a scene's settings that names something of it."""
    props = scene.forest_sensing
    yield props.forest.terrain
    yield from props.plantings
    for thing in sensors.sensors_of(scene):
        yield getattr(thing.forest_sensor, sensors.kind_of(thing))


STEPS: dict[int, Callable[[bpy.types.Scene, Any], list[str]]] = {
    1: _sensors_become_objects,
    2: _names_become_pointers,
}
