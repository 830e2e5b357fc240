"""Branches, twigs and leaves as sound meets them: how much of what size at which height.

Meshes of a stand's trees go in; a ``Clutter`` goes out: metres of branch a cubic metre by
radius and height, square metres of leaf a cubic metre by height. A mesh tells its branches by its curvature:
an edge of length ℓ between faces that turn by δ belongs to ℓδ/2π metres of cylinder (Cohen-Steiner & Morvan
2003), of a radius that is the faces' area over ℓδ, along the edge.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ....base.trimesh import LEAF, TriMesh, is_wood

LAYER, FINE = 1.0, 0.25  # m of height; of a single tree
HIGHEST = 60.0  # m
CLASSES = 2.0 ** np.arange(-10.5, -3.0)  # m, edges between classes of radius: 0.7 mm to 9 cm
SHARPEST, FLATTEST = 2.4, 0.06  # radians between faces of a tube
TURNS = 16  # azimuths over which a branch's slope against level sound is averaged


@dataclass(frozen=True)
class Rods:
    """N pieces of branch: length, radius, height (N,) m, rise (N,) |sin| of the slope."""

    length: np.ndarray
    radius: np.ndarray
    height: np.ndarray
    rise: np.ndarray

    def summed(self) -> Rods:
        """The same in few pieces, of FINE metres of height and a class of radius each."""
        low, rows = _alike(self.height, self.radius)
        length = np.bincount(rows, self.length)
        kept = length > 0

        def mean(values: np.ndarray) -> np.ndarray:
            total: np.ndarray = np.bincount(rows, self.length * values)[kept] / length[kept]
            return total

        height = mean(self.height - low) + low
        return Rods(length[kept], mean(self.radius), height, mean(self.rise))

    def placed(self, transform: np.ndarray) -> Rods:
        """The same of a tree that stands at ``transform`` (3, 4), upright and evenly scaled."""
        scale = _scale(transform)
        height = self.height * scale + float(transform[2, 3])
        return Rods(self.length * scale, self.radius * scale, height, self.rise)


@dataclass(frozen=True)
class Blades:
    """L leaves: area (L,) m² of one side, radius (L,) m of the equal disc, height (L,) m."""

    area: np.ndarray
    radius: np.ndarray
    height: np.ndarray

    def summed(self) -> Blades:
        """The same in few pieces, of FINE metres of height each."""
        low, rows = _alike(self.height, np.full(len(self.height), CLASSES[0]))
        area = np.bincount(rows, self.area)
        kept = area > 0
        radius = np.bincount(rows, self.area * self.radius)[kept] / area[kept]
        height = np.bincount(rows, self.area * (self.height - low))[kept] / area[kept] + low
        return Blades(area[kept], radius, height)

    def placed(self, transform: np.ndarray) -> Blades:
        """The same of a tree that stands at ``transform`` (3, 4), upright and evenly scaled."""
        scale = _scale(transform)
        height = self.height * scale + float(transform[2, 3])
        return Blades(self.area * scale**2, self.radius * scale, height)


def _alike(height: np.ndarray, radius: np.ndarray) -> tuple[float, np.ndarray]:
    """Lowest height, and number (N,) of each piece's layer of FINE metres and class of radius."""
    low = float(height.min(initial=0.0))
    layer = np.floor((height - low) / FINE).astype(np.int64)
    return low, layer * (len(CLASSES) + 1) + np.searchsorted(CLASSES, radius)


def _scale(transform: np.ndarray) -> float:
    return abs(float(np.linalg.det(transform[:, :3]))) ** (1.0 / 3.0)


@dataclass(frozen=True)
class Clutter:
    """Layers of LAYER metres from the ground.

    radii : (K,) m. length : (Z, K) m of branch a m³. across : (K,) mean |sin| between level sound and branch.
    leaf_area : (Z,) m²/m³. leaf_radius : m, of the mean leaf by area.
    """

    radii: tuple[float, ...] = ()
    length: tuple[tuple[float, ...], ...] = ()
    across: tuple[float, ...] = ()
    leaf_area: tuple[float, ...] = ()
    leaf_radius: float = 0.03

    @property
    def empty(self) -> bool:
        """No branch and no leaf."""
        return not np.any(self.length) and not np.any(self.leaf_area)

    @property
    def top(self) -> float:
        """Metres of the highest layer's upper end."""
        return LAYER * max(len(self.length), len(self.leaf_area))

    def with_leaves(self, density: float) -> Clutter:
        """The same with so many m²/m³ of leaves in every layer."""
        count = max(len(self.length), len(self.leaf_area), 1)
        return replace(self, leaf_area=(density,) * count)

    def on_floor(self, area: float) -> Clutter:
        """The same with so many m²/m² of leaves more in the lowest layer."""
        lowest = (self.leaf_area[0] if self.leaf_area else 0.0) + area / LAYER
        return replace(self, leaf_area=(lowest, *self.leaf_area[1:]))

    def filled(self, top: float) -> Clutter:
        """The same, with layers at least up to ``top`` metres."""
        count = max(int(np.ceil(top / LAYER)), len(self.length), len(self.leaf_area), 1)
        empty = (0.0,) * len(self.radii)
        return replace(
            self,
            length=self.length + (empty,) * (count - len(self.length)),
            leaf_area=self.leaf_area + (0.0,) * (count - len(self.leaf_area)),
        )


