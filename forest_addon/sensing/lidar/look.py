"""Needs of LiDARs where the detail of trees is left to "auto": trajectories, beams and steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...spec import Airborne, Mobile, Terrestrial, Tractor
from ..looks import BeamLook


def look_of_tractor(tractor: Tractor) -> BeamLook:
    """The look of a fan of beams that drives along a straight track."""

    def resolves(away: np.ndarray) -> np.ndarray:
        step = tractor.step * (1 + tractor.gap)
        return np.minimum(step, np.deg2rad(tractor.angle_step_deg) * away)

    def width(distance: float) -> float:
        across = distance * float(np.deg2rad(tractor.angle_step_deg))
        return min(tractor.step, across) if tractor.splits else 0.0

    heading, start = np.deg2rad(tractor.heading_deg), np.array(tractor.position, dtype=float)
    onward = np.array([np.cos(heading), np.sin(heading), 0.0]) * tractor.track
    return BeamLook(
        name=tractor.name,
        corners=np.stack([start, start + onward]),
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
