"""Stems of a cloud and the circles that fit them: upright clusters from 1 to 3 m, six heights, two must
agree."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.special import gammaln

from forest_addon.api import SpecError

from ..inside import (
    FAINT,
    INK,
    LEAF_GREEN,
    blank_figure,
    lines_of,
    numbers,
    pulses_of,
    save_figure,
    split_lines,
    stream,
    write_whole,
)
from .own_cloud import CloudReturns, read_cloud
from .stems import taubin

SLICES = (1.0, 1.3, 1.6, 1.9, 2.2, 2.5)  # m, where circles are fitted
LOW, HIGH = 1.0, 3.0  # m
CELL, STEM_LAYERS, FILLED = (
    0.05,
    20,
    7,
)  # m; layers of a cell, and how many of them a stem has points in
HANG = 1.5  # cells between two of one stem
SECTORS = 24
RADII = (0.03, 0.5)  # m


def circle(xy: np.ndarray) -> np.ndarray | None:
    """x, y, radius, arc (share of 24 sectors), residual (m), share of points on it, share well inside it.

    None where too few points are on a circle of a stem's size. RANSAC, then least squares with soft L1.
    """
    rng, most, on = stream(0, "circle"), 0, None
    for _ in range(200):
        centre, radius = taubin(xy[rng.choice(len(xy), 3, replace=False)])
        if RADII[0] < radius < RADII[1]:
            away = np.abs(np.linalg.norm(xy - centre, axis=1) - radius)
            if (away < 0.015).sum() > most:
                most, on = int((away < 0.015).sum()), away < 0.03
    if on is None or on.sum() < 12:
        return None
    some = xy[on]
    centre, radius = taubin(some)

    def misfit(q: np.ndarray) -> np.ndarray:
        return np.asarray(np.hypot(some[:, 0] - q[0], some[:, 1] - q[1]) - q[2])

    x, y, r = least_squares(misfit, [*centre, radius], loss="soft_l1", f_scale=0.01).x
    angle = np.arctan2(some[:, 1] - y, some[:, 0] - x)
    arc = len(np.unique(((angle + np.pi) / (2 * np.pi) * SECTORS).astype(int))) / SECTORS
    inside = (np.hypot(xy[:, 0] - x, xy[:, 1] - y) < 0.6 * r).mean()
    return np.array([x, y, abs(r), arc, np.std(misfit(np.array([x, y, r]))), on.mean(), inside])


def stems_of(place: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(S, 5) x, y, radius, arc and residual of the stems of points (N, 3) at heights (N,) over ground."""
    band = (height > LOW) & (height < HIGH)
    p, h = place[band], height[band]
    cell, which = np.unique(np.floor(p[:, :2] / CELL).astype(int), axis=0, return_inverse=True)
    filled = np.zeros((len(cell), STEM_LAYERS), bool)
    layer = ((h - LOW) / (HIGH - LOW) * STEM_LAYERS).astype(int)
    filled[which.ravel(), np.clip(layer, 0, STEM_LAYERS - 1)] = True
    cell = cell[filled.sum(axis=1) >= FILLED]
    if not len(cell):
        return np.zeros((0, 5))
    pairs = cKDTree(cell).query_pairs(HANG, output_type="ndarray")
    joined = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(cell),) * 2)
    label = connected_components(joined, directed=False)[1]
    stems = []
    for group in range(label.max() + 1):
        stem = _stem(p, h, cell[label == group] * CELL + CELL / 2)
        if stem is not None:
            stems.append(stem)
    kept: list[np.ndarray] = []
    for stem in sorted(stems, key=lambda stem: -stem[5]):
        if all(np.hypot(*(stem[:2] - other[:2])) > 0.3 for other in kept):
            kept.append(stem)
    return np.array([stem[:5] for stem in kept]).reshape(-1, 5)


