"""Settings as Blender properties: every property group is made from a dataclass of ``spec``.

Name, unit, range, default and help come from ``param_of``, so a parameter is written once. Angles stay
degrees, as in a scene file, and are shown as Blender's (``shown``). A value that may be left out becomes a
number with a switch beside it.
``exchange`` takes settings in and gives them back.
"""

from __future__ import annotations

import dataclasses
import math
import re
import typing
from collections.abc import Callable, Iterable, Mapping
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

from ...spec import AUTO, Param, Settings
from ...spec.choices import meaning_of, title_of
from ..shell.words import keep
from .fields import (
    LARGEST_INT,
    WHEN_USED,
    fields_of,
    is_group,
    is_sensor_kind,
    is_text,
    items_of,
    text_of,
    without_none,
)
from .offers import offered
from .shown import FACE, shown_property

Update = Callable[[Any, Any], None]  # told of a group and the context when a setting changed

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
    "dbh": "DBH",
    "sample_rate": "Sampling",
    "density (1/m)": "Branches (1/m)",  # dead ones on a stem
    "density": "Trees/m²",
    "crs": "CRS",
    "subrays": "Sub-rays",
    "pulse_rate": "Pulses",
    "painted_value": "Painted (/m²)",
    "divergence_mrad": "Spread (mrad)",
    "extinction (1/m)": "Air Loss (1/m)",  # of a scanner; a reverb has one in words
    "leaf_area_density": "Leaves (m²/m³)",
    "floor_leaf_area": "Herbs (m²/m²)",
    "needle_area_density": "Needles (m²/m³)",
    "branch_area_density": "Twigs (m²/m³)",
    "leaf_transmittance": "Leaf Lets Pass",
    "elasticity": "Elasticity",
    "prune_descending": "Prune Falling",
    "source_objects": "More Sources",
    "receiver_objects": "More Receivers",
    "array_azimuth_deg": "Array Azim. (°)",
    "array_elevation_deg": "Array Elev. (°)",
    "array_file": "Array CSV",
    "source_path": "Source Path",
    "receiver_path": "Receiver Path",
    "path_step": "Path Step (s)",
    "head_file": "Head (SOFA)",
    "head_azimuth_deg": "Head Azim. (°)",
    "noise_db": "Noise (dB)",
    "directivity_file": "Directivity CSV",
    "facing_azimuth_deg": "Facing Azim.(°)",
    "facing_elevation_deg": "Facing Elev.(°)",
    "impedance_model": "Impedance",
    "turbulence (1e-6)": "Turbul. (1e-6)",
    "acceleration": "Accel. (m/s²)",
    "turn_rate_deg": "Turn (°/s)",
    "flow_resistivity": "σ (kPa·s/m²)",
    "dynamic_range": "Dynamic (dB)",
    "threshold_snr": "Threshold (SNR)",
    "beyond": "Far Echoes",
}  # others are too long for a sidebar
ONE_OF = ("template", "rules", "honda", "crown")  # parts of a species of which one may be used
DIGITS = {"mean": 3, "sd": 3, "low": 3, "high": 3}  # of numbers whose size a default does not tell


def _noticed(_group: Any, _context: Any) -> None:
    """Nothing; but only properties with such a function are reported when a script has set them."""


# --------------------------------------------------------------------------- making property groups


