"""Picture of what a sensor found: the drawing that belongs to its kind, or the plain one of its record."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from forest_addon.blender.sensors.observe import Observer
from forest_addon.results.kind import Finding
from forest_addon.sensing.sonar.kind import targets_of
from forest_addon.spec import Sensor
from forest_addon.stand.forest import GrownForest

from . import plain
from .echo import draw_echo, draw_flight, sample_leaves
from .pictures import draw_cloud, draw_reverb, draw_scan


def draw_result(
    sensor: Sensor, found: Finding, observer: Observer, forest: GrownForest, path: Path
) -> Path | None:
    """Draw what a sensor found into a PNG; return its path, None where there is nothing to draw."""
    if sensor.kind in DRAWINGS:
        return DRAWINGS[sensor.kind](sensor, found, observer, forest, path)
    return plain.draw_result(sensor, found, path)


def _matrix(
    _sensor: Any, found: Finding, _seen: Observer, _forest: GrownForest, path: Path
) -> Path:
    return draw_scan(found, path)


def _panorama(
    sensor: Any, found: Finding, _seen: Observer, _forest: GrownForest, path: Path
) -> Path:
    return draw_cloud(found, sensor, path)


def _cloud(_sensor: Any, found: Finding, _seen: Observer, _forest: GrownForest, path: Path) -> Path:
    return draw_cloud(found, None, path)


def _echoes(sensor: Any, found: Finding, seen: Observer, forest: GrownForest, path: Path) -> Path:
    draw = draw_flight if hasattr(found, "echoes") else draw_echo
    return draw(found, sensor, sample_leaves(seen.once(targets_of)), forest, path)


def _response(
    _sensor: Any, found: Finding, _seen: Observer, _forest: GrownForest, path: Path
) -> Path:
    return draw_reverb(found, path)


DRAWINGS: dict[str, Callable[[Any, Finding, Observer, GrownForest, Path], Path]] = {
    "tractor": _matrix,
    "terrestrial": _panorama,
    "mobile": _cloud,
    "airborne": _cloud,
    "sonar": _echoes,
    "reverb": _response,
}
