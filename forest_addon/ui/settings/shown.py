"""Settings shown in another unit than files have: angles as Blender's angles, high frequencies in kHz.

What is stored stays degrees and hertz, as in a scene file; beside it stands a property NAME_shown that
converts when it is read or set. Blender has no unit of kilohertz, so its label says it.
"""

from __future__ import annotations

import math
from typing import Any

from bpy.props import FloatProperty, FloatVectorProperty

from ...blender.read.inputs import shortest
from ...spec import Param

FACE = "_shown"  # ends the name of the property beside a setting
HIGH = 1000.0  # Hz from which a frequency is one of kHz
LONGEST = 15  # letters of a label
DEGREE = math.pi / 180.0
ROOM = 6  # digits of an angle that are kept: Blender's numbers have no more


def factor_of(known: Param, default: Any) -> float:
    """By how much a value of a setting is multiplied when it is shown; 1: as it is stored."""
    if known.unit == "deg":
        return DEGREE
    values = default if isinstance(default, tuple) else (default,)
    numbers = [value for value in values if isinstance(value, int | float)]
    return 1e-3 if known.unit == "Hz" and numbers and max(numbers) >= HIGH else 1.0


def shown_property(name: str, title: str, words: str, known: Param, default: Any) -> Any:
    """The property that shows a setting in another unit, None where that is as it is stored."""
    factor, many = factor_of(known, default), isinstance(default, tuple)
    if factor == 1.0:
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

    given: dict[str, Any] = {"description": words, "get": read, "set": write}
    for limit, end in (("min", known.minimum), ("max", known.maximum)):
        if math.isfinite(end):
            given[limit] = factor * end
    if factor == DEGREE:
        given |= {"name": title.removesuffix(" (°)").removesuffix("(°)"), "unit": "ROTATION"}
        given |= {"step": 100, "precision": 3}
    else:
        whole = f"{title} (kHz)"
        given["name"] = whole if len(whole) <= LONGEST else f"{title} kHz"
        given |= {"step": 100, "precision": 2}
    if many:
        given["size"] = len(default)
    if many:
        return FloatVectorProperty(options={"SKIP_SAVE"}, **given)
    if factor == DEGREE:
        given["subtype"] = "ANGLE"
    return FloatProperty(options={"SKIP_SAVE"}, **given)
