"""Settings as Blender properties: every property group is made from a dataclass of ``spec``.

Name, unit, range, default and help come from ``param_of``, so a parameter is written once. A value that may
be left out becomes a number with a switch beside it; corners and lists are texts. What is stored stays
degrees and hertz, as in a scene file; beside an angle or a high frequency stands a property NAME_shown that
converts when it is read or set. ``exchange`` takes settings in and gives them back.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import re
import types
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

from ... import spec
from ...blender.scene.layout import shortest
from ...spec import AUTO, Param, Settings, param_of
from ...spec.choices import meaning_of, title_of
from ..shell.words import keep
from .references import offered

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
    "receiver": spec.SonarReceiver(),
    "source_level_db": 110.0,
    "ringing_db": -40.0,
    "self_noise_db": 20.0,
    "ambient_level_db": 50.0,
    "noise_level_db": 80.0,
    "noise_from": (0.0, 0.1, 0.0),
    "overload_db": 120.0,
    "threshold_db": 12.0,
}


@dataclasses.dataclass(frozen=True)
class Field:
    """Field of a settings class, and how the panel keeps it.

    kind : its type, without None. optional : it may be left out, by a switch. how : as a "value", a "group"
    within the group, a list of "groups", a "list" of numbers or texts written as text, nested numbers as
    "text", which Blender has no property for or which need more digits than Blender's numbers keep; "kind"
    of a sensor is not kept. item : class of a list's items. start : what it starts with when it is used.
    """

    name: str
    kind: Any
    param: Param
    default: Any
    optional: bool
    how: str
    item: Any
    start: Any


@functools.cache
def fields_of(settings: type[Settings]) -> tuple[Field, ...]:
    """Every field of a settings class."""
    kinds = typing.get_type_hints(settings)
    return tuple(
        _field(field, kinds[field.name])
        for field in dataclasses.fields(settings)  # type: ignore[arg-type]
    )


def _field(field: dataclasses.Field, kind: Any) -> Field:
    optional, known = isinstance(kind, types.UnionType), param_of(field)
    if optional:
        kind = next(part for part in typing.get_args(kind) if part is not types.NoneType)
    parts = typing.get_args(kind)
    item = parts[0] if len(parts) == 2 and parts[1] is Ellipsis else None
    how = "value"
    if _is_settings(kind):
        how = "group"
    elif _is_settings(item):
        how = "groups"
    elif item in (int, float, str):
        how = "list"
    elif field.name == "offset" or any(typing.get_origin(part) is tuple for part in parts):
        how = "text"
    elif field.name == "kind" and len(known.choices) == 1:
        how = "kind"
    start = WHEN_USED.get(field.name) if field.default is None else field.default
    return Field(field.name, kind, known, field.default, optional, how, item, start)


def _is_settings(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Settings)


def text_of(value: Any) -> str:
    """Numbers as a scene file writes them, [[0, 0], [10, 0], [10, 5.5]]; nothing for an empty list.

    Texts are parted by semicolons.
    """
    if value and isinstance(value[0], str):
        return "; ".join(value)
    return json.dumps(value) if value else ""


FACE = "_shown"  # ends the name of the property beside a setting
HIGH = 1000.0  # Hz from which a frequency is one of kHz
LONGEST = 15  # letters of a label
DEGREE = math.pi / 180.0
ROOM = 6  # digits of an angle that are kept: Blender's numbers have no more


def factor_of(field: Field) -> float:
    """Factor by which a value of a setting is multiplied when it is shown; 1: as it is stored."""
    if field.param.unit == "deg":
        return DEGREE
    values = field.start if isinstance(field.start, tuple) else (field.start,)
    numbers = [value for value in values if isinstance(value, int | float)]
    return 1e-3 if field.param.unit == "Hz" and numbers and max(numbers) >= HIGH else 1.0


def _shown_property(field: Field) -> Any:
    """The property that shows a setting in another unit, None where that is as it is stored."""
    factor, many, name = factor_of(field), isinstance(field.start, tuple), field.name
    if factor == 1.0 or field.start is None:
        return None

    def read(group: Any) -> Any:
        value = getattr(group, name)
        return [factor * part for part in value] if many else factor * value

    def stored(part: float) -> float:
        if factor == DEGREE:
            return float(f"{math.degrees(part):.{ROOM}g}")
        return shortest(part) / factor

    def write(group: Any, value: Any) -> None:
        setattr(group, name, [stored(part) for part in value] if many else stored(value))

    given = words_of(field) | {"get": read, "set": write, "options": {"SKIP_SAVE"}}
    title = str(given["name"])
    for limit, end in (("min", field.param.minimum), ("max", field.param.maximum)):
        if math.isfinite(end):
            given[limit] = factor * end
    if factor == DEGREE:
        given |= {"name": title.removesuffix(" (°)").removesuffix("(°)"), "unit": "ROTATION"}
        given |= {"step": 100, "precision": 3} | ({} if many else {"subtype": "ANGLE"})
    else:
        whole = f"{title} (kHz)"
        given["name"] = whole if len(whole) <= LONGEST else f"{title} kHz"
        given |= {"step": 100, "precision": 2}
    return FloatVectorProperty(size=len(field.start), **given) if many else FloatProperty(**given)


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
    "registration_sd": "Joined Amiss",
    "registration_deg": "Turned (°)",
    "registration_s": "Changes in (s)",
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
    "sample_ns": "Sampling (ns)",
    "las_format": "LAS Format",
    "shape_step_ns": "Shape Step (ns)",
    "beyond": "Far Echoes",
    "source_level_db": "Source (dB)",
    "transducer_file": "Transducer WAV",
    "ringing_db": "Ringing (dB)",
    "gain": "Gain (s, dB)",
    "self_noise_db": "Noise (dB/Hz)",
    "self_noise_shape": "Shape (Hz, dB)",
    "ambient_level_db": "Ambient (dB)",
    "noise_file": "Noise WAV",
    "noise_level_db": "Loudness (dB)",
    "overload_db": "Overload (dB)",
    "threshold_db": "Detect (dB)",
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
    beside = dict(besides)
    for field in fields_of(settings):
        name = field.name
        if field.how == "groups":
            lists[name] = CollectionProperty(type=groups[field.item])
            lists[f"active_{name}"] = IntProperty(
                name="Chosen",
                description="The one that settings and buttons below are about",
                options={"HIDDEN"},
                update=when_set.get(f"active_{name}"),
            )
        elif field.how == "group":
            parts[name] = PointerProperty(type=groups[field.kind], **words_of(field))
        elif field.how != "kind":
            annotations[name] = property_of(field, when_set.get(name, _noticed))
            if shown := _shown_property(field):
                beside[f"{name}{FACE}"] = shown
        if field.optional:
            annotations[f"use_{name}"] = _switch(field)
    group = group_class(settings.__name__.lower(), annotations | parts | lists | beside)
    group.shown = tuple(name for name in annotations if not name.startswith("use_"))
    group.nested = tuple(parts)
    return group


def words_of(field: Field) -> dict[str, Any]:
    """Name and help of a field's property."""
    text = field.param.help.replace("left out:", "off:").replace("Left out:", "Off:")  # its switch
    if field.param.auto:  # a number here, a word in files
        text = text.replace("auto:", "-1, automatic:")
    return {
        "name": label_of(field.name, field.param),
        "description": (text if "α" <= text[:1] <= "ω" else text[:1].upper() + text[1:]),
    }


