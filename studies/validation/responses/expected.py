"""Energy that a plausible stand is expected to send to a receiver, by octave and path length, and its decay.

Direct sound and ground as waves, what trunks scatter once and again, and what branches and leaves turn: the
mean over all places that trunks may have, which costs no sum over them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand
from forest_addon.sensing.reverb.forest.surroundings import FoliageCanopy, clutter_around
from forest_addon.sensing.reverb.forest.tail import tail_of
from forest_addon.sensing.reverb.forest.transport import Density, Sent

from .stands import Path, PlausibleStand, settings

STEPS = 400  # lengths at which energy is computed
LINES = np.geomspace(0.71, 1.41, 24)  # of an octave
EARLY = 0.05  # s, of C50


@dataclass(frozen=True)
class ExpectedEnergy:
    """Re the source's at 1 m. direct (B,); scattered (B, X) a metre at path lengths (X,) m."""

    direct: np.ndarray
    length: np.ndarray
    scattered: np.ndarray

    def decay(self, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """T20 in s and C50 in dB, (B,) each."""
        found = []
        for direct, scattered in zip(self.direct, self.scattered, strict=True):
            heard = cumulative_trapezoid(scattered, self.length, initial=0.0)
            left = heard[-1] - heard
            time = (self.length - self.length[0]) / speed
            level = 10.0 * np.log10(np.maximum(left, 1e-30) / (direct + heard[-1]))
            even = np.linspace(0.0, time[-1], 6000)
            curve = np.interp(even, time, level)
            used = (curve <= -5.0) & (curve >= -25.0)
            slope = np.polyfit(even[used], curve[used], 1)[0] if used.sum() > 2 else np.nan
            late = float(np.interp(EARLY, time, left))
            found.append((-60.0 / slope, 10.0 * np.log10((direct + heard[-1] - late) / late)))
        t20, c50 = np.array(found).T
        return t20, c50


def expected_energy(
    stand: PlausibleStand,
    path: Path,
    bands: np.ndarray,
    last: float,
    packets: int,
    sent: Callable[[float], Sent] | None = None,
) -> ExpectedEnergy:
    """Of octaves (B,) for ``last`` seconds. sent : by frequency, energy that the source sends by ways."""
    reverb = settings(stand, path)
    canopy = replace(FoliageCanopy(), top=stand.trunk_height, clutter=stand.clutter)
    around = TrunkStand(
        stand.density,
        (stand.radius,),
        stand.leaf_area_density,
        stand.trunk_height,
        clutter_around(reverb, canopy),
        stand.floor_leaf_area,
    )
    ends = np.array(reverb.source), np.array(reverb.receiver)
    losses = Losses.of(reverb, path.air, around, *ends)
    key = stand.number, "range"
    tail = tail_of(reverb, losses, Density.even(stand.density), *ends, last, key, packets, sent)
    assert tail is not None
    speed, distance = path.air.speed(), path.distance
    length = np.geomspace(distance * 1.001, last * speed, STEPS)
    direct, scattered = [], []
    for band in bands:
        row = int(np.flatnonzero(tail.band == band)[0])
        once, again = (part[row] for part in tail.energies(length))
        lost = np.exp(-2.0 * np.outer(losses.along(band * LINES), length)).mean(axis=0)
        ground = np.mean([losses.unthinned.mean_square(f, length) for f in band * LINES], axis=0)
        found = (once + again) * ground * lost
        if tail.diffuse is not None:
            of_air = float(losses.of_air(np.array([band]))[0])
            found = found + tail.turned(row, length) * np.exp(-2.0 * of_air * length)
        scattered.append(found)
        straight = losses.unthinned.mean_square(band * LINES, np.array(distance))
        taken = 2.0 * losses.along(band * LINES) + losses.removed(band * LINES)
        direct.append(float(np.mean(straight * np.exp(-taken * distance))) / distance**2)
    return ExpectedEnergy(np.array(direct), length, np.array(scattered))
