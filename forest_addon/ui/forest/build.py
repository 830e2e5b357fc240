"""Building the forest: the button, and the dice beside the seed.

An operator asks the panel's properties for settings, hands them to the rooms below and says what came
of it. Those rooms, and scipy with them, are imported when an operator runs and not before.
"""

from __future__ import annotations

import secrets
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import bpy

from ...base.places import ASSETS
from ...base.progress import Progress
from ...blender.jobs import Task, Work
from ...blender.sensors.objects import sensors_of
from ...spec import Scene
from ..settings.exchange import forestless, to_spec
from ..shell import pace
from ..shell.running import InOwnScene, Working, getting_ready
from ..shell.views import look_at, views
from ..shell.words import say
from ..species.edit import edited_species, load
from . import live
from .beside import beside_cube
from .hand_edits import take_up_changes
from .scene_file import take_scene

if TYPE_CHECKING:  # they bring scipy
    from ...site import ForestSite
    from ...stand.forest import GrownForest, TreesBeforeFall

DEMO = ASSETS / "scenes" / "demo.toml"
_kept: dict[str, TreesBeforeFall] = {}  # trees of the forest that grew last, once one has


def _import_rooms(_tell: Any) -> None:
    from ... import site  # noqa: F401
    from ...blender import site as blender_site  # noqa: F401
    from ..results import finding  # noqa: F401


def _grown(site: ForestSite, tell: Progress) -> GrownForest:
    """Grow a forest, but for trees that are those of the forest before, in another season perhaps."""
    from ...stand.forest import TreesBeforeFall

    kept = _kept.setdefault("trees", TreesBeforeFall())
    forest = site.grow(tell, kept=kept)
    kept.forget_others()
    return forest


def unregister() -> None:
    """Forget the trees of the last forest."""
    _kept.clear()


class FOREST_OT_build(Working, bpy.types.Operator):
    """Grow the trees and plant them, in place of the forest that stands; results stay and are marked"""

    bl_idname = "forest.build"
    bl_label = "Grow Forest"

    frame: bpy.props.BoolProperty(
        name="Frame",
        description="Turn every 3D view to the forest",
        options={"HIDDEN", "SKIP_SAVE"},
    )

    def work(self, context: bpy.types.Context) -> Work:
        started, scene = time.perf_counter(), context.scene
        yield getting_ready(_import_rooms)
        from ...blender.scene.assets import tell_variants, untold
        from ...blender.scene.forest import (
            SHOWN_IN_FULL,
            are_points,
            make_ready,
            shapes_in,
            tell_of,
            triangles_of,
        )
        from ...blender.site import build_site, with_objects
        from ...formats.toml_file import read_settings
        from ...site import ForestSite
        from ..results.finding import keep_forest

        demo = forestless(scene.forest_sensing)
        changed = 0 if demo else take_up_changes(scene)
        given = read_settings(DEMO, Scene) if demo else to_spec(scene)
        settings = beside_cube(scene, given) if demo else given
        if demo and sensors_of(scene):
            settings = replace(settings, sensors=())  # those that are there are the user's own
        edited = edited_species(scene)
        folder = DEMO.parent if demo else Path(bpy.path.abspath(scene.forest_sensing.folder))
        mark = "" if demo else live.fingerprint(scene, context.evaluated_depsgraph_get())

        def read(_tell: Any) -> Any:
            return ForestSite.read(settings, folder, lambda name, home: load(name, home, edited))

        site = yield Task(say("reading files"), read)
        site = with_objects(site, context.evaluated_depsgraph_get())
        forest = yield Task(say("growing trees"), partial(_grown, site))
        known, points = shapes_in(scene), are_points(settings.forest, forest)
        if settings.forest.instancing == "auto" and triangles_of(forest) > SHOWN_IN_FULL:
            points = True  # a view can show stand-ins then
            grown = replace(site.scene.forest, instancing="points")
            site = replace(site, scene=replace(site.scene, forest=grown))
        make = partial(make_ready, forest, known, points, drawable=pace.drawable())
        ready = yield Task(say("preparing trees"), make)
        if demo:  # only now: whoever cancels has the scene of before
            take_scene(scene, settings, folder, keep_sensors=True)
            mark = live.fingerprint(scene, context.evaluated_depsgraph_get())
        first = "forest" not in scene.forest_sensing.results
        build_site(scene, site, forest, as_assets=False, ready=ready)
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


class FOREST_OT_new_seed(InOwnScene, bpy.types.Operator):
    """Throw the dice: another seed is another forest. Press Grow Forest to see it"""

    bl_idname = "forest.new_seed"
    bl_label = "New Seed"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        props = context.scene.forest_sensing
        # Not a stream of the scene: this is the one place where chance itself is wanted.
        props.seed = secrets.randbelow(1_000_000)
        return {"FINISHED"}


CLASSES = (FOREST_OT_build, FOREST_OT_new_seed)
