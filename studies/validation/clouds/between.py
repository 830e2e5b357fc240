"""Distances between two clouds, each beside the distance between halves and between flight lines of one.

A measure is a curve, a ratio of sums (``sums``); a distance is a number of two curves, 0 where they are
the same.
What is real differs from itself: random halves of its blocks of ground, and its flight lines. A distance
agrees
that is not above the 95th percentile of 40 such halvings of either cloud.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from headless.report.pictures import FAINT, INK, LEAF_GREEN, blank_figure, save_figure

from .sums import ANGLES, GAPS, LEVELS, MOST_RETURNS, RANGES, MeasuredCloud, lines_in

HALVINGS, LEVEL = 40, 0.95
FEWEST = 100.0  # pulses, voxels or returns of a class that is compared
FEW_STEMS = 5
Sums = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class CloudMeasure:
    """CloudMeasure: its name, the curve (K,) of sums, NaN where there is too little, the distance of two
    curves,
    one number of a curve, its unit, and the places (K,) and name of the curve's axis."""

    name: str
    curve: Callable[[Sums], np.ndarray | None]
    distance: Callable[[np.ndarray, np.ndarray], float]
    number: Callable[[np.ndarray], float]
    unit: str
    axis: np.ndarray
    along: str


@dataclass(frozen=True)
class PairedRow:
    """PairedRow of the table: a measure, its number of both clouds, their distance, the distances of halves
    (40 of each) and of lines, and why there is none."""

    measure: CloudMeasure
    first: float
    second: float
    distance: float
    halves: np.ndarray
    lines: np.ndarray
    why: str = ""

    @property
    def null(self) -> float:
        """95th percentile of halves."""
        return float(np.quantile(self.halves, LEVEL)) if len(self.halves) else float("nan")

    @property
    def verdict(self) -> str:
        """In a word."""
        if self.why or not np.isfinite(self.null):
            return self.why or "no null"
        return "agrees" if self.distance <= self.null else "does not agree"


def _ratio(above: str, below: str, least: float = FEWEST) -> Callable[[Sums], np.ndarray | None]:
    def curve(sums: Sums) -> np.ndarray | None:
        if above not in sums or below not in sums:
            return None
        enough = sums[below] >= least
        return np.where(enough, sums[above] / np.where(enough, sums[below], 1), np.nan)

    return curve


def _spread(name: str) -> Callable[[Sums], np.ndarray | None]:
    def curve(sums: Sums) -> np.ndarray | None:
        if name not in sums or sums[name].sum() < FEWEST:
            return None
        return np.asarray(sums[name] / sums[name].sum())

    return curve


def _shares(sums: Sums) -> np.ndarray | None:
    if "shares" not in sums:
        return None
    table = sums["shares"].reshape(ANGLES, MOST_RETURNS)
    pulses = table.sum(axis=1, keepdims=True)
    return np.where(pulses >= FEWEST, table / np.maximum(pulses, 1), np.nan).ravel()


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    """Mean difference of the classes that both have."""
    away = np.abs(a - b)
    return float(np.nanmean(away)) if np.isfinite(away).any() else float("nan")


def _not_shared(a: np.ndarray, b: np.ndarray) -> float:
    """Share of one distribution that is not the other's."""
    return float(1 - np.minimum(a, b).sum())


