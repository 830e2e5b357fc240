"""Branches, twigs and leaves as sound meets them: how much of what size at which height.

Meshes of a stand's trees go in; a ``Clutter`` goes out: metres of branch a cubic metre by radius and height,
square metres of leaf and of needle a cubic metre by height. A mesh tells its branches by its curvature:
an edge of length ℓ between faces that turn by δ belongs to ℓδ/2π metres of cylinder (Cohen-Steiner & Morvan
2003), of a radius that is the faces' area over ℓδ, along the edge. A shoot of needles is drawn as strips that
face all ways, fewer and wider than its needles, whose shadow is the shoot's.

Scatter by branches and leaves: what they take out of a sound and where they send it, by height.

A ``Clutter`` goes in; coefficients a metre and a phase function in space go out. A branch is a cylinder much
longer than the wave: sound that meets it at γ from its axis goes on along the cone of the same γ, turned
about the axis as at a trunk of size ka·sin γ (van de Hulst 1957, ch. 15); it is held against level sound at
the slopes that branches have, and looks all ways for sound that was scattered before. A leaf is a hard disc
that looks all ways: Rayleigh's cross-section (2k²a³/3π)²·4π/3·cos² below, half its area above, in between
the smaller; it scatters all ways alike. Lobes straight on, as large as the shadow, are no scattering.
Branches take what their bark takes, as trunks', and what the air at it takes (``twig_loss``). A leaf
takes what was measured of leaves, in which the air at them is held.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ....acoustics.cylinder import transfer
from ....acoustics.extinction import cross_sections
from ....acoustics.foliage import foliage_loss, shoot_width, twig_loss
from ....base.trimesh import LEAF, TriMesh, is_wood
from .transport import without_shadow

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

LAYER, FINE = 1.0, 0.25  # m of height; of a single tree
HIGHEST = 60.0  # m
CLASSES = 2.0 ** np.arange(-10.5, -3.0)  # m, edges between classes of radius: 0.7 mm to 9 cm
SHARPEST, FLATTEST = 2.4, 0.06  # radians between faces of a tube
STRIPS, FACED = 5, 0.5  # strips of a shoot at least; share of its area that may face one way
DRAWN = 0.86  # area of a shoot's strips over half its needles' surface; 0.73 to 1.02 in the presets
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
        return Rods(*_summed(self.radius, self.length, self.radius, self.height, self.rise))

    def placed(self, transform: np.ndarray) -> Rods:
        """The same of a tree that stands at ``transform`` (3, 4), upright and evenly scaled."""
        scale = _scale(transform)
        height = self.height * scale + float(transform[2, 3])
        return Rods(self.length * scale, self.radius * scale, height, self.rise)


@dataclass(frozen=True)
class Blades:
    """L leaves: area (L,) m² of one side, radius (L,) m of the equal disc, height (L,) m.

    shoot : (L,) m, root of the mean square distance of a shoot's needles from its middle; 0: a leaf.
    """

    area: np.ndarray
    radius: np.ndarray
    height: np.ndarray
    shoot: np.ndarray

    def summed(self) -> Blades:
        """The same in few pieces, of FINE metres of height each, leaves and shoots apart."""
        kind = np.where(self.shoot > 0, 2.0 * CLASSES[0], CLASSES[0])
        return Blades(*_summed(kind, self.area, self.radius, self.height, self.shoot))

    def placed(self, transform: np.ndarray) -> Blades:
        """The same of a tree that stands at ``transform`` (3, 4), upright and evenly scaled."""
        scale = _scale(transform)
        height = self.height * scale + float(transform[2, 3])
        return Blades(self.area * scale**2, self.radius * scale, height, self.shoot * scale)


def _summed(
    size: np.ndarray, amount: np.ndarray, radius: np.ndarray, height: np.ndarray, other: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Amount of N pieces in each layer of FINE metres and class of their size, and means of the rest."""
    low = float(height.min(initial=0.0))
    layer = np.floor((height - low) / FINE).astype(np.int64)
    rows = layer * (len(CLASSES) + 1) + np.searchsorted(CLASSES, size)
    whole = np.bincount(rows, amount)
    kept = whole > 0
    radius, height, other = (
        np.bincount(rows, amount * values)[kept] / whole[kept]
        for values in (radius, height - low, other)
    )
    return whole[kept], radius, height + low, other