BARE = Clutter()


def clutter_of(rods: Iterable[Rods], blades: Iterable[Blades], area: float) -> Clutter:
    """Of the trees on so many m², each given in the world."""
    layers = int(HIGHEST / LAYER)
    count = len(CLASSES) - 1
    length, volume = np.zeros((layers, count)), np.zeros(count)
    across = np.zeros(count)
    turn = np.cos(2.0 * np.pi * (np.arange(TURNS) + 0.5) / TURNS) ** 2
    for some in rods:
        size = np.searchsorted(CLASSES, some.radius) - 1
        layer = np.floor(some.height / LAYER).astype(np.int64)
        kept = (size >= 0) & (size < count) & (layer >= 0) & (layer < layers)
        np.add.at(length, (layer[kept], size[kept]), some.length[kept])
        np.add.at(volume, size[kept], (some.length * some.radius)[kept])
        level = np.sqrt(1.0 - np.outer(1.0 - some.rise[kept] ** 2, turn)).mean(axis=1)
        np.add.at(across, size[kept], some.length[kept] * level)
    leaves, leaf_radius = np.zeros(layers), 0.0
    for some_leaves in blades:
        layer = np.floor(some_leaves.height / LAYER).astype(np.int64)
        kept = (layer >= 0) & (layer < layers)
        np.add.at(leaves, layer[kept], some_leaves.area[kept])
        leaf_radius += float((some_leaves.area * some_leaves.radius)[kept].sum())
    whole = length.sum(axis=0)
    used = np.flatnonzero(whole > 0)
    last = np.flatnonzero(length.sum(axis=1) + leaves)
    top = int(last[-1]) + 1 if len(last) else 0
    per_volume = 1.0 / (area * LAYER) if area > 0 else 0.0
    return Clutter(
        tuple((volume[used] / whole[used]).tolist()),
        tuple(tuple(row) for row in (length[:top, used] * per_volume).tolist()),
        tuple((across[used] / whole[used]).tolist()),
        tuple((leaves[:top] * per_volume).tolist()),
        leaf_radius / float(leaves.sum()) if leaves.any() else Clutter.leaf_radius,
    )


def rods_of_mesh(mesh: TriMesh) -> Rods:
    """All wood but what is marked as trunk, by the mesh's curvature."""
    wood = is_wood(mesh.part)
    if mesh.order is not None:
        wood &= mesh.order > 0
    triangles = mesh.triangles[wood].astype(np.int64)
    points = mesh.vertices
    across = np.cross(
        points[triangles[:, 1]] - points[triangles[:, 0]],
        points[triangles[:, 2]] - points[triangles[:, 0]],
    )
    area = 0.5 * np.linalg.norm(across, axis=1)
    normal = across / np.maximum(2.0 * area, 1e-300)[:, None]
    corners = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    corners.sort(axis=1)
    key = corners[:, 0] * len(points) + corners[:, 1]
    order = np.argsort(key, kind="stable")
    pair = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    first, second = order[pair] % len(triangles), order[pair + 1] % len(triangles)
    turned = np.arccos(np.clip((normal[first] * normal[second]).sum(axis=1), -1.0, 1.0))
    kept = (turned > FLATTEST) & (turned < SHARPEST)
    ends = corners[order[pair[kept]]]
    way = points[ends[:, 1]] - points[ends[:, 0]]
    length = np.linalg.norm(way, axis=1)
    bent = length * turned[kept]
    return Rods(
        bent / (2.0 * np.pi),
        (area[first] + area[second])[kept] / np.maximum(bent, 1e-12),
        points[ends].mean(axis=1)[:, 2],
        np.abs(way[:, 2]) / np.maximum(length, 1e-12),
    )


def blades_of_mesh(mesh: TriMesh) -> Blades:
    """All leaves, each by its triangles."""
    rows = np.flatnonzero((mesh.part == LEAF) & (mesh.leaf >= 0))
    corners = mesh.vertices[mesh.triangles[rows]]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1)
    count = int(mesh.leaf[rows].max(initial=-1)) + 1
    of_leaf = np.bincount(mesh.leaf[rows], area, count)
    height = np.bincount(mesh.leaf[rows], area * corners.mean(axis=1)[:, 2], count)
    kept = of_leaf > 0
    of_leaf, height = of_leaf[kept], height[kept]
    return Blades(of_leaf, np.sqrt(of_leaf / np.pi), height / of_leaf)
