"""A glance through a scanner: a coarse image of what its pulses meet, fast enough to be live.

The image has some of the scan's own pulses, one ray each and without noise: on a tripod by azimuth and
elevation; from a spinning head one turn in the middle of its way; of what sweeps lines or circles, or drives
past, a column a line along the way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...spec import Airborne, Mobile, Surfaces, Terrestrial, Tractor
from ..kind import AROUND, Observation, chain, rays_to
from ..trajectory import Trajectory, strips
from .cloud import ESCAPED, Cloud, label
from .pattern import directions, pattern_of
from .radiometry import intensity, reflectance_of
from .tractor import axes, directions_of, fan, origins_of, positions

SHAPE = (64, 256)  # rows and columns, at most


@dataclass(frozen=True)
class Glance:
    """Image of H by W pulses, the lowest row first.

    distance : (H, W) metres, inf where nothing is met. brightness : (H, W) intensity times squared distance:
    what a white surface that faces the scanner would give is 1; 0 where nothing is met.
    organ : (H, W) int8, ``trimesh.PART_NAMES`` or ``cloud.ESCAPED``.
    """

    distance: np.ndarray
    brightness: np.ndarray
    organ: np.ndarray


def glance(job: Observation) -> Glance:
    """Image, of at most ``SHAPE``, of what a LiDAR sees in a still scene.

    Raises
    ------
    SpecError : a mobile scanner that has nowhere to go.
    """
    scanner = job.sensor
    origin, way, size = rays_of(scanner, job.trajectory)
    caster = job.seen.caster
    hits = caster.cast(origin, way, scanner.max_range)
    seen = label(caster.scene, hits, way)
    # What is nearer than the scanner sees hides what is behind it.
    there = hits.found & (hits.distance >= getattr(scanner, "min_range", 0.0))
    surfaces = getattr(scanner, "surfaces", None) or Surfaces()
    clear = getattr(getattr(scanner, "beam", None), "extinction", 0.0)
    away = np.where(there, hits.distance, 1.0)
    reflectance = reflectance_of(caster.scene, hits, seen.organ, surfaces)
    bright = intensity(reflectance, seen.cos_incidence, away, clear) * away**2
    columns = (
        np.where(there, hits.distance, np.inf),
        np.where(there, bright, 0.0),
        np.where(there, seen.organ, ESCAPED).astype(np.int8),
    )
    return Glance(*(values.reshape(size[::-1]).T for values in columns))


def rays_of(
    scanner: Any, trajectory: Trajectory | None
) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """Origins and unit directions (R, 3) of pulses, column by column from the lowest row up, and the image's
    rows and columns."""
    if isinstance(scanner, Tractor):
        column, row = _grid(len(positions(scanner)), len(fan(scanner)))
        origin, way = axes(scanner, column.ravel(), row.ravel())
        return origin, way, column.shape[::-1]
    pattern = pattern_of(scanner, trajectory)
    if isinstance(scanner, Terrestrial):
        azimuth, elevation = directions(scanner)
        column, row = _grid(len(azimuth), len(elevation))
        number = (column[::-1] * len(elevation) + row).ravel()  # azimuth grows to the left
    else:
        per_line = max(1, min(pattern.count, round(scanner.pulse_rate / scanner.line_rate)))
        if _turns(scanner):
            channels = min(scanner.channels, pattern.count)
            column, row = _grid(max(1, per_line // channels), channels)
            start = max(0, (pattern.count - per_line) // 2) // channels * channels
            number = start + column * channels + row
        else:
            column, row = _grid(max(1, pattern.count // per_line), per_line)
            number = column * per_line + row
        number = np.minimum(number, pattern.count - 1).ravel()
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


def _grid(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """(W, H), (W, H) columns and rows of so many, evenly thinned to ``SHAPE``."""
    some = [
        np.linspace(0, n - 1, min(n, most)).round()
        for n, most in ((columns, SHAPE[1]), (rows, SHAPE[0]))
    ]
    column, row = np.meshgrid(*(numbers.astype(np.int64) for numbers in some), indexing="ij")
    return column, row


# A scan from a tripod as an image: the range of the first return by azimuth and elevation.


def range_image(cloud: Cloud, scanner: Terrestrial) -> np.ndarray:
    """(E, A) metres: a row an elevation, from the lowest; NaN where nothing came back."""
    azimuth, elevation = directions(scanner)
    step = np.deg2rad(scanner.angle_step_deg)
    line_step = np.deg2rad(scanner.line_step_deg or scanner.angle_step_deg)
    first = cloud.number == 1
    rounding = step / 1000  # the first column may be a little less than a whole turn away
    turned = (cloud.azimuth[first] - azimuth[0] + rounding) % (2 * np.pi) - rounding
    column = np.rint(turned / step).astype(int)
    row = np.rint((cloud.elevation[first] - elevation[0]) / line_step).astype(int)
    image = np.full((len(elevation), len(azimuth)), np.nan)
    image[row, column] = cloud.returns.distance[first]
    return image


# Outlines of scanners in the viewport: a tractor's fan, a tripod's window, the strips of a flight.


FLAT = math.radians(80.0)  # a beam nearer to the horizon is drawn at this angle from the vertical


def outline(sensor: Any) -> np.ndarray:
    """(N, 2, 3) m, ends of the lines that show where a LiDAR looks."""
    drawn: dict[type, Any] = {
        Tractor: fan_outline,
        Terrestrial: sweep_outline,
        Airborne: strips_outline,
        Mobile: lambda scanner: chain(
            np.array([pose.position for pose in scanner.poses]).reshape(-1, 3)
        ),
    }
    return drawn[type(sensor)](sensor)


def fan_outline(tractor: Tractor) -> np.ndarray:
    """The track, and the fan of beams at its start, middle and end."""
    height = tractor.position[2]
    low, high = -math.atan2(height, tractor.reach), math.atan2(tractor.top - height, tractor.reach)
    rays = tractor.reach * directions_of(tractor, np.linspace(low, high, AROUND // 4 + 1))
    feet = origins_of(tractor, tractor.track * np.array([0.0, 0.5, 1.0]))
    parts = [chain(feet[[0, 2]])]
    for foot in feet:
        parts += [chain(foot + rays), rays_to(foot, foot + rays[[0, -1]])]
    return np.concatenate(parts)


def sweep_outline(scanner: Terrestrial, radius: float = 2.0) -> np.ndarray:
    """The window of angles that is scanned, as circles and meridians ``radius`` metres away."""
    first, last = np.radians(scanner.azimuth_deg)
    low, high = np.radians(scanner.elevation_deg)
    steps = max(2, math.ceil(AROUND * (last - first) / (2.0 * math.pi)))
    position = np.asarray(scanner.position)

    def at(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
        level = np.cos(elevation)
        place = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
        return position + radius * np.stack(np.broadcast_arrays(*place), axis=1)

    round_ = np.linspace(first, last, steps + 1)
    parts = [
        chain(at(round_, np.full(1, elevation))) for elevation in (low, (low + high) / 2, high)
    ]
    rising = np.linspace(low, high, AROUND // 4 + 1)
    parts += [chain(at(np.full(1, azimuth), rising)) for azimuth in np.linspace(first, last, 9)]
    return np.concatenate(parts)


def strips_outline(flight: Airborne) -> np.ndarray:
    """The strips of a flight, and the fan of beams down to z = 0 at the start of each."""
    heading, height = math.radians(flight.heading_deg), max(flight.position[2], 0.0)
    right = np.array([math.sin(heading), -math.cos(heading), 0.0])
    edges = np.clip(np.radians(flight.field_deg), -FLAT, FLAT)
    parts = []
    for number, ends in enumerate(strips(flight).position.reshape(-1, 2, 3)):
        start = ends[number % 2]  # every other strip is flown back
        foot = start + np.tan(edges)[:, None] * height * right - [0.0, 0.0, height]
        parts += [chain(ends), rays_to(start, foot), chain(foot)]
    return np.concatenate(parts)
