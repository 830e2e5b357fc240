"""In which unit a tree's file was drawn: an STL does not say, so a likely size has to.

Trees are some 10 m high and leaves some 10 cm long, give or take a factor of three. Of the units in which
people draw, the one is taken that brings both nearest, on a logarithmic scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

UNITS = {
    "metres": 1.0,
    "decimetres": 0.1,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "feet": 0.3048,
    "inches": 0.0254,
}
USUAL_HEIGHT, HEIGHT_SPREAD = 10.0, math.log(3.0)
USUAL_LEAF, LEAF_SPREAD = 0.10, math.log(2.5)


@dataclass(frozen=True)
class Unit:
    """Metres in one unit of a file, and what it is called."""

    metres: float
    name: str


def infer_unit(height: float, leaf: float | None = None) -> Unit:
    """The likeliest unit of a tree of this height, and of this median leaf length, in file units."""

    def odds(metres: float) -> float:
        far = (math.log(height * metres / USUAL_HEIGHT) / HEIGHT_SPREAD) ** 2
        if leaf:
            far += (math.log(leaf * metres / USUAL_LEAF) / LEAF_SPREAD) ** 2
        return far

    name = min(UNITS, key=lambda unit: odds(UNITS[unit]))
    return Unit(UNITS[name], name)
