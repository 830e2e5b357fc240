"""Views that windows show, and what is chosen: items of lists, the object that is active and alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import bpy
import bpy.utils.previews
import gpu
from mathutils import Vector

from ...blender.sensors import objects as sensors
from ...spec import Forest
from .words import keep

TAB = "Forest"
PANELS = {"VIEW_3D": "UI", "PROPERTIES": "WINDOW"}  # where panels of ours are, by the kind of area
ACROSS = (
    0.36  # metres from the middle to the edge of a view, a metre of its distance; lens of 50 mm
)

_icons: Any = None
_over: dict[Callable[[], None], Any] = {}  # Blender's handles of what draws over views
_seen_through: set[int] = set()  # areas whose views were made so by us


def views() -> Iterator[tuple[bpy.types.Window, bpy.types.Area]]:
    """Each 3D view, with its window."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield window, area


def region_of(area: bpy.types.Area, kind: str) -> bpy.types.Region:
    """The region of an area that is of a kind."""
    return next(region for region in area.regions if region.type == kind)


def region_below(
    window: bpy.types.Window, x: int, y: int
) -> tuple[bpy.types.Area | None, bpy.types.Region | None]:
    """The 3D view below the mouse at (x, y) of a window and its region there, of four views the one that it
    is; the first view where there is none below."""
    areas = [area for area in window.screen.areas if area.type == "VIEW_3D"]
    area = next(iter([area for area in areas if holds(area, x, y)] or areas), None)
    regions = [r for r in area.regions if r.type == "WINDOW" and r.width > 1] if area else []
    return area, next((r for r in regions if holds(r, x, y)), next(iter(regions), None))


def holds(box: bpy.types.Area | bpy.types.Region, x: int, y: int) -> bool:
    """Return whether (x, y) of a window is in an area or region of it."""
    return box.x <= x < box.x + box.width and box.y <= y < box.y + box.height


def redraw_panels() -> None:
    """Have every sidebar of a 3D view and every Properties editor drawn anew, and no view itself.

    Whoever adds to a list of settings or takes from it calls this at once: buttons that are drawn point to
    where items were, and a mouse over one would have Blender read memory that is no longer theirs.
    """
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in PANELS:
                region_of(area, PANELS[area.type]).tag_redraw()


def is_rendering() -> bool:
    """Return whether Blender renders: its thread then goes from frame to frame, and whoever hears of that
    must change nothing that windows draw meanwhile."""
    return bool(bpy.app.is_job_running("RENDER"))


def look_at(area: bpy.types.Area, field: Forest) -> None:
    """Turn a 3D view to the whole field, beside the sidebar, and have its solid mode draw no outlines.

    A view that looks through a camera is not turned.
    """
    space = area.spaces.active
    view = space.region_3d
    space.shading.show_object_outline = False  # black around every leaf: crowns would be dark
    if view.view_perspective == "CAMERA":
        return
    longest = max(field.size)
    space.clip_end = max(space.clip_end, 10.0 * longest)
    view.view_distance = 1.6 * longest
    covered = region_of(area, "UI").width / region_of(area, "WINDOW").width
    aside = view.view_rotation @ Vector((ACROSS * view.view_distance * covered, 0.0, 0.0))
    middle = [o + s / 2 for o, s in zip(field.origin, field.size, strict=True)]
    view.view_location = Vector((*middle, 3.0)) + aside


def see_through(on: bool) -> None:
    """Show through what is in front in every view that does not do so already; or end that."""
    for _, area in views():
        shading, key = area.spaces.active.shading, area.as_pointer()
        if on and not shading.show_xray:
            shading.show_xray = True
            _seen_through.add(key)
        elif not on and key in _seen_through:
            shading.show_xray = False
    if not on:
        _seen_through.clear()


def open_tab(area: bpy.types.Area) -> None:
    """Show the tab; it is known once the sidebar was drawn."""
    side = region_of(area, "UI")
    if side.active_panel_category != "UNSUPPORTED":
        side.active_panel_category = TAB


Way = tuple[bpy.types.LayerCollection, ...]  # from a view layer's own collection down to one