def make_group(
    settings: type[Settings],
    groups: Mapping[type, type],
    when_set: Mapping[str, Update],
    besides: Mapping[str, Any],
) -> type[bpy.types.PropertyGroup]:
    """The property group of a settings class; ``groups`` holds those that it contains.

    Its ``shown`` names what a panel draws one below the other: all but lists, groups within it (its
    ``nested``), and the switches of values that may be left out.

    when_set : what follows when a setting changes, or an item of a list is chosen (active_NAME).
    besides : what the group holds besides its settings.
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
                name="Chosen",
                description="The one that settings and buttons below are about",
                options={"HIDDEN"},
                update=when_set.get(f"active_{name}"),
            )
        elif is_group(part):
            words = {"name": label_of(name, known), "description": help_of(known)}
            parts[name] = PointerProperty(type=groups[part], **words)
            if part != kind:
                annotations[f"use_{name}"] = _switch(name, known, default)
        elif not is_sensor_kind(name, known):
            annotations |= _properties(name, kind, known, default, when_set.get(name, _noticed))
    beside = dict(besides) | _shown_otherwise(annotations, settings)
    group = group_class(settings.__name__.lower(), annotations | parts | lists | beside)
    group.shown = tuple(name for name in annotations if not name.startswith("use_"))
    group.nested = tuple(parts)
    return group


def label_of(name: str, known: Param) -> str:
    """Return what a field is called in the panel: ``angle_step_deg`` is Angle Step (°)."""
    for key in (f"{name} ({known.unit})", name):
        if key in LABELS:
            return LABELS[key]
    stem = name
    for suffix in SUFFIXES:
        stem = stem.removesuffix(suffix)
    words = re.sub(r"\bSd\b", "SD", stem.replace("_", " ").title())
    unit = {"deg": "°"}.get(known.unit, known.unit)
    shown_by_blender = known.unit in UNITS or known.unit in ("", "%", "trees")
    return words if shown_by_blender else f"{words} ({unit})"


def _properties(name: str, kind: Any, known: Param, default: Any, update: Update) -> dict[str, Any]:
    """The one Blender property of a field, or two where it may be left out."""
    optional = without_none(kind)
    if optional is None:
        return {name: property_of(name, kind, known, default, update)}
    start = WHEN_USED[name] if default is None else default
    return {
        name: property_of(name, optional, known, start, update),
        f"use_{name}": _switch(name, known, default),
    }


def _shown_otherwise(annotations: Mapping[str, Any], settings: type[Settings]) -> dict[str, Any]:
    """Return what stands beside settings whose unit is another in the panel than in a file."""
    found = {}
    for name, _, known, default in fields_of(settings):
        start = WHEN_USED.get(name) if default is None else default
        if name in annotations and start is not None:
            title, words = label_of(name, known), help_of(known)
            shown = shown_property(name, title, words, known, start)
            found |= {f"{name}{FACE}": shown} if shown else {}
    return found


def _switch(name: str, known: Param, default: Any) -> Any:
    """Return whether a value that may be left out is given."""
    words: dict[str, Any] = {"name": f"Use {label_of(name, known)}", "description": help_of(known)}
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


def property_of(name: str, kind: Any, known: Param, default: Any, update: Update = _noticed) -> Any:
    """The Blender property of a field."""
    size = len(typing.get_args(kind)) if typing.get_origin(kind) is tuple else 0
    item = typing.get_args(kind)[0] if size else kind
    words: dict[str, Any] = {"name": label_of(name, known), "description": help_of(known)}
    if is_text(name, kind):
        given = () if default is dataclasses.MISSING else default
        return StringProperty(default=text_of(given), update=_noticed, **words)
    words["update"] = update
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
            (choice, title_of(name, choice), meaning_of(name, choice) or words["description"])
            for choice in known.choices
        ]
        return EnumProperty(items=items, default=default, **words)
    words |= offered(name, known)
    return StringProperty(default="" if default is dataclasses.MISSING else default, **words)


def _limits(item: type, known: Param) -> dict[str, Any]:
    """Hard limits; a minimum that is not itself allowed is left to ``spec`` to refuse in words."""
    limits: dict[str, Any] = {}
    if math.isfinite(known.minimum):
        limits["min"] = AUTO if known.auto else known.minimum  # -1 is what files call "auto"
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


def help_of(known: Param) -> str:
    """Return what a field is for, as a panel says it."""
    text = known.help.replace("left out:", "off:").replace("Left out:", "Off:")  # its switch
    if known.auto:  # a number here, a word in files
        text = text.replace("auto:", "-1, automatic:")
    return text if "α" <= text[:1] <= "ω" else text[:1].upper() + text[1:]  # a symbol is no word


def group_class(name: str, annotations: dict[str, Any]) -> type[bpy.types.PropertyGroup]:
    """A property group with these properties."""
    return type(f"FOREST_PG_{name}", (bpy.types.PropertyGroup,), {"__annotations__": annotations})
