"""A sonar at one pose in the air: what its beams, the distance and the air do to an echo.

A pose is a place, a frame (the beam's axis, left, up) and a velocity. ``posed`` makes one from settings,
``poses_of`` many from a trajectory.

For a scatterer at the distances r_t from where the call starts and r_e from ear e,

    gain_e(f) = S_emit(f)·S_hear,e(f)/(r_t·r_e)·e^{-b(f)(r_t + r_e)},

b the absorption; the scattering amplitude times this, at the delay (r_t + r_e)/c, is its echo. Scattering
itself is taken half way between mouth and ear: for ears a few centimetres apart that is right to the
second order of the angle between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from ... import kernels
from ...acoustics.air import absorption
from ...base.rows import RowTable
from ...spec import Air, Sonar
from ..trajectory import Trajectory, frame_of
from .beam import BeamPattern, GaussianBeam, Horseshoe, Omni, beam_offsets
from .calls import Call, synthesise
from .receiver import EchoReceiver
from .targets import Candidates


@dataclass(frozen=True)
class SonarPose:
    """One place of a sonar.

    position : (3,) metres. frame : (3, 3) rows: the axis of the beam, to its left, up.
    velocity : (3,) m/s. width : full -3 dB width in radians instead of the sonar's own, or None.
    time : s, when it pings.
    """

    position: np.ndarray
    frame: np.ndarray
    velocity: np.ndarray
    width: float | None = None
    time: float = 0.0


def posed(sonar: Sonar) -> SonarPose:
    """The pose that the settings say; its speed is along the beam."""
    frame = frame_of(math.radians(sonar.azimuth_deg), math.radians(sonar.elevation_deg))
    return SonarPose(np.asarray(sonar.position, dtype=np.float64), frame, sonar.speed * frame[0])


def poses_of(trajectory: Trajectory) -> list[SonarPose]:
    """The poses of a trajectory; one that says no velocity stands still at each."""
    count = len(trajectory)
    velocity = np.zeros((count, 3)) if trajectory.velocity is None else trajectory.velocity
    width = [None] * count if trajectory.width is None else trajectory.width.tolist()
    time = trajectory.time.tolist()
    each = zip(trajectory.position, trajectory.frames, velocity, width, time, strict=True)
    return [SonarPose(*one) for one in each]


@dataclass(frozen=True)
class Ears:
    """E receivers in the frame of the sonar: ``offset`` (E, 3) metres from where the call is sent,
    ``frame`` (E, 3, 3) of their own axis, left and up, in the sonar's frame."""

    offset: np.ndarray
    frame: np.ndarray

    def __len__(self) -> int:
        return len(self.offset)

    @classmethod
    def of(cls, sonar: Sonar) -> Ears:
        """Evenly on a line across the beam, the first to the left; a single one where the call starts."""
        side = np.linspace(1.0, -1.0, sonar.ears) if sonar.ears > 1 else np.zeros(1)
        offset = np.zeros((sonar.ears, 3))
        offset[:, 1] = side * sonar.ear_spacing / 2
        turn = np.deg2rad(sonar.ear_turn_deg) * side
        return cls(offset, np.array([frame_of(float(a), 0.0) for a in turn]))


@dataclass(frozen=True)
class Equipment:
    """Equipment of a sonar: beams of call and ears, and the call, None for a pulse of the band.

    hears : a pattern for each ear, or one for all. receiver : None where echoes are heard as they are.
    """

    emit: BeamPattern
    hears: tuple[BeamPattern, ...]
    call: Call | None
    receiver: EchoReceiver | None = None

    @classmethod
    def of(
        cls,
        sonar: Sonar,
        emit: BeamPattern | None = None,
        hears: tuple[BeamPattern, ...] = (),
        call: Call | None = None,
        transducer: Call | None = None,
        noise: Call | None = None,
    ) -> Equipment:
        """Receiver of the settings; what they have in files is given.

        transducer : the receiver's impulse response. noise : pascals that it hears.

        Raises
        ------
        ValueError : a file's content is wanted and not given.
        """
        emit = emit or _beam(sonar.beam, sonar.beam_width_deg, "beam")
        if not hears:
            same = sonar.hearing == "same"
            hears = (emit if same else _beam(sonar.hearing, sonar.hearing_width_deg, "hearing"),)
        if call is None and sonar.call in ("fm", "cf-fm"):
            call = synthesise(sonar)
        if call is None and sonar.call == "file":
            raise ValueError("the call's WAV file has not been read; give its samples")
        receiver = None
        if sonar.receiver is not None:
            receiver = EchoReceiver(sonar, call, transducer, noise)
            for given, name in ((transducer, "transducer_file"), (noise, "noise_file")):
                if given is None and getattr(sonar.receiver, name):
                    raise ValueError(f"the receiver's {name} has not been read; give its samples")
        return cls(emit, hears, call, receiver)

    def hear(self, ear: int) -> BeamPattern:
        """The pattern of an ear."""
        return self.hears[ear if len(self.hears) > 1 else 0]

    def widened(self, width: float | None) -> Equipment:
        """A copy with Gaussian beams of another width (radians), where a pose has one."""
        if width is None or type(self.emit) is not GaussianBeam:
            return self
        emit = GaussianBeam((width, width))
        hears = tuple(emit if hear is self.emit else hear for hear in self.hears)
        return replace(self, emit=emit, hears=hears)


def _beam(kind: str, width_deg: tuple[float, float], name: str) -> BeamPattern:
    if kind == "gaussian":
        return GaussianBeam((math.radians(width_deg[0]), math.radians(width_deg[1])))
    if kind == "horseshoe":
        return Horseshoe()
    if kind == "omni":
        return Omni()
    raise ValueError(f"the {name}'s CSV file has not been read; give its pattern")


