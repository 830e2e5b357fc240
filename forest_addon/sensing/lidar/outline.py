"""Outlines of scanners in the viewport: a tractor's fan, a tripod's window, the strips of a flight."""

from __future__ import annotations

import math

import numpy as np

from ...spec import Airborne, Mobile, Terrestrial, Tractor
from ..lines import AROUND, chain, rays_to

FLAT = math.radians(80.0)  # a beam nearer to the horizon is drawn at this angle from the vertical


def fan_outline(tractor: Tractor) -> np.ndarray:
    """The track, and the fan of beams at its start, middle and end."""
    heading = math.radians(tractor.heading_deg)
    ahead = np.array([math.cos(heading), math.sin(heading), 0.0])
    aside = np.array([ahead[1], -ahead[0], 0.0]) * (1.0 if tractor.side == "right" else -1.0)
    start = np.asarray(tractor.position)
    height = start[2]
    low, high = -math.atan2(height, tractor.reach), math.atan2(tractor.top - height, tractor.reach)
    angle = np.linspace(low, high, AROUND // 4 + 1)
    fan = tractor.reach * (
        np.cos(angle)[:, None] * aside + np.sin(angle)[:, None] * [0.0, 0.0, 1.0]
    )
    parts = [chain(np.array([start, start + tractor.track * ahead]))]
    for share in (0.0, 0.5, 1.0):
        foot = start + share * tractor.track * ahead
        parts += [chain(foot + fan), rays_to(foot, foot + fan[[0, -1]])]
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
    heading = math.radians(flight.heading_deg)
    ahead = np.array([math.cos(heading), math.sin(heading), 0.0])
    right = np.array([ahead[1], -ahead[0], 0.0])
    height = max(flight.position[2], 0.0)
    edges = np.clip(np.radians(flight.field_deg), -FLAT, FLAT)
    parts = []
    for strip in range(flight.strips):
        start = np.asarray(flight.position) + strip * flight.spacing * right
        foot = start + np.tan(edges)[:, None] * height * right - [0.0, 0.0, height]
        parts += [chain(np.array([start, start + flight.track * ahead])), rays_to(start, foot)]
        parts.append(chain(foot))
    return np.concatenate(parts)


def poses_outline(scanner: Mobile) -> np.ndarray:
    """The path through the poses of a moving scanner."""
    return chain(np.array([pose.position for pose in scanner.poses]).reshape(-1, 3))
