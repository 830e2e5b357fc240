"""Domain randomisation by one word: what a plan with ``randomise = "measured"`` varies by itself.

Every range has its source beside it, and in docs/dataset.md; *ours* is a choice without a measurement. A key
that the plan's own [vary] names is left to that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from forest_addon.formats.toml_file import PLATFORMS, read_scanner, scanner_names
from forest_addon.spec import SpecError

from .settings import Head, Mix

# Metres from the lowest to the highest place of a plot: 95 % of the 1,250 squares of 20 m on Barro Colorado
# Island (Condit 1998) have less.
RELIEF = (0.0, 6.0)
STEEPER, COARSER = 0.75, 1.5  # times the angle step that a plan has: ours
# Times the density of a mix: quarter and nine tenths of 100 squares of 20 m of longleaf pine (Platt, Evans &
# Rathbun 1988), over their mean.
DENSITY = (0.5, 2.0)
UNDERGROWTH = {"choice": ["none", "sparse", "dense"], "weights": [1, 2, 2]}  # ours
# Species of a stand, and Dirichlet parameters by which Pielou's evenness of two of them is 0.6 to 0.99 in the
# mean: 209 European plots of one to five species, evenness above 0.6 (Baeten et al. 2013).
KINDS = (1, 5)
EVENNESS = (0.6, 30.0)
WIND = (0.0, 9.0)  # m/s: scans in calm and in 9 m/s (Vaaja et al. 2016, ISPRS Annals III-3:117)
# Days of a year: from the unfolding of beech in mid-May (Dittmar & Elling 2006) to the colouring of oak on 19
# October (Deutscher Wetterdienst, mean of 2011 to 2023); a month of turning and falling is ours.
SEASON = {"choice": [0.0, 0.25, 0.5, 0.75, 1.0], "weights": [160, 10, 10, 10, 175]}


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
    found: dict[str, Any] = {
        "forest.undergrowth": UNDERGROWTH,
        "terrain.relief": {"uniform": list(RELIEF)},
        "mix.season": SEASON,
    }
    found |= _of_species(plan.get("mix", {}), scenes)
    sensors = [sensor for scene in scenes for sensor in scene.get("sensors", [])]
    kinds = {sensor.get("kind") for sensor in sensors}
    if kinds & {*PLATFORMS, "sonar"}:
        found["wind.speed"] = {"uniform": list(WIND)}
    if sensors and kinds <= set(PLATFORMS):
        found |= _of_scanners(sensors, kinds)
    return found | own


def _of_species(mix: Mapping[str, Any], scenes: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what varies of species: of a mix, or the shares of the plantings of a scene."""
    found: dict[str, Any] = {}
    if mix.get("species"):
        most = min(KINDS[1], len(mix["species"]))
        found["mix.kinds"] = {"integers": [KINDS[0], most], "times": 2}
        found["mix.evenness"] = {"log_uniform": list(EVENNESS)}
        density = float(mix.get("density", Mix().density))
        found["mix.density"] = {"log_uniform": [density * end for end in DENSITY]}
    elif any(len(scene.get("plantings", [])) > 1 for scene in scenes):
        found["mix.redealt"] = {"log_uniform": list(EVENNESS)}
    return found


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
    ranges = [float(sensor["max_range"]) for sensor in sensors if "max_range" in sensor]
    if len(ranges) == len(sensors):  # else threshold and range are the instrument's own
        limits = [threshold_at(min(ranges), table) for table in tables if table.get("faintest")]
        if limits:
            found["sensors[*].faintest"] = {"log_uniform": [min(limits), max(limits)]}
    steps = [sensor.get("angle_step_deg") for sensor in sensors]
    if all(steps):
        low, high = STEEPER * min(map(float, steps)), COARSER * max(map(float, steps))
        found["sensors[*].angle_step_deg"] = {"uniform": [low, high]}
    return found


def threshold_at(reach: float, table: Mapping[str, Any]) -> float:
    """Reflectance that a facing surface needs at a range, metres, to be as bright as an instrument's faintest
    at its own largest range; at most 1.
    """
    return min(1.0, float(table["faintest"]) * (reach / float(table["max_range"])) ** 2)
