"""The leaves of one mesh, in blocks, and how loud a block of them can be.

A block of leaves has a table of bounds by the direction it is seen from, because leaves that face away
are hundreds of times weaker than leaves that face the sonar. Leaves near the sonar become faces (``near``).
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from ...acoustics.disc import amplitude_bound
from ...base.rows import lengths
from .discs import SIMILAR, FoliageDiscs
from .leaves import LeafEchoes
from .near import EDGE, NearEdges, near_faces, near_field, needs_face, subdued
from .scatterers import LEAF, Population, Scatterers, Sight, Views, cluster


def spiral(count: int) -> np.ndarray:
    """(count, 3) unit directions evenly over the upper hemisphere (Fibonacci's spiral)."""
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    side = np.sqrt(1.0 - z**2)
    return np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1)


SPREADS = np.array([0.08, 0.16, 0.32])  # radians between views of one block
VIEWS = spiral(96)  # of a block, one of each pair of opposite directions
BETWEEN = 0.23  # radians from any direction to the nearest of these, at most
RADII, STEPS = 8, 90  # classes of radii, steps of incidence


class LeafPopulation(Population):
    """The leaves of one mesh."""

    kind: ClassVar[str] = LEAF

    def __init__(self, foliage: FoliageDiscs, model: str) -> None:
        centre, _, radius = foliage.local
        self.blocks = cluster(centre, np.where(np.isfinite(radius), radius, np.nan))
        self._foliage, self._model = foliage, model
        self._largest = self.blocks.each(np.maximum, radius[self.blocks.order])
        self._tables: dict[tuple[float, float], np.ndarray] = {}

    @property
    def held(self) -> tuple[np.ndarray, np.ndarray]:
        order = self.blocks.order
        return self._foliage.local[0][order], self._foliage.leaf[order].astype(np.int64)

    def ceiling(self, views: Views, lowest: float, highest: float) -> np.ndarray:
        widened = np.sqrt(views.stretch[:, 0] * views.stretch[:, 1]) * self._largest[views.block]
        most = self.blocks.count[views.block] * amplitude_bound(
            lowest, highest, widened, np.zeros(1), self._model
        )
        scale = views.stretch[:, 0]
        alike = scale - views.stretch[:, 2] <= 2 * SIMILAR * scale
        spread = np.searchsorted(SPREADS, views.spread)
        known = np.flatnonzero(alike & (spread < len(SPREADS)))
        if len(known):
            # A bound grows with the radius at most as its square, and at least as its root.
            larger = np.maximum(scale[known] ** 2, np.sqrt(scale[known]))
            view = np.abs(views.direction[known] @ VIEWS.T).argmax(axis=1)
            table = self._directed(lowest, highest)
            some = larger * table[views.block[known], view, spread[known]]
            most[known] = np.minimum(most[known], some)
        # A near face is never louder than 1/r, and its rim adds what the edge does.
        near = near_field(views.nearest, widened, highest)
        face = self.blocks.count[views.block] * (views.nearest + EDGE * widened)
        return np.where(near, np.maximum(most, face), most)

    def _directed(self, lowest: float, highest: float) -> np.ndarray:
        """(B, V, S) bounds on Σ|f| of blocks that are seen from ``VIEWS``, give or take ``SPREADS``.

        Radii are rounded up to a few classes, incidences down to steps, and a bound is made to fall with
        the incidence, so that two look-ups a leaf and view do.
        """
        key = (lowest, highest)
        if key not in self._tables:
            _, normal, radius = (values[self.blocks.order] for values in self._foliage.local)
            radius = np.nan_to_num(radius, posinf=0.0)
            classes = np.quantile(radius, np.linspace(0.0, 1.0, RADII + 1)[1:])
            step = np.linspace(0.0, np.pi / 2, STEPS + 1)
            bound = amplitude_bound(lowest, highest, classes[:, None], step, self._model)
            bound = np.maximum.accumulate(bound[:, ::-1], axis=1)[:, ::-1].astype(np.float32)
            row = np.searchsorted(classes, radius)[:, None] * np.int64(STEPS + 1)
            cosine = np.abs(normal @ VIEWS.T)
            incidence = np.arccos(np.minimum(np.nan_to_num(cosine), 1.0)).astype(np.float32)
            tables = []
            for spread in SPREADS:
                place = np.maximum(incidence - np.float32(spread + BETWEEN), 0.0) * (
                    2 * STEPS / np.pi
                )
                some = bound.ravel().take(row + place.astype(np.int64))
                tables.append(np.add.reduceat(some, self.blocks.first[:-1], axis=0))
            self._tables[key] = 1.00001 * np.stack(tables, axis=-1)  # sums in single precision
        return self._tables[key]

    def scatterers(self, transform: np.ndarray, rows: np.ndarray, sight: Sight) -> list[Scatterers]:
        leaf = self.blocks.order[rows]
        centre, normal, radius = self._foliage.moved(transform, leaf)
        number = self._foliage.leaf[leaf].astype(np.int64)
        if sight.turns is not None:
            centre, normal = sight.turns(number, centre, normal)
        far = LeafEchoes(centre, number, normal, radius, np.ones(len(leaf)), self._model)
        if self._model == "paper":
            distance = lengths(centre - sight.point)
            return [replace(far, nearness=subdued(distance, radius, sight.wavenumber))]
        near = needs_face(far, sight)
        if not near.any():
            return [far]
        some = far.select(near)
        found: list[Scatterers] = [far.select(~near), near_faces(some, sight)]
        if self._model == "exact":
            found.append(NearEdges(**vars(some)))
        return found
