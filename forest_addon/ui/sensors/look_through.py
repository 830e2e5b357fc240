"""Look through a scanner as through a camera: a coarse image in the corner of the view, live.

While it is on, the chosen scanner's image is made anew whenever the scanner, what it follows or its settings
change: at once, from the scene as it was read. Where the scene itself has changed, it is read again when it
has been quiet for a moment. Nothing is added to the file, and no result is touched.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.presets import draw_texture_2d

from ...blender.scene.instances import may_be_met
from ...blender.sensors import objects as sensors
from ...sensing.kind import Observation
from ...sensing.kinds import KINDS, choose
from ..settings.exchange import sensor_of, to_spec
from ..settings.preferences import rays_of
from ..shell.running import PROBLEMS, Button, button, current, in_words, obstacle
from ..shell.views import (
    chosen_sensor,
    draw_no_more,
    draw_over,
    redraw_views,
    region_of,
    views,
)
from ..shell.words import keep, label, say

TICK, QUIET = 0.05, 0.5  # s between two looks; s without a change before the scene is read again
SHARE, EDGE = 0.45, 24  # of the view's width that the image takes; pixels from its corner
FONT, SIZE, LINE = 0, 12, 18  # the size in points, the height of a line in pixels


NO_EYES = keep("Choose a scanner or a sonar: this sensor has no eyes")


def _sees(obj: bpy.types.Object | None) -> bool:
    return obj is not None and KINDS[sensors.kind_of(obj)].glance is not None


@dataclass
class Eye:
    """Live image of a scene's chosen scanner.

    observer : the scene as it was read. changed_at : when the scene changed since, None: it has not.
    found : the last ``Glance``. seconds : that it took. problem : why there is none, in a sentence.
    """

    scene: int
    observer: Any = None
    changed_at: float | None = None
    moved: bool = True
    looked_for: Any = None
    name: str = ""
    found: Any = None
    seconds: float = 0.0
    problem: str = ""
    drawn: dict[str, Any] = field(default_factory=dict)

    def look(self, context: bpy.types.Context) -> bool:
        """Make the image anew where something has changed; returns whether there is a new one."""
        obj = chosen_sensor(context)
        try:
            if not _sees(obj):
                wanted: Any = say(NO_EYES)
            else:
                wanted = _placed(context, sensor_of(obj))
        except PROBLEMS as problem:
            wanted = in_words(problem)
        quiet = self.changed_at is not None and time.monotonic() - self.changed_at > QUIET
        if wanted == self.looked_for and not self.moved and not quiet:
            return False
        self.looked_for, self.moved = wanted, False
        self.name = "" if obj is None else obj.name
        self.drawn.clear()
        if isinstance(wanted, str):
            self.found, self.problem = None, wanted
            return True
        try:
            self._glance(context, wanted, quiet)
            self.problem = ""
        except PROBLEMS as problem:
            self.found, self.problem = None, in_words(problem)
        return True

    def _glance(self, context: bpy.types.Context, sensor: Any, again: bool) -> None:
        from ...blender.sensors.observe import Observer

        settings = to_spec(context.scene, [])
        if self.observer is None or again:
            # without a depsgraph of before; reading changes what views show for a moment, which is no news
            self.observer = Observer(context.evaluated_depsgraph_get(), rays_of(settings.rays))
            self.observer.caster  # noqa: B018
            self.changed_at = None
        sensor, _ = choose(sensor)
        way = Observer.way(sensor, Path(bpy.path.abspath(context.scene.forest_sensing.folder)))
        begin = time.perf_counter()
        glance = KINDS[sensor.kind].glance
        assert glance is not None
        self.found = glance(Observation(sensor, self.observer, settings, trajectory=way))
        self.seconds = time.perf_counter() - begin


_eye: Eye | None = None
_reading = False


@button(
    "Look Through",
    Button,
    bl_options=set(),
    ready=staticmethod(lambda context: obstacle(context) if _eye is None else ""),
    needs=((lambda context: _eye is not None or _sees(chosen_sensor(context)), NO_EYES),),
)
def _look_through(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Show live what the chosen scanner sees, or a sonar at the 3D cursor hears; press again to end"""
    if _eye is not None:
        end()
        return ""
    eye = begin(context.scene)
    _look(eye, context)
    if eye.problem:
        pressed.report({"WARNING"}, eye.problem)
    return ""


def draw_switch(
    layout: bpy.types.UILayout, context: bpy.types.Context, obj: bpy.types.Object | None
) -> None:
    """Draw the button for the chosen sensor, and what the image shows while it is on."""
    if _eye is None and not _sees(obj):
        return
    hears = obj is not None and KINDS[sensors.kind_of(obj)].listens
    text = label("Listen Here") if hears else label("Look Through")
    if _eye is not None:
        text = label("End Listening") if hears else label("End Looking Through")
    layout.operator("forest.look_through", text=text, icon="HIDE_OFF")
    if _eye is not None and not hears:
        layout.row(align=True).prop(context.scene.forest_sensing, "look_shows", expand=True)


def eye() -> Eye | None:
    """The live image, None while there is none."""
    return _eye


