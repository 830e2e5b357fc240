"""Ground, rocks and walls as flat facets: a glint where one mirrors the sonar, and its rims.

Physical optics of a sound-hard facet for sound sent and heard at one point, at the height h over its
plane: p = (ik/2π)∫ (h/r³)·e^{-2ikr} dA. In polar coordinates about the point's foot the integral over r
is done, but for terms of 1/(2kr); what is left runs along the rim:

    p = [share of the turn about the foot]·e^{-2ikh}/(2h) − ∮ (h/4πr²)·e^{-2ikr} dφ.

So an endless plane gives its image source, a small facet its far field, and a large one needs no small
pieces. The rim is cut so that its phase is linear on a piece, which gives sinc(kΔr/2). A rim between two
triangles in one plane adds nothing and is left out. Meshes that are closed sound from outside alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ...base.trimesh import TriMesh, is_wood
from ...growth.own_tree.pieces import part
from .scatterers import FACET, Population, Scatterers, Sight, Strength, Views, cluster

FLAT = 1e-5  # sine of the angle between facets that are in one plane
RADIAL = 1e-9  # sine below which an edge runs through the foot
PIECE = 0.125  # of √(λr): the longest piece of a rim


@dataclass(frozen=True)
class RimStrength(Strength):
    """f = weight·sinc(k·slope); both (M,) metres. A glint has no slope."""

    weight: np.ndarray
    slope: np.ndarray

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        k = np.asarray(wavenumber)[:, None]
        return (self.weight * np.sinc(k * (self.slope / math.pi))).astype(np.complex128)

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        with np.errstate(divide="ignore"):
            lobes = 1.0 / (lowest * np.abs(self.slope))
        return np.abs(self.weight) * np.minimum(lobes, 1.0)

    def reach(self, wavenumber: float) -> np.ndarray:
        return np.abs(self.slope)


@dataclass(frozen=True)
class Rims(Scatterers):
    """Glints and pieces of rims, as one point sees them."""

    weight: np.ndarray
    slope: np.ndarray
    kind: ClassVar[str] = FACET

    def seen(self, point: np.ndarray) -> RimStrength:
        return RimStrength(self.weight, self.slope)


class FacetPopulation(Population):
    """The facets of one mesh that are neither leaf nor wood."""

    kind: ClassVar[str] = FACET

    def __init__(self, mesh: TriMesh) -> None:
        corners, rim, outward = _facets(mesh)
        middle = corners.mean(axis=1)
        extent = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1, initial=0.0)
        self.blocks = cluster(middle, extent)
        order = self.blocks.order
        self._corners, self._rim, self._outward = corners[order], rim[order], outward[order]

    @property
    def held(self) -> tuple[np.ndarray, np.ndarray]:
        return self._corners.mean(axis=1), np.full(len(self._corners), -1)

    def ceiling(self, views: Views, lowest: float, highest: float) -> np.ndarray:
        # |p|·r² of a facet: its glint h/2, and its rims (h/4π)·∫|dφ|, at most two turns.
        farthest = views.nearest + 2 * views.stretch[:, 0] * self.blocks.radius[views.block]
        return self.blocks.count[views.block] * farthest * 1.5

    def scatterers(self, transform: np.ndarray, rows: np.ndarray, sight: Sight) -> list[Scatterers]:
        corners = self._corners[rows] @ transform[:, :3].T + (transform[:, 3] - sight.point)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(normal, axis=1)
        sound = np.isfinite(area) & (area > 0)
        corners, normal = corners[sound], normal[sound] / area[sound, None]
        number, rim = self.blocks.order[rows][sound], self._rim[rows][sound]

        height = -np.einsum("mi,mi->m", corners[:, 0], normal)
        side = self._outward[rows][sound] * np.sign(np.linalg.det(transform[:, :3]))
        lit = (height * side > 0) | ((side == 0) & (height != 0))
        corners, normal, number, rim = corners[lit], normal[lit], number[lit], rim[lit]
        foot = -height[lit, None] * normal
        height = np.abs(height[lit])

        share = share_of_turn(corners, foot, normal)
        glint = (share > 0) & (height <= sight.reach)
        pieces = [glints(foot[glint], height[glint], share[glint], number[glint])]
        for corner in range(3):
            some = rim[:, corner]
            ends = corners[some][:, [corner, (corner + 1) % 3]]
            pieces.append(rims(ends, foot[some], normal[some], height[some], number[some], sight))
        found = Rims.joined(pieces)
        return [replace(found, centre=found.centre + sight.point)]


def _facets(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (F, 3, 3), which edges are rims (F, 3), and which side is outside (F,): 1 that of the
    normal, -1 the other, 0 both."""
    kept = (mesh.leaf < 0) & ~is_wood(mesh.part)
    triangles = mesh.triangles[kept]
    triangles = triangles[np.isfinite(mesh.vertices).all(axis=1)[triangles].all(axis=1)]
    if not len(triangles):
        return np.empty((0, 3, 3)), np.empty((0, 3), bool), np.empty(0)
    pieces = part(mesh.vertices[triangles])
    triangles, corners = pieces.triangles, pieces.vertices[pieces.triangles]
    normal = pieces.area_vectors()
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)

    start = triangles.astype(np.int64).ravel()
    end = np.roll(triangles, -1, axis=1).astype(np.int64).ravel()
    name = np.minimum(start, end) * len(pieces.vertices) + np.maximum(start, end)
    order = np.argsort(name, kind="stable")
    first = np.flatnonzero(np.diff(name[order], prepend=-1))
    size = np.diff(first, append=len(name))
    pair = first[size == 2]
    one, other = order[pair], order[pair + 1]
    cosine = np.einsum("pi,pi->p", normal[one // 3], normal[other // 3])
    against = start[one] == end[other]  # wound alike: the edge is walked both ways
    rim = np.ones(len(name), dtype=bool)
    bent = np.linalg.norm(np.cross(normal[one // 3], normal[other // 3]), axis=1) > FLAT
    flat = ~bent & (np.where(against, cosine, -cosine) > 0)
    rim[one[flat]] = rim[other[flat]] = False

    # Closed: every edge has two triangles, wound alike; the sign of the volume says where outside is.
    joined = np.zeros(len(name), dtype=bool)
    joined[one[against]] = joined[other[against]] = True
    piece = pieces.piece
    open_edges = np.bincount(np.repeat(piece, 3), ~joined, pieces.count)
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    volume = np.bincount(piece, volume, pieces.count)
    outward = np.where(open_edges == 0, np.sign(volume), 0.0)[piece]
    return corners, rim.reshape(-1, 3), outward


def _swing(a: np.ndarray, b: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(M,) angle from a to b about unit normals (all (M, 3)); 0 where a line through both meets 0."""
    sine, cosine = np.einsum("mi,mi->m", np.cross(a, b), normal), np.einsum("mi,mi->m", a, b)
    size = np.sqrt(np.einsum("mi,mi->m", a, a) * np.einsum("mi,mi->m", b, b))
    return np.where(np.abs(sine) <= RADIAL * size, 0.0, np.arctan2(sine, cosine))


def share_of_turn(corners: np.ndarray, foot: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(M,) of the turn about its foot that each polygon (M, C, 3) fills: 1 within, ½ on an edge, 0
    outside."""
    ends = corners - foot[:, None]
    following = np.roll(ends, -1, axis=1).reshape(-1, 3)
    turns = _swing(ends.reshape(-1, 3), following, np.repeat(normal, corners.shape[1], axis=0))
    share = turns.reshape(corners.shape[:2]).sum(axis=1) / (2.0 * math.pi)
    return np.where(share > 1e-6, share, 0.0)


def glints(foot: np.ndarray, height: np.ndarray, share: np.ndarray, number: np.ndarray) -> Rims:
    """A = share/2h, so that f = A·h² = share·h/2."""
    return Rims(foot, number, share * height / 2.0, np.zeros(len(height)))


def rims(
    ends: np.ndarray,
    foot: np.ndarray,
    normal: np.ndarray,
    height: np.ndarray,
    number: np.ndarray,
    sight: Sight,
) -> Rims:
    """Edges (M, 2, 3) that run anticlockwise about the normals, in pieces; f = −(hΔφ/4π)·sinc."""
    start, stop = _within(ends, sight.reach)
    span = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(span, axis=1) * (stop - start)
    middle = ends[:, 0] + ((start + stop) / 2)[:, None] * span
    nearest = np.maximum(np.linalg.norm(middle, axis=1) - length / 2, np.maximum(height, 1e-3))
    longest = PIECE * np.sqrt(2.0 * math.pi * nearest / sight.wavenumber)
    parts = np.where(stop > start, np.clip(np.ceil(length / longest), 1, 1 << 16), 0).astype(
        np.int64
    )
    row = np.repeat(np.arange(len(ends)), parts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)
    step = ((stop - start) / np.maximum(parts, 1))[row]
    low = ends[row, 0] + (start[row] + place * step)[:, None] * span[row]
    high = low + step[:, None] * span[row]

    swing = _swing(low - foot[row], high - foot[row], normal[row])
    near, far = np.linalg.norm(low, axis=1), np.linalg.norm(high, axis=1)
    centre = (low + high) / 2
    distance = np.linalg.norm(centre, axis=1)
    # The mean over φ of r² is h² and that of ρ², as ∫ρ²dφ is twice a triangle's area; less for a slope's r.
    swept = np.einsum("mi,mi->m", np.cross(low - foot[row], high - foot[row]), normal[row])
    square = distance**2
    wide = np.abs(swing) > RADIAL
    square[wide] = height[row][wide] ** 2 + swept[wide] / swing[wide]
    mean = np.sqrt(square) - (far - near) ** 2 / (24.0 * np.maximum(distance, 1e-30))
    centre *= (mean / np.maximum(distance, 1e-30))[:, None]
    return Rims(centre, number[row], -height[row] * swing / (4.0 * math.pi), far - near)


def _within(ends: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Shares (M,), (M,) along edges (M, 2, 3) between which they are within ``reach`` of the origin."""
    span = ends[:, 1] - ends[:, 0]
    a = np.maximum(np.einsum("mi,mi->m", span, span), 1e-30)
    b = np.einsum("mi,mi->m", span, ends[:, 0])
    c = np.einsum("mi,mi->m", ends[:, 0], ends[:, 0]) - reach**2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    met = b * b > a * c
    start, stop = np.clip((-b - root) / a, 0.0, 1.0), np.clip((-b + root) / a, 0.0, 1.0)
    return start, np.where(met, stop, start)
