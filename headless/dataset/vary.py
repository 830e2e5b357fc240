"""Variation from scene to scene: values of a key by a distribution, from one even number between 0 and 1.

Every distribution is its quantile function Q(u), so a design only has to say how the u of all scenes lie:
each for itself, as a Latin hypercube (every key has one scene in each of its N slices), or as a scrambled
Sobol sequence (Owen 1998), whose first scenes stay when more are asked for. A grid goes through all
combinations of its values. Keys of the same design make one design together.

With ``randomise = "measured"`` a plan varies by itself within ranges that were measured. Every range has its
source beside it, and in docs/dataset.md; *ours* is a choice without a measurement. A key that the plan's own
[vary] names is left to that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import PLATFORMS, read_scanner, scanner_names
from forest_addon.spec import SpecError, did_you_mean, unknown

from .settings import Head, Mix

KINDS = {
    "fixed": "a value",
    "choice": "a list of values, and weights",
    "uniform": "[low, high]",
    "log_uniform": "[low, high]",
    "integers": "[low, high]",
    "normal": "[mean, sd], and low and high, between which it is cut off",
    "grid": "a list of values",
}
MORE = ("weights", "low", "high", "design", "times")
DESIGNS = ("independent", "latin", "sobol")


@dataclass(frozen=True)
class Varied:
    """One key that varies: its path in the plan, its distribution, its design.

    given : what stands beside the kind. times : so many equal values in a list; 0: the value itself.
    """

    path: str
    kind: str
    given: Any
    weights: tuple[float, ...] = ()
    low: float | None = None
    high: float | None = None
    design: str = "independent"
    times: int = 0

    def at(self, u: float) -> Any:
        """The value at an even number u between 0 and 1, of a grid the value of that share of its list."""
        value = self._value(u)
        return [value] * self.times if self.times else value

    def _value(self, u: float) -> Any:
        if self.kind == "fixed":
            return self.given
        if self.kind in ("choice", "grid"):
            weights = np.array(self.weights or [1.0] * len(self.given))
            edges = np.cumsum(weights) / weights.sum()
            return self.given[min(int(np.searchsorted(edges, u, "right")), len(edges) - 1)]
        a, b = self.given
        if self.kind == "uniform":
            return a + u * (b - a)
        if self.kind == "log_uniform":
            return float(a * (b / a) ** u)
        if self.kind == "integers":
            return int(min(a + math.floor(u * (b - a + 1)), b))
        low, high = (ndtr((end - a) / b) for end in self.ends)
        return float(np.clip(a + b * ndtri(low + u * (high - low)), *self.ends))

    @property
    def ends(self) -> tuple[float, float]:
        """Lowest and highest value of a normal distribution: two deviations from the mean, if not given."""
        mean, sd = self.given
        low = mean - 2 * sd if self.low is None else self.low
        return low, mean + 2 * sd if self.high is None else self.high


def read_varied(table: Any) -> list[Varied]:
    """The keys of a plan's [vary].

    Raises
    ------
    SpecError : a distribution that is none; its key is the path within the plan.
    """
    if not isinstance(table, Mapping):
        raise SpecError("vary", "is not a table of keys and distributions")
    return [_read(path, said) for path, said in table.items()]


def _read(path: str, said: Any) -> Varied:
    place = f"vary.{path}"
    if not isinstance(said, Mapping):
        return Varied(path, "fixed", said)
    kinds = [key for key in said if key in KINDS]
    for key in said:
        if key not in KINDS and key not in MORE:
            hint = did_you_mean(key, [*KINDS, *MORE])
            raise SpecError(
                f"{place}.{key}", f"is not known; {hint}Allowed: {', '.join([*KINDS, *MORE])}"
            )
    if len(kinds) != 1:
        raise SpecError(place, f"needs one of {', '.join(KINDS)}")
    kind, given = kinds[0], said[kinds[0]]
    design = said.get("design", "independent")
    if design not in DESIGNS:
        raise unknown(f"{place}.design", design, DESIGNS)
    beside = {key: said[key] for key in ("low", "high", "times") if key in said}
    one = Varied(path, kind, given, tuple(said.get("weights", ())), design=design, **beside)
    if not _fits(one) or not isinstance(one.times, int) or one.times < 0:
        raise SpecError(place, f"{kind} needs {KINDS[kind]}")
    return one


def _fits(one: Varied) -> bool:
    """Return whether what is given is such as the kind needs."""
    given, weights = one.given, one.weights
    if one.kind == "fixed":
        return True
    if one.kind in ("choice", "grid"):
        if not (isinstance(given, list) and given and len(weights) in (0, len(given))):
            return False
        return not weights or (min(weights) >= 0 and sum(weights) > 0)
    if not (isinstance(given, list) and len(given) == 2 and all(map(_is_number, given))):
        return False
    a, b = given
    if one.kind == "normal":
        low, high = one.ends
        return b > 0 and _is_number(low) and _is_number(high) and low < high
    whole = one.kind != "integers" or all(isinstance(value, int) for value in given)
    return whole and a <= b and (one.kind != "log_uniform" or a > 0)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def cells_of_grid(varied: Sequence[Varied]) -> int:
    """Number of combinations of the grids among them; 1 without any."""
    return math.prod(len(one.given) for one in varied if one.kind == "grid")


def draw(varied: Sequence[Varied], seed: int, count: int) -> list[dict[str, Any]]:
    """Values of every path for each of ``count`` scenes."""
    sobol = [one.path for one in varied if one.design == "sobol" and one.kind != "grid"]
    columns = _sobol(sobol, seed, count)
    cell = np.arange(count) % cells_of_grid(varied)
    for one in reversed(varied):  # the last grid goes fastest
        if one.kind == "grid":
            columns[one.path] = (cell % len(one.given) + 0.5) / len(one.given)
            cell = cell // len(one.given)
        elif one.design == "independent":
            each = (stream(seed, "vary", one.path, scene).random() for scene in range(count))
            columns[one.path] = np.fromiter(each, float, count)
        elif one.design == "latin":
            rng = stream(seed, "vary", "latin", one.path)
            columns[one.path] = (rng.permutation(count) + rng.random(count)) / max(count, 1)
    return [
        {one.path: one.at(float(columns[one.path][scene])) for one in varied}
        for scene in range(count)
    ]


def _sobol(paths: Sequence[str], seed: int, count: int) -> dict[str, np.ndarray]:
    if not paths:
        return {}
    import warnings

    from scipy.stats import qmc

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a count is no power of two
        points = qmc.Sobol(len(paths), scramble=True, rng=stream(seed, "vary", "sobol")).random(
            count
        )
    return dict(zip(paths, points.T, strict=True))


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
RANDOMISE_KINDS = (1, 5)
EVENNESS = (0.6, 30.0)
WIND = (0.0, 9.0)  # m/s: scans in calm and in 9 m/s (Vaaja et al. 2016, ISPRS Annals III-3:117)
# Metres: stems of a joined plot lie 8.2 mm off their circles, ours 4.4 mm where scans are joined without
# error and 7.0 mm where it is 12 mm; the lower end is ours.
REGISTRATION = (0.003, 0.012)
# Of lines: places to 2 to 5 cm, roll and pitch to 0.0025 to 0.025 degrees, as the sheets of Applanix's POS AV
# 610 and APX-15 UAV say of positions worked out after a flight; how fast they change is ours.
LINES = {"sd": (0.02, 0.05), "deg": (0.0025, 0.025), "s": (10.0, 100.0)}
# Days of a year: from the unfolding of beech in mid-May (Dittmar & Elling 2006) to the colouring of oak on 19
# October (Deutscher Wetterdienst, mean of 2011 to 2023); a month of turning and falling is ours.
# dB re 20 µPa at 0.1 m, of the peak, 3 dB above the root mean square: mean of Daubenton's bats in silence,
# and their loudest call in noise (Foskolos et al. 2022, J. Exp. Biol. 225, jeb242957).
SOURCE_LEVEL = (115.0, 132.0)
SELF_NOISE = 6.0  # dB about what a plan has, between receivers of a kind: ours
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
    table: dict[str, Any] = {
        "forest.undergrowth": UNDERGROWTH,
        "terrain.relief": {"uniform": list(RELIEF)},
        "mix.season": SEASON,
    }
    table |= _of_species(plan.get("mix", {}), scenes)
    sensors = [sensor for scene in scenes for sensor in scene.get("sensors", [])]
    kinds = {sensor.get("kind") for sensor in sensors}
    if kinds & {*PLATFORMS, "sonar"}:
        table["wind.speed"] = {"uniform": list(WIND)}
    if sensors and kinds <= set(PLATFORMS):
        table |= _of_scanners(sensors, kinds)
    receivers = [sensor.get("receiver") for sensor in sensors]
    if kinds == {"sonar"} and all(isinstance(one, Mapping) for one in receivers):
        table |= _of_receivers(receivers)
    return table | own


def _of_species(mix: Mapping[str, Any], scenes: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Variations of species: of a mix, or the shares of the plantings of a scene."""
    table: dict[str, Any] = {}
    if mix.get("species"):
        most = min(RANDOMISE_KINDS[1], len(mix["species"]))
        table["mix.kinds"] = {"integers": [RANDOMISE_KINDS[0], most], "times": 2}
        table["mix.evenness"] = {"log_uniform": list(EVENNESS)}
        density = float(mix.get("density", Mix().density))
        table["mix.density"] = {"log_uniform": [density * end for end in DENSITY]}
    elif any(len(scene.get("plantings", [])) > 1 for scene in scenes):
        table["mix.redealt"] = {"log_uniform": list(EVENNESS)}
    return table


def _of_scanners(sensors: Sequence[Mapping[str, Any]], kinds: set[Any]) -> dict[str, Any]:
    """Variations of scanners, where every sensor of a plan is one."""
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
    if kinds == {"terrestrial"}:
        found["sensors[*].noise.registration_sd"] = {"log_uniform": list(REGISTRATION)}
    elif kinds <= {"airborne", "mobile"}:
        for name, ends in LINES.items():
            found[f"sensors[*].noise.registration_{name}"] = {"log_uniform": list(ends)}
    ranges = [float(sensor["max_range"]) for sensor in sensors if "max_range" in sensor]
    if len(ranges) == len(sensors):  # else threshold and range are the instrument's own
        limits = [
            min(1.0, float(table["faintest"]) * (min(ranges) / float(table["max_range"])) ** 2)
            for table in tables
            if table.get("faintest")
        ]
        if limits:
            found["sensors[*].faintest"] = {"log_uniform": [min(limits), max(limits)]}
    steps = [sensor.get("angle_step_deg") for sensor in sensors]
    if all(steps):
        low, high = STEEPER * min(map(float, steps)), COARSER * max(map(float, steps))
        found["sensors[*].angle_step_deg"] = {"uniform": [low, high]}
    return found


def _of_receivers(receivers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Variations of sonars' receivers, where every sensor of a plan has one."""
    table: dict[str, Any] = {}
    if all("source_level_db" in one for one in receivers):
        table["sensors[*].receiver.source_level_db"] = {"uniform": list(SOURCE_LEVEL)}
    noise = [float(one["self_noise_db"]) for one in receivers if "self_noise_db" in one]
    if len(noise) == len(receivers):
        low, high = min(noise) - SELF_NOISE, max(noise) + SELF_NOISE
        table["sensors[*].receiver.self_noise_db"] = {"uniform": [low, high]}
    if all(one.get("ambient") == "wind" for one in receivers):
        table["sensors[*].receiver.wind_speed"] = {"uniform": [0.5, WIND[1]]}
    return table
