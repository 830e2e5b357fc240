"""Display of a forest of points: full trees, stand-ins or dots in views; what measures sees full trees."""

from __future__ import annotations

from typing import Any

import bpy

from ...blender.scene.layout import POINTS_ROLE, ROLE_KEY, TREES, find_part
from ...blender.scene.nodes import LEVEL_KEY, instancer_of, show_as, shown_of
from ..shell.views import views
from ..shell.words import label

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
    home = find_part(scene, TREES)
    things = home.objects if home is not None else ()
    thing = next((t for t in things if t.get(ROLE_KEY) == POINTS_ROLE), None)
    return instancer_of(thing)


def get_display(props: Any) -> int:
    """Return the number of what views show."""
    modifier = forest_of_points(props.id_data)
    return 0 if modifier is None else SHOWN.index(shown_of(modifier))


def set_display(props: Any, number: int) -> None:
    """Have views show something else."""
    modifier = forest_of_points(props.id_data)
    if modifier is not None:
        show_as(modifier, SHOWN[number])
        for _, area in views():  # a script that sets it has nothing else drawn
            area.tag_redraw()


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
    said.label(text=text, icon="INFO")
    said.label(text="Sensors and renders see full trees", icon="BLANK1")
