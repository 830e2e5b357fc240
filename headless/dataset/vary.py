"""Variation from scene to scene: values of a key by a distribution, from one even number between 0 and 1.

Every distribution is its quantile function Q(u), so a design only has to say how the u of all scenes lie:
each for itself, as a Latin hypercube (every key has one scene in each of its N slices), or as a scrambled
Sobol sequence (Owen 1998), whose first scenes stay when more are asked for. A grid goes through all
combinations of its values. Keys of the same design make one design together.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from forest_addon.base.rng import stream
from forest_addon.spec import SpecError, did_you_mean, unknown

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
        low, high = (ndtr((end - a) / b) for end in (self.low, self.high))
        return float(np.clip(a + b * ndtri(low + u * (high - low)), self.low, self.high))


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
    weights, low, high = tuple(said.get("weights", ())), said.get("low"), said.get("high")
    times = said.get("times", 0)
    if kind in ("choice", "grid"):
        good = isinstance(given, list) and given and (not weights or len(weights) == len(given))
        good = good and (not weights or (min(weights) >= 0 and sum(weights) > 0))
    elif kind == "fixed":
        good = True
    else:
        good = isinstance(given, list) and len(given) == 2 and all(_is_number(v) for v in given)
        if good and kind == "normal":
            low = given[0] - 2 * given[1] if low is None else low
            high = given[0] + 2 * given[1] if high is None else high
            good = given[1] > 0 and _is_number(low) and _is_number(high) and low < high
        elif good:
            good = given[0] <= given[1] and (kind != "log_uniform" or given[0] > 0)
            good = good and (kind != "integers" or all(isinstance(v, int) for v in given))
    if not good or not isinstance(times, int) or times < 0:
        raise SpecError(place, f"{kind} needs {KINDS[kind]}")
    return Varied(path, kind, given, weights, low, high, design, times)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def cells_of_grid(varied: Sequence[Varied]) -> int:
    """Return how many combinations the grids among them have; 1 without any."""
    return math.prod(len(one.given) for one in varied if one.kind == "grid")


def draw(varied: Sequence[Varied], seed: int, count: int) -> list[dict[str, Any]]:
    """For each of ``count`` scenes, the value of every path."""
    columns = _even_numbers(varied, seed, count)
    return [
        {one.path: one.at(float(columns[one.path][scene])) for one in varied}
        for scene in range(count)
    ]


def _even_numbers(varied: Sequence[Varied], seed: int, count: int) -> dict[str, np.ndarray]:
    """By path, (count,) numbers between 0 and 1."""
    columns: dict[str, np.ndarray] = {}
    grid = [one for one in varied if one.kind == "grid"]
    places = itertools.product(*(range(len(one.given)) for one in grid))
    rows = np.array(list(places), dtype=float).reshape(cells_of_grid(varied), len(grid))
    for number, one in enumerate(grid):
        sizes = rows[np.arange(count) % len(rows), number]
        columns[one.path] = (sizes + 0.5) / len(one.given)
    for one in varied:
        if one.kind == "grid":
            continue
        if one.design == "independent":
            each = (stream(seed, "vary", one.path, scene).random() for scene in range(count))
            columns[one.path] = np.fromiter(each, float, count)
        elif one.design == "latin":
            rng = stream(seed, "vary", "latin", one.path)
            columns[one.path] = (rng.permutation(count) + rng.random(count)) / max(count, 1)
    columns |= _sobol(
        [one.path for one in varied if one.design == "sobol" and one.kind != "grid"], seed, count
    )
    return columns


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
