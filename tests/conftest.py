"""Fixtures that several tests share."""

import pytest


@pytest.fixture
def empty_blender():
    """Blender with nothing in it."""
    bpy = pytest.importorskip("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy
