"""TOML files into settings and back, with one clear sentence for whatever is wrong.

cattrs structures the tables into the dataclasses of ``spec``; the hooks here are strict (no number is made
of a text, no unknown key is passed over), and ``explain`` turns what cattrs raises into a ``SpecError``
that names the file, the key and what is allowed.

Files of settings may say the version of Forest Sensing that they were written for, ``version`` at the top;
one that says none is read as one of this version. One of a later minor version is read, and what it says
that this version does not know is put down to that; one of a later major version is refused.

Scanner files are published figures of real instruments, as settings that a sensor starts from. ``title``
and ``source`` say what it is and where the figures are from, ``assumed`` names the settings that its maker
does not publish. ``[common]`` and one table for each platform that it is used on (``[terrestrial]``,
``[mobile]``, ``[airborne]``) hold settings as a sensor of a scene file does; the sensor's own settings go
over them.
"""

from __future__ import annotations

import dataclasses
import re
import tomllib
import typing
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from ..base.places import ASSETS, version
from ..spec import AUTO, SENSORS, Sensor, Settings, SpecError, param_of, unknown
from ..spec.base import WORDS, refuse_many, refuse_unknown, shown, typed
from ..spec.choices import idle
from .atomic import replacing
from .foreign import guarded

MOST_BYTES = 100_000_000  # minutes of reading
VERSION_KEY = "version"
VERSION = re.compile(r"(\d{1,6})\.(\d{1,6})(?:\.(\d{1,6}))?")
DIGITS = re.compile(r"[0-9](?:_?[0-9]){999,}")


