"""``blender --command forest run SCENE.toml``: what runs without a screen, from the installed extension."""

from __future__ import annotations

import importlib.util
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
    spec = importlib.util.spec_from_file_location("forest_sensing_in_blender", ENTRY)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return int(module.run(words or ["--help"]))
