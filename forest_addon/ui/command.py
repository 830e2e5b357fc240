"""``blender --command forest run SCENE.toml``: what runs without a screen, from the installed extension."""

from __future__ import annotations

import runpy
from pathlib import Path

import bpy

ENTRY = Path(__file__).resolve().parents[2] / "headless" / "in_blender.py"

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
    return int(runpy.run_path(str(ENTRY))["run"](words or ["--help"]))