def _farthest(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance of the cumulated distributions (Kolmogorov-Smirnov)."""
    return float(np.abs(np.cumsum(a) - np.cumsum(b)).max())


def _middle(axis: np.ndarray) -> Callable[[np.ndarray], float]:
    def number(curve: np.ndarray) -> float:
        return float(np.interp(0.5, np.cumsum(curve), axis))

    return number


def _mean(curve: np.ndarray) -> float:
    return float(np.nanmean(curve)) if np.isfinite(curve).any() else float("nan")


def _single(curve: np.ndarray) -> float:
    return 100 * _mean(curve.reshape(ANGLES, MOST_RETURNS)[:, 0])


HEIGHT, ANGLE = np.arange(60) + 0.5, np.arange(ANGLES) * 5 + 2.5
MEASURES = (
    CloudMeasure(
        *("light that passes a voxel of 1 m", _ratio("passed", "voxels"), _apart, _mean),
        *("", HEIGHT, "height, m"),
    ),
    CloudMeasure(
        *("voxels of 1 m that 10 beams meet", _ratio("filled", "voxels"), _apart, _mean),
        *("", HEIGHT, "height, m"),
    ),
    CloudMeasure(
        *("profile of light", _spread("profile"), _not_shared, _middle(HEIGHT)),
        *("m, median", HEIGHT, "height, m"),
    ),
    CloudMeasure(
        *("light that reaches the ground", _ratio("gap", "sent"), _apart, _mean),
        *("", ANGLE, "off nadir, °"),
    ),
    CloudMeasure(
        *("pulses by returns and angle", _shares, _apart, _single),
        *("% single", np.repeat(ANGLE, MOST_RETURNS), "off nadir, °"),
    ),
    CloudMeasure(
        *("ranges", _spread("range"), _farthest, _middle(np.append(RANGES, RANGES[-1]))),
        *("m, median", np.append(RANGES, RANGES[-1]), "range, m"),
    ),
    CloudMeasure(
        *("intensity over single ones' median", _spread("level"), _farthest),
        *(_middle(np.append(LEVELS, 4.0)), "median", np.append(LEVELS, 4.0), "intensity"),
    ),
    CloudMeasure(
        *("gaps between returns of a pulse", _spread("apart"), _farthest),
        *(_middle(np.append(GAPS, 30.0)), "m, median", np.append(GAPS, 30.0), "gap, m"),
    ),
    CloudMeasure(
        *("light of 1 to 3 m that is on stems", _ratio("hits", "low"), _apart, _mean),
        *("", np.arange(12) * 2.5 + 1.25, "range, m"),
    ),
    CloudMeasure(
        *("residual of stems' circles", _ratio("residual", "stems", FEW_STEMS), _apart, _mean),
        *("mm", np.zeros(1), ""),
    ),
    CloudMeasure(
        *("arc of stems' circles", _ratio("arc", "stems", FEW_STEMS), _apart, _mean),
        *("", np.zeros(1), ""),
    ),
)


def compare_clouds(
    first: Path, second: Path, origins: tuple[np.ndarray | None, np.ndarray | None], seed: int
) -> tuple[list[PairedRow], list[MeasuredCloud]]:
    """Rows of the paired table of two LAS files, and both clouds.

    origins : (3,) where the scanner of each stood, None where pulses say it.

    Raises
    ------
    SpecError : one is no LAS file, or says no returns.
    """
    (one, one_lines), (two, two_lines) = (
        lines_in(path, origin) for path, origin in zip((first, second), origins, strict=True)
    )
    rng = stream(seed, "validate clouds")
    halved = [cloud.halves(rng) for cloud in (one, two) for _ in range(HALVINGS)]
    pairs = [
        (a.whole(), b.whole())
        for lines in (one_lines, two_lines)
        for a, b in combinations(lines, 2)
    ]
    rows = [_row(measure, (one, two), halved, pairs) for measure in MEASURES]
    return rows, [one, two]


def _row(
    measure: CloudMeasure,
    clouds: tuple[MeasuredCloud, MeasuredCloud],
    halved: list[tuple[dict, dict]],
    pairs: list[tuple[dict, dict]],
) -> PairedRow:
    curves = [measure.curve(cloud.whole()) for cloud in clouds]
    numbers = [float("nan") if curve is None else measure.number(curve) for curve in curves]
    missing = [
        cloud.name for cloud, number in zip(clouds, numbers, strict=True) if not np.isfinite(number)
    ]
    none = np.empty(0)
    if missing:
        why = f"too little of it in {' and '.join(missing)}"
        return PairedRow(measure, numbers[0], numbers[1], float("nan"), none, none, why)
    distance = measure.distance(curves[0], curves[1])  # type: ignore[arg-type]
    if not np.isfinite(distance):
        return PairedRow(
            *(measure, numbers[0], numbers[1], distance, none, none, "no class that both have")
        )
    nulls = [
        np.array([d for d in (_between(measure, *two) for two in some) if np.isfinite(d)])
        for some in (halved, pairs)
    ]
    return PairedRow(measure, numbers[0], numbers[1], distance, nulls[0], nulls[1])


def _between(measure: CloudMeasure, one: Sums, two: Sums) -> float:
    a, b = measure.curve(one), measure.curve(two)
    return float("nan") if a is None or b is None else measure.distance(a, b)


def table_text(rows: list[PairedRow], clouds: list[MeasuredCloud]) -> str:
    """The paired table in Markdown, and what could not be measured."""
    one, two = (cloud.name for cloud in clouds)
    lines = [
        f"| measure | {one} | {two} | distance | of halves | of lines | |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        unit = f", {row.measure.unit}" if row.measure.unit else ""
        halves = f"to {row.null:.3g}" if len(row.halves) else "-"
        beside = f"{row.lines.min():.3g} to {row.lines.max():.3g}" if len(row.lines) else "-"
        values = " | ".join(
            f"{v:.3g}" if np.isfinite(v) else "-" for v in (row.first, row.second, row.distance)
        )
        lines.append(
            f"| {row.measure.name}{unit} | {values} | {halves} | {beside} | {row.verdict} |"
        )
    said = [f"{cloud.name}: {words}." for cloud in clouds for words in cloud.said]
    return "\n".join([*lines, *([""] if said else []), *said]) + "\n"


def draw_pair(rows: list[PairedRow], clouds: list[MeasuredCloud], path: Path, seed: int) -> Path:
    """All curves of both clouds, and halves of the first in grey."""
    rng = stream(seed, "validate clouds picture")
    halved = [clouds[0].halves(rng) for _ in range(10)]
    some = [row for row in rows if len(row.measure.axis) > 1]
    figure = blank_figure((13, 6.4))
    for number, row in enumerate(some, 1):
        axes, measure = figure.add_subplot(2, 5, number), row.measure
        drawn = [(sums, FAINT, 0.6) for halves in halved for sums in halves]
        whole = [
            (cloud.whole(), c, 1.6) for cloud, c in zip(clouds, (INK, LEAF_GREEN), strict=True)
        ]
        ends = [0.0]
        for sums, colour, width in [*drawn, *whole]:
            curve = measure.curve(sums)
            if curve is None:
                continue
            axis = measure.axis
            if measure.curve is _shares:
                axis, curve = ANGLE, curve.reshape(ANGLES, MOST_RETURNS)[:, 0]
            axes.plot(axis, curve, color=colour, linewidth=width)
            rows_seen = np.flatnonzero(np.nan_to_num(curve) > 0)
            ends += axis[rows_seen].tolist()
        axes.set_title(f"{measure.name}\n{row.verdict}", fontsize=7)
        axes.set_xlabel(measure.along, fontsize=7)
        axes.tick_params(labelsize=6)
        low = min(ends[1:], default=0.0) if measure.name == "ranges" else 0.0
        axes.set_xlim(0.95 * low, 1.05 * max(ends) + 1e-6)
    figure.suptitle(
        f"{clouds[0].name} (black; its halves grey), {clouds[1].name} (green)", fontsize=9
    )
    return save_figure(figure, path)
