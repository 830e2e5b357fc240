"""SIMLIDAR's tractor (S): a vertical fan across the direction of travel, repeated every step.

The result is the matrix of distances, scans by angles, and ``to_cloud`` makes points of it. A beam is one
ray here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..spec import Tractor
from .cloud import Cloud
from .rays import RayCaster
from .returns import Returns, label, take
from .steps import steps

Progress = Callable[[int, int], None]
Rays = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # beam numbers to origins, directions
RAYS_AT_ONCE = 65_536


@dataclass(frozen=True)
class TractorScan:
    """SIMLIDAR's matrix: N scans by M angles.

    angle : (M,) radians from the horizontal. track : (N,) metres travelled.
    returns : of the N·M beams, row by row; ``distance`` reshapes them to (N, M).
    engine : which ray caster ran.
    """

    angle: np.ndarray
    track: np.ndarray
    returns: Returns
    engine: str

    @property
    def distance(self) -> np.ndarray:
        """(N, M) metres, inf where a beam escaped."""
        return self.returns.distance.reshape(len(self.track), len(self.angle))

    @property
    def organ(self) -> np.ndarray:
        """(N, M) what was hit."""
        return self.returns.organ.reshape(len(self.track), len(self.angle))


def drive(tractor: Tractor, caster: RayCaster, progress: Progress | None = None) -> TractorScan:
    """Drive a tractor scanner past the scene (S, eqs 8-13, angles from the horizontal)."""
    angle, track = fan(tractor), positions(tractor)
    rays = _driven_rays(tractor, angle, track)
    returns = _look(rays, len(track) * len(angle), caster, tractor.max_range, progress)
    return TractorScan(angle, track, returns, caster.engine)


def to_cloud(scan: TractorScan, tractor: Tractor) -> Cloud:
    """The points that a drive met, in world coordinates; the surface is taken to be white."""
    pulse = np.flatnonzero(np.isfinite(scan.returns.distance))
    seen = take(scan.returns, pulse)
    origin, way = _driven_rays(tractor, scan.angle, scan.track)(pulse)
    return Cloud(
        position=origin + seen.distance[:, None] * way,
        pulse=pulse,
        time=np.zeros(len(pulse)),  # S says nothing of a rate
        number=np.ones(len(pulse), dtype=np.uint8),
        count=np.ones(len(pulse), dtype=np.uint8),
        azimuth=np.arctan2(way[:, 1], way[:, 0]),
        elevation=np.arcsin(way[:, 2]),
        scan_angle=np.arcsin(way[:, 2]),
        intensity=seen.cos_incidence / seen.distance**2,
        width=np.zeros(len(pulse)),
        true_range=seen.distance,
        returns=seen,
        pulses=len(scan.returns.distance),
        engine=scan.engine,
    )


def _driven_rays(tractor: Tractor, angle: np.ndarray, track: np.ndarray) -> Rays:
    """Origins and directions of beams, by their number: scan by scan, each from below upwards."""
    heading = np.deg2rad(tractor.heading_deg)
    forward = np.array([np.cos(heading), np.sin(heading), 0.0])
    sideways = np.array([forward[1], -forward[0], 0.0]) * (1 if tractor.side == "right" else -1)
    beams = np.cos(angle)[:, None] * sideways + np.sin(angle)[:, None] * np.array([0.0, 0.0, 1.0])
    start = np.array(tractor.position)

    def rays(beam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        scan, step = np.divmod(beam, len(angle))
        return start + track[scan, None] * forward, beams[step]

    return rays


def fan(tractor: Tractor) -> np.ndarray:
    """(M,) angles of a scan, radians from the horizontal: θ1 = -atan(z0/reach) upwards (S, eq. 8)."""
    lowest = -np.arctan2(tractor.position[2], tractor.reach)
    highest = np.arctan2(tractor.top - tractor.position[2], tractor.reach)
    return steps(lowest, highest, np.deg2rad(tractor.angle_step_deg))


def positions(tractor: Tractor) -> np.ndarray:
    """(N,) metres travelled at each scan; ``gap`` scans are skipped after each."""
    return steps(0.0, tractor.track, tractor.step * (tractor.gap + 1))


def _look(
    rays: Rays,
    count: int,
    caster: RayCaster,
    max_range: float,
    progress: Progress | None,
) -> Returns:
    """Cast ``count`` beams in pieces."""
    pieces: list[Returns] = []
    for first in range(0, count, RAYS_AT_ONCE):
        beam = np.arange(first, min(first + RAYS_AT_ONCE, count))
        origins, directions = rays(beam)
        hits = caster.cast(origins, directions, max_range)
        pieces.append(label(caster.scene, hits, directions))
        if progress:
            progress(int(beam[-1]) + 1, count)
    return Returns(
        **{
            name: np.concatenate([getattr(piece, name) for piece in pieces])
            for name in Returns.__dataclass_fields__
        }
    )
