"""Where a sensor looks, as lines to draw: the -3 dB contour of a beam, a scanner's fan, a sound's path.

Settings go in, line segments in world coordinates come out; nothing of the scene is needed, so they can be
drawn while a slider moves.
"""

from __future__ import annotations

import math

import numpy as np

from ..spec import Airborne, Mobile, Reverb, Sensor, Sonar, Terrestrial, Tractor
from .sonar.beam import beam_frame

AROUND = 64  # segments of a full circle
FLAT = math.radians(80.0)  # a beam nearer to the horizon is drawn at this angle from the vertical
RAYS = 8  # lines from a sonar to the contour of its beam


def outline(sensor: Sensor) -> np.ndarray:
    """(N, 2, 3) ends of the segments, metres."""
    if isinstance(sensor, Sonar):
        return beam_outline(sensor)
    if isinstance(sensor, Tractor):
        return fan_outline(sensor)
    if isinstance(sensor, Terrestrial):
        return sweep_outline(sensor)
    if isinstance(sensor, Airborne):
        return strips_outline(sensor)
    if isinstance(sensor, Mobile):
        return _chain(np.array([pose.position for pose in sensor.poses]).reshape(-1, 3))
    return path_outline(sensor)


def beam_outline(sonar: Sonar) -> np.ndarray:
    """The -3 dB contour of one way of the beam at ``max_range``, rays to it, and the axis."""
    turn = np.linspace(0.0, 2.0 * math.pi, AROUND + 1)
    across, along = (math.radians(width) / 2.0 for width in sonar.beam_width_deg)
    azimuth, elevation = across * np.cos(turn), along * np.sin(turn)
    angle = np.minimum(np.hypot(azimuth, elevation), math.pi)
    share = np.sinc(angle / math.pi)  # sin(angle)/angle: offsets are laid out along the side
    local = np.stack([np.cos(angle), share * azimuth, share * elevation], axis=1)
    frame = beam_frame(math.radians(sonar.azimuth_deg), math.radians(sonar.elevation_deg))
    position = np.asarray(sonar.position)
    contour = position + sonar.max_range * local @ frame
    rays = contour[:: AROUND // RAYS][:RAYS]
    return np.concatenate(
        [
            _chain(contour),
            _from(position, rays),
            _from(position, position + sonar.max_range * frame[:1]),
        ]
    )


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
    parts = [_chain(np.array([start, start + tractor.track * ahead]))]
    for share in (0.0, 0.5, 1.0):
        foot = start + share * tractor.track * ahead
        parts += [_chain(foot + fan), _from(foot, foot + fan[[0, -1]])]
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
        _chain(at(round_, np.full(1, elevation))) for elevation in (low, (low + high) / 2, high)
    ]
    rising = np.linspace(low, high, AROUND // 4 + 1)
    parts += [_chain(at(np.full(1, azimuth), rising)) for azimuth in np.linspace(first, last, 9)]
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
        parts += [_chain(np.array([start, start + flight.track * ahead])), _from(start, foot)]
        parts.append(_chain(foot))
    return np.concatenate(parts)


def path_outline(reverb: Reverb) -> np.ndarray:
    """The direct path, and the one that the ground z = 0 mirrors."""
    source, receiver = np.asarray(reverb.source), np.asarray(reverb.receiver)
    share = source[2] / (source[2] + receiver[2])
    bounce = source + share * (receiver - source)
    bounce[2] = 0.0
    return np.concatenate(
        [_chain(np.array([source, receiver])), _chain(np.array([source, bounce, receiver]))]
    )


def _chain(points: np.ndarray) -> np.ndarray:
    """(N - 1, 2, 3) segments along points (N, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1)


def _from(point: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(N, 2, 3) segments from a point to ends (N, 3)."""
    return np.stack([np.broadcast_to(point, ends.shape), ends], axis=1)
