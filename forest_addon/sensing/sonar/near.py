"""Leaves within their near field, where a disc is no point: their faces, and what the models add.

Far off a disc sends back f/r² (``leaves``). Nearer than about 2ka² the waves from its middle and its rim
no longer arrive in step, and f/r² is too loud where it mirrors. There a leaf is a flat face and sounds as
``facets`` do, by Kirchhoff's integral at its true distance: the mirror's echo where the foot of the sonar
lies on it, and its rim. On its axis that is |p| = |sin(ka²/2r)|/r: never more than twice an endless mirror's
1/2r, which a disc of just one Fresnel zone reaches.

Domain: on the normal both level and phase hold; off it the level does (within 0.13 dB at 22° and
ka²/r = 4), but not the complex amplitude, which is up to 75 % off there. Sums over many such leaves keep
their energy; the interference of two of them is not to be trusted.

The exact disc differs from physical optics by what its edge adds; the difference stays at the leaf's centre,
times r²/(r² + a²), as edges are no nearer than √(r² + a²). The paper's fit has no near field: it is held
below 1/r by 1/√(1 + x²), x = ka²/2r, from where a face would take over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...acoustics.disc import backscatter_amplitude
from ...acoustics.disc_table import table_error
from .facets import PIECE, Rims, glints, rims, share_of_turn
from .leaves import EXACT_REACH, FAR, LeafEchoes
from .scatterers import LEAF, Sight, Strength

ASIDE = 6.0  # a/r: sine of the incidence from where two places of the rim sound
CLOSEST = 20.0  # radii within which all leaves are faces
CLOSE = 0.5  # ka² from where the near field is so that f/r² has no sense
CORNERS = (48, 1024)  # of the polygon that stands for a disc: at least, at most
EDGE = 1.05  # of a, no |f| of the exact disc less physical optics is larger


def near_field(distance: np.ndarray, radius: np.ndarray, wavenumber: float) -> np.ndarray:
    """(M,) bool: leaves that may be too near for f/r²."""
    return distance < FAR * wavenumber * radius**2


def needs_face(leaves: LeafEchoes, sight: Sight) -> np.ndarray:
    """(M,) bool: leaves that are too near for f/r² as they are turned.

    Well off its normal a disc sounds from two places of its rim, whose waves do not care how far the
    middle is: f/r² is right there but for 1/2·a/(r·sinβ) of each, until r is some radii.
    """
    distance = np.linalg.norm(leaves.centre - sight.point, axis=1)
    near = near_field(distance, leaves.radius, sight.wavenumber)
    near &= (distance <= sight.reach) & (distance >= sight.nearest)
    rows = np.flatnonzero(near)
    some, away = leaves.select(rows), distance[rows]
    mirrors = np.sin(some.incidence(sight.point)) < ASIDE * some.radius / away
    near[rows] = mirrors | (away < CLOSEST * some.radius)
    return near


def subdued(distance: np.ndarray, radius: np.ndarray, wavenumber: float) -> np.ndarray:
    """(M,) what the paper's fit is multiplied with; 1 far off."""
    x = wavenumber * radius**2 / (2.0 * np.maximum(distance, 1e-9))
    return (1.0 + np.maximum(x**2 - 1.0 / (2.0 * FAR) ** 2, 0.0)) ** -0.5


@dataclass(frozen=True)
class NearFaces(Rims):
    """Pieces of the faces of near leaves; see ``Rims``. close : (M,) bool, nearer than ka²/2."""

    close: np.ndarray
    kind: ClassVar[str] = LEAF

    def count(self, instance: np.ndarray, some: np.ndarray) -> int:
        return len(np.unique(np.stack([instance[some], self.number[some]]), axis=1).T)

    def count_close(self, instance: np.ndarray) -> int:
        return self.count(instance, self.close)


def near_faces(leaves: LeafEchoes, sight: Sight) -> NearFaces:
    """Discs as polygons of equal area, in pieces."""
    centre, normal = leaves.centre - sight.point, leaves.normal
    radius, number = leaves.radius, leaves.number
    height = np.einsum("mi,mi->m", centre, normal)
    normal = np.where(height > 0, -1.0, 1.0)[:, None] * normal  # towards the sonar
    height = np.abs(height)
    foot = -height[:, None] * normal
    turned = np.where(np.abs(normal[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(normal, turned)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(normal, across)
    nearest = np.maximum(np.linalg.norm(centre, axis=1) - radius, 1e-3)
    longest = PIECE * np.sqrt(2.0 * math.pi * nearest / sight.wavenumber)
    corners = np.clip(2.0 * math.pi * radius / longest, *CORNERS)
    corners = (16 * np.ceil(corners / 16)).astype(np.int64)
    pieces = []
    for count in np.unique(corners).tolist():
        some = corners == count
        angle = 2.0 * math.pi * np.arange(count) / count
        size = radius[some] * math.sqrt(2.0 * math.pi / (count * math.sin(2.0 * math.pi / count)))
        ring = (
            np.cos(angle)[:, None] * across[some, None] + np.sin(angle)[:, None] * along[some, None]
        )
        ring = centre[some, None] + size[:, None, None] * ring  # (m, count, 3)
        ends = np.stack([ring, np.roll(ring, -1, axis=1)], axis=2).reshape(-1, 2, 3)
        row = np.flatnonzero(some).repeat(count)
        pieces.append(rims(ends, foot[row], normal[row], height[row], number[row], sight))
        share = share_of_turn(ring, foot[some], normal[some])
        glint = share > 0
        pieces.append(
            glints(foot[some][glint], height[some][glint], share[glint], number[some][glint])
        )
    made = Rims.joined(pieces)
    close = number[np.linalg.norm(centre, axis=1) < CLOSE * sight.wavenumber * radius**2]
    return NearFaces(
        made.centre + sight.point, made.number, made.weight, made.slope, np.isin(made.number, close)
    )


@dataclass(frozen=True)
class EdgeStrength(Strength):
    """Part of the exact disc beyond physical optics; radius, incidence, share (M,)."""

    radius: np.ndarray
    incidence: np.ndarray
    share: np.ndarray

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        k = np.asarray(wavenumber)[:, None]
        ka = k * self.radius
        exact = backscatter_amplitude(ka, self.incidence, "exact")
        return self.share * (exact - backscatter_amplitude(ka, self.incidence, "piston")) / k

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        return EDGE * self.share * self.radius

    def reach(self, wavenumber: float) -> np.ndarray:
        return EXACT_REACH * self.radius

    def error(self, highest: float) -> np.ndarray:
        return self.share * self.radius * table_error(highest * self.radius, self.incidence)


@dataclass(frozen=True)
class NearEdges(LeafEchoes):
    """Near leaves without what their faces sound like; these count."""

    def count(self, instance: np.ndarray, some: np.ndarray) -> int:
        return 0

    def seen(self, point: np.ndarray) -> Strength:
        distance = np.linalg.norm(self.centre - point, axis=1)
        share = distance**2 / (distance**2 + self.radius**2)
        return EdgeStrength(self.radius, self.incidence(point), share)
