"""``blender --command forest run SCENE.toml``: what runs without a screen, from the installed extension."""

from __future__ import annotations

import os
import runpy

import bpy

from ...base import places
from .preferences import ROOT, cache_folder

ENTRY = places.ROOT / "headless" / "in_blender.py"

_handles: list = []


def register() -> None:
    """Make the command known."""
    _handles.append(bpy.utils.register_cli_command("forest", run))


def unregister() -> None:
    """Take it back."""
    while _handles:
        bpy.utils.unregister_cli_command(_handles.pop())


def run(words: list[str]) -> int:
    """Run the command line in this Blender; returns its exit code."""
    if ROOT.startswith("bl_ext."):  # an extension writes to no other folder of the user by itself
        for cache in ("XDG_CACHE_HOME", "MPLCONFIGDIR"):
            os.environ.setdefault(cache, str(cache_folder()))
    return int(runpy.run_path(str(ENTRY))["run"](words or ["--help"]))