@guarded("a .toml file", most=MOST_BYTES)
def read_tables(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises
    ------
    SpecError : it is missing, or not TOML.
    """
    return parse_tables(path.read_text(encoding="utf-8-sig"), str(path))


def parse_tables(text: str, place: str) -> dict[str, Any]:
    """The tables of a text; ``place`` names it.

    Raises
    ------
    SpecError : it is not TOML.
    """
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise SpecError(place, "is nested too deeply; no setting needs that") from None
    except tomllib.TOMLDecodeError as problem:
        raise SpecError(place, f"is not TOML: {problem}") from None
    except ValueError as problem:  # Python's own limit of digits; a date that is none
        raise SpecError(place, _long_number(text) or f"is not TOML: {problem}") from None


def without_version(table: Mapping[str, Any], place: str) -> tuple[dict[str, Any], str]:
    """The tables of a file without the version that it was written for, and that ("" where it says none).

    Raises
    ------
    SpecError : that is no version, or a later major one than this; names ``place``.
    """
    rest = {key: value for key, value in table.items() if key != VERSION_KEY}
    if VERSION_KEY not in table:
        return rest, ""
    written = table[VERSION_KEY]
    if not isinstance(written, str) or VERSION.fullmatch(written) is None:
        raise SpecError(place, f'version: {shown(written)} is no version; give one such as "1.0"')
    if _minor(written)[0] > _minor(version())[0]:
        told = f"was written for Forest Sensing {written} and this is {version()}; install {written} or later"
        raise SpecError(place, told)
    return rest, written


def later(written: str) -> str:
    """End of a sentence about what is wrong in a file, where that is of a later version; else nothing."""
    if not written or _minor(written) <= _minor(version()):
        return ""
    return f". The file was written for Forest Sensing {written} and this is {version()}: update it"


def _minor(text: str) -> tuple[int, int]:
    """Major and minor number of a version."""
    major, minor = text.split(".")[:2]
    return int(major), int(minor)


def _long_number(text: str) -> str | None:
    """Place of a number that no one can mean."""
    match = DIGITS.search(text)
    if match is None:
        return None
    line = text.count("\n", 0, match.start()) + 1
    begun = text[text.rfind("\n", 0, match.start()) + 1 : match.start()]
    key = begun.partition("=")[0].strip()
    digits = len(match[0].replace("_", ""))
    return f"line {line}: {key or 'a value'} has a number of {digits:,} digits; give a shorter one"


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


def idle_in_sensor(sensor: Sensor, folder: Path = Path()) -> list[str]:
    """Sentences about settings of a sensor without effect, but for those of the instrument that it is."""
    usual = None
    if scanner := getattr(sensor, "scanner", ""):
        with suppress(SpecError):  # a sensor made in Python may call itself anything
            usual = structure(settings_of(scanner, sensor.kind, folder), type(sensor))
    return idle(sensor, usual)


def merged(under: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """One table over another, tables within them likewise."""
    both = dict(under)
    for key, value in over.items():
        below = both.get(key)
        nested = isinstance(value, Mapping) and isinstance(below, Mapping)
        both[key] = merged(below, value) if nested else value  # type: ignore[arg-type]
    return both


def refuse_unknown_scene(path: Path) -> None:
    """Refuse a word that names no scene of assets/scenes, and no file.

    Raises
    ------
    SpecError : it does not; says the nearest names.
    """
    if not path.suffix and not path.exists():
        known = sorted(scene.stem for scene in (ASSETS / "scenes").glob("*.toml"))
        raise unknown("scene", str(path), known, ", or a .toml file")


T = TypeVar("T", bound=Settings)


@guarded("a .toml file")
def read_settings(path: Path, cls: type[T]) -> T:
    """Read a TOML file into a settings class.

    Raises
    ------
    SpecError : the file is missing or not TOML; an unknown key, a wrong type, a value out of range; it is
        of a later major version.
    """
    table, written = without_version(read_tables(path), str(path))
    try:
        return structure(table, cls, path.parent)
    except SpecError as problem:
        raise SpecError(str(path), f"{problem.key}: {problem.problem}{later(written)}") from None


def write_settings(path: Path, settings: Settings) -> None:
    """Write settings as a TOML file that ``read_settings`` makes equal settings of.

    Values that are the default are left out; the version of Forest Sensing stands first.

    Raises
    ------
    OSError : the file cannot be written; an earlier one is kept.
    """
    import tomli_w

    with replacing(path) as partial:
        tables = {VERSION_KEY: version()} | table_of(settings)
        text = f"# {type(settings).__name__} of Forest Sensing\n\n{tomli_w.dumps(tables)}"
        partial.write_text(text, encoding="utf-8")


def table_of(settings: Settings, whole: bool = False) -> dict[str, Any]:
    """The table of a TOML file for settings; of a sensor always its kind.

    whole : also values that are the default, as for all of a scanner that starts from an instrument's
        figures: what is left out there is the instrument's.
    """
    table: dict[str, Any] = {}
    whole = whole or bool(getattr(settings, "scanner", ""))
    for field in dataclasses.fields(settings):  # type: ignore[arg-type]
        value = getattr(settings, field.name)
        if value is not None and (whole or value != field.default or field.name == "kind"):
            auto = param_of(field).auto and value == AUTO
            table[field.name] = "auto" if auto else _toml(value, whole)
    return table


def _toml(value: Any, whole: bool) -> Any:
    if isinstance(value, Settings):
        return table_of(value, whole)
    return [_toml(item, whole) for item in value] if isinstance(value, tuple) else value


def structure(table: Any, cls: type[T], folder: Path = Path()) -> T:
    """A settings object from plain tables, lists, texts and numbers.

    folder : that scanner files are relative to.

    Raises
    ------
    SpecError : ``key`` is the dotted path within the table.
    """
    from cattrs.errors import BaseValidationError

    try:
        return _converter(folder).structure(table, cls)
    except (BaseValidationError, SpecError) as problem:
        raise explain(problem, cls) from None


def explain(problem: BaseException, cls: type[Settings]) -> SpecError:
    """The first thing that is wrong, as a ``SpecError`` with its dotted path."""
    from cattrs.errors import AttributeValidationNote, BaseValidationError, IterableValidationNote

    path = ""
    while isinstance(problem, BaseValidationError):
        # A misspelt key also leaves its right name missing: name the unknown key first.
        problem = min(problem.exceptions, key=lambda one: isinstance(one, KeyError))
        for note in getattr(problem, "__notes__", []):
            if isinstance(note, AttributeValidationNote):
                path += ("." if path else "") + note.name
            elif isinstance(note, IterableValidationNote):
                path += f"[{note.index}]"
    if isinstance(problem, SpecError):
        separator = "." if path and problem.key and not problem.key.startswith("[") else ""
        return SpecError(path + separator + problem.key, problem.problem)
    if isinstance(problem, KeyError):
        key = str(problem.args[0])
        return SpecError(path or key, "is missing; it has no default")
    return SpecError(path or cls.__name__, str(problem))


@lru_cache(maxsize=8)  # it writes its own code, which takes longer than a scene file
def _converter(folder: Path) -> Any:
    from cattrs import Converter

    converter = Converter(detailed_validation=True)
    for kind in (*WORDS, bool | str):
        converter.register_structure_hook(kind, lambda value, kind: typed("", value, kind))
    converter.register_structure_hook_func(_is_tuple, lambda v, t: _tuple(converter, v, t))
    converter.register_structure_hook_factory(
        lambda t: isinstance(t, type) and issubclass(t, Settings),
        lambda cls: _table_hook(converter, cls),
    )
    converter.register_structure_hook_func(  # comes before those of before
        lambda t: t is Sensor, lambda value, _: _sensor(converter, value, folder)
    )
    return converter


def _table_hook(converter: Any, cls: type[Settings]) -> Any:
    """cattrs' own hook for a dataclass, behind a check that the table has no unknown key."""
    from cattrs.gen import make_dict_structure_fn

    fill = make_dict_structure_fn(cls, converter, _cattrs_detailed_validation=True)
    fields = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]

    def hook(value: Any, _: Any) -> Any:
        if isinstance(value, cls):
            return value
        if not isinstance(value, dict):
            raise SpecError("", f"{shown(value)} is not a table with {', '.join(fields)}")
        refuse_unknown(value, fields)
        for key, item in value.items():
            refuse_many(key, item, param_of(fields[key]))
        # "auto" stands for a number; one of a key that knows none is refused as a text
        left = {k: AUTO for k, v in value.items() if v == "auto" and param_of(fields[k]).auto}
        return fill(value | left, cls)

    return hook


