"""Legends of a cloud: for each choice of its menu *Colour By*, names or values, and colours.

Organs, species and objects are named, the most frequent first; a measure has four values along its scale.
Colours are those that the nodes of ``cloud_nodes`` give, computed here with the same arithmetic: a number n
has the hue frac(0.618 n), a measure its place on the usual scale.
"""

from __future__ import annotations

import colorsys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.trimesh import PART_NAMES
from ...sensing.lidar.cloud import Cloud
from ...sensing.sonar.ping import Contributions
from .cloud import COLOUR_OF_ORGAN, OTHER, QUIETEST
from .cloud_nodes import GOLDEN, SCALE, USUAL_MAP, VALUE, VIVID, on_map

MOST = 12  # names of one choice; what is hit more rarely is left out
DEGREES = 180.0 / np.pi

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Entry:
    """One line: under which choice of the menu, what it says, in which colour."""

    choice: str
    name: str
    colour: Colour


def legend_of(
    cloud: Cloud, objects: Sequence[str] = (), species: Sequence[str] = ()
) -> list[Entry]:
    """The legend of a scanner's cloud.

    objects : names by the number of an instance. species : names by the number of a species.
    """
    found = _named("Organ", cloud.returns.organ, PART_NAMES, _of_organ)
    found += _named("Species", cloud.returns.species, species, _of_number)
    found += _named("Object", cloud.returns.instance, objects, _of_number)
    found += _scaled("Height", cloud.position[:, 2], "m")
    found += _scaled("Distance", cloud.returns.distance, "m")
    found += _scaled(
        "Incidence", DEGREES * np.arccos(np.minimum(cloud.returns.cos_incidence, 1.0)), "°"
    )
    found += _scaled("Width", 1e9 * cloud.width, "ns")
    found += _scaled("Scan Angle", DEGREES * cloud.scan_angle, "°")
    found += _scaled("Time", cloud.time, "s")
    return found + _scaled("Intensity", 10.0 * np.log10(np.maximum(cloud.intensity, 1e-20)), "dB")


def legend_of_heard(heard: Contributions) -> list[Entry]:
    """The legend of what a sonar heard."""
    if not len(heard):
        return []
    quiet = 20.0 * np.log10(QUIETEST)
    found = [
        Entry("Loudness", f"{quiet * (1.0 - share) + 0.0:.0f} dB", on_map(USUAL_MAP, share))
        for share in (1.0, 0.5, 0.0)
    ]
    found += _scaled("Delay", 1e3 * heard.delay, "ms")
    return found + _scaled("Distance", heard.distance, "m")


def _named(
    choice: str, numbers: np.ndarray, names: Sequence[str], colour_of: Callable[[int], Colour]
) -> list[Entry]:
    """The most frequent of these numbers that have a name; of several that are called alike, as instances of
    one object are, the first."""
    there, count = np.unique(numbers, return_counts=True)
    order = there[np.argsort(-count, kind="stable")]
    known: dict[str, int] = {}
    for number in (int(n) for n in order if 0 <= n < len(names) and names[n]):
        known.setdefault(names[number], number)
    found = list(known.items())[:MOST]
    return [Entry(choice, name, colour_of(number)) for name, number in found]


def _scaled(choice: str, values: np.ndarray, unit: str) -> list[Entry]:
    """Values along a scale, the smallest first; none where all are the same."""
    if not len(values) or not np.ptp(values) > 0:
        return []
    ends = np.linspace(float(values.min()), float(values.max()), len(SCALE))
    space = "" if unit == "°" else " "
    return [
        Entry(choice, f"{number}{space}{unit}", colour)
        for number, colour in zip(_in_words(ends), SCALE, strict=True)
    ]


def _in_words(values: np.ndarray) -> list[str]:
    """Numbers as one writes those of a scale: all to the digit that tells neighbours apart, none as -0."""
    step = float(np.ptp(values)) / (len(values) - 1)
    digits = int(np.clip(1 - np.floor(np.log10(step)), 0, 12))
    rounded = np.round(values, digits) + 0.0
    return [f"{value:,.{digits}f}" for value in rounded]


def _of_organ(organ: int) -> Colour:
    return _rgb(np.array(COLOUR_OF_ORGAN.get(organ, OTHER)))


def _of_number(number: int) -> Colour:
    hue = float(np.modf(np.float32(number) * np.float32(GOLDEN))[0])
    return colorsys.hsv_to_rgb(hue, VIVID, VALUE)


def _rgb(colour: np.ndarray) -> Colour:
    r, g, b = (float(channel) for channel in colour[:3])
    return r, g, b
