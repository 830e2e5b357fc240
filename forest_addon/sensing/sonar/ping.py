"""A ping at a scene: the echo of leaves, wood and ground, as a bat-like sonar hears it (Tanveer et al.
2020a).

What sounds back (``targets``) goes in; the echo's spectrum and impulse response at every ear come out.
With f_i the scattering amplitude, S the beams of call and ear, b the absorption of the air, r_t and r_e
the distances from mouth and to ear,

    Y(f) = Σ_i S_emit·S_hear·f_i(k)/(r_t·r_e)·e^{-b(f)(r_t + r_e)}·e^{-ik(r_t + r_e)}

is the echo's pressure relative to the sent one at 1 m on the axis; S·L·λ/(2πr²) of Tanveer et al. 2020a is
the same.

The impulse response is the echo of a call whose spectrum is a Hann window over the band and whose
envelope at 1 m on the axis has the peak 1. So a leaf gives a pulse at 2r/c with the height of its |A|,
averaged over the band. The record reaches past the farthest that is heard, and past the pulse's tails:
nothing wraps around. ``Echo.waveform`` is the echo of the sonar's own call.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import fft

from ...base.progress import Progress
from ...spec import Air, Sonar
from ..rays.caster import RayCaster
from .calls import Band, BandGrid, grid_of
from .echo import Contributions, Echo, PingSeries
from .leaves import LeafDiscs
from .receiver import receive
from .search import Found, SearchGroup, mean_amplitude, search
from .shading import shade_of
from .station import Ears, Equipment, SonarPose, Station, posed
from .summation import Moment, fastest, moments_of, played, sum_echoes, widened
from .targets import EchoTargets
from .windy import at_moment


def ping(
    targets: EchoTargets | LeafDiscs,
    sonar: Sonar,
    air: Air,
    wood: RayCaster | None = None,
    progress: Progress | None = None,
    *,
    pose: SonarPose | None = None,
    equipment: Equipment | None = None,
    everything: RayCaster | None = None,
    seed: int = 0,
    number: int = 0,
) -> Echo:
    """Send one ping and sum the echo of all that sounds.

    wood : what hides scatterers where ``sonar.shading`` has "trunks"; None: nothing does.
    progress : called as progress(scatterers done, all of them).
    pose : where the sonar is, in place of the one its settings say.
    equipment : beams and call; needed where the settings name files.
    everything : rays that meet leaves, needed where ``sonar.shading`` has "extinction".
    seed, number : of the receiver's noise: the scene's seed, and which ping of a flight it is.

    Raises
    ------
    ValueError : the record would be longer than memory, or something needed is not given; the sentence
        says what to change.
    """
    if isinstance(targets, LeafDiscs):
        targets = EchoTargets.of_discs(targets)
    station = Station(sonar, air, pose or posed(sonar), equipment or Equipment.of(sonar))
    call = station.equipment.call
    band, rate = Band(*sonar.band), sonar.sample_rate
    hear = PingHearing(targets, station, band, wood, everything)
    targets, heard = hear.at(0.0)
    moments = [Moment(0.0, station, heard.groups)]
    latest = max((g.paths.latest for g in heard.groups), default=0.0)
    lasts, moving = 0.0, 0.0
    if call is not None:
        lasts = call.duration
        if sonar.doppler:
            moments = moments_of(moments[0], call, band.high, hear.moment)
            moving = max(fastest(moment.groups, station.pose) for moment in moments)
    wide = widened(band, moving, station.sound_speed) if moving else band
    grid = grid_of(wide, rate, latest / station.sound_speed, sonar.record, lasts)
    summed = sum_echoes(heard.groups, station, grid, sonar.tolerance, progress)
    spectra = summed.spectrum

    window = band.window(grid.frequency)
    analytic = _in_time(spectra * window, grid, grid.length / window.sum())
    waveforms = np.ascontiguousarray(analytic.real)
    responses, called = waveforms, spectra
    if call is not None:
        called = (
            played(moments, grid, sonar.tolerance, call)
            if moving
            else spectra * call.spectrum(grid.frequency)
        )
        waveforms = _in_time(called, grid, 2.0).real
    received = None
    if (receiver := station.equipment.receiver) is not None:
        ping_key = number, f"{station.pose.time:.9f}"
        ears, speed = Ears.of(sonar).offset, station.sound_speed
        received = receive(receiver, waveforms, ears, speed, seed, *ping_key)
    return Echo(
        frequency=grid.frequency,
        spectra=spectra,
        called=called,
        time=np.arange(grid.samples) / rate,
        responses=responses,
        envelopes=np.abs(analytic),
        waveforms=waveforms,
        leaves=targets.total(sonar, "leaf"),
        others=targets.total(sonar) - targets.total(sonar, "leaf"),
        **vars(heard.counts),
        close=sum(group.scatterers.count_close(group.instance) for group in heard.groups),
        doubtful=sum(
            group.scatterers.count_doubtful(station.point, station.wavenumbers[1])
            for group in heard.groups
        ),
        cull_bound=heard.bound,
        error_bound=summed.error_bound,
        table_error=summed.table_error,
        size=summed.size,
        groups=heard.groups,
        sound_speed=station.sound_speed,
        sample_rate=rate,
        pose=station.pose,
        list_heard=partial(contributions, heard.groups, station, band, targets),
        moments=len(moments),
        received=received,
    )


@dataclass(frozen=True)
class PingHearing:
    """Targets as a station hears them as time goes on; casters as of ``ping``."""

    targets: EchoTargets
    station: Station
    band: Band
    wood: RayCaster | None
    everything: RayCaster | None

    def at(self, time: float, station: Station | None = None) -> tuple[EchoTargets, Found]:
        """The targets and what is heard of them, s after the call begins."""
        then = self.station.pose.time + time
        targets = self.targets.at(then)
        wood, everything = at_moment(self.wood, then), at_moment(self.everything, then)
        return targets, heard_from(station or self.station, targets, self.band, wood, everything)

    def moment(self, time: float) -> Moment:
        """The moment at a time, s after the call begins, from where the sonar has flown to."""
        own = self.station
        gone = replace(own.pose, position=own.pose.position + time * own.pose.velocity)
        station = Station(own.sonar, own.air, gone, own.equipment)
        return Moment(time, station, self.at(time, station)[1].groups)


def heard_from(
    station: Station,
    targets: EchoTargets,
    band: Band,
    wood: RayCaster | None,
    everything: RayCaster | None,
) -> Found:
    """Return who is heard from a station, weakened by what stands in the way; casters as of ``ping``.

    Raises
    ------
    ValueError : shading by extinction without a caster.
    """
    sonar = station.sonar
    if "extinction" in sonar.shading and everything is None:
        raise ValueError("shading by extinction needs rays that meet leaves; give a caster")
    shade = shade_of(
        wood if "trunks" in sonar.shading else None,
        everything if "extinction" in sonar.shading else None,
        station,
    )
    return search(targets, station, band, shade, sonar.record or np.inf)


def _in_time(spectra: np.ndarray, grid: BandGrid, scale: float) -> np.ndarray:
    """(E, N) analytic signals of one-sided spectra (E, K): scale·(1/length)·Σ_k."""
    if grid.count == 1:
        turns = grid.start / grid.spacing * np.arange(grid.samples)
        return np.asarray(spectra * np.exp(2j * np.pi * np.remainder(turns, 1.0)))
    analytic = np.zeros((len(spectra), grid.length), dtype=np.complex128)
    first = round(grid.start / grid.spacing)
    analytic[:, first : first + grid.count] = spectra
    return fft.ifft(analytic, axis=1, overwrite_x=True)[:, : grid.samples] * scale


def contributions(
    groups: list[SearchGroup], station: Station, band: Band, targets: EchoTargets
) -> Contributions:
    """Contribution of each, loudest first."""
    if not groups:
        none, whole = np.empty(0), np.empty(0, np.int64)
        empty = np.empty(0, "U5")
        return Contributions(empty, whole, whole, whole, np.empty((0, 3)), none, none, none)
    amplitude = np.concatenate([mean_amplitude(g, station, band) for g in groups])
    order = np.argsort(-amplitude, kind="stable")
    motion = np.concatenate([g.motion for g in groups])[order]
    moves = motion.shape[1] > 0
    instance = np.concatenate([g.instance for g in groups])[order]
    legs = np.concatenate([g.paths.length[:, 0] for g in groups])[order]
    return Contributions(
        kind=np.repeat([g.scatterers.kind for g in groups], [len(g) for g in groups])[order],
        instance=instance,
        tree=targets.scene.tree[instance],
        number=np.concatenate([g.scatterers.number for g in groups])[order],
        position=np.concatenate([g.scatterers.centre for g in groups])[order],
        distance=np.concatenate([g.paths.distance for g in groups])[order],
        delay=legs / station.sound_speed,
        amplitude=amplitude[order],
        velocity=motion[:, :3] if moves else None,
        rest=motion[:, 3:] if moves else None,
    )


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
    seed: int = 0,
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
        echo = ping(
            targets,
            sonar,
            air,
            wood,
            pose=pose,
            equipment=equipment,
            everything=everything,
            seed=seed,
            number=number,
        )
        echoes.append(echo)
        if progress:
            progress(number + 1, len(poses))
    return PingSeries(tuple(echoes))
