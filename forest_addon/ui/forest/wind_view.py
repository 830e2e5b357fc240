"""Trees in the wind in views and renders: shown and hidden again, and baked to a file for other programs."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import ClassVar

import bpy

from ...blender.jobs import Task, Work
from ...blender.scene.nodes import shown_of
from ...spec import SpecError
from ..settings.exchange import to_spec
from ..shell.running import InOwnScene, Working
from ..shell.words import label, say
from .display import forest_of_points
from .swaying import swaying

ENDINGS = {".abc": "Alembic", ".usd": "USD", ".usda": "USD", ".usdc": "USD", ".usdz": "USD"}


class FOREST_OT_show_wind(Working, bpy.types.Operator):
    """Let the trees sway in views and renders, as sensors meet them"""

    bl_idname = "forest.show_wind"
    bl_label = "Show Wind"

    def work(self, context: bpy.types.Context) -> Work:
        from ...blender.show.wind import amplitudes_of, knots_of, show_wind
        from ...stand.wind.response import KNOTS

        if to_spec(context.scene).wind.speed == 0:
            raise SpecError(say("Wind"), say("set its speed above 0 first"))
        count = knots_of(context.scene, KNOTS)
        missing: list[str] = []
        sway = yield from swaying(context, missing)
        if sway is None:
            raise SpecError(say("Wind"), missing[0] if missing else say("grow a forest first"))
        ahead = yield Task(
            say("working out how trees answer the wind"), partial(amplitudes_of, sway, count)
        )
        made = show_wind(context.scene, sway, KNOTS, ahead)
        sentence = say(
            "{count} trees sway for {seconds:.0f} s; play to see them",
            count=made.trees,
            seconds=made.seconds,
        )
        if made.still:
            sentence += "; " + say("{count} have no skeleton and stand still", count=made.still)
        return sentence


class FOREST_OT_hide_wind(InOwnScene, bpy.types.Operator):
    """Let the trees stand at rest in views and renders"""

    bl_idname = "forest.hide_wind"
    bl_label = "Hide Wind"
    bl_options: ClassVar[set[str]] = {"UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...blender.show.wind import hide_wind

        hide_wind(context.scene)
        return {"FINISHED"}


class FOREST_OT_bake_wind(InOwnScene, bpy.types.Operator):
    """Write the forest in the wind, frame by frame, to an Alembic (.abc) or USD file"""

    bl_idname = "forest.bake_wind"
    bl_label = "Bake Wind"

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(default="*.abc;*.usd;*.usda;*.usdc", options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or "forest-in-wind.abc"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ...blender.files.export import bake
        from ...blender.show.wind import shows_wind

        path = Path(bpy.path.abspath(self.filepath))
        if path.suffix.lower() not in ENDINGS:
            self.report({"ERROR"}, say("Name a file that ends in .abc, .usd, .usda or .usdc"))
            return {"CANCELLED"}
        if not shows_wind(context.scene):
            self.report({"ERROR"}, say("Press Show Wind first"))
            return {"CANCELLED"}
        try:
            bake(context.scene, path)
        except (OSError, RuntimeError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, say("Wrote {file}", file=path.name))
        return {"FINISHED"}


def draw_wind(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """The buttons that show wind in views, hide it and write it to a file."""
    from ...blender.show.wind import shows_wind

    shown = shows_wind(scene)
    row = layout.row(align=True)
    row.operator(
        "forest.show_wind",
        text=label("Show Again") if shown else label("Show Wind"),
        icon="FORCE_WIND",
    )
    if not shown:
        return
    row.operator("forest.hide_wind", text="", icon="X")
    layout.operator("forest.bake_wind", icon="EXPORT")
    modifier = forest_of_points(scene)
    display = shown_of(modifier) if modifier is not None else "FULL"
    if display != "FULL":
        text = label("Dots stand still: choose Light or Full")
        text = label("Stand-ins sway; renders show full trees") if display == "LIGHT" else text
        layout.label(text=text, icon="INFO")


CLASSES = (FOREST_OT_show_wind, FOREST_OT_hide_wind, FOREST_OT_bake_wind)
