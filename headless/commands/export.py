"""``python -m headless export``: a scene for other programs, as surveys of HELIOS++, OBJ parts and JSON."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command import SCENE_HELP, Command, read_scene, scene_file
from ..progress import Stages, hushed


class ExportCommand(Command):
    name = "export"
    default = "{}-export"
    whole = True
    help = "write a scene for HELIOS++ and other programs: OBJ parts, XML, JSON"
    description = (
        "Grow a scene and write it for other programs: each mesh once as OBJ, a scene of HELIOS++, a survey "
        "for each scanner that it can tell, and scene.json with places, labels, sensors, ways and seeds."
    )
    epilog = """\
examples:
  python -m headless export hedge --out out/hedge-export
  python -m headless lidar --survey out/hedge-export/data/surveys/hedge-tripod.xml

What HELIOS++ cannot say is printed, and stands in scene.json."""

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("scene", type=scene_file, metavar="SCENE", help=SCENE_HELP)
        parser.add_argument(
            "--out", type=Path, metavar="FOLDER", help="default out/SCENE-export; made if missing"
        )
        parser.add_argument("--seed", type=int, help="another seed than the scene file's")
        parser.add_argument(
            "--quiet", action="store_true", help="say nothing but warnings and errors"
        )

    def run(self, chosen: argparse.Namespace) -> None:
        export_scene(chosen.scene, chosen.out, chosen.seed, quiet=chosen.quiet)


def export_scene(path: Path, folder: Path, seed: int | None = None, quiet: bool = False) -> None:
    """Grow a scene file and write it for other programs.

    Raises
    ------
    SpecError : a scene that cannot be used.
    OSError : a file that cannot be written.
    """
    stages = Stages(quiet)
    scene = read_scene(path, seed)
    with stages.stage("load bpy"), hushed():
        import bpy

        from forest_addon.api.site import build
        from forest_addon.blender.files.others import export_for_others
        from forest_addon.blender.sensors.observe import Observer
        from forest_addon.sensing.lidar.surveys.export import flown
    with stages.stage("grow the forest"), hushed():
        build(scene, folder=path.parent)
        observer = Observer(bpy.context.evaluated_depsgraph_get(), scene.rays)
        ways = {s.name: flown(s) or observer.way(s, path.parent) for s in scene.sensors}
    told: list[str] = []
    with stages.stage("write files"), hushed():
        export_for_others(scene, observer.geometry, ways, folder, told.append)
    for sentence in told:
        stages.say(sentence)
