"""How each kind of sensor looks at trees: from where, how far, and how fine it tells things apart.

A ``Look`` is what ``detail`` asks of a sensor; there is one class for beams, one for echoes and one for
responses, and ``LOOKS`` says which kind has which.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from ..acoustics.disc import backscatter
from ..spec import Airborne, Mobile, Reverb, Sensor, Sonar, Terrestrial, Tractor

TOGETHER = 50  # coarse leaves that must sound as one
LOUDNESS = 0.05  # the energy that coarse leaves may send back more or less, as a share
SHARE = 0.25  # of its leaves that a coarse tree has
SOUND = 340.0  # m/s, rounded: N is a matter of factors
ORIENTATIONS = 500


@dataclass(frozen=True)
class Upright:
    """N trees as upright cylinders.

    place : (N, 2) metres. reach : (N,) radius of the cylinder, m. low, high : (N,) heights of its ends, m.
    """

    place: np.ndarray
    reach: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def distance(self, corners: np.ndarray) -> np.ndarray:
        """(N,) metres, or less, from each tree to the nearest place of a line through corners (P, 3)."""
        aside = np.full(len(self.place), np.inf)
        for a, b in pairwise(corners if len(corners) > 1 else corners[[0, 0]]):
            step = b[:2] - a[:2]
            at = np.clip(((self.place - a[:2]) @ step) / max(float(step @ step), 1e-12), 0, 1)
            aside = np.minimum(aside, np.hypot(*(self.place - a[:2] - at[:, None] * step).T))
        aside = np.maximum(aside - self.reach, 0)
        lowest, highest = corners[:, 2].min(), corners[:, 2].max()
        over = np.maximum(np.maximum(lowest - self.high, self.low - highest), 0)
        return np.asarray(np.hypot(aside, over))


@dataclass(frozen=True)
class Leafy(Upright):
    """The same with the coarse leaves of trees that can have such.

    length : (N,) of the longest coarse leaf, m; 0: it has none. radius : (N,) of the disc of a full leaf, m;
    0 of needles. density : (N,) coarse leaves in a cubic metre of the crown.
    """

    length: np.ndarray
    radius: np.ndarray
    density: np.ndarray


@dataclass(frozen=True)
class Look:
    """A sensor as ``detail`` asks it; this one hears trees wherever they are.

    name : of the sensor. corners : (P, 3) of its trajectory, m; None where it is not known before the sensor
    runs. range : m, beyond which it finds nothing. leaves : whether a leaf may change what it finds.
    exact_wood : whether wood must be known as it is set. slack : m that it may reach beside its trajectory.
    """

    name: str
    corners: np.ndarray | None = None
    range: float = np.inf
    leaves: bool = True
    exact_wood: bool = True
    slack: float = 0.0

    tells_leaves = False  # whether it can tell one leaf from another
    meets_wood = False  # by beams

    def distance(self, trees: Upright) -> np.ndarray:
        """(N,) metres, or less, to each tree; 0 where the trajectory is not known."""
        if self.corners is None:
            return np.zeros(len(trees.place))
        return np.maximum(trees.distance(self.corners) - self.slack, 0.0)

    def blurs(self, trees: Leafy, away: np.ndarray) -> np.ndarray:
        """(N,) bool, whether coarse leaves of trees at distances (N,) are as good as all."""
        raise NotImplementedError

    def why_blurred(self, trees: Leafy, away: np.ndarray, row: int) -> str:
        """The reason in words, of a tree."""
        raise NotImplementedError

    def footprint(self, distance: float) -> float:
        """Metres across the narrowest that a beam is at a distance or beyond; 0: a line."""
        raise NotImplementedError


@dataclass(frozen=True)
class BeamLook(Look):
    """A scanner: ``resolves`` gives (N,) metres that it tells apart at distances (N,), ``widths`` the
    footprint at one."""

    resolves: Callable[[np.ndarray], np.ndarray] = np.zeros_like
    widths: Callable[[float], float] = float

    tells_leaves = True
    meets_wood = True

    def blurs(self, trees: Leafy, away: np.ndarray) -> np.ndarray:
        return np.asarray(self.resolves(away) >= trees.length)

    def why_blurred(self, trees: Leafy, away: np.ndarray, row: int) -> str:
        fine, long = 100 * self.resolves(away)[row], 100 * trees.length[row]
        return f"which tells {fine:.1f} cm apart there; leaves have up to {long:.1f} cm"

    def footprint(self, distance: float) -> float:
        return self.widths(distance)


@dataclass(frozen=True)
class EchoLook(Look):
    """A sonar; ``beam_width`` is the narrowest full width in radians, ``band`` in Hz."""

    beam_width: float = 0.0
    band: tuple[float, float] = (0.0, 1.0)
    hears_leaves: bool = True

    tells_leaves = True

    def blurs(self, trees: Leafy, away: np.ndarray) -> np.ndarray:
        if not self.hears_leaves:
            return np.ones(len(away), dtype=bool)
        many = self.heard_together(trees, away) >= TOGETHER
        sizes, which = np.unique(np.round(trees.radius, 4), return_inverse=True)
        louder = np.array([loudness(self.band, float(size)) for size in sizes])
        return many & (np.abs(louder - 1) <= LOUDNESS)[which] & (trees.radius > 0)

    def why_blurred(self, trees: Leafy, away: np.ndarray, row: int) -> str:
        many = self.heard_together(trees, away)[row]
        louder = loudness(self.band, round(float(trees.radius[row]), 4))
        return f"where {many:.0f} sound as one, {10 * np.log10(louder):+.2f} dB"

    def heard_together(self, trees: Leafy, away: np.ndarray) -> np.ndarray:
        """(N,) coarse leaves in the beam within half a pulse, at the distances of trees (N,)."""
        low, high = self.band
        deep = SOUND / (2 * max(high - low, 1.0))
        across = np.minimum(away * self.beam_width, 2 * trees.reach)
        return np.asarray(trees.density * np.pi / 4 * across**2 * np.minimum(deep, trees.reach))


@cache
def loudness(band: tuple[float, float], radius: float) -> float:
    """Energy that coarse discs send back over that of full ones of this radius, metres, facing all ways."""
    t = (np.arange(ORIENTATIONS) + 0.5) / ORIENTATIONS
    angle = np.pi / 2 * t**2  # close together straight on, where a large disc glints
    weight = np.sin(angle) * t
    k = 2 * np.pi * np.linspace(*band, 15) / SOUND

    def energy(a: float) -> float:
        return float((weight * (backscatter((k * a)[:, None], angle) / k[:, None]) ** 2).sum())

    return SHARE * energy(radius / np.sqrt(SHARE)) / max(energy(radius), 1e-300)


def _of_tractor(tractor: Tractor) -> Look:
    def resolves(away: np.ndarray) -> np.ndarray:
        step = tractor.step * (1 + tractor.gap)
        return np.minimum(step, np.deg2rad(tractor.angle_step_deg) * away)

    def width(distance: float) -> float:
        across = distance * float(np.deg2rad(tractor.angle_step_deg))
        return min(tractor.step, across) if tractor.splits else 0.0

    return BeamLook(
        name=tractor.name,
        corners=_straight(tractor),
        exact_wood=False,
        slack=tractor.step,  # a beam is as wide as a step
        range=tractor.max_range,
        resolves=resolves,
        widths=width,
    )


def _of_scanner(
    scanner: Terrestrial | Mobile | Airborne, corners: np.ndarray | None, apart: float = 0.0
) -> Look:
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


def _of_terrestrial(scanner: Terrestrial) -> Look:
    steepest = max(abs(angle) for angle in scanner.elevation_deg)
    across = np.deg2rad(scanner.angle_step_deg) * np.cos(np.deg2rad(min(steepest, 60.0)))
    apart = min(across, np.deg2rad(scanner.line_step_deg or scanner.angle_step_deg))
    return _of_scanner(scanner, np.array([scanner.position], dtype=float), float(apart))


def _of_mobile(scanner: Mobile) -> Look:
    at = np.array([pose.position for pose in scanner.poses], dtype=float)
    return _of_scanner(scanner, None if scanner.follow or not len(at) else at)


def _of_airborne(scanner: Airborne) -> Look:
    return _of_scanner(scanner, _straight(scanner, scanner.strips, scanner.spacing))


def _of_sonar(sonar: Sonar) -> Look:
    moves = bool(sonar.route or sonar.follow)
    narrow = min(sonar.beam_width_deg) if sonar.beam == "gaussian" else 10.0
    return EchoLook(
        name=sonar.name,
        corners=None if moves else np.array([sonar.position], dtype=float),
        range=sonar.max_range,
        leaves=sonar.leaves or "extinction" in sonar.shading,
        exact_wood=sonar.wood or "trunks" in sonar.shading,
        beam_width=float(np.deg2rad(narrow)),
        band=sonar.band,
        hears_leaves=sonar.leaves,
    )


def _of_reverb(reverb: Reverb) -> Look:
    return Look(name=reverb.name, leaves=reverb.model == "forest")


def _straight(sensor: Any, strips: int = 1, spacing: float = 0.0) -> np.ndarray:
    """(P, 3) corners of straight parallel lines, back and forth."""
    heading, start = np.deg2rad(sensor.heading_deg), np.array(sensor.position, dtype=float)
    onward = np.array([np.cos(heading), np.sin(heading), 0.0]) * sensor.track
    right = np.array([np.sin(heading), -np.cos(heading), 0.0])
    starts = [start + k * spacing * right for k in range(strips)]
    return np.concatenate([[s, s + onward][:: 1 - 2 * (k % 2)] for k, s in enumerate(starts)])


LOOKS: dict[str, Callable[[Any], Look]] = {
    "tractor": _of_tractor,
    "terrestrial": _of_terrestrial,
    "mobile": _of_mobile,
    "airborne": _of_airborne,
    "sonar": _of_sonar,
    "reverb": _of_reverb,
}


def look_of(sensor: Sensor) -> Look:
    """How a sensor looks at trees."""
    return LOOKS[sensor.kind](sensor)
