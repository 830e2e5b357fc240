"""Echo of a ping, of a flight of pings, and what each scatterer added: data alone, made by ``ping``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .receiver import Reception
    from .search import SearchGroup
    from .station import SonarPose


@dataclass(frozen=True)
class Contributions:
    """Contributions of M scatterers, the loudest first.

    kind : (M,) text, "leaf", "wood" or "facet". instance, tree, number : (M,) int64, of the scene, the
    stand (-1 where none) and the mesh. position : (M, 3) metres. distance : (M,) metres from the mouth.
    delay : (M,) s at the first ear. amplitude : (M,) mean |A| over the band (Hann).
    velocity, rest : in a scene that moves, (M, 3) m/s at the ping's time, and (M, 3) metres where each is as
    the scene stands still, NaN where it is not there; None in a still one.
    """

    kind: np.ndarray
    instance: np.ndarray
    tree: np.ndarray
    number: np.ndarray
    position: np.ndarray
    distance: np.ndarray
    delay: np.ndarray
    amplitude: np.ndarray
    velocity: np.ndarray | None = None
    rest: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.amplitude)

    def around(self, time: float, sample_rate: float) -> np.ndarray:
        """Rows whose echo lies within a sample of ``time`` s, the loudest first."""
        return np.flatnonzero(np.abs(self.delay - time) <= 1.0 / sample_rate)


@dataclass(frozen=True)
class Echo:
    """The echo of one ping; pressures are relative to what was sent, at 1 m on the axis.

    frequency : (K,) Hz, the band. spectra : (E, K) complex, the transfer function, not windowed.
    time : (N,) s after the call. responses : (E, N) of the band's pulse. envelopes : (E, N) of their
    analytic signals. waveforms : (E, N) of the sonar's call; those of a pulse are the responses.
    called : (E, K) spectra of the waveforms; of a pulse, its transfer function.
    leaves, others : how many leaves, and cylinders and facets before they are
    cut, the scene has of the kinds that sound. near, far, broken, hidden, late : scatterers outside the
    limits of range, not finite, behind wood, after the end of the record. close : leaves in the sum that
    are nearer than ka²/2 (a their radius, k the largest wavenumber), where a disc's far field is far off.
    doubtful : exact discs of ka above 120 seen more than 60° off their normal, tens of per cent off.
    cull_bound : all that is left out as too weak adds at most this share of Σ|A| of what is heard.
    error_bound, table_error : of Σ max|A|, by which the spectra may be off the direct sum, and by which
    this may be off because the exact disc and cylinders are looked up. size : (E,) Σ max|A| of these.
    groups : what is in the sum, by kind. moments : how many of the scene the pieces of its call met.
    received : what the sonar's receiver makes of the waveforms; None where it has none.
    """

    frequency: np.ndarray
    spectra: np.ndarray
    called: np.ndarray
    time: np.ndarray
    responses: np.ndarray
    envelopes: np.ndarray
    waveforms: np.ndarray
    leaves: int
    others: int
    near: int
    far: int
    broken: int
    hidden: int
    late: int
    close: int
    doubtful: int
    cull_bound: float
    error_bound: float
    table_error: float
    size: np.ndarray
    groups: list[SearchGroup]
    sound_speed: float
    sample_rate: float
    pose: SonarPose
    list_heard: Callable[[], Contributions]
    moments: int = 1
    received: Reception | None = None

    @cached_property
    def heard(self) -> Contributions:
        """Contributions to the sum; listed when they are first asked for."""
        return self.list_heard()

    @property
    def heard_waveforms(self) -> np.ndarray:
        """(E, N) re the call at 1 m, as the receiver records them, where there is one."""
        if self.received is None:
            return self.waveforms
        return self.received.recorded / self.received.pressure

    @property
    def spectrum(self) -> np.ndarray:
        """(K,) at the first ear."""
        return np.asarray(self.spectra[0])

    @property
    def impulse_response(self) -> np.ndarray:
        """(N,) at the first ear."""
        return np.asarray(self.responses[0])

    @property
    def envelope(self) -> np.ndarray:
        """(N,) at the first ear."""
        return np.asarray(self.envelopes[0])

    @property
    def leaves_heard(self) -> int:
        """Number of leaves in the sum; a near one has several pieces."""
        leaf = self.heard.kind == "leaf"
        names = np.stack([self.heard.instance[leaf], self.heard.number[leaf]])
        return len(np.unique(names, axis=1).T)


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
