"""F1 over a button or a setting: which page of the manual the browser opens.

The extension carries its manual (packaging/write_manual.py), so no network is asked for; in a working copy
the same pages are docs/*.md. A setting leads to its line in the page of scene and species files, an operator
to the paragraph of the panel, or of its subject, that says what it does.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import bpy

from ...base.places import ROOT
from ...spec import Settings
from .shown import FACE

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
    return f"{DOCS.as_uri()}/", [(pattern, _in_working_copy(page)) for pattern, page in pages]


def _pages() -> Iterator[tuple[str, str]]:
    for name, page in PAGES.items():
        yield f"bpy.ops.forest.{name}", f"{page}.html"
    for name, place in PLACES.items():
        yield f"bpy.ops.forest.{name}", f"panel.html#{place}"
    for group in _settings():
        name = group.__name__.lower()
        for field in (field.name for field in dataclasses.fields(group)):  # type: ignore[arg-type]
            yield f"bpy.types.forest_pg_{name}.{field}", f"scene-file.html#{name}.{field}"
            yield f"bpy.types.forest_pg_{name}.use_{field}", f"scene-file.html#{name}.{field}"
            yield f"bpy.types.forest_pg_{name}.{field}{FACE}", f"scene-file.html#{name}.{field}"
    yield "bpy.ops.forest.*", "panel.html"
    yield "bpy.types.forest_*", "panel.html"


def _settings() -> list[type[Settings]]:
    """Every group of settings, those of sensors first made."""
    found: list[type[Settings]] = []
    waiting = list(Settings.__subclasses__())
    while waiting:
        group = waiting.pop(0)
        found.append(group)
        waiting += group.__subclasses__()
    return found


def _in_working_copy(page: str) -> str:
    name, _, place = page.partition(".html")
    file = next((f for f in (f"{name}.md", f"guide/{name}.md") if (DOCS / f).exists()), "panel.md")
    return file + place


def register() -> None:
    bpy.utils.register_manual_map(manual_map)


def unregister() -> None:
    bpy.utils.unregister_manual_map(manual_map)