@lru_cache(maxsize=256)
def _absorbed(frequency: bytes, air: Air) -> np.ndarray:
    """(Q,) nepers per metre at frequencies (Q,) float64; kept, since nodes are the same from ping to ping."""
    return absorption(np.frombuffer(frequency), air.temperature_c, air.humidity, air.pressure_kpa)


class Station:
    """A sonar with its equipment at one pose in the air."""

    def __init__(self, sonar: Sonar, air: Air, pose: SonarPose, equipment: Equipment) -> None:
        self.sonar, self.air, self.pose = sonar, air, pose
        self.equipment = equipment.widened(pose.width)
        ears = Ears.of(sonar)
        self.point = pose.position
        self.ear = pose.position + ears.offset @ pose.frame  # (E, 3)
        self.ear_frame = ears.frame @ pose.frame  # (E, 3, 3)
        self.apart = float(np.linalg.norm(ears.offset, axis=1).max())
        self.sound_speed = air.speed()
        self.least_loss = float(self.loss(np.array([sonar.band[0]]))[0])
        self.wavenumbers = tuple(2.0 * math.pi * f / self.sound_speed for f in sonar.band)

    def loss(self, frequency: np.ndarray) -> np.ndarray:
        """(Q,) absorption in nepers per metre."""
        if not self.sonar.absorption:
            return np.zeros(len(frequency))
        return _absorbed(frequency.tobytes(), self.air)

    def ceiling(self, some: Candidates) -> np.ndarray:
        """(P,) no block adds more than this to Σ|A|, at any ear and frequency of the band."""
        towards = some.centre - self.point
        distance = np.linalg.norm(towards, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            towards = towards / distance[:, None]
            seen = np.arcsin(np.minimum((some.radius + self.apart) / distance, 1.0))
        seen = np.where(distance > some.radius + self.apart, seen, math.pi)
        axes = np.concatenate([self.pose.frame[None, 0], self.ear_frame[:, 0]])
        off = np.arccos(np.clip(np.nan_to_num(towards) @ axes.T, -1.0, 1.0))  # (P, 1 + E)
        off = np.maximum(off - np.nan_to_num(seen, nan=math.pi)[:, None], 0.0)
        band, equipment = self.sonar.band, self.equipment
        gain = equipment.emit.ceiling(off[:, 0], band)
        off_ears = off[:, 1:].min(axis=1)
        gain = gain * np.max([hear.ceiling(off_ears, band) for hear in equipment.hears], axis=0)
        back = np.maximum(some.nearest - self.apart, 0.5 * self.sonar.near_limit)
        return (
            some.strength
            * gain
            * np.exp(-self.least_loss * (some.nearest + back))
            / (some.nearest * back)
        )

    @cached_property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Mouth and ears: places (1 + E, 3) and frames (1 + E, 3, 3)."""
        places = np.concatenate([self.point[None], self.ear])
        return places, np.concatenate([self.pose.frame[None], self.ear_frame])

    @cached_property
    def steepness(self) -> np.ndarray:
        """(1 + E, 2) of the beams: ``BeamPattern.steepness``."""
        hears = (self.equipment.hear(ear) for ear in range(len(self.ear)))
        return np.array([beam.steepness for beam in (self.equipment.emit, *hears)])

    def paths(self, centre: np.ndarray) -> EchoPaths:
        """The ways from the mouth by places (M, 3) to the ears."""
        ends, frames = self.ends
        library = kernels.library()
        if library is not None:
            paths = EchoPaths.empty(len(centre), len(ends))
            library.trace_paths(
                *(len(centre), np.ascontiguousarray(centre), len(ends), ends, frames),
                *vars(paths).values(),
            )
            return paths
        with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is told by who asks
            ways = centre - ends[:, None]
            away = np.linalg.norm(ways, axis=2)
            ways /= away[:, :, None]
            offsets = [beam_offsets(*each) for each in zip(ways, frames, strict=True)]
        return EchoPaths(away.T, np.transpose(offsets, (2, 0, 1)))


@dataclass(frozen=True)
class EchoPaths(RowTable):
    """M ways by a scatterer to E ears.

    away : (M, 1 + E) metres from the mouth and from the ears. offset : (M, 1 + E, 2) radians off the beam's
    axis and off the ears'.
    """

    away: np.ndarray
    offset: np.ndarray

    @classmethod
    def empty(cls, count: int, ends: int) -> EchoPaths:
        """Ways that are not known yet."""
        return cls(np.empty((count, ends)), np.empty((count, ends, 2)))

    @property
    def distance(self) -> np.ndarray:
        """(M,) from the mouth."""
        return self.away[:, 0]

    @property
    def leg(self) -> np.ndarray:
        """(M, E) from scatterer to ear."""
        return self.away[:, 1:]

    @property
    def length(self) -> np.ndarray:
        """(M, E) metres from mouth to ear."""
        return self.distance[:, None] + self.leg

    @property
    def latest(self) -> float:
        """Metres of the longest way, of one or more."""
        return max(float((self.distance + leg).max()) for leg in self.leg.T)

    def bound(self, station: Station) -> np.ndarray:
        """(M,) no gain in the band is larger, at any ear."""
        band, equipment = station.sonar.band, station.equipment
        azimuth, elevation = self.offset[:, 0].T
        sent = equipment.emit.loudest(azimuth, elevation, band)
        most = np.zeros(len(sent))
        for ear, leg in enumerate(self.leg.T):
            azimuth, elevation = self.offset[:, 1 + ear].T
            heard = equipment.hear(ear).loudest(azimuth, elevation, band)
            weaker = np.exp(-station.least_loss * (self.distance + leg)) / (self.distance * leg)
            most = np.maximum(most, sent * heard * weaker)
        return most
