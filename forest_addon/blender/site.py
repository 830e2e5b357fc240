"""A site in Blender: what objects of the open file add to it, and the forest that grew there as a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import bpy

from ..site import ForestSite
from ..spec import SpecError
from ..stand.forest import GrownForest
from .read.inputs import inputs_from_scene
from .scene.forest import ReadyForest, build
from .show.wind import hide_wind

S = TypeVar("S", bound=ForestSite)


def with_objects(site: S, depsgraph: bpy.types.Depsgraph | None = None) -> S:
    """Add the ground, painted weights and places of trees that objects of the open scene give.

    Raises
    ------
    SpecError : there is no such object, layer or collection; says what there is.
    """
    depsgraph = depsgraph or bpy.context.evaluated_depsgraph_get()
    return replace(site, inputs=inputs_from_scene(site.scene, depsgraph, site.inputs))


def build_site(
    place: bpy.types.Scene,
    site: ForestSite,
    forest: GrownForest,
    *,
    as_assets: bool = True,
    looks: bool = True,
    ready: ReadyForest | None = None,
) -> None:
    """Put a forest that grew on a site into a Blender scene, in place of the one that stands there.

    as_assets : whether variants become assets, each with a picture. looks : whether somebody may see it, or
    change it later. ready : what was made ahead.

    Raises
    ------
    SpecError : something that stands there is in the way; nothing is changed.
    """
    try:
        how = {"as_assets": as_assets, "looks": looks}
        build(place, site.scene, forest, site.inputs.terrain, **how, ready=ready)
    except ValueError as problem:
        raise SpecError("build", str(problem)) from None
    hide_wind(place)  # which moved the trees of before