def label_of(name: str, known: Param) -> str:
    """Name of a field in the panel: ``angle_step_deg`` is Angle Step (°)."""
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


def _switch(field: Field) -> Any:
    """Return whether a value that may be left out is given."""
    words = words_of(field) | {"update": _noticed, "default": field.default is not None}
    if field.name in ONE_OF:
        words["update"] = lambda props, _: _switch_others_off(field.name, props)
    return BoolProperty(**words | {"name": f"Use {words['name']}"})


def _switch_others_off(name: str, props: Any) -> None:
    """A species grows in one way only."""
    for other in ONE_OF if getattr(props, f"use_{name}") else ():
        if other != name and getattr(props, f"use_{other}"):
            setattr(props, f"use_{other}", False)


def property_of(field: Field, update: Update = _noticed) -> Any:
    """The Blender property of a field."""
    name, known, default, words = field.name, field.param, field.start, words_of(field)
    if field.how in ("list", "text"):
        given = () if default is dataclasses.MISSING else default
        return StringProperty(default=text_of(given), update=_noticed, **words)
    size = len(typing.get_args(field.kind)) if typing.get_origin(field.kind) is tuple else 0
    item = typing.get_args(field.kind)[0] if size else field.kind
    words["update"] = update
    if item is bool:
        return (BoolVectorProperty if size else BoolProperty)(default=default, **words)
    if item is str:
        if known.choices:
            items = [
                (choice, title_of(name, choice), meaning_of(name, choice) or words["description"])
                for choice in known.choices
            ]
            return EnumProperty(items=items, default=default, **words)
        words |= offered(name, known)
        return StringProperty(default="" if default is dataclasses.MISSING else default, **words)
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


def group_class(name: str, annotations: dict[str, Any]) -> type[bpy.types.PropertyGroup]:
    """A property group with these properties."""
    return type(f"FOREST_PG_{name}", (bpy.types.PropertyGroup,), {"__annotations__": annotations})
