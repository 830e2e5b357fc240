"""Scanner files: published figures of real instruments, as settings that a sensor starts from.

``title`` and ``source`` say what it is and where the figures are from, ``assumed`` names the settings that
its maker does not publish. ``[common]`` and one table for each platform that it is used on
(``[terrestrial]``, ``[mobile]``, ``[airborne]``) hold settings as a sensor of a scene file does; the
sensor's own settings go over them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..base.places import ASSETS
from ..spec import SENSORS, SpecError, unknown
from .toml_text import read_tables, without_version

FOLDER = ASSETS / "scanners"
PLATFORMS = tuple(kind for kind, settings in SENSORS.items() if hasattr(settings, "scanner"))


@dataclass(frozen=True)
class ScannerFile:
    """Content of a scanner file; ``tables`` are the settings of each platform."""

    title: str
    source: str
    assumed: tuple[str, ...]
    tables: Mapping[str, Mapping[str, Any]]


def scanner_names() -> list[str]:
    """Every preset of ``assets/scanners``."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def read_scanner(name: str, folder: Path = Path()) -> ScannerFile:
    """A preset, or a file of that name relative to ``folder``.

    Raises
    ------
    SpecError : there is no such scanner, or its file cannot be used.
    """
    path = folder / name if name.endswith(".toml") else FOLDER / f"{name}.toml"
    if not path.is_file() or (not name.endswith(".toml") and name not in scanner_names()):
        raise unknown("scanner", name, scanner_names(), ", or a .toml file")
    try:
        table, _ = without_version(read_tables(path), str(path))
    except SpecError as problem:
        raise SpecError("scanner", f"{path} cannot be read: it {problem.problem}") from None
    known_keys = {"title", "source", "assumed", "common", *PLATFORMS}
    for key in table.keys() - known_keys:
        raise SpecError(
            "scanner", f"{path}: {key} is not known; use {', '.join(sorted(known_keys))}"
        )
    common = table.get("common", {})
    platforms = {kind: merged(common, table[kind]) for kind in PLATFORMS if kind in table}
    if not platforms:
        raise SpecError(
            "scanner", f"{path} has no table for any of {', '.join(PLATFORMS)}; add one"
        )
    return ScannerFile(
        title=str(table.get("title", path.stem)),
        source=str(table.get("source", "")),
        assumed=tuple(map(str, table.get("assumed", ()))),
        tables=platforms,
    )


def settings_of(name: str, kind: str, folder: Path = Path()) -> Mapping[str, Any]:
    """The settings that a sensor of this kind starts from.

    Raises
    ------
    SpecError : there is no such scanner, or it is not used on this platform.
    """
    tables = read_scanner(name, folder).tables
    if kind not in tables:
        able = " or ".join(f'"{k}"' for k in tables)
        raise SpecError("scanner", f'"{name}" is no {kind} scanner; use kind = {able}, or another')
    return tables[kind]


def merged(under: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """One table over another, tables within them likewise."""
    both = dict(under)
    for key, value in over.items():
        below = both.get(key)
        nested = isinstance(value, Mapping) and isinstance(below, Mapping)
        both[key] = merged(below, value) if nested else value  # type: ignore[arg-type]
    return both
