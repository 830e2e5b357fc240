"""Domain randomisation by one word: what a plan with ``randomise = "measured"`` varies by itself.

Ranges are those that instruments and stands have: whole instruments of the platform that a plan scans from
(``assets/scanners``, published figures), the spread of their ranging noise, undergrowth from none to dense,
ground from flat to hills of a few metres, stands from half to twice the plan's density where that is mixed.
A key that the plan's own [vary] names is left to that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from forest_addon.formats.scanner_file import PLATFORMS, read_scanner, scanner_names
from forest_addon.spec import SpecError

from .settings import Head

RELIEF = (0.0, 3.0)  # metres, of a plot
STEEPER, COARSER = 0.75, 1.5  # times the angle step that a plan has
DENSITY = (0.5, 2.0)  # times the density of a mix


def randomised(head: Head, scenes: Sequence[Mapping[str, Any]], plan: Mapping[str, Any]) -> Any:
    """A [vary] table for a plan of these base scenes: what its word draws, and its own over that.

    Raises
    ------
    SpecError : a plan whose scenes are counted by a grid alone.
    """
    own = plan.get("vary", {})
    if head.randomise == "none" or not isinstance(own, dict):  # what is no table is refused later
        return own
    if head.count == 0:
        said = f'is needed beside randomise = "{head.randomise}"; give the number of scenes'
        raise SpecError("count", said)
    mix = plan.get("mix", {})
    found: dict[str, Any] = {
        "forest.undergrowth": {"choice": ["none", "sparse", "dense"], "weights": [1, 2, 2]},
        "terrain.relief": {"uniform": list(RELIEF)},
    }
    if "density" in mix:
        found["mix.density"] = {"log_uniform": [float(mix["density"]) * end for end in DENSITY]}
    sensors = [sensor for scene in scenes for sensor in scene.get("sensors", [])]
    kinds = {sensor.get("kind") for sensor in sensors}
    if sensors and kinds <= set(PLATFORMS):
        found |= _of_scanners(sensors, kinds)
    return found | own


def _of_scanners(sensors: Sequence[Mapping[str, Any]], kinds: set[Any]) -> dict[str, Any]:
    """Return what varies of scanners, where every sensor of a plan is one."""
    able = [name for name in scanner_names() if kinds <= set(read_scanner(name).tables)]
    tables = [read_scanner(name).tables[kind] for name in able for kind in kinds]
    spread = [
        float(sd) for table in tables if (sd := table.get("noise", {}).get("range_sd")) is not None
    ]
    found: dict[str, Any] = {}
    if able:
        found["sensors[*].scanner"] = {"choice": able}
    if spread:
        found["sensors[*].noise.range_sd"] = {"log_uniform": [min(spread), max(spread)]}
    steps = [sensor.get("angle_step_deg") for sensor in sensors]
    if all(steps):
        low, high = STEEPER * min(map(float, steps)), COARSER * max(map(float, steps))
        found["sensors[*].angle_step_deg"] = {"uniform": [low, high]}
    return found
