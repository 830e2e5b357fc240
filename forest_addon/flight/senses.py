"""Senses of flyers: distances by LiDAR, echoes at two ears, and an idea of their own motion.

Poses go in, arrays come out, a row a flyer; the rays of all flyers are cast in one call. A scan is that of
the mobile scanner at the flyer's pose, as ``World.scan`` makes it, to the bit: where pulses are single rays
that nothing disturbs, their distances are all there is to it, else the whole scan is made. A ping is that of
``World.ping`` likewise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import fft
from scipy.spatial.transform import Rotation

from ..base.rng import stream
from ..sensing.lidar.pattern import Sweep
from ..sensing.lidar.scan import Scan
from ..sensing.sonar.echo import Echo
from ..sensing.sonar.equipment_files import equip
from ..sensing.sonar.ping import ping
from ..sensing.sonar.station import SonarPose as Place
from ..sensing.trajectory import Trajectory, frame_of, through
from ..spec import Air, Flight, Mobile, Pose, Scene, Sonar
from .bodies import State

FLOOR_DB, TOP_DB = -120.0, -20.0  # what a cochleagram shows, re the call at 1 m
HEARD = ("cochleagram", "waveforms")
BANDS, BINS = 8, 64  # of a cochleagram

# 64 rays all around at the flyer's height.
LIDAR = Mobile(
    name="lidar",
    pattern="spinning",
    channels=1,
    field_deg=(0.0, 1.0),
    pulse_rate=1280.0,
    line_rate=20.0,
    max_range=20.0,
    min_range=0.0,
    poses=(Pose(),),
)
# A bat's sweeps, heard with two ears that are turned outwards.
SONAR = Sonar(
    name="sonar",
    ears=2,
    ear_spacing=0.015,
    ear_turn_deg=30.0,
    beam_width_deg=(60.0, 60.0),
    hearing="gaussian",
    hearing_width_deg=(60.0, 60.0),
    band=(40e3, 80e3),
    sample_rate=250e3,
    call="fm",
    max_range=6.0,
    leaf_model="piston",
    shading="none",
    facets=False,
    cull=0.05,
    tolerance=1e-3,
)


def lidar_of(scene: Scene) -> Mobile:
    """The scene's first mobile scanner that a flyer can carry, or 64 rays all around."""
    scanners = (s for s in scene.sensors if isinstance(s, Mobile) and not s.follow)
    return next(scanners, LIDAR)


def sonar_of(scene: Scene) -> Sonar:
    """The scene's first sonar that stays where it is put, or a bat's."""
    sonars = (s for s in scene.sensors if isinstance(s, Sonar) and not (s.route or s.follow))
    return next(sonars, SONAR)


def degrees(state: State, row: int) -> tuple[float, float, float]:
    """Heading, pitch and roll of a flyer as a person would type them: those of ``Pose``, nose up positive."""
    heading = float(np.rad2deg(state.heading[row]))
    return heading, float(-np.rad2deg(state.tilt[row, 0])), float(np.rad2deg(state.tilt[row, 1]))


