"""Settings as Blender properties: every property group is made from a dataclass of ``spec``.

Name, unit, range, default and help come from ``param_of``, so a parameter is written once. Angles stay
degrees, as in a scene file. A value that may be left out becomes a number with a switch beside it.
``exchange`` takes settings in and gives them back.
"""

from __future__ import annotations

import dataclasses
import functools
import json
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
from ..blender.sensors import home_of
from ..spec import Param, Settings, param_of
from .offers import offered
from .selection import select_alone
from .words import keep

ASSETS = Path(__file__).resolve().parents[2] / "assets"
LARGEST_INT = 2**31 - 1  # what Blender's whole numbers hold
UNITS = {"m": "LENGTH", "s": "TIME_ABSOLUTE", "Hz": "FREQUENCY", "m/s": "VELOCITY"}
SUFFIXES = (
    "_deg",
    "_c",
    "_kpa",
    "_nm",
    "_mrad",
    "_ns",
    "_ppm",
)  # units within names; labels show the unit itself
# Pairs that are not along x and y: what their two numbers are called.
PARTS = {
    "azimuth_deg": (keep("From"), keep("To")),
    "elevation_deg": (keep("From"), keep("To")),
    "beam_width_deg": (keep("Width"), keep("Height")),
    "hearing_width_deg": (keep("Width"), keep("Height")),
    "band": (keep("Low"), keep("High")),
    "field_deg": (keep("From"), keep("To")),
    "divergence_mrad": (keep("Sweep"), keep("Across")),
    "scale": (keep("Min"), keep("Max")),
    "slope_deg": (keep("From"), keep("To")),
    "altitude": (keep("From"), keep("To")),
}
LABELS = {
    "beam_width_deg": "Beam (°)",
    "hearing_width_deg": "Hearing (°)",
    "temperature_c": "Temp. (°C)",
    "density": "Trees/m²",
    "painted_value": "Painted (/m²)",
    "divergence_mrad": "Spread (mrad)",
    "extinction": "Air Loss (1/m)",
    "leaf_transmittance": "Leaf Lets Pass",
    "elasticity": "Elasticity",
    "prune_descending": "Prune Falling",
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
# What a value that was left out starts with when it is switched on.
WHEN_USED = {
    "expected": 20.0,
    "density": 0.05,
    "sound_speed": 343.2,
    "line_step_deg": 0.25,
    "size": (30.0, 30.0),
    "origin": (0.0, 0.0),
    "low": 0.0,
    "escape": 0.0,
    "high": 1.0,
    "trunk_daughters": spec.Discrete(values=(3,)),
    "template": spec.Template(wood=""),
    "siblings": spec.Siblings(),
    "rules": spec.Rules(axiom="A", productions=("A -> F[+A][-A]/(90)A",)),
    "honda": spec.Honda(),
}
ONE_OF = ("template", "rules", "honda")  # parts of a species of which one may be used
# What a group holds besides its settings.
BESIDES = {spec.Gaussian: {"handle": PointerProperty(type=bpy.types.Object)}}
DIGITS = {"mean": 3, "sd": 3, "low": 3, "high": 3}  # of numbers whose size a default does not tell


def _place_handle(hill: Any, _context: Any) -> None:
    from . import hills

    hills.place(hill)


def _choose_hill(planting: Any, context: Any) -> None:
    from . import hills

    hills.choose(planting, context)


def _renew_handles(props: Any, _context: Any) -> None:
    from . import hills

    hills.renew(props.id_data)


def _let_live(props: Any, _context: Any) -> None:
    from . import live

    live.begin(props.id_data)


def _noticed(_group: Any, _context: Any) -> None:
    """Nothing; but only properties with such a function are reported when a script has set them."""


# What follows when a setting changes, or an item of a list is chosen.
WHEN_SET = {"centre": _place_handle, "width": _place_handle, "active_gaussians": _choose_hill}


# --------------------------------------------------------------------------- making property groups


def make_group(settings: type[Settings], groups: dict[type, type]) -> type[bpy.types.PropertyGroup]:
    """The property group of a settings class; ``groups`` holds those that it contains.

    Its ``shown`` names what a panel draws one below the other: all but lists, groups within it (its
    ``nested``), and the switches of values that may be left out.
    """
    annotations: dict[str, Any] = {}
    lists: dict[str, Any] = {}
    parts: dict[str, Any] = {}
    for name, kind, known, default in fields_of(settings):
        many = items_of(kind)
        part = without_none(kind) or kind
        if many:
            lists[name] = CollectionProperty(type=groups[many])
            lists[f"active_{name}"] = IntProperty(
                options={"HIDDEN"}, update=WHEN_SET.get(f"active_{name}")
            )
        elif is_group(part):
            words = {"name": label_of(name, known), "description": _help(known)}
            parts[name] = PointerProperty(type=groups[part], **words)
            if part != kind:
                annotations[f"use_{name}"] = _switch(name, known, default)
        elif not is_sensor_kind(name, known):
            annotations |= _properties(name, kind, known, default)
    besides = BESIDES.get(settings, {})
    group = _group_class(settings.__name__.lower(), annotations | parts | lists | besides)
    group.shown = tuple(name for name in annotations if not name.startswith("use_"))
    group.nested = tuple(parts)
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
        return {name: property_of(name, kind, known, default)}
    start = WHEN_USED[name] if default is None else default
    return {
        name: property_of(name, optional, known, start),
        f"use_{name}": _switch(name, known, default),
    }


def _switch(name: str, known: Param, default: Any) -> Any:
    """Whether a value that may be left out is given."""
    words: dict[str, Any] = {"name": f"Use {label_of(name, known)}", "description": _help(known)}
    words["update"] = _noticed
    if name in ONE_OF:
        words["update"] = lambda props, _: _switch_others_off(name, props)
    return BoolProperty(default=default is not None, **words)


def _switch_others_off(name: str, props: Any) -> None:
    """A species grows in one way only."""
    if getattr(props, f"use_{name}"):
        for other in ONE_OF:
            if other != name and getattr(props, f"use_{other}"):
                setattr(props, f"use_{other}", False)


def property_of(name: str, kind: Any, known: Param, default: Any) -> Any:
    size = len(typing.get_args(kind)) if typing.get_origin(kind) is tuple else 0
    item = typing.get_args(kind)[0] if size else kind
    words: dict[str, Any] = {"name": label_of(name, known), "description": _help(known)}
    if is_text(name, kind):
        given = () if default is dataclasses.MISSING else default
        return StringProperty(default=text_of(given), update=_noticed, **words)
    words["update"] = WHEN_SET.get(name, _noticed)
    if item is bool:
        return (BoolVectorProperty if size else BoolProperty)(default=default, **words)
    if item is str:
        return _text_property(name, known, default, words)
    if default is dataclasses.MISSING:
        least = max(known.minimum, 1.0 if known.open_minimum else 0.0)
        default = (least,) * size if size else least
    words |= {"default": default} | _limits(item, known)
    if size:
        words["size"] = size
    if item is int:
        return (IntVectorProperty if size else IntProperty)(**words)
    words |= _how_shown(known, default if size else (default,))
    if name in DIGITS:
        words |= {"precision": DIGITS[name], "step": 1}
    if known.unit in UNITS:
        words["unit"] = UNITS[known.unit]
    if size == 3 and (known.minimum, known.maximum) == (0, 1):
        words["subtype"] = "COLOR"
    elif size and name not in PARTS:
        words["subtype"] = "XYZ_LENGTH" if known.unit == "m" else "XYZ"
    elif known.unit == "%":
        words["subtype"] = "PERCENTAGE"
    elif known.minimum >= -1 and known.maximum == 1:
        words["subtype"] = "FACTOR"
    return (FloatVectorProperty if size else FloatProperty)(**words)


def _text_property(name: str, known: Param, default: Any, words: dict[str, Any]) -> Any:
    if known.choices:
        items = [
            (choice, choice if choice.isupper() else choice.title(), words["description"])
            for choice in known.choices
        ]
        return EnumProperty(items=items, default=default, **words)
    words |= offered(name, known)
    return StringProperty(default="" if default is dataclasses.MISSING else default, **words)


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
    fine = 2 if known.maximum - known.minimum <= 20 else 1
    least = 4 if known.unit in UNITS else fine  # Blender itself drops zeros before a unit
    return {"precision": min(6, max(least, digits)), "step": max(1, min(100, step))}


def _help(known: Param) -> str:
    text = known.help
    return text[:1].upper() + text[1:]


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
    """Whether a field is one group of settings within another."""
    return isinstance(kind, type) and issubclass(kind, Settings)


def is_text(name: str, kind: Any) -> bool:
    """Whether a field is written as text: corners and lists, which Blender has no property for, and what
    needs more digits than Blender's numbers keep.
    """
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


def _group_class(name: str, annotations: dict[str, Any]) -> type[bpy.types.PropertyGroup]:
    return type(f"FOREST_PG_{name}", (bpy.types.PropertyGroup,), {"__annotations__": annotations})


# ----------------------------------------------------------------------------- the scene's property


def _make_groups() -> dict[type, type]:
    groups: dict[type, type] = {}
    held = (spec.Distance, spec.Terrain, spec.Gaussian, spec.Raster, spec.Rows)
    of_species = (spec.Normal, spec.Discrete, spec.Grammar, spec.Jitter, spec.Template, spec.Look)
    of_trees = (spec.Siblings, spec.Rules, spec.Honda, spec.Leaf, spec.Detail, spec.Species)
    of_sensors = (spec.Beam, spec.Surfaces, spec.Noise, spec.Pose, spec.Place)
    of_scene = (spec.Forest, spec.Planting, spec.Stems, spec.Air, spec.Rays)
    plain = (*held, *of_species, *of_trees, *of_sensors, *of_scene)
    for settings in (*plain, *spec.SENSORS.values()):
        groups[settings] = make_group(settings, groups)
    return groups


GROUPS = _make_groups()


class FOREST_PG_sensor(bpy.types.PropertyGroup):
    """The settings of a sensor, on its object: a group for each kind, of which that of its own is used."""

    __annotations__ = {
        kind: PointerProperty(type=GROUPS[cls]) for kind, cls in spec.SENSORS.items()
    }


class FOREST_PG_edited(bpy.types.PropertyGroup):
    """A species that is edited in this file; ``name`` is what plantings call it."""

    name: StringProperty()
    origin: StringProperty(description="What it was made from, as a planting calls that")
    folder: StringProperty(description="Folder that its STL files start from", subtype="DIR_PATH")
    settings: PointerProperty(type=GROUPS[spec.Species])


class FOREST_PG_figure(bpy.types.PropertyGroup):
    """One line of a result: what, how much; in English, with what says it in another language."""

    name: StringProperty()
    value: StringProperty()
    made_of: StringProperty()


class FOREST_PG_result(bpy.types.PropertyGroup):
    """What the last run of something found; ``name`` says what ran, ``kind`` which kind of thing it is."""

    name: StringProperty()
    kind: StringProperty()
    title: StringProperty()
    opened: BoolProperty(description="Show figures and picture; the newest result is", default=True)
    figures: CollectionProperty(type=FOREST_PG_figure)
    shown: StringProperty(description="Object with what was found")
    file: StringProperty(subtype="FILE_PATH", description="File with what was found")
    picture: PointerProperty(type=bpy.types.Image)
    caption: StringProperty()


def _choose_sensor(props: Any, context: bpy.types.Context) -> None:
    """A sensor that is chosen in the list becomes the active object."""
    home = home_of(props.id_data)
    if home is None or not 0 <= props.active_sensor < len(home.objects):
        return
    thing = home.objects[props.active_sensor]
    layer = context.view_layer
    if thing.name in layer.objects and layer.objects.active != thing:
        select_alone(layer, thing)


def _species_pictures(props: Any, _context: Any) -> list[tuple[str, str, str, int, int]]:
    """Species to choose from, with their pictures."""
    from .species_pictures import choices

    return choices(props)


def _species_number(props: Any) -> int:
    """Which of them the chosen planting plants."""
    from .species_pictures import number_of

    return number_of(props)


def _choose_species(props: Any, number: int) -> None:
    from .species_pictures import choices

    planting = chosen_planting(props)
    if planting is not None:
        planting.species = choices(props)[number][0]


def chosen_planting(props: Any) -> Any:
    """The planting that is chosen in the list, None where there is none."""
    active = props.active_plantings
    return props.plantings[active] if 0 <= active < len(props.plantings) else None


def _scene_group() -> type[bpy.types.PropertyGroup]:
    """Everything that a Blender scene holds of ours."""
    plain = {name: (kind, known, default) for name, kind, known, default in fields_of(spec.Scene)}
    return _group_class(
        "scene",
        {
            **{name: property_of(name, *plain[name]) for name in ("name", "seed", "offset", "crs")},
            "forest": PointerProperty(type=GROUPS[spec.Forest]),
            "plantings": CollectionProperty(type=GROUPS[spec.Planting]),
            "active_plantings": IntProperty(options={"HIDDEN"}),
            "stems": CollectionProperty(type=GROUPS[spec.Stems]),
            "active_stems": IntProperty(options={"HIDDEN"}),
            "air": PointerProperty(type=GROUPS[spec.Air]),
            "rays": PointerProperty(type=GROUPS[spec.Rays]),
            "active_sensor": IntProperty(options={"HIDDEN"}, update=_choose_sensor),
            "show_sensors": BoolProperty(
                name="Sensors",
                description="Draw where sensors look: beams to -3 dB, fans, paths of sound",
                default=True,
            ),
            "show_intensity": BoolProperty(
                name="Intensity", description="Draw where trees are likely to stand"
            ),
            "show_points": BoolProperty(
                name="Points",
                description="Draw points of results large enough to be seen, in their colours",
                default=True,
            ),
            "drag_hills": BoolProperty(
                name="Drag in View",
                description="A circle in the view for every hill: move and scale it, copy it, delete it",
                update=_renew_handles,
            ),
            "live": BoolProperty(
                name="Live",
                description="Build the forest anew whenever a setting, a hill, a painting or the terrain "
                "has changed",
                update=_let_live,
            ),
            "built": StringProperty(
                description="Fingerprint of what the forest was built from", options={"HIDDEN"}
            ),
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
            "edited": CollectionProperty(type=FOREST_PG_edited),
            "species_picture": EnumProperty(
                name="Species",
                description="What the chosen planting plants",
                items=_species_pictures,
                get=_species_number,
                set=_choose_species,
                options={"SKIP_SAVE"},
            ),
            "results": CollectionProperty(type=FOREST_PG_result),
            "layout": IntProperty(options={"HIDDEN"}),  # of these settings in the file (migration)
            "notice": StringProperty(options={"HIDDEN"}),
        },
    )


FOREST_PG_scene = _scene_group()
CLASSES = (
    *GROUPS.values(),
    FOREST_PG_sensor,
    FOREST_PG_edited,
    FOREST_PG_figure,
    FOREST_PG_result,
    FOREST_PG_scene,
)
