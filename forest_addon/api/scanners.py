"""Sensors that start from a real instrument's published figures."""

from __future__ import annotations

from typing import Any

from ..formats.scanner_file import PLATFORMS, read_scanner, scanner_names
from ..formats.toml_file import structure
from ..spec import Scanner, Sensor, unknown
from ..spec.base import typed


def instruments() -> tuple[str, ...]:
    """Names that ``instrument`` knows.

    >>> from forest_addon import api as forest
    >>> "riegl-vz-400i" in forest.instruments()
    True
    """
    return tuple(scanner_names())


def instrument(name: str, kind: str = "", /, **settings: Any) -> Scanner:
    """A LiDAR sensor with the figures of an instrument of ``assets/scanners``, or of a .toml file like those.

    kind : "terrestrial", "mobile" or "airborne": what carries it; left out, the first of these that it is
    used on. settings : what is to be otherwise, as of ``Terrestrial``, ``Mobile`` or ``Airborne``.

    Raises
    ------
    SpecError : there is no such instrument, it is not used on that platform, or a setting cannot be used.

    >>> from forest_addon import api as forest
    >>> drone = forest.instrument("riegl-vux-1uav", "airborne", speed=5.0)
    >>> drone.pulse_rate, drone.speed
    (550000.0, 5.0)
    """
    name, kind = typed("instrument", name, str), typed("kind", kind, str)
    if kind and kind not in PLATFORMS:
        raise unknown("kind", kind, PLATFORMS)
    chosen = kind or next(iter(read_scanner(name).tables))
    sensor: Scanner = structure({"kind": chosen, "scanner": name}, Sensor)  # type: ignore[assignment]
    return sensor.changed(**settings)