def _stem(p: np.ndarray, h: np.ndarray, cells: np.ndarray) -> np.ndarray | None:
    """x, y, radius, arc, residual, number of slices of a cluster; None where fewer than two agree."""
    reach = max(0.35, float(np.ptp(cells, axis=0).max()) / 2 + 0.15)
    near = np.hypot(*(p[:, :2] - cells.mean(axis=0)).T) < reach
    fits = []
    for z in SLICES:
        some = near & (np.abs(h - z) < 0.15)
        fit = circle(p[some, :2]) if some.sum() >= 15 else None
        if fit is not None and fit[3] >= 0.3 and fit[4] < 0.02 and fit[5] > 0.4 and fit[6] < 0.25:
            fits.append(fit)
    if len(fits) < 2:
        return None
    fitted = np.array(fits)
    middle = np.median(fitted[:, 2])
    fitted = fitted[np.abs(fitted[:, 2] - middle) < 0.35 * middle + 0.01]
    if len(fitted) < 2:
        return None
    whole = [*np.median(fitted[:, :3], axis=0), *fitted[:, 3:5].mean(axis=0), len(fitted)]
    return np.array(whole)


# Sums of a cloud by blocks of ground, of which measures are ratios, so that density drops out.
#
# Each return stands for 1/n of its pulse's light, n the pulse's returns, which came from the scanner in a
# straight
# line and ended there. So each voxel has light that entered and light that ended, each height its light,
# and so on.


BLOCK = 5.0  # m: side of the blocks that halves are drawn of
VOXEL, STEP = 1.0, 0.5  # m: edge, and step along a beam
LAYERS = 60  # of a metre
ANGLES = 18  # classes of 5 degrees from nadir (or zenith) on
MOST_RETURNS = 4
ENTERED, RARE = (
    10,
    10,
)  # returns that passed or ended in a voxel that counts; what occupancy is told for
GROUND = 0.5  # m
STEM_RANGES = 12  # classes of 2.5 m
MOST = 200_000  # returns that are traced through voxels
LEVELS = np.linspace(0, 4, 81)  # of intensity over the median of single returns
RANGES = np.exp(np.arange(0, 9, 0.02))  # m
GAPS = np.arange(0, 30.01, 0.05)  # m


@dataclass(frozen=True)
class GroundBlocks:
    """GroundBlocks of 5 m from the corner low (2,) m on, wide (2,) of them."""

    low: np.ndarray
    wide: np.ndarray

    @staticmethod
    def under(place: np.ndarray) -> GroundBlocks:
        """Heights of the ground under points (N, 3)."""
        low = np.floor(place.min(axis=0))[:2]
        return GroundBlocks(low, np.floor((place[:, :2].max(axis=0) - low) / BLOCK).astype(int) + 1)

    @property
    def count(self) -> int:
        """Number of blocks."""
        return int(self.wide.prod())

    def of(self, place: np.ndarray) -> np.ndarray:
        """(N,) block of points (N, 3)."""
        cell = np.floor((place[:, :2] - self.low) / BLOCK).astype(int)
        cell = np.clip(cell, 0, self.wide - 1)
        return np.asarray(cell[:, 0] * self.wide[1] + cell[:, 1])

    def table(
        self, where: np.ndarray, kind: np.ndarray, kinds: int, weight: np.ndarray
    ) -> np.ndarray:
        """(blocks, kinds) sums of weights (N,) by block and kind; a kind beyond is the last."""
        key = where * kinds + np.clip(kind, 0, kinds - 1)
        return np.bincount(key, weight, self.count * kinds).reshape(-1, kinds)


