"""The sway of a scene's trees: of the forest that stands, grown once more where it is not in memory."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any

import bpy

from ...blender.jobs import Task
from ..settings.exchange import to_spec
from ..shell.words import say
from ..species.edit import edited_species, load
from . import live

_known: dict[int, tuple[Any, Any]] = {}  # of scenes: what the sway follows from, and it


def swaying(context: bpy.types.Context, missing: list[str]) -> Generator[Task, Any, Any]:
    """Give the sway of the trees of a scene as part of a job; None where they stand still.

    missing : gets a sentence where trees stand still although there is wind.
    """
    scene = context.scene
    settings = to_spec(scene)
    if settings.wind.speed == 0 or not scene.forest_sensing.built:
        return None
    mark = live.fingerprint(scene, context.evaluated_depsgraph_get())
    if mark != scene.forest_sensing.built:
        missing.append(
            say("Trees stand still: the forest is older than its settings. Press Grow Forest")
        )
        return None
    key = mark, settings.wind
    if _known.get(scene.session_uid, (None,))[0] == key:
        return _known[scene.session_uid][1]
    from ...blender.scene.forest import standing_forest
    from ...blender.site import with_objects
    from ...site import ForestSite
    from ...stand.wind.sway import sway_of

    forest = standing_forest(scene)
    if forest is None:
        edited, folder = edited_species(scene), Path(bpy.path.abspath(scene.forest_sensing.folder))

        def read(_tell: Any) -> Any:
            return ForestSite.read(settings, folder, lambda name, home: load(name, home, edited))

        site = yield Task(say("reading files"), read)
        site = with_objects(site, context.evaluated_depsgraph_get())
        forest = yield Task(say("growing trees, to know how they sway"), site.grow)
    _known.clear()
    _known[scene.session_uid] = key, sway_of(forest, settings.wind, settings.seed)
    return _known[scene.session_uid][1]