def _scale(transform: np.ndarray) -> float:
    return abs(float(np.linalg.det(transform[:, :3]))) ** (1.0 / 3.0)


@dataclass(frozen=True)
class Clutter:
    """Layers of LAYER metres from the ground.

    radii : (K,) m. length : (Z, K) m of branch a m³. across : (K,) mean |sin| between level sound and branch.
    leaf_area : (Z,) m²/m³. leaf_radius : m, of the mean leaf by area.
    needle_area : (Z,) m²/m³, half the surface of needles. needle_radius : m. shoot_area : m² of it that a
    shoot has. shoot_spread : m, root of the mean square distance of its needles from its middle.
    """

    radii: tuple[float, ...] = ()
    length: tuple[tuple[float, ...], ...] = ()
    across: tuple[float, ...] = ()
    leaf_area: tuple[float, ...] = ()
    leaf_radius: float = 0.03
    needle_area: tuple[float, ...] = ()
    needle_radius: float = 0.0005
    shoot_area: float = 0.01
    shoot_spread: float = 0.03

    @property
    def empty(self) -> bool:
        """True if there is no branch, no leaf and no needle."""
        return not (np.any(self.length) or np.any(self.leaf_area) or np.any(self.needle_area))

    @property
    def top(self) -> float:
        """Metres of the highest layer's upper end."""
        return LAYER * self.layers

    @property
    def layers(self) -> int:
        """Number of them."""
        return max(len(self.length), len(self.leaf_area), len(self.needle_area))

    def without_leaves(self) -> Clutter:
        """The same with neither leaves nor needles."""
        return replace(
            self, leaf_area=(0.0,) * len(self.leaf_area), needle_area=(0.0,) * len(self.needle_area)
        )

    def on_floor(self, area: float) -> Clutter:
        """The same with so many m²/m² of leaves more in the lowest layer."""
        lowest = (self.leaf_area[0] if self.leaf_area else 0.0) + area / LAYER
        return replace(self, leaf_area=(lowest, *self.leaf_area[1:]))

    def filled(self, top: float) -> Clutter:
        """The same, with layers at least up to ``top`` metres."""
        count = max(int(np.ceil(top / LAYER)), self.layers, 1)
        return replace(
            self,
            length=_filled(self.length, count, (0.0,) * len(self.radii)),
            leaf_area=_filled(self.leaf_area, count, 0.0),
            needle_area=_filled(self.needle_area, count, 0.0),
        )


def _filled(layers: tuple, count: int, empty: object) -> tuple:
    return layers + (empty,) * (count - len(layers))


BARE = Clutter()


