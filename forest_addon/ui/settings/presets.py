"""Presets of sensors, plantings and the wind, in Blender's own preset menu.

A preset is a file in the user's folder of presets, as every one of Blender's is: a line of Python with all
settings but those that say where something is. A file of an earlier version leaves what it does not know
as it is set by default.
"""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ... import spec
from ...formats.atomic import replacing
from ...formats.toml_file import structure, table_of
from ...sensing.kinds import KINDS
from ...spec import SpecError
from ..shell.running import Reading, button, in_words
from ..shell.views import chosen_planting, chosen_sensor, chosen_settings
from ..shell.words import say
from . import exchange, references
from .drawing import is_narrow

FOLDER = "forest_sensing"
PLACES = {
    *("gaussians", "rasters", "painted", "polygon", "holes", "trees", "collection"),
    *("by_hand", "clearings"),
}
ENDS = {"sources", "receivers", "source_path", "receiver_path", "poses", "follow"}


TITLES = {"planting": "Planting Presets", "wind": "Wind Presets"}
SETTINGS: dict[str, type[spec.Settings]] = {
    "planting": spec.Planting,
    "wind": spec.Wind,
    **spec.SENSORS,
}


def group_of(kind: str, context: bpy.types.Context) -> Any:
    """The properties that a preset of a kind is of: the chosen ones, None where there are none."""
    props = context.scene.forest_sensing
    if kind in spec.SENSORS:
        return chosen_settings(context, kind)
    return props.wind if kind == "wind" else chosen_planting(props)


def values_of(kind: str, context: bpy.types.Context) -> dict[str, Any]:
    """The settings of the chosen one that a preset keeps, as a table of a scene file.

    Raises
    ------
    SpecError : a value that cannot be used.
    """
    return {name: value for name, value in _table(kind, context).items() if _is_kept(kind, name)}


def apply(kind: str, context: bpy.types.Context, values: dict[str, Any]) -> None:
    """Set the chosen one as a preset says; what the preset does not say is as it is by default.

    Raises
    ------
    SpecError : a value that cannot be used; nothing is changed.
    """
    names = [f.name for f in fields(SETTINGS[kind]) if _is_kept(kind, f.name)]  # type: ignore[arg-type]
    left = {n: value for n, value in _table(kind, context).items() if n not in names}
    known = {name: values[name] for name in names if name in values}
    settings = structure(left | known, SETTINGS[kind], Path(context.scene.forest_sensing.folder))
    exchange.write(group_of(kind, context), settings, dict.fromkeys(names))
    context.scene.update_tag()


def _is_kept(kind: str, name: str) -> bool:
    """Return whether a preset holds a setting: not where something is, or what it is called."""
    if kind not in spec.SENSORS:
        return name not in PLACES
    return name not in {"kind", "name", *KINDS[kind].posed, *ENDS, *references.REFERENCES}


def _table(kind: str, context: bpy.types.Context) -> dict[str, Any]:
    """Every setting of the chosen one, as a table of a scene file."""
    if kind in spec.SENSORS:
        return table_of(exchange.sensor_of(chosen_sensor(context)), whole=True)
    return table_of(exchange.read(group_of(kind, context), SETTINGS[kind]), whole=True)


def draw_presets(layout: bpy.types.UILayout, name: str) -> None:
    """The button in a panel's header that opens the menu of presets."""
    panel = getattr(bpy.types, f"FOREST_PT_presets_{name}", None)
    if panel is not None and not is_narrow():  # it would stand on the title
        panel.draw_panel_header(layout)


@button(
    "Apply Preset",
    Reading,
    bl_options={"INTERNAL", "UNDO"},
    kind=bpy.props.StringProperty(options={"SKIP_SAVE"}),
    values=bpy.props.StringProperty(options={"SKIP_SAVE"}),
)
def _apply_preset(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Set the chosen sensor or planting, or the wind, as a preset says"""
    if pressed.kind not in SETTINGS or group_of(pressed.kind, context) is None:
        raise ValueError(say("Choose what the preset is for first"))
    apply(pressed.kind, context, json.loads(pressed.values))
    return ""


class _PresetButton(AddPresetBase):
    """Base of the operators that keep the chosen one's settings as a preset, or remove one."""

    kind: ClassVar[str]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        there = group_of(cls.kind, context) is not None
        if not there:
            cls.poll_message_set(say("Choose what the preset is for first"))
        return there

    def add(self, context: bpy.types.Context, path: str) -> None:
        """Write the file of a preset; Blender calls it."""
        try:
            values = json.dumps(values_of(self.kind, context))
        except SpecError as problem:
            self.report({"ERROR"}, in_words(problem))
            return
        given = ", ".join((f"kind={self.kind!r}", f"values={values!r}"))
        lines = ("import bpy", "", f"bpy.ops.forest.apply_preset({given})", "")
        with replacing(Path(path)) as partial:
            partial.write_text("\n".join(lines), encoding="utf-8")


def _classes(kind: str) -> tuple[type, type]:
    """The panel of a kind's presets, and the operator that adds and removes them."""
    folder, name = f"{FOLDER}/{kind}", f"FOREST_PT_presets_{kind}"
    panel = type(
        name,
        (PresetPanel, bpy.types.Panel),
        {
            "__doc__": "Choose a preset, keep the settings as one, or remove one",
            "bl_label": TITLES.get(kind, "Sensor Presets"),
            "preset_subdir": folder,
            "preset_operator": "script.execute_preset",
            "preset_add_operator": f"forest.preset_{kind}",
        },
    )
    add = type(
        f"FOREST_OT_preset_{kind}",
        (_PresetButton, bpy.types.Operator),
        {
            "__doc__": "Keep these settings as a preset, or remove one",
            "bl_label": "Add Preset",
            "preset_menu": name,
            "preset_subdir": folder,
            "kind": kind,
        },
    )
    return add, panel


CLASSES = tuple(cls for kind in SETTINGS for cls in _classes(kind))
