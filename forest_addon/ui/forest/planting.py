"""Plant by hand in the view: a brush over the ground, and trees dragged from the Asset Browser.

A click sets a tree, a drag fills the brush's disc up to a density, with Ctrl it clears; with Shift the
nearest tree is dragged. The forest is grown after each stroke, so that what is seen is what a scene file
grows.

Blender sets a tree that is dropped down as an object, by an operator of its own that no class of ours stands
behind. What that operator has just set down is seen here, and planted as *Plant Copies* does, with *Grow at
Once*; without, it stays an object until that button is pressed. So does a tree of another file, unless it is
the same as one of this forest: the message says what to do.
"""

from __future__ import annotations

import secrets
from typing import Any, ClassVar

import bpy
import numpy as np
from bpy_extras.view3d_utils import (
    location_3d_to_region_2d,
    region_2d_to_origin_3d,
    region_2d_to_vector_3d,
)
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ...base.rng import stream
from ...blender.scene.instances import ASSET_KEY
from ...blender.scene.layout import (
    GROUND_NAME,
    GROUND_ROLE,
    ROLE_KEY,
    SHAPE_KEY,
    VARIANTS,
    by_role,
    find_part,
)
from ...spec import SpecError
from ..shell.running import WhenReady, current, made, obstacle, show_no_job
from ..shell.views import (
    PLANTED,
    chosen_planting,
    draw_lines,
    draw_no_more,
    draw_over,
    holds,
    line_shader,
    redraw_views,
    region_below,
    region_of,
)
from ..shell.words import keep, say
from .hand import (
    Hand,
    copy_of,
    hand_trees,
    set_tree,
    swap_tree,
    take_away,
    take_up_changes,
    variant_copied,
)

TICK = 0.1  # s between two looks at whether the forest can be grown
STEP = 0.5  # of the radius that the brush moves between two dabs
REACH = 3.0  # metres at most to the tree that is meant
ROUND = np.linspace(0, 2 * np.pi, 49)
PLANTS, CLEARS, SET = (0.3, 1.0, 0.4, 0.9), (1.0, 0.35, 0.25, 0.9), (0.5, 1.0, 0.3, 0.8)
KEYS = keep(
    "Click: a tree. Drag: many. Ctrl: clear. Shift: move one. [ ]: brush size. "
    "L: lock. V: next variant. X: remove. Esc: done"
)

_working: FOREST_OT_plant | None = None