def _sensor(converter: Any, value: Any, folder: Path) -> Any:
    kind = value.get("kind") if isinstance(value, dict) else None
    if kind not in SENSORS:
        known = ", ".join(f'"{k}"' for k in SENSORS)
        said = f"{shown(kind)} is not known" if kind is not None else "is missing"
        raise SpecError("kind", f"{said}; use one of {known}")
    if kind in PLATFORMS and isinstance(value.get("scanner"), str) and value["scanner"]:
        value = merged(settings_of(value["scanner"], kind, folder), value)
    return converter.structure(value, SENSORS[kind])


def _is_tuple(kind: Any) -> bool:
    return typing.get_origin(kind) is tuple


def _tuple(converter: Any, value: Any, kind: Any) -> Any:
    """Fixed-length vectors and lists of anything; says how many numbers are expected."""
    from cattrs.errors import IterableValidationError, IterableValidationNote

    parts = typing.get_args(kind)
    many = len(parts) == 2 and parts[1] is Ellipsis
    if many and isinstance(value, dict):
        raise SpecError(
            "", "is one table, not a list of them; give it two brackets on each side: [[…]]"
        )
    if not isinstance(value, (list, tuple)):
        raise SpecError("", f"{shown(value)} is not a list" + ("" if many else f" of {len(parts)}"))
    if not many and len(value) != len(parts):
        raise SpecError("", f"has {len(value)} values; give {len(parts)}")
    done, wrong = [], []
    for index, item in enumerate(value):
        try:
            done.append(converter.structure(item, parts[0] if many else parts[index]))
        except Exception as problem:
            problem.add_note(IterableValidationNote("", index, parts[0]))
            wrong.append(problem)
    if wrong:
        raise IterableValidationError("", wrong, tuple)
    return tuple(done)