class LidarSense:
    """A mobile scanner that flyers carry.

    ways : (R, 3) of its rays, ahead along +X. level : those that are level enough to fly by, and their angles
    to the left, radians.
    """

    def __init__(self, scanner: Mobile) -> None:
        self.scanner = scanner
        self._sweep = Sweep(scanner, through([Pose()]))
        self.rays = self._sweep.count
        self.ways, _, _ = self._sweep.ways(np.arange(self.rays))
        self._after = np.arange(self.rays) / scanner.pulse_rate
        level = np.flatnonzero(np.abs(self.ways[:, 2]) < 0.3)
        self.level = level, np.arctan2(self.ways[level, 1], self.ways[level, 0])
        beam, surfaces = scanner.beam, scanner.surfaces
        white = min(surfaces.other, surfaces.wood, surfaces.leaf, surfaces.ground) > 0
        self.exact = (  # nothing is left to chance, nothing is weighed
            beam.subrays == 1
            and white
            and surfaces.leaf_transmittance == 0
            and scanner.faintest == 0
            and scanner.noise == type(scanner.noise)()
        )
        self._scan: tuple[Any, Scan] | None = None

    def look(
        self, around: Any, state: State, seeds: np.ndarray, time: np.ndarray | None = None
    ) -> np.ndarray:
        """(N, R) metres to what each ray meets first, the largest range where it meets nothing.

        seeds : (N,) of chances and noise, where the scanner has any. time : (N,) s, when each flyer's first
        pulse goes out, in a world that moves; left out: 0.
        """
        time = np.zeros(len(state)) if time is None else time
        # As a path of the same pose has it: through degrees, as settings say angles. Nose down is a turn
        # about the left.
        angles = np.deg2rad(np.rad2deg(np.column_stack([state.heading, state.tilt])))
        attitude = Rotation.from_euler("ZYX", angles)
        if not (self.exact and np.isnan(around.geometry.reflectance).all()):
            return np.array(
                [
                    self._whole(around, state.position[row], attitude[[row]], int(seed), time[row])
                    for row, seed in enumerate(seeds)
                ]
            )
        turn = (attitude * self._sweep.mount).as_matrix()
        ways = np.einsum("njk,rk->nrj", turn, self.ways).reshape(-1, 3)
        origins = np.repeat(state.position, self.rays, axis=0)
        most = self.scanner.max_range
        when = (time[:, None] + self._after).ravel()
        distance = around.caster.cast(origins, ways, most, time=when).distance
        distance[(distance < self.scanner.min_range) | (distance > most)] = most
        return distance.reshape(len(state), self.rays)

    def _whole(
        self, around: Any, place: np.ndarray, attitude: Rotation, seed: int, time: float
    ) -> np.ndarray:
        if self._scan is None or self._scan[0] is not around:
            self._scan = (around, Scan(self.scanner, around.caster, seed, through([Pose()])))
        path = Trajectory(np.array([time]), place[None], attitude)
        cloud = self._scan[1].moved(seed, path).look(0, self.rays)
        distance = np.full(self.rays, self.scanner.max_range)
        first = cloud.number == 1
        distance[cloud.pulse[first]] = cloud.returns.distance[first]
        return np.clip(distance, 0.0, self.scanner.max_range)


class EarSense:
    """A sonar that flyers carry; through its receiver, where it has one.

    heard : what is told of an echo, ``cochleagram`` (E, BANDS, BINS) from 0 (``FLOOR_DB``) to 1
    (``TOP_DB``), or ``waveforms`` (E, S) re the call at 1 m. folder : that names of its files start from.
    """

    def __init__(
        self, sonar: Sonar, air: Air, heard: str = "cochleagram", folder: str | Path = "."
    ) -> None:
        speed = air.speed()
        if not sonar.record:
            lasts = sonar.call_duration if sonar.call != "impulse" else 0.0
            sonar = sonar.changed(record=2.0 * sonar.max_range / speed + lasts)
        self.sonar, self.air, self.heard = sonar, air, heard
        self._equipment = equip(sonar, Path(folder))
        self.samples = math.ceil(sonar.record * sonar.sample_rate)
        shape = (BANDS, BINS) if heard == "cochleagram" else (self.samples,)
        self.shape = (sonar.ears, *shape)

    def place(self, state: State, row: int = 0, time: float = 0.0) -> Place:
        """Pose of a flyer's sonar at a time, s."""
        heading, pitch, _ = degrees(state, row)
        frame = frame_of(math.radians(heading), math.radians(pitch))
        velocity = self.sonar.speed * frame[0]
        return Place(state.position[row].copy(), frame, velocity, time=time)

    def ping(
        self,
        around: Any,
        state: State,
        row: int = 0,
        time: float = 0.0,
        seed: int = 0,
        number: int = 0,
    ) -> Echo:
        """One ping at a time, s. seed, number : of the flyer and its ping, for the receiver's noise."""
        shading = self.sonar.shading
        return ping(
            around.targets,
            self.sonar,
            self.air,
            around.wood if "trunks" in shading else None,
            pose=self.place(state, row, time),
            equipment=self._equipment,
            everything=around.caster if "extinction" in shading else None,
            seed=seed,
            number=number,
        )

    def listen(
        self,
        around: Any,
        state: State,
        time: np.ndarray | None = None,
        seeds: Sequence[int] | None = None,
        numbers: np.ndarray | None = None,
    ) -> np.ndarray:
        """(N, *shape) what all flyers hear who ping at times (N,), s; seeds, numbers : as of ``ping``. What
        is left out is 0."""
        told = np.empty((len(state), *self.shape))
        none = np.zeros(len(state), dtype=np.int64)
        given = (none if part is None else part for part in (time, seeds, numbers))
        for row, (when, seed, number) in enumerate(zip(*given, strict=True)):
            echo = self.ping(around, state, row, float(when), int(seed), int(number))
            sound = echo.heard_waveforms
            is_picture = self.heard == "cochleagram"
            told[row] = cochleagram(sound, self.sonar) if is_picture else sound[:, : self.samples]
        return told


