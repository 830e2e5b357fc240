"""Changes of single trees that *Grow Forest* keeps: moved, turned, locked, swapped, removed.

Before a forest is grown anew, trees that somebody has moved or deleted in the view are noted in the
settings of their planting: as trees set by hand, and as clearings where they were drawn. Buttons for
selected trees do the same at once. So a scene file and a script grow what the window shows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, ClassVar

import bpy
import numpy as np

from ...blender.scene.layout import TREES, VARIANTS, find_part
from ...blender.scene.ours import ROLE_KEY, is_ours
from ...blender.scene.stood import (
    STOOD_KEY,
    StoodTree,
    deleted_trees,
    forget_tree,
    note_change,
    stood_trees,
)
from ..shell.running import LINKED, obstacle
from ..shell.words import keep, say

Place = tuple[float, float]
NEAR = 1e-3  # metres: two places that are one
SPOT = 0.01  # metres, radius of the clearing where a tree was drawn
NO_COPIES = keep(
    "Select copies of the forest's trees, such as those dragged from the Asset Browser"
)
NO_TREES = keep("Select trees of the forest that are objects; Plant by Hand changes all others")


def plantings_by_label(scene: bpy.types.Scene) -> dict[str, Any]:
    """The plantings of the panel, by the name that each has in a forest."""
    from ...stand.plan import labels

    plantings = scene.forest_sensing.plantings
    return dict(zip(labels(plantings), plantings, strict=True))


def take_up_changes(scene: bpy.types.Scene) -> int:
    """Note in the settings what was moved or deleted in the view; returns how many trees those are."""
    known, count = plantings_by_label(scene), 0
    for tree in stood_trees(scene):
        if tree.is_changed and tree.label in known:
            set_tree(known[tree.label], tree)
            count += 1
    for label, places in deleted_trees(scene).items():
        for place in places if label in known else ():
            remove_tree(known[label], place)
            count += 1
    if count:
        scene.update_tag()
    return count


def set_tree(planting: Any, tree: StoodTree, variant: int | None = None) -> None:
    """Have a tree stand where it is now, whatever is drawn; ``variant`` in place of its own."""
    entry = find_set(planting, tree.planted)
    if entry is None:
        clear_spot(planting, tree.planted)
        entry = planting.by_hand.add()
    entry.position = tree.place
    angle = (np.rad2deg(tree.rotation) + 180) % 360 - 180
    given = {"rotation_deg": angle, "scale": tree.scale, "diameter": tree.diameter or None}
    given["variant"] = tree.variant if variant is None else variant
    note_change(tree, given["variant"])
    for name, value in given.items():
        setattr(entry, f"use_{name}", value is not None)
        if value is not None:
            setattr(entry, name, value)


def remove_tree(planting: Any, place: Place) -> None:
    """Have no tree stand where one was planted."""
    entry = find_set(planting, place)
    if entry is None:
        clear_spot(planting, place)
    else:
        planting.by_hand.remove(list(planting.by_hand).index(entry))


def find_set(planting: Any, place: Place) -> Any:
    """The tree set by hand at a place, None where there is none."""
    far = max(NEAR, 1e-6 * max(map(abs, place)))
    for entry in planting.by_hand:
        if np.hypot(*np.subtract(entry.position, place)) <= far:
            return entry
    return None


def clear_spot(planting: Any, place: Place, radius: float = SPOT) -> None:
    """Keep a disc free of trees that are drawn."""
    disc = planting.clearings.add()
    disc.position, disc.radius = place, radius


class _OfSelected:
    """An operator on selected trees of the forest."""

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.is_editable:
            cls.poll_message_set(say(LINKED))
            return False
        if context.mode != "OBJECT" or not any(STOOD_KEY in t for t in context.selected_objects):
            cls.poll_message_set(say(NO_TREES))
            return False
        return True

    def each(
        self, context: bpy.types.Context, change: Callable[[Any, StoodTree], None]
    ) -> set[str]:
        """Do it with each; says how many."""
        known, count = plantings_by_label(context.scene), 0
        for tree in _selected(context):
            if tree.label in known:
                change(known[tree.label], tree)
                count += 1
        if not count:
            self.report({"WARNING"}, say(NO_TREES))
            return {"CANCELLED"}
        context.scene.update_tag()
        self.report({"INFO"}, say("{count} trees; Grow Forest keeps them so", count=count))
        return {"FINISHED"}


def _selected(context: bpy.types.Context) -> Iterable[StoodTree]:
    chosen = set(context.selected_objects)
    return [tree for tree in stood_trees(context.scene) if tree.thing in chosen]


class FOREST_OT_lock_trees(_OfSelected, bpy.types.Operator):
    """Keep the selected trees where and as they stand, whatever is drawn around them"""

    bl_idname = "forest.lock_trees"
    bl_label = "Lock Trees"

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.each(context, set_tree)


class FOREST_OT_swap_trees(_OfSelected, bpy.types.Operator):
    """Make each selected tree the next variant of its species, and keep it so"""

    bl_idname = "forest.swap_trees"
    bl_label = "Next Variant"

    def execute(self, context: bpy.types.Context) -> set[str]:
        meshes = _meshes_of_variants(context.scene)

        def swap(planting: Any, tree: StoodTree) -> None:
            number = (tree.variant + 1) % planting.variants
            set_tree(planting, tree, number)
            mesh = meshes.get(f"{tree.label}.{number:03d}")
            if (
                mesh is not None and tree.thing is not None
            ):  # else it comes when the forest is grown
                tree.thing.data = mesh

        return self.each(context, swap)


class FOREST_OT_remove_trees(_OfSelected, bpy.types.Operator):
    """Take the selected trees out of the forest, and have none drawn in their places"""

    bl_idname = "forest.remove_trees"
    bl_label = "Remove Trees"

    def execute(self, context: bpy.types.Context) -> set[str]:
        def remove(planting: Any, tree: StoodTree) -> None:
            remove_tree(planting, tree.planted)
            forget_tree(tree)

        return self.each(context, remove)


class FOREST_OT_adopt_trees(bpy.types.Operator):
    """Plant the selected copies of trees where they stand: copied here or dragged from the Asset Browser"""

    bl_idname = "forest.adopt_trees"
    bl_label = "Plant Copies"
    bl_options: ClassVar[set[str]] = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.is_editable:
            cls.poll_message_set(say(LINKED))
            return False
        if context.mode != "OBJECT" or not any(map(copy_of, context.selected_objects)):
            cls.poll_message_set(say(NO_COPIES))
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        known, planted = plantings_by_label(context.scene), []
        for thing in context.selected_objects:
            label, variant = copy_of(thing) or ("", 0)
            if label not in known or variant >= known[label].variants:
                continue
            place, turn, size = thing.matrix_world.decompose()
            entry = known[label].by_hand.add()
            entry.position = place[:2]
            entry.use_rotation_deg = entry.use_scale = entry.use_variant = True
            entry.rotation_deg = np.rad2deg(turn.to_euler().z)
            entry.scale, entry.variant = sum(size) / 3, variant
            planted.append(thing)
        if not planted:
            self.report({"WARNING"}, say("No planting of this forest has these trees"))
            return {"CANCELLED"}
        data = {thing.data for thing in planted}
        bpy.data.batch_remove(planted)
        bpy.data.batch_remove([mesh for mesh in data if not mesh.users])  # the browser copies them
        context.scene.update_tag()
        if context.scene.forest_sensing.plant_grows and not obstacle(context):
            bpy.ops.forest.build("INVOKE_DEFAULT")
        self.report({"INFO"}, say("{count} planted; Grow Forest keeps them", count=len(planted)))
        return {"FINISHED"}


def copy_of(thing: bpy.types.Object) -> tuple[str, int] | None:
    """Return the planting and variant of which an object is a copy that somebody made; None: of none."""
    part, _, name = str(thing.get(ROLE_KEY, "")).partition("/")
    if thing.type != "MESH" or is_ours(thing):
        return None
    if part == VARIANTS:
        return variant_copied(thing)
    if part == TREES and STOOD_KEY in thing:
        return name.rpartition(" ")[0], int(thing[STOOD_KEY][4])
    return None


def variant_copied(thing: bpy.types.Object) -> tuple[str, int] | None:
    """Return planting and number of the variant that an object is, here or in another file; None: of none."""
    part, _, name = str(thing.get(ROLE_KEY, "")).partition("/")
    label, _, number = name.rpartition(".")
    is_one = thing.type == "MESH" and part == VARIANTS and number.isdecimal()
    return (label, int(number)) if is_one else None


def _meshes_of_variants(scene: bpy.types.Scene) -> dict[str, bpy.types.Mesh]:
    home = find_part(scene, VARIANTS)
    things = home.objects if home is not None else ()
    return {str(t.get(ROLE_KEY, "")).removeprefix(f"{VARIANTS}/"): t.data for t in things}


def draw_menu(menu: Any, context: bpy.types.Context) -> None:
    """Draw what can be done with selected trees, in the context menu of objects."""
    stand = any(STOOD_KEY in thing for thing in context.selected_objects)
    copied = any(map(copy_of, context.selected_objects))
    if stand or copied:
        menu.layout.separator()
    for name in ("lock_trees", "swap_trees", "remove_trees") if stand else ():
        menu.layout.operator(f"forest.{name}")
    if copied:
        menu.layout.operator("forest.adopt_trees")


MENUS = (("VIEW3D_MT_object_context_menu", draw_menu),)
CLASSES = (
    FOREST_OT_lock_trees,
    FOREST_OT_swap_trees,
    FOREST_OT_remove_trees,
    FOREST_OT_adopt_trees,
)
