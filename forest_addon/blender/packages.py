"""Advice on how to install a Python package that the extension does without."""

from __future__ import annotations

import sys

import bpy


def to_install(package: str) -> str:
    """Command to type: a plain Python knows where; Blender looks beside the add-ons of a user."""
    where = ""
    if bpy.app.binary_path:
        folder = bpy.utils.user_resource("SCRIPTS", path="addons")
        where = f'--target "{folder}/modules" '
    return f'"{sys.executable}" -m pip install {where}{package}'
