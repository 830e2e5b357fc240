"""Pings along a way: one echo a pose, as one set of arrays.

A bat that flies past trees sends call after call; ``fly`` pings from every pose of a list. Records differ
in length with what is heard; stacked, they are padded with silence to the longest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.progress import Progress
from ...spec import Air, Sonar
from ..rays.caster import RayCaster
from .ping import Echo, ping
from .poses import SonarPose
from .station import Equipment
from .targets import EchoTargets


@dataclass(frozen=True)
class PingSeries:
    """P echoes, one a pose, in order."""

    echoes: tuple[Echo, ...]

    def __len__(self) -> int:
        return len(self.echoes)

    @property
    def time(self) -> np.ndarray:
        """(N,) s after each call, of the longest record."""
        return max((echo.time for echo in self.echoes), key=len)

    def stacked(self, name: str) -> np.ndarray:
        """(P, E, N) ``responses``, ``envelopes`` or ``waveforms``, padded with 0 to one length."""
        arrays = [getattr(echo, name) for echo in self.echoes]
        whole = np.zeros((len(arrays), len(arrays[0]), len(self.time)))
        for row, array in zip(whole, arrays, strict=True):
            row[:, : array.shape[1]] = array
        return whole

    def poses(self) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3) positions in metres and (P, 3) unit axes of the beam."""
        poses = [echo.pose for echo in self.echoes]
        return np.array([p.position for p in poses]), np.array([p.frame[0] for p in poses])


def fly(
    targets: EchoTargets,
    sonar: Sonar,
    air: Air,
    poses: Sequence[SonarPose],
    wood: RayCaster | None = None,
    progress: Progress | None = None,
    *,
    equipment: Equipment | None = None,
    everything: RayCaster | None = None,
) -> PingSeries:
    """Ping from every pose; arguments as of ``ping``, progress counts poses.

    Raises
    ------
    ValueError : there is no pose; as ``ping``.
    """
    if not len(poses):
        raise ValueError("a flight needs at least one pose")
    equipment = equipment or Equipment.of(sonar)
    echoes = []
    for number, pose in enumerate(poses):
        found = ping(
            targets, sonar, air, wood, pose=pose, equipment=equipment, everything=everything
        )
        echoes.append(found)
        if progress:
            progress(number + 1, len(poses))
    return PingSeries(tuple(echoes))
