"""Trees in the wind in views and renders, baked for other programs; what views show of trees on points.

Views show full trees, stand-ins or dots; what measures sees full trees. The sway is that of the forest that
stands, grown once more where it is not in memory.
"""

from __future__ import annotations

from collections.abc import Generator
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ...blender.jobs import Task, Work
from ...blender.scene.layout import points_of_forest
from ...blender.scene.nodes import LEVEL_KEY, NEAR, drawn_inputs, instancer_of, show_as, shown_of
from ...spec import SpecError
from ..settings.exchange import to_spec, usable
from ..shell.running import Button, Working, ask_for_file, button, long_button
from ..shell.views import redraw_views
from ..shell.words import label, say
from .build import fingerprint, read_site

FINEST = 500  # triangles at most of stand-ins of files that do not say how many theirs have
SHOWN = ("FULL", "LIGHT", "DOTS")
ITEMS = (
    ("FULL", "Full", "Views draw every triangle of every tree", 0),
    (
        "LIGHT",
        "Light",
        "Views draw stand-ins: the more trees, the fewer triangles each, 500 to 30",
        1,
    ),
    ("DOTS", "Points", "Views draw a dot where each tree stands", 2),
)


def forest_of_points(scene: bpy.types.Scene) -> bpy.types.Modifier | None:
    """The modifier that puts trees on points, None in a scene whose trees are objects."""
    return instancer_of(points_of_forest(scene))


def get_display(props: Any) -> int:
    """Return the number of what views show."""
    modifier = forest_of_points(props.id_data)
    return 0 if modifier is None else SHOWN.index(shown_of(modifier))


def set_display(props: Any, number: int) -> None:
    """Have views show something else."""
    modifier = forest_of_points(props.id_data)
    if modifier is not None:
        show_as(modifier, SHOWN[number])
        redraw_views()  # a script that sets it has nothing else drawn


def draw_display(layout: bpy.types.UILayout, props: Any) -> None:
    """The switch, and what views show where that is less than the forest."""
    modifier = forest_of_points(props.id_data)
    if modifier is None:
        return
    layout.row(align=True).prop(props, "display", expand=True)
    if props.display == "FULL":
        return
    text, said = label("A dot for each tree"), layout.column(align=True)
    if props.display == "LIGHT":
        count = modifier.id_data.get(LEVEL_KEY, FINEST)
        text = label("Stand-ins of {count} triangles at most", count=count)
        holder, key = drawn_inputs(modifier).get(NEAR, (None, ""))
        if holder is not None:
            layout.prop(holder, key, text=label("Whole Trees Around the Camera"))
    said.label(text=text, icon="INFO")
    said.label(text="Sensors and renders see full trees", icon="BLANK1")


_known: dict[int, tuple[Any, Any]] = {}  # of scenes: what the sway follows from, and it


def swaying(context: bpy.types.Context, missing: list[str]) -> Generator[Task, Any, Any]:
    """Give the sway of the trees of a scene as part of a job; None where they stand still.

    missing : gets a sentence where trees stand still although there is wind.
    """
    scene = context.scene
    settings = to_spec(scene, usable(scene))
    if settings.wind.speed == 0 or not scene.forest_sensing.built:
        return None
    mark = fingerprint(scene, context.evaluated_depsgraph_get())
    if mark != scene.forest_sensing.built:
        missing.append(
            say("Trees stand still: the forest is older than its settings. Press Grow Forest")
        )
        return None
    key = mark, settings.wind
    if _known.get(scene.session_uid, (None,))[0] == key:
        return _known[scene.session_uid][1]
    from ...blender.scene.forest import standing_forest
    from ...stand.wind import sway_of

    forest = standing_forest(scene)
    if forest is None:
        folder = Path(bpy.path.abspath(scene.forest_sensing.folder))
        site = yield from read_site(context, settings, folder)
        forest = yield Task(say("growing trees, to know how they sway"), site.grow)
    _known.clear()
    _known[scene.session_uid] = key, sway_of(forest, settings.wind, settings.seed)
    return _known[scene.session_uid][1]


ENDINGS = {".abc": "Alembic", ".usd": "USD", ".usda": "USD", ".usdc": "USD", ".usdz": "USD"}


@long_button("Show Wind", Working)
def _show_wind(_pressed: bpy.types.Operator, context: bpy.types.Context) -> Work:
    """Let the trees sway in views and renders, as sensors meet them"""
    from ...blender.show.wind import amplitudes_of, knots_of, show_wind
    from ...stand.wind import KNOTS

    if to_spec(context.scene, []).wind.speed == 0:
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


@button("Hide Wind", Button, bl_options={"UNDO"})
def hide_wind(_button: Button, context: bpy.types.Context) -> str:
    """Let the trees stand at rest in views and renders"""
    from ...blender.scene.placing import hide_wind

    hide_wind(context.scene)
    return ""


def _by_usual_name(
    pressed: bpy.types.Operator, context: bpy.types.Context, event: bpy.types.Event
) -> set[str]:
    pressed.filepath = pressed.filepath or "forest-in-wind.abc"
    return ask_for_file(pressed, context, event)


@button(
    "Bake Wind",
    Button,
    bl_options={"REGISTER"},
    invoke=_by_usual_name,
    filepath=bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE"}),
    filter_glob=bpy.props.StringProperty(default="*.abc;*.usd;*.usda;*.usdc", options={"HIDDEN"}),
)
def bake_wind(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Write the forest in the wind, frame by frame, to an Alembic (.abc) or USD file"""
    from ...blender.files.export import bake
    from ...blender.scene.placing import wind_home

    path = Path(bpy.path.abspath(pressed.filepath))
    if path.suffix.lower() not in ENDINGS:
        raise ValueError(say("Name a file that ends in .abc, .usd, .usda or .usdc"))
    if not wind_home(context.scene):
        raise ValueError(say("Press Show Wind first"))
    bake(context.scene, path)
    return say("Wrote {file}", file=path.name)


def draw_wind(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """The buttons that show wind in views, hide it and write it to a file."""
    from ...blender.scene.placing import wind_home

    shown, modifier = wind_home(scene), forest_of_points(scene)
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
    said = {
        "DOTS": label("Dots stand still: choose Light or Full"),
        "LIGHT": label("Stand-ins sway; renders show full trees"),
    }
    if modifier is not None and shown_of(modifier) in said:
        layout.label(text=said[shown_of(modifier)], icon="INFO")
