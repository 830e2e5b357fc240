"""The panel's lists: how an item is drawn, and the operators that add and remove items."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, ClassVar

import bpy

from ..blender.sensors import kind_of
from . import hills
from .operators import chosen_sensor
from .properties import chosen_planting
from .running import LINKED
from .species_pictures import EDITED, title_of
from .words import keep, label, say

ICONS = {
    "forest": "OUTLINER_OB_CURVES",
    "tractor": "AUTO",
    "terrestrial": "OUTLINER_OB_POINTCLOUD",
    "mobile": "CURVE_PATH",
    "airborne": "OUTLINER_OB_LIGHTPROBE",
    "sonar": "OUTLINER_OB_SPEAKER",
    "reverb": "RNDCURVE",
}


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
        edited = item.species.startswith(EDITED)
        icon_name = "GREASEPENCIL" if edited else "OUTLINER_OB_CURVES"
        row.label(text=title_of(item.species) or label("(no species)"), icon=icon_name)
        if item.use_expected:
            number = row.row()
            number.alignment = "RIGHT"
            one = item.expected == 1
            number.label(
                text=label("1 tree") if one else label("{expected:g} trees", expected=item.expected)
            )


class FOREST_UL_gaussians(bpy.types.UIList):
    """Hills of a species' intensity."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        x, y = item.centre
        layout.label(text=f"{x:g}, {y:g} m", icon="MESH_CIRCLE")
        number = layout.row()
        number.alignment = "RIGHT"
        number.label(text=label("peak {height:.3g}", height=item.peak))


class FOREST_UL_stems(bpy.types.UIList):
    """Stems that only reverb hears."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        layout.label(text=label("{count:,} stems", count=item.count), icon="MESH_CYLINDER")


class FOREST_UL_sensors(bpy.types.UIList):
    """Sensors of the scene, which are objects."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        layout.prop(item, "name", text="", emboss=False, icon=ICONS[kind_of(item)])
        run = layout.operator("forest.run", text="", icon="PLAY", emboss=False)
        run.sensor, run.frames = item.name, "THIS"

    def filter_items(self, context, data, name) -> tuple[list[int], list[int]]:
        things = getattr(data, name)
        return [self.bitflag_filter_item if kind_of(thing) else 0 for thing in things], []


class FOREST_UL_rasters(bpy.types.UIList):
    """Images of a species' intensity."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        layout.label(text=Path(item.file).name or label("(no file)"), icon="IMAGE_DATA")
        use = layout.row()
        use.alignment = "RIGHT"
        use.label(text=item.use)


class FOREST_UL_distances(bpy.types.UIList):
    """Distances between pairs of species."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        layout.label(text=f"{item.species or '?'}, {item.other or '?'}", icon="DRIVER_DISTANCE")
        number = layout.row()
        number.alignment = "RIGHT"
        number.label(text=f"{item.distance:g} m")