def cochleagram(sound: np.ndarray, sonar: Sonar) -> np.ndarray:
    """(E, BANDS, BINS) levels of sound (E, S) by frequency and time."""
    return levels(band_power(sound, sonar))


def levels(power: np.ndarray) -> np.ndarray:
    """(..., BINS) levels of squared envelopes (..., S) by time, 0 at ``FLOOR_DB`` and 1 at ``TOP_DB``: their
    mean in each bin, in dB.
    """
    count = power.shape[-1]
    edges = np.linspace(0, count, BINS, endpoint=False).astype(np.int64)
    size = np.diff(edges, append=count)
    mean = np.add.reduceat(power, edges, axis=-1) / size
    level = 10.0 * np.log10(np.maximum(mean, 1e-30))
    return np.clip((level - FLOOR_DB) / (TOP_DB - FLOOR_DB), 0.0, 1.0)


def power_of(level: np.ndarray) -> np.ndarray:
    """The squared envelopes of ``levels``."""
    return np.asarray(10.0 ** ((FLOOR_DB + level * (TOP_DB - FLOOR_DB)) / 10.0))


def band_power(sound: np.ndarray, sonar: Sonar) -> np.ndarray:
    """(E, BANDS, S) squared envelopes of sound (E, S) in bands that are as wide in octaves and overlap by
    half: raised cosines over log f, a filter bank of constant quality.
    """
    count = sound.shape[-1]
    length = fft.next_fast_len(count, real=True)
    spectrum = fft.rfft(sound, length, axis=-1)
    frequency = fft.rfftfreq(length, 1.0 / sonar.sample_rate)
    low, high = sonar.band
    place = np.log(np.maximum(frequency, 1.0) / low) / np.log(high / low) * (BANDS - 1)
    off = place - np.arange(BANDS)[:, None]
    window = np.where(np.abs(off) < 1.0, 0.5 + 0.5 * np.cos(np.pi * off), 0.0)
    analytic = np.zeros((len(sound), BANDS, length), dtype=np.complex128)
    analytic[..., : len(frequency)] = 2.0 * spectrum[:, None] * window
    envelope = fft.ifft(analytic, axis=-1, overwrite_x=True)[..., :count]
    return envelope.real**2 + envelope.imag**2


ODOMETRY = 8
FARTHEST = 1e7  # no number of odometry is larger


def odometry(
    flight: Flight, state: State, goal: np.ndarray, rngs: list[np.random.Generator] | None
) -> np.ndarray:
    """(N, 8) what flyers know of themselves: the aim ahead, to the left and above, metres; the velocity
    ahead, to the left and up, m/s; nose down and left side up, radians. With the spreads of the settings.
    """
    position, velocity, heading = state.position, state.velocity, state.heading
    if rngs is not None and (flight.position_sd or flight.velocity_sd or flight.heading_sd_deg):
        drawn = np.array([rng.standard_normal(7) for rng in rngs])
        position = position + flight.position_sd * drawn[:, :3]
        velocity = velocity + flight.velocity_sd * drawn[:, 3:6]
        heading = heading + np.deg2rad(flight.heading_sd_deg) * drawn[:, 6]
    towards = goal - position
    cos, sin = np.cos(heading), np.sin(heading)
    told = np.empty((len(heading), ODOMETRY))
    for first, vector in ((0, towards), (3, velocity)):
        told[:, first] = cos * vector[:, 0] + sin * vector[:, 1]
        told[:, first + 1] = cos * vector[:, 1] - sin * vector[:, 0]
        told[:, first + 2] = vector[:, 2]
    told[:, 6:] = state.tilt
    return told.clip(-FARTHEST, FARTHEST, out=told)


def generator(seed: int) -> np.random.Generator:
    """The chances of one flyer's episode."""
    return stream(seed, "flight", 0)
