"""Records of the four LiDARs: SIMLIDAR's tractor, scanners on a tripod, on a vehicle and in an aircraft."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.progress import Progress
from ...base.words import keep
from ...spec import Airborne, Mobile, Terrestrial, Tractor
from ..audit import AuditPart
from ..kind import Cost, Observation, SensorKind, cost_of_rays, why_nothing
from ..looks import BeamLook

if TYPE_CHECKING:
    from ..trajectory import Follower, Trajectory


PLACES = 64  # along a way, that are looked at where nothing was found
MOST_RETURNS = 1.5  # of a pulse, as forests give them


# Needs of LiDARs where the detail of trees is left to "auto": trajectories, beams and steps.


def look_of_tractor(tractor: Tractor) -> BeamLook:
    """The look of a fan of beams that drives along a straight track."""

    def resolves(away: np.ndarray) -> np.ndarray:
        step = tractor.step * (1 + tractor.gap)
        return np.minimum(step, np.deg2rad(tractor.angle_step_deg) * away)

    def width(distance: float) -> float:
        across = distance * float(np.deg2rad(tractor.angle_step_deg))
        return min(tractor.step, across) if tractor.splits else 0.0

    from .tractor import origins_of

    return BeamLook(
        name=tractor.name,
        corners=origins_of(tractor, np.array([0.0, tractor.track])),
        exact_wood=False,
        slack=tractor.step,  # a beam is as wide as a step
        range=tractor.max_range,
        resolves=resolves,
        widths=width,
    )


def look_of_terrestrial(scanner: Terrestrial) -> BeamLook:
    """The look of a scanner on a tripod, whose pulses lie evenly apart."""
    steepest = max(abs(angle) for angle in scanner.elevation_deg)
    across = np.deg2rad(scanner.angle_step_deg) * np.cos(np.deg2rad(min(steepest, 60.0)))
    apart = min(across, np.deg2rad(scanner.line_step_deg or scanner.angle_step_deg))
    return _look(scanner, np.array([scanner.position], dtype=float), float(apart))


def look_of_mobile(scanner: Mobile) -> BeamLook:
    """The look of a scanner on a vehicle; where it goes is known of its own poses alone."""
    at = np.array([pose.position for pose in scanner.poses], dtype=float)
    return _look(scanner, None if scanner.follow or not len(at) else at)


def look_of_airborne(scanner: Airborne) -> BeamLook:
    """The look of a scanner in an aircraft, along its strips."""
    from ..trajectory import strips

    return _look(scanner, strips(scanner).position)


def _look(scanner: Any, corners: np.ndarray | None, apart: float = 0.0) -> BeamLook:
    """``apart``: radians between neighbouring pulses; 0 where lines may meet anywhere."""
    beam = scanner.beam

    def resolves(away: np.ndarray) -> np.ndarray:
        wide = beam.exit_diameter**2 + (1e-3 * min(beam.divergence_mrad) * away) ** 2
        footprint = np.sqrt(wide) if beam.subrays > 1 else np.zeros(len(away))
        return np.asarray(np.maximum(footprint, apart * away))

    def width(distance: float) -> float:
        if beam.subrays == 1:
            return 0.0
        spread = min(beam.divergence_mrad) * 1e-3 * max(distance, scanner.min_range)
        return float(np.hypot(beam.exit_diameter, spread))

    return BeamLook(
        name=scanner.name,
        corners=corners,
        range=scanner.max_range,
        exact_wood=False,
        resolves=resolves,
        widths=width,
    )


# What each kind does when it is asked: its physics is imported then.


def _drive(job: Observation, progress: Progress | None) -> Any:
    from .tractor import drive

    return drive(job.sensor, job.seen.caster, progress)


def _scan(job: Observation, progress: Progress | None) -> Any:
    from .scan import scan

    return scan(job.sensor, job.caster, job.settings.seed, job.trajectory, progress)


def _glance(job: Observation) -> Any:
    from .glance import glance

    return glance(job)


def _lasts(scanner: Any, trajectory: Any) -> float:
    """Seconds until the last pulse of a scan in a scene that moves."""
    from .pattern import pattern_of

    if not scanner.motion:
        return 0.0
    pattern = pattern_of(scanner, trajectory)
    return float(pattern.pulses(np.array([pattern.count - 1])).time[0])


def _audit_drive(job: Observation, found: Any) -> list[AuditPart]:
    from .audit import parts_of_drive

    share = job.settings.accuracy.audit
    return parts_of_drive(job.sensor, found, job.seen.caster, share, job.seen.geometry)


def _audit_scan(job: Observation, found: Any) -> list[AuditPart]:
    from .audit import parts_of_scan
    from .scan import Scan

    share = job.settings.accuracy.audit
    return parts_of_scan(Scan.of(job), found, share, job.seen.geometry)


def _no_hits(job: Observation, found: Any) -> str:
    """The reason why no beam of a tractor met anything."""
    from .tractor import origins_of, positions

    if np.isfinite(found.distance).any():
        return ""
    where = origins_of(job.sensor, np.linspace(0, positions(job.sensor)[-1], PLACES))
    return why_nothing("no beam met anything", where, job.sensor.max_range, job.seen.geometry)


def _no_points(job: Observation, found: Any) -> str:
    """The reason why a scan has no point."""
    from .pattern import pattern_of

    if len(found):
        return ""
    pattern = pattern_of(job.sensor, job.trajectory)
    some = np.linspace(0, pattern.count - 1, PLACES).astype(np.int64)
    where = pattern.pulses(some).origin
    return why_nothing("0 points", where, job.sensor.max_range, job.seen.geometry)


def _cost_of_drive(tractor: Tractor, _trajectory: Any, engine: str) -> Cost:
    beams, scans = tractor.counts
    count = int(beams * scans)
    return cost_of_rays(tractor, count, max(tractor.splits, 1) ** 2, 1.0, engine)


def _cost_of_scan(scanner: Any, trajectory: Any, engine: str) -> Cost:
    from .pattern import pattern_of

    returns = min(scanner.beam.max_returns, MOST_RETURNS)
    count = pattern_of(scanner, trajectory).count
    return cost_of_rays(scanner, count, scanner.beam.subrays, returns, engine)


def _trajectory(scanner: Mobile, _folder: Path, follower: Follower) -> Trajectory | None:
    from ..trajectory import followed, through

    if scanner.follow:
        return followed(follower, scanner.follow, scanner.speed)
    return through(scanner.poses) if scanner.poses else None


def _where_it_starts(job: Observation) -> np.ndarray:
    if job.trajectory is not None:
        return np.asarray(job.trajectory.position[:1])
    return np.array([pose.position for pose in job.sensor.poses[:1]]).reshape(-1, 3)


def _outline(sensor: Any) -> np.ndarray:
    from .glance import outline

    return outline(sensor)


def _fewer_pulses(scanner: Any, share: float) -> dict[str, Any]:
    return {"pulse_rate": scanner.pulse_rate / share}


TRACTOR = SensorKind(
    Tractor,
    run=_drive,
    audit=_audit_drive,
    empty=_no_hits,
    cost=_cost_of_drive,
    outline=_outline,
    look=look_of_tractor,
    glance=_glance,
    family="lidar",
    help=keep("A fan of beams to the side of a tractor, which drives along an orchard's row"),
    icon="MOD_ARRAY",
    posed=("position", "heading_deg"),
    turns=(2,),
    fixed=lambda _: keep("It stays upright"),
)
TERRESTRIAL = SensorKind(
    Terrestrial,
    run=_scan,
    audit=_audit_scan,
    empty=_no_points,
    lasts=_lasts,
    sways=True,
    cost=_cost_of_scan,
    outline=_outline,
    look=look_of_terrestrial,
    glance=_glance,
    thinned=lambda scanner, share: {
        "angle_step_deg": min(scanner.angle_step_deg * share**0.5, 90.0)
    },
    family="lidar",
    help=keep("A scanner on a tripod, which looks all round"),
    icon="OUTLINER_OB_POINTCLOUD",
    posed=("position",),
    turns=(2,),
    fixed=lambda _: keep("It stays upright"),
)
MOBILE = SensorKind(
    Mobile,
    run=_scan,
    audit=_audit_scan,
    empty=_no_points,
    trajectory=_trajectory,
    positions=_where_it_starts,
    lasts=_lasts,
    sways=True,
    cost=_cost_of_scan,
    outline=_outline,
    look=look_of_mobile,
    glance=_glance,
    thinned=_fewer_pulses,
    family="lidar",
    help=keep("Turning beams on a vehicle, which drives along a curve"),
    icon="CURVE_PATH",
    posed=(),
    turns=(),
    fixed=lambda it: keep("Move what it follows") if it.follow else keep("It moves by its poses"),
)
AIRBORNE = SensorKind(
    Airborne,
    run=_scan,
    audit=_audit_scan,
    empty=_no_points,
    lasts=_lasts,
    sways=True,
    cost=_cost_of_scan,
    outline=_outline,
    look=look_of_airborne,
    glance=_glance,
    thinned=_fewer_pulses,
    family="lidar",
    help=keep("A scanner in an aircraft, which flies straight strips"),
    icon="OUTLINER_OB_LIGHTPROBE",
    posed=("position", "heading_deg"),
    turns=(2,),
    fixed=lambda _: keep("It flies level"),
)
