"""A shoot of needles as one blade: few large facets whose mean shadow is that of all its needles.

A needle is a cylinder; its mean shadow over all directions, πld/4, is that of a flat strip l·(πd/2), which is
half of its surface. Needles of a shoot shade each other: the mean shadow of the whole shoot is smaller than
the sum by the clumping factor 4·STAR (Oker-Blom & Smolander 1988). It is found here by drawing the shoot
from directions spread over the sphere. A shoot of fewer facets has them so wide that its mean shadow is the
same, to a thousandth of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...spec import Needles
from ..draw import GOLDEN
from ..mesh.blades import Blade

DIRECTIONS, PIXELS = 16, 256
CLOSELY = 150, 128  # directions and pixels
BARE = 0.06  # of a shoot's foot without needles
APART = 0.12  # radians between a needle and the middle of its fascicle


@dataclass(frozen=True, eq=False)
class Shoot(Blade):
    """A blade that stands for needles.

    needle_area : of all its needles, half their surface, over the square of the shoot's length.
    shadow : mean over all directions, over the square of the shoot's length.
    """

    needle_area: float = 0.0
    shadow: float = 0.0

    @property
    def by_facets(self) -> bool:
        """No: they are as wide as their shadow wants."""
        return False

    @property
    def share(self) -> float:  # type: ignore[override]
        """One-sided needle area over length times width."""
        return self.needle_area

    @property
    def clumping(self) -> float:
        """Shadow over that of the same needles apart, 4·STAR."""
        return 2 * self.shadow / self.needle_area


@lru_cache(maxsize=32)
def shoot_of(needles: Needles, length: float) -> Shoot:
    """The blade of a shoot of this length, metres, in its unit frame (width = length)."""
    reach, wide = needles.length / length, np.pi / 2 * needles.diameter / length
    area = needles.count * reach * wide
    full = _strips(needles.count, reach, wide, needles)
    shadow = mean_shadow(*full)
    count = needles.blades
    if not count or count >= needles.count:
        return Shoot(*full, area, shadow)
    width = (
        wide * needles.count / count * shadow / (area / 2)
    )  # as if they hid nothing of each other
    for _ in range(4):
        found = mean_shadow(*_strips(count, reach, width, needles))
        width *= (shadow / found) ** 1.2
    return Shoot(*_strips(count, reach, width, needles), area, shadow)


@lru_cache(maxsize=32)
def coarse_shoot(needles: Needles, length: float, blades: int) -> Shoot:
    """A shoot of fewer blades in place of ``shoot_of``: the same needles, and the same mean shadow.

    Few blades hide much more from some sides than from others, so that both are seen from many.
    """
    fine = shoot_of(needles, length)
    wanted = mean_shadow(fine.vertices, fine.triangles, *CLOSELY)
    reach = needles.length / length
    width = np.pi / 2 * needles.diameter / length * needles.count / blades
    for _ in range(6):
        strips = _strips(blades, reach, width, needles)
        width *= (wanted / mean_shadow(*strips, *CLOSELY)) ** 1.2
    return Shoot(*_strips(blades, reach, width, needles), fine.needle_area, fine.shadow)


def mean_shadow(
    vertices: np.ndarray,
    triangles: np.ndarray,
    directions: int = DIRECTIONS,
    pixels: int = PIXELS,
) -> float:
    """Mean over directions of the area that triangles hide, by drawing them."""
    total = 0.0
    k = np.arange(directions) + 0.5
    z, azimuth = 1 - k / directions, GOLDEN * k  # half a sphere: both ways hide the same
    for dz, turn in zip(z, azimuth, strict=True):
        flat = np.sqrt(1 - dz * dz)
        right = np.array([-np.sin(turn), np.cos(turn), 0.0])
        up = np.array([-dz * np.cos(turn), -dz * np.sin(turn), flat])
        seen = np.stack([vertices @ right, vertices @ up], axis=1)
        low, size = seen.min(axis=0), float(np.ptp(seen, axis=0).max())
        last = pixels - 1
        drawn = _drawn((seen - low) / size * last, triangles, pixels)
        total += drawn * (size / last) ** 2
    return total / directions


def _drawn(corners: np.ndarray, triangles: np.ndarray, pixels: int) -> float:
    """Pixels whose middle lies in any of the triangles."""
    picture = np.zeros((pixels, pixels), dtype=bool)
    corner = corners[triangles]
    low = np.floor(corner.min(axis=1)).astype(int).tolist()
    high = (np.ceil(corner.max(axis=1)).astype(int) + 1).tolist()
    place = np.arange(pixels + 1)
    for (x0, y0), (x1, y1), (a, b, c) in zip(low, high, corner.tolist(), strict=True):
        x, y = place[x0:x1], place[y0:y1, None]
        first, second, third = (
            (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
            for p, q in ((a, b), (b, c), (c, a))
        )
        inside = np.minimum(np.minimum(first, second), third) >= 0
        inside |= np.maximum(np.maximum(first, second), third) <= 0
        picture[y0:y1, x0:x1] |= inside
    return float(picture.sum())


def _strips(
    count: int, reach: float, wide: float, needles: Needles
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of needles around x from 0 to 1: narrow kites, each turned about itself.

    Those of a fascicle spring from one place and lean apart. They stand along all of the shoot, so that the
    last stand out beyond its end.
    """
    k, angle = np.arange(count), np.deg2rad(needles.angle_deg)
    bundle, of_bundle = np.divmod(k, needles.together)
    bundles = -(-count // needles.together)
    along = BARE + (1 - BARE) * (bundle + 0.5) / bundles
    azimuth, lean = GOLDEN * bundle, angle * (1 - 0.5 * (bundle / bundles) ** 3)
    radial = np.stack([np.zeros(count), np.cos(azimuth), np.sin(azimuth)], axis=1)
    way = np.cos(lean)[:, None] * [1.0, 0, 0] + np.sin(lean)[:, None] * radial
    side = np.cross(way, radial)
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    third = np.cross(way, side)
    if needles.together > 1:
        round_it = 2 * np.pi * of_bundle[:, None] / needles.together
        apart = np.cos(round_it) * side + np.sin(round_it) * third
        way = np.cos(APART) * way + np.sin(APART) * apart
        side = np.cross(way, radial)
        side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
        third = np.cross(way, side)
    turn = 2.4 * k[:, None]
    side = np.cos(turn) * side + np.sin(turn) * third
    foot = along[:, None] * [1.0, 0, 0]
    middle = foot + 0.5 * reach * way
    # A kite has half the area of its box: twice as wide in the middle as the strip that it stands for.
    corners = np.stack(
        [foot, middle - wide * side, foot + reach * way, middle + wide * side], axis=1
    )
    first = 4 * k[:, None, None]
    triangles = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return corners.reshape(-1, 3), triangles.astype(np.int32)
