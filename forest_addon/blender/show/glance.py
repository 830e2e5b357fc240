"""Colours of a glance through a scanner, and what they mean in a line."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base.trimesh import PART_NAMES
from .cloud import COLOUR_OF_ORGAN, OTHER
from .cloud_nodes import MAPS, USUAL_MAP

DISTANCE, BRIGHTNESS, ORGAN = "DISTANCE", "BRIGHTNESS", "ORGAN"
NOTHING = (0.02, 0.02, 0.03)  # linear, where no pulse meets anything
OUTLIERS = 2  # percent of the values at each end, that share the colour of those
GAMMA = 1 / 2.2  # colours are linear, the screen's are not
Entry = tuple[str, tuple[float, float, float]]


def ear_colours(found: Any) -> tuple[np.ndarray, list[Entry]]:
    """Return colours for the screen (H, W, 3), 0 to 1, of a ``Cochleagram``, one ear above the other, and a
    legend: texts with colours."""
    ears, channels, columns = found.level.shape
    level = np.full((ears * (channels + 1) - 1, columns), np.nan)  # a dark row between ears
    for ear in range(ears):
        level[ear * (channels + 1) :][:channels] = found.level[ear]
    there = np.isfinite(level)
    if not there.any():
        return np.tile(np.array(NOTHING) ** GAMMA, (*level.shape, 1)), []
    low, high = float(level[there].min()), float(level[there].max())
    colours = _mapped((np.where(there, level, low) - low) / ((high - low) or 1.0))
    colours = np.where(there[..., None], colours, NOTHING)
    ends = _mapped(np.array([0.0, 1.0]))
    legend = [
        (f"{value:.0f} dB", _screen(end)) for value, end in zip((low, high), ends, strict=True)
    ]
    first, last = found.frequency[0] / 1e3, found.frequency[-1] / 1e3
    axes = f"0–{found.reach:g} m, {first:.0f}–{last:.0f} kHz"
    return np.clip(colours, 0.0, 1.0) ** GAMMA, [*legend, (axes, (0.7, 0.7, 0.7))]


def glance_colours(found: Any, shown: str) -> tuple[np.ndarray, list[Entry]]:
    """Return colours for the screen (H, W, 3), 0 to 1, of a ``Glance``, and a legend: texts with colours.

    Of a ``Cochleagram`` see ``ear_colours``. Distances are coloured by their logarithm, near ones bright;
    ``shown``: DISTANCE, BRIGHTNESS or ORGAN.
    """
    if hasattr(found, "level"):
        return ear_colours(found)
    there = np.isfinite(found.distance)
    if shown == ORGAN:
        of_part = np.tile(OTHER[:3], (128, 1))
        for part, colour in COLOUR_OF_ORGAN.items():
            of_part[part] = colour[:3]
        colours, parts = of_part[found.organ], np.unique(found.organ[there])
        legend = [(PART_NAMES[part], _screen(of_part[part])) for part in parts.tolist()]
    else:
        values = np.log(np.maximum(found.distance, 1e-3)) if shown == DISTANCE else found.brightness
        low, high = (
            np.percentile(values[there], (OUTLIERS, 100 - OUTLIERS)) if there.any() else (0, 0)
        )
        share = (np.where(there, values, low) - low) / ((high - low) or 1.0)
        colours = _mapped(1.0 - share if shown == DISTANCE else share)
        ends = _mapped(np.array([1.0, 0.0] if shown == DISTANCE else [0.0, 1.0]))
        texts = (
            [f"{np.exp(value):.3g} m" for value in (low, high)]
            if shown == DISTANCE
            else [f"{100 * value:.0f} %" for value in (low, high)]
        )
        legend = [(text, _screen(end)) for text, end in zip(texts, ends, strict=True)]
    colours = np.where(there[..., None], colours, NOTHING)
    return np.clip(colours, 0.0, 1.0) ** GAMMA, legend if there.any() else []


def _mapped(share: np.ndarray) -> np.ndarray:
    """(..., 3) linear colours of shares on the usual scale."""
    stops = np.array(MAPS[USUAL_MAP])
    place = np.linspace(0.0, 1.0, len(stops))
    return np.stack(
        [np.interp(np.clip(share, 0, 1), place, channel) for channel in stops.T], axis=-1
    )


def _screen(colour: np.ndarray) -> tuple[float, float, float]:
    r, g, b = (float(channel) ** GAMMA for channel in colour[:3])
    return r, g, b
