"""SIMLIDAR's tractor (Méndez et al.): a vertical fan across the direction of travel, repeated every step.

The result is the matrix of distances, scans by angles, and ``to_cloud`` makes points of it. A beam is one
ray, or Méndez et al.'s solid sector: from y to y + Δy, from θ to θ + Δθ, sampled by P + 1 points along
each, its distance that of the nearest hit. S samples the range too; a ray needs no such steps. Neighbours
share the rays on their borders, so the rays are cast once, as a lattice of P·N + 1 by P·M + 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ...base.progress import Progress
from ...base.vectors import azimuth_of, column
from ...spec import Tractor
from ..rays.caster import RayCaster
from .cloud import Cloud, Returns, label
from .pattern import steps

RAYS_AT_ONCE = 131_072
CONTACT = 1e-3  # m; what is nearer is as bright as there


@dataclass(frozen=True)
class TractorScan:
    """SIMLIDAR's matrix: N scans by M angles.

    angle : (M,) radians from the horizontal. track : (N,) metres travelled.
    returns : of the N·M beams, row by row; ``distance`` reshapes them to (N, M).
    engine : which ray caster ran.
    escape : metres, what ``matrix`` says of a beam that met nothing.
    """

    angle: np.ndarray
    track: np.ndarray
    returns: Returns
    engine: str
    escape: float = np.inf

    @property
    def distance(self) -> np.ndarray:
        """(N, M) metres, inf where a beam escaped."""
        return self.returns.distance.reshape(len(self.track), len(self.angle))

    @property
    def matrix(self) -> np.ndarray:
        """(N, M) Méndez et al.'s l: the distance, or the escape value."""
        return np.where(np.isfinite(self.distance), self.distance, self.escape)

    @property
    def organ(self) -> np.ndarray:
        """(N, M) what was hit."""
        return self.returns.organ.reshape(len(self.track), len(self.angle))


def drive(tractor: Tractor, caster: RayCaster, progress: Progress | None = None) -> TractorScan:
    """Drive a tractor scanner past the scene (S, eqs 8-13, angles from the horizontal)."""
    angle, track = fan(tractor), positions(tractor)
    returns = _look(tractor, len(track), len(angle), caster, progress)
    escape = np.inf if tractor.escape is None else tractor.escape
    return TractorScan(angle, track, returns, caster.engine, escape)


def to_cloud(scan: TractorScan, tractor: Tractor) -> Cloud:
    """The points that a drive met, in world coordinates; the surface is taken to be white.

    A point lies on the first ray of its beam, which is all that the scanner knows of its direction.
    """
    pulse = np.flatnonzero(np.isfinite(scan.returns.distance))
    seen = scan.returns.select(pulse)
    row, step = np.divmod(pulse, len(scan.angle))
    origin, way = axes(tractor, row, step)
    elevation = np.arcsin(column(way, 2))
    return Cloud(
        position=origin + seen.distance[:, None] * way,
        pulse=pulse,
        time=np.zeros(len(pulse)),  # S says nothing of a rate
        number=np.ones(len(pulse), dtype=np.uint8),
        count=np.ones(len(pulse), dtype=np.uint8),
        azimuth=azimuth_of(way),
        elevation=elevation,
        scan_angle=elevation,
        intensity=seen.cos_incidence / np.maximum(seen.distance, CONTACT) ** 2,
        width=np.zeros(len(pulse)),
        true_range=seen.distance,
        returns=seen,
        pulses=len(scan.returns.distance),
        engine=scan.engine,
    )


def fan(tractor: Tractor) -> np.ndarray:
    """(M,) angles of a scan, radians from the horizontal: θ1 = -atan(z0/reach) upwards (S, eq. 8)."""
    lowest = -np.arctan2(tractor.position[2], tractor.reach)
    highest = np.arctan2(tractor.top - tractor.position[2], tractor.reach)
    return steps(lowest, highest, np.deg2rad(tractor.angle_step_deg))