def begin(scene: bpy.types.Scene) -> Eye:
    """Look through the chosen scanner of a scene from now on."""
    global _eye
    end()
    _eye = Eye(scene.session_uid)
    if not bpy.app.background:
        bpy.app.timers.register(_tick, first_interval=TICK)
    draw_over(_draw, "POST_PIXEL")
    return _eye


@bpy.app.handlers.persistent
def end(*_: object) -> None:
    """Look no longer, and leave nothing behind."""
    global _eye
    _eye = None
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    draw_no_more(_draw)
    redraw_views()


unregister = end


@bpy.app.handlers.persistent
def _hear(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Something has changed: where the scanner is, or what it sees."""
    if _eye is None or _reading or scene.session_uid != _eye.scene:
        return
    for update in depsgraph.updates:
        obj = update.id
        if not isinstance(obj, bpy.types.Object):
            continue
        _eye.moved = True
        changed = update.is_updated_geometry or update.is_updated_transform
        if changed and not sensors.kind_of(obj) and may_be_met(obj):
            _eye.changed_at = time.monotonic()


@bpy.app.handlers.persistent
def _hear_undone(*_: object) -> None:
    """All may have changed."""
    if _eye is not None:
        _eye.moved, _eye.changed_at = True, time.monotonic()


def _look(one: Eye, context: bpy.types.Context) -> bool:
    global _reading
    _reading = True
    try:
        return one.look(context)
    finally:
        _reading = False


def _tick() -> float | None:
    if _eye is None:
        return None
    if current() is not None:  # a job may be building what would be read
        return QUIET
    for window, area in views():
        if window.scene.session_uid == _eye.scene:
            with bpy.context.temp_override(window=window, area=area):
                shown = window.scene.forest_sensing.look_shows
                if _look(_eye, bpy.context) or (_eye.found and shown not in _eye.drawn):
                    redraw_views()
            return TICK
    return QUIET


def _draw() -> None:
    """Draw the image, its name and its legend in the lower left corner of the view, beside the toolbar."""
    context = bpy.context
    if _eye is None or context.scene.session_uid != _eye.scene:
        return
    from ...blender.show.cloud import glance_colours

    scale = context.preferences.system.ui_scale
    edge, line = EDGE * scale, LINE * scale
    main, tools = (region_of(context.area, kind) for kind in ("WINDOW", "TOOLS"))
    covers = tools.width > 1 and tools.x <= main.x + main.width // 2
    left = edge + max(tools.x + tools.width - main.x, 0) * covers
    blf.size(FONT, SIZE * scale)
    if _eye.found is None:
        _write(_eye.problem, left, edge, (1.0, 0.8, 0.4))
        return
    shown = context.scene.forest_sensing.look_shows
    if shown not in _eye.drawn:
        colours, legend = glance_colours(_eye.found, shown)
        _eye.drawn = {shown: (_texture(colours), legend)}
    texture, legend = _eye.drawn[shown]
    wide = SHARE * context.region.width
    high = wide * min(max(texture.height / texture.width, 0.15), 0.6)
    gpu.state.blend_set("NONE")
    draw_texture_2d(texture, (left, edge + line), wide, high)
    x = left
    for text, colour in legend:
        x = _write("■", x, edge, colour) + 4 * scale
        x = _write(label(text), x, edge, (0.9, 0.9, 0.9)) + 14 * scale
    title = label(
        "{sensor}, {milliseconds:.0f} ms", sensor=_eye.name, milliseconds=1e3 * _eye.seconds
    )
    if hasattr(_eye.found, "level"):
        title = label("{image}, at the 3D cursor", image=title)
    if _eye.changed_at is not None:
        title = label("{image}, before the last change", image=title)
    _write(title, left, edge + line + high + 6 * scale, (0.9, 0.9, 0.9))


def _placed(context: bpy.types.Context, sensor: Any) -> Any:
    """A sensor where it is, one that listens at the 3D cursor: one clicks about, and hears."""
    if not KINDS[sensor.kind].listens:
        return sensor
    place = tuple(round(float(x), 4) for x in context.scene.cursor.location)
    return sensor.changed(position=place, route="", follow="")


def _texture(colours: Any) -> gpu.types.GPUTexture:
    high, wide = colours.shape[:2]
    pixels = np.ones((high, wide, 4), dtype=np.float32)
    pixels[..., :3] = colours
    buffer = gpu.types.Buffer("FLOAT", high * wide * 4, pixels.ravel())
    return gpu.types.GPUTexture((wide, high), format="RGBA16F", data=buffer)


def _write(text: str, x: float, y: float, colour: tuple[float, float, float]) -> float:
    """Write a text over the view; returns where it ends."""
    blf.position(FONT, x, y, 0)
    blf.color(FONT, *colour, 1.0)
    blf.draw(FONT, text)
    return x + blf.dimensions(FONT, text)[0]


HANDLERS = (
    *((name, _hear) for name in ("depsgraph_update_post", "frame_change_post")),
    *((name, _hear_undone) for name in ("undo_post", "redo_post")),
    ("load_pre", end),
)
