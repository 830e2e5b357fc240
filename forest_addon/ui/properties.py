"""Settings as Blender properties: every property group is made from a dataclass of ``spec``.

Name, unit, range, default and help come from ``param_of``, so a parameter is written once. Angles stay
degrees, as in a scene file. A value that may be left out becomes a number with a switch beside it.
``exchange`` takes settings in and gives them back.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    BoolVectorProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    IntVectorProperty,
    PointerProperty,
    StringProperty,
)

from .. import spec
from ..spec import Param, Settings, param_of

ASSETS = Path(__file__).resolve().parents[2] / "assets"
LARGEST_INT = 2**31 - 1  # what Blender's whole numbers hold
UNITS = {"m": "LENGTH", "s": "TIME_ABSOLUTE", "Hz": "FREQUENCY", "m/s": "VELOCITY"}
SUFFIXES = ("_deg", "_c", "_kpa")  # units within names; labels show the unit itself
# Pairs that are not along x and y: what their two numbers are called.
PARTS = {
    "azimuth_deg": ("from", "to"),
    "elevation_deg": ("from", "to"),
    "beam_width_deg": ("width", "height"),
    "band": ("low", "high"),
    "scale": ("min", "max"),
}
LABELS = {
    "beam_width_deg": "Beam (°)",
    "temperature_c": "Temp. (°C)",
    "source_objects": "More Sources",
    "receiver_objects": "More Receivers",
    "array_azimuth_deg": "Array Azim. (°)",
    "array_elevation_deg": "Array Elev. (°)",
    "directivity_file": "Directivity CSV",
    "facing_azimuth_deg": "Facing Azim.(°)",
    "facing_elevation_deg": "Facing Elev.(°)",
    "impedance_model": "Impedance",
    "flow_resistivity": "σ (kPa·s/m²)",
}  # others are too long for a sidebar
# What a number that was left out starts with when it is switched on.
WHEN_USED = {"expected": 20.0, "sound_speed": 343.2}


# --------------------------------------------------------------------------- making property groups


def make_group(settings: type[Settings], groups: dict[type, type]) -> type[bpy.types.PropertyGroup]:
    """The property group of a settings class; ``groups`` holds those that it contains.

    Its ``shown`` names what a panel draws one below the other: all but lists, and but the switches of
    values that may be left out.
    """
    annotations: dict[str, Any] = {}
    lists: dict[str, Any] = {}
    for name, kind, known, default in fields_of(settings):
        many = items_of(kind)
        if many:
            lists[name] = CollectionProperty(type=groups[many])
            lists[f"active_{name}"] = IntProperty(options={"HIDDEN"})
        elif not is_sensor_kind(name, known):
            annotations |= _properties(name, kind, known, default)
    group = _group_class(settings.__name__.lower(), annotations | lists)
    group.shown = tuple(name for name in annotations if not name.startswith("use_"))
    return group


def label_of(name: str, known: Param) -> str:
    """What a field is called in the panel: ``angle_step_deg`` is Angle Step (°)."""
    if name in LABELS:
        return LABELS[name]
    stem = name
    for suffix in SUFFIXES:
        stem = stem.removesuffix(suffix)
    words = stem.replace("_", " ").title()
    unit = {"deg": "°"}.get(known.unit, known.unit)
    shown_by_blender = known.unit in UNITS or known.unit in ("", "%", "trees")
    return words if shown_by_blender else f"{words} ({unit})"


def _properties(name: str, kind: Any, known: Param, default: Any) -> dict[str, Any]:
    """The one Blender property of a field, or two where it may be left out."""
    optional = without_none(kind)
    if optional is None:
        return {name: _property(name, kind, known, default)}
    start = WHEN_USED[name] if default is None else default
    return {
        name: _property(name, optional, known, start),
        f"use_{name}": BoolProperty(
            name=f"Use {label_of(name, known)}",
            description=_help(known),
            default=default is not None,
        ),
    }


def _property(name: str, kind: Any, known: Param, default: Any) -> Any:
    size = len(typing.get_args(kind)) if typing.get_origin(kind) is tuple else 0
    item = typing.get_args(kind)[0] if size else kind
    words: dict[str, Any] = {"name": label_of(name, known), "description": _help(known)}
    if item is bool:
        return (BoolVectorProperty if size else BoolProperty)(default=default, **words)
    if item is str:
        return _text_property(name, known, default, words)
    if default is dataclasses.MISSING:
        default = (max(known.minimum, 1.0 if known.open_minimum else 0.0),) * size
    words |= {"default": default} | _limits(item, known)
    if size:
        words["size"] = size
    if item is int:
        return (IntVectorProperty if size else IntProperty)(**words)
    words |= _how_shown(known, default if size else (default,))
    if known.unit in UNITS:
        words["unit"] = UNITS[known.unit]
    if size and name not in PARTS:
        words["subtype"] = "XYZ_LENGTH" if known.unit == "m" else "XYZ"
    elif known.unit == "%":
        words["subtype"] = "PERCENTAGE"
    elif known.minimum >= -1 and known.maximum == 1:
        words["subtype"] = "FACTOR"
    return (FloatVectorProperty if size else FloatProperty)(**words)


def _text_property(name: str, known: Param, default: Any, words: dict[str, Any]) -> Any:
    if known.choices:
        items = [(choice, choice.title(), words["description"]) for choice in known.choices]
        return EnumProperty(items=items, default=default, **words)
    if name == "species":
        words |= {"search": _known_species, "search_options": {"SUGGESTION"}}
    return StringProperty(default="" if default is dataclasses.MISSING else default, **words)


def _known_species(_props: Any, _context: Any, typed: str) -> list[str]:
    """Presets to choose from; looked up when the field is opened."""
    presets = (ASSETS / "species").glob("*.toml")
    return sorted(path.stem for path in presets if typed in path.stem)


def _limits(item: type, known: Param) -> dict[str, Any]:
    """Hard limits; a minimum that is not itself allowed is left to ``spec`` to refuse in words."""
    limits: dict[str, Any] = {}
    if math.isfinite(known.minimum):
        limits["min"] = known.minimum
    if math.isfinite(known.maximum):
        limits["max"] = known.maximum
    if item is int:
        return {k: int(max(-LARGEST_INT, min(LARGEST_INT, v))) for k, v in limits.items()}
    return limits


def _how_shown(known: Param, values: Iterable[float]) -> dict[str, int]:
    """Digits to show and the step of the arrows, from the size of the default."""
    shown = [f"{abs(value):.6g}" for value in values]
    digits = max(len(text.partition(".")[2]) if "e" not in text else 6 for text in shown)
    largest = max(float(text) for text in shown) or 1.0
    step = round(10.0 ** math.floor(math.log10(largest)) * 10)  # hundredths
    least = 4 if known.unit in UNITS else 1  # Blender itself drops zeros before a unit
    return {"precision": min(6, max(least, digits)), "step": max(1, min(100, step))}


def _help(known: Param) -> str:
    text = known.help
    return text[:1].upper() + text[1:]


def fields_of(settings: type[Settings]) -> Iterable[tuple[str, Any, Param, Any]]:
    """(name, type, param, default) of every field."""
    kinds = typing.get_type_hints(settings)
    for field in dataclasses.fields(settings):  # type: ignore[arg-type]
        yield field.name, kinds[field.name], param_of(field), field.default


def items_of(kind: Any) -> type[Settings] | None:
    """The settings class of ``tuple[Class, ...]``, None for any other type."""
    parts = typing.get_args(kind)
    if typing.get_origin(kind) is tuple and len(parts) == 2 and parts[1] is Ellipsis:
        return parts[0] if isinstance(parts[0], type) and issubclass(parts[0], Settings) else None
    return None


def without_none(kind: Any) -> Any:
    """float of ``float | None``, None for a type that is always given."""
    if not isinstance(kind, types.UnionType):
        return None
    return next(part for part in typing.get_args(kind) if part is not types.NoneType)


def is_sensor_kind(name: str, known: Param) -> bool:
    return name == "kind" and len(known.choices) == 1


def _group_class(name: str, annotations: dict[str, Any]) -> type[bpy.types.PropertyGroup]:
    return type(f"FOREST_PG_{name}", (bpy.types.PropertyGroup,), {"__annotations__": annotations})


# ----------------------------------------------------------------------------- the scene's property


def _make_groups() -> dict[type, type]:
    groups: dict[type, type] = {}
    for settings in (
        spec.Forest,
        spec.Gaussian,
        spec.Planting,
        spec.Air,
        spec.Place,
        *spec.SENSORS.values(),
    ):
        groups[settings] = make_group(settings, groups)
    return groups


GROUPS = _make_groups()


class FOREST_PG_figure(bpy.types.PropertyGroup):
    """One line of a result: what, how much."""

    name: StringProperty()
    value: StringProperty()


class FOREST_PG_result(bpy.types.PropertyGroup):
    """What the last run of something found; ``name`` says what ran."""

    name: StringProperty()
    title: StringProperty()
    figures: CollectionProperty(type=FOREST_PG_figure)
    shown: StringProperty(description="Object with what was found")
    file: StringProperty(subtype="FILE_PATH", description="File with what was found")
    picture: PointerProperty(type=bpy.types.Image)
    caption: StringProperty()


def _scene_group() -> type[bpy.types.PropertyGroup]:
    """Everything that a Blender scene holds of ours."""
    plain = {name: (kind, known, default) for name, kind, known, default in fields_of(spec.Scene)}
    return _group_class(
        "scene",
        {
            **{name: _property(name, *plain[name]) for name in ("name", "seed")},
            "forest": PointerProperty(type=GROUPS[spec.Forest]),
            "plantings": CollectionProperty(type=GROUPS[spec.Planting]),
            "active_plantings": IntProperty(options={"HIDDEN"}),
            "air": PointerProperty(type=GROUPS[spec.Air]),
            **{
                kind: PointerProperty(type=GROUPS[settings])
                for kind, settings in spec.SENSORS.items()
            },
            "folder": StringProperty(
                name="Species Folder",
                description="Folder that names of species files start from",
                subtype="DIR_PATH",
            ),
            "output": StringProperty(
                name="Save To",
                description="Folder that results are written to; empty: they stay in this file alone",
                subtype="DIR_PATH",
                options={"ANIMATABLE", "PATH_SUPPORTS_BLEND_RELATIVE"},
            ),
            "results": CollectionProperty(type=FOREST_PG_result),
        },
    )


FOREST_PG_scene = _scene_group()
CLASSES = (*GROUPS.values(), FOREST_PG_figure, FOREST_PG_result, FOREST_PG_scene)