def clutter_of(rods: Iterable[Rods], blades: Iterable[Blades], area: float) -> Clutter:
    """Clutter of the trees on ``area`` m², each given in the world."""
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
    leaves, needles = np.zeros(layers), np.zeros(layers)
    of_leaf, of_shoot = 0.0, np.zeros(2)
    for some_leaves in blades:
        layer = np.floor(some_leaves.height / LAYER).astype(np.int64)
        kept = (layer >= 0) & (layer < layers)
        in_shoot = kept & (some_leaves.shoot > 0)
        kept &= ~in_shoot
        np.add.at(leaves, layer[kept], some_leaves.area[kept])
        of_leaf += float((some_leaves.area * some_leaves.radius)[kept].sum())
        half = some_leaves.area[in_shoot] / DRAWN
        np.add.at(needles, layer[in_shoot], half)
        each = math.pi * some_leaves.radius[in_shoot] ** 2 / DRAWN
        of_shoot += half @ np.column_stack([each, some_leaves.shoot[in_shoot]])
    whole = length.sum(axis=0)
    used = np.flatnonzero(whole > 0)
    last = np.flatnonzero(length.sum(axis=1) + leaves + needles)
    top = int(last[-1]) + 1 if len(last) else 0
    per_volume = 1.0 / (area * LAYER) if area > 0 else 0.0
    shoot = of_shoot / needles.sum() if needles.any() else (BARE.shoot_area, BARE.shoot_spread)
    return Clutter(
        tuple((volume[used] / whole[used]).tolist()),
        tuple(tuple(row) for row in (length[:top, used] * per_volume).tolist()),
        tuple((across[used] / whole[used]).tolist()),
        tuple((leaves[:top] * per_volume).tolist()),
        of_leaf / float(leaves.sum()) if leaves.any() else Clutter.leaf_radius,
        tuple((needles[:top] * per_volume).tolist()) if needles.any() else (),
        shoot_area=float(shoot[0]),
        shoot_spread=float(shoot[1]),
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
    """All leaves, each by its triangles, and shoots of needles."""
    rows = np.flatnonzero((mesh.part == LEAF) & (mesh.leaf >= 0))
    corners = mesh.vertices[mesh.triangles[rows]].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1)
    number = mesh.leaf[rows]
    count = int(number.max(initial=-1)) + 1

    def of_each(values: np.ndarray) -> np.ndarray:
        return np.column_stack([np.bincount(number, column, count) for column in values.T])

    of_leaf = np.bincount(number, area, count)
    safe = np.maximum(of_leaf, 1e-300)[:, None]
    centre = corners.mean(axis=1)
    middle = of_each(area[:, None] * centre) / safe
    square = of_each((area * np.square(centre - middle[number]).sum(axis=1))[:, None]) / safe
    square += of_each((area * np.square(corners - centre[:, None]).sum(axis=(1, 2)))[:, None]) / (
        12.0 * safe
    )
    kept = of_leaf > 0
    shoot = np.where(_is_shoot(mesh, rows, 0.5 * across, count), np.sqrt(square[:, 0]), 0.0)
    of_leaf, height = of_leaf[kept], middle[kept, 2]
    return Blades(of_leaf, np.sqrt(of_leaf / np.pi), height, shoot[kept])


def shoot_triangles(mesh: TriMesh) -> np.ndarray:
    """(T,) bool, which of a mesh's triangles are of shoots of needles."""
    rows = np.flatnonzero((mesh.part == LEAF) & (mesh.leaf >= 0))
    corners = mesh.vertices[mesh.triangles[rows]]
    facing = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    shoot = _is_shoot(mesh, rows, facing, int(mesh.leaf[rows].max(initial=-1)) + 1)
    is_shoot = np.zeros(len(mesh.triangles), bool)
    is_shoot[rows] = shoot[mesh.leaf[rows]]
    return is_shoot


