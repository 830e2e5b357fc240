"""A glance through a scanner: a coarse image of what its pulses meet, fast enough to be live.

The image has some of the scan's own pulses, one ray each and without noise: on a tripod by azimuth and
elevation; from a spinning head one turn in the middle of its way; of what sweeps lines or circles, or drives
past, a column a line along the way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...spec import Surfaces, Terrestrial, Tractor
from ..kind import Observation
from ..rays.caster import RayCaster
from .radiometry import intensity, reflectance_of
from .returns import ESCAPED, label

if TYPE_CHECKING:
    from ..trajectory import Trajectory

SHAPE = (64, 256)  # rows and columns, at most


@dataclass(frozen=True)
class Glance:
    """Image of H by W pulses, the lowest row first.

    distance : (H, W) metres, inf where nothing is met. brightness : (H, W) intensity times squared distance:
    what a white surface that faces the scanner would give is 1; 0 where nothing is met.
    organ : (H, W) int8, ``trimesh.PART_NAMES`` or ``returns.ESCAPED``.
    """

    distance: np.ndarray
    brightness: np.ndarray
    organ: np.ndarray


def glance(job: Observation, shape: tuple[int, int] = SHAPE) -> Glance:
    """Return what a LiDAR sees in a still scene, in an image of at most this shape.

    Raises
    ------
    SpecError : a mobile scanner that has nowhere to go.
    """
    scanner = job.sensor
    origin, way, size = rays_of(scanner, job.trajectory, shape)
    found = _look(job.seen.caster, scanner, origin, way)
    return Glance(*(values.reshape(size[::-1]).T for values in found))


def rays_of(
    scanner: Any, trajectory: Trajectory | None, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """Origins and unit directions (R, 3) of pulses, column by column from the lowest row up, and the image's
    rows and columns."""
    if isinstance(scanner, Tractor):
        from .tractor import axes, fan, positions

        column, row = _grid(len(positions(scanner)), len(fan(scanner)), shape)
        origin, way = axes(scanner, column.ravel(), row.ravel())
        return origin, way, column.shape[::-1]
    from .scanner import directions, pattern_of

    pattern = pattern_of(scanner, trajectory)
    if isinstance(scanner, Terrestrial):
        azimuth, elevation = directions(scanner)
        column, row = _grid(len(azimuth), len(elevation), shape)
        number = (column[::-1] * len(elevation) + row).ravel()  # azimuth grows to the left
    else:
        number, column = _of_sweep(scanner, pattern.count, shape)
    pulses = pattern.pulses(number)
    origin, way = np.array(pulses.origin), pulses.direction
    if not isinstance(scanner, Terrestrial) and not _turns(scanner):
        order = np.argsort(pulses.scan_angle.reshape(column.shape), axis=1, kind="stable")
        rows = (np.arange(len(order))[:, None] * column.shape[1] + order).ravel()
        origin, way = origin[rows], way[rows]
    return origin, way, column.shape[::-1]


def _turns(scanner: Any) -> bool:
    """Return whether a scanner has a head with several channels that turns."""
    return bool(scanner.pattern == "spinning" and scanner.channels > 1)


def _of_sweep(scanner: Any, count: int, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """(W * H,) numbers of pulses of what sweeps, and a grid (W, H) of their columns."""
    per_line = max(1, min(count, round(scanner.pulse_rate / scanner.line_rate)))
    if _turns(scanner):
        channels = min(scanner.channels, count)
        column, row = _grid(max(1, per_line // channels), channels, shape)
        start = max(0, (count - per_line) // 2) // channels * channels
        number = start + column * channels + row
    else:
        column, row = _grid(max(1, count // per_line), per_line, shape)
        number = column * per_line + row
    return np.minimum(number, count - 1).ravel(), column


def _grid(columns: int, rows: int, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """(W, H), (W, H) columns and rows of so many, evenly thinned to a shape (H, W)."""
    some = [
        np.linspace(0, n - 1, min(n, most)).round()
        for n, most in ((columns, shape[1]), (rows, shape[0]))
    ]
    column, row = np.meshgrid(*(numbers.astype(np.int64) for numbers in some), indexing="ij")
    return column, row


def _look(
    caster: RayCaster, scanner: Any, origin: np.ndarray, way: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(R,) distance, brightness and organ; what is nearer than the scanner sees hides what is behind it."""
    hits = caster.cast(origin, way, scanner.max_range)
    seen = label(caster.scene, hits, way)
    there = hits.found & (hits.distance >= getattr(scanner, "min_range", 0.0))
    surfaces = getattr(scanner, "surfaces", None) or Surfaces()
    beam = getattr(scanner, "beam", None)
    away = np.where(there, hits.distance, 1.0)
    reflectance = reflectance_of(caster.scene, hits, seen.organ, surfaces)
    clear = 0.0 if beam is None else beam.extinction
    bright = intensity(reflectance, seen.cos_incidence, away, clear) * away**2
    return (
        np.where(there, hits.distance, np.inf),
        np.where(there, bright, 0.0),
        np.where(there, seen.organ, ESCAPED).astype(np.int8),
    )
