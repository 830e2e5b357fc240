"""Ray casting: what a sensor asks of a scene, and what a caster promises to answer.

A sensor hands a batch of world rays to a ``RayCaster`` and gets ``Hits`` back. There are two engines in
``blender/`` that search in float32, and one without any tree in the tests; ``search`` is where what they
find becomes exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ...base.rows import RowTable
from .geometry import SceneGeometry

ROWS = 8192  # hits at a time: what is in work stays in the cache
SHORT, LONG = 1e-200, 1e200  # squared lengths that can be taken as they are


@dataclass(frozen=True)
class Hits(RowTable):
    """First hits of R rays.

    distance : (R,) float64 metres along the unit direction, ``inf`` for a miss.
    instance, triangle : (R,) int64, -1 for a miss.
    normal : (R, 3) unit world normals of the triangles, NaN for a miss; None: not told.
    """

    distance: np.ndarray
    instance: np.ndarray
    triangle: np.ndarray
    normal: np.ndarray | None = None

    @property
    def found(self) -> np.ndarray:
        """(R,) bool, whether anything was hit."""
        return self.instance >= 0

    @classmethod
    def misses(cls, count: int) -> Hits:
        """Hits of rays that meet nothing."""
        nothing = np.full(count, -1, dtype=np.int64)
        return cls(np.full(count, np.inf), nothing, nothing.copy(), np.full((count, 3), np.nan))

    def put(self, rows: np.ndarray | slice, found: Hits) -> None:
        """Write what some of the rays hit."""
        for column, values in zip(vars(self).values(), vars(found).values(), strict=True):
            column[rows] = values


class RayCaster(Protocol):
    """Closest-hit and occlusion queries over batches of world rays.

    Rays are ``origins`` (R, 3) and ``directions`` (R, 3), in metres. Directions need not be unit vectors;
    one that is zero or not finite hits nothing, nor does a ray whose origin or limits are NaN. A hit
    counts where ``min_distance <= distance <= max_distance``, both ends included, each a number or (R,);
    what is nearer neither counts nor hides what is behind it. Both faces of a triangle are hit; of
    surfaces at the same distance any one is. Flat instances (a singular transform), triangles without
    area and triangles with a corner that is not finite hit nothing.

    Chained rays do not meet the surface they come from: ``leaving`` are the hits they start at. Where a
    ray leaves a triangle it never meets that triangle, and ``min_distance`` itself does not count, so
    that faces which lie on each other are passed together. To go on behind what was hit, and to start
    anew at it::

        caster.cast(origins, directions, limit, min_distance=hits.distance, leaving=hits)
        caster.cast(points, new_directions, limit, leaving=hits)

    An engine that searches in float32 may pass over a surface that lies less than about 1e-4 m behind the
    one it leaves.

    Each ray has a time, s, at which it meets the scene, if that moves: a number or (R,). ``moving`` is a
    ``MovingScene`` then.
    """

    engine: str
    scene: SceneGeometry
    moving: Any = None

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
        time: float | np.ndarray = 0.0,
    ) -> Hits:
        """The closest hit of each ray."""
        ...

    def occluded(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
    ) -> np.ndarray:
        """(R,) bool: whether ``cast`` with the same arguments finds anything."""
        return self.cast(
            origins, directions, max_distance, min_distance=min_distance, leaving=leaving
        ).found


def unit_columns(directions: np.ndarray) -> np.ndarray:
    """(3, R) float64 unit vectors, each coordinate one contiguous array; NaN where a direction is zero or
    not finite.
    """
    d = np.array(directions, dtype=np.float64, order="C")
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        square = d * d
        length = square[0] + square[1]
        length += square[2]
        if not (len(length) and length.min() > SHORT and length.max() < LONG):
            odd = np.flatnonzero(~((length > SHORT) & (length < LONG)))  # 1e-300 to 1e300
            d[:, odd] /= np.maximum(np.maximum(np.abs(d[0]), np.abs(d[1])), np.abs(d[2]))[odd]
            length[odd] = d[0, odd] ** 2 + d[1, odd] ** 2 + d[2, odd] ** 2
            d /= np.sqrt(length, out=length)
            d[:, ~(np.abs(d[0] + d[1] + d[2]) < 2.0)] = np.nan
            return d
        d /= np.sqrt(length, out=length)
    return d


def hit_normals(scene: SceneGeometry, hits: Hits) -> np.ndarray:
    """(R, 3) unit world normals of the triangles that were hit; NaN for a miss."""
    if hits.normal is not None:
        return hits.normal
    normals = np.full((len(hits.distance), 3), np.nan)
    met = np.flatnonzero(hits.found)
    for first in range(0, len(met), ROWS):
        part = met[first : first + ROWS]
        instance = hits.instance[part]
        a, b, c = scene.corners(instance, hits.triangle[part]).transpose(1, 2, 0)
        m = scene.transform[instance].reshape(-1, 12).T.copy()
        u, v = _turned(m, b - a), _turned(m, c - a)
        x = u[1] * v[2] - u[2] * v[1]
        y = u[2] * v[0] - u[0] * v[2]
        z = u[0] * v[1] - u[1] * v[0]
        with np.errstate(invalid="ignore", divide="ignore"):
            length = np.sqrt(x * x + y * y + z * z)
            for axis, along in enumerate((x, y, z)):
                normals[part, axis] = along / length
    return normals


def _turned(m: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
    """Vectors (3, R) by the linear parts of transforms (12, R)."""
    return tuple(m[i] * v[0] + m[i + 1] * v[1] + m[i + 2] * v[2] for i in (0, 4, 8))
