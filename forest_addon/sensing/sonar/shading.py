"""Shading of an echo: wood as a hard edge, leaves as a haze or a shadow.

``BehindWood`` asks one ray a scatterer whether trunks, branches or ground stand before it.

``Extinction`` is what leaves take on the way. The directions around the sonar are cut into cells ``CELL``
wide; through each go N = ``shading_rays``² rays, from leaf to leaf. A leaf of radius a at the distance s
on the way to a place at d is set against the Fresnel zone there, F² = λ·s·(d - s)/d, q = (a/F)². A small
one (a few centimetres at a few metres) casts no shadow of its own: it takes its part of the mean number of
leaves that rays meet, the optical depth of Beer-Lambert (a point quadrat, Warren Wilson 1960: it takes the
projected area of the leaves as they are turned). A large one shades the rays that meet it and no others.
With both in proportion, each way leaves of the intensity

    mean over rays of e^{-Σq} · e^{-Σe^{-q}/N},

sums over the leaves that a ray and all rays of the cell met. Of leaves that stand at random that is
e^{-τ} whatever their size; of one opaque leaf before everything e^{-q}, next to nothing. Both ways leave as
much of the pressure. A leaf does not shade itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...base.rows import RowTable, distinct
from ...base.trimesh import TriMesh
from ..rays.caster import RayCaster
from .leaves import own_pieces
from .scatterers import LEAF
from .search import SearchGroup
from .station import Station

CELL = math.radians(4.0)
STEP = 1e-4  # m beyond a leaf from where a ray goes on
MOST_LEAVES = 64  # on one ray; nothing is heard behind
FARTHER = 1.25  # times what is asked for, that rays look ahead
PAIRS = 1 << 20  # of places and leaves before them, at once

Shade = Callable[[SearchGroup], np.ndarray]


def shade_of(
    wood: RayCaster | None, everything: RayCaster | None, station: Station
) -> Shade | None:
    """(M,) what is left of the pressure of a group, by what is given; None: all."""
    shades: list[Shade] = []
    if wood is not None:
        shades.append(BehindWood(wood, station.point))
    if everything is not None:
        shades.append(Extinction(everything, station))
    if not shades:
        return None
    return lambda group: np.prod([shade(group) for shade in shades], axis=0)


class BehindWood:
    """0 where wood hides a scatterer from a point (3,)."""

    def __init__(self, wood: RayCaster, point: np.ndarray) -> None:
        self._wood, self._point = wood, point

    def __call__(self, group: SearchGroup) -> np.ndarray:
        direction, distance = group.ways(self._point), group.paths.distance
        origins = np.broadcast_to(self._point, direction.shape)
        reach = np.maximum(distance - group.scatterers.clear, 0.0)
        return 1.0 - np.asarray(self._wood.occluded(origins, direction, reach), dtype=np.float64)


@dataclass(frozen=True)
class _Met(RowTable):
    """H leaves that rays of one cell met: distance, ray in the cell, radius (H,); instance and number."""

    distance: np.ndarray
    ray: np.ndarray
    radius: np.ndarray
    instance: np.ndarray
    leaf: np.ndarray


class Extinction:
    """The leaves around a sonar; cells are looked into when something is heard there."""

    def __init__(self, rays: RayCaster, station: Station) -> None:
        self._rays, self._station = rays, station
        self._side = station.sonar.shading_rays  # rays along each side of a cell
        self._wavelength = 4.0 * math.pi / sum(station.wavenumbers)
        self._leaves = [_leaf_radii(mesh) for mesh in rays.scene.meshes]
        linear = rays.scene.transform[:, :, :3]
        self._scale = np.abs(np.linalg.det(np.nan_to_num(linear))) ** (1 / 3)
        self._known: dict[tuple[int, int], tuple[float, _Met]] = {}

    def __call__(self, group: SearchGroup) -> np.ndarray:
        """(M,) of the pressure of a group."""
        owner = np.full((2, len(group)), -1)
        if group.scatterers.kind == LEAF:
            owner = np.stack([group.instance, group.scatterers.number])
        before = group.paths.distance - group.scatterers.clear
        return self.transmission(group.paths.offset[:, 0].T, before, owner)

    def transmission(
        self, offset: np.ndarray, distance: np.ndarray, owner: np.ndarray | None = None
    ) -> np.ndarray:
        """(M,) of the intensity that gets to places at offsets (2, M) off the axis, one way.

        owner : (2, M) instance and number of the leaf that is there and does not count; -1: none.
        """
        count = len(distance)
        owner = np.full((2, count), -1) if owner is None else owner
        cell = np.floor(offset.T / CELL).astype(np.int64)  # (M, 2)
        cells, of_place = np.unique(cell, axis=0, return_inverse=True)
        of_place = of_place.ravel()
        farthest = np.zeros(len(cells))
        np.maximum.at(farthest, of_place, distance)
        self._look(cells, farthest)
        left = np.ones(count)
        order = np.argsort(of_place, kind="stable")
        ends = np.searchsorted(of_place[order], np.arange(len(cells) + 1))
        for number, name in enumerate(map(tuple, cells.tolist())):
            met = self._known[name][1]
            rows = order[ends[number] : ends[number + 1]]
            if not len(met.distance):
                continue
            step = max(1, PAIRS // len(met.distance))
            for first in range(0, len(rows), step):
                some = rows[first : first + step]
                left[some] = self._through(met, distance[some], owner[:, some])
        return left

    def _through(self, met: _Met, distance: np.ndarray, owner: np.ndarray) -> np.ndarray:
        """(m,) of the intensity that passes the leaves of one cell."""
        before = met.distance < distance[:, None]  # (m, H)
        before &= (met.instance != owner[0][:, None]) | (met.leaf != owner[1][:, None])
        there = np.where(before, distance[:, None] - met.distance, np.inf)
        zone = self._wavelength * met.distance / np.maximum(distance[:, None], 1e-9) * there
        size = met.radius**2 / np.maximum(zone, 1e-12)
        haze = np.where(before, np.exp(-size), 0.0).sum(axis=1) / self._side**2
        block = np.where(before, size, 0.0) @ (met.ray[:, None] == np.arange(self._side**2))
        return np.asarray(np.exp(-block).mean(axis=1) * np.exp(-haze))

    def _look(self, cells: np.ndarray, farthest: np.ndarray) -> None:
        """Cast rays through cells that are not known as far as that."""
        reach = [self._known.get(tuple(c), (-1.0,))[0] for c in cells.tolist()]
        rows = np.flatnonzero(farthest > np.array(reach))
        if not len(rows):
            return
        ahead = np.minimum(FARTHER * farthest[rows], 1.01 * self._station.sonar.max_range)
        ahead = np.maximum(ahead, farthest[rows])
        met_leaves = self._meet(cells[rows], ahead)
        for number, row in enumerate(rows.tolist()):
            some = met_leaves[0] == number
            met = _Met(*(values[some] for values in met_leaves[1:]))
            self._known[tuple(cells[row].tolist())] = (float(ahead[number]), met)

    def _meet(self, cells: np.ndarray, farthest: np.ndarray) -> tuple[np.ndarray, ...]:
        """Every leaf that the rays of the cells meet: number of the cell, and the fields of ``_Met``."""
        inner = (np.arange(self._side) + 0.5) / self._side
        grid = np.stack(np.meshgrid(inner, inner, indexing="ij"), axis=-1).reshape(-1, 2)
        offset = (cells[:, None] + grid).reshape(-1, 2) * CELL
        ray_cell = np.repeat(np.arange(len(cells)), self._side**2)
        angle = np.hypot(*offset.T)
        side = offset * np.sinc(angle / math.pi)[:, None]
        forward, left, up = self._station.pose.frame
        way = (
            np.outer(np.cos(angle), forward) + np.outer(side[:, 0], left) + np.outer(side[:, 1], up)
        )

        travelled = np.zeros(len(way))
        alive = np.flatnonzero(angle < math.pi)
        scene = self._rays.scene
        columns: list[tuple[np.ndarray, ...]] = []
        for _ in range(MOST_LEAVES):
            if not len(alive):
                break
            origin = self._station.point + travelled[alive, None] * way[alive]
            hits = self._rays.cast(origin, way[alive], farthest[ray_cell[alive]] - travelled[alive])
            alive, hit = alive[hits.found], np.flatnonzero(hits.found)
            travelled[alive] += hits.distance[hit] + STEP
            instance, triangle = hits.instance[hit], hits.triangle[hit]
            mesh = scene.mesh_index[instance]
            number, radius = np.full(len(alive), -1), np.zeros(len(alive))
            for index in distinct(mesh).tolist():
                rows = mesh == index
                number[rows], radius[rows] = (v[triangle[rows]] for v in self._leaves[index])
            leaf = number >= 0
            ray = alive[leaf]
            radius = radius[leaf] * self._scale[instance[leaf]]
            distance = travelled[ray] - STEP
            columns.append(
                (ray_cell[ray], distance, ray % self._side**2, radius, instance[leaf], number[leaf])
            )
            alive = alive[travelled[alive] < farthest[ray_cell[alive]]]
        none = (np.empty(0, np.int64), np.empty(0), np.empty(0, np.int64), np.empty(0))
        columns.append((*none, np.empty(0, np.int64), np.empty(0, np.int64)))
        return tuple(np.concatenate(column) for column in zip(*columns, strict=True))


def _leaf_radii(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray]:
    """(T,) number of each triangle's leaf, -1 where it is none, and radius of the disc of its piece."""
    radius = np.zeros(len(mesh.triangles))
    facets = np.flatnonzero(mesh.leaf >= 0)
    if len(facets):
        facets = facets[np.argsort(mesh.leaf[facets], kind="stable")]
        owner, _ = own_pieces(mesh.leaf[facets], mesh.triangles[facets])
        corners = mesh.vertices[mesh.triangles[facets]]
        area = 0.5 * np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        radius[facets] = np.sqrt(np.bincount(owner, area)[owner] / math.pi)
    return mesh.leaf.astype(np.int64), radius
