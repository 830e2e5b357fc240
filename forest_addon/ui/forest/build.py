"""Growing the forest: the button, and *Live*, which grows it whenever it differs from its settings.

The operator asks the panel's properties for settings, hands them to the rooms below and says what came of it.
Those rooms, and scipy with them, are imported when it runs and not before.

A fingerprint sums up all that a forest is built from; the build leaves its own in the scene, where undo
brings it back with the forest. Blender tells of every change; once nothing has changed for a moment, nobody
is dragging and no other job runs, the fingerprint is taken anew. Drawing only compares two texts.
What undo, redo or a file brought is let be, and so is what could not be built or was cancelled, until the
next change. Without a window *Live* does nothing.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Generator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ...base.kept import digest
from ...base.places import ASSETS
from ...base.progress import Progress
from ...blender.jobs import Job, Task, Work
from ...blender.sensors.objects import sensors_of
from ...formats.toml_file import read_settings
from ...spec import Scene
from ..settings import exchange
from ..settings.exchange import forestless, to_spec
from ..shell import running
from ..shell.running import (
    PROBLEMS,
    Button,
    Working,
    button,
    current,
    getting_ready,
    made,
    obstacle,
    stop,
)
from ..shell.views import is_rendering, look_at, redraw_panels, region_of, views
from ..shell.words import say
from ..species.edit import edited_species, load
from .hand import take_up_changes
from .scene_file import beside_cube, take_scene

if TYPE_CHECKING:
    from ...site import ForestSite
    from ...stand.forest import GrownForest, TreesBefore

QUIET = 0.2  # s without a change before anything is done
LOOK = 0.05  # s between two looks at what is under way
DRAGGING = ("TRANSFORM_OT_", "OBJECT_OT_", "VIEW3D_OT_")  # operators that hold the mouse
UNUSABLE = "unusable"  # the fingerprint of settings that nothing can be built from

_now: dict[int, str] = {}  # fingerprint of a scene's settings, by its session_uid
_let_be: dict[int, str] = {}  # the one that is not built by itself
_digests: dict[tuple[str, str], str] = {}  # of a surface or weights, by name and setting
_due = 0.0  # when it will have been quiet for long enough
_brought: set[int] = set()  # scenes of which the next report is the work of undo, redo or a file
_building: tuple[Job, int, str] | None = None  # the job that Live began, its scene, what it builds


@made(bpy.types.Operator, "OT", "invoke", "Grow Live", bl_options={"INTERNAL"})
def _live(
    _pressed: bpy.types.Operator, _context: bpy.types.Context, event: bpy.types.Event
) -> set[str]:
    """Grow the forest, unless a mouse button is down: then a slider is being dragged

    Only an operator is told of that, by the event that it is invoked with, the last one of the window.
    """
    if event.value == "PRESS" and event.type.endswith("MOUSE"):
        return {"CANCELLED"}
    bpy.ops.forest.build("INVOKE_DEFAULT")
    return {"FINISHED"}


def unregister() -> None:
    """Forget what was compared, and the trees of the last forest."""
    if bpy.app.timers.is_registered(_settle):
        bpy.app.timers.unregister(_settle)
    for known in (_now, _let_be, _digests, _brought, _kept):
        known.clear()


def is_stale(scene: bpy.types.Scene) -> bool:
    """Return whether settings have changed since the forest was built; for drawing."""
    built = scene.forest_sensing.built
    return bool(built) and _now.get(scene.session_uid, built) != built


def fingerprint(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> str:
    """A digest of all that a forest is built from, but for what is in files.

    Raises
    ------
    SpecError : a setting that cannot be used, or an object that is not there.
    """
    from ...blender.read.inputs import read_painted, read_places, read_terrain

    settings = exchange.to_spec(scene, [])
    folder = bpy.path.abspath(scene.forest_sensing.folder)
    said = (settings.seed, settings.offset, settings.forest, settings.plantings)
    parts = [repr((*said, edited_species(scene), folder))]
    if settings.accuracy.detail == "auto":  # what grows depends on who looks
        parts.append(repr(exchange.to_spec(scene, exchange.usable(scene)).sensors))
    named = [(settings.forest.terrain.object, "forest.terrain.object")]
    for number, planting in enumerate(settings.plantings):
        named.append((planting.painted, f"plantings[{number}].painted"))
        if planting.layout == "list" and planting.collection:
            where = f"plantings[{number}].collection"
            places = read_places(planting.collection, depsgraph, where)
            parts.append(digest([places.position, places.scale, places.rotation]))
    for name, where in named:
        if name and (name, where) not in _digests:
            painted = where.endswith("painted")
            surface: Any = (read_painted if painted else read_terrain)(name, depsgraph, where)
            surface = surface if painted else surface.surface
            weight = surface.weight if painted else b""
            _digests[name, where] = digest([surface.vertices, surface.triangles, weight])
        parts.append(_digests.get((name, where), ""))
    return digest(["\n".join(parts).encode()])


def settle(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph, brought: bool = False) -> str:
    """Take the fingerprint anew; returns it if Live should build it, else nothing.

    brought : the change was undo, redo or a file, and is let be.
    """
    props, key = scene.forest_sensing, scene.session_uid
    try:
        mark = fingerprint(scene, depsgraph)
    except PROBLEMS:
        mark = UNUSABLE
    _now[key] = mark
    if brought:
        _let_be[key] = mark
    if mark == props.built:
        _let_be.pop(key, None)
    return "" if not props.live or mark in (UNUSABLE, props.built, _let_be.get(key)) else mark


def begin_live(scene: bpy.types.Scene) -> None:
    """Live was switched on or off: what was let be is so no longer."""
    _let_be.pop(scene.session_uid, None)


def let_be(scene: bpy.types.Scene, mark: str) -> None:
    """Mark a scene as being built: however it ends, it is not begun again by itself."""
    _let_be[scene.session_uid] = mark


# ---------------------------------------------------------------------------------- what is reported


@bpy.app.handlers.persistent
def _hear(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Something has changed."""
    global _due
    brought = scene.session_uid in _brought
    _brought.discard(scene.session_uid)
    props = scene.forest_sensing
    if not (props.built or props.live) or is_rendering():
        return
    if brought:
        settle(scene, depsgraph, brought)
        return
    _forget_changed(depsgraph)
    _due = time.monotonic() + QUIET
    if not bpy.app.timers.is_registered(_settle):
        bpy.app.timers.register(_settle, first_interval=QUIET, persistent=True)


