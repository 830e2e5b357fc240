"""LiDAR: rays of a scanner, and what they return.

``drive`` is SIMLIDAR's tractor (S): a vertical fan across the direction of travel, repeated every step;
the result is the matrix of distances, scans by angles, and ``to_cloud`` makes points of it. ``sweep`` is
a scanner on a tripod, azimuth by elevation; the result is a point cloud with labels. A beam is one ray
here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..growth.trimesh import TriMesh
from ..spec import Terrestrial, Tractor
from .geometry import SceneGeometry
from .rays import Hits, RayCaster, hit_normals

Progress = Callable[[int, int], None]
Rays = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # beam numbers to origins, directions
RAYS_AT_ONCE = 65_536
ESCAPED = -1  # organ of a beam that meets nothing


@dataclass(frozen=True)
class Returns:
    """What R rays met; where a ray met nothing: inf, NaN or -1.

    distance : (R,) metres. cos_incidence : (R,) |cos| between ray and surface normal.
    organ : (R,) int8, ``trimesh.PART_NAMES`` or ``ESCAPED``. leaf, tree, species, instance : (R,).
    """

    distance: np.ndarray
    cos_incidence: np.ndarray
    organ: np.ndarray
    leaf: np.ndarray
    tree: np.ndarray
    species: np.ndarray
    instance: np.ndarray


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


@dataclass(frozen=True)
class Cloud:
    """A point cloud of P returns out of ``pulses`` beams.

    position : (P, 3) metres. pulse : (P,) number of the beam. azimuth, elevation : (P,) radians.
    intensity : (P,) reflectance·|cos|/R², as a share of a facing surface's at 1 m.
    returns : the labels of the P points.
    """

    position: np.ndarray
    pulse: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    intensity: np.ndarray
    returns: Returns
    pulses: int
    engine: str


def drive(tractor: Tractor, caster: RayCaster, progress: Progress | None = None) -> TractorScan:
    """Drive a tractor scanner past the scene (S, eqs 8-13, angles from the horizontal)."""
    angle, track = fan(tractor), positions(tractor)
    rays = _driven_rays(tractor, angle, track)
    returns = _look(rays, len(track) * len(angle), caster, 0.0, tractor.max_range, progress)
    return TractorScan(angle, track, returns, caster.engine)


def to_cloud(scan: TractorScan, tractor: Tractor) -> Cloud:
    """The points that a drive met, in world coordinates; the surface is taken to be white."""
    pulse = np.flatnonzero(np.isfinite(scan.returns.distance))
    seen = _take(scan.returns, pulse)
    origin, way = _driven_rays(tractor, scan.angle, scan.track)(pulse)
    return Cloud(
        position=origin + seen.distance[:, None] * way,
        pulse=pulse,
        azimuth=np.arctan2(way[:, 1], way[:, 0]),
        elevation=np.arcsin(way[:, 2]),
        intensity=seen.cos_incidence / seen.distance**2,
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
    return _steps(lowest, highest, np.deg2rad(tractor.angle_step_deg))


def positions(tractor: Tractor) -> np.ndarray:
    """(N,) metres travelled at each scan; ``gap`` scans are skipped after each."""
    return _steps(0.0, tractor.track, tractor.step * (tractor.gap + 1))


def sweep(scanner: Terrestrial, caster: RayCaster, progress: Progress | None = None) -> Cloud:
    """Scan azimuth by elevation from a tripod."""
    step = np.deg2rad(scanner.angle_step_deg)
    azimuth = _steps(*_radians(scanner.azimuth_deg), step)
    if scanner.azimuth_deg[1] - scanner.azimuth_deg[0] >= 360:
        azimuth = azimuth[azimuth < np.deg2rad(scanner.azimuth_deg[0]) + 2 * np.pi - 1e-9]
    elevation = _steps(*_radians(scanner.elevation_deg), step)
    start = np.array(scanner.position)

    def angles(beam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        column, row = np.divmod(beam, len(elevation))
        return azimuth[column], elevation[row]

    def rays(beam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        az, el = angles(beam)
        way = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], axis=1)
        return np.broadcast_to(start, way.shape), way

    pulses = len(azimuth) * len(elevation)
    returns = _look(rays, pulses, caster, scanner.min_range, scanner.max_range, progress)
    pulse = np.flatnonzero(np.isfinite(returns.distance))
    seen = _take(returns, pulse)
    az, el = angles(pulse)
    return Cloud(
        position=start + seen.distance[:, None] * rays(pulse)[1],
        pulse=pulse,
        azimuth=az,
        elevation=el,
        intensity=scanner.reflectance * seen.cos_incidence / seen.distance**2,
        returns=seen,
        pulses=pulses,
        engine=caster.engine,
    )


def label(scene: SceneGeometry, hits: Hits, directions: np.ndarray) -> Returns:
    """What hits are: organ, leaf, tree, species, and the angle of incidence."""
    count = len(hits.distance)
    organ = np.full(count, ESCAPED, dtype=np.int8)
    leaf = np.full(count, -1, dtype=np.int32)
    found = np.flatnonzero(hits.found)
    mesh_of = scene.mesh_index[hits.instance[found]]
    for number in np.unique(mesh_of):
        rows = found[mesh_of == number]
        mesh: TriMesh = scene.meshes[number]
        organ[rows] = mesh.part[hits.triangle[rows]]
        leaf[rows] = mesh.leaf[hits.triangle[rows]]
    cosine = np.abs(np.einsum("ri,ri->r", hit_normals(scene, hits), directions))
    of_tree = np.append(scene.tree, -1)  # a miss has instance -1
    of_species = np.append(scene.species, -1)
    return Returns(
        distance=hits.distance,
        cos_incidence=cosine,
        organ=organ,
        leaf=leaf,
        tree=of_tree[hits.instance],
        species=of_species[hits.instance],
        instance=hits.instance,
    )


def _look(
    rays: Rays,
    count: int,
    caster: RayCaster,
    min_range: float,
    max_range: float,
    progress: Progress | None,
) -> Returns:
    """Cast ``count`` beams in pieces; a hit nearer than ``min_range`` is no return."""
    pieces: list[Returns] = []
    for first in range(0, count, RAYS_AT_ONCE):
        beam = np.arange(first, min(first + RAYS_AT_ONCE, count))
        origins, directions = rays(beam)
        hits = caster.cast(origins, directions, max_range)
        near = hits.distance < min_range
        if near.any():
            hits = Hits(
                np.where(near, np.inf, hits.distance),
                np.where(near, -1, hits.instance),
                np.where(near, -1, hits.triangle),
            )
        pieces.append(label(caster.scene, hits, directions))
        if progress:
            progress(int(beam[-1]) + 1, count)
    return Returns(
        **{
            name: np.concatenate([getattr(piece, name) for piece in pieces])
            for name in Returns.__dataclass_fields__
        }
    )


def _take(returns: Returns, rows: np.ndarray) -> Returns:
    return Returns(**{n: getattr(returns, n)[rows] for n in Returns.__dataclass_fields__})


def _steps(low: float, high: float, step: float) -> np.ndarray:
    """From ``low`` to at most ``high``, without the drift of adding steps up."""
    return low + step * np.arange(int(np.floor((high - low) / step + 1e-9)) + 1)


def _radians(span_deg: tuple[float, float]) -> tuple[float, float]:
    return float(np.deg2rad(span_deg[0])), float(np.deg2rad(span_deg[1]))
