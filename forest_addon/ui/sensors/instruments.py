"""The menu of instruments: their names, from their files; what is stored stays the name of the file.

Files are read when the menu is first drawn. A scanner file of one's own stands in the menu as long as it is
the one that is chosen.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import bpy

from ..words import label, language

Item = tuple[str, str, str, str, int]
NONE = "NONE"  # no instrument: settings as they are


def menu(name: str, help: str) -> Any:
    """The property that chooses the instrument of a scanner by its name."""
    return bpy.props.EnumProperty(
        name=name,
        description=help,
        items=_offered,
        get=_number_of,
        set=_choose,
        options={"SKIP_SAVE"},
    )


def _offered(group: Any, _context: Any) -> tuple[Item, ...]:
    kind = type(group).__name__.removeprefix("FOREST_PG_")
    return items(kind, group.scanner, language())


def _number_of(group: Any) -> int:
    names = [item[0] for item in _offered(group, None)]
    return names.index(group.scanner) if group.scanner in names else 0


def _choose(group: Any, number: int) -> None:
    group.scanner = "" if number == 0 else _offered(group, None)[number][0]


@functools.lru_cache(maxsize=32)  # Blender wants the texts kept while it shows them
def items(kind: str, chosen: str, _language: str) -> tuple[Item, ...]:
    """None, the presets that are used on this platform by their titles, and what else is chosen."""
    found = [(NONE, label("Any"), label("No instrument: settings as they are below"))]
    found += _presets(kind)
    if chosen and chosen not in [name for name, *_ in found]:
        found.append((chosen, Path(chosen).stem, chosen))
    return tuple((*item, "NONE", number) for number, item in enumerate(found))


@functools.cache
def _presets(kind: str) -> list[tuple[str, str, str]]:
    from ...formats.scanner_file import read_scanner, scanner_names

    read = {name: read_scanner(name) for name in scanner_names()}
    able = [(name, file) for name, file in read.items() if kind in file.tables]
    return sorted(((n, f.title, f.source) for n, f in able), key=lambda item: item[1])