def positions(tractor: Tractor) -> np.ndarray:
    """(N,) metres travelled at each scan; ``gap`` scans are skipped after each."""
    return steps(0.0, tractor.track, tractor.step * (tractor.gap + 1))


def axes(tractor: Tractor, scan: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(B, 3), (B, 3) origins and unit directions of the first rays of beams, by scan and step of the fan."""
    along = positions(tractor)[scan]
    return origins_of(tractor, along), directions_of(tractor, fan(tractor)[step])


def beam_rays(
    tractor: Tractor, scan: np.ndarray, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions (B·(P + 1)², 3) of the rays of beams (B,), beam by beam, by scan and step
    of the fan."""
    split = max(tractor.splits, 1)
    within = np.arange(tractor.splits + 1)
    i, j = (part.ravel() for part in np.meshgrid(within, within, indexing="ij"))
    along = tractor.step * ((scan[:, None] * (tractor.gap + 1) * split + i) / split)
    lowest, turn = fan(tractor)[0], np.deg2rad(tractor.angle_step_deg)
    angle = lowest + turn * ((step[:, None] * split + j) / split)
    return origins_of(tractor, along.ravel()), directions_of(tractor, angle.ravel())


def _look(
    tractor: Tractor, scans: int, angles: int, caster: RayCaster, progress: Progress | None
) -> Returns:
    """Cast all beams, some scans at a time."""
    split = max(tractor.splits, 1)
    within = np.arange(tractor.splits + 1)
    column = np.arange(angles)[:, None] * split + within  # (M, P + 1) of the lattice
    lowest, step = fan(tractor)[0], np.deg2rad(tractor.angle_step_deg)
    ways = directions_of(tractor, lowest + step * (np.arange(column.max() + 1) / split))
    at_once = max(1, RAYS_AT_ONCE // (len(ways) * split))
    pieces: list[Returns] = []
    for first in range(0, scans, at_once):
        scan = np.arange(first, min(first + at_once, scans))
        lines, row = np.unique(
            scan[:, None] * (tractor.gap + 1) * split + within, return_inverse=True
        )
        origins = np.repeat(origins_of(tractor, tractor.step * (lines / split)), len(ways), axis=0)
        directions = np.tile(ways, (len(lines), 1))
        hits = caster.cast(origins, directions, tractor.max_range)
        near = _nearest(hits.distance.reshape(len(lines), -1), row.reshape(len(scan), -1), column)
        pieces.append(label(caster.scene, hits.select(near), directions[near]))
        if progress:
            progress((int(scan[-1]) + 1) * angles, scans * angles)
    return Returns(
        **{
            name: np.concatenate([getattr(piece, name) for piece in pieces])
            for name in Returns.__dataclass_fields__
        }
    )


def _nearest(distance: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """(n·M,) number of the ray that meets something first in each beam of n scans.

    distance : (lines, columns) of the lattice's rays. row : (n, P + 1), column : (M, P + 1) of each beam.
    """
    flat = distance.ravel()
    rays = (
        r[:, None] * distance.shape[1] + c for r, c in product(row.T, column.T)
    )  # one ray of every beam, (n, M)
    best = next(rays)
    for ray in rays:
        best = np.where(flat[ray] < flat[best], ray, best)
    return best.ravel()


def origins_of(tractor: Tractor, along: np.ndarray) -> np.ndarray:
    """(K, 3) where the scanner is after so many metres."""
    return np.array(tractor.position) + along[:, None] * _forward(tractor)


def directions_of(tractor: Tractor, angle: np.ndarray) -> np.ndarray:
    """(K, 3) unit vectors at angles from the horizontal, to the scanner's side."""
    forward = _forward(tractor)
    sideways = np.array([forward[1], -forward[0], 0.0]) * (1 if tractor.side == "right" else -1)
    up = np.array([0.0, 0.0, 1.0])
    return np.cos(angle)[:, None] * sideways + np.sin(angle)[:, None] * up


def _forward(tractor: Tractor) -> np.ndarray:
    heading = np.deg2rad(tractor.heading_deg)
    return np.array([np.cos(heading), np.sin(heading), 0.0])
