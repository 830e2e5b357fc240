"""TOML files into settings and back, with one clear sentence for whatever is wrong.

cattrs structures the tables into the dataclasses of ``spec``; the hooks here are strict (no number is
made of a text, no unknown key is passed over), and ``explain`` turns what cattrs raises into a
``SpecError`` that names the file, the key and what is allowed.
"""

from __future__ import annotations

import dataclasses
import typing
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from ..base.places import version
from ..spec import AUTO, SENSORS, Sensor, Settings, SpecError, param_of
from ..spec.base import WORDS, refuse_many, refuse_unknown, shown, typed
from .atomic import replacing
from .foreign import guarded
from .scanner_file import PLATFORMS, merged, settings_of
from .toml_text import VERSION_KEY, later, read_tables, without_version

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
        told = f"{problem.key}: {problem.problem}{later(written)}"
        raise SpecError(str(path), told) from None


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
        problem = min(problem.exceptions, key=_urgency)
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


def _urgency(problem: BaseException) -> int:
    return 1 if isinstance(problem, KeyError) else 0


@lru_cache(maxsize=8)  # it writes its own code, which takes longer than a scene file
def _converter(folder: Path) -> Any:
    from cattrs import Converter

    converter = Converter(detailed_validation=True)
    for kind in WORDS:
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
