"""Trees that keep apart: the Strauss process (Strauss 1975), with γ = 0 a hard core.

Its density against a Poisson process is Π β(x_i) · γ^s, s the pairs nearer than R. It is drawn by births
and deaths (Geyer & Møller 1994) in cells at least R wide: cells of one of four colours do not see each
other, so all of a colour take a step at once, each by Metropolis's ratio with |cell| and its own trees.

Trees at the edge of the field would have no neighbours beyond it and be too many (3 % in a hectare), so the
process runs on around the field, with the intensity of the nearest place in it.

A planting says the mean intensity λ, not β. With G = (1 - γ)πR² and η = λG/4,

    log β = log λ + λG + (1 - γ) (S(η) - 4η),   S(η) = -log(1 - η) + (3η - 2η²)/(1 - η)².

λG is the Poisson-saddlepoint approximation (Baddeley & Nair 2012); S is that of hard discs by scaled
particle theory (Helfand, Frisch & Lebowitz 1961), weighted as the third virial coefficient is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..spec import Strauss
from .intensity.functions import IntensityError
from .process import Process

Activity = Callable[[np.ndarray], np.ndarray]
EDGE = 3.0  # radii around the field that are run too and cut off: trees at its edge have neighbours
SWEEPS = 100  # steps of each cell for each tree that it may hold
CLOSEST = 0.5  # η up to which the correction is known
DENSEST = 0.6  # λR² of a hard core above which births have no room (random packing: 0.70)
FAR = 1e150  # where a place of the table without a tree is
MOST_CELLS = 2_000_000
RIGHT, UP = np.repeat([0, 1, 2], 3), np.tile([0, 1, 2], 3)  # a cell and its neighbours in the table


def sample_strauss(process: Process, strauss: Strauss, rng: np.random.Generator) -> np.ndarray:
    """Points (N, 2) of the process on its field, whose mean intensity is about λ.

    Raises
    ------
    IntensityError : a hard core too wide for so many trees, or more cells than can be held.
    """
    highest = process.factor * float(
        process.intensity.bounds(process.low[None], process.high[None])[1][0]
    )
    if strauss.gamma == 0 and highest * strauss.radius**2 > DENSEST:
        raise IntensityError(
            f"{highest:g} trees/m² cannot keep {strauss.radius:g} m apart; lower the intensity or make "
            f"radius at most {np.sqrt(DENSEST / highest):.3g} m"
        )

    def activity(points: np.ndarray) -> np.ndarray:
        inside = np.clip(points, process.low, process.high)
        return activity_of(process.at(inside), strauss)

    mean = process.expected() / float(np.prod(process.high - process.low))
    edge = EDGE * strauss.radius
    trees = run_births_and_deaths(
        activity, mean, process.low - edge, process.high + edge, strauss, rng
    )
    return trees[((trees >= process.low) & (trees < process.high)).all(axis=1)]


def activity_of(intensity: np.ndarray, strauss: Strauss) -> np.ndarray:
    """(N,) β of a mean intensity λ (N,)."""
    saddle = (1 - strauss.gamma) * np.pi * strauss.radius**2 * intensity
    eta = np.minimum(saddle / 4, CLOSEST)
    discs = -np.log1p(-eta) + (3 * eta - 2 * eta**2) / (1 - eta) ** 2
    return np.asarray(intensity * np.exp(saddle + (1 - strauss.gamma) * (discs - 4 * eta)))


def run_births_and_deaths(
    activity: Activity,
    mean: float,
    low: np.ndarray,
    high: np.ndarray,
    strauss: Strauss,
    rng: np.random.Generator,
) -> np.ndarray:
    """Points (N, 2) of the Strauss process of this β on a rectangle.

    mean : about how many trees a square metre will hold; it says how long to run.
    """
    if mean <= 0:
        return np.empty((0, 2))
    side = max(strauss.radius, 1 / np.sqrt(mean))
    shape = np.maximum(np.floor((high - low) / side), 1).astype(int)
    if shape.prod() > MOST_CELLS:
        raise IntensityError(
            f"{shape.prod():,} cells are more than {MOST_CELLS:,}; make the field smaller"
        )
    table = _Table(low, (high - low) / shape, shape, strauss, activity)
    steps = int(np.ceil(SWEEPS * max(1.0, mean * float(np.prod((high - low) / shape)))))
    for _ in range(steps):
        for column in (0, 1):
            for row in (0, 1):
                column_of, row_of = np.mgrid[column : shape[0] : 2, row : shape[1] : 2]
                table.step(column_of.ravel(), row_of.ravel(), rng)
    return table.points()


class _Table:
    """Trees by cell: ``place`` (columns + 2, rows + 2, room, 2) and how many of them are there."""

    def __init__(
        self,
        low: np.ndarray,
        cell: np.ndarray,
        shape: np.ndarray,
        strauss: Strauss,
        activity: Activity,
    ) -> None:
        self.low, self.cell, self.area = low, cell, float(np.prod(cell))
        self.near, self.gamma, self.activity = strauss.radius**2, strauss.gamma, activity
        self.place = np.full((*(shape + 2), 8, 2), FAR)
        self.count = np.zeros(shape + 2, np.int64)

    def points(self) -> np.ndarray:
        """(N, 2) all trees."""
        there = np.arange(self.place.shape[2]) < self.count[:, :, None]
        return self.place[there]

    def step(self, column: np.ndarray, row: np.ndarray, rng: np.random.Generator) -> None:
        """A birth or a death in every one of these cells, of which no two are neighbours."""
        birth, chance = rng.random(len(column)) < 0.5, rng.random(len(column))
        self._bear(column[birth], row[birth], chance[birth], rng)
        some = ~birth & (self.count[column + 1, row + 1] > 0)
        self._fell(column[some], row[some], chance[some], rng)

    def _bear(
        self, column: np.ndarray, row: np.ndarray, chance: np.ndarray, rng: np.random.Generator
    ) -> None:
        born = self.low + (np.stack([column, row], axis=1) + rng.random((len(row), 2))) * self.cell
        count = self.count[column + 1, row + 1]
        ratio = self._density(born, column, row, 0) * self.area / (count + 1)
        take = chance < ratio
        column, row, born, count = column[take], row[take], born[take], count[take]
        if len(count) and count.max() >= self.place.shape[2]:
            more = np.full_like(self.place, FAR)
            self.place = np.concatenate([self.place, more], axis=2)
        self.place[column + 1, row + 1, count] = born
        self.count[column + 1, row + 1] += 1

    def _fell(
        self, column: np.ndarray, row: np.ndarray, chance: np.ndarray, rng: np.random.Generator
    ) -> None:
        count = self.count[column + 1, row + 1]
        which = (rng.random(len(count)) * count).astype(np.int64)
        tree = self.place[column + 1, row + 1, which]
        density = self._density(tree, column, row, 1) * self.area
        take = chance * density < count
        column, row, which, last = column[take] + 1, row[take] + 1, which[take], count[take] - 1
        self.place[column, row, which] = self.place[column, row, last]
        self.place[column, row, last] = FAR
        self.count[column, row] = last

    def _density(
        self, points: np.ndarray, column: np.ndarray, row: np.ndarray, itself: int
    ) -> np.ndarray:
        """β(x) γ^t of points (M, 2), t the others nearer than R."""
        most = int(self.count.max(initial=0))
        around = self.place[column[:, None] + RIGHT, row[:, None] + UP, :most]
        x, y = (around[..., axis] - points[:, None, None, axis] for axis in (0, 1))
        near = (x * x + y * y < self.near).sum(axis=(1, 2)) - itself
        return np.asarray(self.activity(points) * float(self.gamma) ** near)
