"""Sums of a cloud by blocks of ground, of which measures are ratios, so that density drops out.

Each return stands for 1/n of its pulse's light, n the pulse's returns, which came from the scanner in a
straight
line and ended there. So each voxel has light that entered and light that ended, each height its light,
and so on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import gammaln

from forest_addon.base.rng import stream
from forest_addon.sensing.lidar.surveys.flown import gaps_of, lines_of, pulses_of, split_lines

from ..own_cloud import CloudReturns, read_cloud
from .circles import stems_of

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
        """Those under points (N, 3)."""
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
    found = {"profile": table(block[high], layer[high], LAYERS, light[high])}
    away = np.linalg.norm(cloud.place - start, axis=1)
    known = np.isfinite(away)
    if known.any():
        with np.errstate(invalid="ignore"):
            lean = np.abs((start - cloud.place)[:, 2]) / away
        angle = np.degrees(np.arccos(np.clip(np.nan_to_num(lean), 0, 1))) // 5
        angle = angle.astype(int)
        found["sent"] = table(block[known], angle[known], ANGLES, light[known])
        seen = known & ~high
        found["gap"] = table(block[seen], angle[seen], ANGLES, light[seen])
        seen = known & first
        many = np.minimum(cloud.count, MOST_RETURNS) - 1
        kind = (angle * MOST_RETURNS + many)[seen]
        found["shares"] = table(block[seen], kind, ANGLES * MOST_RETURNS, np.ones(seen.sum()))
        kind = np.searchsorted(RANGES, away[known])
        found["range"] = table(block[known], kind, len(RANGES) + 1, light[known])
        found |= _voxels(cloud, height, start, light, known, blocks)
    found |= _echoes(cloud, blocks)
    found |= _stems(cloud, height, away, stems, blocks)
    return found


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
    found = {
        "residual": table(block[whose], one, 1, 1000 * stems[:, 4]),
        "arc": table(block[whose], one, 1, stems[:, 3]),
        "stems": table(block[whose], one, 1, one + 1.0),
    }
    if np.isfinite(away).any():
        kind = np.nan_to_num(away / 2.5, nan=0).astype(int)
        for name, rows in (("low", band), ("hits", on)):
            found[name] = table(block[rows], kind[rows], STEM_RANGES, light[rows])
    return found


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
