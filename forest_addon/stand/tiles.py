"""A forest in tiles: where each tile lies, which trees are its own, and which its scene needs.

Places, ages, spacing, competition and sizes are those of the whole field, drawn at once: they take some
hundred bytes a tree and depend on no tile. What takes memory by the tree (instances, their boxes in a ray
engine, leaves) is made for some rows of it at a time.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..growth.tree import Tree
from ..spec import Forest
from .forest import ForestPlan, GrownForest, keys_of
from .plan import Stand, labels

KEPT = 2_000_000_000  # bytes of grown variants that stay in memory
SLACK = 0.01  # metres that a tree may reach beyond what its mesh says, for rounding
Key = tuple[int, int]  # planting and variant


@dataclass(frozen=True)
class TileGrid:
    """Tiles of a field, half-open squares counted from its corner; the last of a row or column end with it.

    low, high : (2,) corners of the field, m. size : m. count : along x and y.
    """

    low: np.ndarray
    high: np.ndarray
    size: float
    count: tuple[int, int]

    @classmethod
    def of(cls, field: Forest, size: float) -> TileGrid:
        """The tiles of a field."""
        low = np.array(field.origin)
        across = np.maximum(np.ceil(np.array(field.size) / size - 1e-9), 1).astype(int)
        return cls(low, low + field.size, size, (int(across[0]), int(across[1])))

    def __len__(self) -> int:
        return self.count[0] * self.count[1]

    def tile_of(self, points: np.ndarray) -> np.ndarray:
        """(N,) number of the tile that points (N, 2) lie in; of what lies beyond the field the nearest."""
        place = np.floor((points - self.low) / self.size)
        column, row = np.clip(place, 0, np.array(self.count) - 1).astype(np.int64).T
        return np.asarray(row * self.count[0] + column)

    def corners(self, tile: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, 2), (N, 2) lowest and highest coordinates of tiles (N,)."""
        row, column = np.divmod(np.asarray(tile), self.count[0])
        low = self.low + self.size * np.stack([column, row], axis=-1)
        return low, np.minimum(low + self.size, np.maximum(self.high, low))

    def name(self, tile: int) -> str:
        """Return a tile's name: its column and row from the field's corner."""
        row, column = divmod(int(tile), self.count[0])
        return f"{column}-{row}"


class KeptTrees(Mapping[Key, Tree]):
    """The variants of a forest's plan, grown when they are asked for; the latest stay in memory."""

    def __init__(self, plan: ForestPlan) -> None:
        self._plan = plan
        self._keys = keys_of(plan.measured.stand)
        self._trees: OrderedDict[Key, Tree] = OrderedDict()
        self._bytes = 0

    def __getitem__(self, key: Key) -> Tree:
        if key not in self._trees:
            self._trees[key] = tree = self._plan.tree(*key)
            self._bytes += tree.nbytes
            while self._bytes > KEPT and len(self._trees) > 1:
                self._bytes -= self._trees.popitem(last=False)[1].nbytes
        self._trees.move_to_end(key)
        return self._trees[key]

    def __iter__(self) -> Iterator[Key]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)


class TiledForest:
    """A forest that is planned and has not grown but for its variants.

    stand : all trees, in their sizes, with their feet in the ground. reach : (N,) metres that a tree reaches
    to the sides of its foot. across : m, the largest distance between two points of one tree. low, high :
    lowest and highest coordinate z of any tree.
    """

    def __init__(self, plan: ForestPlan) -> None:
        self._plan = plan
        self.trees = KeptTrees(plan)
        self.stand = stand = plan.placed(self.trees)
        self.labels = tuple(labels(plan.scene.plantings))
        self.reach = np.zeros(len(stand))
        self.low, self.high, self.across = np.inf, -np.inf, 0.0
        for key, tree in self.trees.items():
            rows = np.flatnonzero((stand.species == key[0]) & (stand.variant == key[1]))
            corner = tree.mesh.vertices[np.isfinite(tree.mesh.vertices).all(axis=1)]
            if not len(corner):
                continue
            size = stand.scale[rows]
            self.reach[rows] = size * float(np.hypot(*corner[:, :2].T).max()) + SLACK
            ends = np.ptp(corner, axis=0)
            self.across = max(self.across, float(np.linalg.norm(ends) * size.max()))
            foot = stand.position[rows, 2] - stand.sink[rows]
            self.low = min(self.low, float((foot + size * corner[:, 2].min()).min()) - SLACK)
            self.high = max(self.high, float((foot + size * corner[:, 2].max()).max()) + SLACK)

    def near(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Rows of the trees of which any part may stand over a rectangle, m; crowns that reach in count."""
        place = self.stand.position[:, :2]
        aside = np.maximum(np.maximum(low - place, place - high), 0.0)
        return np.flatnonzero(np.hypot(*aside.T) <= self.reach)

    def part(self, rows: np.ndarray) -> GrownForest:
        """Some trees as a forest, with the numbers that they have in the whole."""
        whole, stand = self.whole, self.stand.select(rows)
        return replace(
            whole,
            stand=stand,
            variants={key: self.trees[key] for key in keys_of(stand)},
            wanted=None if whole.wanted is None else whole.wanted[rows],
        )

    @property
    def whole(self) -> GrownForest:
        """Return all trees as a forest, whose variants grow when they are asked for."""
        plan, measured = self._plan, self._plan.measured
        return GrownForest(
            stand=self.stand,
            labels=self.labels,
            species=tuple(species for species, _ in plan.species),
            variants=self.trees,
            wanted=measured.trees if measured.variants else None,
            laws=measured.laws,
        )

    def parts(self, at_once: int) -> Iterator[GrownForest]:
        """All trees, so many at a time."""
        for first in range(0, max(len(self.stand), 1), at_once):
            yield self.part(np.arange(first, min(first + at_once, len(self.stand))))


def numbers_in_scene(stand: Stand, as_points: bool) -> np.ndarray:
    """(N,) place of each tree among the trees of the scene of a whole forest: in order where each is an
    object, by variant where all are points of one.
    """
    if not as_points:
        return np.arange(len(stand))
    order = np.lexsort((np.arange(len(stand)), stand.variant, stand.species))
    place = np.empty(len(stand), dtype=np.int64)
    place[order] = np.arange(len(stand))
    return place