def _is_shoot(mesh: TriMesh, rows: np.ndarray, facing: np.ndarray, count: int) -> np.ndarray:
    """(L,) bool: leaves of STRIPS strips and more, each of two triangles by itself, that face all ways.

    facing : (T, 3) m², of the triangles ``rows``.
    """
    number = mesh.leaf[rows]
    triangles = np.bincount(number, minlength=count)
    vertices = len(mesh.vertices)
    corner = np.repeat(number, 3).astype(np.int64) * vertices
    corner = np.unique(corner + mesh.triangles[rows].ravel().astype(np.int64))
    corners = np.bincount(corner // vertices, minlength=count)
    area = np.bincount(number, np.linalg.norm(facing, axis=1), count)
    whole = np.column_stack([np.bincount(number, column, count) for column in facing.T])
    apart = (triangles >= 2 * STRIPS) & (corners >= 2 * triangles)
    return np.asarray(apart & (np.linalg.norm(whole, axis=1) < FACED * area))


ANGLES = 90  # of the phase function, 0 to π
SLOPES, SCATTER_TURNS = 16, 360  # γ and turns about the axis, over which a branch is averaged
ALL_WAYS = 0.785  # mean |sin| to branches and needles that look all ways
THIN = 0.05  # ka, below which bark takes the same share of a branch's width
EDGE = 4.0  # of the smaller of two areas of a leaf
SPECTRUM = np.geomspace(1.0, 200e3, 140)  # Hz at which a level coefficient is computed


@dataclass(frozen=True)
class Takes:
    """Absorption by leaves and branches: what they take for good.

    leaf_absorption : G of ``acoustics/foliage``. bark : share of a wave head on that branches' bark takes.
    boundary : the air at branches takes some too.
    """

    leaf_absorption: float = 0.0
    bark: float = 0.0
    boundary: bool = False


@dataclass(frozen=True)
class Scatter:
    """Scattering by the clutter at one frequency.

    scattered, absorbed : (Z,) share of the energy a metre, in each layer of the clutter.
    density : (ANGLES,) scattered share per steradian by angle from straight on, mean over heights; its
    integral over the sphere is 1.
    """

    scattered: np.ndarray
    absorbed: np.ndarray
    density: np.ndarray


def scatter_of(clutter: Clutter, frequency: float, speed: float, takes: Takes) -> Scatter:
    """Scattering by branches and leaves at one frequency, Hz."""
    radii = np.array(clutter.radii)
    wood = np.zeros(len(clutter.length))
    lost = np.zeros(len(clutter.length))
    density = np.zeros(ANGLES)
    if len(radii):
        each = _widths(clutter, frequency, speed)
        wood = np.array(clutter.length) @ each
        lost = np.array(clutter.length) @ _taken(clutter, frequency, speed, takes)
        share = np.array(clutter.length).sum(axis=0) * each
        for radius, part in zip(radii, share, strict=True):
            if part > 1e-3 * share.sum():
                density += part * _turned(float(radius), frequency, speed)
    area = _to(np.array(clutter.leaf_area), clutter.layers)
    leaves = area * _leaf_width(clutter.leaf_radius, frequency, speed)
    density += leaves.sum() / (4.0 * math.pi)
    absorbed = area * 2.0 * foliage_loss(np.array([frequency]), 1.0, takes.leaf_absorption)[0]
    wood, lost = _to(wood, clutter.layers), _to(lost, clutter.layers)
    if np.any(clutter.needle_area):
        area = _to(np.array(clutter.needle_area), clutter.layers)
        alone, joint, taken, turned = _needles(clutter, frequency, speed, takes)
        wood, lost = wood + area * (alone + joint), lost + area * taken
        density += area.sum() * (alone * _turned(clutter.needle_radius, frequency, speed))
        density += area.sum() * joint * turned
    whole = wood.sum() + leaves.sum()
    return Scatter(
        wood + leaves,
        lost + absorbed,
        density / whole if whole > 0 else np.full(ANGLES, 0.25 / math.pi),
    )


def _to(layers: np.ndarray, count: int) -> np.ndarray:
    """(count,) of layers, those above are empty."""
    return np.pad(layers, (0, count - len(layers)))


def _needles(
    clutter: Clutter, frequency: float, speed: float, takes: Takes
) -> tuple[float, float, float, np.ndarray]:
    """Shares of half the needles' surface: each scatters, shoots do in phase, air at them takes.

    And (ANGLES,) per steradian of what is in phase.
    """
    radius = clutter.needle_radius
    metres = 1.0 / (math.pi * radius)  # of needle a m²
    size = max(2.0 * math.pi * frequency / speed * radius * ALL_WAYS, 1e-4)
    alone = metres * float(cross_sections(np.array([size])).energy[0]) * radius * ALL_WAYS
    given = clutter.shoot_area, radius, clutter.shoot_spread, frequency, speed
    joint, turned = shoot_width(*given, ANGLES)
    taken = 0.0
    if takes.boundary:
        taken = metres * float(twig_loss(np.array([radius]), frequency, speed)[0])
    return alone, joint, taken, turned


@lru_cache(maxsize=64)
def level_loss(clutter: Clutter, height: float, speed: float, takes: Takes) -> CubicSpline | None:
    """Nepers of amplitude a metre at a height: branches and needles take or scatter it, leaves scatter it.

    By log frequency; the values are logarithms. None where there is nothing.
    """
    layer = int(height)
    wood = np.array(clutter.length[layer]) if layer < len(clutter.length) else np.zeros(0)
    leaves = clutter.leaf_area[layer] if layer < len(clutter.leaf_area) else 0.0
    needles = clutter.needle_area[layer] if layer < len(clutter.needle_area) else 0.0
    if not wood.any() and leaves <= 0 and needles <= 0:
        return None
    loss = leaves * _leaf_widths(clutter.leaf_radius, speed)
    if len(wood):
        every = SPECTRUM[:, None]
        loss = loss + (_widths(clutter, every, speed) + _taken(clutter, every, speed, takes)) @ wood
    if needles > 0:
        of_needles = [sum(_needles(clutter, f, speed, takes)[:3]) for f in SPECTRUM.tolist()]
        loss = loss + needles * np.array(of_needles)
    from scipy.interpolate import CubicSpline  # here: other sensors need not wait for its import

    return CubicSpline(np.log(SPECTRUM), np.log(0.5 * np.maximum(loss, 1e-30)))


def leaf_loss(
    area: float, radius: float, frequency: np.ndarray, speed: float, absorption: float
) -> np.ndarray:
    """(F,) nepers of amplitude a metre that m²/m³ of leaves take and scatter away. absorption : G."""
    row = np.log(np.clip(frequency, SPECTRUM[0], SPECTRUM[-1]))
    width = np.interp(row, np.log(SPECTRUM), _leaf_widths(radius, speed))
    return np.asarray(0.5 * area * width + foliage_loss(frequency, area, absorption))


@lru_cache(maxsize=16)
def _leaf_widths(radius: float, speed: float) -> np.ndarray:
    return np.array([_leaf_width(radius, f, speed) for f in SPECTRUM.tolist()])


def _widths(clutter: Clutter, frequency: float | np.ndarray, speed: float) -> np.ndarray:
    """(..., K) m of width that a metre of branch scatters of level sound, at a frequency or (F, 1)."""
    radii, across = np.array(clutter.radii), np.array(clutter.across)
    size = np.maximum(2.0 * math.pi * frequency / speed * radii * across, 1e-4)
    return np.asarray(cross_sections(size.ravel()).energy.reshape(size.shape) * radii * across)


def _taken(
    clutter: Clutter, frequency: float | np.ndarray, speed: float, takes: Takes
) -> np.ndarray:
    """(..., K) m of width whose sound a metre of branch takes for good."""
    radii = np.array(clutter.radii)
    taken = np.zeros(np.broadcast_shapes(np.shape(frequency), radii.shape))
    if takes.bark > 0:
        across = np.array(clutter.across)
        size = np.maximum(2.0 * math.pi * frequency / speed * radii * across, THIN)
        whole = (
            1.0 + size**2
        ) / size**2  # trunks' bark fades out below ka = 1, where none is measured
        absorbed = cross_sections(size.ravel(), takes.bark).absorption.reshape(size.shape)
        taken += absorbed * whole * radii * across
    if takes.boundary:
        taken += twig_loss(radii, frequency, speed)
    return taken


def _leaf_width(radius: float, frequency: float, speed: float) -> float:
    """Share of a leaf's area by which it scatters, mean over all ways that it may look."""
    ka = 2.0 * math.pi * frequency / speed * radius
    small = 16.0 / 81.0 / math.pi**2 * ka**4  # (2k²a³/3π)²·4π/3·<cos²>/(πa²)
    return float((small**-EDGE + 0.5**-EDGE) ** (-1.0 / EDGE)) if ka > 1e-3 else 0.0


@lru_cache(maxsize=256)
def _turned(radius: float, frequency: float, speed: float) -> np.ndarray:
    """(ANGLES,) per steradian of a branch that looks all ways."""
    slope = (math.pi * (np.arange(SLOPES) + 0.5) / SLOPES)[: SLOPES // 2]
    turn = math.pi * (np.arange(SCATTER_TURNS) + 0.5) / SCATTER_TURNS
    size = radius * np.sin(slope)
    each = np.abs(transfer(frequency, turn[:, None], size, speed)) ** 2  # (SCATTER_TURNS, slopes)
    widths = cross_sections(2.0 * math.pi * frequency / speed * size)
    shadow = (widths.extinction - widths.energy) * size
    turned = np.zeros(ANGLES)
    for gamma, column, lobe in zip(slope.tolist(), each.T, shadow.tolist(), strict=True):
        weight = math.sin(gamma) ** 2 * without_shadow(column, lobe)
        cosine = math.cos(gamma) ** 2 + math.sin(gamma) ** 2 * np.cos(turn)
        row = np.minimum((np.arccos(np.clip(cosine, -1, 1)) * (ANGLES / math.pi)).astype(int), 89)
        turned += np.bincount(row, weight, ANGLES)
    edges = np.cos(np.linspace(0.0, math.pi, ANGLES + 1))
    turned /= 2.0 * math.pi * -np.diff(edges)
    return turned / (turned @ (2.0 * math.pi * -np.diff(edges)))
