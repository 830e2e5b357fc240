"""Base of the settings of all sensors, the table of their kinds, and the fields that they share.

Each function makes one field of a group, with the unit, range and words that it has everywhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from .base import Settings, param

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


class Sensor(Settings):
    """Base of the settings of a sensor: ``kind`` is its word in a scene file, ``name`` that of its files.

    KINDS : every kind that a scene file may name, in the order in which a user is told of them. The program's
    own are in ``scene``; ``sensing.kinds.add`` adds others.
    """

    KINDS: ClassVar[dict[str, type[Sensor]]] = {}

    if TYPE_CHECKING:  # each class declares both, with defaults of its own
        kind: str
        name: str