@bpy.app.handlers.persistent
def _hear_brought(*_: object) -> None:
    """All may have changed, and nobody has touched a setting."""
    _brought.update(scene.session_uid for scene in bpy.data.scenes)
    _digests.clear()


def _forget_changed(depsgraph: bpy.types.Depsgraph) -> None:
    """Read again what Blender says has changed."""
    changed = {
        update.id.name
        for update in depsgraph.updates
        if update.is_updated_geometry or update.is_updated_transform
    }
    for name, where in list(_digests):
        if name in changed or name.rpartition(":")[0] in changed:  # until Blender says so
            del _digests[name, where]


def _settle() -> float | None:
    """Timer's work when it has been quiet: seconds until the next look, None when there is nothing
    more."""
    left = _due - time.monotonic()
    if left > 0:
        return left
    windows = bpy.context.window_manager.windows
    if any(op.bl_idname.startswith(DRAGGING) for w in windows for op in w.modal_operators):
        return LOOK
    waits = [_attend(window) for window in windows]  # every one of them
    return LOOK if True in waits else None


def _attend(window: bpy.types.Window) -> bool:
    """See to the scene of a window; whether there is something to wait for."""
    global _building
    scene = window.scene
    if exchange.forestless(scene.forest_sensing):
        return False
    area = next((area for area in window.screen.areas if area.type == "VIEW_3D"), None)
    region = None if area is None else region_of(area, "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        was = is_stale(scene)
        mark = settle(scene, bpy.context.evaluated_depsgraph_get())
        if was != is_stale(scene):
            redraw_panels()
        job = current()
        if _building is not None and _building[0] is not job:
            _building = None
        of_this = _building is not None and _building[1] == scene.session_uid
        if of_this and _now[scene.session_uid] != _building[2]:
            stop()
        if not mark or (job is None and obstacle(bpy.context)):
            return False
        if job is not None:
            return True
        if bpy.ops.forest.live("INVOKE_DEFAULT") == {"CANCELLED"}:
            return True
        let_be(scene, mark)
        begun = current()
        _building = None if begun is None else (begun, scene.session_uid, mark)
    return False


WINDOW_HANDLERS = (
    *((name, _hear) for name in ("depsgraph_update_post", "frame_change_post")),
    *((name, _hear_brought) for name in ("undo_post", "redo_post", "load_post")),
)


DEMO = ASSETS / "scenes" / "demo.toml"
_kept: dict[str, TreesBefore] = {}  # trees that grew last, once some have


def _grown(site: ForestSite, tell: Progress) -> GrownForest:
    """Grow a forest, but for trees that have grown before, in another season perhaps."""
    from ...stand.forest import keep_trees

    return site.grow(tell, kept=_kept.setdefault("trees", keep_trees()))


def read_site(
    context: bpy.types.Context, settings: Scene, folder: Path
) -> Generator[Task, Any, ForestSite]:
    """Read the files and objects of a scene as part of a job, with the species that it edits."""
    from ...blender.read.inputs import with_objects
    from ...site import ForestSite

    edited = edited_species(context.scene)

    def read(_tell: Any) -> Any:
        return ForestSite.read(settings, folder, lambda name, home: load(name, home, edited))

    site = yield Task(say("reading files"), read)
    return with_objects(site, context.evaluated_depsgraph_get())


class FOREST_OT_build(Working, bpy.types.Operator):
    """Grow the trees and plant them; a forest that stands is replaced, its results stay and are marked"""

    bl_label = "Grow Forest"

    frame: bpy.props.BoolProperty(
        name="Frame",
        description="Turn every 3D view to the forest",
        options={"HIDDEN", "SKIP_SAVE"},
    )

    def work(self, context: bpy.types.Context) -> Work:
        started, scene = time.perf_counter(), context.scene
        yield getting_ready("site", "blender.scene.forest", "ui.results.finding")
        from ...blender.scene.assets import tell_variants, untold
        from ...blender.scene.forest import (
            SHOWN_IN_FULL,
            are_points,
            build,
            make_ready,
            shapes_in,
            tell_of,
            triangles_of,
        )
        from ..results.finding import keep_forest

        demo = forestless(scene.forest_sensing)
        changed = 0 if demo else take_up_changes(scene)
        given = read_settings(DEMO, Scene) if demo else to_spec(scene, exchange.usable(scene))
        settings = beside_cube(scene, given) if demo else given
        if demo and sensors_of(scene):
            settings = replace(settings, sensors=())  # those that are there are the user's own
        folder = DEMO.parent if demo else Path(bpy.path.abspath(scene.forest_sensing.folder))
        mark = "" if demo else fingerprint(scene, context.evaluated_depsgraph_get())

        site = yield from read_site(context, settings, folder)
        forest = yield Task(say("growing trees"), partial(_grown, site))
        known, points = shapes_in(scene), are_points(settings.forest, forest)
        if settings.forest.instancing == "auto" and triangles_of(forest) > SHOWN_IN_FULL:
            points = True  # a view can show stand-ins then
            grown = replace(site.scene.forest, instancing="points")
            site = replace(site, scene=replace(site.scene, forest=grown))
        make = partial(make_ready, forest, known, points, drawable=running.drawable())
        ready = yield Task(say("preparing trees"), make)
        if demo:  # only now: whoever cancels has the scene of before
            take_scene(scene, settings, folder, keep_sensors=True)
            mark = fingerprint(scene, context.evaluated_depsgraph_get())
        first = "forest" not in scene.forest_sensing.results
        build(scene, site.scene, forest, site.inputs.terrain, as_assets=False, ready=ready)
        scene.forest_sensing.built = mark
        if getattr(self, "frame", False):
            for _, area in views():
                look_at(area, settings.forest)
        elif first and context.area is not None and context.area.type == "VIEW_3D":
            look_at(context.area, settings.forest)
        said = keep_forest(context, settings, forest, time.perf_counter() - started)
        new = untold(scene, forest)
        if new:
            if hasattr(self, "_job"):  # whoever cancels now keeps the forest
                self._job.kept.append(say("the forest"))
            make = partial(tell_of, forest, new)
            told = yield Task(say("measuring trees, drawing their pictures"), make)
            tell_variants(scene, forest, told)
        return f"{said}; {say('{count} changed by hand', count=changed)}" if changed else said


@button("New Seed", Button)
def new_seed(_button: Button, context: bpy.types.Context) -> str:
    """Throw the dice: another seed is another forest. Press Grow Forest to see it"""
    # Not a stream of the scene: this is the one place where chance itself is wanted.
    context.scene.forest_sensing.seed = secrets.randbelow(1_000_000)
    return ""
