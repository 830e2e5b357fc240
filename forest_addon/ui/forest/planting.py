"""Plant by hand: a brush over the ground that sets trees, takes them away and changes single ones.

A click sets a tree, a drag fills the brush's disc up to a density, with Ctrl it clears; with Shift the
nearest tree is dragged. The forest is grown after each stroke, so that what is seen is what a scene file
grows.
"""

from __future__ import annotations

import secrets
from typing import Any, ClassVar

import bpy
import gpu
import numpy as np
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ...base.rng import stream
from ...blender.scene.layout import GROUND_NAME, GROUND_ROLE, ROLE_KEY, find_part
from ..shell.chosen import chosen_planting
from ..shell.running import current, obstacle
from ..shell.views import region_of, views
from ..shell.words import keep, say
from .hand import Hand
from .hand_edits import take_up_changes

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
_handle: Any = None


class FOREST_OT_plant(bpy.types.Operator):
    """Plant the chosen species with a brush: click, drag, Ctrl to clear, Shift to move; press again to end"""

    bl_idname = "forest.plant"
    bl_label = "Plant by Hand"
    bl_options: ClassVar[set[str]] = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if _working is not None:
            return True
        reason = obstacle(context)
        if not reason and chosen_planting(context.scene.forest_sensing) is None:
            reason = say("There is no planting yet. Add one to the list")
        if not reason and (context.area is None or context.area.type != "VIEW_3D"):
            reason = say("Plant in a 3D view")
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        global _working
        if _working is not None:
            _working.over = True
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
        _draw_from_now_on()
        context.workspace.status_text_set(say(KEYS))
        context.window_manager.modal_handler_add(self)
        _redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.over or context.scene != self.hand.scene or context.mode != "OBJECT":
            return self._end(context)
        if event.type == "TIMER":
            self._grow(context)
            return {"PASS_THROUGH"}
        if event.type == "LEFTMOUSE" and event.value == "RELEASE" and self.stroke:
            self._lift()
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
            self._press(context, event, place)
            return {"RUNNING_MODAL"}
        return self._key(context, event, place)

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender itself ends the operator: another file is loaded, or Blender quits."""
        self._end(context)

    clearing = False

    def _press(self, context: bpy.types.Context, event: bpy.types.Event, place: Vector) -> None:
        """Begin a stroke."""
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

    def _drag(self, context: bpy.types.Context, place: Vector) -> None:
        """Go on with a stroke."""
        props, hand, xy = context.scene.forest_sensing, self.hand, tuple(place[:2])
        if self.stroke == "move":
            if self.moved is not None and self.moved.thing is not None:
                self.moved.thing.location[:2] = xy
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

    def _lift(self) -> None:
        """End a stroke."""
        if self.stroke == "move" and self.moved is not None:
            self.hand.change(self.moved, place=(self.last.x, self.last.y))
        self.stroke, self.moved, self.due = "", None, True
        self.hand.scene.update_tag()

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
                if event.type == "X":
                    hand.remove(tree)
                else:
                    hand.change(tree, tree.variant + 1 if event.type == "V" else None)
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
        """Return where the ground is below the mouse, None beside the view."""
        region = region_of(self.area, "WINDOW")
        over = [r for r in self.area.regions if _is_over(r, event)]
        if over != [region]:
            return None
        xy = event.mouse_x - region.x, event.mouse_y - region.y
        view = self.area.spaces.active.region_3d
        begin = region_2d_to_origin_3d(region, view, xy)
        return ground_below(context, begin, region_2d_to_vector_3d(region, view, xy))

    def _end(self, context: bpy.types.Context) -> set[str]:
        global _working
        if _working is self:
            context.window_manager.event_timer_remove(self.timer)
            context.workspace.status_text_set(None)
            _working = None
            _draw_no_more()
            _redraw()
        return {"FINISHED"} if self.hand.before else {"CANCELLED"}


def is_planting() -> bool:
    """Return whether somebody plants now."""
    return _working is not None


def ground_below(context: bpy.types.Context, begin: Vector, way: Vector) -> Vector | None:
    """Return where a line meets the ground of the forest, or the level of flat ground; else None."""
    terrain = context.scene.forest_sensing.forest.terrain
    home = find_part(context.scene, GROUND_NAME)
    things = [t for t in home.objects if t.get(ROLE_KEY) == GROUND_ROLE] if home else []
    for thing in (terrain.object_pointer, *things):
        if thing is None or thing.type != "MESH":
            continue
        back = thing.matrix_world.inverted_safe()
        hit, place, _, _ = thing.ray_cast(back @ begin, back.to_3x3() @ way)
        if hit:
            return thing.matrix_world @ place
    if abs(way.z) < 1e-9 or (terrain.base - begin.z) / way.z <= 0:
        return None
    return begin + way * ((terrain.base - begin.z) / way.z)


def _is_over(region: bpy.types.Region, event: bpy.types.Event) -> bool:
    x, y = event.mouse_x - region.x, event.mouse_y - region.y
    return region.width > 1 and 0 <= x < region.width and 0 <= y < region.height


def _redraw() -> None:
    for _, area in views():
        area.tag_redraw()


def _draw_from_now_on() -> None:
    global _handle
    _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")


def _draw_no_more() -> None:
    global _handle
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None


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
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    batch = batch_for_shader(shader, "LINES", {"pos": ends.astype(np.float32)})
    shader.bind()
    shader.uniform_float("color", colour)
    shader.uniform_float("lineWidth", 2.0)
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    batch.draw(shader)


def unregister() -> None:
    """Leave nothing that draws."""
    global _working
    _working = None
    _draw_no_more()


CLASSES = (FOREST_OT_plant,)
