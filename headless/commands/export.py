"""``python -m headless export``: a scene for other programs, as surveys of HELIOS++, OBJ parts and JSON."""

from __future__ import annotations

import argparse

from ..command import read_scene
from ..progress import Stages, hushed


def run(chosen: argparse.Namespace) -> None:
    """Grow a scene file and write it for other programs.

    Raises
    ------
    SpecError : a scene that cannot be used.
    OSError : a file that cannot be written.
    """
    stages, folder = Stages(chosen.quiet), chosen.scene.parent
    scene = read_scene(chosen.scene, chosen.seed)
    with stages.stage("load bpy"), hushed():
        import bpy

        from forest_addon.api.world import build
        from forest_addon.blender.files.others import export_for_others
        from forest_addon.blender.sensors.observe import Observer
        from forest_addon.sensing.lidar.surveys.export import flown
    with stages.stage("grow the forest"), hushed():
        build(scene, folder=folder)
        observer = Observer(bpy.context.evaluated_depsgraph_get(), scene.rays)
        ways = {s.name: flown(s) or observer.way(s, folder) for s in scene.sensors}
    told: list[str] = []
    with stages.stage("write files"), hushed():
        export_for_others(scene, observer.geometry, ways, chosen.out, told.append)
    for sentence in told:
        stages.say(sentence)