@dataclass(frozen=True)
class MeasuredCloud:
    """MeasuredCloud: its name, sums (blocks, ...) by name, and sentences about what could not be measured."""

    name: str
    sums: Mapping[str, np.ndarray]
    said: tuple[str, ...] = ()

    def halves(self, rng: np.random.Generator) -> tuple[dict, dict]:
        """Sums over a random half of the blocks with returns, and over the other half."""
        rows = np.flatnonzero(self.sums["profile"].any(axis=1))
        some = np.zeros(len(self.sums["profile"]), bool)
        some[rng.permutation(rows)[: len(rows) // 2]] = True
        return tuple(
            {name: values[part].sum(axis=0) for name, values in self.sums.items()}
            for part in (some, ~some)
        )  # type: ignore[return-value]

    def whole(self) -> dict[str, np.ndarray]:
        """Sums over all blocks."""
        return {name: values.sum(axis=0) for name, values in self.sums.items()}


def lines_in(path: Path, origin: np.ndarray | None) -> tuple[MeasuredCloud, list[MeasuredCloud]]:
    """A cloud of a LAS file as a whole, and by flight line where it has several of a tenth of its returns.

    origin : (3,) where the scanner stood; None: from the cloud's own pulses.

    Raises
    ------
    SpecError : it is no LAS file, or says no returns.
    """
    cloud = read_cloud(path)
    height = cloud.heights()
    start, line, said = _origins(cloud, origin)
    stems = stems_of(cloud.place, height)
    whole = MeasuredCloud(path.stem, _sums(cloud, height, start, stems), tuple(said))
    name, many = np.unique(line, return_counts=True)
    parts = []
    for number in name[many > 0.1 * len(line)].tolist():
        rows = np.flatnonzero(line == number)
        sums = _sums(cloud.take(rows), height[rows], start[rows], stems[:0])
        parts.append(MeasuredCloud(f"{path.stem}, line {number}", sums))
    return whole, parts if len(parts) > 1 else []


def _origins(
    cloud: CloudReturns, origin: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """(N, 3) where the scanner was for each return, NaN where nobody knows, (N,) its line, and words."""
    none = np.full((len(cloud.place), 3), np.nan)
    line = np.zeros(len(cloud.place), dtype=np.int64)
    if origin is not None:
        return np.broadcast_to(origin, none.shape), line, []
    if cloud.time is None or cloud.source is None or not np.ptp(cloud.time):
        return none, line, ["no GPS times: beams are not known, give --origin of a tripod"]
    line = split_lines(cloud.time, cloud.source)
    lines = lines_of(cloud.place, cloud.time, cloud.number, cloud.count, line)
    for number, flight in lines.items():
        rows = line == number
        none[rows] = flight.at(cloud.time[rows])
    lost = np.isnan(none[:, 0]).mean()
    words = [f"{lost:.1%} of the returns belong to lines without enough pulses of several returns"]
    return none, line, words if lost > 0.001 else []


def _sums(
    cloud: CloudReturns, height: np.ndarray, start: np.ndarray, stems: np.ndarray
) -> dict[str, np.ndarray]:
    blocks = GroundBlocks.under(cloud.place)
    table = blocks.table
    block, light = blocks.of(cloud.place), 1 / np.maximum(cloud.count, 1)
    layer = np.floor(height).astype(int)
    high, first = height > GROUND, cloud.number == 1
    sums = {"profile": table(block[high], layer[high], LAYERS, light[high])}
    away = np.linalg.norm(cloud.place - start, axis=1)
    known = np.isfinite(away)
    if known.any():
        with np.errstate(invalid="ignore"):
            lean = np.abs((start - cloud.place)[:, 2]) / away
        angle = np.degrees(np.arccos(np.clip(np.nan_to_num(lean), 0, 1))) // 5
        angle = angle.astype(int)
        sums["sent"] = table(block[known], angle[known], ANGLES, light[known])
        seen = known & ~high
        sums["gap"] = table(block[seen], angle[seen], ANGLES, light[seen])
        seen = known & first
        many = np.minimum(cloud.count, MOST_RETURNS) - 1
        kind = (angle * MOST_RETURNS + many)[seen]
        sums["shares"] = table(block[seen], kind, ANGLES * MOST_RETURNS, np.ones(seen.sum()))
        kind = np.searchsorted(RANGES, away[known])
        sums["range"] = table(block[known], kind, len(RANGES) + 1, light[known])
        sums |= _voxels(cloud, height, start, light, known, blocks)
    sums |= _echoes(cloud, blocks)
    sums |= _stems(cloud, height, away, stems, blocks)
    return sums


def gaps_of(place: np.ndarray, pulse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(G,) metres between neighbouring returns of a pulse, and (G,) the row of the farther one."""
    row = np.flatnonzero(np.diff(pulse) == 0) + 1
    return np.linalg.norm(place[row] - place[row - 1], axis=1), row


def _echoes(cloud: CloudReturns, blocks: GroundBlocks) -> dict[str, np.ndarray]:
    """Intensities over the median of single returns, and metres between returns of a pulse."""
    found, table, block = {}, blocks.table, blocks.of(cloud.place)
    single = cloud.count == 1
    if cloud.intensity is not None and single.any() and cloud.intensity.any():
        middle = max(float(np.median(cloud.intensity[single])), 1e-9)
        kind = np.searchsorted(LEVELS, cloud.intensity / middle)
        found["level"] = table(block, kind, len(LEVELS) + 1, np.ones(len(kind)))
    if cloud.time is not None and (cloud.count > 1).any():
        gap, row = gaps_of(cloud.place, pulses_of(cloud.time, cloud.number, cloud.count))
        kind = np.searchsorted(GAPS, gap)
        found["apart"] = table(block[row], kind, len(GAPS) + 1, np.ones(len(row)))
    return found


def _stems(
    cloud: CloudReturns,
    height: np.ndarray,
    away: np.ndarray,
    stems: np.ndarray,
    blocks: GroundBlocks,
) -> dict[str, np.ndarray]:
    """Light from 1 to 3 m, and of it on stems, by range; sums of residuals (mm), arcs and stems."""
    if not len(stems):
        return {}
    table, block = blocks.table, blocks.of(cloud.place)
    light = 1 / np.maximum(cloud.count, 1)
    band = np.flatnonzero((height > 1) & (height < 3))
    far, near = cKDTree(stems[:, :2]).query(cloud.place[band, :2])
    on = band[np.abs(far - stems[near, 2]) < 0.03]
    whose = cKDTree(cloud.place[:, :2]).query(stems[:, :2])[1]
    one = np.zeros(len(stems), dtype=int)
    tables = {
        "residual": table(block[whose], one, 1, 1000 * stems[:, 4]),
        "arc": table(block[whose], one, 1, stems[:, 3]),
        "stems": table(block[whose], one, 1, one + 1.0),
    }
    if np.isfinite(away).any():
        kind = np.nan_to_num(away / 2.5, nan=0).astype(int)
        for name, rows in (("low", band), ("hits", on)):
            tables[name] = table(block[rows], kind[rows], STEM_RANGES, light[rows])
    return tables


def _voxels(
    cloud: CloudReturns,
    height: np.ndarray,
    start: np.ndarray,
    light: np.ndarray,
    known: np.ndarray,
    blocks: GroundBlocks,
) -> dict[str, np.ndarray]:
    """Voxels by height: how many, sum of their transmittance, of their rarefied occupancy."""
    rows = np.flatnonzero(known)
    if len(rows) > MOST:
        rows = stream(0, "traced").permutation(rows)[:MOST]
    low = np.floor(cloud.place.min(axis=0))
    wide = np.floor((cloud.place.max(axis=0) - low) / VOXEL).astype(int) + 1
    entered, many = _traced(cloud.place[rows] - low, start[rows] - low, light[rows], wide)
    cell = _cell(cloud.place[rows] - low, wide)
    ended = np.bincount(cell, light[rows], wide.prod())
    hits = np.bincount(cell, minlength=wide.prod())
    counts = np.flatnonzero(many >= ENTERED)
    middle = (np.stack(np.unravel_index(counts, wide), axis=1) + 0.5) * VOXEL + low
    level = cloud.place[:, 2] - height
    near = cKDTree(cloud.place[:, :2]).query(middle[:, :2])[1]
    layer = np.floor(middle[:, 2] - level[near]).astype(int)
    inside = (layer >= 1) & (layer < LAYERS)
    counts, layer = counts[inside], layer[inside]
    key = blocks.of(middle[inside]) * LAYERS + layer
    share = 1 - ended[counts] / entered[counts]
    met = rarefied(many[counts], hits[counts], RARE)
    return {
        name: np.bincount(key, weight, blocks.count * LAYERS).reshape(-1, LAYERS)
        for name, weight in (("voxels", None), ("passed", share), ("filled", met))
    }


def rarefied(many: np.ndarray, hits: np.ndarray, few: int) -> np.ndarray:
    """Chance (V,) that ``few`` beams, drawn of ``many`` (V,) of which ``hits`` (V,) met something, meet some.

    Hurlbert (1971, Ecology 52, 577): unbiased for every number of beams that is at least ``few``.
    """
    left = np.maximum(many - hits, few)
    none = gammaln(left + 1.0) - gammaln(left - few + 1.0)
    none = none - gammaln(many + 1.0) + gammaln(many - few + 1.0)
    return np.where(many - hits >= few, 1 - np.exp(none), 1.0)


def _cell(place: np.ndarray, wide: np.ndarray) -> np.ndarray:
    cell = np.clip(np.floor(place / VOXEL).astype(int), 0, wide - 1)
    return np.asarray(np.ravel_multi_index(tuple(cell.T), tuple(wide)))


def _traced(
    place: np.ndarray, start: np.ndarray, light: np.ndarray, wide: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(V,) light and (V,) returns whose beams entered each voxel, steps of half a metre from the return
    back."""
    entered, many = np.zeros(wide.prod()), np.zeros(wide.prod(), dtype=np.int64)
    away = np.linalg.norm(start - place, axis=1)
    way = (start - place) / away[:, None]
    here, before = np.arange(len(place)), np.full(len(place), -1)
    step = 0.0
    while len(here):
        at = place[here] + step * way[here]
        within = ((at >= 0) & (at < wide * VOXEL)).all(axis=1) & (step <= away[here])
        here, at, before = here[within], at[within], before[within]
        cell = _cell(at, wide)
        fresh = cell != before
        entered += np.bincount(cell[fresh], light[here[fresh]], wide.prod())
        many += np.bincount(cell[fresh], minlength=wide.prod())
        before = cell
        step += STEP
    return entered, many


# Distances between two clouds, each beside the distance between halves and between flight lines of one.
#
# A measure is a curve, a ratio of sums (``sums``); a distance is a number of two curves, 0 where they are
# the same.
# What is real differs from itself: random halves of its blocks of ground, and its flight lines. A distance
# agrees
# that is not above the 95th percentile of 40 such halvings of either cloud.


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
        """The verdict in a word."""
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


# ``validate lidar A.laz B.laz``: the paired table and the picture of two clouds.


def hold_pair(
    subject: str, files: tuple[Path, Path], origins: list[str], chosen: argparse.Namespace
) -> None:
    """Hold a cloud to another; print the table, and keep it as pair.md beside pair.png in DIR/lidar.

    origins : "x,y,z" of the scanner of both clouds, or of each.

    Raises
    ------
    SpecError : another subject, more than two origins, or a cloud that cannot be read.
    """
    if subject != "lidar":
        raise SpecError("validate", f'two files go with lidar, not with "{subject}"')
    if chosen.scene or chosen.stand or chosen.docs:
        raise SpecError("validate", "two clouds go without --scene, --stand and --docs")
    if len(origins) > 2:
        raise SpecError("--origin", f"is given {len(origins)} times; give one for both, or two")
    places = [np.array(numbers("--origin", text, 3)) for text in origins] or [None]
    folder = chosen.out / "lidar"
    folder.mkdir(parents=True, exist_ok=True)
    rows, clouds = compare_clouds(*files, (places[0], places[-1]), chosen.seed)
    text = table_text(rows, clouds)
    write_whole(folder / "pair.md", text)
    drawn = draw_pair(rows, clouds, folder / "pair.png", chosen.seed)
    print(text)
    print(f"Wrote {folder / 'pair.md'} and {drawn}.")