class FOREST_OT_plant(WhenReady, bpy.types.Operator):
    """Plant the chosen species with a brush: click, drag, Ctrl to clear, Shift to move; press again to end"""

    bl_label = "Plant by Hand"
    bl_options: ClassVar[set[str]] = {"UNDO"}

    needs = (
        PLANTED,
        (
            lambda context: context.area is not None and context.area.type == "VIEW_3D",
            keep("Plant in a 3D view"),
        ),
    )

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        return super().obstacle(context) if _working is None else ""

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        global _working
        if _working is not None:
            _working.over = True
            return {"CANCELLED"}
        try:
            hand_trees(context.scene)  # those that cannot be used could not be taken back
        except SpecError as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        take_up_changes(context.scene)
        # chance itself is wanted; what comes of it is noted in the settings
        self.hand = Hand(context.scene, stream(secrets.randbits(62), "hand"))
        self.hand.look()
        self.over, self.due, self.stroke, self.moved = False, False, "", None
        self.at: Vector | None = None
        self.last: Any = None
        self.area, self.grew = context.area, None
        self.timer = context.window_manager.event_timer_add(TICK, window=context.window)
        _working = self
        draw_over(_draw)
        context.workspace.status_text_set(say(KEYS))
        context.window_manager.modal_handler_add(self)
        redraw_views()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        try:
            return self.heed(context, event)
        except Exception:
            self._end(context)  # or the brush would be drawn for ever, and nothing would end it
            raise

    def heed(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Do what an event means to the brush."""
        if self.over or context.scene != self.hand.scene or context.mode != "OBJECT":
            return self._end(context)
        if event.type == "TIMER":
            self._grow(context)
            return {"PASS_THROUGH"}
        if event.type == "LEFTMOUSE" and event.value == "RELEASE" and self.stroke:
            if self.moved is not None:
                self.hand.change(self.moved, place=(self.last.x, self.last.y))
            self.stroke, self.moved, self.due = "", None, True
            self.hand.scene.update_tag()
            return {"RUNNING_MODAL"}
        place = self._below(context, event)
        if place is None and not self.stroke:
            return {"PASS_THROUGH"}
        if event.type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE"):
            self.at = place
            self.clearing = event.ctrl
            if self.stroke and place is not None:
                self._drag(context, place)
            self.area.tag_redraw()
            return {"RUNNING_MODAL"} if self.stroke else {"PASS_THROUGH"}
        if event.value != "PRESS" or place is None:
            return {"PASS_THROUGH"}
        if event.type in ("ESC", "RET", "RIGHTMOUSE"):
            return self._end(context)
        if event.type == "LEFTMOUSE" and not event.alt:
            props, hand, xy = context.scene.forest_sensing, self.hand, tuple(place[:2])
            hand.begin()
            self.last = place
            if event.shift:
                self.stroke, self.moved = "move", hand.nearest(xy, REACH)
            elif event.ctrl:
                self.stroke = "clear"
                hand.erase(xy, props.plant_radius)
            else:
                self.stroke = "plant"
                hand.plant(chosen_planting(props), xy)
            return {"RUNNING_MODAL"}
        return self._key(context, event, place)

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender itself ends the operator: another file is loaded, or Blender quits."""
        self._end(context)

    clearing = False

    def _drag(self, context: bpy.types.Context, place: Vector) -> None:
        """Go on with a stroke."""
        props, hand, xy = context.scene.forest_sensing, self.hand, tuple(place[:2])
        if self.stroke == "move":
            if self.moved is not None and self.moved.obj is not None:
                self.moved.obj.location[:2] = xy
            self.last = place
            return
        if (place - self.last).length < STEP * props.plant_radius:
            return
        self.last = place
        if self.stroke == "clear":
            hand.erase(xy, props.plant_radius)
        else:
            planting = chosen_planting(props)
            hand.scatter(planting, xy, props.plant_radius, props.plant_density)

    def _key(self, context: bpy.types.Context, event: bpy.types.Event, place: Vector) -> set[str]:
        """Do what a key means; other keys are Blender's."""
        props, hand = context.scene.forest_sensing, self.hand
        larger = {"LEFT_BRACKET": 1 / 1.25, "RIGHT_BRACKET": 1.25}.get(event.type)
        if larger:
            props.plant_radius *= larger
        elif event.type == "Z" and (event.ctrl or event.oskey):
            self.due |= hand.take_back()
        elif event.type in ("L", "V", "X") and not (event.ctrl or event.alt):
            tree = hand.nearest(tuple(place[:2]), REACH)
            if tree is not None:
                hand.begin()
                hand.change(tree, {"L": set_tree, "V": swap_tree, "X": take_away}[event.type])
                self.due = True
        else:
            return {"PASS_THROUGH"}
        self.area.tag_redraw()
        return {"RUNNING_MODAL"}

    def _grow(self, context: bpy.types.Context) -> None:
        """Grow the forest when a stroke is done and nothing else runs, and see what stands then."""
        if self.grew is not None and self.grew.over and current() is None:
            self.grew = None
            context.workspace.status_text_set(say(KEYS))  # where the job said how far it was
            if not self.due and not self.stroke:
                self.hand.look()
                self.area.tag_redraw()
        if not self.due or self.stroke or current() is not None:
            return
        self.due = False
        if context.scene.forest_sensing.plant_grows:
            region = region_of(self.area, "WINDOW")
            with context.temp_override(area=self.area, region=region):
                bpy.ops.forest.build("INVOKE_DEFAULT")
            self.grew = current()

    def _below(self, context: bpy.types.Context, event: bpy.types.Event) -> Vector | None:
        """Place of the ground below the mouse, None beside the view."""
        region, x, y = region_of(self.area, "WINDOW"), event.mouse_x, event.mouse_y
        if [r for r in self.area.regions if r.width > 1 and holds(r, x, y)] != [region]:
            return None
        return _ground_seen(context, region, (x - region.x, y - region.y))

    def _end(self, context: bpy.types.Context) -> set[str]:
        if _working is self:
            unregister()
            context.window_manager.event_timer_remove(self.timer)
            show_no_job(context)
            redraw_views()
        return {"FINISHED"} if self.hand.before else {"CANCELLED"}


@bpy.app.handlers.persistent
def _look_again(*_: object) -> None:
    """Undo and redo make objects anew: those that the brush has seen may be gone."""
    if _working is not None:
        _working.hand.scene, _working.moved = bpy.context.scene, None
        _working.hand.look()


def is_planting() -> bool:
    """Return whether somebody plants now."""
    return _working is not None


def _ground_seen(context: bpy.types.Context, region: bpy.types.Region, mouse: Any) -> Vector | None:
    """Place of the ground below (x, y) of a region."""
    view = region.data
    begin = region_2d_to_origin_3d(region, view, mouse)
    return ground_below(context, begin, region_2d_to_vector_3d(region, view, mouse))


def ground_below(context: bpy.types.Context, begin: Vector, way: Vector) -> Vector | None:
    """Place where a line meets the ground of the forest, or the level of flat ground; else None."""
    terrain = context.scene.forest_sensing.forest.terrain
    home = find_part(context.scene, GROUND_NAME)
    things = [t for t in home.objects if t.get(ROLE_KEY) == GROUND_ROLE] if home else []
    for obj in (terrain.object_pointer, *things):
        if obj is None or obj.type != "MESH":
            continue
        back = obj.matrix_world.inverted_safe()
        hit, place, _, _ = obj.ray_cast(back @ begin, back.to_3x3() @ way)
        if hit:
            return obj.matrix_world @ place
    if abs(way.z) < 1e-9 or (terrain.base - begin.z) / way.z <= 0:
        return None
    return begin + way * ((terrain.base - begin.z) / way.z)


def _draw() -> None:
    """Draw the brush, a stick for each tree that is set and not grown yet, and what is cleared."""
    work = _working
    if work is None or bpy.context.scene != work.hand.scene:
        return
    height = 0.0 if work.at is None else work.at.z
    radius = bpy.context.scene.forest_sensing.plant_radius
    if work.at is not None:
        _lines(_ring(*work.at[:2], radius, height), CLEARS if work.clearing else PLANTS)
    sticks = [(x, y, z) for x, y in work.hand.set for z in (height, height + 2.0)]
    _lines(np.reshape(sticks, (-1, 3)), SET)
    for x, y, wide in work.hand.cleared:
        _lines(_ring(x, y, wide, height), CLEARS)


def _ring(x: float, y: float, radius: float, z: float) -> np.ndarray:
    places = np.column_stack([x + radius * np.cos(ROUND), y + radius * np.sin(ROUND)])
    ends = np.repeat(places, 2, axis=0)[1:-1]
    return np.column_stack([ends, np.full(len(ends), z + 0.05)])


def _lines(ends: np.ndarray, colour: tuple[float, ...]) -> None:
    if not len(ends):
        return
    shader = line_shader()
    draw_lines(shader, batch_for_shader(shader, "LINES", {"pos": ends.astype(np.float32)}), colour)


def unregister() -> None:
    """Leave nothing that draws."""
    global _working
    _working = None
    draw_no_more(_draw)


LOCAL = "OBJECT_OT_add_named"  # what Blender does when an asset of this file is dropped
FOREIGN = ("OBJECT_OT_transform_to_mouse", "OBJECT_OT_collection_external_asset_drop")
SOON = 0.01  # s: not within the update that tells of it

_known = 0  # the session_uid of the tree that was dropped last


@made(
    bpy.types.Operator,
    "OT",
    "invoke",
    "Plant Dropped Tree",
    bl_options={"INTERNAL"},
    foreign=bpy.props.BoolProperty(
        name="Of Another File",
        description="The tree came from another file or library",
        options={"HIDDEN", "SKIP_SAVE"},
    ),
)
def _plant_dropped(
    pressed: bpy.types.Operator, context: bpy.types.Context, event: bpy.types.Event
) -> set[str]:
    """Plant the tree that was dropped last, below the mouse

    Only an operator is told where the mouse is, by the event that it is invoked with.
    """
    obj = context.view_layer.objects.active
    if obj is None or obstacle(context):
        return {"CANCELLED"}
    if pressed.foreign and not is_of_forest(obj, context.scene):
        told = say(
            "{name} is a tree of another file and stays an object, which sensors meet as it is; "
            "add its species to the forest to plant it",
            name=obj.name,
        )
        pressed.report({"INFO"}, told)
        return {"FINISHED"}
    area, region = region_below(context.window, event.mouse_x, event.mouse_y)
    with context.temp_override(area=area, region=region, selected_objects=[obj]):
        if region is not None:
            low, high = obj.bound_box[0], obj.bound_box[6]
            bottom = Vector(((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]))
            region = bpy.context.region
            mouse = location_3d_to_region_2d(region, region.data, obj.matrix_world @ bottom)
            place = None if mouse is None else _ground_seen(bpy.context, region, mouse)
            if place is not None:
                obj.rotation_euler[:2] = 0.0, 0.0
                obj.location = place
            context.view_layer.update()
        bpy.ops.forest.adopt_trees()
    return {"FINISHED"}


@bpy.app.handlers.persistent
def hear_drop(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Have a tree planted if it is what Blender did last."""
    global _known
    done = bpy.context.window_manager.operators
    obj = depsgraph.view_layer.objects.active
    if not len(done) or obj is None or obj.session_uid == _known:
        return
    foreign = done[-1].bl_idname in FOREIGN
    if not foreign and done[-1].bl_idname != LOCAL:
        return
    is_tree = is_foreign_tree(obj) if foreign else copy_of(obj) is not None
    if not is_tree or not (foreign or scene.forest_sensing.plant_grows):
        return
    _known = obj.session_uid
    bpy.app.timers.register(plant_dropped, first_interval=SOON)


def plant_dropped() -> None:
    """Plant the tree that was dropped last, and grow the forest."""
    for window in bpy.context.window_manager.windows:
        obj = window.view_layer.objects.active
        if obj is None or obj.session_uid != _known:
            continue
        done = bpy.context.window_manager.operators
        foreign = bool(len(done)) and done[-1].bl_idname in FOREIGN
        with bpy.context.temp_override(window=window):
            bpy.ops.forest.plant_dropped("INVOKE_DEFAULT", foreign=foreign)
        return


def is_foreign_tree(obj: bpy.types.Object) -> bool:
    """Return whether an object from another file is a tree of ours: a variant of a forest, or of a library of
    species."""
    home = obj.instance_collection
    meshes = [t.data for t in home.objects] if home is not None else [obj.data]
    said = [*(mesh for mesh in meshes if mesh is not None), obj]
    return any(ASSET_KEY in block for block in said) or _role(obj).startswith(f"{VARIANTS}/")


def is_of_forest(obj: bpy.types.Object, scene: bpy.types.Scene) -> bool:
    """Return whether a tree from another file is the same as the variant of its name in this forest."""
    known = variant_copied(obj)
    mesh = by_role(bpy.data.meshes).get(_role(obj)) if known is not None else None
    own = scene.forest_sensing.plant_grows and obj.data is not None
    return bool(own and mesh and mesh.get(SHAPE_KEY, "") == obj.data.get(SHAPE_KEY))


def _role(obj: bpy.types.Object) -> str:
    return str(obj.get(ROLE_KEY, ""))


WINDOW_HANDLERS = (
    ("depsgraph_update_post", hear_drop),
    *((name, _look_again) for name in ("undo_post", "redo_post")),
)
