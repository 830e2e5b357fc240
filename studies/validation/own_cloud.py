"""A cloud of the user's own against those of a scene's scanners: returns of a pulse, heights over ground.

Judged is only what the file says: without numbers of returns it is refused, and shares of a file with one
return a pulse are not judged. Both clouds are cut to the scene's field, and heights are over the ground of
each. A share agrees within a tenth of itself and what chance makes of so many pulses.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from forest_addon.api import Scene, SpecError

from ..inside import read_las
from .run import Comparison, Interval

MOST = 4  # returns that are told apart
RELATIVE = 0.1  # of a share or a height, that counts as the same
CHANCE = 3.0  # standard errors
CELL = 2.0  # m, in which the lowest point is of the ground
GROUND = 2  # class of LAS
FEWEST = 100  # pulses that a share is told of


@dataclass(frozen=True)
class CloudReturns:
    """CloudReturns of a cloud: place (N, 3) m, number (N,) of its pulse's, how many that pulse had, ground
    (N,) bool, whether it is classed so; where it is known time (N,) s, source (N,), the number of the flight
    line, and intensity (N,) in the instrument's numbers."""

    place: np.ndarray
    number: np.ndarray
    count: np.ndarray
    ground: np.ndarray
    time: np.ndarray | None = None
    source: np.ndarray | None = None
    intensity: np.ndarray | None = None

    def within(self, low: np.ndarray, high: np.ndarray) -> CloudReturns:
        """Points over a rectangle."""
        rows = ((self.place[:, :2] >= low) & (self.place[:, :2] <= high)).all(axis=1)
        return self.take(rows)

    def take(self, rows: np.ndarray) -> CloudReturns:
        """Points of these rows, numbers or bool."""
        values = (getattr(self, name) for name in CloudReturns.__dataclass_fields__)
        return CloudReturns(*(None if value is None else value[rows] for value in values))

    def shares(self) -> tuple[np.ndarray, int]:
        """(4,) shares of pulses with 1, 2, 3 and 4 returns, and of how many pulses."""
        first = self.count[self.number == 1]
        return np.bincount(np.minimum(first, 15), minlength=16)[1 : MOST + 1] / max(
            len(first), 1
        ), len(first)

    def heights(self) -> np.ndarray:
        """(N,) m over the ground: over what is classed as ground, else over the lowest point of each cell."""
        some = self.place[self.ground] if self.ground.any() else self.place
        cell = np.floor(some[:, :2] / CELL).astype(np.int64)
        order = np.lexsort((some[:, 2], cell[:, 1], cell[:, 0]))
        first = np.ones(len(order), bool)
        first[1:] = (np.diff(cell[order], axis=0) != 0).any(axis=1)
        lowest = some[order[first]]
        away, near = cKDTree(lowest[:, :2]).query(self.place[:, :2], k=min(3, len(lowest)))
        weight = 1.0 / np.maximum(np.reshape(away, (len(self.place), -1)), 1e-3)
        level = lowest[np.reshape(near, (len(self.place), -1)), 2]
        return self.place[:, 2] - (weight * level).sum(axis=1) / weight.sum(axis=1)


def read_cloud(path: Path) -> CloudReturns:
    """The returns of a LAS file.

    Raises
    ------
    SpecError : it is no LAS or LAZ file, has no points, or does not say which return of how many each is.
    """
    cloud = read_las(path)
    number, count = np.asarray(cloud.return_number), np.asarray(cloud.number_of_returns)
    if not (number > 0).any() or not (count > 0).any():
        raise SpecError(
            str(path), "does not say which return of how many each point is; export it with these"
        )
    names = set(cloud.point_format.dimension_names)
    return CloudReturns(
        np.asarray(cloud.xyz),
        number,
        count,
        np.asarray(cloud.classification) == GROUND,
        np.asarray(cloud.gps_time) if "gps_time" in names else None,
        np.asarray(cloud.point_source_id),
        np.asarray(cloud.intensity, float),
    )


def compare_own(file: Path, scene: Path | None) -> list[Comparison]:
    """Compare a cloud with the clouds of a scene's scanners.

    Raises
    ------
    SpecError : no scene was given, it has no scanner, or the cloud cannot be read.
    """
    from forest_addon import api

    if scene is None:
        raise SpecError("--scene", "is needed beside a cloud; give the scene file that it is of")
    measured = read_cloud(file)
    settings = api.read(scene)
    scanners = [s for s in settings.sensors if hasattr(s, "scanner")]
    if not scanners:
        raise SpecError(str(scene), "has no LiDAR; add one under [[sensors]]")
    world = api.build(settings, folder=scene.parent)
    low, high = _field(settings)
    shift = np.array(settings.offset)
    theirs = measured.within(low + shift[:2], high + shift[:2])
    over = "Both over the scene's field." if len(theirs.place) else NOT_THERE
    theirs = theirs if len(theirs.place) else measured
    rows = []
    for scanner in scanners:
        cloud = world.scan(scanner).found
        whole = CloudReturns(cloud.position, cloud.number, cloud.count, cloud.returns.organ == 3)
        rows += _compared(scanner.name, theirs, whole.within(low, high), over)
    return rows


NOT_THERE = (
    "The file has no point over the scene's field (its offset added), so all of it is compared."
)


def _field(settings: Scene) -> tuple[np.ndarray, np.ndarray]:
    low = np.array(settings.forest.origin)
    return low, low + settings.forest.size


def _compared(name: str, theirs: CloudReturns, ours: CloudReturns, over: str) -> list[Comparison]:
    """Rows of one scanner."""
    (measured, pulses), (mine, sent) = theirs.shares(), ours.shares()
    single = bool((theirs.count <= 1).all())
    few = min(pulses, sent) < FEWEST
    words = over
    if single:
        words += " The file has one return a pulse, by its instrument or its export: shares are not judged."
    if few:
        words += f" There are {min(pulses, sent):,} pulses only: shares are not judged."
    rows = []
    for number in range(MOST):
        p, q = float(measured[number]), float(mine[number])
        error = CHANCE * np.sqrt(p * (1 - p) / max(pulses, 1) + q * (1 - q) / max(sent, 1))
        agrees = abs(p - q) <= RELATIVE * max(p, q) + error
        rows.append(
            Comparison(
                f"{name}, pulses with {number + 1} returns",
                "%",
                Interval(100 * p),
                Interval(100 * q),
                None if single or few else bool(agrees),
                words=words if not number else "",
            )
        )
    if len(theirs.place) and len(ours.place):
        tall = [returns.heights() for returns in (theirs, ours)]
        for share in (0.5, 0.95):
            high = [float(np.quantile(heights, share)) for heights in tall]
            near = abs(high[0] - high[1]) <= RELATIVE * max(map(abs, high)) + 0.1
            label = f"{name}, {share:.0%} of returns lie lower, over ground"
            rows.append(Comparison(label, "m", Interval(high[0]), Interval(high[1]), bool(near)))
    return rows
