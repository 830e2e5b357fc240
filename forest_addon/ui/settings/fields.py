"""Fields of a settings class of ``spec``, and how the panel keeps each: as a value, a text, a list, a
group within the group, or as one that may be left out."""

from __future__ import annotations

import dataclasses
import functools
import json
import types
import typing
from typing import Any

from ... import spec
from ...spec import Param, Settings, param_of

LARGEST_INT = 2**31 - 1  # what Blender's whole numbers hold
# What a value that was left out starts with when it is switched on.
WHEN_USED = {
    "expected": 20.0,
    "density": 0.05,
    "rotation_deg": 0.0,
    "scale": 1.0,  # of a tree set by hand
    "diameter": 0.25,
    "variant": 0,
    "sound_speed": 343.2,
    "line_step_deg": 0.25,
    "size": (30.0, 30.0),
    "origin": (0.0, 0.0),
    "start": (0.0, 0.0, 2.0),
    "low": 0.0,
    "escape": 0.0,
    "high": 1.0,
    "trunk_daughters": spec.Discrete(values=(3,)),
    "template": spec.Template(wood=""),
    "siblings": spec.Siblings(),
    "rules": spec.Rules(axiom="A", productions=("A -> F[+A][-A]/(90)A",)),
    "honda": spec.Honda(),
    "crown": spec.Crown(),
    "targets": spec.Targets(),
    "needles": spec.Needles(),
    "architecture": spec.Architecture(),
    "dbh": spec.Normal(mean=0.25, sd=0.06),
    "inclination": spec.Inclination(),
}


@functools.cache
def fields_of(settings: type[Settings]) -> tuple[tuple[str, Any, Param, Any], ...]:
    """(name, type, param, default) of every field."""
    kinds = typing.get_type_hints(settings)
    return tuple(
        (field.name, kinds[field.name], param_of(field), field.default)
        for field in dataclasses.fields(settings)  # type: ignore[arg-type]
    )


def items_of(kind: Any) -> type[Settings] | None:
    """The settings class of ``tuple[Class, ...]``, None for any other type."""
    parts = typing.get_args(kind)
    if typing.get_origin(kind) is tuple and len(parts) == 2 and parts[1] is Ellipsis:
        return parts[0] if isinstance(parts[0], type) and issubclass(parts[0], Settings) else None
    return None


def is_group(kind: Any) -> bool:
    """Return whether a field is one group of settings within another."""
    return isinstance(kind, type) and issubclass(kind, Settings)


def is_text(name: str, kind: Any) -> bool:
    """Return whether a field is written as text: corners and lists, which Blender has no property for, and
    what needs more digits than Blender's numbers keep."""
    nested = any(typing.get_origin(part) is tuple for part in typing.get_args(kind))
    return (
        name == "offset"
        or listed(kind) is not None
        or (typing.get_origin(kind) is tuple and nested)
    )


def listed(kind: Any) -> type | None:
    """int of ``tuple[int, ...]``, as also float and str; None for any other type."""
    parts = typing.get_args(kind)
    many = typing.get_origin(kind) is tuple and len(parts) == 2 and parts[1] is Ellipsis
    return parts[0] if many and parts[0] in (int, float, str) else None


def text_of(value: Any) -> str:
    """Numbers as a scene file writes them, [[0, 0], [10, 0], [10, 5.5]]; nothing for an empty list.

    Texts are parted by semicolons.
    """
    if value and isinstance(value[0], str):
        return "; ".join(value)
    return json.dumps(value) if value else ""


def without_none(kind: Any) -> Any:
    """float of ``float | None``, None for a type that is always given."""
    if not isinstance(kind, types.UnionType):
        return None
    return next(part for part in typing.get_args(kind) if part is not types.NoneType)


def is_sensor_kind(name: str, known: Param) -> bool:
    return name == "kind" and len(known.choices) == 1
