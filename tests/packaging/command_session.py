"""One Blender session, run by test_command.py: jobs as ``blender --command forest`` runs them.

Usage: command_session.py SCENE.toml FOLDER, the extension being installed. FOLDER/answer.json says what was
installed before and after each job, and how the job ended. The Blender that comes as a module has no
``--command``; the window's test runs the jobs through that.
"""

import json
import sys
from importlib import import_module, metadata
from pathlib import Path

import bpy

# Blender's own module, there once bpy is loaded.
import addon_utils  # isort: skip

MODULE = "bl_ext.user_default.forest_sensing"


def main(scene: str, folder: str) -> None:
    out = Path(folder)
    bpy.ops.preferences.addon_enable(module=MODULE)
    command = import_module(f"{MODULE}.forest_addon.ui.settings.preferences")
    seen = [state()]
    jobs = (
        ["run", scene, "--out", folder, "--quiet"],
        [
            *("lidar", f"{folder}/forest.blend", "--scanner", "riegl-vz-400i", "--at", "5,5,1.6"),
            *("--set", "angle_step_deg=5.0", "--out", f"{folder}/own.laz", "--quiet"),
        ],
        ["stand", scene, "--out", f"{folder}/points.csv"],
    )
    codes = []
    for words in jobs:
        codes.append(command.run(words))
        seen.append(state())
        import_module(
            "headless.commands.work.species"
        ).WIDTH = 300  # pixels of the sheet, which is rendered
    answer = {"codes": codes, "seen": seen, "files": sorted(p.name for p in out.iterdir())}
    (out / "answer.json").write_text(json.dumps(answer, indent=1))


def state() -> dict[str, object]:
    """What the extension brought, as it lies on the disk, and whether it is switched on."""
    local = Path(bpy.utils.user_resource("EXTENSIONS")) / ".local"
    folders = [str(path) for path in local.rglob("site-packages")]
    packages = {dist.name for dist in metadata.distributions(path=folders)}
    return {"packages": sorted(packages), "enabled": addon_utils.check(MODULE)}


if __name__ == "__main__":
    main(*sys.argv[1:])
