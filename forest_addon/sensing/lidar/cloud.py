"""A point cloud: what a scanner gives back, with its labels and its truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.rows import RowTable
from .returns import Returns


@dataclass(frozen=True)
class Lost:
    """Pulses from number ``first`` to before ``stop`` that could not be measured, and why."""

    first: int
    stop: int
    why: str

    def __str__(self) -> str:
        last = self.stop - 1
        which = f"pulse {last}" if last == self.first else f"pulses {self.first} to {last}"
        return f"{which} ({self.why})"


@dataclass(frozen=True)
class Cloud(RowTable):
    """P returns of ``pulses`` pulses, sorted by pulse and then by range.

    position : (P, 3) metres, at the measured range on the axis of the beam.
    pulse : (P,) number of the pulse. time : (P,) seconds at which it was sent.
    number, count : (P,) uint8, which return of its pulse, from 1, and of how many.
    azimuth, elevation : (P,) radians, of the axis of the beam. scan_angle : (P,) radians, elevation of a
        scanner on a tripod, angle from nadir of one that moves, right positive.
    intensity : (P,) energy that came back, as a share of a white Lambert surface's at 1 m.
    width : (P,) seconds, standard deviation of the echo; 0 where a pulse has no length.
    true_range : (P,) metres, the range without noise.
    returns : measured range, surface and labels of the P returns.
    velocity, rest : of a scan in a scene that moves, (P, 3) m/s of what was met, and (P, 3) metres where that
        point is when the scene stands as at the frame of the scan; None of a still scene.
    bounce : of a scanner that follows bounces, (P,) int8: 0 direct, 1 by reflection: a ghost where nothing
        stands, 2 straight through glass, 3 refracted; None of others.
    unfollowed : rays that were turned and met a second mirror, glass or water.
    lost : those of the ``pulses`` on which the program failed; a fault of ours, to be reported.
    """

    position: np.ndarray
    pulse: np.ndarray
    time: np.ndarray
    number: np.ndarray
    count: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    scan_angle: np.ndarray
    intensity: np.ndarray
    width: np.ndarray
    true_range: np.ndarray
    returns: Returns
    pulses: int
    engine: str
    lost: tuple[Lost, ...] = ()
    velocity: np.ndarray | None = None
    rest: np.ndarray | None = None
    bounce: np.ndarray | None = None
    unfollowed: int = 0

    def __len__(self) -> int:
        return len(self.pulse)


def join(clouds: Sequence[Cloud]) -> Cloud:
    """One cloud of the pieces of a scan, in order; at least one piece."""
    return dataclasses.replace(
        Cloud.joined(clouds),
        pulses=sum(cloud.pulses for cloud in clouds),
        unfollowed=sum(cloud.unfollowed for cloud in clouds),
        lost=together([lost for cloud in clouds for lost in cloud.lost]),
    )


def together(lost: Sequence[Lost]) -> tuple[Lost, ...]:
    """Lost pulses in order, those that follow each other for the same reason as one."""
    joined: list[Lost] = []
    for one in lost:
        if joined and (joined[-1].stop, joined[-1].why) == (one.first, one.why):
            one = Lost(joined.pop().first, one.stop, one.why)
        joined.append(one)
    return tuple(joined)
