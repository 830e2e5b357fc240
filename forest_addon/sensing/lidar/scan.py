"""A LiDAR scan: pulses go out, their sub-rays meet surfaces, echoes come back as a point cloud.

    pulses (``pattern``) → sub-rays (``footprint``) → contacts (``passage``) → light that comes back
    (``radiometry``) → echoes (``waveform``) → what the electronics make of them (``receiver``) → errors
    (``radiometry``) → returns with labels and truth

Each pulse is a function of its number and the seed alone, so a scan may be cut anywhere. A surface
counts where its distance lies in [min_range, max_range], both ends included; what is nearer hides what
is behind it all the same. Limits hold for the true range; noise is added after.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.progress import Progress
from ...base.rng import child_keys, first_key
from ...base.rows import distinct
from ...base.trimesh import LEAF
from ...base.vectors import azimuth_of
from ..kind import Observation
from ..moving_rays import exactly
from ..rays.caster import Hits, RayCaster, hit_normals
from ..rays.exact import Referee
from ..rays.geometry import SceneGeometry
from ..trajectory import Trajectory
from .cloud import Cloud, Lost, join, label
from .footprint import blurred_patches, spread
from .passage import Contacts, Received, meet
from .pattern import LiDAR, Pattern, Pulses, pattern_of
from .radiometry import (
    detection_limit,
    light_back,
    range_error,
    reflectance_of,
    refuse_surplus,
    registration,
    survives_drop_out,
)
from .receiver import (
    arrives_awake,
    awake,
    chosen_returns,
    false_echoes,
    noisy_light,
    ranks,
    reading,
    unambiguous_range,
)
from .specular import DIRECT, Halo, SpecularScene, follow
from .waveform import (
    LIGHT,
    Bins,
    Waveforms,
    find_echoes,
    fitted_echoes,
    pulse_length,
    record,
    sent_pulse,
)

RAYS_AT_ONCE = 32_768
FINE_STEP = 0.25  # pulse lengths between samples that nobody told
FAINT_CREST = 0.5  # of the faintest echo's crest, that a Gaussian is fitted to: others add to it
MOST_LOST = 100  # pulses of a scan; beyond, it is not a pulse that is at fault


class Scan:
    """A scanner in a scene, ready to send its pulses.

    pattern : pulses that are sent in place of the scanner's own. specular : mirrors, glass and water that it
    follows; None where there are none.

    Raises
    ------
    SpecError : a mobile scanner that has nowhere to go; a surface that gives more light than arrives.
    """

    def __init__(
        self,
        scanner: LiDAR,
        caster: Any,
        seed: int = 0,
        path: Trajectory | None = None,
        pattern: Pattern | None = None,
    ) -> None:
        refuse_surplus(caster.scene, scanner.surfaces)
        self.scanner, self.caster = scanner, caster
        self.pattern = pattern_of(scanner, path) if pattern is None else pattern
        self._key = first_key(seed, "lidar", scanner.name)
        self.pulses = self.pattern.count
        self.at_once = max(1, RAYS_AT_ONCE // scanner.beam.subrays)
        self._halo = None if caster.moving else Halo.of(scanner, caster.scene)
        self.specular = SpecularScene.of(caster.scene, scanner)
        self._unfollowed = 0
        self._subrays, self._sigma = scanner.beam.subrays, pulse_length(scanner.beam.pulse_ns)
        self._share = np.full(self._subrays, 1 / self._subrays)  # of a pulse's light, of each ray
        self._bins: Bins | None = None  # echoes are crests of waveforms
        self._step, self._fits = 0.0, scanner.receiver.echoes == "gaussians"
        if self._fits or scanner.receiver.sample_ns:
            self._step = scanner.receiver.sample_ns * 1e-9 * LIGHT / 2 or FINE_STEP * self._sigma
            self._sent = sent_pulse(scanner.beam, self._step)
        # light a metre of range at the crest of the faintest echo that is seen
        self._faintest = detection_limit(scanner) / (self._sigma * np.sqrt(2 * np.pi))
        self._by_chance = scanner.surfaces.leaf_transmittance > 0  # what a ray meets
        self._lost = 0
        self._waves: Waveforms | None = None

    @classmethod
    def of(cls, job: Observation) -> Scan:
        """The scan of a scanner in its scene."""
        return cls(job.sensor, job.caster, job.settings.seed, job.trajectory)

    def moved(self, seed: int, path: Trajectory) -> Scan:
        """The same scanner in the same scene on another path, with the chances of another seed."""
        other = copy(self)
        other.pattern = pattern_of(self.scanner, path)
        other._key = first_key(seed, "lidar", self.scanner.name)
        other.pulses = other.pattern.count
        return other

    def exactly(self, true: SceneGeometry | None = None) -> Scan:
        """The same scan with every ray held against float64. true : the scene that is; left out: its own."""
        other = copy(self)
        other.caster = Referee(self.caster, exactly(self.caster, true))
        return other

    def look(self, first: int, stop: int) -> Cloud:
        """The returns of the pulses from number ``first`` to before ``stop``."""
        return self.look_at(np.arange(first, stop))

    def look_at(self, number: np.ndarray) -> Cloud:
        """The returns of the pulses of these numbers (P,), ascending."""
        pulses = self.pattern.pulses(number)
        keys = child_keys(self._key, number)
        self._unfollowed = 0
        if self.scanner.receiver.beyond == "folded":
            return self._measure(pulses, number, keys, self._folded(number))
        returns = self._found(pulses, keys)
        if self.scanner.receiver.blanking:
            returns = returns.select(
                np.flatnonzero(arrives_awake(self.scanner, returns.echoes.distance))
            )
        return self._measure(pulses, number, keys, returns)

    def rays(self, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Origins and directions (P·S, 3) of the rays of the pulses of these numbers (P,), pulse by pulse."""
        return self._rays(self.pattern.pulses(number), child_keys(self._key, number))

    def _rays(self, pulses: Pulses, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return origins and directions of the rays of pulses with these keys, pulse by pulse."""
        return spread(pulses, self.scanner.beam, keys)

    def _found(self, pulses: Pulses, keys: np.ndarray) -> Received:
        """Return the echoes of pulses and their halos, before the receiver."""
        rays, count = self._rays(pulses, keys), self._subrays
        of_rays = np.repeat(keys, count)
        if count > 1 and self._by_chance:
            of_rays = child_keys(of_rays, np.tile(np.arange(count), len(keys)))
        contacts = self._met(rays, of_rays, np.repeat(pulses.time, count))
        direct = self._received(contacts)
        return direct if self._halo is None else self._halo.added(self.caster, pulses, keys, direct)

    def _met(
        self, rays: tuple[np.ndarray, np.ndarray], keys: np.ndarray, at: np.ndarray
    ) -> Contacts:
        """Contacts of rays from origins in directions, at times."""
        limits = self.scanner.max_range, self.scanner.surfaces
        if self.specular is None:
            return meet(self.caster, *rays, *limits, keys, at)
        contacts, ended = follow(self.caster, self.specular, rays, *limits, keys)
        self._unfollowed += ended
        return contacts

    def _folded(self, number: np.ndarray) -> Received:
        """Return the echoes that arrive after these pulses were sent and before the next, of whichever pulse,
        at the range that they seem to have."""
        period = unambiguous_range(self.scanner)
        late = np.arange(int(self.scanner.max_range // period) + 1)
        sent = distinct(number[:, None] - late)
        sent = sent[sent >= 0]
        arriving = self._found(self.pattern.pulses(sent), child_keys(self._key, sent))
        rounds = np.floor(arriving.echoes.distance / period)
        arrives = sent[arriving.echoes.pulse] + rounds.astype(np.int64)
        place = np.searchsorted(number, arrives)
        seems = arriving.echoes.distance - rounds * period
        here = np.append(number, -1)[place] == arrives
        here &= arrives_awake(self.scanner, arriving.echoes.distance)
        rows = np.flatnonzero(here & (seems >= self.scanner.min_range))
        rows = rows[np.lexsort((seems[rows], place[rows]))]
        arriving = arriving.select(rows)
        return replace(
            arriving, echoes=replace(arriving.echoes, pulse=place[rows], distance=seems[rows])
        )

    def chunks(self, first: int = 0, at_once: int | None = None) -> Iterator[tuple[int, Cloud]]:
        """Pieces of the scan from pulse ``first`` on: where each ends, and what it found.

        A pulse on which the program fails costs no other: it is looked for by halves and named in the
        cloud's ``lost``.
        """
        step = at_once or self.at_once
        for begin in range(first, self.pulses, step):
            stop = min(begin + step, self.pulses)
            yield stop, self.look_around_faults(np.arange(begin, stop))

    def look_around_faults(self, number: np.ndarray) -> Cloud:
        """Cast pulses as ``look_at`` does; the cloud's ``lost`` names those on which the program fails."""
        try:
            return self.look_at(number)
        except MemoryError:
            raise  # no pulse is at fault
        except Exception as fault:
            if len(number) > 1:
                middle = len(number) // 2
                halves = [number[:middle], number[middle:]]
                return join([self.look_around_faults(half) for half in halves])
            self._lost += 1
            if self._lost > MOST_LOST:
                raise
            first, why = int(number[0]), f"{type(fault).__name__}: {fault}"
            lost = (Lost(first, first + 1, why),)
            return replace(self.look_at(number[:0]), pulses=1, lost=lost)

    def _received(self, contacts: Contacts) -> Received:
        """Return the echoes of the light that contacts send back."""
        scanner, scene, hits, way = self.scanner, self.caster.scene, contacts.hits, contacts.way
        normal = hit_normals(scene, hits)
        reflectance = reflectance_of(scene, hits, contacts.organ, scanner.surfaces)
        light, distance, blur = (reflectance, contacts.light), hits.distance, None
        seen = distance, normal, way, scanner.beam.extinction, scanner.min_range
        energy = light_back(contacts.ray, self._share, light, *seen)
        common = contacts.ray, self._subrays
        if self._subrays > 1 and self._bins is None:
            bounce = np.int8(DIRECT) if contacts.bounce is None else contacts.bounce
            surface = np.where(contacts.organ == LEAF, np.int8(-1), bounce)
            rays = contacts.origin, way
            distance, blur = blurred_patches(
                *common, surface, distance, energy, rays, normal, self._sigma
            )
        if self._step and self._bins is None:
            blur = np.zeros(len(distance)) if blur is None else blur
            self._waves = record(*common, distance, energy, blur, self._sent, self._step)
        if self._waves is not None and self._fits:
            echoes = fitted_echoes(
                self._waves, *common, distance, energy, self._sigma, FAINT_CREST * self._faintest
            )
        else:
            echoes = find_echoes(*common, distance, energy, self._sigma, blur, self._bins)
        chosen = echoes.contact
        gone = None if contacts.bounce is None else contacts.bounce[chosen]
        return Received(echoes, hits.select(chosen), way[chosen], normal[chosen], gone)

    def _measure(
        self, pulses: Pulses, number: np.ndarray, keys: np.ndarray, received: Received
    ) -> Cloud:
        """Returns that the receiver makes of echoes."""
        scanner = self.scanner
        if scanner.receiver.threshold_snr:
            # echoes with the receiver's noise, and those of noise alone, which meet nothing
            light = noisy_light(self.scanner, received.echoes, keys)
            false = false_echoes(self.scanner, keys)
            both = Received.joined(
                [
                    replace(received, echoes=replace(received.echoes, energy=light)),
                    Received(
                        false,
                        replace(Hits.misses(len(false.pulse)), distance=false.distance),
                        pulses.direction[false.pulse],
                        np.full((len(false.pulse), 3), np.nan),
                        None
                        if received.bounce is None
                        else np.zeros(len(false.pulse), dtype=np.int8),
                    ),
                ]
            )
            received = both.select(np.lexsort((both.echoes.distance, both.echoes.pulse)))
        crest = received.echoes.energy * (self._sigma / received.echoes.width)
        received = received.select(np.flatnonzero(crest >= detection_limit(scanner)))
        received = received.select(awake(received.echoes, scanner.receiver.dead_zone))
        return_keys = child_keys(keys[received.echoes.pulse], ranks(received.echoes.pulse))
        kept = np.flatnonzero(survives_drop_out(scanner.noise, return_keys))
        received, return_keys = received.select(kept), return_keys[kept]
        kept = chosen_returns(received.echoes, scanner.beam.max_returns, scanner.receiver.keep)
        received, return_keys = received.select(kept), return_keys[kept]
        echoes = received.echoes
        rank = ranks(echoes.pulse)

        gone, waves = received.bounce, None
        if scanner.bounces and gone is None:
            gone = np.full(len(echoes.pulse), DIRECT, dtype=np.int8)
        if scanner.receiver.sample_ns and self._waves is not None:
            counted = self._waves.counted(self._faintest, keys, scanner.receiver)
            waves = replace(counted, pulse=number[counted.pulse])
        labelled = label(self.caster.scene, received.hits, received.way, received.normal)
        measured = echoes.distance + range_error(
            scanner.noise, echoes.distance, labelled.cos_incidence, return_keys
        )
        travelled = echoes.distance
        if scanner.receiver.beyond == "folded":
            period = unambiguous_range(scanner)
            travelled = travelled + period * np.round((received.hits.distance - travelled) / period)
        way = pulses.direction[echoes.pulse]
        velocity = rest = None
        moving = self.caster.moving
        if moving is not None:
            met = pulses.origin[echoes.pulse] + labelled.distance[:, None] * received.way
            which = labelled.instance, labelled.triangle
            velocity, rest = moving.velocities(met, *which, pulses.time[echoes.pulse])
            instance, triangle = moving.known(*which)
            labelled = replace(labelled, instance=instance, triangle=triangle)
        return Cloud(
            position=self.placed(pulses.select(echoes.pulse), measured),
            pulse=number[echoes.pulse],
            time=pulses.time[echoes.pulse],
            number=(rank + 1).astype(np.uint8),
            count=np.bincount(echoes.pulse, minlength=len(pulses))[echoes.pulse].astype(np.uint8),
            azimuth=azimuth_of(way),
            elevation=np.arcsin(np.clip(way[:, 2], -1, 1)),
            scan_angle=pulses.scan_angle[echoes.pulse],
            intensity=reading(scanner, echoes.energy, measured),
            width=echoes.width * 2 / LIGHT,
            true_range=travelled,
            returns=replace(labelled, distance=measured),
            pulses=len(pulses),
            engine=self.caster.engine,
            velocity=velocity,
            rest=rest,
            bounce=gone,
            unfollowed=self._unfollowed,
            waves=waves,
        )

    def placed(self, pulses: Pulses, distance: np.ndarray) -> np.ndarray:
        """(P, 3) points at distances (P,) along pulses, in the joined cloud."""
        origin, way, noise = pulses.origin, pulses.direction, self.scanner.noise
        if noise.registration_sd_or_deg and len(origin):
            turn, shift = registration(noise, self._key, pulses.time)
            origin, way = origin + shift, turn.apply(way)
        return np.asarray(origin + distance[:, None] * way)


def scan(
    scanner: LiDAR,
    caster: RayCaster,
    seed: int = 0,
    path: Trajectory | None = None,
    progress: Progress | None = None,
) -> Cloud:
    """A whole scan in memory; ``results.scan_file`` writes one of any size to disk.

    seed : scene seed, for noise and chances. path : see ``pattern.pattern_of``.

    Raises
    ------
    SpecError : a mobile scanner that has nowhere to go.
    """
    work = Scan(scanner, caster, seed, path)
    pieces = []
    for done, piece in work.chunks():
        pieces.append(piece)
        if progress:
            progress(done, work.pulses)
    return join(pieces)
