"""Presets of sensors, plantings and the wind, in Blender's own preset menu.

A preset is a file in the user's folder of presets, as every one of Blender's is: a line of Python with all
settings but those that say where something is. A file of an earlier version leaves what it does not know
as it is set by default.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ... import spec
from ...blender.sensors import objects as sensors
from ...sensing.kinds import KINDS
from ...spec import SpecError
from ..shell.chosen import chosen_planting, chosen_sensor
from ..shell.running import PROBLEMS, in_words
from ..shell.words import say
from . import exchange, references

FOLDER = "forest_sensing"
PLACES = {"gaussians", "rasters", "painted", "polygon", "holes", "trees", "collection"}
PLACES |= {"by_hand", "clearings"}
ENDS = {"sources", "receivers", "source_path", "receiver_path", "poses", "follow"}


@dataclass(frozen=True)
class PresetKind:
    """Kind of thing that presets are of: a kind of sensor, a planting or the wind.

    left : settings that stay as they are. group : the properties of the one that is chosen, None where there
    is none.
    """

    name: str
    title: str
    settings: type[spec.Settings]
    left: frozenset[str]
    group: Callable[[bpy.types.Context], Any]

    @property
    def names(self) -> tuple[str, ...]:
        """The settings that a preset holds."""
        return tuple(f.name for f in fields(self.settings) if f.name not in self.left)  # type: ignore[arg-type]


def kinds() -> dict[str, PresetKind]:
    """Return all kinds, by name."""
    found = {
        "planting": PresetKind(
            *("planting", "Planting Presets", spec.Planting, frozenset(PLACES)),
            lambda context: chosen_planting(context.scene.forest_sensing),
        ),
        "wind": PresetKind(
            *("wind", "Wind Presets", spec.Wind, frozenset()),
            lambda context: context.scene.forest_sensing.wind,
        ),
    }
    for name, settings in spec.SENSORS.items():
        of_place = {"kind", "name", *KINDS[name].posed, *ENDS, *references.REFERENCES}
        left = frozenset(of_place & {f.name for f in fields(settings)})  # type: ignore[arg-type]
        found[name] = PresetKind(name, "Sensor Presets", settings, left, _of_sensor(name))
    return found


def values_of(kind: PresetKind, context: bpy.types.Context) -> dict[str, Any]:
    """The settings of the chosen one that a preset keeps, as a table of a scene file.

    Raises
    ------
    SpecError : a value that cannot be used.
    """
    from ...formats.toml_file import table_of

    table = table_of(_read(kind, context), whole=True)
    return {name: table[name] for name in kind.names if name in table}


def apply(kind: PresetKind, context: bpy.types.Context, values: dict[str, Any]) -> None:
    """Set the chosen one as a preset says; what the preset does not say is as it is by default.

    Raises
    ------
    SpecError : a value that cannot be used; nothing is changed.
    """
    from ...formats.toml_file import structure, table_of

    now = table_of(_read(kind, context), whole=True)
    kept = {name: now[name] for name in kind.left if name in now}
    known = {name: value for name, value in values.items() if name in kind.names}
    settings = structure(kept | known, kind.settings, Path(context.scene.forest_sensing.folder))
    exchange.write(kind.group(context), settings, dict.fromkeys(kind.names))
    context.scene.update_tag()


def draw_presets(layout: bpy.types.UILayout, name: str) -> None:
    """The button in a panel's header that opens the menu of presets."""
    panel = getattr(bpy.types, f"FOREST_PT_presets_{name}", None)
    if panel is not None:
        panel.draw_panel_header(layout)


class FOREST_OT_apply_preset(bpy.types.Operator):
    """Set the chosen sensor or planting, or the wind, as a preset says"""

    bl_idname = "forest.apply_preset"
    bl_label = "Apply Preset"
    bl_options: ClassVar[set[str]] = {"INTERNAL", "UNDO"}

    kind: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]
    values: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        kind = kinds().get(self.kind)
        if kind is None or kind.group(context) is None:
            self.report({"ERROR"}, say("Choose what the preset is for first"))
            return {"CANCELLED"}
        try:
            apply(kind, context, json.loads(self.values))
        except PROBLEMS as problem:  # json's are ValueErrors
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        return {"FINISHED"}


def _read(kind: PresetKind, context: bpy.types.Context) -> spec.Settings:
    if kind.name in spec.SENSORS:
        return exchange.sensor_of(chosen_sensor(context))
    return exchange.read(kind.group(context), kind.settings)


def _of_sensor(name: str) -> Callable[[bpy.types.Context], Any]:
    def group(context: bpy.types.Context) -> Any:
        thing = chosen_sensor(context)
        if thing is None or sensors.kind_of(thing) != name:
            return None
        return getattr(thing.forest_sensor, name)

    return group


class _PresetButton(AddPresetBase):
    """Base of the operators that keep the chosen one's settings as a preset, or remove one."""

    kind: ClassVar[str]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if kinds()[cls.kind].group(context) is None:
            cls.poll_message_set(say("Choose what the preset is for first"))
            return False
        return True

    def add(self, context: bpy.types.Context, path: str) -> None:
        """Write the file of a preset; Blender calls it."""
        from ...formats.atomic import replacing

        try:
            values = json.dumps(values_of(kinds()[self.kind], context))
        except SpecError as problem:
            self.report({"ERROR"}, in_words(problem))
            return
        given = ", ".join((f"kind={self.kind!r}", f"values={values!r}"))
        lines = ("import bpy", "", f"bpy.ops.forest.apply_preset({given})", "")
        with replacing(Path(path)) as partial:
            partial.write_text("\n".join(lines), encoding="utf-8")


def _classes(kind: PresetKind) -> tuple[type, type]:
    """The panel of a kind's presets, and the operator that adds and removes them."""
    folder, name = f"{FOLDER}/{kind.name}", f"FOREST_PT_presets_{kind.name}"
    panel = type(
        name,
        (PresetPanel, bpy.types.Panel),
        {
            "__doc__": "Choose a preset, keep the settings as one, or remove one",
            "bl_label": kind.title,
            "preset_subdir": folder,
            "preset_operator": "script.execute_preset",
            "preset_add_operator": f"forest.preset_{kind.name}",
        },
    )
    add = type(
        f"FOREST_OT_preset_{kind.name}",
        (_PresetButton, bpy.types.Operator),
        {
            "__doc__": "Keep these settings as a preset, or remove one",
            "bl_idname": f"forest.preset_{kind.name}",
            "bl_label": "Add Preset",
            "preset_menu": name,
            "preset_subdir": folder,
            "kind": kind.name,
        },
    )
    return add, panel


CLASSES = (FOREST_OT_apply_preset, *(cls for kind in kinds().values() for cls in _classes(kind)))
