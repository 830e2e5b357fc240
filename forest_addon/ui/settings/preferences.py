"""Extension as it is installed: its preferences, cache, command and manual.

Preferences say how rays are cast where a scene leaves it open. The cache holds what libraries compute once a
machine (the fonts of pictures). It lies in the folder that Blender gives this extension, and can be cleared
at any time. The command is ``blender --command forest run SCENE.toml``, of an open file's own
sensors ``blender -b FILE.blend --command forest run``.

F1 over a button or a setting opens a page of the manual. The extension carries it
(packaging/write_manual.py), so no network is asked for; in a working copy the same pages are docs/*.md. A
setting leads to its line in the page of scene and species files, an operator to the paragraph of the panel,
or of its subject, that says what it does.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import runpy
import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy

from ... import spec
from ...base import places
from ...base.places import ROOT
from ...spec import Settings
from ..shell.running import Reading, button
from ..shell.words import keep, label, say
from .groups import FACE, fields_of, property_of

ADDON = (__package__ or "").split(".forest_addon")[0].removesuffix(".ui")
FRESH = 2.0  # s that the size of the cache is shown before it is looked up again


class FOREST_AP_preferences(bpy.types.AddonPreferences):
    """Preferences that hold for every scene that does not say otherwise."""

    bl_idname = ADDON
    __annotations__ = {field.name: property_of(field) for field in fields_of(spec.Rays)}

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
            text=label("Clear {size}", size=_megabytes(_size_at(int(time.monotonic() / FRESH)))),
            icon="TRASH",
        )
        column.label(text="Asset Library")
        row = column.row()
        row.label(text=str(library_folder()))
        row.operator("forest.add_library", icon="ASSET_MANAGER")


CACHED = (lambda _context: cache_folder().is_dir(), keep("The cache is empty"))


@button("Clear Cache", Reading, needs=(CACHED,))
def clear_cache(_button: Reading, _context: bpy.types.Context) -> str:
    """Remove what is cached; it is computed again when it is needed"""
    size = cache_size()
    shutil.rmtree(cache_folder(), ignore_errors=True)
    expansions.cache_clear()
    return say("{size} were removed", size=_megabytes(size))


def chosen() -> Any:
    """The preferences, None where the add-on runs without being installed."""
    addon = bpy.context.preferences.addons.get(ADDON)
    return addon.preferences if addon else None


def rays_of(rays: spec.Rays) -> spec.Rays:
    """Settings of rays: the scene's, else those of the preferences."""
    preferred = chosen()
    if preferred is None:
        return rays
    engine = preferred.engine if rays.engine == "auto" else rays.engine
    return replace(rays, engine=engine, threads=rays.threads or preferred.threads)


def cache_folder() -> Path:
    """The extension's own folder for what can be computed again; it need not exist."""
    return _home() / "cache"


def species_folder() -> Path:
    """Folder of a user's own species; it need not exist."""
    return _home() / "species"


def library_folder() -> Path:
    """Folder of trees that are written as assets; it need not exist."""
    return _home() / "library"


def _home() -> Path:
    """The folder that Blender gives this extension; a temporary one where it is not installed."""
    if chosen() is None or not ADDON.startswith("bl_ext."):
        return Path(bpy.app.tempdir) / "forest_sensing"
    return Path(bpy.utils.extension_path_user(ADDON))


@functools.cache
def expansions() -> Any:
    """Expansions of trunk scattering, kept as long as Blender runs."""
    from ...sensing.reverb.sums.fast_scattering import Expansions

    return Expansions()


def cache_size() -> int:
    """Bytes of all files in the cache."""
    return sum(file.stat().st_size for file in cache_folder().rglob("*") if file.is_file())


@functools.lru_cache(maxsize=1)
def _size_at(_moment: int) -> int:
    """The size of the cache, not looked up at every redraw."""
    return cache_size()


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.1f} MB"