class FOREST_UL_poses(bpy.types.UIList):
    """Poses of a moving scanner."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        x, y, z = item.position
        layout.label(text=f"{x:g}, {y:g}, {z:g} m", icon="EMPTY_ARROWS")
        number = layout.row()
        number.alignment = "RIGHT"
        number.label(text=f"{item.time:g} s")


class FOREST_UL_places(bpy.types.UIList):
    """Further sources or receivers of a reverb."""

    def draw_item(self, context, layout, data, item, icon, active, name, index=0) -> None:
        x, y, z = item.position
        layout.label(text=f"{x:g}, {y:g}, {z:g} m", icon="EMPTY_AXIS")


class _Listed:
    """Adding to and removing from a list of the panel, of which Blender reports nothing by itself."""

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    items: ClassVar[str]
    no_owner: ClassVar[str] = ""  # said where there is nothing that holds the list

    @classmethod
    def owner(cls, context: bpy.types.Context) -> Any:
        """The group that holds the list, None where there is none."""
        return context.scene.forest_sensing

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        """Why the list cannot be changed; empty where it can."""
        if not context.scene.is_editable:
            return say(LINKED)
        return "" if cls.owner(context) is not None else say(cls.no_owner)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reason = cls.obstacle(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason


class _OfPlanting(_Listed):
    """A list of the chosen planting."""

    no_owner = keep("There is no planting yet. Add one to the list")

    @classmethod
    def owner(cls, context: bpy.types.Context) -> Any:
        return chosen_planting(context.scene.forest_sensing)


class _Gaussians(_OfPlanting):
    items = "gaussians"


class _Rasters(_OfPlanting):
    items = "rasters"


class _Distances(_Listed):
    items = "distances"

    @classmethod
    def owner(cls, context: bpy.types.Context) -> Any:
        return context.scene.forest_sensing.forest


class _Stems(_Listed):
    items = "stems"


class _OfSensor(_Listed):
    """A list of the chosen sensor, which must be of a kind."""

    kind: ClassVar[str]

    @classmethod
    def owner(cls, context: bpy.types.Context) -> Any:
        thing = chosen_sensor(context)
        fits = thing is not None and kind_of(thing) == cls.kind
        return getattr(thing.forest_sensor, cls.kind) if fits else None


class _Poses(_OfSensor):
    items, kind = "poses", "mobile"
    no_owner = keep("Choose a moving scanner in the list of sensors first")


class _Ends(_OfSensor):
    """Further sources or receivers of the chosen reverb."""

    kind = "reverb"
    no_owner = keep("Choose a reverb in the list of sensors first")

    def start(self, place: Any, props: Any) -> None:
        place.position = (*_middle(props.forest), place.position[2])


def _middle(field: Any) -> list[float]:
    return [o + s / 2 for o, s in zip(field.origin, field.size, strict=True)]


class _Sources(_Ends):
    items = "sources"


class _Receivers(_Ends):
    items = "receivers"


class _Add(_Listed):
    def execute(self, context: bpy.types.Context) -> set[str]:
        owner = self.owner(context)
        listed = getattr(owner, self.items)
        self.start(listed.add(), context.scene.forest_sensing)
        hills.renew(context.scene)
        setattr(owner, f"active_{self.items}", len(listed) - 1)
        context.scene.update_tag()
        return {"FINISHED"}


class _Remove(_Listed):
    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        reason = super().obstacle(context)
        if reason or len(getattr(cls.owner(context), cls.items)):
            return reason
        return say("The list is empty: there is nothing to remove")

    def execute(self, context: bpy.types.Context) -> set[str]:
        owner = self.owner(context)
        listed, active = getattr(owner, self.items), getattr(owner, f"active_{self.items}")
        listed.remove(active)
        hills.renew(context.scene)
        setattr(owner, f"active_{self.items}", max(0, min(active, len(listed) - 1)))
        context.scene.update_tag()
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
        hill.centre = _middle(props.forest)
        hill.width = [s / 4 for s in props.forest.size]


class FOREST_OT_remove_gaussian(_Remove, _Gaussians, bpy.types.Operator):
    """Remove the chosen hill"""

    bl_idname = "forest.remove_gaussian"
    bl_label = "Remove Hill"


class FOREST_OT_add_raster(_Add, _Rasters, bpy.types.Operator):
    """Add an image to the intensity function"""

    bl_idname = "forest.add_raster"
    bl_label = "Add Image"

    def start(self, raster: Any, props: Any) -> None:
        raster.size, raster.origin = props.forest.size, props.forest.origin  # when switched on


class FOREST_OT_remove_raster(_Remove, _Rasters, bpy.types.Operator):
    """Remove the chosen image"""

    bl_idname = "forest.remove_raster"
    bl_label = "Remove Image"


class FOREST_OT_add_distance(_Add, _Distances, bpy.types.Operator):
    """Add a distance between trees of two species, at first of the chosen planting with itself"""

    bl_idname = "forest.add_distance"
    bl_label = "Add Distance"

    def start(self, pair: Any, props: Any) -> None:
        planting = chosen_planting(props)
        if planting is not None:
            pair.species = pair.other = planting.species
        pair.distance = props.forest.spacing


class FOREST_OT_remove_distance(_Remove, _Distances, bpy.types.Operator):
    """Remove the chosen distance"""

    bl_idname = "forest.remove_distance"
    bl_label = "Remove Distance"


class FOREST_OT_add_stems(_Add, _Stems, bpy.types.Operator):
    """Add trees that are upright cylinders only: reverb hears them, nothing is grown"""

    bl_idname = "forest.add_stems"
    bl_label = "Add Stems"

    def start(self, stems: Any, _props: Any) -> None:
        stems.count = 1000


class FOREST_OT_remove_stems(_Remove, _Stems, bpy.types.Operator):
    """Remove the chosen stems"""

    bl_idname = "forest.remove_stems"
    bl_label = "Remove Stems"


class FOREST_OT_add_pose(_Add, _Poses, bpy.types.Operator):
    """Add a place that the scanner passes, ten seconds and ten metres after the last"""

    bl_idname = "forest.add_pose"
    bl_label = "Add Pose"

    def start(self, pose: Any, _props: Any) -> None:
        poses = self.owner(bpy.context).poses
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


class FOREST_OT_add_source(_Add, _Sources, bpy.types.Operator):
    """Add one more source, in the middle of the field"""

    bl_idname = "forest.add_source"
    bl_label = "Add Source"


class FOREST_OT_remove_source(_Remove, _Sources, bpy.types.Operator):
    """Remove the chosen source"""

    bl_idname = "forest.remove_source"
    bl_label = "Remove Source"


class FOREST_OT_add_receiver(_Add, _Receivers, bpy.types.Operator):
    """Add one more receiver, in the middle of the field"""

    bl_idname = "forest.add_receiver"
    bl_label = "Add Receiver"


class FOREST_OT_remove_receiver(_Remove, _Receivers, bpy.types.Operator):
    """Remove the chosen receiver"""

    bl_idname = "forest.remove_receiver"
    bl_label = "Remove Receiver"


CLASSES = (
    FOREST_UL_sensors,
    FOREST_UL_stems,
    FOREST_UL_plantings,
    FOREST_UL_gaussians,
    FOREST_UL_rasters,
    FOREST_UL_distances,
    FOREST_UL_poses,
    FOREST_UL_places,
    FOREST_OT_add_source,
    FOREST_OT_remove_source,
    FOREST_OT_add_receiver,
    FOREST_OT_remove_receiver,
    FOREST_OT_add_planting,
    FOREST_OT_remove_planting,
    FOREST_OT_add_gaussian,
    FOREST_OT_remove_gaussian,
    FOREST_OT_add_raster,
    FOREST_OT_remove_raster,
    FOREST_OT_add_distance,
    FOREST_OT_remove_distance,
    FOREST_OT_add_stems,
    FOREST_OT_remove_stems,
    FOREST_OT_add_pose,
    FOREST_OT_remove_pose,
)
