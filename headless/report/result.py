"""The picture of what a sensor found: which of the drawings belongs to it."""

from __future__ import annotations

from pathlib import Path

from forest_addon.blender.sensors.observe import Observer
from forest_addon.results.figures import Finding
from forest_addon.sensing.lidar.cloud import Cloud
from forest_addon.sensing.lidar.tractor import TractorScan
from forest_addon.sensing.sonar.flight import Flight
from forest_addon.sensing.sonar.kind import targets_of
from forest_addon.sensing.sonar.ping import Echo
from forest_addon.spec import Sensor
from forest_addon.stand.forest import Forest

from .echo import draw_echo, draw_flight, sample_leaves
from .pictures import draw_cloud, draw_reverb, draw_scan


def draw_result(
    sensor: Sensor, found: Finding, observer: Observer, forest: Forest, path: Path
) -> Path:
    """Draw what a sensor found into a PNG; returns its path."""
    if isinstance(found, TractorScan):
        return draw_scan(found, path)
    if isinstance(found, Cloud):
        return draw_cloud(found, sensor, path)
    if isinstance(found, Echo):
        return draw_echo(found, sensor, sample_leaves(observer.once(targets_of)), forest, path)
    if isinstance(found, Flight):
        return draw_flight(found, sensor, sample_leaves(observer.once(targets_of)), forest, path)
    return draw_reverb(found, path)