ENTRY = places.ROOT / "headless" / "in_blender.py"

_handles: list = []


def run(words: list[str]) -> int:
    """Run the command line in this Blender; returns its exit code."""
    if ADDON.startswith("bl_ext."):  # an extension writes to no other folder of the user by itself
        for cache in ("XDG_CACHE_HOME", "MPLCONFIGDIR"):
            os.environ.setdefault(cache, str(cache_folder()))
    return int(runpy.run_path(str(ENTRY))["run"](words))


CARRIED, DOCS = ROOT / "manual", ROOT / "docs"
START, FOREST, SENSORS = "from-nothing-to-results", "the-forest", "sensors"
RESULTS, FILES = "results", "the-same-without-a-window"
PLACES = {  # where panel.md speaks of operators
    **dict.fromkeys(("add_tree", "grow_again", "gallery", "new", "start", "scan_here"), START),
    **dict.fromkeys(
        ("build", "live", "paint", "edit_species", "make_species", "save_species"), FOREST
    ),
    **dict.fromkeys(("plant", "lock_trees", "swap_trees", "remove_trees", "adopt_trees"), FOREST),
    **dict.fromkeys(
        (
            "add_sensor",
            "remove_sensor",
            "choose_instrument",
            "run",
            "run_frames",
            "run_large",
            "cancel",
        ),
        SENSORS,
    ),
    **dict.fromkeys(
        ("export_result", "remove_result", "show_picture", "play", "select_result"), RESULTS
    ),
    **dict.fromkeys(("save_scene", "load_scene"), FILES),
}
PAGES = {  # operators of which another page speaks
    "import_tree": "template",
    "add_flight": "flight",
    "fly": "flight",
    "export_others": "lidar",
    "make_library": "asset-library",
    "add_library": "asset-library",
}

Map = tuple[str, list[tuple[str, str]]]


def manual_map() -> Map:
    """Blender's hook: where the pages are, and the page for each pattern of names; the first that fits."""
    pages = list(_pages())
    if CARRIED.is_dir():
        return f"{CARRIED.as_uri()}/", pages
    own = {file.stem for file in (*DOCS.glob("*.md"), *DOCS.glob("guide/*.md"))}
    guides = {file.stem for file in DOCS.glob("guide/*.md")} - {f.stem for f in DOCS.glob("*.md")}
    found = []
    for pattern, page in pages:
        name, _, place = page.partition(".html")
        name = name if name in own else "panel"
        found.append((pattern, f"{'guide/' * (name in guides)}{name}.md{place}"))
    return f"{DOCS.as_uri()}/", found


def _pages() -> Iterator[tuple[str, str]]:
    for name, page in PAGES.items():
        yield f"bpy.ops.forest.{name}", f"{page}.html"
    for name, place in PLACES.items():
        yield f"bpy.ops.forest.{name}", f"panel.html#{place}"
    groups = [*Settings.__subclasses__()]
    for group in groups:  # it grows
        groups += group.__subclasses__()
    for group in groups:
        name = group.__name__.lower()
        for field in (field.name for field in dataclasses.fields(group)):  # type: ignore[arg-type]
            yield f"bpy.types.forest_pg_{name}.{field}", f"scene-file.html#{name}.{field}"
            yield f"bpy.types.forest_pg_{name}.use_{field}", f"scene-file.html#{name}.{field}"
            yield f"bpy.types.forest_pg_{name}.{field}{FACE}", f"scene-file.html#{name}.{field}"
    yield "bpy.ops.forest.*", "panel.html"
    yield "bpy.types.forest_*", "panel.html"


def register() -> None:
    """Make the command and the manual known."""
    _handles.append(bpy.utils.register_cli_command("forest", run))
    bpy.utils.register_manual_map(manual_map)


def unregister() -> None:
    """Take both back."""
    bpy.utils.unregister_manual_map(manual_map)
    while _handles:
        bpy.utils.unregister_cli_command(_handles.pop())
