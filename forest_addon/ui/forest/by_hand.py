"""The trees of a planting that were set by hand, and the discs that are kept free, in the panel."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy

from ..settings.drawing import BIG, Tab, draw_settings, split
from ..settings.lists import Listed, Row, buttons, draw_list, rows
from ..shell.chosen import chosen, chosen_planting
from ..shell.words import label
from .lists import NO_PLANTING
from .planting import is_planting


def _planting(context: bpy.types.Context) -> Any:
    return chosen_planting(context.scene.forest_sensing)


HANDS = Listed("by_hand", _planting, NO_PLANTING)
CLEARINGS = Listed("clearings", _planting, NO_PLANTING)
OF_HAND = "Set a tree by hand at the 3D cursor"
OF_CLEARING = "Keep a disc around the 3D cursor free of trees that are drawn"
WIDE = 2.0  # metres, of a clearing that a button makes


def _tree_row(tree: Any) -> Row:
    x, y = tree.position
    right = label("variant {number}", number=tree.variant) if tree.use_variant else ""
    return Row(f"{x:.2f}, {y:.2f} m", "OUTLINER_OB_CURVES", right)


def _clearing_row(disc: Any) -> Row:
    x, y = disc.position
    return Row(f"{x:.2f}, {y:.2f} m", "MESH_CIRCLE", f"{disc.radius:.3g} m")


def _start_tree(tree: Any, context: bpy.types.Context) -> None:
    tree.position = context.scene.cursor.location[:2]


def _start_clearing(disc: Any, context: bpy.types.Context) -> None:
    disc.position, disc.radius = context.scene.cursor.location[:2], WIDE


class FOREST_PT_by_hand(Tab, bpy.types.Panel):
    """Of the chosen planting: single trees that stay as they were set, discs without trees."""

    bl_label = "By Hand"
    bl_parent_id = "FOREST_PT_plantings"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.scene.forest_sensing.plantings)

    def draw(self, context: bpy.types.Context) -> None:
        layout, planting = self.layout, chosen(context.scene.forest_sensing, "plantings")
        props = context.scene.forest_sensing
        text = label("Done Planting") if is_planting() else label("Plant by Hand")
        row = layout.row()
        row.scale_y = BIG
        row.operator("forest.plant", text=text, icon="CHECKMARK" if is_planting() else "BRUSH_DATA")
        column = split(layout)
        for name in ("plant_radius", "plant_density", "plant_grows"):
            column.prop(props, name)
        layout.label(text="Selected Trees")
        row = layout.column(align=True)  # side by side their names would be cut off
        for name, icon in (("lock", "LOCKED"), ("swap", "FILE_REFRESH"), ("remove", "X")):
            row.operator(f"forest.{name}_trees", icon=icon)
        row.operator("forest.adopt_trees", icon="ADD")
        layout.label(text="Trees Set by Hand")
        draw_list(layout, "FOREST_UL_by_hand", planting, "by_hand", "hand_tree")
        if planting.by_hand:
            draw_settings(split(layout), chosen(planting, "by_hand"))
        layout.label(text="Clearings")
        draw_list(layout, "FOREST_UL_clearings", planting, "clearings", "clearing")
        if planting.clearings:
            draw_settings(split(layout), chosen(planting, "clearings"))


CLASSES = (
    rows("by_hand", "Trees of a planting that were set by hand", _tree_row),
    rows("clearings", "Discs that a planting keeps free", _clearing_row),
    *buttons("hand_tree", "Tree", HANDS, OF_HAND, _start_tree),
    *buttons("clearing", "Clearing", CLEARINGS, OF_CLEARING, _start_clearing),
    FOREST_PT_by_hand,
)
