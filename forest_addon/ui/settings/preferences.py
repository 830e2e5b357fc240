"""Preferences of the add-on: how rays are cast where a scene leaves it open, and the cache.

The cache holds what libraries compute once a machine (the fonts of pictures). It lies in the folder that
Blender gives this extension, and can be cleared at any time.
"""

from __future__ import annotations

import functools
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ... import spec
from ..shell.words import label, say
from .fields import fields_of
from .groups import property_of

ROOT = (__package__ or "").split(".forest_addon")[0].removesuffix(".ui")
FRESH = 2.0  # s that the size of the cache is shown before it is looked up again


def _ray_fields() -> dict[str, Any]:
    """Engine and threads, with the words of ``spec``."""
    return {
        name: property_of(name, kind, known, default)
        for name, kind, known, default in fields_of(spec.Rays)
    }


class FOREST_AP_preferences(bpy.types.AddonPreferences):
    """Preferences that hold for every scene that does not say otherwise."""

    bl_idname = ROOT
    __annotations__ = _ray_fields()

    def draw(self, _context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.label(text="Ray casting, for scenes left to auto")
        column.prop(self, "engine")
        column.prop(self, "threads")
        column.label(text="Cache")
        row = column.row()
        row.label(text=str(cache_folder()))
        row.operator(
            "forest.clear_cache",
            text=label("Clear {size}", size=_megabytes(_recently())),
            icon="TRASH",
        )
        column.label(text="Asset Library")
        row = column.row()
        row.label(text=str(library_folder()))
        row.operator("forest.add_library", icon="ASSET_MANAGER")


class FOREST_OT_clear_cache(bpy.types.Operator):
    """Remove what is cached; it is computed again when it is needed"""

    bl_idname = "forest.clear_cache"
    bl_label = "Clear Cache"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if not cache_folder().is_dir():
            cls.poll_message_set(say("The cache is empty"))
            return False
        return True

    def execute(self, _context: bpy.types.Context) -> set[str]:
        size = cache_size()
        shutil.rmtree(cache_folder(), ignore_errors=True)
        expansions.cache_clear()
        self.report({"INFO"}, say("{size} were removed", size=_megabytes(size)))
        return {"FINISHED"}


def chosen() -> Any:
    """The preferences, None where the add-on runs without being installed."""
    addon = bpy.context.preferences.addons.get(ROOT)
    return addon.preferences if addon else None


def rays_of(rays: spec.Rays) -> spec.Rays:
    """Return how rays are cast: as the scene says, else as the preferences say."""
    mine = chosen()
    if mine is None:
        return rays
    engine = mine.engine if rays.engine == "auto" else rays.engine
    return replace(rays, engine=engine, threads=rays.threads or mine.threads)


def cache_folder() -> Path:
    """The extension's own folder for what can be computed again; it need not exist."""
    return _home() / "cache"


def species_folder() -> Path:
    """Return where one's own species are kept; it need not exist."""
    return _home() / "species"


def library_folder() -> Path:
    """Return where trees are written as assets; it need not exist."""
    return _home() / "library"


def _home() -> Path:
    """The folder that Blender gives this extension; a temporary one where it is not installed."""
    if chosen() is None or not ROOT.startswith("bl_ext."):
        return Path(bpy.app.tempdir) / "forest_sensing"
    return Path(bpy.utils.extension_path_user(ROOT))


@functools.cache
def expansions() -> Any:
    """Expansions of trunk scattering, kept as long as Blender runs."""
    from ...sensing.reverb.sums.fast_scattering import Expansions

    return Expansions()


def cache_size() -> int:
    """Bytes of all files in the cache."""
    return sum(file.stat().st_size for file in cache_folder().rglob("*") if file.is_file())


_seen = (float("-inf"), 0)


def _recently() -> int:
    """The size of the cache, not looked up at every redraw."""
    global _seen
    if time.monotonic() - _seen[0] > FRESH:
        _seen = (time.monotonic(), cache_size())
    return _seen[1]


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.1f} MB"


CLASSES = (FOREST_AP_preferences, FOREST_OT_clear_cache)
