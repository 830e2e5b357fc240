"""The menu of instruments by their makers' names; the setting that is stored is the file's name.

What a scanner file says of ranges, pulses and beams stands in the tooltip of its entry.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import bpy

from ... import spec
from ...blender.sensors import objects as sensors
from ..shell.chosen import chosen_sensor
from ..shell.words import label, say

if TYPE_CHECKING:
    from ...formats.toml_file import ScannerFile

OWN = "My Own"


@cache
def instruments() -> dict[str, ScannerFile]:
    """Every instrument that the add-on brings, by the name of its file; read once."""
    from ...formats.toml_file import read_scanner, scanner_names

    return {name: read_scanner(name) for name in scanner_names()}


def draw_instrument(layout: bpy.types.UILayout, group: Any) -> None:
    """The menu, which shows the instrument that a scanner's settings started from."""
    layout.row(heading="Instrument").menu(FOREST_MT_instruments.__name__, text=title_of(group))


def title_of(group: Any) -> str:
    """Return what the settings of a scanner started from: an instrument, a file of the user's, or nothing."""
    file = instruments().get(group.scanner)
    if file is not None:
        return short(file.title)
    return Path(group.scanner).name if group.scanner else label(OWN)


def short(title: str) -> str:
    """A title without what stands in brackets, so that it fits beside its label."""
    return title.partition(" (")[0]


def figures_of(file: ScannerFile, kind: str) -> str:
    """Return how far, how often and how narrow, of an instrument on a platform."""
    figures = file.tables[kind]
    parts = []
    if "max_range" in figures:
        parts.append(say("{metres:g} m", metres=figures["max_range"]))
    if "pulse_rate" in figures:
        parts.append(say("{rate:g} kHz", rate=figures["pulse_rate"] / 1e3))
    spread = figures.get("beam", {}).get("divergence_mrad")
    if spread:
        parts.append(say("{spread:g} mrad", spread=max(spread)))
    return ", ".join(parts)


class FOREST_OT_choose_instrument(bpy.types.Operator):
    """Start from an instrument's published figures"""

    bl_idname = "forest.choose_instrument"
    bl_label = "Instrument"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO", "INTERNAL"}

    scanner: bpy.props.StringProperty(name="Instrument")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        thing = chosen_sensor(context)
        return thing is not None and hasattr(spec.SENSORS[sensors.kind_of(thing)], "scanner")

    @classmethod
    def description(cls, context: bpy.types.Context, settings: Any) -> str:
        file, thing = instruments().get(settings.scanner), chosen_sensor(context)
        if file is None or thing is None or sensors.kind_of(thing) not in file.tables:
            return say("All settings as they are, of no instrument")
        figures = figures_of(file, sensors.kind_of(thing))
        return say("{instrument}: {figures}", instrument=file.title, figures=figures)

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = chosen_sensor(context)
        group = getattr(thing.forest_sensor, sensors.kind_of(thing))
        group.scanner = self.scanner  # what follows when it is set takes the figures
        return {"FINISHED"}


class FOREST_MT_instruments(bpy.types.Menu):
    """Instruments that are used on what carries the chosen sensor"""

    bl_label = "Instruments"

    def draw(self, context: bpy.types.Context) -> None:
        thing = chosen_sensor(context)
        if thing is None:
            return
        kind = sensors.kind_of(thing)
        for name, file in instruments().items():
            if kind in file.tables:
                title = short(file.title)
                choose = self.layout.operator(FOREST_OT_choose_instrument.bl_idname, text=title)
                choose.scanner = name
        none = self.layout.operator(FOREST_OT_choose_instrument.bl_idname, text=label(OWN))
        none.scanner = ""


CLASSES = (FOREST_OT_choose_instrument, FOREST_MT_instruments)
