"""The panel's lists: how an item is drawn, and the operators that add and remove items."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import bpy


def draw_list(layout: bpy.types.UILayout, shown: str, owner: Any, name: str, thing: str) -> None:
    """A list with buttons that add and remove."""
    row = layout.row()
    row.template_list(shown, "", owner, name, owner, f"active_{name}", rows=2)
    buttons = row.column(align=True)
    buttons.operator(f"forest.add_{thing}", text="", icon="ADD")
    buttons.operator(f"forest.remove_{thing}", text="", icon="REMOVE")


class FOREST_UL_plantings(bpy.types.UIList):
    """Species of the forest."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        row = layout.row(align=True)
        row.label(text=item.species or "(no species)", icon="OUTLINER_OB_CURVES")
        if item.use_expected:
            number = row.row()
            number.alignment = "RIGHT"
            number.label(text=f"{item.expected:g} trees")


class FOREST_UL_gaussians(bpy.types.UIList):
    """Hills of a species' intensity."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        x, y = item.centre
        layout.label(text=f"{x:g}, {y:g} m", icon="MESH_CIRCLE")
        number = layout.row()
        number.alignment = "RIGHT"
        number.label(text=f"peak {item.peak:.3g}")


class FOREST_UL_poses(bpy.types.UIList):
    """Poses of a moving scanner."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        x, y, z = item.position
        layout.label(text=f"{x:g}, {y:g}, {z:g} m", icon="EMPTY_ARROWS")
        number = layout.row()
        number.alignment = "RIGHT"
        number.label(text=f"{item.time:g} s")


class _Listed:
    """Adding to and removing from a list of the panel."""

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    items: ClassVar[str]

    @classmethod
    def owner(cls, context: bpy.types.Context) -> Any:
        """The group that holds the list, None where there is none."""
        return context.scene.forest_sensing

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.scene.is_editable and cls.owner(context) is not None


class _Gaussians(_Listed):
    items = "gaussians"

    @classmethod
    def owner(cls, context: bpy.types.Context) -> Any:
        props = context.scene.forest_sensing
        active = props.active_plantings
        return props.plantings[active] if 0 <= active < len(props.plantings) else None


class _Poses(_Listed):
    items = "poses"

    @classmethod
    def owner(cls, context: bpy.types.Context) -> Any:
        return context.scene.forest_sensing.mobile


class _Add(_Listed):
    def execute(self, context: bpy.types.Context) -> set[str]:
        owner = self.owner(context)
        listed = getattr(owner, self.items)
        self.start(listed.add(), context.scene.forest_sensing)
        setattr(owner, f"active_{self.items}", len(listed) - 1)
        return {"FINISHED"}


class _Remove(_Listed):
    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and bool(len(getattr(cls.owner(context), cls.items)))

    def execute(self, context: bpy.types.Context) -> set[str]:
        owner = self.owner(context)
        listed, active = getattr(owner, self.items), getattr(owner, f"active_{self.items}")
        listed.remove(active)
        setattr(owner, f"active_{self.items}", max(0, min(active, len(listed) - 1)))
        return {"FINISHED"}


class FOREST_OT_add_planting(_Add, bpy.types.Operator):
    """Plant one more species"""

    bl_idname = "forest.add_planting"
    bl_label = "Add Planting"
    items = "plantings"

    def start(self, planting: Any, _props: Any) -> None:
        planting.species = "maple"
        planting.use_expected = True


class FOREST_OT_remove_planting(_Remove, bpy.types.Operator):
    """Remove the chosen planting"""

    bl_idname = "forest.remove_planting"
    bl_label = "Remove Planting"
    items = "plantings"


class FOREST_OT_add_gaussian(_Add, _Gaussians, bpy.types.Operator):
    """Add a hill of the intensity function, in the middle of the field"""

    bl_idname = "forest.add_gaussian"
    bl_label = "Add Hill"

    def start(self, hill: Any, props: Any) -> None:
        field = props.forest
        hill.centre = [o + s / 2 for o, s in zip(field.origin, field.size, strict=True)]
        hill.width = [s / 4 for s in field.size]


class FOREST_OT_remove_gaussian(_Remove, _Gaussians, bpy.types.Operator):
    """Remove the chosen hill"""

    bl_idname = "forest.remove_gaussian"
    bl_label = "Remove Hill"


class FOREST_OT_add_pose(_Add, _Poses, bpy.types.Operator):
    """Add a place that the scanner passes, ten seconds and ten metres after the last"""

    bl_idname = "forest.add_pose"
    bl_label = "Add Pose"

    def start(self, pose: Any, props: Any) -> None:
        poses = props.mobile.poses
        if len(poses) < 2:
            return
        last = poses[len(poses) - 2]
        pose.time, pose.heading_deg = last.time + 10, last.heading_deg
        x, y, z = last.position
        heading = math.radians(last.heading_deg)
        pose.position = (x + 10 * math.cos(heading), y + 10 * math.sin(heading), z)


class FOREST_OT_remove_pose(_Remove, _Poses, bpy.types.Operator):
    """Remove the chosen pose"""

    bl_idname = "forest.remove_pose"
    bl_label = "Remove Pose"


CLASSES = (
    FOREST_UL_plantings,
    FOREST_UL_gaussians,
    FOREST_UL_poses,
    FOREST_OT_add_planting,
    FOREST_OT_remove_planting,
    FOREST_OT_add_gaussian,
    FOREST_OT_remove_gaussian,
    FOREST_OT_add_pose,
    FOREST_OT_remove_pose,
)
