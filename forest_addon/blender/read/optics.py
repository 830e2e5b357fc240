"""Mirrors, glass and water of a scene, from custom properties of objects and materials."""

from __future__ import annotations

from dataclasses import fields

import bpy
import numpy as np

from ...spec import POLISHED, Polished, property_of

KIND_KEY, *NUMBER_KEYS = (property_of(field.name) for field in fields(Polished))
NO_OPTICS = (np.nan, np.nan, np.nan, np.nan)
Optics = tuple[float, float, float, float]


def optics_of(*places: bpy.types.ID) -> Optics:
    """Kind and numbers of a mirror, glass or water, of the first of an object's places that says one.

    Returns
    -------
    kind as a number of ``spec.POLISHED``, -1 where the word is none of them; index, share and extinction (of
    a retro-reflector its gain), NaN where they are not said. All are NaN where no place says anything.
    """
    for place in places:
        kind = place.get(KIND_KEY)
        if isinstance(kind, str) and kind:
            said = [place.get(key) for key in NUMBER_KEYS]
            index, share, extinction, gain = (
                float(value) if isinstance(value, (int, float)) else np.nan for value in said
            )
            extinction = gain if kind == "retro" else extinction
            number = POLISHED.index(kind) if kind in POLISHED else -1
            return float(number), index, share, extinction
    return NO_OPTICS
