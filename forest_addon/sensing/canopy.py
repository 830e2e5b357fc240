"""Leaf area index and gap fraction as a hemispherical picture tells them: rays upwards from points.

P(θ) is the share of rays at zenith angle θ that leave through the canopy, of all points together. The
effective plant area index is that of Miller (1967), Le = 2 ∫ -ln P(θ) cos θ sin θ dθ, by rings up
to ``REACH``; what is lower counts as the last ring does. Leaves that are clumped let more light through than
as many strewn at random: Le over the true index is the clumping factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .lidar.cloud import ESCAPED, organs
from .rays.caster import RayCaster

REACH = np.deg2rad(75.0)
SKY, OUTSIDE = ESCAPED, -2  # of a hemispherical picture: what is open, what is beyond its circle
FEWEST = 0.5  # of a ray: a ring without a gap has at most one in twice its rays


@dataclass(frozen=True)
class Canopy:
    """View of a canopy from below.

    zenith : (Z,) middle of each ring, radians. gap : (Z,) share of its rays that meet nothing.
    open : share of the sky that is open, by solid angle. effective : Le, m²/m², wood counted.
    points : how many. rays : of all points together.
    """

    zenith: np.ndarray
    gap: np.ndarray
    open: float
    effective: float
    points: int
    rays: int


def look_up(
    caster: RayCaster,
    points: np.ndarray,
    rng: np.random.Generator,
    rings: int = 15,
    rays: int = 360,
) -> Canopy:
    """Look up from points (N, 3), metres.

    rings : of equal width in zenith angle. rays : of each ring, from each point.
    """
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    edges = np.linspace(0, REACH, rings + 1)
    shape = (len(points), rings, rays)
    cosine = np.cos(edges[:-1])[:, None] + np.diff(np.cos(edges))[:, None] * rng.random(shape)
    azimuth = 2 * np.pi * (np.arange(rays) + rng.random(shape)) / rays
    sine = np.sqrt(1 - cosine**2)
    way = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)
    start = np.broadcast_to(points[:, None, None], way.shape)
    hidden = caster.occluded(start.reshape(-1, 3), way.reshape(-1, 3)).reshape(shape)
    gap = 1 - hidden.mean(axis=(0, 2))
    pooled = np.maximum(gap, FEWEST / (rays * len(points)))
    middle = (edges[:-1] + edges[1:]) / 2
    contact = -np.cos(middle) * np.log(pooled)
    ring = -np.diff(np.cos(edges))  # ∫ sin dθ, which is also its solid angle over 2π
    horizon = ring.copy()
    horizon[-1] += np.cos(REACH)
    effective = 2 * float((contact * horizon).sum())
    sky = float((gap * ring).sum() / ring.sum())
    return Canopy(middle, gap, sky, effective, len(points), hidden.size)


def hemisphere(caster: RayCaster, point: np.ndarray, pixels: int = 512) -> np.ndarray:
    """(pixels, pixels) int8, a hemispherical picture upwards from a point (3,): the part of what is seen
    (``PART_NAMES``), ``SKY``, or ``OUTSIDE`` of its circle.

    Equidistant: the zenith angle is in proportion to the distance from the middle, the horizon the circle. As
    one sees it lying on one's back with the head to the north: the first row is north, the first column east.
    """
    middle = (np.arange(pixels) + 0.5) / pixels * 2 - 1
    east, north = -middle[None, :], -middle[:, None]
    away = np.hypot(east, north)
    inside = away <= 1
    zenith, azimuth = away * np.pi / 2, np.arctan2(north, east)
    way = np.stack(
        [np.sin(zenith) * np.cos(azimuth), np.sin(zenith) * np.sin(azimuth), np.cos(zenith)],
        axis=-1,
    )[inside]
    hits = caster.cast(np.broadcast_to(np.asarray(point, dtype=float), way.shape), way)
    image = np.full((pixels, pixels), OUTSIDE, dtype=np.int8)
    image[inside] = organs(caster.scene, hits)  # ``SKY`` where it is open
    return image