def select(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Make an object visible, active and the only one selected."""
    show(context, obj)
    select_alone(context.view_layer, obj)


def show(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Make an object visible. Of collections only those that hide it are shown: others stay excluded."""
    layer = context.view_layer
    way = min(  # that with the fewest switches which hide the contents of its last collection
        _ways(layer.layer_collection, obj),
        key=lambda way: (
            way[-1].exclude + sum(h.hide_viewport + h.collection.hide_viewport for h in way)
        ),
        default=(),
    )
    for home in way:
        for hides in (home, home.collection):
            if hides.hide_viewport:
                hides.hide_viewport = False
    if way and way[-1].exclude:
        home = way[-1]
        within = list(_below(home))
        excluded = [child.exclude for child in within]
        home.exclude = False
        for child, was in zip(within, excluded, strict=True):
            child.exclude = was
    obj.hide_viewport = False
    if obj.name in layer.objects:
        obj.hide_set(False)


def select_alone(layer: bpy.types.ViewLayer, obj: bpy.types.Object) -> None:
    """Make an object active and the only one selected, where a view layer has it."""
    for other in layer.objects.selected:
        other.select_set(False)
    if obj.name in layer.objects:
        obj.select_set(True)
        layer.objects.active = obj


def _ways(home: bpy.types.LayerCollection, obj: bpy.types.Object) -> Iterator[Way]:
    """The ways from a collection down to each that holds an object."""
    if home.collection.objects.get(obj.name) == obj:
        yield (home,)
    for child in home.children:
        for way in _ways(child, obj):
            yield (home, *way)


def _below(home: bpy.types.LayerCollection) -> Iterator[bpy.types.LayerCollection]:
    """The collections within another, each before those within it."""
    for child in home.children:
        yield child
        yield from _below(child)


def chosen(owner: Any, name: str) -> Any:
    """The item of a list that is chosen, the last one where fewer are left; the list must hold one."""
    listed = getattr(owner, name)
    return listed[min(getattr(owner, f"active_{name}"), len(listed) - 1)]


def chosen_planting(props: Any) -> Any:
    """The planting that is chosen in the list, None where there is none."""
    active = props.active_plantings
    return props.plantings[active] if 0 <= active < len(props.plantings) else None


# What an operator on the chosen planting needs.
PLANTED = (
    lambda context: chosen_planting(context.scene.forest_sensing),
    keep("There is no planting yet. Add one to the list"),
)


def chosen_sensor(
    context: bpy.types.Context, known: Sequence[bpy.types.Object] | None = None
) -> bpy.types.Object | None:
    """The sensor that list and buttons are about: the active object if it is one, else the one of before.

    None where the scene has no sensor. known : the sensors of the scene, where the caller has them.
    """
    listed = sensors.sensors_of(context.scene) if known is None else known
    for obj in (context.view_layer.objects.active, context.scene.forest_sensing.last_sensor):
        if obj in listed:
            return obj
    return listed[0] if listed else None


def chosen_settings(context: bpy.types.Context, kind: str) -> Any:
    """The settings of the chosen sensor if it is of a kind, else None."""
    obj = chosen_sensor(context)
    fits = obj is not None and sensors.kind_of(obj) == kind
    return getattr(obj.forest_sensor, kind) if fits else None


def choose_sensor(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Make a sensor the active object, unless another one is being edited, and remember it."""
    context.scene.forest_sensing.last_sensor = obj
    layer = context.view_layer
    if layer.objects.active != obj and context.mode == "OBJECT":
        select_alone(layer, obj)


def number_of_sensor(props: Any) -> int:
    """Row of the chosen sensor in the list, -1 where there is none."""
    known = sensors.sensors_of(props.id_data)
    home = sensors.home_of(props.id_data, known)
    obj = chosen_sensor(bpy.context, known) if bpy.context.scene == props.id_data else None
    return -1 if home is None or obj is None else list(home.objects).index(obj)


def choose_number(props: Any, number: int) -> None:
    """A sensor was chosen in the list."""
    home = sensors.home_of(props.id_data)
    obj = home.objects[number] if home and 0 <= number < len(home.objects) else None
    if obj is not None and sensors.kind_of(obj):
        choose_sensor(bpy.context, obj)


@bpy.app.handlers.persistent
def _remember(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """The active sensor stays the chosen one when something else becomes active."""
    active = depsgraph.view_layer.objects.active
    if active is None or not sensors.kind_of(active) or not scene.is_editable:
        return
    props = scene.forest_sensing
    if props.last_sensor != active and active in sensors.sensors_of(scene):
        props.last_sensor = active


HANDLERS = (("depsgraph_update_post", _remember),)


def icons() -> Any:
    """Pictures of ours that Blender shows as icons, by name; from their first use until the add-on goes."""
    global _icons
    if _icons is None:
        _icons = bpy.utils.previews.new()
    return _icons


def unregister() -> None:
    """Free the pictures."""
    global _icons
    if _icons is not None:
        bpy.utils.previews.remove(_icons)
        _icons = None


def redraw_views() -> None:
    """Have every 3D view drawn anew."""
    for _, area in views():
        area.tag_redraw()


def draw_over(draw: Callable[[], None], when: str = "POST_VIEW") -> None:
    """Have every 3D view drawn over from now on; without windows nothing is."""
    if not bpy.app.background:
        _over[draw] = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", when)


def draw_no_more(draw: Callable[[], None]) -> None:
    """Have views drawn over by this no longer."""
    if draw in _over:
        bpy.types.SpaceView3D.draw_handler_remove(_over.pop(draw), "WINDOW")


def line_shader() -> gpu.types.GPUShader:
    """The shader of lines over a view."""
    return gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")


def draw_lines(
    shader: gpu.types.GPUShader, batch: Any, colour: tuple[float, ...], width: float = 2.0
) -> None:
    """Draw lines over a view, so many pixels wide."""
    shader.bind()
    shader.uniform_float("color", colour)
    shader.uniform_float("lineWidth", width)
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    batch.draw(shader)
