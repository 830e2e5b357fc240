"""The unit in which a tree's file was drawn: an STL does not say.

Metres, where the tree is then 0.3 to 120 m high. Else, of the other units in which people draw and in which
it is, the one that brings tree and leaves nearest to usual sizes, on a logarithmic scale: trees are some 10 m
high and leaves some 10 cm long, give or take a factor of three.
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
LOWEST, HIGHEST = 0.3, 120.0  # metres
USUAL_HEIGHT, HEIGHT_SPREAD = 10.0, math.log(3.0)
USUAL_LEAF, LEAF_SPREAD = 0.10, math.log(2.5)


@dataclass(frozen=True)
class Unit:
    """Metres in one unit of a file, and what it is called."""

    metres: float
    name: str


def infer_unit(height: float, leaf: float | None = None) -> Unit:
    """Metres where a tree of this height, in file units, is then as high as trees are, else the likeliest
    unit in which it is.

    leaf : median length of a leaf, in file units.
    """

    def odds(name: str) -> float:
        metres = UNITS[name]
        far = (math.log(height * metres / USUAL_HEIGHT) / HEIGHT_SPREAD) ** 2
        if leaf:
            far += (math.log(leaf * metres / USUAL_LEAF) / LEAF_SPREAD) ** 2
        return far

    possible = [name for name in UNITS if LOWEST <= height * UNITS[name] <= HIGHEST]
    name = "metres" if "metres" in possible else min(possible or ["metres"], key=odds)
    return Unit(UNITS[name], name)
