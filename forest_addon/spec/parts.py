"""Fields that sensors and layouts share, said once: kinds, names, places, directions and beams.

Each makes one field of a group, with the unit, range and words that it has everywhere.
"""

from __future__ import annotations

from typing import Any

from .base import param

PATTERNS = ("gaussian", "horseshoe", "file", "omni")  # how a sonar's call spreads, or its ears hear


def kind(name: str) -> Any:
    """The word that names a kind of sensor in a scene file."""
    return param(name, help="kind of sensor", choices=(name,))


def output_name(default: str) -> Any:
    """The name of a sensor and of its files."""
    return param(default, help="name of its output files")


def place(default: tuple[float, float, float], what: str) -> Any:
    """A position in the scene, metres."""
    return param(default, unit="m", help=what)


def azimuth(default: float, what: str) -> Any:
    """A direction on the map, degrees."""
    return param(default, unit="deg", help=f"{what}, from +X towards +Y", ge=-360, le=360)


def elevation(default: float, what: str) -> Any:
    """A direction above or below the horizon, degrees."""
    return param(default, unit="deg", help=f"{what}, from the horizon up", ge=-90, le=90)


def beam_width(default: float, what: str) -> Any:
    """The -3 dB widths of a Gaussian beam, degrees."""
    words = f"full -3 dB width of {what}, in azimuth and elevation"
    return param((default, default), unit="deg", help=words, gt=0, le=360)


def motion() -> Any:
    """The switch by which a sensor heeds that a scene moves."""
    words = (
        "animated objects are where they are at the time of each pulse or ping, counted from the scene's "
        "first frame; left out: all stands as at the present frame"
    )
    return param(False, help=words)


def range_limit(default: float) -> Any:
    """The distance beyond which light is not seen, metres."""
    return param(default, unit="m", help="nothing farther is seen", gt=0, le=1e5)
